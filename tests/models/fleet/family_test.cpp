// models/fleet/family: which robots of a fleet are unlike the others.
//
// Proves, on made-up fleets whose numbers are drawn as the header's model says (independent and
// correlated tolerances; noise beside them; two numbers that the data cannot tell apart): of
// healthy robots as many are called out of family as the level says, within the binomial interval,
// from eight robots on, also with fewer robots than numbers; robots far out are found, named by the
// right number, and do not hide each other; directions that the data leave open count nothing, and
// neither do other units or another origin. The distance is Mahalanobis' where there is a
// covariance. Does not prove: anything of real tolerances, which need not be normal, nor of results
// whose covariances are wrong (benchmarks/fleet.py goes through the program).
#include "../../../models/fleet/family.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/rig/random_stream.h"

namespace family_test {

using namespace kincal;

namespace {

struct Kind {
  int numbers = 6;
  bool correlated = false;
  double noise = 0.5;  // of the estimates, in tolerances
};

/// A fleet of robots; the tolerance of each number.
struct MadeFleet {
  std::vector<Evidence> robots;
  VectorXd tolerance, scale;
};

MadeFleet make_fleet(RandomStream& draws, int robots, const Kind& kind, int bad = 0,
                     double off = 0) {
  const int n = kind.numbers;
  MadeFleet out;
  out.scale = VectorXd::Constant(n, 0.05);
  out.tolerance.resize(n);
  for (int c = 0; c < n; ++c) out.tolerance(c) = 0.005 * std::exp(0.5 * draws.normal());
  MatrixXd mix = MatrixXd::Identity(n, n);
  for (int a = 0; kind.correlated && a < n; ++a)
    for (int b = 0; b < n; ++b) mix(a, b) += 0.5 * draws.normal() / std::sqrt(n);
  for (int i = 0; i < robots; ++i) {
    VectorXd unit(n), noise(2 * n);
    for (int c = 0; c < n; ++c) unit(c) = draws.normal();
    for (int r = 0; r < 2 * n; ++r) noise(r) = draws.normal();
    VectorXd x = out.tolerance.cwiseProduct(mix * unit);
    if (i < bad) x(i % n) += off * out.tolerance(i % n);
    MatrixXd j(2 * n, n);
    for (int r = 0; r < 2 * n; ++r)
      for (int c = 0; c < n; ++c)
        j(r, c) = draws.normal() / std::sqrt(2.0 * n) / (kind.noise * out.tolerance(c));
    j.col(1) = j.col(2);  // only their sum is seen
    const MatrixXd normal = j.transpose() * j;
    out.robots.push_back(
        evidence(normal, normal * x + j.transpose() * noise, VectorXd::Zero(n), out.scale));
  }
  return out;
}

/// Whether so many of all are no surprise at a level: within 3.3 standard deviations.
bool plausible(long found, long all, double level) {
  const auto count = static_cast<double>(all);
  return std::abs(static_cast<double>(found) - level * count) <
         3.3 * std::sqrt(count * level * (1 - level)) + 1;
}

}  // namespace

TEST_CASE("fleet: of healthy robots as many are out of family as the level says") {
  // Robots of one fleet share its mean and covariance: so many fleets that chance evens out.
  struct Size {
    int numbers, robots, fleets;
  };
  for (const Size& size :
       {Size{6, 8, 250}, Size{6, 20, 100}, Size{6, 100, 20}, Size{24, 12, 50}, Size{24, 60, 10}})
    for (const bool correlated : {false, true}) {
      RandomStream draws(3, static_cast<std::uint64_t>(100 * size.numbers + size.robots));
      long at_5 = 0, at_1 = 0, all = 0;
      for (int f = 0; f < size.fleets; ++f) {
        const MadeFleet fleet = make_fleet(draws, size.robots, {size.numbers, correlated});
        const Family family = judge_family(fleet.robots, fleet.scale);
        REQUIRE(family.judged);
        for (const FamilyMember& m : family.members) {
          at_5 += m.p < 0.05;
          at_1 += m.p < 0.01;
          ++all;
        }
      }
      CAPTURE(size.numbers, size.robots, correlated, at_5, at_1, all);
      CHECK(at_1 <= 0.02 * static_cast<double>(all));
      CHECK(at_5 <= 0.08 * static_cast<double>(all));
      CHECK(at_5 >= 0.02 * static_cast<double>(all));
    }
}

TEST_CASE("fleet: a thousand healthy robots, within the binomial interval") {
  RandomStream draws(5);
  for (const bool correlated : {false, true}) {
    const MadeFleet fleet = make_fleet(draws, 1000, {12, correlated});
    const Family family = judge_family(fleet.robots, fleet.scale);
    long at_5 = 0, at_1 = 0;
    for (const FamilyMember& m : family.members) {
      at_5 += m.p < 0.05;
      at_1 += m.p < 0.01;
      CHECK(m.equations == 11);
    }
    CAPTURE(correlated, at_5, at_1);
    CHECK(plausible(at_1, 1000, 0.01));
    CHECK(plausible(at_5, 1000, 0.05));
  }
}

TEST_CASE("fleet: robots far out are found and named, also where they are many") {
  RandomStream draws(7);
  long found = 0, named = 0, all = 0;
  for (int f = 0; f < 20; ++f) {
    const int bad = 6;  // of 40
    const MadeFleet fleet = make_fleet(draws, 40, {6, false, 0.3}, bad, 12);
    const Family family = judge_family(fleet.robots, fleet.scale);
    for (int i = 0; i < bad; ++i) {
      const FamilyMember& m = family.members[i];
      found += m.p < 0.01;
      const int first = m.numbers[0].number, is = i % 6;
      named += first == is || ((first == 1 || first == 2) && (is == 1 || is == 2));
      ++all;
    }
  }
  CAPTURE(found, named, all);
  // Some 95 % are found. No model says how many must be; the limit is 2.5 standard deviations of
  // that many below.
  CHECK(static_cast<double>(found) > 0.9 * static_cast<double>(all));
  CHECK(static_cast<double>(named) > 0.85 * static_cast<double>(all));
}

TEST_CASE("fleet: units and origin of the numbers do not matter, nor does what is left open") {
  RandomStream draws(11);
  const MadeFleet fleet = make_fleet(draws, 15, {6, true});
  const Family before = judge_family(fleet.robots, fleet.scale);
  std::vector<Evidence> moved = fleet.robots;
  VectorXd factor(6), shift(6);
  for (int c = 0; c < 6; ++c) factor(c) = std::pow(10, c - 3), shift(c) = 0.02 * draws.normal();
  for (Evidence& s : moved) {  // x = (y - shift) / factor
    s.rows = s.rows * factor.cwiseInverse().asDiagonal();
    s.seen += s.rows * shift;
  }
  const Family after = judge_family(moved, factor.cwiseProduct(fleet.scale));
  for (size_t i = 0; i < moved.size(); ++i) {
    CHECK(after.members[i].p == Approx(before.members[i].p).epsilon(0.02).margin(1e-3));
    // A number that nobody sees, more.
    Evidence& s = moved[i];
    s = fleet.robots[i];
    s.rows.conservativeResize(Eigen::NoChange, 7);
    s.rows.col(6).setZero();
  }
  VectorXd scale(7);
  scale << fleet.scale, 0.05;
  const Family with_open = judge_family(moved, scale);
  for (size_t i = 0; i < moved.size(); ++i) {
    CHECK(with_open.members[i].equations == before.members[i].equations);
    CHECK(std::abs(std::log(with_open.members[i].p / before.members[i].p)) < 1);
  }
}

TEST_CASE("fleet: equations of what the data say") {
  MatrixXd normal(3, 3);
  normal << 4e6, 1e6, 0, 1e6, 9e6, 0, 0, 0, 1;  // of the third: sigma 1, beyond its scale
  const VectorXd at = (VectorXd(3) << 0.1, -0.2, 0.3).finished(),
                 pull = (VectorXd(3) << 3, -4, 5).finished(), scale = VectorXd::Constant(3, 0.05);
  const Evidence s = evidence(normal, pull, at, scale);
  REQUIRE(s.rows.rows() == 2);
  CHECK((s.rows.transpose() * s.rows - normal).topLeftCorner(2, 2).norm() < 1e-6);
  CHECK(s.rows.col(2).norm() < 1e-9);
  // N (x - at) = pull, so R'z = pull + N at.
  CHECK((s.rows.transpose() * s.seen - pull - normal * at).head(2).norm() < 1e-6);
}

TEST_CASE("fleet: few robots are not judged") {
  RandomStream draws(13);
  const MadeFleet fleet = make_fleet(draws, kFewestRobots - 1, {});
  CHECK_FALSE(judge_family(fleet.robots, fleet.scale).judged);
}

}  // namespace family_test
