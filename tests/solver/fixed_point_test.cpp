#include "../../solver/fixed_point.h"

#include <Eigen/LU>
#include <catch2/catch.hpp>
#include <cmath>

namespace fixed_point_test {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using kincal::FixedPoint;

TEST_CASE("A slow linear fixed point is exact once as many steps are known as it has dimensions") {
  MatrixXd a(3, 3);
  a << 0.95, 0.02, 0, 0.01, 0.8, 0.05, 0, 0.1, 0.5;
  const VectorXd b = VectorXd::LinSpaced(3, -1, 2),
                 solution = (MatrixXd::Identity(3, 3) - a).partialPivLu().solve(b);
  FixedPoint fixed_point(3, 1e9);
  VectorXd x = VectorXd::Zero(3);
  for (int i = 0; i < 5; ++i) x = fixed_point.next(x, a * x + b);
  CHECK((x - solution).norm() < 1e-9 * solution.norm());
  VectorXd plain = VectorXd::Zero(3);
  for (int i = 0; i < 5; ++i) plain = a * plain + b;
  CHECK((plain - solution).norm() > 0.5 * solution.norm());
}

TEST_CASE("Where the map is nonlinear the fixed point is reached all the same") {
  const auto map = [](const VectorXd& x) -> VectorXd { return x.array().cos(); };
  FixedPoint fixed_point(2, 0.5);
  VectorXd x = VectorXd::Constant(2, 3.0);
  x(1) = -7;
  for (int i = 0; i < 60; ++i) x = fixed_point.next(x, map(x));
  CHECK((map(x) - x).norm() < 1e-12);
}

TEST_CASE("No element of a step is larger than allowed, and nothing has no next") {
  FixedPoint fixed_point(2, 0.25);
  const VectorXd x = VectorXd::Zero(2), far = VectorXd::LinSpaced(2, -8, 0.1);
  CHECK(fixed_point.next(x, far) == VectorXd::LinSpaced(2, -0.25, 0.1));
  FixedPoint of_nothing(2, 1);
  CHECK(of_nothing.next(VectorXd(), VectorXd()).size() == 0);
}

TEST_CASE("A constant map's place is reached in one step, and kept") {
  FixedPoint fixed_point(3, 10);
  const VectorXd place = VectorXd::LinSpaced(2, 1, 2);
  VectorXd x = VectorXd::Zero(2);
  for (int i = 0; i < 4; ++i) {
    x = fixed_point.next(x, place);
    CHECK((x - place).norm() < 1e-14);
  }
}

}  // namespace

}  // namespace fixed_point_test
