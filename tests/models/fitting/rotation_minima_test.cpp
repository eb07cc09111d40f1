// models/fitting/rotation_minima.h: every minimum of a sum of squares that is linear in a rotation.
//
// Proves: on rigid fits the least minimum is Kabsch's, with its translation and its cost; every
// minimum is one (no small turn is better), and no rotation of many drawn ones is below the least;
// a plane seen from afar has its two mirror solutions; turns that change nothing are said to be
// undetermined. Does not prove: that no minimum is ever missed.
#include <catch2/catch.hpp>

#include "../../../models/fitting/closed_form.h"
#include "../../../models/fitting/rotation_minima.h"
#include "../../fixtures/random.h"
#include "../../fixtures/transforms.h"

namespace rotation_minima_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// x' S x of sum |W_i (R a_i + t - b_i)|^2.
MatrixXd form(const Matrix3Xd& a, const Matrix3Xd& b, const std::vector<Matrix3d>& weights) {
  MatrixXd s = MatrixXd::Zero(13, 13), row(3, 13);
  for (Eigen::Index i = 0; i < a.cols(); ++i) {
    const Matrix3d& w = weights[static_cast<size_t>(i)];
    set_rotation_columns(w, a.col(i), row.leftCols<9>());
    row.middleCols<3>(9) = w;
    row.col(12) = -w * b.col(i);
    s += row.transpose() * row;
  }
  return s;
}

double cost_of(const MatrixXd& s, const Matrix3d& r) {  // at the best translation
  VectorXd x(13);
  x << r.col(0), r.col(1), r.col(2), Vector3d::Zero(), 1;
  const Vector3d t = -s.block<3, 3>(9, 9).inverse() * (s.middleRows<3>(9) * x);
  x.segment<3>(9) = t;
  return x.dot(s * x);
}

}  // namespace

TEST_CASE("rotation minima: the rigid fit, and nothing below it") {
  Random random(5);
  for (int trial = 0; trial < 30; ++trial) {
    const Pose truth = random.pose(2, kPi);
    Matrix3Xd a(3, 6), b(3, 6);
    for (int i = 0; i < 6; ++i) {
      a.col(i) = random.vector(1);
      b.col(i) = truth * Vector3d(a.col(i)) + random.vector(0.1);
    }
    const MatrixXd s = form(a, b, std::vector<Matrix3d>(6, Matrix3d::Identity()));
    const std::vector<RotationMinimum> minima = rotation_minima(s);
    REQUIRE_FALSE(minima.empty());
    const Pose fitted = fit_points(a, b);
    CHECK((minima[0].rotation - fitted.rotation).norm() < 1e-6);
    CHECK((minima[0].others - fitted.translation).norm() < 1e-6);
    CHECK(minima[0].directions == 3);
    double cost = 0;
    for (int i = 0; i < 6; ++i) cost += (fitted * Vector3d(a.col(i)) - b.col(i)).squaredNorm();
    CHECK(minima[0].cost == Approx(cost).epsilon(1e-9));
    for (const RotationMinimum& m : minima) {
      CHECK(m.cost == Approx(cost_of(s, m.rotation)).epsilon(1e-6));
      for (int k = 0; k < 10; ++k)
        CHECK(cost_of(s, m.rotation * exp_so3(random.vector(0.01))) > m.cost * (1 - 1e-9));
    }
    for (int k = 0; k < 100; ++k) CHECK(cost_of(s, random.rotation(kPi)) > minima[0].cost);
  }
}

TEST_CASE(
    "rotation minima: a plane seen from afar has two, and turns about a line change nothing") {
  Random random(6);
  Matrix3Xd plane(3, 12), rays(3, 12);
  std::vector<Matrix3d> across;
  const Pose truth = {exp_so3({0.5, 0.3, 0.2}), {0.1, -0.05, 3}};
  for (int i = 0; i < 12; ++i) {
    plane.col(i) << 0.05 * (i % 4), 0.05 * (i / 4), 0;
    const Vector3d d = (truth * Vector3d(plane.col(i))).normalized();
    across.push_back(Matrix3d::Identity() - d * d.transpose());
  }
  const std::vector<RotationMinimum> minima = rotation_minima(form(plane, 0 * plane, across));
  int before = 0;
  for (const RotationMinimum& m : minima) before += m.others.z() > 0;
  CHECK(before == 2);
  CHECK((minima[0].rotation - truth.rotation).norm() < 1e-6);

  Matrix3Xd line(3, 5);
  for (int i = 0; i < 5; ++i) line.col(i) << 0.1 * i, 0.2 * i, 0;
  const std::vector<Matrix3d> all(5, Matrix3d::Identity());
  CHECK(rotation_minima(form(line, line, all))[0].directions == 2);
}

}  // namespace rotation_minima_test
