// models/monitor/drift_watch: has something moved since the calibration?
//
// Proves: innovations are those of a dense covariance; the estimate is the dense least-squares one;
// R is the sum of its definition; while nothing moves alarms come as rarely as stated (at least two
// fifths and at most three standard deviations more than that, 500 runs); a group that no sample
// sees does not raise them; what moved is named, its size is right within its sigma, and accepting
// it ends the alarm with an estimate that is the dense one of the model with the change; wrong
// sizes are refused. Does not prove: that the equations of a robot's samples are such
// (monitor_test.cpp).
#include "../../../models/monitor/drift_watch.h"
#include "../../fixtures/dense.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

namespace drift_watch_test {

using namespace kincal;
using Catch::Matchers::Contains;

namespace {

constexpr int kColumns = 12, kRows = 4;
constexpr double kWidth = 50;

/// A robot of equations only: what its samples say, and how it differs from its calibration.
class Equations {
 public:
  explicit Equations(unsigned seed) : random_(seed) {
    MatrixXd information = 1e-2 * MatrixXd::Identity(kColumns, kColumns);
    for (int i = 0; i < 40; ++i) {
      next();
      information += j.transpose() * j;
    }
    covariance = fixture::dense::inverse(information);
    const MatrixXd root = fixture::dense::lower(covariance);
    difference = root * normal(kColumns);
  }

  VectorXd normal(int n) {
    VectorXd out(n);
    for (double& x : out) x = normal_(random_);
    return out;
  }
  /// The next sample's j and y. Column 11 is not seen.
  void next() {
    j.resize(kRows, kColumns);
    for (int c = 0; c < kColumns; ++c) j.col(c) = 0.3 * normal(kRows);
    j.col(11).setZero();
    if (difference.size() > 0) y = j * difference + normal(kRows);
  }

  MatrixXd covariance, j;
  VectorXd difference, y;

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

std::vector<DriftGroup> groups() {
  std::vector<DriftGroup> out = {{"mount", {0, 1, 2, 3, 4, 5}, VectorXd::Constant(6, kWidth)}};
  for (int c = 6; c < kColumns; ++c)
    out.push_back({"offset " + std::to_string(c), {c}, VectorXd::Constant(1, kWidth)});
  return out;
}

void add(DriftWatch& test, const Equations& e, long sample, bool learn = true) {
  test.look(e.j, e.y);
  test.take(learn, sample);
}

}  // namespace

TEST_CASE("drift watch: innovations and the estimate against dense ones") {
  Equations e(3);
  DriftWatch test(e.covariance, groups(), 1e9, kRows);
  MatrixXd information = fixture::dense::inverse(e.covariance);
  VectorXd pull = VectorXd::Zero(kColumns);
  for (long i = 0; i < 30; ++i) {
    e.next();
    const MatrixXd known = fixture::dense::inverse(information);
    const MatrixXd s = MatrixXd::Identity(kRows, kRows) + e.j * known * e.j.transpose();
    const VectorXd v = e.y - e.j * known * pull;
    CHECK(test.look(e.j, e.y) == Approx(v.dot(fixture::dense::inverse(s) * v)));
    test.take(true, i);
    information += e.j.transpose() * e.j;
    pull += e.j.transpose() * e.y;
  }
  const MatrixXd known = fixture::dense::inverse(information);
  CHECK((test.covariance() - known).norm() < 1e-9 * known.norm());
  CHECK((test.mean() - known * pull).norm() < 1e-9);
  // What is not learnt from changes neither.
  const VectorXd before = test.mean();
  e.next();
  add(test, e, 30, false);
  CHECK(test.mean() == before);
}

TEST_CASE("drift watch: R is the sum of its definition") {
  for (const double size : {0.1, 0.5, 2.0, 8.0}) {
    INFO("a change of " << size);
    Equations e(11);
    const std::vector<DriftGroup> all = groups();
    DriftWatch test(e.covariance, all, 1e9, kRows);
    MatrixXd known = e.covariance;
    VectorXd mean = VectorXd::Zero(kColumns);
    MatrixXd a[2];  // of all columns, by start
    VectorXd b[2];
    for (long i = 0; i < 2; ++i) {
      a[i].setZero(kColumns, kColumns);
      b[i].setZero(kColumns);
      e.difference(2) += size;
      e.difference(8) -= size;
      e.next();
      const MatrixXd inverse =
          fixture::dense::inverse(MatrixXd::Identity(kRows, kRows) + e.j * known * e.j.transpose());
      const VectorXd v = e.y - e.j * mean;
      for (long start = 0; start <= i; ++start) {
        a[start] += e.j.transpose() * inverse * e.j;
        b[start] += e.j.transpose() * inverse * v;
      }
      mean += known * e.j.transpose() * inverse * v;
      known -= MatrixXd(known * e.j.transpose() * inverse * e.j * known);
      add(test, e, i);
      double r = 0;
      for (long start = 0; start <= i; ++start)
        for (const DriftGroup& group : all)
          for (const double scale : {1.0, 0.1, 0.01}) {
            const VectorXd width = scale * group.width;
            MatrixXd weighed = width.asDiagonal() * a[start](group.columns, group.columns) *
                               MatrixXd(width.asDiagonal());
            weighed.diagonal().array() += 1;
            const VectorXd right = width.cwiseProduct(b[start](group.columns));
            const double log = 0.5 * fixture::dense::weighted_square(right, weighed) -
                               0.5 * fixture::dense::log_determinant(weighed);
            if (log > std::log(99)) r += std::exp(log) / (3.0 * static_cast<double>(all.size()));
          }
      if (r > 0)
        CHECK(test.log_statistic() == Approx(std::log(r)).epsilon(1e-8));
      else
        CHECK(test.log_statistic() == -INFINITY);
    }
  }
}

TEST_CASE("drift watch: false alarms are as rare as stated") {
  constexpr int kRuns = 500, kSamples = 300;
  int alarms = 0;
  for (unsigned run = 0; run < kRuns; ++run) {
    Equations e(100 + run);
    DriftWatch test(e.covariance, groups(), kSamples, kRows);
    for (long i = 0; i < kSamples && !test.alarm(); ++i) {
      e.next();
      add(test, e, i);
    }
    alarms += test.alarm();
  }
  const double share = 1 - std::exp(-1.0), expected = kRuns * share;
  CHECK(alarms > 0.4 * expected);
  CHECK(alarms < expected + 3 * std::sqrt(expected * (1 - share)));
}

TEST_CASE("drift watch: what moved, by how much, and since when") {
  constexpr int kRuns = 60;
  constexpr long kFrom = 40;
  int right = 0, found = 0, within = 0;
  for (unsigned run = 0; run < kRuns; ++run) {
    Equations e(1000 + run);
    DriftWatch test(e.covariance, groups(), 10000, kRows);
    const int group = static_cast<int>(run % 6), column = groups()[group].columns[0];
    for (long i = 0; i < kFrom; ++i) {
      e.next();
      add(test, e, i);
    }
    if (test.alarm()) continue;  // a false one
    e.difference(column) += 3;
    for (long i = kFrom; i < kFrom + 40; ++i) {
      e.next();
      add(test, e, i);
    }
    if (!test.alarm()) continue;
    ++found;
    const std::vector<Moved> moved = test.moved();
    double sum = 0;
    for (const Moved& m : moved) sum += m.probability;
    CHECK(sum == Approx(1));
    right += moved[0].group == group;
    for (const Moved& m : moved)
      if (m.group == group) {
        within += std::abs(m.change(0) - 3) < 3 * m.sigma(0);
        CHECK(m.since >= kFrom - 10);
        CHECK(m.since <= kFrom + 20);
      }
  }
  CHECK(found >= kRuns - 2);
  CHECK(right >= 0.95 * found);
  CHECK(within >= 0.9 * found);
}

TEST_CASE("drift watch: an accepted change is part of the estimate") {
  Equations e(7);
  DriftWatch test(e.covariance, groups(), 100, kRows);
  for (long i = 0; i < 20; ++i) {
    e.next();
    add(test, e, i);
  }
  REQUIRE_FALSE(test.alarm());
  const VectorXd mean = test.mean();
  const MatrixXd before = test.covariance();
  e.difference(7) += 40;  // from here on nothing is learnt: outliers
  MatrixXd information = MatrixXd::Zero(kColumns, kColumns);
  VectorXd pull = VectorXd::Zero(kColumns);
  for (long i = 20; i < 23; ++i) {
    e.next();
    add(test, e, i, false);
    information += e.j.transpose() * e.j;
    pull += e.j.transpose() * (e.y - e.j * mean);
  }
  REQUIRE(test.alarm());
  const std::vector<Moved> moved = test.moved();
  REQUIRE(groups()[moved[0].group].columns[0] == 7);
  CHECK(moved[0].since == 20);
  CHECK(moved[0].residuals == 3 * kRows);
  CHECK(moved[0].chi2 < 40);  // of 12
  test.restart(moved);
  CHECK_FALSE(test.alarm());
  MatrixXd prior = before;
  prior(7, 7) += kWidth * kWidth;
  const MatrixXd known = fixture::dense::inverse(fixture::dense::inverse(prior) + information);
  CHECK((test.covariance() - known).norm() < 1e-8 * known.norm());
  CHECK((test.mean() - mean - known * pull).norm() < 1e-8);
  CHECK(std::abs(test.mean()(7) - e.difference(7)) < 4 * std::sqrt(known(7, 7)));
}

TEST_CASE("drift watch: sizes that do not fit") {
  const MatrixXd known = MatrixXd::Identity(3, 3);
  const auto make = [&](std::vector<DriftGroup> g, double every) {
    return DriftWatch(known, std::move(g), every, 2);
  };
  CHECK_THROWS_WITH(make({{"a", {3}, VectorXd::Ones(1)}}, 100),
                    Contains("'a'") && Contains("no such column"));
  CHECK_THROWS_WITH(make({{"a", {0, 1}, VectorXd::Ones(1)}}, 100), Contains("with a width each"));
  CHECK_THROWS_WITH(make({{"a", {0}, VectorXd::Zero(1)}}, 100), Contains("a width is positive"));
  CHECK_THROWS_WITH(make({{"a", {0}, VectorXd::Ones(1)}}, 0.5), Contains("samples_between_alarms"));
  CHECK_THROWS_WITH(DriftWatch(MatrixXd::Ones(3, 2), {}, 100, 2), Contains("not square"));
  CHECK_THROWS_WITH(DriftWatch(MatrixXd::Constant(3, 3, NAN), {}, 100, 2), Contains("not finite"));
}

}  // namespace drift_watch_test
