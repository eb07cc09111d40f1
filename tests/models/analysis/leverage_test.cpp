// models/analysis/leverage.h: what leaving one group of rows out would do.
//
// Proves: influences equal least squares without the group, also where groups have unknowns of
// their own that observe() eliminates first; a group that alone determines a number, or a
// combination of two, makes exactly these infinite; a group that its own unknowns use up moves
// nothing, and what nobody determines is never named; they come largest first, and those below
// `least` not at all. Does not prove: anything about problems that are not linear: a Newton step is
// all there is.
#include "../../../models/analysis/leverage.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <stdexcept>

#include "../../fixtures/dense.h"
#include "../../fixtures/random.h"

namespace leverage_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// Linear groups, rows [J_private J_touched y] each; residuals J x - y at the state [shared,
/// private group after group].
class Linear final : public Problem {
 public:
  Linear(int shared, std::vector<GroupShape> groups, std::vector<MatrixXd> rows)
      : shared_(shared), size_(shared), groups_(std::move(groups)), rows_(std::move(rows)) {
    for (size_t g = 0; g < groups_.size(); ++g) {
      groups_[g].rows = static_cast<int>(rows_[g].rows());
      start_.push_back(size_);
      size_ += groups_[g].private_size;
    }
  }
  int shared_size() const override { return shared_; }
  const std::vector<GroupShape>& groups() const override { return groups_; }
  void set_workers(int) override {}
  void prepare(const VectorXd&) override {}
  bool evaluate(int, const VectorXd&, int, Cost&) const override {
    throw std::logic_error("not needed");
  }
  bool linearise(int, const VectorXd&, int, const GroupEquations&, Cost&) const override {
    throw std::logic_error("not needed");
  }
  bool square_root(int group, const VectorXd& state, int, MatrixXd& rows) const override {
    rows = rows_[group];
    const std::vector<int> at = unknowns(group);
    for (size_t c = 0; c < at.size(); ++c)
      rows.rightCols(1) -= state(at[c]) * rows.col(static_cast<int>(c));
    rows.rightCols(1) *= -1;
    return true;
  }
  void retract(const VectorXd&, const VectorXd&, const VectorXd&, VectorXd&) const override {
    throw std::logic_error("not needed");
  }
  bool renew(const VectorXd&) override { return false; }

  /// The least-squares solution over all unknowns by one dense factorisation, `without` a group;
  /// the shortest one if it is not unique.
  VectorXd solution(int without = -1) const {
    MatrixXd all = MatrixXd::Zero(0, size_ + 1);  // [J y]
    for (int g = 0; g < static_cast<int>(groups_.size()); ++g) {
      if (g == without) continue;
      const Eigen::Index n = rows_[g].rows();
      all.conservativeResize(all.rows() + n, size_ + 1);
      all.bottomRows(n).setZero();
      const std::vector<int> at = unknowns(g);
      for (size_t c = 0; c < at.size(); ++c)
        all.col(at[c]).tail(n) = rows_[g].col(static_cast<int>(c));
      all.rightCols(1).bottomRows(n) = rows_[g].rightCols(1);
    }
    return all.leftCols(size_).completeOrthogonalDecomposition().solve(all.col(size_));
  }

 private:
  /// Where a group's unknowns stand in the state, in the order of its columns.
  std::vector<int> unknowns(int group) const {
    std::vector<int> out;
    for (int k = 0; k < groups_[group].private_size; ++k) out.push_back(start_[group] + k);
    out.insert(out.end(), groups_[group].columns.begin(), groups_[group].columns.end());
    return out;
  }
  int shared_, size_;
  std::vector<GroupShape> groups_;
  std::vector<MatrixXd> rows_;
  std::vector<int> start_;  // of each group's own unknowns in the state
};

GroupShape shape(int private_size, const std::vector<int>& columns) {
  GroupShape out;
  out.private_size = private_size;
  out.columns = columns;
  return out;
}

ReducedRows rows_of(const std::vector<MatrixXd>& left) {
  return [&left](size_t g) -> const MatrixXd& { return left[g]; };
}

/// Influences on a problem at its solution.
std::vector<Influence> influences_of(Linear& problem, Observability& observability,
                                     double least = 0) {
  std::vector<MatrixXd> left;
  observability = observe(problem, problem.solution(), &left);
  return influences(problem.groups(), rows_of(left), observability, least);
}

/// By how many of its sigmas leaving the group out really moves the column.
double really_moved(const Linear& problem, const Observability& observability, const Influence& f) {
  return (problem.solution(f.group)(f.column) - problem.solution()(f.column)) /
         std::sqrt(observability.covariance(f.column, f.column));
}

}  // namespace

TEST_CASE("outliers: influences equal least squares without the group") {
  Random random(2);
  const int n = 5;
  std::vector<GroupShape> groups;
  std::vector<MatrixXd> left;
  MatrixXd all(0, n + 1);
  for (int g = 0; g < 6; ++g) {
    GroupShape shape;
    for (int c = g % 2; c < n; ++c)
      if (c != 3 || g == 4) shape.columns.push_back(c);  // only group 4 knows column 3
    const int m = static_cast<int>(shape.columns.size());
    left.push_back(random_matrix(random, 4, m + 1));
    MatrixXd wide = MatrixXd::Zero(4, n + 1);
    for (int i = 0; i < m; ++i) wide.col(shape.columns[i]) = left[g].col(i);
    wide.col(n) = left[g].col(m);
    all.conservativeResize(all.rows() + 4, n + 1);
    all.bottomRows(4) = wide;
    groups.push_back(shape);
  }
  // At the solution: subtract it.
  const VectorXd x = fixture::dense::qr_solve(all.leftCols(n), all.col(n));
  all.col(n) -= all.leftCols(n) * x;
  for (size_t g = 0; g < groups.size(); ++g)
    left[g].col(left[g].cols() - 1) = all.col(n).segment(4 * static_cast<Eigen::Index>(g), 4);
  Observability observability;
  observability.covariance = fixture::dense::inverse(all.leftCols(n).transpose() * all.leftCols(n));
  observability.root = fixture::dense::lower(observability.covariance);
  const std::vector<Influence> found = influences(groups, rows_of(left), observability, 0);
  CHECK(std::is_sorted(found.begin(), found.end(), [](const Influence& a, const Influence& b) {
    return std::abs(a.sigmas) > std::abs(b.sigmas);
  }));
  int finite = 0;
  for (const Influence& f : found) {
    if (f.group == 4) {
      CHECK((f.column == 3) == std::isinf(f.sigmas));
      if (f.column == 3) continue;
    }
    MatrixXd others = all;
    others.middleRows(4 * f.group, 4).setZero();
    const VectorXd moved =
        -others.leftCols(n).completeOrthogonalDecomposition().solve(others.col(n));
    CHECK(f.sigmas ==
          Approx(moved(f.column) / std::sqrt(observability.covariance(f.column, f.column)))
              .margin(1e-9));
    ++finite;
  }
  CHECK(finite == 6 * n - 1);
  CHECK(influences(groups, rows_of(left), observability, 1e9).size() == 1);  // the infinite one
}

TEST_CASE("leverage: with unknowns of each group's own, as solving again without the group") {
  Random random(3);
  const int n = 4;
  std::vector<GroupShape> groups;
  std::vector<MatrixXd> rows;
  for (const std::vector<int>& columns : std::vector<std::vector<int>>{
           {0, 1, 2}, {1, 2, 3}, {0, 3}, {0, 1, 2, 3}, {0, 2, 3}, {1}, {0, 1, 2, 3}}) {
    groups.push_back(shape(2, columns));
    rows.push_back(random_matrix(random, 6, groups.back().size() + 1));
  }
  Linear problem(n, groups, rows);
  Observability observability;
  const std::vector<Influence> found = influences_of(problem, observability);
  REQUIRE(found.size() == groups.size() * n);
  for (const Influence& f : found) {
    INFO("group " << f.group << ", column " << f.column);
    CHECK(f.sigmas == Approx(really_moved(problem, observability, f)).epsilon(1e-7).margin(1e-9));
  }
  const size_t half = found.size() / 2;
  const std::vector<Influence> larger =
      influences_of(problem, observability, std::abs(found[half].sigmas));
  REQUIRE(larger.size() == half);
  for (size_t i = 0; i < half; ++i)
    CHECK((larger[i].group == found[i].group && larger[i].column == found[i].column));
}

TEST_CASE("reduced rows: kept up to 32 MB, and the same numbers when they are made again") {
  Random random(5);
  const int n = 200;  // 200 rows of 201 numbers a group, so 104 of 130 groups are kept
  std::vector<int> columns(n);
  for (int i = 0; i < n; ++i) columns[i] = i;
  const std::vector<GroupShape> groups(130, shape(2, columns));
  std::vector<MatrixXd> rows;
  for (size_t g = 0; g < groups.size(); ++g) rows.push_back(random_matrix(random, 202, n + 3));
  Linear problem(n, groups, rows);
  const VectorXd state = VectorXd::Zero(n + 2 * 130);
  std::vector<MatrixXd> kept;
  std::vector<double> told;
  observe(problem, state, &kept, Progress([&](const Progress::News& news) {
            told.push_back(news.share);
            return true;
          }));
  CHECK(kept.size() == 32 * 1024 * 1024 / 8 / (200 * 201));
  for (const size_t g : {size_t(0), size_t(7), kept.size() - 1})
    CHECK(reduced_rows(problem, state, g) == kept[g]);
  CHECK(reduced_rows(problem, state, groups.size() - 1).rows() == n);
  CHECK(std::is_sorted(told.begin(), told.end()));
  CHECK(told.back() == 1);
}

TEST_CASE(
    "leverage: a group that alone tells two numbers apart makes both infinite, and nothing else") {
  Random random(4);
  std::vector<GroupShape> groups(6, shape(1, {0, 1, 2, 3}));
  std::vector<MatrixXd> rows;
  for (size_t g = 0; g < groups.size(); ++g) {
    rows.push_back(random_matrix(random, 5, 6));
    if (g != 2)
      rows[g].col(3) = rows[g].col(2);  // the others see columns 1 and 2 as their sum only
  }
  Linear problem(4, groups, rows);
  Observability observability;
  const std::vector<Influence> found = influences_of(problem, observability);
  CHECK(found.size() == groups.size() * 4);
  for (const Influence& f : found) {
    INFO("group " << f.group << ", column " << f.column);
    const bool alone = f.group == 2 && (f.column == 1 || f.column == 2);
    CHECK(std::isinf(f.sigmas) == alone);
    if (!alone)
      CHECK(f.sigmas == Approx(really_moved(problem, observability, f)).epsilon(1e-6).margin(1e-8));
  }
}

TEST_CASE(
    "leverage: what its own unknowns use up moves nothing, and what nobody sees is not named") {
  Random random(5);
  std::vector<GroupShape> groups(5, shape(3, {0, 1, 3}));  // column 2 is nobody's
  std::vector<MatrixXd> rows;
  for (size_t g = 0; g < groups.size(); ++g)
    rows.push_back(random_matrix(random, g == 1 ? 3 : 7, 7));
  Linear problem(4, groups, rows);
  Observability observability;
  const std::vector<Influence> found = influences_of(problem, observability);
  CHECK(found.size() == 4 * 3);
  for (const Influence& f : found) {
    CHECK(f.group != 1);
    CHECK(f.column != 2);
    CHECK(std::isfinite(f.sigmas));
  }
}

}  // namespace leverage_test
