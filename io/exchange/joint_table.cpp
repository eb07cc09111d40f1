#include "joint_table.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/names.h"
#include "../rig/samples_file.h"
#include "poses.h"
#include "read_table.h"

namespace kincal {
namespace {

std::optional<double> as_number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != 0 || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// A file name as it is written on any system.
std::string with_slashes(std::string name) {
  std::replace(name.begin(), name.end(), '\\', '/');
  return name;
}

bool names_image(const std::string& column) {
  const std::string low = lower_case(column);
  return low == "image" || low == "file" || low == "filename" || low == "id";
}

bool names_time(const std::string& column) {
  const std::string low = lower_case(column);
  return low == "time" || low == "timestamp";
}

bool is_one_of(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Of names beside readings: one that is no joint's, while a joint with nearly that name has no
/// reading, is misspelt. Others may be of the gripper, or no joints.
void check_spelling(const std::vector<std::string>& names, const std::vector<std::string>& joints,
                    const std::string& where) {
  std::vector<std::string> without;
  for (const std::string& joint : joints)
    if (!is_one_of(names, joint)) without.push_back(joint);
  for (const std::string& name : names)
    if (!is_one_of(joints, name))
      if (const std::string nearest = nearest_names(name, without); !nearest.empty())
        throw InputError(where + ": there is no joint '" + name + "'" + nearest +
                         "; the robot has: " + comma_separated(joints));
}

/// The columns of UR's recorder of real-time data, in the order of the robot's joints.
void take_recorded_by_ur(const Table& table, const std::vector<std::string>& joints,
                         std::vector<std::string>& columns, std::vector<std::string>& notes) {
  constexpr size_t kAxes = 6;
  if (joints.size() != kAxes) return;
  std::vector<int> at;
  for (size_t i = 0; i < kAxes; ++i)
    at.push_back(column_of(table, "actual_q_" + std::to_string(i)));
  if (std::count(at.begin(), at.end(), -1) > 0) return;
  for (size_t i = 0; i < kAxes; ++i) columns[at[i]] = joints[i];
  notes.push_back(table.path + ": actual_q_0 to actual_q_5 are used as the joints " +
                  comma_separated(joints) + ", in this order");
}

JointRow row_of_cells(const Table& table, const TableRow& cells,
                      const std::vector<std::string>& joints, const Rig& rig,
                      const JointWords& words) {
  JointRow row;
  row.where = cells.where;
  for (size_t i = 0; i < cells.cells.size(); ++i) {
    if (!joints[i].empty()) continue;
    const std::string& name = table.header[i];
    if (names_image(name) && (row.image.empty() || lower_case(name) != "id"))
      row.image = with_slashes(cells.cells[i]);
    if (names_time(name)) row.time = number_of(cells, static_cast<int>(i), "time");
  }
  row.joints = readings_of(cells, joints, rig, words);
  return row;
}

JointRow row_of_json(const std::string& line, const std::vector<std::string>& joints,
                     const std::string& path, int number) {
  const std::string where = path + ":" + std::to_string(number);
  parse_json(line, path, number);  // refuses a key that is there twice
  const auto json = nlohmann::json::parse(line, nullptr, false);
  if (!json.is_object() || !json.contains("joints") || !json["joints"].is_object())
    throw InputError(where + ": {\"image\" or \"time\", \"joints\": {...}} is expected");
  JointRow row;
  row.where = where;
  for (const char* key : {"id", "file", "image"})
    if (json.contains(key) && json[key].is_string())
      row.image = with_slashes(json[key].get<std::string>());
  if (json.contains("time") && json["time"].is_number()) row.time = json["time"].get<double>();
  for (const auto& [name, value] : json["joints"].items()) {
    if (value.is_object()) {
      const Node node = parse_json(value.dump(), path, number);
      row.poses[name] = read_pose_reading({&node, &path, "joints." + name});
    } else if (value.is_number()) {
      row.joints[name] = value.get<double>();
    } else {
      throw InputError(where + ": joints." + name +
                       ": a number is expected, or a pose {\"xyz\", \"quat\"}");
    }
  }
  std::vector<std::string> names;
  for (const auto& [name, value] : json["joints"].items()) names.push_back(name);
  check_spelling(names, joints, where);
  return row;
}

const std::string kJointPrefix = "joint/";  // of a column, where others have the joint's name

/// How well a name in a table is that of an image: 0 not at all.
int likeness(const std::string& named, const std::filesystem::path& image) {
  const std::filesystem::path path(named);
  const auto low = [](std::string text) {
    for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return text;
  };
  const std::string name = path.filename().string(), full = image.generic_string();
  if (name.empty()) return 0;
  const bool ends = full.size() > named.size() && full[full.size() - named.size() - 1] == '/' &&
                    full.compare(full.size() - named.size(), named.size(), named) == 0;
  if (named == full || (ends && path.has_parent_path())) return 6;
  if (name == image.filename()) return 5;
  if (name == image.stem()) return 4;
  if (low(name) == low(image.filename().string())) return 3;
  if (low(name) == low(image.stem().string())) return 2;
  const std::string ending = path.extension().string();
  const bool a_file = ending.size() > 1 && std::isalpha(static_cast<unsigned char>(ending[1]));
  return a_file && low(path.stem().string()) == low(image.stem().string()) ? 1 : 0;
}

bool same_readings(const JointRow& a, const JointRow& b) {
  const auto same = [](const auto& x, const auto& y) {
    return x.first == y.first && x.second.translation == y.second.translation &&
           x.second.rotation == y.second.rotation;
  };
  return a.joints == b.joints && a.poses.size() == b.poses.size() &&
         std::equal(a.poses.begin(), a.poses.end(), b.poses.begin(), same);
}

bool renamed(const JointWords& words, const std::string& column) {
  return std::any_of(words.names.begin(), words.names.end(),
                     [&](const auto& pair) { return pair.second == column; });
}

/// JSON objects, one a line; no list and no frames of a KUKA program.
bool has_json_lines(const std::string& path) {
  const std::string text = read_file(path);
  const size_t open = text.find_first_not_of(" \t\r\n");
  const size_t inside =
      open == std::string::npos ? open : text.find_first_not_of(" \t\r\n", open + 1);
  return inside != std::string::npos && text[open] == '{' && text[inside] == '"';
}

/// Rows go by their names and times, or all of them by their order.
void refuse_half_named(const std::vector<JointRow>& rows) {
  const auto unnamed = [](const JointRow& row) { return row.image.empty() && !row.time; };
  const auto first = std::find_if(rows.begin(), rows.end(), unnamed);
  if (first != rows.end() && !std::all_of(rows.begin(), rows.end(), unnamed))
    throw InputError(first->where +
                     ": `image` (a file name) or `time` is expected, as in other "
                     "rows");
}

}  // namespace

std::vector<std::string> joints_with_readings(const Rig& rig) {
  std::vector<std::string> out;
  for (const Joint& joint : rig.tree.joints)
    if (joint.has_reading()) out.push_back(joint.name);
  return out;
}

void rename_columns(Table& table, const std::map<std::string, std::string>& names,
                    const std::vector<std::string>& joints) {
  std::vector<std::string> valid = joints;
  for (const std::string& joint : joints) valid.push_back(kJointPrefix + joint);
  for (const char* name : {"image", "time", "id", "point"}) valid.emplace_back(name);
  for (const PoseFormat& format : pose_formats())
    for (const std::string& column : format.columns)
      if (!is_one_of(valid, column)) valid.push_back(column);
  std::map<std::string, std::string> left = names;
  for (std::string& column : table.header)
    if (const auto found = names.find(column); found != names.end()) {
      if (!is_one_of(valid, found->second))
        throw InputError("--map: '" + found->second + "' is neither a joint nor a column that " +
                         "has a meaning" + nearest_names(found->second, valid) +
                         "; joints: " + comma_separated(joints));
      column = found->second;
      left.erase(found->first);
    }
  if (!left.empty())
    throw InputError("--map: there is no column '" + left.begin()->first + "' in " + table.path +
                     nearest_names(left.begin()->first, table.header) +
                     "; valid: " + comma_separated(table.header));
}

std::vector<std::string> joints_of_columns(const Table& table, const Rig& rig,
                                           const JointWords& words,
                                           std::vector<std::string>& notes) {
  const std::vector<std::string> joints = joints_with_readings(rig);
  const std::string where = table.where;
  std::vector<std::string> out(table.header.size());
  std::map<std::string, std::string> column_of_joint;
  for (size_t i = 0; i < table.header.size(); ++i) {
    const std::string& name = table.header[i];
    for (const std::string& joint : joints)
      if (name == kJointPrefix + joint ||
          (name == joint && !is_one_of(table.header, kJointPrefix + joint)))
        out[i] = joint;
    const bool used = !out[i].empty() || names_image(name) || names_time(name);
    const std::string what = out[i].empty() ? lower_case(name) : out[i];
    if (used && !column_of_joint.emplace(what, name).second)
      throw InputError(where + ": there are two columns '" + what + "'; " +
                       (out[i].empty()
                            ? "leave one out"
                            : "leave one out, or call that of the joint '" + kJointPrefix + what +
                                  "' (--map COLUMN=" + kJointPrefix + what + ")"));
  }
  if (std::all_of(out.begin(), out.end(), [](const std::string& name) { return name.empty(); }))
    take_recorded_by_ur(table, joints, out, notes);
  std::vector<std::string> named = out;
  for (size_t i = 0; i < out.size(); ++i)
    if (out[i].empty() && !renamed(words, table.header[i])) named.push_back(table.header[i]);
  check_spelling(named, joints, where);
  return out;
}

std::map<std::string, double> readings_of(const TableRow& row,
                                          const std::vector<std::string>& joints, const Rig& rig,
                                          const JointWords& words) {
  std::map<std::string, double> out;
  for (size_t i = 0; i < joints.size(); ++i) {
    if (joints[i].empty()) continue;
    const double value = number_of(row, static_cast<int>(i), joints[i]);
    const Joint& joint = rig.tree.joints[rig.tree.find_joint(joints[i])];
    out[joints[i]] = joint.type == JointType::prismatic ? value * words.length
                     : words.degrees                    ? value * kPi / 180
                                                        : value;
  }
  return out;
}

JointTable read_joint_table(const std::string& path, const Rig& rig, const JointWords& words) {
  const std::vector<std::string> joints = joints_with_readings(rig);
  JointTable out;
  if (has_json_lines(path)) {
    std::istringstream in(read_file(path));
    std::string line;
    for (int number = 1; std::getline(in, line); ++number)
      if (line.find_first_not_of(" \t\r") != std::string::npos)
        out.rows.push_back(row_of_json(line, joints, path, number));
  } else {
    Table table = read_table(path);
    rename_columns(table, words.names, joints);
    if (table.header.empty())
      throw InputError(table.where +
                       ": a header is expected: `image` (file names) or `time`, and the joints' "
                       "names: " +
                       comma_separated(joints));
    const std::vector<std::string> columns = joints_of_columns(table, rig, words, out.notes);
    if (std::all_of(columns.begin(), columns.end(),
                    [](const std::string& name) { return name.empty(); }))
      throw InputError(table.where + ": no column is a joint with a reading; " +
                       (joints.empty() ? "the robot has none: is it a table of poses "
                                         "(--pose-format)?"
                                       : "the robot has: " + comma_separated(joints) +
                                             " (--map COLUMN=JOINT where a column is called "
                                             "differently)"));
    for (const TableRow& row : table.rows)
      out.rows.push_back(row_of_cells(table, row, columns, rig, words));
  }
  refuse_half_named(out.rows);
  return out;
}

JointTable read_flange_table(const std::string& path, const std::string& pose_format_name,
                             const std::string& unit) {
  JointTable out;
  for (const FlangePose& one :
       read_flange_poses(path, pose_format(pose_format_name), pose_unit(unit))) {
    const std::string& name = one.image.empty() ? one.id : one.image;
    out.rows.push_back({with_slashes(name), one.where, one.time, {}, {}});
    out.rows.back().poses["flange"] = one.pose;
  }
  refuse_half_named(out.rows);
  return out;
}

std::map<std::string, std::string> joint_names(const std::vector<std::string>& pairs) {
  std::map<std::string, std::string> out;
  for (const std::string& pair : pairs) {
    const size_t equal = pair.find('=');
    if (equal == std::string::npos || equal == 0 || equal + 1 == pair.size())
      throw InputError("--map: COLUMN=JOINT is expected, for example A1=joint_1, not '" + pair +
                       "'");
    if (!out.emplace(pair.substr(0, equal), pair.substr(equal + 1)).second)
      throw InputError("--map: the column '" + pair.substr(0, equal) + "' is there twice");
  }
  return out;
}

bool angles_in_degrees(const std::string& unit) {
  if (!unit.empty() && unit != "rad" && unit != "deg")
    throw InputError("--angles: 'rad' or 'deg' is expected, not '" + unit + "'");
  return unit == "deg";
}

const JointRow* row_of_image(const std::vector<JointRow>& rows, const std::string& image,
                             double tolerance) {
  const std::filesystem::path path(image);
  const JointRow* named = nullptr;
  int best = 0;
  for (const JointRow& row : rows) {
    const int like = likeness(row.image, path);
    if (like == 0 || like < best) continue;
    if (like == best && !same_readings(row, *named))
      throw InputError(row.where + ": other readings for image '" + image + "' than " +
                       named->where + " has");
    if (like > best) named = &row;
    best = like;
  }
  if (named) return named;
  std::optional<double> time = as_number(path.stem().string());
  if (!time) return nullptr;
  if (*time > 1e15) *time *= 1e-9;
  const JointRow* nearest = nullptr;
  for (const JointRow& row : rows)
    if (row.time && (!nearest || std::abs(*row.time - *time) < std::abs(*nearest->time - *time)))
      nearest = &row;
  return nearest && std::abs(*nearest->time - *time) <= tolerance ? nearest : nullptr;
}

}  // namespace kincal
