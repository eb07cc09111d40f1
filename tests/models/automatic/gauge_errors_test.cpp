// models/automatic/gauge_errors: errors that are predicted where a gauge is fixed.
//
// Proves, on a SCARA whose axes are tilted by milliradians, a tracker and three reflectors of
// unknown pose: the length beside a tilt, which goes with the reflectors' height, is as accurate as
// is predicted, and the height itself, too (12 robots; with the gauge of parallel axes alone the
// length was off by up to 40 sigmas); where they are parallel, what is added moves no target
// relative to a sensor. Does not prove: other robots (benchmarks/healthy.py).
#include "../../../models/automatic/gauge_errors.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "../../../models/automatic/automatic.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/rigs.h"

namespace gauge_errors_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

Rig scara() {
  Rig rig;
  const Vector3d z = Vector3d::UnitZ();
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "a1", "base", "one", z, at({0, 0, 0.4}), 1e-4);
  add_joint(rig, JointType::revolute, "a2", "one", "two", z, at({0.35, 0, 0.05}), 1e-4);
  add_joint(rig, JointType::prismatic, "a3", "two", "three", z, at({0.3, 0, 0}), 2e-5);
  add_joint(rig, JointType::revolute, "a4", "three", "hand", z, at({0, 0, 0}), 1e-4);
  finish_tree(rig.tree);
  for (Joint& joint : rig.tree.joints) {
    joint.lower = joint.type == JointType::prismatic ? -0.2 : -2;
    joint.upper = joint.type == JointType::prismatic ? 0 : 2;
  }
  add_tracker(rig, "tracker", "base", at({1.9, 1, 0.5}, {0.2, 0, 2.4}), Vector3d::Constant(3e-5));
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.1, 0, 0, 0, 0.08, 0, 0, 0.03;
  add_points(rig, "reflectors", points, "hand", at({0.06, 0.02, -0.1}));
  return rig;
}

}  // namespace

TEST_CASE("gauge errors: a length beside tilted axes is as accurate as is predicted") {
  double length = 0, height = 0;  // sums of squares, in predicted sigmas
  constexpr int kRobots = 12;
  for (int seed = 0; seed < kRobots; ++seed) {
    Rig rig = scara();
    const ParameterTable table(rig);
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    VectorXd truth = table.initial;
    for (const int origin : table.joint_origin) {
      const int start = table.all[origin].start;
      Vector6d off;
      for (int c = 0; c < 6; ++c) off(c) = (c < 3 ? 3e-4 : 1.5e-3) * normal(random);
      set_pose(truth, start, get_pose(truth, start) * exp_se3(off));
    }
    SimulationOptions options;
    options.seed = seed + 1;
    options.samples = 60;
    const std::vector<Sample> samples = simulate(rig, table, truth, options).samples;
    rig.sensors[0].pose_given = rig.targets[0].pose_given = false;
    rig.sensors[0].link_T_sensor = rig.targets[0].link_T_target = Pose();
    const AutomaticCalibration found = calibrate_automatically(Recording(rig, samples), {});
    INFO(seed << ": " << found.solution.message);
    REQUIRE(found.solution.usable());
    REQUIRE(found.gauges.size() == 1);
    const Prediction& predicted = *found.solution.prediction;
    const auto error_in_sigmas = [&](const Component& c) {
      const auto at = std::find(predicted.columns.begin(), predicted.columns.end(), c) -
                      predicted.columns.begin();
      REQUIRE(at < static_cast<std::ptrdiff_t>(predicted.columns.size()));
      const int start = table.all[c.parameter].start;
      const Vector6d off =
          log_se3(inverse(get_pose(truth, start)) * get_pose(found.solution.values.shared, start));
      return off(c.index) / std::sqrt(predicted.covariance(at, at));
    };
    const double one = error_in_sigmas({table.joint_origin[1], 0}),
                 other = error_in_sigmas(found.gauges[0].fixed);
    CHECK(std::abs(one) < 4);
    length += one * one / kRobots;
    height += other * other / kRobots;
  }
  CHECK(length < 1.8);
  CHECK(length > 0.05);  // nor are predictions far too wide
  CHECK(height < 1.8);
}

TEST_CASE("gauge errors: beside parallel axes they move no target relative to a sensor") {
  Rig rig = scara();
  SimulationOptions options;
  options.samples = 60;
  const ParameterTable table(rig);
  const std::vector<Sample> samples = simulate(rig, table, table.initial, options).samples;
  rig.sensors[0].pose_given = rig.targets[0].pose_given = false;
  AutomaticOptions mounts;
  mounts.groups.without = {"lengths*", "angles*"};
  const AutomaticCalibration found = calibrate_automatically(Recording(rig, samples), mounts);
  REQUIRE(found.solution.usable());
  REQUIRE(found.gauges.size() == 1);
  const Prediction& predicted = *found.solution.prediction;
  REQUIRE(predicted.columns.back() == found.gauges[0].fixed);
  const Eigen::Index last = predicted.covariance.rows() - 1;
  CHECK(predicted.covariance(last, last) == Approx(1).epsilon(0.02));
  const VectorXd along = predicted.covariance.col(last) / predicted.covariance(last, last);
  CHECK(along.cwiseAbs().maxCoeff() == Approx(1).epsilon(0.01));  // both heights
  const MatrixXd motions = squared_motions(*found.solution.recording, found.solution.values.shared,
                                           predicted.columns, charts_of(found.solution));
  CHECK(along.dot(motions * along) < 1e-8 * motions.trace());
}

}  // namespace gauge_errors_test
