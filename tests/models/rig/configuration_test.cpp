// models/rig/configuration.h: where everything is, at given values and readings.
//
// Proves, on the nasty robot at values that are not the rig's: positions (mimics, chains of them,
// what follows a fixed joint, a joint with a bend), origins, motions, poses of all links in each
// other, of sensors and of mounted targets equal those of the fixture's independent forward model;
// with() is another reading of that joint alone, for a scanning one too; the joints that are named
// as needed are those whose readings move something there, found by moving each. Does not prove:
// derivatives (models/estimation, models/analysis/frames), nor that models/joints are right
// (joint_model_test.cpp).
#include "../../../models/rig/configuration.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "../../fixtures/forward_model.h"
#include "../../fixtures/quadratic_joint.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/transforms.h"

namespace configuration_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

double difference(const Pose& a, const Isometry3d& b) {
  return (isometry(a).matrix() - b.matrix()).cwiseAbs().maxCoeff();
}

/// A rig, the values of another one, and a posture; `other` and `posture` are the forward model's.
struct Scene {
  Rig rig, other;
  ParameterTable table{rig};
  VectorXd values;
  TruePosture posture;

  explicit Scene(unsigned long seed, const Rig& robot = nasty_robot()) : rig(robot) {
    Random random(seed);
    other = moved(rig, {"*"}, random, 0.05, 0.3, 1, 0.05);
    for (Rig* r : {&rig, &other}) bend_joint(*r, "elbow", 0.07);
    table = ParameterTable(rig);
    values = ParameterTable(other).initial;
    posture = random_posture(rig, random, 2, false);
    posture.bends[joint_index(rig, "elbow")] = 0.07;
    for (size_t t = 0; t < rig.targets.size(); ++t)
      posture.boards[static_cast<int>(t)] = isometry(random.pose(1, 3));
  }
  Configuration robot() const { return {rig, table, values, posture.readings}; }
  Isometry3d a_T_b(int a, int b, const TruePosture& p) const {
    return root_T_link(other, a, p).inverse() * root_T_link(other, b, p);
  }
  /// Joints with a reading that, moved by itself, changes `what`.
  template <class Function>
  std::vector<int> moving(const Function& what) const {
    std::vector<int> out;
    for (size_t j = 0; j < rig.joints.size(); ++j) {
      if (!rig.tree.joints[j].has_reading()) continue;
      TruePosture p = posture;
      p.readings[j] += 0.3;
      if (!what(p).isApprox(what(posture), 1e-9)) out.push_back(static_cast<int>(j));
    }
    return out;
  }
};

std::vector<int> sorted(std::vector<int> v) {
  std::sort(v.begin(), v.end());
  return v;
}

}  // namespace

TEST_CASE("configuration: positions, origins, motions and poses equal the independent model's") {
  for (unsigned long seed = 1; seed <= 6; ++seed) {
    const Scene s(seed, seed <= 4 ? nasty_robot() : standing_robot());
    const Configuration robot = s.robot();
    for (size_t j = 0; j < s.rig.joints.size(); ++j) {
      const Joint& joint = s.rig.tree.joints[j];
      const int index = static_cast<int>(j);
      INFO(joint.name);
      CHECK(robot.position(index) == Approx(position(s.other, index, s.posture)).margin(1e-15));
      CHECK(difference(robot.origin(index), isometry(s.other.tree.joints[j].parent_T_joint)) <
            1e-15);
      CHECK(difference(robot.origin(index) * robot.motion(index),
                       s.a_T_b(joint.parent, joint.child, s.posture)) < 1e-12);
      if (!joint.has_reading()) continue;
      CHECK(robot.reading(index) == s.posture.readings[j]);
      CHECK(robot.own_numbers(index)[0] == s.other.joints[j].offset);
      CHECK(robot.own_numbers(index)[1] == s.other.joints[j].scale);
      if (joint.name == "elbow") CHECK(robot.own_numbers(index)[2] == 0.07);
    }
    const int links = static_cast<int>(s.rig.tree.links.size());
    double worst = 0;
    for (int a = 0; a < links; ++a)
      for (int b = 0; b < links; ++b)
        worst = std::max(worst, difference(robot.a_T_b(a, b), s.a_T_b(a, b, s.posture)));
    CHECK(worst < 1e-12);
    const Isometry3d base = root_T_link(s.other, s.rig.base, s.posture).inverse();
    for (int l = 0; l < links; ++l)
      CHECK(difference(robot.base_T_link(l), s.a_T_b(s.rig.base, l, s.posture)) < 1e-12);
    for (const int sensor : all_sensors(s.rig)) {
      CHECK(difference(robot.link_T_sensor(sensor),
                       isometry(s.other.sensors[sensor].link_T_sensor)) < 1e-15);
      CHECK(difference(robot.base_T_sensor(sensor),
                       base * root_T_sensor(s.other, sensor, s.posture)) < 1e-12);
    }
    for (const char* target : {"wall", "marks"}) {
      const int t = target_index(s.rig, target);
      CHECK(difference(robot.base_T_target(t), base * root_T_target(s.other, t, s.posture)) <
            1e-12);
    }
  }
}

TEST_CASE(
    "configuration: another reading of one joint, of a scanning one as well, and nothing else") {
  const Scene s(11);
  const Configuration robot = s.robot();
  for (const char* name : {"elbow", "scan", "pan", "lift"}) {
    const int joint = joint_index(s.rig, name);
    TruePosture turned = s.posture;
    turned.readings[joint] = 0.77;
    const Configuration other = robot.with(joint, 0.77);
    INFO(name);
    CHECK(other.reading(joint) == 0.77);
    CHECK(robot.reading(joint) == s.posture.readings[joint]);
    for (size_t l = 0; l < s.rig.tree.links.size(); ++l)
      CHECK(difference(other.base_T_link(static_cast<int>(l)),
                       s.a_T_b(s.rig.base, static_cast<int>(l), turned)) < 1e-12);
  }
  const int laser = sensor_index(s.rig, "laser"), scan = s.rig.sensors[laser].scanning_joint;
  const TruePosture ray = at_ray(s.other, laser, s.posture, -0.4);
  CHECK(difference(robot.with(scan, -0.4).base_T_sensor(laser),
                   root_T_link(s.other, s.rig.base, ray).inverse() *
                       root_T_sensor(s.other, laser, ray)) < 1e-12);
}

TEST_CASE("configuration: needed readings are those that move something") {
  const Scene s(21, GENERATE(false, true) ? standing_robot() : nasty_robot());
  const int links = static_cast<int>(s.rig.tree.links.size());
  for (int a = 0; a < links; ++a)
    for (int b = 0; b < links; ++b) {
      INFO(s.rig.tree.links[a] << " to " << s.rig.tree.links[b]);
      const std::vector<int> moving =
          s.moving([&](const TruePosture& p) { return s.a_T_b(a, b, p); });
      CHECK(sorted(joints_between(s.rig, a, b)) == moving);
      for (const int except : moving) {
        std::vector<int> rest = moving;
        rest.erase(std::find(rest.begin(), rest.end(), except));
        CHECK(sorted(joints_between(s.rig, a, b, except)) == rest);
      }
      if (a != s.rig.base) continue;
      // Exactly these readings may not be absent.
      for (size_t j = 0; j < s.rig.joints.size(); ++j) {
        std::vector<double> readings = s.posture.readings;
        readings[j] = std::nan("");
        const bool needed = std::count(moving.begin(), moving.end(), static_cast<int>(j)) > 0;
        CHECK(has_readings(s.rig, b, readings) == !needed);
        const Pose pose = Configuration(s.rig, s.table, s.values, readings).base_T_link(b);
        CHECK((pose.rotation.allFinite() && pose.translation.allFinite()) == !needed);
      }
    }
  // In the order of the path; a follower counts as the joint that it follows, once.
  const auto joints = [&](const std::vector<const char*>& names) {
    std::vector<int> out;
    for (const char* name : names) out.push_back(joint_index(s.rig, name));
    return out;
  };
  if (s.rig.tree.joints[joint_index(s.rig, "tilt")].has_reading())
    CHECK(joints_between(s.rig, link_index(s.rig, "head"), link_index(s.rig, "nail")) ==
          joints({"tilt", "pan", "shoulder", "elbow", "slide"}));

  const Isometry3d nowhere = Isometry3d::Identity();
  for (const int sensor : all_sensors(s.rig))
    for (size_t t = 0; t < s.rig.targets.size(); ++t) {
      const int target = static_cast<int>(t);
      const bool mounted = s.rig.targets[t].link >= 0;
      INFO(s.rig.sensors[sensor].name << ", " << s.rig.targets[t].name);
      View view;
      view.sensor = sensor;
      view.target = target;
      CHECK(sorted(joints_between(s.rig, view)) == s.moving([&](const TruePosture& p) {
        return sensor_T_target(s.other, sensor, target, p);
      }));
      // Relative to the base: the sensor at a reading of its own scanning joint, the target if it
      // is mounted.
      const auto to_base = [&](const TruePosture& p) {
        return root_T_link(s.other, s.rig.base, p).inverse();
      };
      std::vector<int> needed = s.moving([&](const TruePosture& p) {
        const bool scans = s.rig.sensors[sensor].scanning_joint >= 0;
        const TruePosture still = scans ? at_ray(s.other, sensor, p, 0.1) : p;
        return to_base(still) * root_T_sensor(s.other, sensor, still);
      });
      for (const int j : s.moving([&](const TruePosture& p) {
             return mounted ? to_base(p) * root_T_target(s.other, target, p) : nowhere;
           }))
        if (!std::count(needed.begin(), needed.end(), j)) needed.push_back(j);
      CHECK(sorted(needed_readings(s.rig, sensor, target)) == sorted(needed));
      CHECK(needed_readings(s.rig, -1, -1).empty());
    }
}

TEST_CASE("configuration: nothing goes through a floating joint") {
  Rig rig = nasty_robot();
  add_joint(rig, JointType::floating, "float", "torso", "away", {0, 0, 1}, at({1, 0, 0}));
  finish_tree(rig.tree);
  const ParameterTable table(rig);
  const std::vector<double> readings(rig.joints.size(), 0.1);
  CHECK_THROWS_AS(
      Configuration(rig, table, table.initial, readings).base_T_link(link_index(rig, "away")),
      std::invalid_argument);
  CHECK_THROWS_AS(joints_between(rig, rig.base, link_index(rig, "away")), std::invalid_argument);
}

}  // namespace configuration_test
