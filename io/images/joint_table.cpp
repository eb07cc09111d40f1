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
#include "../exchange/poses.h"
#include "../rig/samples_file.h"

namespace kincal {
namespace {

std::optional<double> as_number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != 0 || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// What stands between the cells of a table, by its header.
char separator_of(const std::string& header) {
  for (const char c : {'\t', ';'})
    if (header.find(c) != std::string::npos) return c;
  return ',';
}

std::vector<std::string> cells_of(std::string line, char separator) {
  if (!line.empty() && line.back() == '\r') line.pop_back();
  if (!line.empty() && line.back() == separator) line += ' ';  // an empty cell is one
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, separator);) {
    const size_t begin = cell.find_first_not_of(" \t\""), end = cell.find_last_not_of(" \t\"");
    cells.push_back(begin == std::string::npos ? "" : cell.substr(begin, end - begin + 1));
  }
  return cells;
}

/// A file name as it is written on any system.
std::string with_slashes(std::string name) {
  std::replace(name.begin(), name.end(), '\\', '/');
  return name;
}

bool names_image(const std::string& column) {
  return column == "image" || column == "file" || column == "filename" || column == "id";
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

/// The columns: lower case where they say which image it is, else as they stand.
std::vector<std::string> columns_of(const std::string& line, char separator,
                                    const std::vector<std::string>& joints,
                                    const std::string& where) {
  std::vector<std::string> names = cells_of(line, separator);
  int readings = 0, images = 0;
  for (std::string& name : names) {
    std::string low = name;
    for (char& c : low) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    const bool joint = is_one_of(joints, name);
    readings += joint;
    if (!joint && (names_image(low) || low == "time")) name = low, ++images;
  }
  if (images == 0)
    throw InputError(where + ": a column `image` (file names) or `time` is expected in the header");
  if (readings == 0)
    throw InputError(where + ": no column is a joint with a reading; " +
                     (joints.empty() ? "the robot has none: is it a table of poses "
                                       "(--pose-format)?"
                                     : "the robot has: " + comma_separated(joints)));
  for (size_t i = 0; i < names.size(); ++i)
    if ((is_one_of(joints, names[i]) || names_image(names[i]) || names[i] == "time") &&
        std::find(names.begin(), names.begin() + static_cast<long>(i), names[i]) !=
            names.begin() + static_cast<long>(i))
      throw InputError(where + ": there are two columns '" + names[i] + "'; leave one out");
  check_spelling(names, joints, where);
  return names;
}

JointRow row_of_cells(const std::vector<std::string>& names, const std::vector<std::string>& cells,
                      const std::vector<std::string>& joints, const std::string& where) {
  if (cells.size() != names.size())
    throw InputError(where + ": " + std::to_string(cells.size()) + " cells, the header has " +
                     std::to_string(names.size()));
  JointRow row;
  row.where = where;
  for (size_t i = 0; i < cells.size(); ++i) {
    if (names_image(names[i])) {
      if (row.image.empty() || names[i] != "id") row.image = with_slashes(cells[i]);
      continue;
    }
    const std::optional<double> value = as_number(cells[i]);
    const bool joint = is_one_of(joints, names[i]);
    if (!value && (joint || names[i] == "time"))
      throw InputError(where + ": " + names[i] + ": a number is expected, like 0.25, not '" +
                       cells[i] + "'");
    if (names[i] == "time")
      row.time = value;
    else if (joint)  // all else is a comment
      row.joints[names[i]] = *value;
  }
  return row;
}

JointRow row_of_json(const std::string& line, const std::vector<std::string>& joints,
                     const std::string& path, int number) {
  const std::string where = path + ":" + std::to_string(number);
  parse_json(line, path, number);  // says what is there twice
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

}  // namespace

std::vector<JointRow> read_joint_table(const std::string& path,
                                       const std::vector<std::string>& joints) {
  std::istringstream in(read_file(path));
  std::vector<JointRow> rows;
  std::vector<std::string> names;
  std::string line;
  char separator = ',';
  for (int number = 1; std::getline(in, line); ++number) {
    if (number == 1 && line.compare(0, 3, "\xEF\xBB\xBF") == 0) line.erase(0, 3);  // of Excel
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = path + ":" + std::to_string(number);
    if (names.empty() && line[line.find_first_not_of(" \t")] == '{') {
      rows.push_back(row_of_json(line, joints, path, number));
    } else if (names.empty()) {
      separator = separator_of(line);
      names = columns_of(line, separator, joints, where);
    } else {
      rows.push_back(row_of_cells(names, cells_of(line, separator), joints, where));
    }
  }
  if (rows.empty()) throw InputError(path + ": no joint readings in it");
  for (const JointRow& row : rows)
    if (row.image.empty() && !row.time)
      throw InputError(row.where + ": `image` (a file name) or `time` is expected");
  return rows;
}

std::vector<JointRow> read_flange_table(const std::string& path,
                                        const std::string& pose_format_name,
                                        const std::string& unit) {
  std::vector<JointRow> rows;
  for (const FlangePose& one :
       read_flange_poses(path, pose_format(pose_format_name), pose_unit(unit))) {
    const std::string& name = one.image.empty() ? one.id : one.image;
    const std::string where = path + ": pose " + std::to_string(rows.size() + 1);
    rows.push_back({with_slashes(name), where, one.time, {}, {}});
    rows.back().poses["flange"] = one.pose;
    if (name.empty() && !one.time)
      throw InputError(path + ": a column `image` (file names) or `time` is expected");
  }
  return rows;
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
