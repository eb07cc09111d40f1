// models/calibration: plans, solutions, and a calibration that is solved again.
//
// Proves: errors of a selection begin with their place in it; what changes nothing is said, and
// nothing else; plans count what the step minimises; after replace() a repeated solve() ends where
// a calibration of the new samples does, estimates and covariance with it, in every noise mode and
// with sigmas of single readings, and copies of earlier solutions stay as they were; replace()
// takes samples of the same shape only; a solution's parameters, poses and tree; a start that
// cannot be evaluated and a cancellation are statuses, from which a calibration recovers. Does not
// prove: that nothing is allocated (solver/allocation_test.cpp), nor that estimates are right
// (example_test.cpp).
#include "../../../models/calibration/calibration.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"
#include "../../fixtures/transforms.h"
#include "../../fixtures/two_joints.h"

namespace calibration_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;
using Catch::Matchers::StartsWith;

namespace {

constexpr int kCount = 15;

/// base -shoulder(z)- upper -elbow(y)- fore with marks; a tracker and a camera on the base look at
/// them. Two steps.
Rig arm() {
  Rig rig;
  add_two_joints(rig, 0.0003);
  add_joint(rig, JointType::revolute, "idle", "base", "away", {0, 0, 1}, at({0, 0.5, 0}), 0.0003);
  finish_tree(rig.tree);
  add_marks_and_tracker(rig);
  add_eye(rig);
  Step camera, all;
  camera.name = "camera";
  camera.sensors = {1};
  camera.free = {"sensor/eye/pose"};
  all.name = "all";
  all.sensors = {0, 1};
  all.free = {"sensor/*/pose", "joint/elbow/offset", "joint/elbow/scale"};
  rig.steps = {camera, all};
  return rig;
}

/// What the arm logs whose elbow is off by `offset`, and whose sensors by a few millimetres and
/// milliradians.
std::vector<Sample> logged(double offset, unsigned long seed) {
  Rig truth = arm();
  truth.joints[joint_index(truth, "elbow")].offset = offset;
  for (Sensor& s : truth.sensors)
    s.link_T_sensor =
        s.link_T_sensor * exp_se3((Vector6d() << 4e-3, -3e-3, 2e-3, 0.01, -5e-3, 8e-3).finished());
  Random random(seed);
  std::vector<Sample> out;
  for (int n = 0; n < kCount; ++n) {
    const TruePosture p = random_posture(truth, random, 0.5, true);
    out.push_back(make_sample(truth, p, "s" + std::to_string(n)));
    for (const int sensor : {0, 1}) REQUIRE(add_view(out.back(), truth, sensor, 0, p, &random));
  }
  return out;
}

std::shared_ptr<const Recording> recorded(double offset = 0.02, unsigned long seed = 1) {
  return make_recording(arm(), logged(offset, seed));
}

StepSelection selection(const std::vector<std::string>& free,
                        const std::vector<std::string>& fix = {},
                        const std::string& last_step = "") {
  StepSelection out;
  out.free = free;
  out.fix = fix;
  out.last_step = last_step;
  return out;
}

}  // namespace

TEST_CASE("calibration: errors of a selection begin with their place") {
  const auto recording = recorded();
  const auto resolve = [&](const StepSelection& what) { resolve_steps(*recording, what); };
  CHECK_THROWS_WITH(resolve(selection({"joint/elbow/offset", "joint/elbow/offsets"})),
                    StartsWith("free[1]: 'joint/elbow/offsets'"));
  CHECK_THROWS_WITH(resolve(selection({}, {"sensor/eye/pose", "sensor/ear*"})),
                    StartsWith("fix[1]: 'sensor/ear*'"));
  CHECK_THROWS_AS(resolve(selection({}, {"sensor/ear*"})), NameError);
  CHECK_THROWS_WITH(resolve(selection({}, {}, "none")),
                    StartsWith("last_step: ") && Contains("'none'") && Contains("camera, all"));
  CHECK_THROWS_AS(resolve(selection({}, {}, "none")), std::invalid_argument);
  CHECK_THROWS_WITH(resolve(selection({}, {"*"})), Contains("step 'all' frees nothing"));
  try {
    resolve(selection({"joint/elbow/offsets"}));
    FAIL("no error");
  } catch (const NameError& error) {
    CHECK(error.name == "joint/elbow/offsets");
  }
  // The same of those who resolve on the way.
  CalibrationOptions options;
  options.free = {"nobody"};
  CHECK_THROWS_WITH(Calibration(recording, options), StartsWith("free[0]: "));
  CHECK_THROWS_WITH(calibrate(recording, options), StartsWith("free[0]: "));
  CHECK_THROWS_WITH(evaluate(*recording, NoiseMode::latent, {"joint/elbow/offset", "nobody"}),
                    StartsWith("free[1]: "));
  CHECK_THROWS_AS(Calibration(make_recording(arm(), {})), std::invalid_argument);
  Rig without = arm();
  without.steps.clear();
  CHECK_THROWS_AS(resolve_steps(Recording(without, recording->samples), {}), std::invalid_argument);
}

TEST_CASE("calibration: what a selection changes, and what changes nothing") {
  const auto recording = recorded();
  const auto last = [&](const std::vector<std::string>& free,
                        const std::vector<std::string>& fix = {}) {
    return resolve_steps(*recording, selection(free, fix)).back();
  };
  CHECK(last({}).without_effect.empty());
  CHECK(last({"target/marks/pose.rx"}, {"joint/elbow/scale"}).without_effect.empty());
  const StepPlan fixed = last({}, {"sensor/tracker/pose.x"});
  CHECK(fixed.without_effect.empty());
  REQUIRE(fixed.free.size() == 4);
  CHECK(components_of(fixed.free).size() == components_of(last({}).free).size() - 1);

  const StepPlan plan = last({"joint/elbow/offset", "joint/id*/offset", "target/marks/pose.rx"},
                             {"joint/shoulder/offset"});
  REQUIRE(plan.without_effect.size() == 3);
  CHECK(plan.without_effect[0] ==
        "`free` 'joint/elbow/offset' changes nothing: it is free in step 'all' anyway");
  CHECK_THAT(
      plan.without_effect[1],
      StartsWith(
          "`free` 'joint/id*/offset' changes nothing: no measurement of step 'all' depends on it"));
  CHECK(plan.without_effect[2] ==
        "`fix` 'joint/shoulder/offset' changes nothing: it is not free in step 'all' anyway");
  CHECK(plan.unused == std::vector<std::string>{"joint/idle/offset"});

  CalibrationOptions options;
  options.free = {"joint/elbow/offset"};
  CHECK(calibrate(recording, options).without_effect == last(options.free).without_effect);
}

TEST_CASE("calibration: plans count what their steps minimise") {
  const auto recording = recorded();
  CalibrationOptions options;
  options.noise = NoiseMode::none;
  const std::vector<StepPlan> none = Calibration(recording, options).plan();
  REQUIRE(none.size() == 2);
  CHECK(none[0].name == "camera");
  CHECK(none[0].samples == kCount);
  CHECK(none[0].rows == 2 * kMarksOfArm * kCount);
  CHECK(none[0].unknowns == 6);
  CHECK(none[1].rows == 5 * kMarksOfArm * kCount);
  CHECK(none[1].unknowns == 14);
  options.noise = NoiseMode::latent;
  options.last_step = "camera";
  const std::vector<StepPlan> latent =
      Calibration(recording, options).plan();  // with the errors of shoulder and elbow
  REQUIRE(latent.size() == 1);
  CHECK(latent[0].rows == 2 * kMarksOfArm * kCount + 2 * kCount);
  CHECK(latent[0].unknowns == 6 + 2 * kCount);
  const Solution solution = calibrate(recording, options);
  CHECK(solution.steps.size() == 1);
  CHECK(solution.dof == latent[0].rows - latent[0].unknowns);
}

TEST_CASE("calibration: solved again with other samples it ends where a new one does") {
  for (const NoiseMode mode :
       {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none}) {
    INFO("mode " << static_cast<int>(mode));
    CalibrationOptions options;
    options.noise = mode;
    Calibration calibration(recorded(0.02, 1), options);
    const Solution first = calibration.solve();
    REQUIRE(first.status == Status::converged);
    CHECK(first.values.shared == calibrate(recorded(0.02, 1), options).values.shared);
    const VectorXd kept = first.values.shared;
    const double offset = first["joint/elbow/offset"].value[0];
    for (const auto& [moved, seed] : {std::make_pair(-0.01, 2ul), std::make_pair(0.015, 3ul)}) {
      const auto next = recorded(moved, seed);
      for (int i = 0; i < kCount; ++i) calibration.replace(i, next->samples[i]);
      const Solution fresh = calibrate(next, options);
      const Solution& again = calibration.solve();
      REQUIRE(again.status == Status::converged);
      CHECK(again.parameters.empty());  // made when they are asked for, and not those of before
      CHECK_THROWS_AS(again["joint/elbow/offset"], std::out_of_range);
      CHECK_THROWS_AS(linearise(again), std::invalid_argument);
      CHECK(std::isnan(again.chi2_per_dof()));
      CHECK(&calibration.last() == &again);
      CHECK(again.chi2 == Approx(fresh.chi2).epsilon(1e-10));
      CHECK(again.dof == fresh.dof);
      REQUIRE(again.parameters.size() == fresh.parameters.size());
      for (const ParameterEstimate& expected : fresh.parameters) {
        INFO(expected.name);
        const ParameterEstimate& found = again[expected.name];
        for (size_t c = 0; c < expected.value.size(); ++c) {
          CHECK(std::abs(found.value[c] - expected.value[c]) <= 1e-9 * expected.sigma[c]);
          CHECK(found.sigma[c] == Approx(expected.sigma[c]).epsilon(1e-8));
          CHECK(found.initial[c] == expected.initial[c]);
        }
        CHECK(found.step == expected.step);
      }
      CHECK((again.covariance - fresh.covariance).norm() < 1e-8 * fresh.covariance.norm());
      CHECK(again.samples()[3].views[0].z == next->samples[3].views[0].z);
    }
    CHECK(first.values.shared == kept);
    CHECK(first["joint/elbow/offset"].value[0] == offset);
  }
}

TEST_CASE("calibration: the sigmas of a replaced sample's readings count") {
  const auto quiet = recorded(0.02, 1);
  const auto with_noise = [](std::vector<Sample> samples) {
    for (size_t i = 0; i < samples.size(); ++i)
      samples[i].noise = {1 + 0.5 * static_cast<double>(i), 3, 1};
    return make_recording(arm(), std::move(samples));
  };
  const auto noisy = with_noise(logged(-0.01, 2)), noisy_before = with_noise(quiet->samples),
             silent = recorded(-0.01, 2);
  for (const NoiseMode mode : {NoiseMode::latent, NoiseMode::marginal})
    for (const auto& [before, after] : {std::pair(quiet, noisy), std::pair(noisy_before, silent),
                                        std::pair(noisy_before, noisy)}) {
      INFO("mode " << static_cast<int>(mode) << ", noise " << before->samples[0].noise.size()
                   << " by " << after->samples[0].noise.size());
      CalibrationOptions options;
      options.noise = mode;
      Calibration calibration(before, options);
      REQUIRE(calibration.solve().status == Status::converged);
      for (int i = 0; i < kCount; ++i) calibration.replace(i, after->samples[i]);
      REQUIRE(calibration.solve().status == Status::converged);
      const Solution fresh = calibrate(after, options);
      const ParameterEstimate& expected = fresh["joint/elbow/offset"];
      const ParameterEstimate& found = calibration.last()["joint/elbow/offset"];
      CHECK(calibration.last().chi2 == Approx(fresh.chi2).epsilon(1e-10));
      CHECK(std::abs(found.value[0] - expected.value[0]) <= 1e-9 * expected.sigma[0]);
      CHECK(found.sigma[0] == Approx(expected.sigma[0]).epsilon(1e-8));
      for (int i = 0; i < kCount; ++i)
        CHECK(joint_sigma(arm(), calibration.recording().samples[i], 1) ==
              joint_sigma(arm(), after->samples[i], 1));
    }
}

TEST_CASE("calibration: samples are replaced by such as show the same") {
  const auto recording = recorded();
  Calibration calibration(recording);
  Sample other = recording->samples[2];
  CHECK_NOTHROW(calibration.replace(0, other));
  CHECK(recording->samples[0].readings != other.readings);  // what was given is not touched
  CHECK_THROWS_AS(calibration.replace(-1, other), std::invalid_argument);
  CHECK_THROWS_AS(calibration.replace(kCount, other), std::invalid_argument);
  SECTION("another order of views") { std::swap(other.views[0], other.views[1]); }
  SECTION("a view less") { other.views.pop_back(); }
  SECTION("other points") { std::swap(other.views[0].ids.own()[0], other.views[0].ids.own()[1]); }
  SECTION("numbers missing") { other.views[1].z.pop_back(); }
  SECTION("covariances instead of sigmas") {
    other.views[0].covariance.assign(kMarksOfArm, Matrix3d::Identity());
  }
  SECTION("sigmas of some readings only") { other.noise = {1}; }
  SECTION("held out") { other.train = false; }
  CHECK_THROWS_AS(calibration.replace(0, other), std::invalid_argument);
}

TEST_CASE("calibration: a solution's parameters, poses and robot") {
  const Rig rig = arm();
  const Solution solution = calibrate(recorded(), {});
  REQUIRE(solution.status == Status::converged);
  CHECK(solution.usable());
  CHECK(solution.message.empty());
  const ParameterEstimate& offset = solution["joint/elbow/offset"];
  CHECK(offset.name == "joint/elbow/offset");
  CHECK(offset.step == "all");
  CHECK(std::abs(offset.value[0] - 0.02) < 4 * offset.sigma[0]);
  CHECK_FALSE(offset.pose);
  CHECK_THROWS_AS(solution["joint/shoulder/offset"], std::out_of_range);
  CHECK_THROWS_AS(solution["nobody"], std::out_of_range);

  const ParameterEstimate& eye = solution["sensor/eye/pose"];
  REQUIRE(eye.pose);
  CHECK(solution.pose("sensor/eye/pose").translation == eye.pose->translation);
  CHECK(solution.pose("sensor/eye/pose").rotation == eye.pose->rotation);
  const Pose moved =
      rig.sensors[1].link_T_sensor * exp_se3(Eigen::Map<const Vector6d>(eye.value.data()));
  CHECK((solution.pose("sensor/eye/pose").translation - moved.translation).norm() < 1e-12);
  CHECK((solution.pose("sensor/eye/pose").rotation - moved.rotation).norm() < 1e-12);
  CHECK(solution.pose("joint/shoulder/origin").translation ==
        rig.tree.joints[0].parent_T_joint.translation);  // no step freed it
  CHECK_THROWS_AS(solution.pose("joint/elbow/offset"), std::out_of_range);

  // The same link poses without the offset: position = scale * reading.
  const Tree tree = solution.tree();
  const double scale = solution["joint/elbow/scale"].value[0];
  for (const double reading : {-0.4, 0.0, 0.7}) {
    const Joint &before = rig.tree.joints[1], &after = tree.joints[1];
    const Pose expected =
                   before.parent_T_joint * joint_motion(before, scale * reading + offset.value[0]),
               folded = after.parent_T_joint * joint_motion(after, scale * reading);
    CHECK((expected.translation - folded.translation).norm() < 1e-12);
    CHECK((expected.rotation - folded.rotation).norm() < 1e-12);
  }
  for (const int same : {0, 2}) {
    CHECK(tree.joints[same].parent_T_joint.translation ==
          rig.tree.joints[same].parent_T_joint.translation);
    CHECK(tree.joints[same].parent_T_joint.rotation ==
          rig.tree.joints[same].parent_T_joint.rotation);
  }
}

TEST_CASE("calibration: a start that cannot be evaluated is a status") {
  Rig rig = arm();
  SECTION("of a mounted target") {
    rig.sensors[1].link_T_sensor.rotation =
        (rig.sensors[1].link_T_sensor.rotation * rpy(0, kPi, 0)).eval();  // looks away
    for (Step& step : rig.steps)  // freed wholly it would start where the data put it
      for (std::string& name : step.free)
        if (name.rfind("sensor/", 0) == 0) name += ".r[xyz]";
    const auto recording = make_recording(rig, logged(0.02, 1));
    const Solution solution = calibrate(recording, {});
    CHECK(solution.status == Status::undefined_start);
    CHECK_FALSE(solution.usable());
    CHECK_THAT(solution.message,
               StartsWith("step 'camera': in sample 's0'") && Contains("'eye' of 'marks'"));
    CHECK(solution.pose("sensor/eye/pose").rotation == rig.sensors[1].link_T_sensor.rotation);

    StudyOptions options;
    const std::optional<Report> report = study(recording, options);
    REQUIRE(report);
    CHECK(report->solution.status == Status::undefined_start);
    CHECK(report->solution.message == solution.message);
    CHECK(report->residuals.sensors.empty());
  }
  SECTION("of a free target that no pose explains") {
    rig.targets[0].link = -1;
    std::vector<Sample> samples = logged(0.02, 1);
    for (double& z : samples[4].views[1].z) z = 1e9;  // no direction
    samples[4].views.erase(samples[4].views.begin());
    const Solution solution = calibrate(make_recording(rig, samples), {});
    CHECK(solution.status == Status::undefined_start);
    CHECK_THAT(solution.message, Contains("s4"));
    CHECK(solution.pose("sensor/eye/pose").translation == rig.sensors[1].link_T_sensor.translation);
  }
}

TEST_CASE("calibration: numbers that overflow together are a status that names a sample") {
  const auto spoil = [](const std::function<void(std::vector<Sample>&)>& change) {
    std::vector<Sample> samples = logged(0.02, 1);
    change(samples);
    return calibrate(make_recording(arm(), samples), {});
  };
  SECTION("one sample's cost is infinite") {
    const Solution solution = spoil([](std::vector<Sample>& s) {
      s[4].views[0].sigma = {1e-200, 1e-200, 1e-200};
    });
    CHECK(solution.status == Status::undefined_start);
    CHECK_THAT(solution.message, Contains("'s4'") && Contains("sigma"));
  }
  SECTION("each cost is a number, and their sum is none") {
    const Solution solution = spoil([](std::vector<Sample>& s) {
      for (Sample& sample : s) sample.views[0].sigma = {6e-157, 6e-157, 6e-157};
    });
    CHECK(solution.status == Status::undefined_start);
    CHECK_THAT(solution.message, Contains("in sample 's"));
  }
}

TEST_CASE(
    "calibration: after a replaced sample that cannot be evaluated it goes on from the last "
    "values") {
  const auto recording = recorded();
  Calibration calibration(recording);
  const VectorXd first = calibration.solve().values.shared;
  CHECK(calibration.solve().status == Status::converged);  // so that estimates are to be made again
  Sample broken = recording->samples[5];
  broken.views[0].z[0] = std::numeric_limits<double>::quiet_NaN();
  calibration.replace(5, broken);
  const Solution& solution = calibration.solve();
  CHECK(solution.status == Status::undefined_start);
  CHECK_FALSE(solution.usable());
  CHECK_FALSE(solution.message.empty());
  CHECK(solution.values.shared.allFinite());
  calibration.replace(5, recording->samples[5]);
  CHECK(calibration.solve().status == Status::converged);
  CHECK(solution.message.empty());
  CHECK((calibration.last().values.shared - first).norm() < 1e-9);
}

TEST_CASE("calibration: a cancellation is a status") {
  const auto recording = recorded();
  CalibrationOptions options;
  std::string at;
  int calls = 0, allowed = 0;
  options.progress = Progress([&](const Progress::News& news) {
    at = news.what + " " + std::to_string(news.iteration);
    return calls++ < allowed;
  });
  for (allowed = 0; allowed < 8; ++allowed) {
    calls = 0;
    const Solution solution = calibrate(recording, options);
    CHECK(solution.status == Status::cancelled);
    CHECK(solution.message == "cancelled");
    CHECK_FALSE(solution.usable());
    CHECK(calls == allowed + 1);
    StudyOptions study_options;
    study_options.calibration = options;
    calls = 0;
    CHECK_FALSE(study(recording, study_options));
  }
  allowed = 1000;
  Calibration calibration(recording, options);
  REQUIRE(calibration.solve().status == Status::converged);
  const VectorXd values = calibration.last().values.shared;
  calls = allowed;
  CHECK(calibration.solve().status == Status::cancelled);
  CHECK_THAT(at, StartsWith("all "));
  CHECK(calibration.last().values.shared == values);
  calls = 0;
  CHECK(calibration.solve().status == Status::converged);
}

}  // namespace calibration_test
