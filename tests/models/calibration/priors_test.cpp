// Calibrations with priors: gauges that they hold, and chi2 of the data alone.
//
// Proves: an arm whose ends are gauges (first joint against the tracker's pose, last one against
// the target's) converges where the offsets have priors, from far narrower than the data to far
// wider, with the priors' sigmas along the gauges and estimates at the priors' centres, wherever
// the step begins; without priors on them the gauges are found. chi2_data / dof_data has the mean 1
// where many numbers have wide priors and the noise is as stated; without priors it is chi2 / dof;
// a repeated solve() has both anew. Does not prove: the algebra (solver/held_gauges_test.cpp).
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "../../../models/calibration/calibration.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"
#include "../../fixtures/transforms.h"

namespace priors_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// base -a(z)- b(y)- c(y)- d(z), with three points on the last link; a tracker on the base.
Rig tracked_arm(double sigma, double joint_sigma = 0) {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "a", "base", "la", {0, 0, 1}, at({0, 0, 0.2}), joint_sigma);
  add_joint(rig, JointType::revolute, "b", "la", "lb", {0, 1, 0}, at({0.05, 0, 0.2}), joint_sigma);
  add_joint(rig, JointType::revolute, "c", "lb", "lc", {0, 1, 0}, at({0, 0, 0.4}), joint_sigma);
  add_joint(rig, JointType::revolute, "d", "lc", "ld", {0, 0, 1}, at({0.05, 0, 0.3}), joint_sigma);
  finish_tree(rig.tree);
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.05, 0, 0, 0, 0.05, 0, 0, 0.02;
  add_points(rig, "ball", points, "ld", at({0.1, 0.02, 0.1}));
  add_tracker(rig, "tracker", "base", Pose(), {sigma, sigma, sigma});
  return rig;
}

std::vector<Sample> tracked_samples(const Rig& truth, int count, unsigned long seed) {
  Random random(seed);
  std::vector<Sample> out;
  for (int k = 0; k < count; ++k) {
    const TruePosture p = random_posture(truth, random, 1.2, true);
    out.push_back(make_sample(truth, p, "s" + std::to_string(k)));
    add_view(out.back(), truth, 0, 0, p, &random);
  }
  return out;
}

Step step_of(const std::vector<std::string>& free, const std::vector<PriorSetting>& priors) {
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = free;
  step.priors = priors;
  return step;
}
PriorSetting prior(const std::string& name, double translation, double rotation) {
  return {name, translation, rotation, translation != rotation, name};
}

const std::vector<std::string> kEnds = {"joint/*/offset", "target/ball/pose",
                                        "sensor/tracker/pose"};

}  // namespace

TEST_CASE("priors: gauges of an arm that priors hold are determined, as well as they say") {
  for (const double sigma : {1e-3, 1e-5})
    for (const double width : {1e-6, 1e-4, 0.05, 1.0, 10.0}) {
      INFO("tracker " << sigma << ", prior " << width);
      Rig rig = tracked_arm(sigma);
      const std::vector<Sample> samples = tracked_samples(rig, 60, 3);
      rig.steps = {step_of(kEnds, {prior("joint/*/offset", width, width)})};
      const Solution one = solution_of(rig, samples);
      REQUIRE(one.status == Status::converged);
      CHECK(one.unobservable.empty());
      // From elsewhere: where the tracker and the points are turned, a first step without priors
      // gives that to the offsets.
      Rig turned = rig;
      turned.sensors[0].link_T_sensor = at({0, 0, 0}, {0, 0, -0.03});
      turned.targets[0].link_T_target = at({0.1, 0.02, 0.1}, {0, 0, -0.03});
      Step first = step_of({"joint/a/offset", "joint/d/offset"}, {});
      first.name = "first";
      turned.steps.insert(turned.steps.begin(), first);
      const Solution two = solution_of(turned, samples);
      REQUIRE(two.status == Status::converged);
      for (const Solution* s : {&one, &two})
        for (const char* end : {"joint/a/offset", "joint/d/offset"}) {
          CHECK((*s)[end].sigma[0] == Approx(width).epsilon(1e-4));
          CHECK(std::abs((*s)[end].value[0]) < 1e-3 * width);
        }
    }
  Rig rig = tracked_arm(1e-4);
  rig.steps = {step_of(kEnds, {prior("joint/a/offset", 0.05, 0.05)})};
  const Solution held = solution_of(rig, tracked_samples(rig, 60, 3));
  CHECK(held.status == Status::unobservable);
  REQUIRE(held.unobservable.size() == 1);
  CHECK(held["joint/a/offset"].sigma[0] == Approx(0.05).epsilon(1e-4));
  CHECK(std::isnan(held["joint/d/offset"].sigma[0]));
}

TEST_CASE("priors: chi2 of the data alone has the mean that its degrees of freedom say") {
  // 33 numbers with wide priors, of which the data tell some, and few samples.
  const std::vector<std::string> free = {"joint/*/offset", "joint/*/origin", "target/ball/pose",
                                         "sensor/tracker/pose"};
  for (const double joint_sigma : {0.0, 1e-3}) {
    INFO("joints " << joint_sigma);
    double data = 0, data_dof = 0, all = 0, all_dof = 0;
    for (unsigned long seed = 1; seed <= 60; ++seed) {
      Rig rig = tracked_arm(2e-4, joint_sigma);
      const std::vector<Sample> samples = tracked_samples(rig, 6, seed);
      rig.steps = {step_of(
          free, {prior("joint/*/offset", 0.05, 0.05), prior("joint/*/origin", 0.01, 0.02)})};
      const Solution s = solution_of(rig, samples);
      REQUIRE(s.status == Status::converged);
      CHECK(s.chi2_data < s.chi2);
      CHECK(s.steps.back().chi2_data == s.chi2_data);
      data += s.chi2_data;
      data_dof += s.dof_data;
      all += s.chi2;
      all_dof += static_cast<double>(s.dof);
    }
    CHECK(data_dof > 500);
    CHECK(data / data_dof == Approx(1).margin(4 * std::sqrt(2 / data_dof)));
    CHECK(all / all_dof < 0.8);
  }
  Rig rig = tracked_arm(2e-4, 1e-3);
  rig.steps = {step_of({"joint/*/offset", "sensor/tracker/pose.x"}, {})};
  const Solution bare = solution_of(rig, tracked_samples(rig, 20, 1));
  REQUIRE(bare.status == Status::converged);
  CHECK(bare.chi2_data == bare.chi2);
  CHECK(bare.dof_data == static_cast<double>(bare.dof));
  CHECK(bare.chi2_per_dof() == bare.chi2 / static_cast<double>(bare.dof));
}

TEST_CASE("priors: a repeated solve has chi2 of the data anew") {
  Rig rig = tracked_arm(2e-4, 1e-3);
  rig.steps = {step_of(kEnds, {prior("joint/*/offset", 0.01, 0.01)})};
  const std::vector<Sample> first = tracked_samples(rig, 20, 1),
                            second = tracked_samples(rig, 20, 2);
  Calibration calibration(make_recording(rig, first), {});
  calibration.solve();
  for (int i = 0; i < 20; ++i) calibration.replace(i, second[i]);
  calibration.solve();
  const Solution& again = calibration.last();
  const Solution fresh = solution_of(rig, second);
  CHECK(again.chi2_data == Approx(fresh.chi2_data).epsilon(1e-6));
  CHECK(again.dof_data == Approx(fresh.dof_data).epsilon(1e-6));
}

}  // namespace priors_test
