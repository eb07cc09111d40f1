#include "mount_texts.h"

#include <algorithm>
#include <cctype>

#include "../document/numbers.h"

namespace kincal {
namespace {

/// A name that none of `taken` has.
template <class Taken>
std::string free_name(const std::string& name, const Taken& taken) {
  std::string out = name;
  for (int i = 2; taken(out); ++i) out = name + "_" + std::to_string(i);
  return out;
}

}  // namespace

std::string xml_text(const std::string& text) {
  std::string out;
  for (const char c : text)
    out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '"' ? "&quot;" : std::string(1, c);
  return out;
}

std::string fixed_joint_text(const std::string& joint, const std::string& parent,
                             const std::string& child, const std::string& xyz,
                             const std::string& rpy) {
  return "<joint name=\"" + xml_text(joint) + "\" type=\"fixed\"><parent link=\"" +
         xml_text(parent) + "\"/><child link=\"" + xml_text(child) + "\"/><origin xyz=\"" + xyz +
         "\" rpy=\"" + rpy + "\"/></joint>";
}

std::string xacro_name(const std::string& name) {
  std::string out = name;
  for (char& c : out)
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  return out.empty() || std::isdigit(static_cast<unsigned char>(out[0])) ? "_" + out : out;
}

std::string xacro_origin(const std::string& name, const Pose& pose) {
  return "<xacro:property name=\"" + name + "_xyz\" value=\"" + shortest(pose.translation) +
         "\"/>\n<xacro:property name=\"" + name + "_rpy\" value=\"" +
         shortest(Vector3d(rpy_from_rotation(pose.rotation))) + "\"/>\n";
}

std::string shell_word(const std::string& text) {
  const auto plain = [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-' || c == '.' || c == '/';
  };
  if (!text.empty() && std::all_of(text.begin(), text.end(), plain)) return text;
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? "'\\''" : std::string(1, c);
  return out + "'";
}

std::string new_link_name(const Tree& tree, const std::string& owner,
                          const std::vector<std::string>& taken) {
  return free_name(owner, [&](const std::string& name) {
    return tree.find_link(name) >= 0 || std::count(taken.begin(), taken.end(), name) > 0;
  });
}

std::string new_joint_name(const Tree& tree, const std::string& name) {
  return free_name(name, [&](const std::string& n) { return tree.find_joint(n) >= 0; });
}

std::string ros1_static_transform(const Pose& parent_T_child, const std::string& parent,
                                  const std::string& child) {
  const Eigen::Vector4d q = quaternion_from_rotation(parent_T_child.rotation);
  return "rosrun tf2_ros static_transform_publisher " + shortest(parent_T_child.translation) + " " +
         shortest(q[0]) + " " + shortest(q[1]) + " " + shortest(q[2]) + " " + shortest(q[3]) + " " +
         shell_word(parent) + " " + shell_word(child);
}

std::string ros2_static_transform(const Pose& parent_T_child, const std::string& parent,
                                  const std::string& child) {
  const Vector3d& t = parent_T_child.translation;
  const Eigen::Vector4d q = quaternion_from_rotation(parent_T_child.rotation);
  return "ros2 run tf2_ros static_transform_publisher --x " + shortest(t.x()) + " --y " +
         shortest(t.y()) + " --z " + shortest(t.z()) + " --qx " + shortest(q[0]) + " --qy " +
         shortest(q[1]) + " --qz " + shortest(q[2]) + " --qw " + shortest(q[3]) + " --frame-id " +
         shell_word(parent) + " --child-frame-id " + shell_word(child);
}

std::vector<MountText> mount_texts(const Solution& solution) {
  const Rig& rig = solution.rig();
  const Tree& tree = rig.tree;
  std::vector<MountText> out;
  std::vector<std::string> links;  // that the texts name
  for (const ParameterEstimate& e : solution.parameters) {
    const Parameter& p = solution.table().all[e.parameter];
    const bool sensor = p.kind == ParameterKind::sensor_pose;
    if (!e.pose || (!sensor && p.kind != ParameterKind::target_pose)) continue;
    const std::string& owner = sensor ? rig.sensors[p.owner].name : rig.targets[p.owner].name;
    const std::string& parent =
        tree.links[sensor ? rig.sensors[p.owner].link : rig.targets[p.owner].link];
    const std::string link = new_link_name(tree, owner, links);
    links.push_back(link);
    MountText text{(sensor ? "sensor/" : "target/") + owner, "", ""};
    text.urdf = "<link name=\"" + xml_text(link) + "\"/>\n" +
                fixed_joint_text(new_joint_name(tree, link + "_mount"), parent, link,
                                 shortest(e.pose->translation),
                                 shortest(Vector3d(rpy_from_rotation(e.pose->rotation))));
    text.ros2 = ros2_static_transform(*e.pose, parent, link);
    out.push_back(std::move(text));
  }
  return out;
}

}  // namespace kincal
