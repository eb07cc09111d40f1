// models/rig/conditions.h: positions that depend on the conditions of a sample, on gear ratios and
// on readings of other joints, in estimation, Configuration and simulation.
//
// Proves: every derivative of an Estimation of the nasty robot with backlash, temperatures,
// ripples, couplings and time offsets, column by column and the errors of readings one by one, with
// followers, a scanning joint, rolling shutters, stiff and bending, in samples with and without
// conditions; derivatives of a frame by readings that are coupled; residuals of simulated samples
// (simulation walks by Configuration) are noise at the truth, and are not without each term. Does
// not prove: that gears and clocks are so; what the automatic path keeps
// (tests/program/conditions_test.py).
#include "../../../models/rig/conditions.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../../../models/analysis/frames.h"
#include "../../../models/rig/elasticity.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/open_recording.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/stacked.h"

namespace conditions_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// The nasty robot with play in joints of every kind, and sensors with clocks of their own.
Rig late_robot(bool bends) {
  Rig rig = nasty_robot();
  Random random(11);
  for (const char* joint : {"pan", "elbow", "slide", "turn", "scan", "lift"})
    rig.joints[joint_index(rig, joint)].terms.backlash = random.uniform(-0.02, 0.02);
  for (const char* joint : {"pan", "elbow", "slide", "scan", "wrist"})
    rig.joints[joint_index(rig, joint)].terms.temperature = random.uniform(-2e-3, 2e-3);
  for (const char* joint : {"elbow", "tilt"}) {
    JointTerms& terms = rig.joints[joint_index(rig, joint)].terms;
    terms.gear_ratios = {7, 11.5};
    for (int k = 0; k < 2 * kRipple; ++k) terms.ripple.push_back(random.uniform(-0.01, 0.01));
  }
  const std::pair<const char*, std::vector<const char*>> coupled[] = {
      {"elbow", {"shoulder"}}, {"wrist", {"elbow", "shoulder"}}, {"tilt", {"pan"}}};
  for (const auto& [joint, others] : coupled)
    for (const char* other : others) {
      JointTerms& terms = rig.joints[joint_index(rig, joint)].terms;
      terms.coupled_to.push_back(joint_index(rig, other));
      terms.coupling.push_back(random.uniform(-0.1, 0.1));
    }
  for (Sensor& sensor : rig.sensors)
    if (sensor.model->measurement_kind() != MeasurementKind::chain)
      sensor.time_offset = random.uniform(-0.02, 0.02);
  Random rolling(14);
  for (Sensor& sensor : rig.sensors)
    if (sensor.model->measurement_kind() == MeasurementKind::rays)
      sensor.line_time = rolling.uniform(-3e-5, 3e-5);
  if (!bends) return rig;
  rig.base = rig.tree.root;
  rig.elasticity = nominal_elasticity(rig);
  for (size_t j = 0; j < rig.tree.joints.size(); ++j)
    if (rig.elasticity->skeleton->index[j] >= 0)
      for (int c = 0; c < 3; ++c) rig.elasticity->compliance[j](c) = random.uniform(-2e-3, 2e-3);
  return rig;
}

struct Late : OpenRecording {
  Values values;

  explicit Late(bool bends) : OpenRecording(late_robot(bends)) {
    std::vector<TruePosture> postures;
    samples = nasty_samples(rig, 3, 43, &postures);
    Random random(12);
    for (size_t s = 0; s + 1 < samples.size(); ++s) {  // the last one states nothing
      samples[s].conditions.approach.resize(rig.joints.size());
      samples[s].conditions.rates.resize(rig.joints.size());
      for (size_t j = 0; j < rig.joints.size(); ++j) {
        samples[s].conditions.approach[j] = random.uniform(-1, 1) < 0 ? -1 : 1;
        samples[s].conditions.rates[j] = random.uniform(-1, 1);
      }
      samples[s].conditions.temperature = random.uniform(10, 40);
    }
    values.shared = table.initial;
    for (size_t s = 0; s < samples.size(); ++s)
      for (const auto& [target, board] : postures[s].boards)
        values.targets[{static_cast<int>(s), target}] = to_pose(board);
  }
};

}  // namespace

TEST_CASE("conditions: every derivative of an estimation") {
  for (const bool bends : {false, true}) {
    const Late s(bends);
    EstimationSetup setup;
    setup.noise = NoiseMode::latent;
    setup.sensors = all_sensors(s.rig);
    setup.free = freed(
        s.table, {"joint/*/backlash", "joint/*/temperature", "joint/*/ripple", "joint/*/coupling",
                  "sensor/*/time_offset", "sensor/*/line_time", "joint/*/offset", "joint/*/scale",
                  "joint/flange/origin", "joint/pan/origin"});
    Estimation problem(s, s.training(), setup);
    problem.set_workers(1);
    const VectorXd state = problem.pack(s.values);
    problem.renew(state);
    problem.prepare(state);
    const Stacked analytic = stack(problem, state);
    const MatrixXd numeric = stacked_differences(problem, state, 1e-5);
    std::map<std::string, int> touched;
    for (Eigen::Index k = 0; k < analytic.j.cols(); ++k) {
      const std::string name = k >= analytic.privates
                                   ? problem.column_name(static_cast<int>(k - analytic.privates))
                                   : "private";
      INFO("column " << k << " " << name << " bends " << bends);
      CHECK((analytic.j.col(k) - numeric.col(k)).norm() <= 1e-6 * numeric.col(k).norm() + 1e-5);
      if (numeric.col(k).norm() > 0)
        for (const char* one :
             {"backlash", "temperature", "ripple", "coupling", "time_offset", "line_time"})
          touched[one] += name.find(one) != std::string::npos;
    }
    CHECK(touched["backlash"] + touched["time_offset"] > 8);
    CHECK(touched["temperature"] == 5);
    CHECK(touched["ripple"] == 16);
    CHECK(touched["coupling"] == 4);
    CHECK(touched["line_time"] >= 2);
  }
}

TEST_CASE("conditions: a frame moves with readings that its joints are coupled to") {
  const Rig rig = late_robot(false);
  const ParameterTable table(rig);
  Readings readings(rig.joints.size(), 0);
  Random random(13);
  for (double& reading : readings) reading = random.uniform(-1, 1);
  const Frame tool = {"tool", link_index(rig, "tool"), -1};
  const FrameDerivative by = frame_derivative(rig, table, table.initial, {}, tool, readings);
  REQUIRE(by.joints.size() == 4);  // shoulder, elbow, slide, wrist
  for (size_t i = 0; i < by.joints.size(); ++i) {
    constexpr double kStep = 1e-6;
    Readings more = readings, less = readings;
    more[by.joints[i]] += kStep;
    less[by.joints[i]] -= kStep;
    const Pose a = base_T_frame(rig, table, table.initial, tool, less),
               b = base_T_frame(rig, table, table.initial, tool, more);
    VectorXd numeric(6);
    numeric << b.translation - a.translation, log_so3(b.rotation * a.rotation.transpose());
    numeric *= rig.joints[by.joints[i]].sigma / (2 * kStep);
    const VectorXd analytic = by.by_readings.col(static_cast<Eigen::Index>(i));
    INFO(rig.tree.joints[by.joints[i]].name << ": " << analytic.transpose() << ", "
                                            << numeric.transpose());
    CHECK((analytic - numeric).norm() < 1e-7 * numeric.norm());
  }
}

TEST_CASE("conditions: simulated samples fit at the truth, with what they state only") {
  Rig rig;
  add_link(rig, "base");
  rig.base = 0;
  const auto at = [](double x, double z) { return Pose{Matrix3d::Identity(), {x, 0, z}}; };
  add_joint(rig, JointType::revolute, "a", "base", "upper", Vector3d::UnitZ(), at(0, 0.3), 1e-5);
  add_joint(rig, JointType::revolute, "b", "upper", "fore", Vector3d::UnitY(), at(0.4, 0), 1e-5);
  add_joint(rig, JointType::prismatic, "c", "fore", "hand", Vector3d::UnitX(), at(0.3, 0), 1e-5);
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.1, 0, 0, 0, 0.1, 0.1, 0, 0;
  add_points(rig, "ball", points, "hand", at(0.1, 0));
  add_tracker(rig, "tracker", "base", at(1, 1), Vector3d::Constant(1e-5));
  finish_tree(rig.tree);
  rig.joints.resize(rig.tree.joints.size());
  for (JointSettings& joint : rig.joints) joint.terms.backlash = joint.terms.temperature = 2e-3;
  rig.joints[1].terms.gear_ratios = {50};
  rig.joints[1].terms.ripple = {1e-3, -2e-3, 0, 1e-3};
  rig.joints[1].terms.coupled_to = {0};
  rig.joints[1].terms.coupling = {0.05};
  rig.sensors[0].time_offset = 5e-3;
  const ParameterTable table(rig);
  CHECK(table.initial(table.all[table.time_offset[0]].start) == 5e-3);
  CHECK(table.select("joint/b/backlash").size() == 1);

  SimulationOptions options;
  options.samples = 40;
  std::vector<Sample> samples = simulate(rig, table, table.initial, options).samples;
  Rig known = rig;
  const auto chi2_per_row = [&] {
    const Recording recording(known, samples);
    EstimationSetup setup;
    setup.sensors = {0};
    const Estimation problem(recording, recording.training(), setup);
    Values values;
    values.shared = recording.table.initial;
    double sum = 0, rows = 0;
    for (const ViewResiduals& view : problem.residuals(problem.pack(values))) {
      sum += view.whitened.squaredNorm();
      rows += static_cast<double>(view.whitened.size());
    }
    return sum / rows;
  };
  CHECK(chi2_per_row() < 5);  // noise of points and of readings
  std::vector<Sample> stated = samples;
  for (Sample& sample : samples) sample.conditions.approach.clear();
  CHECK(chi2_per_row() > 1000);
  samples = stated;
  for (Sample& sample : samples) sample.conditions.rates.clear();
  CHECK(chi2_per_row() > 1000);
  samples = stated;
  for (Sample& sample : samples) sample.conditions.temperature.reset();
  CHECK(chi2_per_row() > 1000);
  samples = stated;
  known.joints[1].terms.ripple.assign(kRipple, 0);
  CHECK(chi2_per_row() > 1000);
  known = rig;
  known.joints[1].terms.coupling = {0};
  CHECK(chi2_per_row() > 1000);
}

TEST_CASE("conditions: a rolling shutter sees each point at the time of its row") {
  Rig rig;
  const std::string hand = add_arm(rig, 1e-5);
  const Pose ahead = {(Matrix3d() << 0, 0, 1, -1, 0, 0, 0, -1, 0).finished(), {0.05, 0, 0}};
  const int camera = add_camera(rig, "camera", hand, ahead, Lens::pinhole, {}, 0, 0.1);
  const bool mounted = GENERATE(true, false);
  add_grid(rig, "board", 5, 7, 0.03, mounted ? "base" : "", {Matrix3d::Identity(), {1, 0, 0.5}});
  rig.sensors[camera].time_offset = 2e-3;
  rig.sensors[camera].line_time = 3e-5;
  const ParameterTable table(rig);
  SimulationOptions options;
  options.samples = 30;
  const Simulation made = simulate(rig, table, table.initial, options);
  REQUIRE(made.samples.size() == 30);
  Values values;
  values.shared = table.initial;
  values.targets = made.targets;
  Rig known = rig;
  const auto residuals = [&](NoiseMode noise) {
    const Recording recording(known, made.samples);
    EstimationSetup setup;
    setup.noise = noise;
    setup.sensors = {camera};
    Estimation problem(recording, recording.training(), setup);
    Values now = values;
    now.shared = recording.table.initial;
    const VectorXd state = problem.pack(now);
    problem.renew(state);
    return problem.residuals(state);
  };
  const auto chi2_per_row = [&](NoiseMode noise) {
    double sum = 0, rows = 0;
    for (const ViewResiduals& view : residuals(noise)) {
      sum += view.whitened.squaredNorm();
      rows += static_cast<double>(view.whitened.size());
    }
    return sum / rows;
  };
  const std::vector<ViewResiduals> views = residuals(NoiseMode::latent);
  CHECK(views.size() == made.samples.size());  // one of each view, with all of its points
  for (const ViewResiduals& view : views) {
    CHECK(view.raw.size() == 2 * 35);
    CHECK(view.whitened.size() == 2 * 35);
    CHECK((view.whitened * 0.1 - view.raw).norm() < 1e-9);
  }
  CHECK(chi2_per_row(NoiseMode::latent) < 1.3);  // pixels, and readings to 0.01 mrad
  CHECK(chi2_per_row(NoiseMode::point) < 1.1);
  CHECK_THROWS_WITH(residuals(NoiseMode::marginal), Catch::Contains("latent, point, none"));
  known.sensors[camera].line_time = 0;
  CHECK(chi2_per_row(NoiseMode::latent) > 20);
  known.sensors[camera].line_time.reset();
  CHECK(chi2_per_row(NoiseMode::latent) > 20);
}

}  // namespace conditions_test
