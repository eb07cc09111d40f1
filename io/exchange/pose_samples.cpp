#include "pose_samples.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>

#include "../document/document.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../results/json_values.h"
#include "foreign.h"
#include "number_lists.h"
#include "read_table.h"

namespace kincal {
namespace {

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
std::vector<PosePair> hand_eye_pairs(const Field& file, bool in_hand) {
  std::vector<PosePair> out;
  if (file.node->kind == Node::Kind::sequence && is_moveit(*file.node)) {
    for (size_t i = 0; i < file.size(); ++i)
      out.push_back({"", matrix_of_field(file.item(i)["effector_wrt_world"]),
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
      out.push_back({"", robot(all.item(i)["robot"]), transform_of(all.item(i)["tracking"])});
    return out;
  }
  const Field hands = all["hand_world_samples"], markers = all["camera_marker_samples"];
  if (hands.size() != markers.size())
    markers.fail("as many transforms as hand_world_samples has are expected, " +
                 std::to_string(hands.size()) + ", not " + std::to_string(markers.size()));
  for (size_t i = 0; i < hands.size(); ++i)
    out.push_back({"", robot(hands.item(i)), transform_of(markers.item(i))});
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
         ".\n"
         "format: kincal/1\n"
         "robot: {base: base, flange: tool0}   # reports the poses of its flange\n"
         "# Noise of the poses, m and rad. If omitted, it is found from the data.\n"
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
         "    # Noise of the poses, m and rad: found from the data, unless it is stated without "
         "guess.\n"
         "    sigma: {guess: {translation: 0.001, rotation: 0.003}}\n";
}

// ------------------------------------------------------------------------------------------------
// pairs of poses
const std::string& name_of(const FlangePose& pose) {
  return pose.id.empty() ? pose.image : pose.id;
}

/// Poses by their names; empty where one has none. @throws InputError where two have the same
std::map<std::string, const FlangePose*> by_name(const std::vector<FlangePose>& poses) {
  std::map<std::string, const FlangePose*> out;
  for (const FlangePose& one : poses) {
    if (name_of(one).empty()) return {};
    const auto [other, fresh] = out.emplace(name_of(one), &one);
    if (!fresh)
      throw InputError(one.where + ": the name '" + name_of(one) + "' is that of " +
                       other->second->where + " already");
  }
  return out;
}

/// The number that a file's name ends with, 7 of pose_fPe_7.yaml; without one the whole name.
std::string number_at_end(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  const size_t last = stem.find_last_not_of("0123456789");
  if (last == std::string::npos) return stem;
  const std::string digits = stem.substr(last + 1);
  if (digits.empty()) return stem;
  return digits.substr(std::min(digits.find_first_not_of('0'), digits.size() - 1));  // 7 of 07
}

/// What stands in front of the columns of a second pose, and the format that both have; "": none.
std::pair<std::string, std::string> second_columns(const Table& table) {
  for (const PoseFormat& format : pose_formats()) {
    if (pose_columns(table, format, "").empty()) continue;
    for (const std::string& name : table.header) {
      const std::string low = lower_case(name), column = format.columns[0];
      if (low.size() <= column.size() ||
          low.compare(low.size() - column.size(), column.size(), column) != 0)
        continue;
      const std::string prefix = low.substr(0, low.size() - column.size());
      if (!pose_columns(table, format, prefix).empty()) return {prefix, format.name};
    }
  }
  return {};
}

}  // namespace

const PoseFormat& format_of_file(const Table& table, const PoseWords& words,
                                 const std::string& what) {
  if (!words.format.empty()) return pose_format(words.format);
  if (!table.format.empty()) return pose_format(table.format);
  if (is_matrices(table)) return pose_format("matrix");
  if (!pose_columns(table, pose_format("xyzw"), "").empty()) return pose_format("xyzw");
  std::vector<std::string> names;
  for (const PoseFormat& format : pose_formats()) names.push_back(format.name);
  throw InputError(
      table.path + ": " + what + " is missing: how " + std::to_string(table.columns()) +
      " numbers encode a pose is not stated in the file; valid: " + comma_separated(names) +
      " (see kincal import --help)");
}

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
  if (!has_number_lists(read_file(path), path)) return false;
  const Node node = read_any_tree(path);
  if (node.kind == Node::Kind::sequence)  // of easy_handeye also the list by itself
    return is_moveit(node) ||
           (!node.items.empty() && node.items[0].find("robot") && node.items[0].find("tracking"));
  return node.find("samples") || node.find("hand_world_samples");
}

std::vector<PosePair> read_hand_eye(const std::string& path, bool in_hand) {
  const Node node = read_any_tree(path);
  std::vector<PosePair> pairs = hand_eye_pairs(top(node, path), in_hand);
  if (pairs.empty()) throw InputError(path + ": no sample in it");
  return pairs;
}

std::vector<FlangePose> read_poses(const std::vector<std::string>& files, const PoseWords& words,
                                   const std::string& what) {
  std::vector<FlangePose> out;
  for (const std::string& file : files) {
    const Table table = read_table(file);
    std::vector<FlangePose> poses =
        poses_of(table, format_of_file(table, words, what), pose_unit(words.unit));
    if (files.size() > 1 && poses.size() != 1)
      throw InputError(file + ": one pose is expected, as there are " +
                       std::to_string(files.size()) + " files; it has " +
                       std::to_string(poses.size()));
    if (files.size() > 1) poses[0].id = number_at_end(file);
    std::move(poses.begin(), poses.end(), std::back_inserter(out));
  }
  return out;
}

std::vector<PosePair> pair_poses(const std::vector<FlangePose>& flange,
                                 const std::vector<FlangePose>& measured, std::string& note) {
  const std::map<std::string, const FlangePose*> named = by_name(measured);
  std::vector<PosePair> out;
  if (!by_name(flange).empty() && !named.empty()) {
    for (const FlangePose& one : flange) {
      const auto other = named.find(name_of(one));
      if (other == named.end())
        throw InputError(one.where + ": there is no measured pose of '" + name_of(one) + "'");
      out.push_back({name_of(one), one.pose, other->second->pose});
    }
    if (measured.size() > flange.size())
      throw InputError(measured[0].where + ": " + std::to_string(measured.size()) +
                       " measured poses, and " + std::to_string(flange.size()) +
                       " of the flange: each measured pose needs its own flange pose");
    note = "paired by name, from '" + out[0].id + "' to '" + out.back().id + "'";
    return out;
  }
  if (flange.size() != measured.size())
    throw InputError(measured[0].where + ": " + std::to_string(measured.size()) +
                     " measured poses, and " + std::to_string(flange.size()) +
                     " of the flange: without names they are paired in order, so there must be as "
                     "many");
  for (size_t i = 0; i < flange.size(); ++i) out.push_back({"", flange[i].pose, measured[i].pose});
  note = "paired by their order, because one of the lists has no names";
  return out;
}

bool has_pairs(const std::vector<Table>& tables) {
  if (tables.size() == 2) return true;
  if (tables.size() != 1) return false;
  const size_t cells = tables[0].columns();
  return !second_columns(tables[0]).second.empty() ||
         (tables[0].header.empty() && tables[0].format.empty() &&
          (cells == 14 || cells == 32 || cells == 24 || cells == 12 || cells == 13) &&
          !is_matrices(tables[0]));
}

std::vector<PosePair> pairs_of(const std::vector<Table>& tables, const PoseWords& flange,
                               const PoseWords& measured, std::string& note) {
  const double unit = pose_unit(flange.unit), other_unit = pose_unit(measured.unit);
  if (tables.size() == 2) {
    const auto poses = [&](const Table& table, const PoseWords& words, const char* option) {
      return poses_of(table, format_of_file(table, words, option), pose_unit(words.unit));
    };
    note = tables[0].name + " is used as the flange's poses, " + tables[1].name +
           " as the measured ones; ";
    std::string how;
    std::vector<PosePair> out = pair_poses(poses(tables[0], flange, "--pose-format"),
                                           poses(tables[1], measured, "--target-format"), how);
    note += how;
    return out;
  }
  const Table& table = tables[0];
  PoseWords words = flange, second_words = measured;
  const auto [prefix, likely] = second_columns(table);
  if (words.format.empty()) words.format = likely;
  if (second_words.format.empty()) second_words.format = words.format;
  const PoseFormat& first = format_of_file(table, words, "--pose-format");
  const PoseFormat& second = format_of_file(table, second_words, "--target-format");
  std::vector<int> columns = pose_columns(table, first, ""), others;
  if (!table.header.empty()) {
    others = pose_columns(table, second, prefix);
    if (columns.empty() || others.empty())
      throw InputError(table.where +
                       ": the columns of two poses are expected, the "
                       "flange's as --pose-format " +
                       first.name + " has them (" + comma_separated(first.columns) +
                       "), the measured pose's with something "
                       "in front (m" +
                       second.columns[0] + ", ...); there are " + comma_separated(table.header));
    note = "the measured poses are those in the columns that begin with '" + prefix + "'";
  } else {
    const size_t count = first.columns.size() + second.columns.size();
    const size_t begin = table.columns() == count + 1 ? 1 : 0;
    if (table.columns() != count + begin)
      throw InputError(table.where + ": " + std::to_string(count) +
                       " numbers of two poses (--pose-format " + first.name + ", --target-format " +
                       second.name +
                       ") are expected, or a name and "
                       "these; there are " +
                       std::to_string(table.columns()) + " cells");
    for (size_t i = begin; i < table.columns(); ++i)
      (i < begin + first.columns.size() ? columns : others).push_back(static_cast<int>(i));
    note = "the first pose of each row is used as the flange's, the second as the measured one";
  }
  const std::vector<FlangePose> poses = poses_of_columns(table, first, unit, columns),
                                seen = poses_of_columns(table, second, other_unit, others);
  std::vector<PosePair> out;
  for (size_t i = 0; i < poses.size(); ++i)
    out.push_back({name_of(poses[i]), poses[i].pose, seen[i].pose});
  return out;
}

HandEyeFiles hand_eye_files(const std::string& from, const std::vector<PosePair>& pairs,
                            bool in_hand) {
  HandEyeFiles out;
  out.rig_yaml = hand_eye_rig(from, in_hand);
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!pairs[i].base_T_flange.translation.allFinite() ||
        !pairs[i].sensor_T_target.translation.allFinite())
      throw InputError(from + ": a position is too large");
    Json line;
    line["id"] = pairs[i].id.empty() ? numbered("sample_", i) : pairs[i].id;
    line["joints"]["flange"] = pose(pairs[i].base_T_flange);
    line["views"] = Json::array(
        {{{"sensor", "camera"}, {"target", "board"}, {"pose", pose(pairs[i].sensor_T_target)}}});
    out.samples_jsonl += line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  }
  return out;
}

}  // namespace kincal
