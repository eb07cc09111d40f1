// models/fleet/drift: which numbers of one robot changed between its results.
//
// Proves, on made-up results: slope, step and their sigmas are those of the weighted fit of one
// number beside all others as unknown constants, solved here as one dense problem; without any
// change z is standard normal, and a robot is called drifting no more often than the level says; a
// planted line and a planted change are found, of the right kind, number and time, and nothing
// else is; one of two numbers that the data cannot tell apart still shows; numbers that are new in
// every result are no drift; a constant that is badly known does not matter. Does not prove:
// anything of results whose covariances are wrong.
#include "../../../models/fleet/drift.h"

#include <Eigen/Dense>
#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/rig/random_stream.h"
#include "../../fixtures/dense.h"

namespace drift_test {

using namespace kincal;

namespace {

constexpr int kNumbers = 6;
const double kSigma = 0.001;

MatrixXd draw(RandomStream& draws, Eigen::Index rows, Eigen::Index columns) {
  MatrixXd out(rows, columns);
  for (Eigen::Index i = 0; i < rows; ++i)
    for (Eigen::Index j = 0; j < columns; ++j) out(i, j) = draws.normal();
  return out;
}

/// Results of a robot whose numbers are `x` plus what moved(t) adds.
template <class Moved>
std::vector<Evidence> results(RandomStream& draws, int count, const Moved& moved) {
  const VectorXd x = 0.01 * draw(draws, kNumbers, 1);
  std::vector<Evidence> out;
  for (int t = 0; t < count; ++t) {
    Evidence s;
    s.rows = draw(draws, 12, kNumbers) / kSigma / std::sqrt(12);
    s.rows.col(2) = s.rows.col(1);  // only their sum is seen
    s.seen = s.rows * (x + moved(t)) + draw(draws, 12, 1);
    out.push_back(s);
  }
  return out;
}

std::vector<double> months(int count) {
  std::vector<double> out;
  for (int t = 0; t < count; ++t) out.push_back(50 + t / 12.0);
  return out;
}

const auto kNothing = [](int) { return VectorXd(VectorXd::Zero(kNumbers)); };
const VectorXd kScale = VectorXd::Constant(kNumbers, 0.05);

}  // namespace

TEST_CASE("drift: slopes, steps and sigmas are those of the whole fit") {
  RandomStream draws(1);
  const std::vector<Evidence> all = results(draws, 5, kNothing);
  const std::vector<double> times = {50, 50.1, 50.5, 50.6, 51};
  const Drift drift = find_drift(all, times, kScale, 0.01);
  REQUIRE(drift.numbers.size() == kNumbers);
  for (const NumberDrift& number : drift.numbers) {
    for (const bool line : {true, false}) {
      // Unknowns: all numbers (the third is the second one's other half), and b.
      MatrixXd a = MatrixXd::Zero(60, kNumbers);
      VectorXd z(60);
      for (int t = 0; t < 5; ++t) {
        const MatrixXd& r = all[t].rows;
        a.block(12 * t, 0, 12, 2) = r.leftCols(2);
        a.block(12 * t, 2, 12, 3) = r.rightCols(3);
        a.block(12 * t, 5, 12, 1) =
            (line ? times[t] - 50.4 : t >= number.from) * r.col(number.number);
        z.segment(12 * t, 12) = all[t].seen;
      }
      const MatrixXd covariance = fixture::dense::inverse(a.transpose() * a);
      const VectorXd fit = covariance * a.transpose() * z;
      const Slope& slope = line ? number.line : number.change;
      CHECK(slope.value == Approx(fit(5)).epsilon(1e-4));
      CHECK(slope.sigma == Approx(std::sqrt(covariance(5, 5))).epsilon(1e-4));
    }
  }
}

TEST_CASE("drift: without any, z is normal and alarms are as rare as the level says") {
  RandomStream draws(2);
  double square = 0;
  long count = 0, alarms = 0;
  const int robots = 600;
  for (int i = 0; i < robots; ++i) {
    const Drift drift = find_drift(results(draws, 8, kNothing), months(8), kScale, 0.05);
    alarms += !drift.causes.empty();
    square += std::pow(drift.numbers[0].line.in_sigmas(), 2);
    ++count;
  }
  CHECK(square / static_cast<double>(count) == Approx(1).margin(3.3 * std::sqrt(2.0 / robots)));
  CAPTURE(alarms);
  CHECK(alarms <= 0.05 * robots + 3.3 * std::sqrt(0.05 * robots));
  CHECK(alarms >= 5);  // and the correction for all that is tried is not much too careful
}

TEST_CASE("drift: what is planted is found, and nothing else") {
  RandomStream draws(4);
  long line = 0, change = 0;
  const int robots = 50;
  for (int i = 0; i < robots; ++i) {
    const auto by_line = [](int t) {
      return VectorXd(0.012 * t / 12.0 * VectorXd::Unit(kNumbers, 4));
    };
    Drift drift = find_drift(results(draws, 12, by_line), months(12), kScale, 0.01);
    line += drift.causes.size() == 1 && drift.causes[0].number == 4 && drift.causes[0].from == 0 &&
            std::abs(drift.causes[0].slope.value - 0.012) < 4 * drift.causes[0].slope.sigma;
    const auto at_once = [](int t) {
      return VectorXd((t >= 7 ? 0.01 : 0.0) * VectorXd::Unit(kNumbers, 0));
    };
    drift = find_drift(results(draws, 12, at_once), months(12), kScale, 0.01);
    change += drift.causes.size() == 1 && drift.causes[0].number == 0 && drift.causes[0].from == 7;
  }
  CAPTURE(line, change);
  CHECK(line >= 46);
  CHECK(change >= 46);
}

TEST_CASE("drift: two causes; numbers that cannot be told apart; numbers that are new every time") {
  RandomStream draws(6);
  const auto both = [](int t) {
    VectorXd x = 0.05 * t / 12.0 * VectorXd::Unit(kNumbers, 3);
    if (t >= 4) x(1) += 0.02;
    return x;
  };
  const std::vector<Evidence> all = results(draws, 10, both);
  const Drift drift = find_drift(all, months(10), kScale, 0.01);
  REQUIRE(drift.causes.size() == 2);
  for (const Cause& cause : drift.causes)
    if (cause.from)
      CHECK(((cause.number == 1 || cause.number == 2) && cause.from == 4));
    else
      CHECK(cause.number == 3);

  std::vector<Evidence> without;
  for (const Evidence& s : all) {
    without.push_back(without_numbers(s, {1, 2}));
    CHECK(without.back().rows.rows() == 11);  // one direction of these was seen
    CHECK(without.back().rows.middleCols(1, 2).norm() == 0);
  }
  const Drift rest = find_drift(without, months(10), kScale, 0.01);
  REQUIRE(rest.causes.size() == 1);
  CHECK(rest.causes[0].number == 3);
  CHECK(rest.numbers.size() == 4);
}

TEST_CASE("drift: two results have a difference, one has nothing, and equal times no line") {
  RandomStream draws(8);
  const auto moved = [](int t) { return VectorXd(0.05 * t * VectorXd::Unit(kNumbers, 5)); };
  const std::vector<Evidence> two = results(draws, 2, moved);
  const Drift drift = find_drift(two, {50, 50.5}, kScale, 0.01);
  REQUIRE(drift.causes.size() == 1);
  CHECK(drift.causes[0].number == 5);
  CHECK(drift.causes[0].slope.value == Approx(0.1).margin(0.02));  // a year
  CHECK(find_drift({two[0]}, {50}, kScale, 0.01).numbers.empty());
  CHECK(find_drift(two, {50, 50}, kScale, 0.01).causes.empty());
}

}  // namespace drift_test
