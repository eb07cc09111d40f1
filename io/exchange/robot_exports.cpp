#include "robot_exports.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../results/mount_texts.h"
#include "../rig/types.h"

namespace kincal {
namespace {

constexpr int kTicksOfTurn = 4096;
constexpr int kFarthestFeetech = 2047, kFarthestDynamixel = 1000000;  // homing offsets they keep

/// What of a joint an offset alone cannot say; "": nothing.
std::string beyond_offset(const RobotNumbers& robot, size_t j) {
  std::string out;
  if (robot.scales[j] != 1) out = "its scale (" + shortest(robot.scales[j]) + ")";
  if (!robot.rig.joints[j].model->extra_parameters().empty())
    out += std::string(out.empty() ? "" : " and ") + "its joint model";
  return out;
}

/// First byte and length of a number in a text of JSON. The node has its place, or that of its key
/// where the number stands on another line.
std::pair<size_t, size_t> bytes_of(const std::string& text, const Node& number) {
  size_t at = 0;
  for (int l = 1; l < number.line; ++l) at = text.find('\n', at) + 1;
  at += static_cast<size_t>(number.column) - 1;
  if (text[at] == '"') at = text.find_first_not_of(" \t\r\n:", text.find('"', at + 1) + 1);
  return {at, std::min(text.find_first_of(" \t\r\n,]}", at), text.size()) - at};
}

}  // namespace

RobotNumbers robot_numbers(const CalibratedFiles& files) {
  const Rig& rig = files.rig_file.rig;
  const Tree& tree = rig.tree;
  RobotNumbers out{rig, {}, {}, {}, {}, {}};
  const auto value = [&](int parameter, double absent) {
    return parameter < 0 ? absent : files.values(files.table.all[parameter].start);
  };
  const auto has_sigma = [&](int parameter) {
    return parameter >= 0 && files.sigma.count(files.table.all[parameter].name) > 0;
  };
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    const int origin = files.table.joint_origin[j], offset = files.table.joint_offset[j];
    out.origins.push_back(origin < 0 ? tree.joints[j].parent_T_joint
                                     : get_pose(files.values, files.table.all[origin].start));
    out.offsets.push_back(value(offset, 0));
    out.scales.push_back(value(files.table.joint_scale[j], 1));
    const int leader = tree.joints[j].mimic ? driver(tree, static_cast<int>(j)).joint : -1;
    out.estimated.push_back(files.sigma.empty() || has_sigma(origin) || has_sigma(offset) ||
                            (leader >= 0 && has_sigma(files.table.joint_offset[leader])));
  }
  out.folded = fold_offsets(tree, out.origins, out.offsets);
  return out;
}

std::string xacro_properties(const RobotNumbers& robot) {
  std::string out =
      "<!-- origins of the calibrated robot, offsets included: <origin xyz=\"${JOINT_xyz}\" "
      "rpy=\"${JOINT_rpy}\"/> -->\n";
  Names taken;
  for (size_t j = 0; j < robot.folded.size(); ++j) {
    if (!robot.estimated[j] || robot.rig.tree.joints[j].axis_of_pose != PoseAxis::none) continue;
    const std::string& joint = robot.rig.tree.joints[j].name;
    const std::string name = xacro_name(joint);
    if (std::count(taken.begin(), taken.end(), name))
      throw InputError("joint '" + joint + "': another joint has the property '" + name +
                       "', too: names must differ in more than spaces and punctuation");
    taken.push_back(name);
    out += xacro_origin(name, robot.folded[j]);
  }
  return out;
}

std::string ros2_control_text(const RobotNumbers& robot, std::vector<std::string>& notes) {
  const Tree& tree = robot.rig.tree;
  std::string transmissions, origins;
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    const Joint& joint = tree.joints[j];
    const std::string name = xml_text(joint.name);
    if (joint.has_reading() && (robot.offsets[j] != 0 || robot.scales[j] != 1)) {
      if (!robot.rig.joints[j].model->extra_parameters().empty())
        notes.push_back("joint '" + joint.name +
                        "': a transmission cannot express its joint model; this one has its offset "
                        "and scale only");
      transmissions += "<transmission name=\"" + name +
                       "_transmission\">\n  <plugin>transmission_interface/SimpleTransmission"
                       "</plugin>\n  <actuator name=\"" +
                       name + "\" role=\"actuator1\"/>\n  <joint name=\"" + name +
                       "\" role=\"joint1\">\n    <mechanical_reduction>" +
                       shortest(1 / robot.scales[j]) + "</mechanical_reduction>\n    <offset>" +
                       shortest(robot.offsets[j]) + "</offset>\n  </joint>\n</transmission>\n";
    }
    const Pose& a = robot.origins[j];
    const Pose& b = robot.folded[j];
    if (a.rotation != b.rotation || a.translation != b.translation)
      origins += "     " + joint.name + ": <origin xyz=\"" + shortest(a.translation) + "\" rpy=\"" +
                 shortest(Vector3d(rpy_from_rotation(a.rotation))) + "\"/>\n";
  }
  if (transmissions.empty())
    throw InputError("no joint has an offset or a scale: export a result of `kincal calibrate`");
  return "<!-- position = reading / mechanical_reduction + offset. robot.urdf contains the offsets "
         "in its origins.\n     With these transmissions, restore the origins in robot.urdf:\n" +
         origins + "     -->\n" + transmissions;
}

std::string lerobot_text(const RobotNumbers& robot, const std::string& from,
                         const std::string& motors, std::vector<std::string>& notes) {
  if (motors != "feetech" && motors != "dynamixel")
    throw InputError("--motors: '" + motors + "'; valid: feetech, dynamixel");
  const std::string text = read_file(from);
  const Node node = parse_json(text, from);
  const Field all = top(node, from);
  std::vector<std::pair<std::pair<size_t, size_t>, std::string>> places;  // byte, length: new text
  Names known, left;
  for (const auto& [name, ignored] : all.members()) {
    const Field motor = all[name];
    motor.check_keys({"id", "drive_mode", "homing_offset", "range_min", "range_max"});
    const int homing = motor["homing_offset"].integer(-kFarthestDynamixel, kFarthestDynamixel),
              mode = motor["drive_mode"].integer(0, 1);
    known.push_back(name);
    const int j = robot.rig.tree.find_joint(name);
    if (j < 0 || !robot.rig.tree.joints[j].has_reading()) {
      left.push_back(name);
      continue;
    }
    if (const std::string what = beyond_offset(robot, j); !what.empty())
      notes.push_back("joint '" + name + "': a homing offset cannot express " + what);
    const double ticks = robot.offsets[j] * kTicksOfTurn / (2 * kPi);
    const int by = static_cast<int>(std::lround(ticks));
    const bool down = (motors == "feetech") != (mode == 1);
    const int shall = homing + (down ? -by : by);
    const int farthest = motors == "feetech" ? kFarthestFeetech : kFarthestDynamixel;
    if (std::abs(shall) > farthest)
      motor["homing_offset"].fail("would be " + std::to_string(shall) +
                                  ", and these motors have +-" + std::to_string(farthest) +
                                  ": mount the horn again");
    places.push_back({bytes_of(text, *motor["homing_offset"].node), std::to_string(shall)});
  }
  if (left.size() == known.size())
    throw InputError(
        from + ": no motor has the name of a joint with a reading: " + comma_separated(known));
  if (!left.empty())
    notes.push_back("not joints of the robot, left unchanged: " + comma_separated(left));
  for (size_t j = 0; j < robot.offsets.size(); ++j)
    if (robot.offsets[j] != 0 &&
        !std::count(known.begin(), known.end(), robot.rig.tree.joints[j].name))
      notes.push_back("joint '" + robot.rig.tree.joints[j].name + "' has no motor in " + from);
  notes.push_back("homing offsets are whole ticks: they are rounded by up to " +
                  rounded(1e3 * kPi / kTicksOfTurn, 2) + " mrad");
  std::sort(places.begin(), places.end());
  std::string out;
  size_t at = 0;
  for (const auto& [old, shall] : places) {
    out.append(text, at, old.first - at).append(shall);
    at = old.first + old.second;
  }
  return out.append(text, at, std::string::npos);
}

}  // namespace kincal
