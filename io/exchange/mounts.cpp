#include "mounts.h"

#include <algorithm>
#include <cctype>

#include "../document/error.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../results/csv.h"
#include "../results/mount_texts.h"
#include "../rig/types.h"

namespace kincal {
namespace {

/// What sensors and targets have in common of this.
template <class T>
Mount mount_of(const Rig& rig, const T& thing, const Pose& pose, const Names& taken, bool frames) {
  const Tree& tree = rig.tree;
  if (thing.mount_joint >= 0) {
    const Joint& joint = tree.joints[thing.mount_joint];
    if (frames)
      return {thing.name, tree.links[joint.parent], thing.name, "",
              *fixed_pose(tree, joint.parent, thing.link) * pose};
    return {thing.name, tree.links[joint.parent], tree.links[joint.child],
            joint.name, joint.parent_T_joint,     true,
            false};
  }
  const std::string child = new_link_name(tree, thing.name, taken);
  return {thing.name, tree.links[thing.link], child, new_joint_name(tree, child + "_mount"), pose};
}

/// The link of an option. @throws InputError
int link_of(const Tree& tree, const std::string& name, const std::string& option) {
  const int link = tree.find_link(name);
  if (link < 0)
    throw InputError(option + ": the robot has no link '" + name + "'" +
                     nearest_or_all(name, tree.links, "the robot has"));
  return link;
}

bool is_below(const Tree& tree, int link, int above) {
  while (link != above && tree.joint_above[link] >= 0)
    link = tree.joints[tree.joint_above[link]].parent;
  return link == above;
}

/// A pose of 6 or 7 numbers; none if the text is something else.
std::optional<Pose> pose_of_numbers(std::string text) {
  for (char& c : text)
    if (c == ',' || std::isspace(static_cast<unsigned char>(c))) c = ' ';
  std::vector<double> n;
  for (size_t i = 0; i < text.size();) {
    const size_t begin = text.find_first_not_of(' ', i), end = text.find(' ', begin);
    if (begin == std::string::npos) break;
    double value = 0;
    if (!read_number(text.substr(begin, end - begin), value)) return std::nullopt;
    n.push_back(value);
    i = end == std::string::npos ? text.size() : end;
  }
  if (n.size() == 6) return Pose{rotation_from_rpy({n[3], n[4], n[5]}), {n[0], n[1], n[2]}};
  if (n.size() != 7) return std::nullopt;
  const Eigen::Vector4d q(n[3], n[4], n[5], n[6]);
  if (std::abs(q.norm() - 1) > 1e-3)
    throw InputError("--known: qx qy qz qw is of length " + shortest(q.norm()) +
                     "; a quaternion of length 1 is expected");
  return Pose{rotation_from_quaternion(q), {n[0], n[1], n[2]}};
}

/// child_T_sensor, as the driver of the sensor has it.
Pose known_pose(const Rig& rig, const Sensor& sensor, const std::string& child,
                const std::string& known) {
  const Tree& tree = rig.tree;
  if (const std::optional<Pose> given = pose_of_numbers(known)) return *given;
  const int above = tree.find_link(child);
  if (above < 0)
    throw InputError("--child: '" + child +
                     "' is not a link of the robot: give the pose of the sensor's frame in it by "
                     "--known \"x y z roll pitch yaw\" (m, rad), as its driver publishes it" +
                     nearest_names(child, tree.links));
  if (known.empty() && !is_below(tree, sensor.link, above))
    throw InputError("--child: link '" + tree.links[sensor.link] + "' of sensors." + sensor.name +
                     " does not hang on '" + child +
                     "': name by --known the link that is the sensor's frame, or give its pose, "
                     "\"x y z roll pitch yaw\" (m, rad)");
  const int frame = known.empty() ? sensor.link : link_of(tree, known, "--known");
  const std::optional<Pose> pose = fixed_pose(tree, above, frame);
  if (!pose) throw InputError("--known: '" + tree.links[frame] + "' moves against '" + child + "'");
  return *pose;
}

std::string comment(std::string text) {
  for (size_t i; (i = text.find("--")) != std::string::npos;) text.insert(i + 1, " ");
  return "<!-- " + text + " -->\n";
}

/// What is said before a mount.
std::string head_of(const Mount& m) {
  return m.of + (m.in_robot   ? ": in robot.urdf already"
                 : m.new_link ? ""
                              : ": in place of the robot's joint '" + m.joint + "'");
}

std::string transforms_text(const Mount& m) {
  return "# " + m.of +
         (m.in_robot ? ": in robot.urdf, whose robot_state_publisher already publishes it" : "") +
         "\n" + ros2_static_transform(m.parent_T_child, m.parent, m.child) +
         "\n# ROS 1: " + ros1_static_transform(m.parent_T_child, m.parent, m.child) + "\n";
}

std::string joint_text(const Mount& m, const std::string& xyz, const std::string& rpy) {
  return (m.new_link ? "<link name=\"" + xml_text(m.child) + "\"/>\n" : "") +
         fixed_joint_text(m.joint, m.parent, m.child, xyz, rpy) + "\n";
}

std::string urdf_text(const Mount& m) {
  return comment(head_of(m)) +
         joint_text(m, shortest(m.parent_T_child.translation),
                    shortest(Vector3d(rpy_from_rotation(m.parent_T_child.rotation))));
}

std::string xacro_text(const Mount& m) {
  const std::string name = xacro_name(m.child);
  return comment(head_of(m)) + xacro_origin(name, m.parent_T_child) +
         joint_text(m, "${" + name + "_xyz}", "${" + name + "_rpy}");
}

}  // namespace

std::optional<Pose> fixed_pose(const Tree& tree, int a, int b) {
  const auto from_root = [&](int link, std::vector<int>& joints) {
    for (int j = tree.joint_above[link]; j >= 0; j = tree.joint_above[tree.joints[j].parent])
      joints.push_back(j);
  };
  std::vector<int> up, down;
  from_root(a, up);
  from_root(b, down);
  while (!up.empty() && !down.empty() && up.back() == down.back()) up.pop_back(), down.pop_back();
  Pose a_T_top, b_T_top;
  for (const auto& [joints, pose] : {std::make_pair(&up, &a_T_top), {&down, &b_T_top}})
    for (int j : *joints) {
      if (!tree.joints[j].is_rigid()) return std::nullopt;
      *pose = *pose * inverse(pose_at_zero(tree.joints[j]));
    }
  return a_T_top * inverse(b_T_top);
}

std::vector<Mount> mounts_of(const Rig& rig, const Names& sensors, bool frames,
                             std::vector<std::string>& notes) {
  std::vector<Mount> out;
  const auto add = [&](const auto& thing, const Pose& pose, const std::string& kind) {
    Names taken;
    for (const Mount& m : out) taken.push_back(m.child);
    if (thing.pose_given)
      out.push_back(mount_of(rig, thing, pose, taken, frames));
    else
      notes.push_back(
          kind + thing.name +
          " is left out: its pose is not in the rig. Export a result of `kincal calibrate`");
  };
  for (const Sensor& sensor : rig.sensors)
    if (sensors.empty() || std::count(sensors.begin(), sensors.end(), sensor.name))
      add(sensor, sensor.link_T_sensor, "sensors.");
  for (const Target& target : rig.targets)
    if (sensors.empty() && target.link >= 0) add(target, target.link_T_target, "targets.");
  if (out.empty())
    throw InputError(
        "no pose of a sensor or mounted target is in the rig: export a result of `kincal "
        "calibrate`");
  return out;
}

Mount driver_mount(const Rig& rig, const Sensor& sensor, const std::string& child,
                   const std::string& known) {
  const Tree& tree = rig.tree;
  if (!sensor.pose_given)
    throw InputError("sensors." + sensor.name +
                     ": its pose is not in the rig: export a result of `kincal calibrate`");
  const Pose child_T_sensor = known_pose(rig, sensor, child, known);
  const int link = tree.find_link(child), above = link < 0 ? -1 : tree.joint_above[link];
  if (link >= 0 && above < 0)
    throw InputError("--child: '" + child + "' is the root of the robot: no joint is above it");
  if (above >= 0 && !tree.joints[above].is_rigid())
    throw InputError("--child: '" + child + "' hangs on a joint that moves, '" +
                     tree.joints[above].name + "'; a frame that is fixed on a link is expected");
  const int parent = above >= 0                ? tree.joints[above].parent
                     : sensor.mount_joint >= 0 ? tree.joints[sensor.mount_joint].parent
                                               : sensor.link;
  const std::optional<Pose> parent_T_link = fixed_pose(tree, parent, sensor.link);
  if (!parent_T_link)
    throw InputError("--child: link '" + tree.links[sensor.link] + "' of sensors." + sensor.name +
                     " moves against '" + child + "'");
  return {sensor.name,
          tree.links[parent],
          child,
          above >= 0 ? tree.joints[above].name : new_joint_name(tree, child + "_mount"),
          *parent_T_link * sensor.link_T_sensor * inverse(child_T_sensor),
          false,
          above < 0};
}

const Names& mount_formats() {
  static const Names formats = {"static_transforms", "urdf", "xacro", "poses"};
  return formats;
}

std::string poses_text(const std::vector<Mount>& mounts, const PoseFormat& format) {
  std::string out = "id,in";
  for (const std::string& column : format.columns) out += "," + column;
  for (const Mount& m : mounts) {
    out += "\n" + csv_field(m.of) + "," + csv_field(m.parent);
    for (const double number : numbers_of_pose(format, m.parent_T_child))
      out += "," + shortest(number);
  }
  return out + "\n";
}

std::string mounts_text(const std::vector<Mount>& mounts, const std::string& format) {
  std::string out;
  for (const Mount& m : mounts)
    out += format == "urdf" ? urdf_text(m) : format == "xacro" ? xacro_text(m) : transforms_text(m);
  return out;
}

}  // namespace kincal
