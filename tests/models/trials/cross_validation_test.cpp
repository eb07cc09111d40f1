// models/trials/cross_validation.h with outliers: what is held out decides nothing.
//
// Proves: with `reject` every fold's calibration is that of its own training samples without their
// gross outliers, and is judged on all that it holds out, outliers included; a fold's own samples,
// however wrong, change neither what is taken out of its training nor its estimates; the median
// leaves outliers alone where the root mean square does not; a study folds the samples as they
// were given, whatever its result took out. A warning names residuals that are not final. Does not
// prove: which samples are outliers (outliers_test.cpp), nor folds (folds_test.cpp,
// validation_test.cpp).
#include "../../../models/trials/cross_validation.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <set>

#include "../../../models/report/study.h"
#include "../../../models/report/warnings.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/study.h"

namespace cross_validation_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

constexpr int kFolds = 4;
constexpr double kNoise = 5e-4;  // m

/// An arm of two joints with three reflectors, seen by a tracker whose pose is to be found.
Rig followed_arm() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "turn", "base", "upper", {0, 0, 1}, at({0, 0, 0.4}), 2e-4);
  add_joint(rig, JointType::revolute, "bend", "upper", "fore", {0, 1, 0}, at({0.5, 0, 0}), 2e-4);
  finish_tree(rig.tree);
  for (Joint& j : rig.tree.joints) j.lower = -1.2, j.upper = 1.2;
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.1, 0, 0, 0, 0.1, 0, 0.02, 0;
  add_points(rig, "reflectors", points, "fore", at({0.4, 0, 0.02}));
  add_tracker(rig, "tracker", "base", at({2, 0.3, 0.5}, {0, 0, 2}), Vector3d::Constant(kNoise));
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = {"sensor/tracker/pose", "joint/bend/offset"};
  rig.steps = {step};
  return rig;
}

/// 40 samples; readings of the named ones are wrong by 0.1 rad.
std::vector<Sample> some_wrong(const Rig& rig, const std::set<int>& wrong) {
  SimulationOptions options;
  options.seed = 3;
  options.samples = 40;
  const ParameterTable table(rig);
  std::vector<Sample> out = simulate(rig, table, table.initial, options).samples;
  for (int i : wrong) out[static_cast<size_t>(i)].readings[1] += 0.1;
  return out;
}

const std::set<int> kWrong = {1, 8, 15, 22, 29, 36};

std::set<std::string> ids(const std::vector<Rejected>& rejected) {
  std::set<std::string> out;
  for (const Rejected& r : rejected) out.insert(r.sample);
  return out;
}

}  // namespace

TEST_CASE("cross-validation: outliers are taken out of the training of each fold, and judged") {
  const Rig rig = followed_arm();
  const std::vector<Sample> samples = some_wrong(rig, kWrong);
  const Folds folds = deal_folds(rig, samples, kFolds);
  const auto recording = make_recording(rig, samples);
  const CrossValidation cross = *cross_validate(recording, {}, kFolds, fit_without_outliers);
  REQUIRE(cross.folds.size() == kFolds);
  REQUIRE(cross.sensors.size() == 1);
  CHECK(cross.sensors[0].points == 3 * 40);
  CHECK(cross.sensors[0].missing == 0);
  double squares = 0;
  for (int f = 0; f < kFolds; ++f) {
    std::set<std::string> in_training;
    std::vector<Sample> split = samples, without;
    for (size_t i = 0; i < samples.size(); ++i) {
      split[i].train = folds.of[i] != f;
      const bool wrong = kWrong.count(static_cast<int>(i)) > 0;
      if (wrong && split[i].train) in_training.insert(samples[i].id);
      if (!wrong || !split[i].train) without.push_back(split[i]);
    }
    CHECK(ids(cross.folds[static_cast<size_t>(f)].rejected) == in_training);
    CHECK(cross.folds[static_cast<size_t>(f)].judged);
    const Solution by_hand = solution_of(rig, without);
    const SplitStatistics test = residuals_of(by_hand).sensors[0].test;
    squares += test.rms * test.rms * static_cast<double>(test.points);
  }
  CHECK(cross.sensors[0].rms == Approx(std::sqrt(squares / 120)).epsilon(1e-9));
  CHECK(cross.sensors[0].rms_as_read > 10e-3);  // six of forty are off by 40 mm and more
  CHECK(cross.sensors[0].median_as_read < 2e-3);
  CHECK(cross.sensors[0].median_as_read > kNoise);
  // Without `reject` they ruin the calibrations too.
  const CrossValidation plain = *cross_validate(recording, {}, kFolds);
  CHECK(plain.folds[0].rejected.empty());
  CHECK(plain.sensors[0].median_as_read > 2 * cross.sensors[0].median_as_read);
}

TEST_CASE(
    "cross-validation: a fold's own samples do not decide what is taken out of its training") {
  const Rig rig = followed_arm();
  const std::vector<Sample> samples = some_wrong(rig, kWrong);
  const Folds folds = deal_folds(rig, samples, kFolds);
  std::vector<Sample> worse = samples;
  for (size_t i = 0; i < worse.size(); ++i)
    if (folds.of[i] == 0) worse[i].readings[1] += 0.3;
  const CrossValidation one = *cross_validate(make_recording(rig, samples), {}, kFolds,
                                              fit_without_outliers),
                        other = *cross_validate(make_recording(rig, worse), {}, kFolds,
                                                fit_without_outliers);
  CHECK(ids(one.folds[0].rejected) == ids(other.folds[0].rejected));
  CHECK(ids(one.folds[1].rejected) != ids(other.folds[1].rejected));
}

TEST_CASE("cross-validation: a study folds the samples as given") {
  const Rig rig = followed_arm();
  for (bool estimate : {false, true}) {
    StudyOptions options;
    options.reject = true;
    options.estimate_noise = estimate;
    options.cross_validate = kFolds;
    options.loops = false;
    const Report report = *study(make_recording(rig, some_wrong(rig, kWrong)), options);
    CHECK(report.rejected.size() == kWrong.size());
    CHECK(report.residuals.sensors[0].train.points == 3 * 34);
    REQUIRE(report.validation.cross_validation);
    CHECK(report.validation.cross_validation->sensors[0].points == 3 * 40);
  }
}

TEST_CASE("validation: what is not final is named") {
  const Rig rig = followed_arm();
  Report report = study_of(rig, some_wrong(rig, {}));
  const auto named = [&] {
    std::string out;
    for (const Notice& w : warnings(report))
      if (w.kind == NoticeKind::unfinished) out += sentences(w) + "\n";
    return out;
  };
  CHECK(report.residuals.unfinished.empty());
  CHECK(named().empty());
  report.residuals.unfinished = {{true, "rms_as_read", {"s1"}}, {false, "rms", {"s2", "s3"}}};
  CHECK_THAT(named(), Catch::Contains("rms_as_read of the training samples") &&
                          Catch::Contains("rms of the held-out samples is not final") &&
                          Catch::Contains("2 samples, first 's2'"));
}

}  // namespace cross_validation_test
