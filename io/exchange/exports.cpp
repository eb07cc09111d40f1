#include "exports.h"

#include <algorithm>
#include <optional>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../document/yaml.h"
#include "../results/mount_texts.h"
#include "../rig/types.h"
#include "dh.h"
#include "lens.h"
#include "mounts.h"
#include "robot_exports.h"
#include "ur_kinematics.h"
#include "write_lens.h"

namespace kincal {
namespace {

void check_sensors(const Rig& rig, const Names& given) {
  const Names names = names_of(rig.sensors);
  for (const std::string& name : given)
    if (!std::count(names.begin(), names.end(), name))
      throw InputError("--sensor: there is no sensor '" + name + "'" + nearest_names(name, names) +
                       "; valid: " + comma_separated(names));
}

/// The one sensor of a format that holds one.
const Sensor& only_sensor(const std::vector<const Sensor*>& sensors, const std::string& format) {
  if (sensors.size() == 1) return *sensors[0];
  Names names;
  for (const Sensor* sensor : sensors) names.push_back(sensor->name);
  throw InputError((format[0] == '-' ? format + " is about" : "a file of " + format + " holds") +
                   " one sensor: take --sensor NAME with one of " + comma_separated(names));
}

/// The sensors of these names, of no names all that have a frame of their own.
std::vector<const Sensor*> posed_sensors(const Rig& rig, const Names& names) {
  std::vector<const Sensor*> out;
  for (const Sensor& sensor : rig.sensors)
    if (names.empty() ? sensor.type != "chain"
                      : std::count(names.begin(), names.end(), sensor.name) > 0)
      out.push_back(&sensor);
  return out;
}

/// Where the centre of a rectified right camera is, in the sensor's frame.
Pose lens_in_sensor(const LensNumbers& lens) {
  return {Matrix3d::Identity(), Vector3d(lens.baseline.value_or(0), 0, 0)};
}

std::string camchain(const Rig& rig, const std::vector<const Sensor*>& cameras,
                     std::vector<std::string>& notes) {
  std::vector<LensNumbers> lenses;
  std::vector<std::optional<Pose>> before;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Sensor& camera = *cameras[i];
    lenses.push_back(lens_of(camera));
    before.emplace_back();
    if (i == 0) continue;
    const Sensor& last = *cameras[i - 1];
    const std::optional<Pose> links = fixed_pose(rig.tree, camera.link, last.link);
    if (!links || !camera.pose_given || !last.pose_given)
      notes.push_back(
          "T_cn_cnm1 of cam" + std::to_string(i) + " is left out: " + last.name + " and " +
          camera.name +
          (links ? " have no poses in the rig. Give the first camera one (any, such as pose: "
                   "{xyz: [0, 0, 0]}), and `kincal intrinsics` or `calibrate` writes "
                   "the other's"
                 : " move against each other"));
    else
      before[i] = inverse(camera.link_T_sensor * lens_in_sensor(lenses[i])) * *links *
                  last.link_T_sensor * lens_in_sensor(lenses[i - 1]);
  }
  return kalibr_text(lenses, before);
}

struct HandEye {
  bool in_hand = false;
  std::string base, effector, camera, marker;  // frames
  Pose pose;                                   // of the camera, in effector or base
};

HandEye hand_eye(const Rig& rig, const Sensor& sensor) {
  if (!sensor.pose_given)
    throw InputError("sensors." + sensor.name +
                     ": its pose is not in the rig: export a result of `kincal calibrate`");
  const Tree& tree = rig.tree;
  HandEye out;
  out.base = tree.links[rig.base];
  const std::optional<Pose> base_T_link = fixed_pose(tree, rig.base, sensor.link);
  out.in_hand = !base_T_link;
  // A pose that a joint of the robot has is told from the joint's parent: the link may be the
  // camera's own.
  const int above = sensor.mount_joint < 0 ? sensor.link : tree.joints[sensor.mount_joint].parent;
  const Pose link_T_sensor = *fixed_pose(tree, above, sensor.link) * sensor.link_T_sensor;
  const bool own_link = above != sensor.link && sensor.link_T_sensor.translation.isZero(0) &&
                        sensor.link_T_sensor.rotation.isIdentity(0);
  out.camera = own_link ? tree.links[sensor.link] : new_link_name(tree, sensor.name, {});
  out.pose = out.in_hand ? link_T_sensor : *base_T_link * sensor.link_T_sensor;
  if (out.in_hand) out.effector = tree.links[above];
  for (const Target& target : rig.targets) {
    if (out.marker.empty()) out.marker = target.name;
    if (out.effector.empty() && target.link >= 0 && !fixed_pose(tree, rig.base, target.link)) {
      out.effector = tree.links[target.link];
      out.marker = target.name;
    }
  }
  return out;
}

std::string easy_handeye(const HandEye& it, const std::string& name) {
  const Eigen::Vector4d q = quaternion_from_rotation(it.pose.rotation);
  const Vector3d& t = it.pose.translation;
  const std::string space = "/" + name + (it.in_hand ? "_eye_on_hand/" : "_eye_on_base/");
  return "parameters:\n  eye_on_hand: " + std::string(it.in_hand ? "true" : "false") +
         "\n  move_group: manipulator\n  move_group_namespace: /\n  namespace: " +
         yaml_text(space) + "\n  robot_base_frame: " + yaml_text(it.base) +
         "\n  robot_effector_frame: " + yaml_text(it.effector) +
         "\n  tracking_base_frame: " + yaml_text(it.camera) +
         "\n  tracking_marker_frame: " + yaml_text(it.marker) +
         "\ntransformation:\n  qw: " + real_text(q[3]) + "\n  qx: " + real_text(q[0]) +
         "\n  qy: " + real_text(q[1]) + "\n  qz: " + real_text(q[2]) +
         "\n  x: " + real_text(t.x()) + "\n  y: " + real_text(t.y()) +
         "\n  z: " + real_text(t.z()) + "\n";
}

std::string easy_handeye2(const HandEye& it, const std::string& name) {
  const Eigen::Vector4d q = quaternion_from_rotation(it.pose.rotation);
  const Vector3d& t = it.pose.translation;
  return "parameters:\n  name: " + yaml_text(name) +
         "\n  calibration_type: " + (it.in_hand ? "eye_in_hand" : "eye_on_base") +
         "\n  tracking_base_frame: " + yaml_text(it.camera) +
         "\n  tracking_marker_frame: " + yaml_text(it.marker) +
         "\n  robot_base_frame: " + yaml_text(it.base) +
         "\n  robot_effector_frame: " + yaml_text(it.effector) +
         "\n  freehand_robot_movement: true\ntransform:\n  translation:\n    x: " +
         real_text(t.x()) + "\n    y: " + real_text(t.y()) + "\n    z: " + real_text(t.z()) +
         "\n  rotation:\n    x: " + real_text(q[0]) + "\n    y: " + real_text(q[1]) +
         "\n    z: " + real_text(q[2]) + "\n    w: " + real_text(q[3]) + "\n";
}

/// Formats of the robot's joints, without sensors.
const Names& robot_formats() {
  static const Names formats = {"xacro_properties", "ros2_control", "ur_kinematics",
                                "lerobot",          "dh",           "modified_dh"};
  return formats;
}

bool is_among(const Names& names, const std::string& name) {
  return std::count(names.begin(), names.end(), name) > 0;
}

/// Refuses options that the format has no use for.
void check_options(const ExportOptions& o) {
  if (!is_among(export_formats(), o.format))
    throw InputError("--as: unknown format '" + o.format + "'" +
                     nearest_names(o.format, export_formats()) +
                     "; valid: " + comma_separated(export_formats()));
  const auto only_of = [&](const std::string& option, bool given, const Names& formats) {
    if (given && !is_among(formats, o.format))
      throw InputError(option + ": is of the formats " + comma_separated(formats));
  };
  only_of("--child", !o.child.empty(), mount_formats());
  only_of("--known", !o.known.empty(), mount_formats());
  only_of("--pose-format", !o.pose_format.empty(), {"poses"});
  only_of("--tip", !o.tip.empty(), {"dh", "modified_dh"});
  only_of("--prefix", !o.prefix.empty(), {"ur_kinematics"});
  only_of("--from", !o.from.empty(), {"ur_kinematics", "lerobot"});
  only_of("--motors", o.motors != "feetech", {"lerobot"});
  if (is_among(robot_formats(), o.format) && !o.sensors.empty())
    throw InputError("--sensor: " + o.format + " has no sensors");
  if (o.child.empty() && !o.known.empty())
    throw InputError("--known needs --child: it is the pose of the sensor in that link");
  if (o.format == "poses" && o.pose_format.empty()) {
    Names names;
    for (const PoseFormat& one : pose_formats()) names.push_back(one.name);
    throw InputError("--pose-format is missing: one of " + comma_separated(names));
  }
  if (o.format == "lerobot" && o.from.empty())
    throw InputError(
        "--from is missing: LeRobot's calibration file of this robot. The offsets in a copy of it "
        "are corrected");
}

std::string dh_of(const RobotNumbers& robot, const ExportOptions& o) {
  const Tree& tree = robot.rig.tree;
  if (o.tip.empty())
    throw InputError("--tip is missing: the link at the end of the chain; the robot has: " +
                     comma_separated(tree.links));
  const int tip = tree.find_link(o.tip);
  if (tip < 0)
    throw InputError("--tip: the robot has no link '" + o.tip + "'" +
                     nearest_or_all(o.tip, tree.links, "the robot has"));
  const DhTable table =
      dh_table(tree, robot.folded, robot.rig.base, tip, o.format == "modified_dh");
  return dh_text(table, dh_misfit(table, tree, robot.folded, robot.rig.base, tip),
                 tree.links[robot.rig.base], o.tip);
}

std::string ur_kinematics_of(const RobotNumbers& robot, const ExportOptions& o,
                             std::vector<std::string>& notes) {
  UrKinematics out;
  for (const int j : ur_joints(robot.rig.tree, o.prefix)) out.origins.push_back(robot.folded[j]);
  if (!o.from.empty()) out.hash = read_ur_kinematics(o.from).hash;
  if (out.hash.empty()) {
    out.hash = "kincal_" + sha256(ur_kinematics_text(out)).substr(0, 16);
    notes.push_back(
        "the driver compares `hash` with the robot's and warns: take --from FILE with the file "
        "that ur_calibration wrote for the robot, and its hash is kept");
  }
  return ur_kinematics_text(out);
}

ExportedFile export_robot(const RobotNumbers& robot, const ExportOptions& o) {
  ExportedFile out;
  if (o.format == "xacro_properties")
    out.text = xacro_properties(robot);
  else if (o.format == "ros2_control")
    out.text = ros2_control_text(robot, out.notes);
  else if (o.format == "ur_kinematics")
    out.text = ur_kinematics_of(robot, o, out.notes);
  else if (o.format == "lerobot")
    out.text = lerobot_text(robot, o.from, o.motors, out.notes);
  else
    out.text = dh_of(robot, o);
  return out;
}

}  // namespace

const Names& export_formats() {
  static const Names formats = [] {
    Names out = {"camera_info", "opencv", "kalibr",       "static_transforms", "urdf",
                 "xacro",       "poses",  "easy_handeye", "easy_handeye2"};
    out.insert(out.end(), robot_formats().begin(), robot_formats().end());
    return out;
  }();
  return formats;
}

ExportedFile export_calibrated(const CalibratedFiles& files, const ExportOptions& o) {
  const std::string& format = o.format;
  check_options(o);
  if (is_among(robot_formats(), format)) return export_robot(robot_numbers(files), o);
  const Rig& rig = files.rig_file.rig;
  check_sensors(rig, o.sensors);
  ExportedFile out;
  if (is_among(mount_formats(), format)) {
    const std::vector<Mount> mounts =
        o.child.empty()
            ? mounts_of(rig, o.sensors, format == "poses", out.notes)
            : std::vector<Mount>{driver_mount(
                  rig, only_sensor(posed_sensors(rig, o.sensors), "--child"), o.child, o.known)};
    out.text = format == "poses" ? poses_text(mounts, pose_format(o.pose_format))
                                 : mounts_text(mounts, format);
  } else if (format == "easy_handeye" || format == "easy_handeye2") {
    const Sensor& sensor = only_sensor(posed_sensors(rig, o.sensors), format);
    const HandEye it = hand_eye(rig, sensor);
    out.text =
        format == "easy_handeye" ? easy_handeye(it, sensor.name) : easy_handeye2(it, sensor.name);
  } else {
    const std::vector<const Sensor*> cameras = cameras_of(rig, o.sensors);
    out.text = format == "kalibr" ? camchain(rig, cameras, out.notes)
               : format == "camera_info"
                   ? camera_info_text(lens_of(only_sensor(cameras, format)))
                   : opencv_text(lens_of(only_sensor(cameras, format)), out.notes);
  }
  return out;
}

}  // namespace kincal
