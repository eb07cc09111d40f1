#include "pose_samples.h"

#include <algorithm>
#include <filesystem>

#include "../document/document.h"
#include "../results/json_values.h"
#include "foreign.h"

namespace kincal {
namespace {

struct PosePair {
  Pose base_T_flange, sensor_T_target;
};

/// A geometry_msgs/Transform.
Pose transform_of(const Field& field) {
  const Field t = field["translation"], q = field["rotation"];
  const Eigen::Vector4d xyzw(q["x"].number(), q["y"].number(), q["z"].number(), q["w"].number());
  if (!(std::abs(xyzw.norm() - 1) < 1e-2))
    q.fail("a quaternion of length 1 is expected, not of " + std::to_string(xyzw.norm()));
  return {rotation_from_quaternion(xyzw),
          Vector3d(t["x"].number(), t["y"].number(), t["z"].number())};
}

Pose matrix_of_field(const Field& field) { return pose_of_matrix(field.vector(16), field.where()); }

/// Whether a list has samples of MoveIt Calibration.
bool is_moveit(const Node& list) {
  return !list.items.empty() && list.items[0].find("effector_wrt_world");
}

/// Returns the samples as the file has them. easy_handeye stores flange_T_base where the camera
/// stands beside the robot.
std::vector<PosePair> pairs_of(const Field& file, bool in_hand) {
  std::vector<PosePair> out;
  if (file.node->kind == Node::Kind::sequence && is_moveit(*file.node)) {
    for (size_t i = 0; i < file.size(); ++i)
      out.push_back({matrix_of_field(file.item(i)["effector_wrt_world"]),
                     matrix_of_field(file.item(i)["object_wrt_sensor"])});
    return out;
  }
  const auto robot = [&](const Field& field) {
    return in_hand ? transform_of(field) : inverse(transform_of(field));
  };
  const bool list = file.node->kind == Node::Kind::sequence;
  const Field all = !list && file.has("samples") ? file["samples"] : file;
  if (all.node->kind == Node::Kind::sequence) {
    for (size_t i = 0; i < all.size(); ++i)
      out.push_back({robot(all.item(i)["robot"]), transform_of(all.item(i)["tracking"])});
    return out;
  }
  const Field hands = all["hand_world_samples"], markers = all["camera_marker_samples"];
  if (hands.size() != markers.size())
    markers.fail("as many transforms as hand_world_samples has are expected, " +
                 std::to_string(hands.size()) + ", not " + std::to_string(markers.size()));
  for (size_t i = 0; i < hands.size(); ++i)
    out.push_back({robot(hands.item(i)), transform_of(markers.item(i))});
  return out;
}

std::string numbered(const std::string& name, size_t i) {
  std::string number = std::to_string(i + 1);
  number.insert(0, number.size() < 3 ? 3 - number.size() : 0, '0');
  return name + number;
}

std::string hand_eye_rig(const std::string& path, bool in_hand) {
  const std::string camera = in_hand ? "tool0" : "base", board = in_hand ? "base" : "tool0";
  return "# Made by `kincal import` from " + std::filesystem::path(path).filename().string() +
         ".\n# What is marked GUESS is to be replaced by what you know.\n"
         "format: kincal/1\n"
         "robot: {base: base, flange: tool0}   # known by the poses of its flange\n"
         "# Noise of the poses, m and rad. Left away, it is found from the data.\n"
         "# joints: {flange: {sigma: {translation: 0.0001, rotation: 0.0002}}}\n"
         "targets:\n"
         "  board:\n"
         "    type: points\n"
         "    points: [[0, 0, 0]]              # the frame of the board: it is seen as a whole "
         "pose\n"
         "    mount: {link: " +
         board +
         "}              # its pose there is found from the data\n"
         "sensors:\n"
         "  camera:\n"
         "    type: pose\n"
         "    link: " +
         camera +
         "                      # likewise\n"
         "    sigma: {translation: 0.001, rotation: 0.003}   # GUESS: m, rad\n";
}

}  // namespace

std::string flange_lines(const std::vector<FlangePose>& poses, const std::string& sensor,
                         const std::string& target) {
  std::string out;
  for (size_t i = 0; i < poses.size(); ++i) {
    const FlangePose& one = poses[i];
    Json line;
    line["id"] = !one.id.empty()      ? one.id
                 : !one.image.empty() ? std::filesystem::path(one.image).stem().string()
                                      : numbered("pose_", i);
    if (one.time) line["time"] = *one.time;
    line["joints"]["flange"] = pose(one.pose);
    if (!sensor.empty()) {
      Json view = {{"sensor", sensor}, {"target", target}};
      if (!one.image.empty()) view["image"] = one.image;
      line["views"] = Json::array({view});
    } else if (!one.image.empty()) {
      line["image"] = one.image;
    }
    out += line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  }
  return out;
}

bool is_hand_eye(const std::string& path) {
  const Node node = read_foreign(path);
  if (node.kind == Node::Kind::sequence)  // of easy_handeye also the list by itself
    return is_moveit(node) ||
           (!node.items.empty() && node.items[0].find("robot") && node.items[0].find("tracking"));
  return node.find("samples") || node.find("hand_world_samples");
}

HandEyeFiles read_hand_eye(const std::string& path, bool in_hand) {
  const Node node = read_foreign(path);
  const std::vector<PosePair> pairs = pairs_of(top(node, path), in_hand);
  for (const PosePair& pair : pairs)
    if (!pair.base_T_flange.translation.allFinite())
      throw InputError(path + ": a position is too large");
  if (pairs.empty()) throw InputError(path + ": no sample in it");
  HandEyeFiles out;
  out.count = static_cast<int>(pairs.size());
  out.rig_yaml = hand_eye_rig(path, in_hand);
  for (size_t i = 0; i < pairs.size(); ++i) {
    Json line;
    line["id"] = numbered("sample_", i);
    line["joints"]["flange"] = pose(pairs[i].base_T_flange);
    line["views"] = Json::array(
        {{{"sensor", "camera"}, {"target", "board"}, {"pose", pose(pairs[i].sensor_T_target)}}});
    out.samples_jsonl += line.dump() + "\n";
  }
  return out;
}

}  // namespace kincal
