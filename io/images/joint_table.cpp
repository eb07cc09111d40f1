#include "joint_table.h"

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/json.h"
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

std::vector<std::string> cells_of(std::string line) {
  if (!line.empty() && line.back() == '\r') line.pop_back();
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) {
    const size_t begin = cell.find_first_not_of(" \t\""), end = cell.find_last_not_of(" \t\"");
    cells.push_back(begin == std::string::npos ? "" : cell.substr(begin, end - begin + 1));
  }
  return cells;
}

JointRow row_of_cells(const std::vector<std::string>& names, const std::vector<std::string>& cells,
                      const std::string& where) {
  if (cells.size() != names.size())
    throw InputError(where + ": " + std::to_string(cells.size()) + " cells, the header has " +
                     std::to_string(names.size()));
  JointRow row;
  for (size_t i = 0; i < cells.size(); ++i) {
    if (names[i] == "image" || names[i] == "file" || names[i] == "id") {
      row.image = std::filesystem::path(cells[i]).filename().string();
      continue;
    }
    const std::optional<double> value = as_number(cells[i]);
    if (!value)
      throw InputError(where + ": " + names[i] + ": a number is expected, not '" + cells[i] + "'");
    if (names[i] == "time")
      row.time = value;
    else
      row.joints[names[i]] = *value;
  }
  return row;
}

JointRow row_of_json(const std::string& line, const std::string& path, int number) {
  const std::string where = path + ":" + std::to_string(number);
  const auto json = nlohmann::json::parse(line, nullptr, false);
  if (!json.is_object() || !json.contains("joints") || !json["joints"].is_object())
    throw InputError(where + ": {\"image\" or \"time\", \"joints\": {...}} is expected");
  JointRow row;
  for (const char* key : {"id", "file", "image"})
    if (json.contains(key) && json[key].is_string())
      row.image = std::filesystem::path(json[key].get<std::string>()).filename().string();
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
  return row;
}

}  // namespace

std::vector<JointRow> read_joint_table(const std::string& path) {
  std::istringstream in(read_file(path));
  std::vector<JointRow> rows;
  std::vector<std::string> names;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = path + ":" + std::to_string(number);
    if (names.empty() && line[line.find_first_not_of(" \t")] == '{')
      rows.push_back(row_of_json(line, path, number));
    else if (names.empty())
      names = cells_of(line);
    else
      rows.push_back(row_of_cells(names, cells_of(line), where));
  }
  if (rows.empty()) throw InputError(path + ": no joint readings in it");
  for (const JointRow& row : rows)
    if (row.image.empty() && !row.time)
      throw InputError(path + ": a column `image` (file names) or `time` is expected");
  return rows;
}

std::vector<JointRow> read_flange_table(const std::string& path,
                                        const std::string& pose_format_name,
                                        const std::string& unit) {
  std::vector<JointRow> rows;
  for (const FlangePose& one :
       read_flange_poses(path, pose_format(pose_format_name), pose_unit(unit))) {
    const std::string& name = one.image.empty() ? one.id : one.image;
    rows.push_back({std::filesystem::path(name).filename().string(), one.time, {}, {}});
    rows.back().poses["flange"] = one.pose;
    if (name.empty() && !one.time)
      throw InputError(path + ": a column `image` (file names) or `time` is expected");
  }
  return rows;
}

const JointRow* row_of_image(const std::vector<JointRow>& rows, const std::string& image,
                             double tolerance) {
  const std::filesystem::path path(image);
  const std::string name = path.filename().string(), stem = path.stem().string();
  for (const JointRow& row : rows)
    if (!row.image.empty() && (row.image == name || row.image == stem)) return &row;
  std::optional<double> time = as_number(stem);
  if (!time) return nullptr;
  if (*time > 1e15) *time *= 1e-9;
  const JointRow* nearest = nullptr;
  for (const JointRow& row : rows)
    if (row.time && (!nearest || std::abs(*row.time - *time) < std::abs(*nearest->time - *time)))
      nearest = &row;
  return nearest && std::abs(*nearest->time - *time) <= tolerance ? nearest : nullptr;
}

}  // namespace kincal
