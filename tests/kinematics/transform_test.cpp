// kinematics/transform.h: exp and log, their Jacobians, adjoint, roll-pitch-yaw and quaternions.
//
// Proves: exp and log are inverse to rounding, and every Jacobian agrees entry by entry with
// central differences, at random vectors, at zero, at 1e-8 and near pi; rpy reproduces a rotation
// to rounding at any distance from its pole. Does not prove: the digits of a Jacobian below 1e-9
// (central differences end there), log beyond a half turn (it is not defined).
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <vector>

#include "../../kinematics/transform.h"

namespace transform_test {

using namespace kincal;

namespace {

constexpr double kStep = 1e-5;  // of central differences: truncation 1e-10, rounding 1e-11

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1p-53);
  }
  Vector3d vector(double size) {
    return {(*this)(-size, size), (*this)(-size, size), (*this)(-size, size)};
  }
  Vector3d direction() {
    Vector3d v;
    do v = vector(1);
    while (v.norm() > 1 || v.norm() < 0.1);
    return v.normalized();
  }
  Matrix3d rotation() { return exp_so3((*this)(0, kPi) * direction()); }
  Pose pose() { return {rotation(), vector(2)}; }

 private:
  std::mt19937_64 engine_;
};

/// Rotation vectors of every kind: zero, along the axes, tiny, around the switches to series,
/// random, close to a half turn.
std::vector<Vector3d> rotation_vectors(double largest) {
  Random random(1);
  std::vector<Vector3d> vectors{Vector3d::Zero()};
  for (double angle : {1e-8, 0.99e-5, 1.01e-5, 0.99e-3, 1.01e-3, 0.1, 1.0, 2.0, largest}) {
    for (int axis = 0; axis < 3; ++axis) {
      vectors.push_back(angle * Vector3d::Unit(axis));
      vectors.push_back(-angle * Vector3d::Unit(axis));
    }
    for (int i = 0; i < 10; ++i) vectors.push_back(angle * random.direction());
  }
  for (int i = 0; i < 50; ++i) vectors.push_back(random(0, largest) * random.direction());
  return vectors;
}

std::vector<Vector6d> twists(double largest) {
  Random random(2);
  std::vector<Vector6d> list{Vector6d::Zero(), Vector6d::Constant(1e-8)};
  for (const Vector3d& w : rotation_vectors(largest)) {
    Vector6d xi;
    xi << random.vector(1), w;
    list.push_back(xi);
  }
  return list;
}

template <class A, class B>
double largest_difference(const A& a, const B& b) {
  return (a - b).cwiseAbs().maxCoeff();
}

double largest_difference(const Pose& a, const Pose& b) {
  return std::max(largest_difference(a.rotation, b.rotation),
                  largest_difference(a.translation, b.translation));
}

/// Checks each entry, so that the message names it.
template <class A, class B>
void check_entries(const A& analytic, const B& numeric, double tolerance) {
  for (Eigen::Index i = 0; i < analytic.rows(); ++i)
    for (Eigen::Index j = 0; j < analytic.cols(); ++j) {
      INFO("entry " << i << ", " << j << ": " << analytic(i, j) << " against " << numeric(i, j));
      CHECK(std::abs(analytic(i, j) - numeric(i, j)) < tolerance);
    }
}

}  // namespace

TEST_CASE("skew is the cross product") {
  Random random(3);
  const Vector3d a = random.vector(1), b = random.vector(1);
  CHECK(largest_difference(skew(a) * b, a.cross(b)) < 1e-16);
}

TEST_CASE("exp and log of rotations are inverse to rounding") {
  for (const Vector3d& w : rotation_vectors(kPi - 1e-9)) {
    INFO("w = " << w.transpose() << ", length " << w.norm());
    const Matrix3d r = exp_so3(w);
    CHECK(largest_difference(r * r.transpose(), Matrix3d::Identity()) < 2e-15);
    CHECK(r.determinant() == Approx(1).epsilon(1e-14));
    CHECK(largest_difference(r,
                             Eigen::AngleAxisd(w.norm(), w.stableNormalized()).toRotationMatrix()) <
          1e-15);  // another's formula
    CHECK(largest_difference(log_so3(r), w) < 4e-15);
  }
  CHECK(log_so3(exp_so3(1e-8 * Vector3d::UnitY())).y() ==
        Approx(1e-8).epsilon(1e-12));  // relative too
  CHECK(log_so3(Matrix3d::Identity()).norm() == 0);
}

TEST_CASE("the rotation between two vectors is the least one, also where they are opposite") {
  Random random(12);
  for (int i = 0; i < 200; ++i) {
    const Vector3d a = random(0.1, 3) * random.direction();
    const Vector3d across = a.cross(random.direction());
    std::vector<Vector3d> others = {random(0.1, 3) * random.direction(), 2 * a, -2 * a};
    for (double off = 1; off > 1e-17; off /= 10) others.push_back(-a + off * across);
    for (const Vector3d& b : others) {
      const Matrix3d r = rotation_between(a, b);
      CHECK(largest_difference(r * r.transpose(), Matrix3d::Identity()) < 1e-9);
      CHECK(r.determinant() == Approx(1));
      CHECK((r * a.normalized() - b.normalized()).norm() < 1e-9);
      CHECK(log_so3(r).norm() == Approx(std::atan2(a.cross(b).norm(), a.dot(b))).epsilon(1e-6));
    }
  }
}

TEST_CASE("log of exactly half a turn has length pi and gives the rotation back") {
  Random random(4);
  for (int i = 0; i < 50; ++i) {
    const Vector3d axis = i < 3 ? Vector3d(Vector3d::Unit(i)) : random.direction();
    const Matrix3d r = 2 * axis * axis.transpose() - Matrix3d::Identity();
    CHECK(log_so3(r).norm() == Approx(kPi).epsilon(1e-15));
    CHECK(largest_difference(exp_so3(log_so3(r)), r) < 2e-15);
  }
}

TEST_CASE("exp and log of motions are inverse to rounding") {
  for (const Vector6d& xi : twists(kPi - 1e-6)) {
    INFO("xi = " << xi.transpose());
    CHECK(largest_difference(log_se3(exp_se3(xi)), xi) < 1e-14);
  }
  Random random(5);
  for (int i = 0; i < 50; ++i) {
    const Pose t = random.pose();
    CHECK(largest_difference(exp_se3(log_se3(t)), t) < 1e-14);
  }
}

TEST_CASE("left Jacobian of rotations and its inverse agree with central differences") {
  for (const Vector3d& w : rotation_vectors(kPi - 1e-3)) {
    INFO("w = " << w.transpose());
    Matrix3d forward, backward;
    for (int i = 0; i < 3; ++i) {
      const Vector3d d = kStep * Vector3d::Unit(i);
      forward.col(i) =
          (log_so3(exp_so3(w + d) * exp_so3(-w)) - log_so3(exp_so3(w - d) * exp_so3(-w))) /
          (2 * kStep);
      backward.col(i) =
          (log_so3(exp_so3(d) * exp_so3(w)) - log_so3(exp_so3(-d) * exp_so3(w))) / (2 * kStep);
    }
    check_entries(left_jacobian_so3(w), forward, 1e-9);
    check_entries(inverse_left_jacobian_so3(w), backward, 1e-9);
  }
}

TEST_CASE("inverse left Jacobian is the inverse, past half a turn too") {
  for (const Vector3d& w : rotation_vectors(5.5)) {
    INFO("w = " << w.transpose());
    check_entries(left_jacobian_so3(w) * inverse_left_jacobian_so3(w), Matrix3d::Identity(), 1e-14);
  }
}

TEST_CASE("right Jacobian of motions agrees with central differences") {
  for (const Vector6d& xi : twists(kPi - 1e-6)) {
    INFO("xi = " << xi.transpose());
    const Pose back = inverse(exp_se3(xi));
    Matrix6d numeric;
    for (int i = 0; i < 6; ++i) {
      const Vector6d d = kStep * Vector6d::Unit(i);
      numeric.col(i) =
          (log_se3(back * exp_se3(xi + d)) - log_se3(back * exp_se3(xi - d))) / (2 * kStep);
    }
    check_entries(right_jacobian_se3(xi), numeric, 2e-9);
  }
}

TEST_CASE("adjoint carries a twist through a motion") {
  Random random(6);
  for (int i = 0; i < 50; ++i) {
    const Pose t = random.pose();
    Vector6d xi;
    xi << random.vector(1), random.vector(1);
    CHECK(largest_difference(t * exp_se3(xi), exp_se3(adjoint(t) * xi) * t) < 1e-14);
    const Pose u = random.pose();
    check_entries(adjoint(t * u), adjoint(t) * adjoint(u), 1e-14);
  }
}

TEST_CASE("a twist on the left moves points by v + w x p") {
  Random random(7);
  const Vector3d v = random.vector(1), w = random.vector(1), p = random.vector(2);
  Vector6d xi;
  xi << v, w;
  const Vector3d numeric = (exp_se3(kStep * xi) * p - exp_se3(-kStep * xi) * p) / (2 * kStep);
  check_entries(Vector3d(v + w.cross(p)), numeric, 1e-9);
}

TEST_CASE("pose products and inverses") {
  Random random(8);
  const Pose a = random.pose(), b = random.pose();
  const Vector3d p = random.vector(1);
  CHECK(largest_difference((a * b) * p, a * (b * p)) < 2e-15);
  CHECK(largest_difference(a * inverse(a), Pose{}) < 2e-15);
}

TEST_CASE("rpy is Rz(yaw) Ry(pitch) Rx(roll)") {
  Random random(9);
  for (int i = 0; i < 100; ++i) {
    const Vector3d rpy = random.vector(kPi);
    const Matrix3d r = (Eigen::AngleAxisd(rpy.z(), Vector3d::UnitZ()) *
                        Eigen::AngleAxisd(rpy.y(), Vector3d::UnitY()) *
                        Eigen::AngleAxisd(rpy.x(), Vector3d::UnitX()))
                           .toRotationMatrix();
    CHECK(largest_difference(rotation_from_rpy(rpy), r) < 2e-15);
  }
  CHECK(rpy_from_rotation(Matrix3d::Identity()) == Vector3d::Zero());
}

TEST_CASE("rpy away from the pole gives the angles back") {
  Random random(10);
  for (int i = 0; i < 200; ++i) {
    const Vector3d rpy(random(-kPi, kPi), random(-1.5, 1.5), random(-kPi, kPi));
    CHECK(largest_difference(rpy_from_rotation(rotation_from_rpy(rpy)), rpy) < 1e-14);
  }
}

TEST_CASE("rpy reproduces the rotation to rounding at every distance from pitch +-90 degrees") {
  Random random(11);
  for (double distance : {0.0, 1e-16, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7,
                          1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1.0})
    for (double sign : {-1.0, 1.0})
      for (int i = 0; i < 50; ++i) {
        const Vector3d rpy(random(-kPi, kPi), sign * (kPi / 2 - distance), random(-kPi, kPi));
        INFO("rpy = " << rpy.transpose() << ", distance " << distance);
        const Matrix3d exact = rotation_from_rpy(rpy);
        CHECK(largest_difference(rotation_from_rpy(rpy_from_rotation(exact)), exact) < 1e-15);
        // The same rotation as a product: orthonormal to rounding only, as after folding an offset
        // into an origin.
        const Matrix3d some = random.rotation(), product = some * (some.transpose() * exact);
        CHECK(largest_difference(rotation_from_rpy(rpy_from_rotation(product)), product) < 3e-15);
      }
}

TEST_CASE("quaternions give the rotation back in all four branches") {
  Random random(12);
  int branch_seen[4] = {};
  const auto check = [&](const Matrix3d& r) {
    const Eigen::Vector4d q = quaternion_from_rotation(r);
    INFO("q = " << q.transpose());
    CHECK(q(3) >= 0);
    CHECK(q.norm() == Approx(1).epsilon(1e-15));
    CHECK(largest_difference(rotation_from_quaternion(q), r) < 2e-15);
    CHECK(largest_difference(rotation_from_quaternion(-3.5 * q), r) < 2e-15);  // any length
    CHECK(largest_difference(Eigen::Quaterniond(q(3), q(0), q(1), q(2)).toRotationMatrix(), r) <
          2e-15);  // another's formula
    Eigen::Index largest;
    q.cwiseAbs().maxCoeff(&largest);
    ++branch_seen[largest];
  };
  check(Matrix3d::Identity());
  for (int axis = 0; axis < 3; ++axis)
    for (double angle : {-kPi, -3.0, -1e-8, 1e-8, kPi / 2, 3.0, kPi - 1e-8, kPi})
      check(exp_so3(angle * Vector3d::Unit(axis)));
  for (int i = 0; i < 500; ++i) check(random.rotation());
  for (int count : branch_seen) CHECK(count > 10);
}

}  // namespace transform_test
