// The shipped example as a statistical laboratory: simulated often, calibrated each time, compared
// with the truth. Proves that estimates are right and that sigmas mean what they say in mode
// latent, on this robot, also with ten times its joint noise and with priors; and how far they are
// off in the other modes. It does not prove anything about errors that the model does not have
// (elasticity, backlash, wrong corners).

#include <unistd.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "../../../io/document/files.h"
#include "../../../io/results/results.h"
#include "../../../io/rig/rig_file.h"
#include "../../../io/rig/samples_file.h"
#include "../../../io/rig/simulation_file.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/study.h"

namespace example_test {

using namespace kincal;

namespace {

const std::string kExample = std::string(KINCAL_SOURCE_DIR) + "/examples/pr2/";

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kSeeds = 20;
#else
constexpr int kSeeds = 200;
#endif

struct Laboratory {
  Rig rig = read_rig(kExample + "rig.yaml").rig;
  ParameterTable table{rig};
  VectorXd truth = read_truth(kExample + "truth_values.json", table);
  SimulationOptions options;

  Laboratory() {
    options.postures = read_postures(kExample + "postures.jsonl", rig);
    options.samples = static_cast<int>(options.postures.size());
  }
  std::vector<Sample> samples(int seed) {
    options.seed = seed;
    return simulate(rig, table, truth, options).samples;
  }
};

Solution calibrate(const Rig& rig, const std::vector<Sample>& samples,
                   NoiseMode noise = NoiseMode::latent) {
  CalibrationOptions options;
  options.noise = noise;
  return fixture::solution_of(rig, samples, options);
}

/// Estimate minus truth of the last step's freed components, in the sense of the covariance: a
/// wholly freed pose as the increment on the right at the estimate, else component by component.
VectorXd errors(const Solution& result, const ParameterTable& table, const VectorXd& truth) {
  VectorXd e(static_cast<Eigen::Index>(result.columns.size()));
  for (Eigen::Index i = 0; i < e.size(); ++i) {
    const Parameter& p = table.all[result.columns[i].parameter];
    const int c = result.columns[i].index;
    if (!p.pose) {
      e(i) = result.values.shared(p.start + c) - truth(p.start + c);
      continue;
    }
    const Pose estimate = get_pose(result.values.shared, p.start), real = get_pose(truth, p.start),
               initial = get_pose(table.initial, p.start);
    const bool whole =
        std::count_if(result.columns.begin(), result.columns.end(), [&](const Component& other) {
          return other.parameter == result.columns[i].parameter;
        }) == 6;
    e(i) = whole ? -log_se3(inverse(estimate) * real)(c)
                 : (log_se3(inverse(initial) * estimate) - log_se3(inverse(initial) * real))(c);
  }
  return e;
}

double nees(const Solution& result, const VectorXd& e) {
  return fixture::dense::weighted_square(e, result.covariance);
}

}  // namespace

/// Over many simulations. 1 and 1 are honest; of honest sigmas 0.6827 and 0.9545 of the errors are
/// within one and two.
struct Honesty {
  double chi2 = 0, nees = 0, within_one = 0,
         within_two = 0;  // chi2/dof; squared error in the covariance's metric / unknowns; shares
  int parameters = 0;
};

/// Calibrations of seeds 1 to `seeds`. `spread`: the truth is drawn anew for every seed, from the
/// rig's values by this much.
Honesty honesty(Laboratory& lab, NoiseMode mode, int seeds,
                const std::vector<Spread>& spread = {}) {
  Honesty h;
  double dof = 0, count = 0;
  const VectorXd truth = lab.truth;
  for (int seed = 1; seed <= seeds; ++seed) {
    if (!spread.empty()) {
      const VectorXd drawn = draw_truth(lab.table, spread, static_cast<std::uint64_t>(seed));
      lab.truth = truth;
      for (const Spread& s : spread)
        for (const Freed& f : lab.table.select(s.pattern)) {
          const Parameter& p = lab.table.all[f.parameter];
          lab.truth.segment(p.start, p.pose ? 12 : p.size()) =
              drawn.segment(p.start, p.pose ? 12 : p.size());
        }
    }
    const Solution result = calibrate(lab.rig, lab.samples(seed), mode);
    CAPTURE(seed, static_cast<int>(mode));
    REQUIRE(result.status == Status::converged);
    const VectorXd e = errors(result, lab.table, lab.truth),
                   sigma = result.covariance.diagonal().cwiseSqrt();
    h.parameters = static_cast<int>(e.size());
    h.chi2 += result.chi2;
    dof += static_cast<double>(result.dof);
    h.nees += nees(result, e);
    h.within_one += static_cast<double>((e.cwiseAbs().array() < sigma.array()).count());
    h.within_two += static_cast<double>((e.cwiseAbs().array() < 2 * sigma.array()).count());
    count += static_cast<double>(e.size());
  }
  lab.truth = truth;
  h.chi2 /= dof;
  h.nees /= count;
  h.within_one /= count;
  h.within_two /= count;
  WARN("mode " << static_cast<int>(mode) << ", " << seeds << " seeds, " << h.parameters
               << " parameters: chi2/dof " << h.chi2 << ", NEES/dof " << h.nees
               << ", within 1 sigma " << h.within_one << ", within 2 sigma " << h.within_two);
  return h;
}

TEST_CASE("example: latent mode is honest over many seeds", "[example][statistics]") {
  Laboratory lab;
  lab.rig.steps = {lab.rig.steps.back()};  // everything together, from the rig's values
  const Honesty h = honesty(lab, NoiseMode::latent, kSeeds);
  REQUIRE(h.parameters >= 30);
  CHECK(h.chi2 > 0.95);
  CHECK(h.chi2 < 1.05);
  // 20 seeds (sanitizers): the standard deviation of the pooled figure is 0.042, of 200 seeds
  // 0.013.
  CHECK(h.nees > (kSeeds < 200 ? 0.85 : 0.95));
  CHECK(h.nees < (kSeeds < 200 ? 1.15 : 1.05));
  CHECK(std::abs(h.within_one - 0.6827) < (kSeeds < 200 ? 0.05 : 0.02));
  CHECK(std::abs(h.within_two - 0.9545) < (kSeeds < 200 ? 0.03 : 0.01));
}

TEST_CASE("example: latent mode is honest with ten times the joint noise, and with priors",
          "[example][statistics][slow]") {
  // Joint errors of 10 mrad are no small ones any more: 8 mm at the hand.
  Laboratory noisy;
  noisy.rig.steps = {noisy.rig.steps.back()};
  for (JointSettings& j : noisy.rig.joints) j.sigma *= 10;
  const Honesty large = honesty(noisy, NoiseMode::latent, kSeeds / 4);
  CHECK(large.chi2 == Approx(1).margin(0.03));
  CHECK(large.nees == Approx(1).margin(kSeeds < 200 ? 0.4 : 0.12));
  CHECK(std::abs(large.within_two - 0.9545) < (kSeeds < 200 ? 0.05 : 0.02));

  // Priors that the data hardly improve on some numbers; the truth is drawn from them, for whole
  // poses, parts of poses and offsets.
  Laboratory lab;
  Step step = lab.rig.steps.back();
  const std::vector<Spread> spread = {{"joint/?_*/offset", 0.002},
                                      {"sensor/*_arm/pose", 0.001},
                                      {"joint/*_stereo_frame_joint/origin", 0.002}};
  for (const Spread& s : spread) {
    PriorSetting prior;
    prior.pattern = s.pattern;
    prior.translation = s.sigma;
    step.priors.push_back(prior);
  }
  step.free.push_back("sensor/left_arm/pose.rx");  // a gauge without the priors
  lab.rig.steps = {step};
  // What is not freed of these poses stays as the rig has it.
  std::vector<Spread> drawn;
  for (const StepPlan& plan : resolve_steps(Recording(lab.rig, lab.samples(1)), {}))
    for (const Prior& p : plan.priors)
      drawn.push_back({lab.table.all[p.parameter].component_name(p.component), p.sigma});
  const Honesty prior = honesty(lab, NoiseMode::latent, kSeeds / 4, drawn);
  CHECK(prior.chi2 == Approx(1).margin(0.03));
  CHECK(prior.nees == Approx(1).margin(kSeeds < 200 ? 0.4 : 0.12));
  CHECK(std::abs(prior.within_two - 0.9545) < (kSeeds < 200 ? 0.05 : 0.02));
}

TEST_CASE("example: the other noise modes are not", "[example][statistics][slow]") {
  Laboratory lab;
  lab.rig.steps = {lab.rig.steps.back()};
  const int seeds = kSeeds / 4;
  const Honesty marginal = honesty(lab, NoiseMode::marginal, seeds),
                point = honesty(lab, NoiseMode::point, seeds),
                none = honesty(lab, NoiseMode::none, seeds);
  const double wide = kSeeds < 200 ? 2 : 1;
  // One view after the other honest, what views of a sample share counted as new each time: a
  // little too sure, all together.
  CHECK(marginal.chi2 == Approx(0.98).margin(0.01 * wide));
  CHECK(marginal.nees == Approx(1.16).margin(0.1 * wide));
  CHECK(marginal.within_two == Approx(0.938).margin(0.015 * wide));
  // 20 corners counted as 20 readings of the same encoder: residuals look too good, and half of the
  // errors exceed two sigmas.
  CHECK(point.chi2 == Approx(0.667).margin(0.02 * wide));
  CHECK(point.nees > 10);
  CHECK(point.nees < 17);
  CHECK(point.within_two == Approx(0.48).margin(0.05 * wide));
  // Joints taken as exact.
  CHECK(none.chi2 == Approx(2.34).margin(0.15 * wide));
  CHECK(none.nees > 150);
  CHECK(none.nees < 260);
  CHECK(none.within_two == Approx(0.2).margin(0.04 * wide));
}

TEST_CASE("example: all steps in turn recover the truth, the laser's gear reduction among it",
          "[example]") {
  Laboratory lab;
  const Solution result = calibrate(lab.rig, lab.samples(1));
  REQUIRE(result.steps.size() == lab.rig.steps.size());
  CHECK(result.status == Status::converged);
  const VectorXd e = errors(result, lab.table, lab.truth);
  for (Eigen::Index i = 0; i < e.size(); ++i) {
    CAPTURE(lab.table.name(result.columns[i]));
    CHECK(std::abs(e(i)) < 4.5 * std::sqrt(result.covariance(i, i)));
  }
  const auto scale = std::find_if(
      result.parameters.begin(), result.parameters.end(),
      [](const ParameterEstimate& p) { return p.name == "joint/laser_tilt_mount_joint/scale"; });
  REQUIRE(scale != result.parameters.end());
  CHECK(std::abs(scale->value[0] - 1) > 0.01);
  CHECK(std::abs(scale->value[0] -
                 lab.truth(lab.table.all[lab.table.select(scale->name)[0].parameter].start)) <
        5 * scale->sigma[0]);
  CHECK(scale->sigma[0] < 1e-3);
}

TEST_CASE("example: without noise the truth comes back exactly", "[example]") {
  Laboratory lab;
  lab.rig.steps = {lab.rig.steps.back()};
  Rig quiet = lab.rig;
  for (JointSettings& j : quiet.joints) j.sigma = 0;
  for (Sensor& s : quiet.sensors)
    for (double& sigma : s.sigma) sigma = 0;
  std::vector<Sample> samples = simulate(quiet, lab.table, lab.truth, lab.options).samples;
  for (Sample& s : samples)
    for (View& v : s.views) v.sigma = lab.rig.sensors[v.sensor].sigma;
  const Solution result = calibrate(lab.rig, samples);
  CHECK(result.status == Status::converged);
  CHECK(errors(result, lab.table, lab.truth).cwiseAbs().maxCoeff() < 1e-8);
}

TEST_CASE("example: the written robot and rig hold the result", "[example]") {
  // The URDF differs in the lines of changed origins only, and a calibration that starts from the
  // written files stays where it is.
  const RigFile rig_file = read_rig(kExample + "rig.yaml");
  const Report report =
      fixture::study_of(rig_file.rig, read_samples(kExample + "samples.jsonl", rig_file.rig));
  ResultOptions options;
  options.samples_hash = sha256(read_file(kExample + "samples.jsonl"));
  const ResultFiles files = make_results(rig_file, report, options);

  std::istringstream before(rig_file.urdf.text), after(files.robot_urdf);
  int changed = 0;
  for (std::string a, b; std::getline(before, a);) {
    REQUIRE(std::getline(after, b));
    if (a == b) continue;
    ++changed;
    CHECK(a.find("<origin") != std::string::npos);
    CHECK(b.find("<origin") != std::string::npos);
  }
  // head pan, 2 stereo mounts, tilt offset and laser mount, 14 arm joints, 2 forearm cameras
  CHECK(changed == 1 + 2 + 2 + 14 + 2);

  const std::string folder =
      (std::filesystem::temp_directory_path() / ("kincal_example_" + std::to_string(getpid())))
          .string();
  REQUIRE(write_results(folder, files, false, nullptr));
  const RigFile written = read_rig(folder + "/rig.yaml");
  const Report second =
      fixture::study_of(written.rig, read_samples(kExample + "samples.jsonl", written.rig));
  CHECK(second.solution.status == Status::converged);
  // Not to the last digit: the laser's mount is freed in part, and its held components (x, y, ry)
  // are now held about another pose.
  CHECK(second.solution.chi2 == Approx(report.solution.chi2).epsilon(1e-7));
  for (size_t i = 0; i < report.residuals.sensors.size(); ++i)
    CHECK(second.residuals.sensors[i].train.rms_before ==
          Approx(report.residuals.sensors[i].train.rms_as_read).epsilon(1e-4));
  std::filesystem::remove_all(folder);
}

TEST_CASE("example: freed gauges are found and named", "[example]") {
  Laboratory lab;
  const std::vector<Sample> samples = lab.samples(3);
  struct Gauge {
    std::string free;
    size_t directions;
    std::vector<std::string> named;
  };
  const std::vector<Gauge> gauges = {
      {"sensor/left_arm/pose.rx",
       1,
       {"sensor/left_arm/pose.rx", "joint/l_wrist_roll_joint/offset"}},
      {"sensor/*_arm/pose.rx", 2, {"sensor/right_arm/pose.rx", "joint/r_wrist_roll_joint/offset"}},
      {"joint/head_tilt_joint/offset",
       1,
       {"joint/head_tilt_joint/offset", "joint/narrow_stereo_frame_joint/origin.ry"}},
      {"joint/laser_tilt_mount_joint/origin.ry",
       1,
       {"joint/laser_tilt_mount_joint/origin.ry", "joint/laser_tilt_mount_joint/offset"}},
      {"sensor/forearm_right/baseline",
       1,
       {"sensor/forearm_right/baseline", "joint/r_forearm_cam_frame_joint/origin.y"}},
      {"joint/head_plate_frame_joint/origin", 6, {"joint/head_plate_frame_joint/origin.x"}}};
  for (const Gauge& g : gauges) {
    CAPTURE(g.free);
    CalibrationOptions options;
    options.free = {g.free};
    const Solution result = fixture::solution_of(lab.rig, samples, options);
    CHECK(result.status == Status::unobservable);
    CHECK(result.unobservable.size() == g.directions);
    for (const std::string& name : g.named) {
      bool found = false;
      for (const Direction& d : result.unobservable)
        for (const auto& c : d) found = found || c.first == name;
      CAPTURE(name);
      CHECK(found);
    }
  }
}

TEST_CASE("example: absent sensor poses up to 180 degrees and 1 m away are found in closed form",
          "[example][starts]") {
  // Cameras, laser and boards in the hands on sensor poses instead of mount joints; each truth at a
  // random place. The base rig knows the places, the other does not: both must end at the same
  // optimum.
  Laboratory lab;
  std::mt19937_64 random(7);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  // Everything on one true robot: its mounts are exact, so only sensor poses are unknown.
  Rig rig = lab.rig;
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    rig.tree.joints[j].parent_T_joint =
        get_pose(lab.truth, lab.table.all[lab.table.joint_origin[j]].start);
    if (!rig.tree.joints[j].has_reading()) continue;
    rig.joints[j].offset = lab.truth(lab.table.all[lab.table.joint_offset[j]].start);
    rig.joints[j].scale = lab.truth(lab.table.all[lab.table.joint_scale[j]].start);
  }
  const std::vector<Sample> samples = lab.samples(11);
  for (const std::vector<std::string>& absent :
       {std::vector<std::string>{"narrow_left"},
        {"narrow_left", "narrow_right", "wide_left", "wide_right"},
        {"tilt_laser", "forearm_left"},
        {"left_arm", "right_arm"},
        {"narrow_left", "wide_left", "left_arm", "forearm_right"}}) {
    Rig known = rig;
    Step step;
    step.name = "poses";
    for (size_t s = 0; s < rig.sensors.size(); ++s) {
      step.sensors.push_back(static_cast<int>(s));
      Sensor& sensor = known.sensors[s];
      sensor.link_T_sensor = get_pose(lab.truth, lab.table.all[lab.table.sensor_pose[s]].start);
      sensor.pose_given = true;
      if (std::find(absent.begin(), absent.end(), sensor.name) == absent.end()) continue;
      step.free.push_back("sensor/" + sensor.name + "/pose");
    }
    known.steps = {step};
    // Move each absent sensor's link frame by a random motion X, so that its true pose becomes X^-1
    // link_T_sensor.
    Rig unknown = known;
    for (const std::string& name : absent)
      for (Rig* r : {&known, &unknown})
        for (Sensor& sensor : r->sensors) {
          if (sensor.name != name) continue;
          if (r == &unknown) {
            sensor.pose_given = false;
            sensor.link_T_sensor = Pose();
          }
        }
    // The truths here are near the links; turn the links' meaning instead: a fixed joint of random
    // origin before each absent sensor.
    for (const std::string& name : absent) {
      Vector3d axis(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)),
          shift(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
      const Pose x{exp_so3(axis.normalized() * uniform(2, kPi)),
                   shift.normalized() * uniform(0.5, 1)};
      for (Rig* r : {&known, &unknown})
        for (Sensor& sensor : r->sensors) {
          if (sensor.name != name) continue;
          Joint joint;
          joint.name = "extra_" + name;
          joint.parent = sensor.link;
          joint.child = static_cast<int>(r->tree.links.size());
          joint.parent_T_joint = x;
          r->tree.links.push_back("extra_link_" + name);
          r->tree.joints.push_back(joint);
          r->joints.push_back({});
          finish_tree(r->tree);
          sensor.link = joint.child;
          if (r == &known) sensor.link_T_sensor = inverse(x) * sensor.link_T_sensor;
        }
    }
    std::vector<Sample> more = samples;
    for (Sample& s : more) s.readings.resize(known.tree.joints.size(), std::nan(""));
    const Solution a = calibrate(known, more), b = calibrate(unknown, more);
    CAPTURE(absent);
    CHECK(a.status == Status::converged);
    CHECK(b.status == Status::converged);
    CHECK(b.chi2 == Approx(a.chi2).epsilon(1e-8));
    for (size_t i = 0; i < a.parameters.size(); ++i) {
      const Vector6d apart = log_se3(inverse(*a.parameters[i].pose) * *b.parameters[i].pose);
      for (int c = 0; c < 6; ++c) CHECK(std::abs(apart(c)) < 0.01 * a.parameters[i].sigma[c]);
    }
  }
}

}  // namespace example_test
