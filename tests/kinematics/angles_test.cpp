// kinematics/angles.h: three numbers as rotations and back.
//
// Proves: each convention's rotation against elementary turns of Eigen; both triples give the
// rotation that they are of, also at and near the places where an angle is not unique; the first
// triple is a usual one. Not proved: which of them a maker's controller writes.
#include <catch2/catch.hpp>

#include "../../kinematics/angles.h"
#include "../fixtures/random.h"

namespace angles_test {

using namespace kincal;
using Eigen::AngleAxisd;

namespace {

Matrix3d turn(int axis, double angle) {
  return AngleAxisd(angle, Vector3d::Unit(axis)).toRotationMatrix();
}

Matrix3d by_elementary_turns(Angles which, const Vector3d& n) {
  switch (which) {
    case Angles::roll_pitch_yaw:
      return turn(2, n(2)) * turn(1, n(1)) * turn(0, n(0));
    case Angles::a_b_c:
      return turn(2, n(0)) * turn(1, n(1)) * turn(0, n(2));
    case Angles::moving_x_y_z:
      return turn(0, n(0)) * turn(1, n(1)) * turn(2, n(2));
    case Angles::z_y_z:
      return turn(2, n(0)) * turn(1, n(1)) * turn(2, n(2));
    case Angles::rotation_vector:
      return AngleAxisd(n.norm(), n.normalized()).toRotationMatrix();
  }
  return {};
}

}  // namespace

TEST_CASE("angles: each convention is that of elementary turns, and is inverted") {
  fixture::Random random(5);
  for (int c = 0; c < kAngleConventions; ++c) {
    const AngleConvention& convention = angle_convention(static_cast<Angles>(c));
    INFO(convention.name);
    for (int i = 0; i < 200; ++i) {
      Vector3d n;
      for (int k = 0; k < 3; ++k) n(k) = random.uniform(-3, 3);
      if (i % 4 == 0) n(1) = (i % 8 == 0 ? 0 : kPi / 2) + (i % 16 < 8 ? 0 : 1e-9);  // not unique
      const Matrix3d r = convention.rotation(n);
      CHECK((r - by_elementary_turns(static_cast<Angles>(c), n)).norm() < 1e-14);
      const auto both = convention.numbers(r);
      CHECK((convention.rotation(both[0]) - r).norm() < 1e-13);
      CHECK((convention.rotation(both[1]) - r).norm() < 1e-13);
      CHECK(convention.usual(both[0]));
    }
    CHECK((convention.rotation(convention.numbers(Matrix3d::Identity())[0]) - Matrix3d::Identity())
              .norm() < 1e-15);
  }
}

}  // namespace angles_test
