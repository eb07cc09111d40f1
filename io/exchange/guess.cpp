#include "guess.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "../document/document.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "foreign.h"
#include "number_lists.h"
#include "pose_samples.h"
#include "read_table.h"

namespace kincal {
namespace {

/// Farther than any joint's reading in rad, so degrees (or pulses).
constexpr double kLargestRadians = 2 * kPi;
/// Farther than any joint turns in degrees, so pulses.
constexpr double kLargestDegrees = 1000;
constexpr size_t kLookedAt = 1000;  // rows

std::string counted(size_t count, const std::string& what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

std::string row_text(const TableRow& row) {
  std::string out = "  " + row.where.substr(row.where.rfind('/') + 1) + ": ";
  for (size_t i = 0; i < row.cells.size() && i < 20; ++i)
    out += (i > 0 ? "  " : "") + (row.cells[i].empty() ? std::string("-") : row.cells[i]);
  return out + (row.cells.size() > 20 ? "  ..." : "") + "\n";
}

std::string pose_text(const Pose& pose) {
  const std::array<double, 7> n = pose_numbers(pose);
  std::string out = "    as a pose: x y z ";
  for (int i = 0; i < 3; ++i) out += rounded(n[i], 6) + " ";
  out += "m, quaternion ";
  for (int i = 3; i < 7; ++i) out += rounded(n[i], 6) + (i < 6 ? " " : "");
  return out + "\n";
}

/// The formats that rows may have by their columns and numbers.
std::vector<const PoseFormat*> possible_formats(const Table& table) {
  std::vector<const PoseFormat*> out;
  if (!table.format.empty()) return {&pose_format(table.format)};
  const bool named = likely_format(table) != nullptr;
  if (!table.header.empty() && !named) return {};
  std::vector<const PoseFormat*> far;  // by which a pose is farther away than robots reach
  Table head = table;
  if (head.rows.size() > kLookedAt) head.rows.resize(kLookedAt);
  for (const PoseFormat& format : pose_formats()) {
    if (named && pose_columns(table, format, "").empty() && !is_matrices(table)) continue;
    try {
      std::vector<Pose> poses;
      for (const FlangePose& one : poses_of(head, format, 0)) poses.push_back(one.pose);
      (doubt_of_unit(table.path, poses).empty() ? out : far).push_back(&format);
    } catch (const InputError&) {  // the numbers are none of this format
    }
  }
  return out.empty() ? far : out;
}

std::string format_names(const std::vector<const PoseFormat*>& formats) {
  std::vector<std::string> names;
  for (const PoseFormat* format : formats) names.push_back(format->name);
  return comma_separated(names);
}

/// What a table is, with its first two rows as they are read.
std::string table_text(const Table& table, const std::vector<const PoseFormat*>& formats) {
  std::string out = table.path + ": " + table.kind + ", " + counted(table.rows.size(), "row") +
                    " of " + counted(table.columns(), "column") +
                    (table.header.empty() ? "" : ": " + comma_separated(table.header)) + "\n";
  Table head = table;
  head.rows.resize(std::min<size_t>(2, head.rows.size()));
  std::vector<FlangePose> poses;
  if (!formats.empty()) poses = poses_of(head, *formats[0], 0);
  for (size_t i = 0; i < head.rows.size(); ++i) {
    out += row_text(head.rows[i]);
    if (!poses.empty()) out += pose_text(poses[i].pose);
  }
  return out;
}

std::string pose_guess(const Table& table, const std::vector<const PoseFormat*>& formats,
                       const std::string& file) {
  const bool said = !table.format.empty() || is_matrices(table);
  std::string out = formats.size() == 1
                        ? "It seems to have poses (" + formats[0]->name + ").\n"
                        : "It may have poses. The columns suit " + format_names(formats) +
                              "; above they are read as " + formats[0]->name +
                              ".\n"
                              "See the robot's manual for the right one; `kincal check` detects a "
                              "wrong choice.\n";
  const std::string format =
      said ? "" : " --pose-format " + (formats.size() == 1 ? formats[0]->name : "FORMAT");
  return out + "With images of a board, one for each row:\n  kincal detect RIG IMAGES --joints " +
         file + " --pose-format " + (formats.size() == 1 ? formats[0]->name : "FORMAT") +
         " --out samples.jsonl\nWith other files that have one pose of the board in the camera for "
         "each row:\n"
         "  kincal import " +
         file + format + " --target-poses FILE... --setup eye_in_hand --out hand_eye\n";
}

std::string reading_guess(const Table& table, const std::string& file) {
  bool degrees = false;
  std::string too_large;  // columns
  for (size_t i = 0; i < table.header.size(); ++i) {
    double largest = 0;
    for (const TableRow& row : table.rows)
      if (double value = 0; i < row.cells.size() && read_number(row.cells[i], value))
        largest = std::max(largest, std::abs(value));
    degrees = degrees || (largest > kLargestRadians && largest < kLargestDegrees);
    if (largest >= kLargestDegrees) too_large += (too_large.empty() ? "" : ", ") + table.header[i];
  }
  std::string out = "It may have readings of joints";
  if (degrees) out += ", in degrees, as some are larger than 6.28";
  if (!too_large.empty())
    out += "; too large for angles are values of " + too_large +
           ": readings in pulses need a `scale` of the joint in the rig (rad per pulse), lengths "
           "in millimetres --unit mm";
  const std::string angles = degrees ? " --angles deg" : "";
  return out +
         ".\nWith images of a board, one for each row:\n  kincal detect RIG IMAGES --joints " +
         file + angles +
         " --out samples.jsonl\n"
         "With measurements in separate columns (x, y, z; or a pose):\n"
         "  kincal import " +
         file + " --rig RIG --sensor NAME --target NAME" + angles +
         " --out samples.jsonl\n"
         "A column whose name differs from the rig's joint: --map COLUMN=JOINT\n";
}

constexpr const char* kPairs =
    "It seems to have two poses in each row: the flange's in the robot's base, and the board's in "
    "the camera\n(or the reflector's in the tracker). Then:\n";

std::string pair_command(const std::string& files) {
  return "  kincal import " + files +
         " --setup eye_in_hand --out hand_eye\n"
         "(--setup eye_to_hand where the camera stands beside the robot)\n";
}

/// Whether a file is a camera's, which may have poses of the camera besides.
bool has_camera(const Node& node) {
  for (const char* key : {"intrinsics", "camera_matrix", "cameraMatrix", "distortion_model",
                          "camera_model", "model_type", "distortion_coeffs", "lensmodel"})
    if (node.find(key)) return true;
  return std::any_of(node.members.begin(), node.members.end(),
                     [](const auto& member) { return has_camera(member.second); });
}

/// A file's name without the number at its end, with the ending: pose_fPe_*.yaml.
std::string pattern_of(const std::string& path) {
  const std::filesystem::path p(path);
  std::string stem = p.stem().string();
  stem.resize(stem.find_last_not_of("0123456789") + 1);
  return (p.parent_path() / (stem + "*")).string() + p.extension().string();
}

}  // namespace

bool is_table(const std::string& path) {
  const std::string ending = lower_case(std::filesystem::path(path).extension().string());
  if (ending == ".xml") return false;
  std::vector<Table> tables;
  try {
    tables = read_tables(path);
  } catch (const InputError&) {  // its reader names the mistake
    return ending == ".csv" || ending == ".tsv";
  }
  if (!has_number_lists(read_file(path), path)) return true;
  if (has_camera(read_any_tree(path))) return false;
  return std::any_of(tables.begin(), tables.end(), [](const Table& table) {
    return !table.format.empty() || is_matrices(table) || likely_format(table) ||
           (table.rows.size() > 2 && table.columns() >= 6);
  });
}

std::string guess_text(const std::vector<std::string>& files) {
  std::string out;
  if (files.size() == 1) {
    const std::vector<Table> tables = read_tables(files[0]);
    for (const Table& table : tables) {
      const std::vector<const PoseFormat*> formats = possible_formats(table);
      out += table_text(table, formats);
      if (tables.size() == 2) continue;
      if (has_pairs({table}))
        out += kPairs + pair_command(files[0] + " --pose-format FORMAT");
      else
        out +=
            formats.empty() ? reading_guess(table, files[0]) : pose_guess(table, formats, files[0]);
    }
    if (tables.size() == 2)
      out += "If the first list is of the flange, and the second of the board in the camera:\n" +
             pair_command(files[0]);
    return out;
  }
  std::map<std::string, std::vector<std::string>> groups;
  for (const std::string& file : files) groups[pattern_of(file)].push_back(file);
  std::vector<std::string> patterns;
  for (const auto& [pattern, members] : groups) {
    const Table first = read_table(members[0]);
    const std::vector<const PoseFormat*> formats = possible_formats(first);
    out += counted(members.size(), "file") + " " + pattern +
           "; the first: " + table_text(first, formats);
    if (groups.size() == 1 && !formats.empty()) out += pose_guess(first, formats, pattern);
    patterns.push_back(pattern);
  }
  if (patterns.size() == 2) {
    const bool second_is_flange = patterns[1].find("fPe") != std::string::npos;  // ViSP's name
    out +=
        "If " + patterns[second_is_flange] + " are poses of the flange, and " +
        patterns[!second_is_flange] + " of the board in the camera:\n" +
        pair_command(patterns[second_is_flange] + " --target-poses " + patterns[!second_is_flange]);
  }
  return out;
}

}  // namespace kincal
