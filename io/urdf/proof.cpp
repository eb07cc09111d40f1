#include "proof.h"

#include <console_bridge/console.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <map>
#include <mutex>
#include <pugixml.hpp>
#include <stdexcept>

#include "../../models/rig/numbers.h"
#include "../../models/rig/random_stream.h"
#include "../../models/rig/words.h"

namespace kincal {
namespace {

/// Keeps urdfdom's messages instead of printing them, as long as it lives.
class Messages : public console_bridge::OutputHandler {
 public:
  Messages() { console_bridge::useOutputHandler(this); }
  ~Messages() override { console_bridge::restorePreviousOutputHandler(); }
  void log(const std::string& message, console_bridge::LogLevel level, const char*, int) override {
    if (level >= console_bridge::CONSOLE_BRIDGE_LOG_ERROR)
      text += (text.empty() ? "" : "; ") + message;
  }
  std::string text;
};

/// A joint as another reader sees it; nothing here comes from kinematics/tree.cpp.
struct WrittenJoint {
  std::string name, parent, master;  // master: empty if it mimics nothing
  JointType type = JointType::fixed;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Vector3d translation = Vector3d::Zero(), axis = Vector3d::UnitX();
  double multiplier = 1, offset = 0;
};
using Written = std::map<std::string, WrittenJoint>;  // by child link

JointType type_of(const urdf::Joint& joint) {
  switch (joint.type) {
    case urdf::Joint::REVOLUTE:
      return JointType::revolute;
    case urdf::Joint::CONTINUOUS:
      return JointType::continuous;
    case urdf::Joint::PRISMATIC:
      return JointType::prismatic;
    case urdf::Joint::FLOATING:
      return JointType::floating;
    case urdf::Joint::PLANAR:
      return JointType::planar;
    default:
      return JointType::fixed;
  }
}

Written joints_of(const urdf::ModelInterface& model) {
  Written written;
  for (const auto& entry : model.joints_) {
    const urdf::Joint& from = *entry.second;
    WrittenJoint joint;
    joint.name = from.name;
    joint.parent = from.parent_link_name;
    joint.type = type_of(from);
    const urdf::Pose& pose = from.parent_to_joint_origin_transform;
    joint.rotation =
        Eigen::Quaterniond(pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z);
    joint.translation = {pose.position.x, pose.position.y, pose.position.z};
    joint.axis = Vector3d(from.axis.x, from.axis.y, from.axis.z).stableNormalized();
    if (from.mimic) {
      joint.master = from.mimic->joint_name;
      joint.multiplier = from.mimic->multiplier;
      joint.offset = from.mimic->offset;
    }
    written[from.child_link_name] = joint;
  }
  return written;
}

Written joints_of(const Tree& tree) {
  Written written;
  for (const Joint& from : tree.joints) {
    WrittenJoint joint;
    joint.name = from.name;
    joint.parent = tree.links[from.parent];
    joint.type = from.type;
    joint.rotation = Eigen::Quaterniond(from.parent_T_joint.rotation);
    joint.translation = from.parent_T_joint.translation;
    joint.axis = from.axis;
    if (from.mimic) {
      joint.master = tree.joints[from.mimic->master].name;
      joint.multiplier = from.mimic->multiplier;
      joint.offset = from.mimic->offset;
    }
    written[tree.links[from.child]] = joint;
  }
  return written;
}

/// Removes the children of an element but for some.
void keep_children(pugi::xml_node element, std::initializer_list<const char*> names) {
  for (pugi::xml_node child = element.first_child(), next; child; child = next) {
    next = child.next_sibling();
    if (std::none_of(names.begin(), names.end(),
                     [&](const char* name) { return std::strcmp(child.name(), name) == 0; }))
      element.remove_child(child);
  }
}

/// A URDF without what no pose depends on, as shapes and masses of links: urdfdom takes four fifths
/// of its time for these numbers. What is no XML stays.
std::string without_shapes(const std::string& text) {
  pugi::xml_document document;
  if (!document.load_buffer(text.data(), text.size(), pugi::parse_default, pugi::encoding_utf8))
    return text;
  const pugi::xml_node robot = document.document_element();
  keep_children(robot, {"link", "joint"});
  for (const pugi::xml_node link : robot.children("link")) keep_children(link, {});
  for (const pugi::xml_node joint : robot.children("joint"))
    keep_children(joint, {"origin", "parent", "child", "axis", "limit", "mimic"});
  struct Text : pugi::xml_writer {
    void write(const void* data, size_t size) override {
      text.append(static_cast<const char*>(data), size);
    }
    std::string text;
  } out;
  document.save(out, "", pugi::format_raw, pugi::encoding_utf8);
  return out.text;
}

/// The written text as urdfdom reads it, or as we do where urdfdom takes exception to what stood in
/// the input already.
Written read_written(const std::string& text, const Urdf& input) {
  static std::mutex one_at_a_time;  // who gets urdfdom's messages is a global of its library
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  Messages messages;
  if (const auto model = urdf::parseURDF(without_shapes(text))) return joints_of(*model);
  const std::string why = messages.text;
  if (urdf::parseURDF(without_shapes(input.text)))
    throw std::runtime_error(input.path + ": the written URDF is refused by urdfdom: " + why);
  return joints_of(parse_urdf(text, input.path + " (written)").tree);
}

/// The written robot, each joint beside the same joint of the input. Parents and masters are
/// checked.
class WrittenRobot {
 public:
  WrittenRobot(const Written& written, const Tree& tree)
      : tree_(tree), joints_(tree.joints.size()) {
    if (written.size() != tree.joints.size()) fail("another number of joints");
    for (size_t j = 0; j < joints_.size(); ++j) {
      const Joint& joint = tree.joints[j];
      const auto it = written.find(tree.links[joint.child]);
      if (it == written.end() || it->second.name != joint.name ||
          it->second.parent != tree.links[joint.parent] || it->second.type != joint.type)
        fail("another joint in place of '" + joint.name + "'");
      joints_[j] = it->second;
      if (joint.has_axis() &&
          joints_[j].master != (joint.mimic ? tree.joints[joint.mimic->master].name : ""))
        fail("another mimic in joint '" + joint.name + "'");
    }
    std::vector<int> links = {tree.root};
    for (size_t i = 0; i < links.size(); ++i)
      for (size_t j = 0; j < joints_.size(); ++j)
        if (tree.joints[j].parent == links[i]) {
          outwards_.push_back(static_cast<int>(j));
          links.push_back(tree.joints[j].child);
        }
  }

  /// root_T_link of all links for readings of all joints; followers and joints that do not move
  /// have none.
  std::vector<Eigen::Isometry3d> poses(const std::vector<double>& readings) const {
    std::vector<Eigen::Isometry3d> root_T_link(tree_.links.size(), Eigen::Isometry3d::Identity());
    for (const int j : outwards_)
      root_T_link[tree_.joints[j].child] =
          root_T_link[tree_.joints[j].parent] * parent_T_child(j, readings);
    return root_T_link;
  }

 private:
  double position(int j, const std::vector<double>& readings) const {
    if (!tree_.joints[j].has_axis()) return 0;
    if (!tree_.joints[j].mimic) return readings[j];
    return joints_[j].multiplier * position(tree_.joints[j].mimic->master, readings) +
           joints_[j].offset;
  }

  Eigen::Isometry3d parent_T_child(int j, const std::vector<double>& readings) const {
    const WrittenJoint& joint = joints_[j];
    Eigen::Isometry3d pose = Eigen::Translation3d(joint.translation) * joint.rotation;
    if (joint.type == JointType::prismatic)
      pose = pose * Eigen::Translation3d(position(j, readings) * joint.axis);
    else if (joint.type == JointType::revolute || joint.type == JointType::continuous)
      pose = pose * Eigen::AngleAxisd(position(j, readings), joint.axis);
    return pose;
  }

  [[noreturn]] static void fail(const std::string& what) {
    throw std::runtime_error("the written URDF has " + what);
  }

  const Tree& tree_;
  std::vector<WrittenJoint> joints_;  // as in the tree
  std::vector<int> outwards_;         // joints, from the root on
};

/// Uniform in the joint's limits; +-pi without limits, or where they span turns upon turns (1e16
/// occurs: all digits would be lost).
double random_reading(const Joint& joint, RandomStream& draws) {
  const bool usable = joint.lower < joint.upper && joint.lower > -4 * kPi && joint.upper < 4 * kPi;
  return usable ? draws.uniform(joint.lower, joint.upper) : draws.uniform(-kPi, kPi);
}

/// How far two poses are apart.
struct Difference {
  double metres, radians;
  double from_base;       // m: what is far away is known to fewer digits
  bool matters() const {  // NaN matters
    return !(metres <= 1e-9 + 1e-12 * from_base && radians <= 1e-9);
  }
};

Difference difference(const Pose& a, const Eigen::Isometry3d& b) {
  const Matrix3d r = a.rotation.transpose() * b.linear();
  const Vector3d twice_sine(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  return {(a.translation - b.translation()).norm(), std::atan2(twice_sine.norm(), r.trace() - 1),
          a.translation.norm()};
}

}  // namespace

void prove_urdf(const std::string& text, const Urdf& input, const std::vector<Pose>& origins,
                const std::vector<double>& offsets, int postures) {
  const Tree& tree = input.tree;
  const WrittenRobot written(read_written(text, input), tree);
  RandomStream draws(20240229);
  std::vector<double> readings(tree.joints.size(), 0), positions(tree.joints.size(), 0);
  for (int posture = 0; posture < postures; ++posture) {
    for (size_t j = 0; j < tree.joints.size(); ++j) {
      const bool reads = tree.joints[j].has_reading();
      readings[j] = reads ? random_reading(tree.joints[j], draws) : 0;
      positions[j] = reads ? readings[j] + offsets[j] : 0;
    }
    follow_mimics(tree, positions);
    const std::vector<Pose> poses = link_poses(tree, origins, positions);
    const std::vector<Eigen::Isometry3d> are = written.poses(readings);
    const auto compare = [&](int link) { return difference(poses[link], are[link]); };
    for (size_t l = 0; l < tree.links.size(); ++l) {
      int link = static_cast<int>(l);
      if (!compare(link).matters()) continue;
      for (int j; (j = tree.joint_above[link]) >= 0 && compare(tree.joints[j].parent).matters();)
        link = tree.joints[j].parent;
      const Difference d = compare(link);
      throw std::runtime_error("the written URDF does not describe the calibrated robot: link '" +
                               tree.links[link] + "' is off by " +
                               kincal::text("%.3g m and %.3g rad", d.metres, d.radians));
    }
  }
}

}  // namespace kincal
