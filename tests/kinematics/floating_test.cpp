// kinematics/floating.h: a floating joint as twelve of one degree of freedom.
//
// Proves: the pose written to the axes is the pose that comes back, at angles that are not unique
// too, and the path through them gives origin * reading * error; the error's axes are exp(d) to
// second order; indices of links and joints stay; who reads and whose noise is shared. What it does
// not prove: that calibrations with such joints are right (models/calibration/floating_test.cpp).
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "../../kinematics/floating.h"

namespace floating_test {

using namespace kincal;

namespace {

Tree base_and_flange() {
  Tree tree;
  tree.links = {"base", "tool", "finger"};
  Joint flange;
  flange.name = "flange";
  flange.type = JointType::floating;
  flange.parent = 0;
  flange.child = 1;
  flange.parent_T_joint = {rotation_from_rpy({0.1, 0.2, 0.3}), {1, 2, 3}};
  Joint finger;
  finger.name = "finger";
  finger.type = JointType::revolute;
  finger.parent = 1;
  finger.child = 2;
  finger.axis = Vector3d::UnitY();
  tree.joints = {flange, finger};
  open_floating(tree);
  return tree;
}

Pose along_path(const Tree& tree, int from, int to, const std::vector<double>& readings) {
  Pose reached;
  for (const PathStep& step : find_path(tree, from, to)) {
    const Joint& joint = tree.joints[step.joint];
    Pose a_T_joint, a_T_to;
    walk(step, joint.parent_T_joint, joint_motion(joint, readings[step.joint]), reached, a_T_joint,
         a_T_to);
    reached = a_T_to;
  }
  return reached;
}

double apart(const Pose& a, const Pose& b) {
  return std::max((a.translation - b.translation).cwiseAbs().maxCoeff(),
                  (a.rotation - b.rotation).cwiseAbs().maxCoeff());
}

}  // namespace

TEST_CASE("floating joints: a pose comes back from its axes, and the path goes through it") {
  const Tree tree = base_and_flange();
  const std::vector<Vector3d> rotations = {{0, 0, 0},
                                           {0.3, -0.8, 1.1},
                                           {0, kPi / 2, 0},  // yaw and roll about the same line
                                           {0.4, -kPi / 2, 0.9},
                                           {kPi, 0, 0},
                                           {0.1, kPi / 2 - 1e-9, -2}};
  for (const Vector3d& rpy : rotations) {
    const Pose pose = {rotation_from_rpy(rpy), {0.4, -0.2, 1.7}};
    std::vector<double> readings(tree.joints.size(), std::nan(""));
    set_pose_reading(tree, 0, pose, readings);
    CHECK(apart(pose_reading(tree, 0, readings), pose) < 1e-15);
    CHECK(apart(along_path(tree, 0, 1, readings), tree.joints[0].parent_T_joint * pose) < 2e-15);
    CHECK(apart(along_path(tree, 1, 0, readings), inverse(tree.joints[0].parent_T_joint * pose)) <
          3e-15);
  }
}

TEST_CASE("floating joints: errors are on the right of the reading, as exp(d) to second order") {
  const Tree tree = base_and_flange();
  const Pose pose = {rotation_from_rpy({0.3, -0.8, 1.1}), {0.4, -0.2, 1.7}};
  Vector6d d;
  d << 3e-4, -2e-4, 1e-4, 2e-4, -4e-4, 3e-4;
  std::vector<double> readings(tree.joints.size(), 0.0);
  set_pose_reading(tree, 0, pose, readings);
  for (int k = 0; k < 6; ++k) readings[tree.joints[0].first_axis + kPoseAxes + k] = d(k);
  CHECK(apart(pose_reading(tree, 0, readings), pose * exp_se3(d)) < d.squaredNorm());
  for (int k = 0; k < 6; ++k) {  // and each by itself exactly
    set_pose_reading(tree, 0, pose, readings);
    readings[tree.joints[0].first_axis + kPoseAxes + k] = 0.1;
    const Vector6d one = 0.1 * Vector6d::Unit(k);
    CHECK(apart(pose_reading(tree, 0, readings), pose * exp_se3(one)) < 1e-15);
  }
}

TEST_CASE("floating joints: names, indices, what reads, and whose noise is the same") {
  const Tree tree = base_and_flange();
  CHECK(tree.find_link("finger") == 2);
  CHECK(tree.find_joint("finger") == 1);
  CHECK(tree.joints.size() == 2 + 2 * kPoseAxes);
  CHECK(tree.joints[tree.joint_above[1]].name == "flange.drz");
  for (size_t j = 2; j < tree.joints.size(); ++j) {
    const int joint = static_cast<int>(j);
    CHECK(tree.joints[j].drives());
    CHECK_FALSE(tree.joints[j].has_reading());
    CHECK(read_name(tree, joint) == "flange");
    CHECK(same_noise(tree, joint).size() == (j < 2 + kPoseAxes ? 1u : 3u));
  }
  CHECK(same_noise(tree, 8) == std::vector<int>{8, 9, 10});
  CHECK(same_noise(tree, 13) == std::vector<int>{11, 12, 13});
  CHECK(same_noise(tree, 1) == std::vector<int>{1});
  CHECK(usual_range(tree.joints[8]) == std::make_pair(0.0, 0.0));
}

}  // namespace floating_test
