#include "new_rig.h"

#include <algorithm>
#include <cmath>
#include <regex>
#include <set>

#include "../../models/rig/words.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../document/yaml.h"
#include "types.h"

namespace kincal {

const char* const kTargetForm =
    "chessboard:ROWSxCOLUMNS:SQUARE, circles:ROWSxCOLUMNS:SPACING, "
    "charuco:ROWSxCOLUMNS:SQUARE:MARKER[:DICTIONARY]\n"
    "(DICT_4X4_50, ...), apriltag_grid:ROWSxCOLUMNS:TAG:GAP[:FAMILY] (gap / tag; tag36h11, ...), "
    "marker:DICTIONARY:ID:SIZE\n"
    "(one ArUco or AprilTag marker, by its edge) or points:X,Y,Z[;X,Y,Z...], then @LINK\n"
    "where it is mounted (without: free, its own pose in every sample) and :NAME; lengths in m";

std::string sensor_form() {
  std::string types;
  const std::vector<SensorKeys>& all = sensor_types();
  for (size_t i = 0; i < all.size(); ++i)
    types += (i == 0 ? "" : i + 1 < all.size() ? ", " : " or ") + all[i].name;
  return "TYPE:LINK[:NAME] with TYPE " + types;
}

namespace {

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> out(1);
  for (char c : text) {
    if (c == at)
      out.emplace_back();
    else
      out.back() += c;
  }
  return out;
}

double number_of_option(const std::string& text, const std::string& option,
                        const std::string& what) {
  const Node node = scalar_node(text);
  return Field{&node, &option, what}.number();
}

double positive(const std::string& text, const std::string& option, const std::string& what) {
  const double value = number_of_option(text, option, what);
  if (!(value > 0))
    throw InputError(option + ": " + what + ": a number greater than 0 is expected, not '" + text +
                     "'");
  return value;
}

std::string known_link(const std::string& link, const Tree& tree, const std::string& option) {
  if (tree.find_link(link) < 0)
    throw InputError(option + ": unknown link '" + link + "'" +
                     nearest_or_all(link, tree.links, "the robot has"));
  return link;
}

template <class Keys>
std::string known_type(const std::string& type, const std::vector<Keys>& types,
                       const std::string& option) {
  const Names names = names_of(types);
  if (!find_type(types, type))
    throw InputError(option + ": unknown type '" + type + "'" + nearest_names(type, names) +
                     "; valid: " + comma_separated(names));
  return type;
}

/// Gives names to what has none: `base`, `base_2`, ...
template <class T, class F>
void give_names(std::vector<T>& things, const char* option, const F& base) {
  std::set<std::string> taken;
  for (const T& t : things)
    if (!t.name.empty() && !taken.insert(t.name).second)
      throw InputError(std::string(option) + ": the name '" + t.name + "' occurs twice");
  for (T& t : things) {
    if (!t.name.empty()) continue;
    const std::string plain = base(t);
    t.name = plain;
    for (int i = 2; !taken.insert(t.name).second; ++i) t.name = plain + "_" + std::to_string(i);
  }
}

std::string list(const std::vector<double>& numbers) {
  return list_text(numbers.data(), static_cast<int>(numbers.size()));
}

std::string target_text(const NewTarget& t) {
  std::string out = "  " + yaml_text(t.name) + ":\n    type: " + t.type + "\n";
  const char* pose = "  # pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}";
  if (t.type == "points") {
    out += "    points: [";
    for (size_t i = 0; i < t.points.size(); i += 3)
      out += (i ? ", " : "") + list({t.points[i], t.points[i + 1], t.points[i + 2]});
    out += "]          # m, in the target's frame\n";
  } else if (t.type == "marker") {
    out += "    dictionary: " + t.marks + "\n    id: " + std::to_string(t.id) +
           "\n    size: " + shortest(t.size) + "                # m: the black square's edge\n";
  } else {
    out += "    rows: " + std::to_string(t.rows) + "                      # " +
           (t.type == "chessboard" ? "inner corners"
            : t.type == "charuco"  ? "squares"
            : t.type == "circles"  ? "circles"
                                   : "tags") +
           "\n    columns: " + std::to_string(t.columns) + "\n";
    out += std::string("    ") + find_type(target_types(), t.type)->size + ": " + shortest(t.size) +
           "                # m: measure it, over several squares\n";
    if (t.type == "charuco")
      out += "    marker: " + shortest(t.second) + "\n    dictionary: " +
             (t.marks.empty() ? "DICT_6X6_250    # GUESS; only" : t.marks + "    # only") +
             " for the detection, not used here\n";
    if (t.type == "apriltag_grid")
      out += "    spacing: " + shortest(t.second) +
             "               # gap / tag\n    family: " + (t.marks.empty() ? "tag36h11" : t.marks) +
             "          # only for the detection, not used here\n";
  }
  if (t.link.empty())
    return out + "    mount: free                  # its own pose in every sample\n";
  return out + "    mount:\n      link: " + yaml_text(t.link) + "\n    " + pose +
         "   # link_T_target; if omitted: found from the data\n";
}

/// Whether a text is a dictionary of markers or a family of tags, as OpenCV calls them.
bool names_marks(const std::string& text) {
  static const std::regex known("DICT_\\w+|(tag)?(16h5|25h9|36h10|36h11)");
  return std::regex_match(text, known);
}

/// Every sensor and target gets a name. @throws InputError where options contradict each other.
void complete(NewRig& rig) {
  if (rig.sensors.empty()) throw InputError("--sensor: at least one is needed: " + sensor_form());
  if (rig.targets.empty())
    throw InputError(std::string("--target: at least one is needed:\n") + kTargetForm);
  give_names(rig.sensors, "--sensor", [](const NewSensor& s) {
    return s.type == "tilting_laser" ? std::string("laser") : s.type;
  });
  give_names(rig.targets, "--target", [](const NewTarget& t) {
    return t.type == "points" ? std::string("points") : std::string("board");
  });
  const auto cameras =
      static_cast<size_t>(std::count_if(rig.sensors.begin(), rig.sensors.end(),
                                        [](const NewSensor& s) { return s.type == "camera"; }));
  for (const auto& given : {std::make_pair("--intrinsics", rig.intrinsics.size()),
                            std::make_pair("--image-size", rig.image_sizes.size())})
    if (given.second > 1 && given.second != cameras)
      throw InputError(std::string(given.first) + ": stands " + std::to_string(given.second) +
                       " times for " + std::to_string(cameras) +
                       " cameras: once for all, or once for each in their order");
}

const std::string kReplace = " Replace values marked GUESS by known ones.";

/// What stands above the targets: the robot and the noise of its joints.
std::string head_text(const Tree& tree, const std::string& robot) {
  if (robot.empty())
    return "# Made by `kincal init`." + kReplace +
           "\n"
           "format: kincal/1\n"
           "# No URDF: each sample has the pose of the flange in the base as the robot reports "
           "it,\n"
           "#   \"joints\": {\"flange\": {\"xyz\": [x, y, z], \"quat\": [x, y, z, w]}}    m\n"
           "robot: {base: " +
           yaml_text(tree.links[tree.root]) +
           ", flange: " + yaml_text(tree.links[tree.joints[0].child]) +
           "}\n\n"
           "# Noise of the poses, m and rad (0: exact). Not stated, it is found from the data.\n"
           "# joints: {flange: {sigma: {translation: 0.0001, rotation: 0.0002}}}\n";
  std::string out =
      "# Made by `kincal init`." + kReplace +
      "\n"
      "format: kincal/1\n"
      "robot: " +
      yaml_text(robot) +
      "\n"
      "base: " +
      yaml_text(tree.links[tree.root]) +
      "                # frame of free targets\n\n"
      "# Noise of one joint reading (repeatability, backlash), rad; 0: exact. It decides how "
      "residuals are shared between robot and\n"
      "# sensors. {guess: ...} is no statement: the noise is found from the data. If you know it, "
      "state it: sigma: 0.0002\n"
      "joints:\n"
      "  \"*\": {sigma: {guess: " +
      text("%g", kGuessedTurnNoise) + "}}\n";
  for (const Joint& joint : tree.joints)
    if (joint.has_reading() && joint.type == JointType::prismatic)
      out += "  " + yaml_text(joint.name) + ": {sigma: {guess: " + text("%g", kGuessedSlideNoise) +
             "}}    # m\n";
  return out;
}

/// What only a camera has; `camera`: its number among the cameras.
std::string camera_text(const NewRig& rig, const NewSensor& s, size_t camera) {
  std::string out;
  const auto of_camera = [&](const auto& all) {
    return all.empty() ? nullptr : &all[all.size() == 1 ? 0 : camera];
  };
  const std::vector<double>* intrinsics = of_camera(rig.intrinsics);
  const std::vector<int>* size = of_camera(rig.image_sizes);
  if (!intrinsics && !size)
    throw InputError("--sensor " + s.type + ":" + s.link +
                     ": a camera needs --intrinsics FX,FY,CX,CY, or --image-size WIDTHxHEIGHT to "
                     "guess them from");
  out +=
      "    model: brown_conrady         # or pinhole (images rectified), kannala_brandt "
      "(fisheye)\n";
  if (size)
    out += "    image_size: [" + std::to_string((*size)[0]) + ", " + std::to_string((*size)[1]) +
           "]\n";
  if (intrinsics)
    out += "    intrinsics: " + list(*intrinsics) + "   # fx fy cx cy, px\n";
  else
    out +=
        "    intrinsics: " +
        list({1.0 * (*size)[0], 1.0 * (*size)[0], ((*size)[0] - 1) / 2.0, ((*size)[1] - 1) / 2.0}) +
        "   # GUESS: 53 degrees wide, centre of the image\n";
  out += "    # distortion: [0, 0, 0, 0, 0] # k1 k2 p1 p2 k3\n";
  return out;
}

/// The fixed joint that a camera's link hangs on.
struct MountJoint {
  int joint = -1;        // -1: none
  bool optical = false;  // it ends in an optical frame, so the URDF has it for the camera
};

/// A joint that only turns to the axes of an optical frame is no mount: the one above it is, if
/// that is fixed too and nothing else hangs there.
MountJoint joint_of_mount(const Tree& tree, int link) {
  const int joint = tree.joint_above[link];
  if (joint < 0 || tree.joints[joint].type != JointType::fixed) return {};
  const Matrix3d optical = rotation_from_rpy(Vector3d(-kPi / 2, 0, -kPi / 2));
  const Pose& origin = tree.joints[joint].parent_T_joint;
  const int parent = tree.joints[joint].parent, above = tree.joint_above[parent];
  const auto on_parent = std::count_if(tree.joints.begin(), tree.joints.end(),
                                       [&](const Joint& j) { return j.parent == parent; });
  if (!(log_so3(optical.transpose() * origin.rotation).norm() < 1e-2)) return {joint, false};
  const bool climb = origin.translation.norm() < 1e-9 && on_parent == 1 && above >= 0 &&
                     tree.joints[above].type == JointType::fixed;
  return {climb ? above : joint, true};
}

/// What else would move with a joint: the first joint below it that moves, or another sensor or
/// target; "": nothing.
std::string moved_along(const Tree& tree, const NewRig& rig, const NewSensor& sensor, int joint) {
  const auto below = [&](int link) {
    for (int l = link; l >= 0;) {
      if (l == tree.joints[joint].child) return true;
      l = tree.joint_above[l] < 0 ? -1 : tree.joints[tree.joint_above[l]].parent;
    }
    return false;
  };
  for (const Joint& j : tree.joints)
    if (!j.is_rigid() && below(j.parent)) return "joint " + yaml_text(j.name);
  for (const NewSensor& s : rig.sensors)
    if (&s != &sensor && below(tree.find_link(s.link))) return "sensor " + yaml_text(s.name);
  for (const NewTarget& t : rig.targets)
    if (!t.link.empty() && below(tree.find_link(t.link))) return "target " + yaml_text(t.name);
  return "";
}

/// The line that mounts a camera by a fixed joint; a comment where more would move along, or where
/// the link may be a flange's. `mounted` gets the joint, -1: none.
std::string mount_text(const Tree& tree, const NewRig& rig, const NewSensor& s, int& mounted) {
  const MountJoint mount = joint_of_mount(tree, tree.find_link(s.link));
  mounted = -1;
  if (mount.joint < 0) return "";
  const std::string along = moved_along(tree, rig, s, mount.joint),
                    key = "mount: " + yaml_text("joint/" + tree.joints[mount.joint].name);
  if (!along.empty())
    return "    # " + key + "   # would be calibrated in place of the pose, in robot.urdf; " +
           along + " would move along\n";
  if (!mount.optical)
    return "    # " + key +
           "   # is calibrated in place of the pose, in robot.urdf: if this joint is the camera's "
           "own\n";
  mounted = mount.joint;
  return "    " + key +
         "   # is calibrated, in robot.urdf; take this line away for a pose beside it\n";
}

std::string laser_text(const Tree& tree, const NewSensor& s) {
  int link = tree.find_link(s.link), joint = tree.joint_above[link];
  while (joint >= 0 && !tree.joints[joint].has_reading())
    joint = tree.joint_above[tree.joints[joint].parent];
  if (joint < 0)
    throw InputError("--sensor " + s.type + ":" + s.link +
                     ": no joint above this link moves: nothing tilts the laser");
  return "    joint: " + yaml_text(tree.joints[joint].name) + "   # that moves while it scans\n";
}

std::string sensor_text(const Tree& tree, const NewRig& rig, const NewSensor& s, size_t camera) {
  const SensorKeys& type = *find_type(sensor_types(), s.type);
  std::string out = "  " + yaml_text(s.name) + ":\n    type: " + s.type +
                    "\n    link: " + yaml_text(s.link) + "\n" +
                    "    # pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}\n";
  int mounted = -1;
  if (s.type == "camera") out += mount_text(tree, rig, s, mounted);
  if (s.type == "camera") out += camera_text(rig, s, camera);
  if (type.make()->scans()) out += laser_text(tree, s);
  return out + "    sigma: {guess: " + type.guess + "}   # " + type.unit +
         "; found from the data, unless you state it: sigma: " + type.guess + "\n";
}

/// The first chain with several moving joints between the links that carry something, as a step
/// names it; "" if there is none.
std::string example_chain(const Tree& tree, const NewRig& rig) {
  const auto moves_between = [&](const std::string& a, const std::string& b) {
    try {
      const Path path = find_path(tree, tree.find_link(a), tree.find_link(b));
      return std::count_if(path.begin(), path.end(), [&](const PathStep& step) {
               return tree.joints[step.joint].moves();
             }) > 1;
    } catch (const std::invalid_argument&) {
      return false;
    }
  };
  std::vector<std::string> links;
  for (const NewTarget& t : rig.targets)
    if (!t.link.empty()) links.push_back(t.link);
  for (const NewSensor& s : rig.sensors) links.push_back(s.link);
  for (const std::string& base : links)
    for (const std::string& tip : links)
      if (moves_between(base, tip)) return "geometry/" + base + ".." + tip;
  return "";
}

/// Whether anything tells how a target is turned: not a single point, if nobody measures its pose.
bool has_orientation(const NewRig& rig, const NewTarget& target) {
  return target.type != "points" || target.points.size() > 3 ||
         std::any_of(rig.sensors.begin(), rig.sensors.end(), [](const NewSensor& sensor) {
           return sensor.type == "pose" || sensor.type == "chain";
         });
}

/// An example of steps, with names that exist.
std::string steps_text(const Tree& tree, const NewRig& rig) {
  std::string poses;
  const auto add = [&](const std::string& name) {
    poses += (poses.empty() ? "" : ", ") + yaml_text(name);
  };
  for (const NewSensor& s : rig.sensors) {
    int mounted = -1;
    if (s.type == "camera") mount_text(tree, rig, s, mounted);
    add(mounted < 0 ? "sensor/" + s.name + "/pose"
                    : "joint/" + tree.joints[mounted].name + "/origin");
  }
  for (const NewTarget& t : rig.targets) {
    if (t.link.empty()) continue;
    if (has_orientation(rig, t))
      add("target/" + t.name + "/pose");
    else
      for (const char* axis : {"x", "y", "z"}) add("target/" + t.name + "/pose." + axis);
  }
  if (rig.robot.empty())
    return "\n# Without `estimate`, `kincal calibrate` estimates every parameter that may be "
           "wrong. Your own steps:\n"
           "# estimate:\n"
           "#   - step: mounts\n"
           "#     free: [" +
           poses + "]\n";
  const std::string chain = example_chain(tree, rig);
  std::string out =
      "\n# Without `estimate`, `kincal calibrate` estimates every parameter that may be wrong, "
      "with priors learned from the data,\n"
      "# and keeps nominal values without evidence of error. To choose yourself, use steps like "
      "these (each starts from the result of the\n"
      "# one before; `kincal calibrate --dry-run` shows their parameters; offsets of the first and "
      "last joint often cannot be separated\n"
      "# from mounts: --fix them if they are reported as unobservable):\n"
      "# estimate:\n"
      "#   - step: mounts\n"
      "#     free: [" +
      poses +
      "]\n"
      "#   - step: offsets\n"
      "#     free: [" +
      poses +
      ", \"joint/*/offset\"]\n"
      "#     priors: {\"joint/*/offset\": 0.05}\n";
  if (!chain.empty())
    out +=
        "#   - step: geometry                # the independent components of the chain, offsets "
        "included\n"
        "#     free: [" +
        poses + ", " + yaml_text(chain) +
        "]\n"
        "#     priors: {" +
        yaml_text(chain) + ": {translation: 0.005, rotation: 0.05}}\n";
  return out;
}

}  // namespace

NewSensor parse_new_sensor(const std::string& text, const Tree& tree) {
  const std::string option = "--sensor " + text;
  const std::vector<std::string> parts = split(text, ':');
  const std::string type = known_type(parts[0], sensor_types(), option);
  if (parts.size() < 2 || parts.size() > 3)
    throw InputError(option + ": " + sensor_form() + " is expected");
  return {type, known_link(parts[1], tree, option), parts.size() > 2 ? parts[2] : ""};
}

NewTarget parse_new_target(const std::string& text, const Tree& tree) {
  const std::string option = "--target " + text;
  const size_t at = text.find('@');
  std::vector<std::string> fields = split(text.substr(0, at), ':');
  NewTarget out;
  out.type = known_type(fields[0], target_types(), option);
  const bool marker = out.type == "marker";
  const bool marked = out.type == "charuco" || out.type == "apriltag_grid";
  const size_t numbers = out.type == "points" ? 2 : marked || marker ? 4 : 3;
  if (marked && fields.size() > numbers && names_marks(fields[numbers])) {
    out.marks = fields[numbers];
    fields.erase(fields.begin() + static_cast<long>(numbers));
  }
  if (at != std::string::npos) {
    const std::vector<std::string> where = split(text.substr(at + 1), ':');
    if (where.size() > 2 || fields.size() != numbers)
      throw InputError(option + ": expected is one of\n" + kTargetForm);
    out.link = known_link(where[0], tree, option);
    if (where.size() > 1) out.name = where[1];
  } else if (fields.size() == numbers + 1) {
    out.name = fields.back();
    fields.pop_back();
  }
  if (fields.size() != numbers) throw InputError(option + ": expected is one of\n" + kTargetForm);
  if (out.type == "points") {
    for (const std::string& point : split(fields[1], ';')) {
      const std::vector<std::string> xyz = split(point, ',');
      if (xyz.size() != 3)
        throw InputError(option + ": a point is X,Y,Z in m, not '" + point + "'");
      for (const std::string& v : xyz) out.points.push_back(number_of_option(v, option, "points"));
    }
    return out;
  }
  const auto count = [&](const std::string& t, const char* name) {
    const double value = number_of_option(t, option, name);
    const int least = marker ? 0 : out.type == "charuco" ? 2 : 1;
    if (value != std::floor(value) || value < least || value > 1000)
      throw InputError(option + ": " + name + ": a whole number from " + std::to_string(least) +
                       " to 1000 is expected, not '" + t + "'");
    return static_cast<int>(value);
  };
  if (marker) {
    if (!names_marks(fields[1]))
      throw InputError(option +
                       ": a dictionary such as DICT_6X6_250 or tag36h11 is expected, not '" +
                       fields[1] + "'; the form is marker:DICTIONARY:ID:SIZE");
    out.marks = fields[1];
    out.id = count(fields[2], "id");
    out.size = positive(fields[3], option, "size");
    return out;
  }
  const std::vector<std::string> size = split(fields[1], 'x');
  if (size.size() != 2)
    throw InputError(option + ": ROWSxCOLUMNS is expected, such as 8x11, not '" + fields[1] + "'");
  out.rows = count(size[0], "rows");
  out.columns = count(size[1], "columns");
  out.size = positive(fields[2], option, "size");
  if (numbers == 4)
    out.second = positive(fields[3], option, out.type == "charuco" ? "marker" : "gap");
  return out;
}

std::string new_rig_text(const Urdf& urdf, NewRig rig) {
  const Tree& tree = urdf.tree;
  complete(rig);
  if (rig.robot
          .empty())  // known by its flange: what the first sensor looks at is on the other link
    for (NewTarget& target : rig.targets)
      if (target.link.empty()) {
        const int base = tree.root, flange = tree.joints[0].child;
        target.link = tree.links[rig.sensors[0].link == tree.links[flange] ? base : flange];
      }
  std::string out = head_text(tree, rig.robot) + "\ntargets:\n";
  for (const NewTarget& t : rig.targets) out += target_text(t);
  out +=
      "\n# Poses are link_T_sensor. An omitted pose is found from the data if a step estimates all "
      "of it, else it is the identity.\n"
      "sensors:\n";
  size_t camera = 0;
  for (const NewSensor& s : rig.sensors) {
    out += sensor_text(tree, rig, s, camera);
    camera += s.type == "camera";
  }
  out += steps_text(tree, rig);
  const size_t at = out.find(kReplace);
  if (out.find("GUESS", at + kReplace.size()) == std::string::npos) out.erase(at, kReplace.size());
  return out;
}

}  // namespace kincal
