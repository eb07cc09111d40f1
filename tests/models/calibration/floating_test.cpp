// Robots known by the poses of their flange: files to estimate, against an independent truth.
//
// Proves by Monte Carlo, with poses made here with Eigen alone: the camera's and the board's pose
// are found, in the hand and in the room, and are as far off as the covariance says, with exact and
// with noisy poses; noise of the poses that nobody states is found. Not proved: images (tests of
// the program), and robots whose poses are wrong in a systematic way.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "../../../kinematics/floating.h"
#include "../../fixtures/flange.h"

namespace floating_test {

using namespace kincal;
using Cell = fixture::FlangeCell;
using Truth = fixture::FlangeTruth;

TEST_CASE("flange poses: mounts are found, as far off as the covariance says") {
  constexpr int kSeeds = 60;
  for (const Cell& cell : {Cell{true, 0, 0}, Cell{true, 2e-4, 4e-4}, Cell{false, 1e-3, 1e-3}}) {
    double nees = 0, chi2 = 0;
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
      Truth truth(cell, seed);
      const fixture::FlangeInput input = read(truth, 12);
      const Solution solution = fixture::solution_of(input.rig, input.samples);
      REQUIRE(solution.status == Status::converged);
      nees += truth.nees(solution) / 12 / kSeeds;
      chi2 += solution.chi2_per_dof() / kSeeds;
    }
    INFO("NEES/dof " << nees << ", chi2/dof " << chi2);
    // 12 x 60 and 700 x 60 numbers: 99 % intervals
    CHECK(nees > 1 - 2.6 * std::sqrt(2.0 / (12 * kSeeds)));
    CHECK(nees < 1 + 2.6 * std::sqrt(2.0 / (12 * kSeeds)));
    CHECK(chi2 == Approx(1).margin(2.6 * std::sqrt(2.0 / (700 * kSeeds))));
  }
}

TEST_CASE("flange poses: noise that nobody states is found, and zero where it says exact") {
  const Cell noisy{true, 6e-4, 1.2e-3, false}, exact{false, 0, 0, false};
  for (const Cell& cell : {noisy, exact}) {
    Truth truth(cell, 5);
    const fixture::FlangeInput input = read(truth, 25);
    const Report report = fixture::study_of(input.rig, input.samples);
    REQUIRE(report.solution.status == Status::converged);
    const std::vector<JointSettings>& joints = report.solution.rig().joints;
    const int first = input.rig.tree.joints[0].first_axis + kPoseAxes;
    if (cell.translation > 0) {
      CHECK(joints[first].sigma == Approx(cell.translation).epsilon(0.4));
      CHECK(joints[first + 3].sigma == Approx(cell.rotation).epsilon(0.4));
    } else {
      CHECK(joints[first].sigma < 1e-4);  // (what the sensor's noise hides is near the guess, 3e-4)
      CHECK(joints[first + 3].sigma < 1e-4);
    }
    CHECK(joints[first + 2].sigma == joints[first].sigma);
    CHECK(report.solution.chi2_per_dof() == Approx(1).margin(0.15));
  }
}

TEST_CASE(
    "flange poses: the noise of a few is known less well, and pictures at one posture are no "
    "postures") {
  const auto has = [](const Report& report, const std::string& id) {
    return std::any_of(report.warnings.begin(), report.warnings.end(),
                       [&](const Notice& w) { return kincal::id(w.kind) == id; });
  };
  for (const int count : {4, 12}) {
    Truth truth(Cell{true, 1e-3, 1e-3, false}, 7);
    const fixture::FlangeInput input = fixture::read(truth, count);
    const Report report = fixture::study_of(input.rig, input.samples);
    CHECK(has(report, "noise"));
    CHECK_FALSE(has(report, "repeated"));
    for (const NoiseLevel& level : report.noise_levels) {
      if (level.guess == 0) continue;
      const auto [low, high] = level.interval();
      CHECK(low < 1e-3);
      CHECK(high > 1e-3);
      CHECK((level.uncertainty > 0.3) == (count < 8));
    }
  }
  Truth truth(Cell{true, 1e-3, 1e-3}, 8);
  fixture::FlangeInput input = fixture::read(truth, 12);
  for (size_t i = 0; i < input.samples.size(); ++i)
    input.samples[i].readings = input.samples[i / 2 * 2].readings;
  CHECK(has(fixture::study_of(input.rig, input.samples), "repeated"));
}

}  // namespace floating_test
