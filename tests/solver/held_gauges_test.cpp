// solver/observability: what priors hold that the data do not determine.
//
// Proves, on linear problems whose gauges are exact: a gauge with a prior is determined however
// wide the prior is beside the data, with the covariance that elimination in exact coordinates
// gives; what no prior touches stays unobservable beside it, and moves nothing of the rest: its
// direction is exactly 0 there; a column of which the elimination of private unknowns leaves
// rounding has its prior's sigma; chi2, rows and the effective number of unknowns of the data
// alone. Does not prove: the same of a robot (models/calibration/priors_test.cpp).
#include <Eigen/Cholesky>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "../../solver/observability.h"
#include "../fixtures/dense.h"
#include "../fixtures/random.h"

namespace held_gauges_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// Groups of given rows [J_private J_shared r], of which each touches all shared columns; the last
/// one may be that of the priors.
class GivenRows final : public Problem {
 public:
  GivenRows(int shared, std::vector<MatrixXd> rows, const MatrixXd& priors)
      : shared_(shared), rows_(std::move(rows)), with_priors_(priors.rows() > 0) {
    if (with_priors_) rows_.push_back(priors);
    for (const MatrixXd& r : rows_) {
      GroupShape shape;
      shape.private_size = static_cast<int>(r.cols()) - shared - 1;
      for (int c = 0; c < shared; ++c) shape.columns.push_back(c);
      shape.rows = static_cast<int>(r.rows());
      shapes_.push_back(shape);
    }
  }
  int shared_size() const override { return shared_; }
  const std::vector<GroupShape>& groups() const override { return shapes_; }
  int prior_group() const override {
    return with_priors_ ? static_cast<int>(rows_.size()) - 1 : -1;
  }
  void set_workers(int) override {}
  void prepare(const VectorXd&) override {}
  bool evaluate(int, const VectorXd&, int, Cost&) const override { return true; }
  bool linearise(int, const VectorXd&, int, const GroupEquations&, Cost&) const override {
    return true;
  }
  bool square_root(int group, const VectorXd&, int, MatrixXd& rows) const override {
    rows = rows_[group];
    return true;
  }
  void retract(const VectorXd& state, const VectorXd&, const VectorXd&,
               VectorXd& moved) const override {
    moved = state;
  }
  bool renew(const VectorXd&) override { return false; }

 private:
  int shared_;
  std::vector<MatrixXd> rows_;
  std::vector<GroupShape> shapes_;
  bool with_priors_;
};

/// Rows of data and residuals, whole numbers times `precision`: six columns, of which column 3 =
/// column 0 + 2 column 1 and column 5 = column 4, to the last bit.
MatrixXd gauged_data(double precision) {
  Random random(5);
  MatrixXd rows(40, 7);
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    for (const int c : {0, 1, 2, 4, 6}) rows(i, c) = std::round(random.uniform(-50, 50));
    rows(i, 3) = rows(i, 0) + 2 * rows(i, 1);
    rows(i, 5) = rows(i, 4);
  }
  return rows * precision;
}

/// One prior a row: its column and sigma, and what it is off.
struct GivenPrior {
  int column;
  double sigma, off;
};
MatrixXd prior_rows(int columns, const std::vector<GivenPrior>& priors) {
  MatrixXd out = MatrixXd::Zero(static_cast<Eigen::Index>(priors.size()), columns + 1);
  for (size_t i = 0; i < priors.size(); ++i) {
    out(static_cast<Eigen::Index>(i), priors[i].column) = 1 / priors[i].sigma;
    out(static_cast<Eigen::Index>(i), columns) = priors[i].off / priors[i].sigma;
  }
  return out;
}

/// The covariance in coordinates of which the gauges are two: there the data say nothing of them to
/// the last bit, and the normal matrix, scaled, is far from singular. `held`: gauges that count.
MatrixXd exact_covariance(const MatrixXd& data, const MatrixXd& priors, int held) {
  MatrixXd back = MatrixXd::Identity(6, 6);  // columns: 0, 1, 2, 4, gauges
  back.col(3) = VectorXd::Unit(6, 4);
  back.col(4) << -1, -2, 0, 1, 0, 0;
  back.col(5) << 0, 0, 0, 0, -1, 1;
  const MatrixXd to = back.leftCols(4 + held);
  MatrixXd j(data.rows() + priors.rows(), 4 + held);
  j.topRows(data.rows()) = data.leftCols(6) * to;
  j.bottomRows(priors.rows()) = priors.leftCols(6) * to;
  MatrixXd normal = j.transpose() * j;
  const VectorXd scale = normal.diagonal().cwiseSqrt().cwiseInverse();
  normal = scale.asDiagonal() * normal * scale.asDiagonal();
  const MatrixXd inverse =
      fixture::dense::llt_solve(normal, MatrixXd::Identity(4 + held, 4 + held));
  return to * (scale.asDiagonal() * inverse * scale.asDiagonal()) * to.transpose();
}

/// To what rounding leaves: `ratio` is the size of the data's columns times the priors' sigma.
void check_covariance(const Observability& o, const MatrixXd& expected, double ratio) {
  for (int i = 0; i < expected.rows(); ++i)
    for (int k = 0; k < expected.cols(); ++k)
      CHECK(std::abs(o.covariance(i, k) - expected(i, k)) <=
            (1e-9 + 1e-14 * ratio) * std::sqrt(expected(i, i) * expected(k, k)));
  CHECK((o.root * o.root.transpose() - o.covariance).norm() < 1e-12 * o.covariance.norm());
}

Observability observe_rows(int shared, const std::vector<MatrixXd>& rows, const MatrixXd& priors) {
  GivenRows problem(shared, rows, priors);
  return observe(problem, VectorXd());
}

/// The columns that each unobservable direction touches, by all that is not 0; sorted.
std::vector<std::vector<int>> touched(const Observability& o) {
  std::vector<std::vector<int>> out(static_cast<size_t>(o.null_space.cols()));
  for (Eigen::Index d = 0; d < o.null_space.cols(); ++d)
    for (int c = 0; c < o.null_space.rows(); ++c)
      if (o.null_space(c, d) != 0) out[static_cast<size_t>(d)].push_back(c);
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace

TEST_CASE("held gauges: priors from narrow to wide beside precise data determine them") {
  for (const double precision : {1.0, 1e3, 1e6})
    for (const double sigma : {1e-9, 1e-6, 1e-4, 0.05, 1.0, 10.0}) {
      INFO("precision " << precision << ", prior " << sigma);
      const MatrixXd data = gauged_data(precision);
      // Two priors on the one gauge, of different sigmas, and one on the other.
      const MatrixXd priors = prior_rows(
          6, {{3, sigma, 0.3 * sigma}, {1, 3 * sigma, -sigma}, {5, 0.1 * sigma, 0.05 * sigma}});
      const Observability o = observe_rows(6, {data}, priors);
      CHECK(o.directions.empty());
      CHECK(std::count(o.unobservable.begin(), o.unobservable.end(), 0) == 6);
      CHECK(o.rank == 6);
      CHECK(o.rows == 43);
      CHECK(o.prior_rows == 3);
      CHECK(o.prior_chi2 == Approx(0.09 + 1.0 / 9 + 0.25));
      const MatrixXd expected = exact_covariance(data, priors, 2);
      check_covariance(o, expected, 200 * precision * sigma);
      // One prior a gauge decides it; the third tells what the data know better, or worse.
      const MatrixXd p = priors.leftCols(6);
      CHECK(o.decided_by_priors == Approx((p * expected * p.transpose()).trace()).epsilon(1e-6));
      CHECK(o.dof_data() == Approx(40 - 6 + o.decided_by_priors));
    }
}

TEST_CASE("held gauges: what no prior touches stays unobservable beside them") {
  for (const double sigma : {1e-6, 1e-3, 10.0}) {
    INFO("prior " << sigma);
    const MatrixXd data = gauged_data(1e6), priors = prior_rows(6, {{3, sigma, 0}});
    const Observability o = observe_rows(6, {data}, priors);
    REQUIRE(o.directions.size() == 1);
    REQUIRE(o.directions[0].size() == 2);
    CHECK(o.directions[0][0].first == 4);
    CHECK(o.directions[0][1].first == 5);
    CHECK(o.directions[0][0].second * o.directions[0][1].second == Approx(-1));
    CHECK(o.unobservable == std::vector<char>{0, 0, 0, 0, 1, 1});
    CHECK(o.rank == 5);
    const MatrixXd expected = exact_covariance(data, priors, 1);
    for (int i = 0; i < 4; ++i)
      for (int k = 0; k < 4; ++k)
        CHECK(std::abs(o.covariance(i, k) - expected(i, k)) <=
              1e-6 * std::sqrt(expected(i, i) * expected(k, k)));
    CHECK(std::sqrt(o.covariance(3, 3)) == Approx(sigma).epsilon(1e-6));
    CHECK(o.decided_by_priors == Approx(1));
    CHECK(touched(o) == std::vector<std::vector<int>>{{4, 5}});
    // Without any prior both gauges are.
    const Observability bare = observe_rows(6, {data}, MatrixXd(0, 7));
    CHECK(bare.directions.size() == 2);
    CHECK(touched(bare) == std::vector<std::vector<int>>{{0, 1, 3}, {4, 5}});
    CHECK(bare.dof_data() == 40 - 4);
  }
}

TEST_CASE("held gauges: a column that the private unknowns take up has its prior's sigma") {
  // In every group the second shared column is a combination of the two private ones.
  Random random(6);
  std::vector<MatrixXd> rows;
  for (int g = 0; g < 5; ++g) {
    MatrixXd r = 1e6 * random_matrix(random, 9, 5);
    r.col(3) = 0.3 * r.col(0) - 0.7 * r.col(1);
    rows.push_back(r);
  }
  for (const double sigma : {1e-6, 1e-3, 1.0, 10.0}) {
    INFO("prior " << sigma);
    const Observability o = observe_rows(2, rows, prior_rows(2, {{1, sigma, 0.5 * sigma}}));
    CHECK(o.directions.empty());
    CHECK(o.rank == 5 * 2 + 2);
    CHECK(std::sqrt(o.covariance(1, 1)) == Approx(sigma).epsilon(1e-9));
    CHECK(o.dof_data() == Approx(5 * 9 - 5 * 2 - 1));
  }
  const Observability o = observe_rows(2, rows, MatrixXd(0, 3));
  REQUIRE(o.directions.size() == 1);
  CHECK(o.directions[0] == std::vector<std::pair<int, double>>{{1, 1.0}});
  CHECK(o.unobservable == std::vector<char>{0, 1});
}

TEST_CASE("held gauges: many at once, with columns that nothing depends on") {
  // Of 60 columns 15 are copies of others and 15 are nothing.
  Random random(7);
  MatrixXd data = MatrixXd::Zero(100, 61);
  for (Eigen::Index i = 0; i < data.rows(); ++i) {
    for (int c = 0; c < 30; ++c) data(i, c) = random.normal();
    for (int c = 0; c < 15; ++c) data(i, 30 + c) = data(i, c);
    data(i, 60) = random.normal();
  }
  const Observability bare = observe_rows(60, {data}, MatrixXd(0, 61));
  REQUIRE(bare.directions.size() == 30);
  size_t entries = 0, parts = 0;
  for (const auto& columns : touched(bare)) entries += columns.size();
  for (const auto& direction : bare.directions) {
    parts += direction.size();
    CHECK((direction.size() == 1 || direction.size() == 2));
    for (const auto& [column, coefficient] : direction) CHECK(std::abs(coefficient) == Approx(1));
  }
  CHECK(entries == parts);  // rounding is no part of a direction
  CHECK(bare.covariance.allFinite());
  CHECK(bare.null_space.allFinite());
  CHECK(bare.rank == 30);
  std::vector<GivenPrior> all;
  for (int c = 15; c < 60; ++c) all.push_back({c, 1e3 * (c - 14), 0});
  const Observability held = observe_rows(60, {data}, prior_rows(60, all));
  CHECK(held.directions.empty());
  CHECK(held.rank == 60);
  for (int c = 30; c < 60; ++c)
    CHECK(std::sqrt(held.covariance(c, c)) == Approx(1e3 * (c - 14)).epsilon(1e-6));
  CHECK(held.decided_by_priors == Approx(30).epsilon(1e-4));
}

}  // namespace held_gauges_test
