#include "floating.h"

#include <algorithm>

namespace kincal {
namespace {

struct Axis {
  const char* name;
  JointType type;
  int along;  // x, y or z
};
constexpr Axis kReading[kPoseAxes] = {
    {"x", JointType::prismatic, 0},    {"y", JointType::prismatic, 1},
    {"z", JointType::prismatic, 2},    {"yaw", JointType::revolute, 2},
    {"pitch", JointType::revolute, 1}, {"roll", JointType::revolute, 0}};
constexpr Axis kError[kPoseAxes] = {
    {"dx", JointType::prismatic, 0}, {"dy", JointType::prismatic, 1},
    {"dz", JointType::prismatic, 2}, {"drx", JointType::revolute, 0},
    {"dry", JointType::revolute, 1}, {"drz", JointType::revolute, 2}};

}  // namespace

void open_floating(Tree& tree) {
  const int joints = static_cast<int>(tree.joints.size());
  for (int j = 0; j < joints; ++j) {
    if (tree.joints[j].type != JointType::floating || tree.joints[j].first_axis >= 0) continue;
    const std::string name = tree.joints[j].name;
    const int child = tree.joints[j].child;
    tree.joints[j].first_axis = static_cast<int>(tree.joints.size());
    const auto new_link = [&](const std::string& of) {
      tree.links.push_back(name + "." + of);
      return static_cast<int>(tree.links.size()) - 1;
    };
    int above = tree.joints[j].child = new_link("origin");
    for (int k = 0; k < 2 * kPoseAxes; ++k) {
      const Axis& axis = k < kPoseAxes ? kReading[k] : kError[k - kPoseAxes];
      Joint joint;
      joint.name = name + "." + axis.name;
      joint.type = axis.type;
      joint.axis = Vector3d::Unit(axis.along);
      joint.parent = above;
      joint.child = above = k + 1 < 2 * kPoseAxes ? new_link(axis.name) : child;
      joint.axis_of_pose = k < kPoseAxes ? PoseAxis::reading : PoseAxis::error;
      joint.floating = j;
      tree.joints.push_back(joint);
    }
  }
  finish_tree(tree);
}

void set_pose_reading(const Tree& tree, int joint, const Pose& pose,
                      std::vector<double>& readings) {
  const Vector3d rpy = rpy_from_rotation(pose.rotation);
  double* axes = readings.data() + tree.joints[joint].first_axis;
  for (int k = 0; k < 3; ++k) {
    axes[k] = pose.translation(k);
    axes[3 + k] = rpy(2 - k);
  }
  std::fill(axes + kPoseAxes, axes + 2 * kPoseAxes, 0.0);
}

const std::string& read_name(const Tree& tree, int joint) {
  const int floating = tree.joints[joint].floating;
  return tree.joints[floating < 0 ? joint : floating].name;
}

bool is_between_axes(const Tree& tree, int link) {
  return std::any_of(tree.joints.begin(), tree.joints.end(), [&](const Joint& joint) {
    return joint.parent == link && joint.floating >= 0;
  });
}

std::vector<int> same_noise(const Tree& tree, int joint) {
  const Joint& axis = tree.joints[joint];
  if (axis.axis_of_pose != PoseAxis::error) return {joint};
  const int first = tree.joints[axis.floating].first_axis + kPoseAxes +
                    (axis.type == JointType::prismatic ? 0 : 3);
  return {first, first + 1, first + 2};
}

Pose pose_reading(const Tree& tree, int joint, const std::vector<double>& readings) {
  Pose pose;
  for (int k = 0; k < 2 * kPoseAxes; ++k) {
    const int axis = tree.joints[joint].first_axis + k;
    pose = pose * joint_motion(tree.joints[axis], readings[axis]);
  }
  return pose;
}

}  // namespace kincal
