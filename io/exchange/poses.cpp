#include "poses.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "../document/error.h"
#include "../document/files.h"
#include "../document/kinds.h"
#include "../document/names.h"
#include "../document/numbers.h"

namespace kincal {
namespace {

constexpr double kDegree = kPi / 180;
constexpr double kFarthestFlange = 20;  // m: no robot reaches so far
constexpr double kRound = 1e-2;         // how far from a rotation rounded numbers may be

using Row = std::vector<double>;
using Cells = std::vector<std::string>;

Matrix3d from_xyzw(const Row& n) { return rotation_from_quaternion({n[3], n[4], n[5], n[6]}); }
Matrix3d from_wxyz(const Row& n) { return rotation_from_quaternion({n[4], n[5], n[6], n[3]}); }
Matrix3d from_rpy(const Row& n) { return rotation_from_rpy(Vector3d(n[3], n[4], n[5])); }
Matrix3d from_rotation_vector(const Row& n) { return exp_so3(Vector3d(n[3], n[4], n[5])); }
/// Both turn by fixed x, then y, then z, in degrees: Rz Ry Rx.
Matrix3d from_x_y_z_degrees(const Row& n) {
  return rotation_from_rpy(kDegree * Vector3d(n[3], n[4], n[5]));
}
Matrix3d from_z_y_x_degrees(const Row& n) {
  return rotation_from_rpy(kDegree * Vector3d(n[5], n[4], n[3]));
}
Matrix3d from_matrix(const Row& n) {
  Matrix3d r;
  r << n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10];
  return r;
}

Cells matrix_columns() {
  Cells out;
  for (const char* row : {"0", "1", "2", "3"})
    for (const char* column : {"0", "1", "2", "3"}) out.push_back(std::string("m") + row + column);
  return out;
}

bool in_degrees(const PoseFormat& format) {
  return format.rotation == from_x_y_z_degrees || format.rotation == from_z_y_x_degrees;
}
bool is_quaternion(const PoseFormat& format) {
  return format.rotation == from_xyzw || format.rotation == from_wxyz;
}

// ------------------------------------------------------------------------------------------------
// tables
std::string lower(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

/// Cells between semicolons, tabs, commas or blanks, whichever of these the line has first. A pose
/// as robots of Universal Robots write it, p[x, y, z, rx, ry, rz], is its numbers.
Cells cells_of_line(std::string line) {
  if (!line.empty() && line.back() == '\r') line.pop_back();
  if (const size_t p = line.find("p["); p != std::string::npos && line.back() == ']') {
    line.erase(p, 2);
    line.pop_back();
  }
  char separator = ' ';
  for (const char c : {',', '\t', ';'})  // the last of these: commas may be decimal ones
    if (line.find(c) != std::string::npos) separator = c;
  Cells cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, separator);) {
    const size_t begin = cell.find_first_not_of(" \t\""), end = cell.find_last_not_of(" \t\"");
    if (begin != std::string::npos)
      cells.push_back(cell.substr(begin, end - begin + 1));
    else if (separator != ' ')
      cells.emplace_back();
  }
  return cells;
}

bool is_header(const Cells& cells) {
  double ignored = 0;
  return std::none_of(cells.begin(), cells.end(), [&](std::string cell) {
    std::replace(cell.begin(), cell.end(), ',', '.');  // a decimal comma
    return read_number(cell, ignored);
  });
}

/// Which column of a table has what; -1: none has it.
struct PoseColumns {
  size_t count = 0;
  int id = -1, image = -1, time = -1;
  std::vector<int> numbers;  // of the format, in its order
};

/// The format whose columns these are, in whatever order; null: none.
const PoseFormat* format_of(Cells names) {
  std::sort(names.begin(), names.end());
  for (const PoseFormat& format : pose_formats()) {
    Cells columns = format.columns;
    std::sort(columns.begin(), columns.end());
    if (columns == names) return &format;
  }
  return nullptr;
}

PoseColumns columns_of_header(const Cells& header, const PoseFormat& format,
                              const std::string& where) {
  PoseColumns out;
  out.count = header.size();
  std::vector<int> others;
  for (size_t i = 0; i < header.size(); ++i) {
    const std::string name = lower(header[i]);
    const int at = static_cast<int>(i);
    if (name == "id" || name == "name")
      out.id = at;
    else if (name == "image" || name == "file" || name == "filename")
      out.image = at;
    else if (name == "time" || name == "timestamp" || name == "stamp")
      out.time = at;
    else
      others.push_back(at);
  }
  for (const std::string& column : format.columns)
    for (int i : others)
      if (lower(header[i]) == column) out.numbers.push_back(i);
  Cells names;
  for (int i : others) names.push_back(lower(header[i]));
  if (out.numbers.size() != format.columns.size()) {
    if (const PoseFormat* other = format_of(names))
      throw InputError(where + ": the columns " + comma_separated(names) + " are those of " +
                       "--pose-format " + other->name + ", not of " + format.name + " (its are " +
                       comma_separated(format.columns) + ")");
    out.numbers = others;  // by their order
  }
  if (out.numbers.size() != format.columns.size())
    throw InputError(where + ": --pose-format " + format.name + " needs the columns " +
                     comma_separated(format.columns) + " (beside id, image, time); there are " +
                     comma_separated(header));
  return out;
}

PoseColumns columns_without_header(size_t cells, const PoseFormat& format,
                                   const std::string& where) {
  const size_t needed = format.columns.size();
  if (cells != needed && cells != needed + 1)
    throw InputError(where + ": --pose-format " + format.name + " needs " + std::to_string(needed) +
                     " numbers in a row (" + comma_separated(format.columns) +
                     "), or a name and these; there are " + std::to_string(cells) + " cells");
  PoseColumns out;
  out.count = cells;
  if (cells == needed + 1) out.id = 0;
  for (size_t i = cells - needed; i < cells; ++i) out.numbers.push_back(static_cast<int>(i));
  return out;
}

/// img_001.png, not 1.5.
bool is_file_name(const std::string& text) {
  const std::string end = std::filesystem::path(text).extension().string();
  return end.size() > 1 && std::isalpha(static_cast<unsigned char>(end[1]));
}

double number_of_cell(const std::string& text, const std::string& where) {
  double value = 0;
  if (!read_number(text, value))
    throw InputError(where + ": a finite number is expected, not '" + text + "'" +
                     (text.find(',') != std::string::npos ? "; write a point, not a comma" : ""));
  return value;
}

}  // namespace

const std::vector<PoseFormat>& pose_formats() {
  static const std::vector<PoseFormat> formats = {
      {"xyzw", {"x", "y", "z", "qx", "qy", "qz", "qw"}, 1, "m and a quaternion (ROS)", from_xyzw},
      {"wxyz", {"x", "y", "z", "qw", "qx", "qy", "qz"}, 1, "m and a quaternion", from_wxyz},
      {"rpy",
       {"x", "y", "z", "roll", "pitch", "yaw"},
       1,
       "m, rad: Rz(yaw) Ry(pitch) Rx(roll)",
       from_rpy},
      {"rpy_deg",
       {"x", "y", "z", "roll", "pitch", "yaw"},
       1,
       "the same in m and degrees",
       from_x_y_z_degrees},
      {"rotvec",
       {"x", "y", "z", "rx", "ry", "rz"},
       1,
       "m, rad: a rotation vector (Universal Robots)",
       from_rotation_vector},
      {"abb", {"x", "y", "z", "q1", "q2", "q3", "q4"}, 0.001, "mm, quaternion w x y z", from_wxyz},
      {"kuka",
       {"x", "y", "z", "a", "b", "c"},
       0.001,
       "mm, degrees: Rz(A) Ry(B) Rx(C)",
       from_z_y_x_degrees},
      {"fanuc",
       {"x", "y", "z", "w", "p", "r"},
       0.001,
       "mm, degrees: Rz(R) Ry(P) Rx(W)",
       from_x_y_z_degrees},
      {"matrix", matrix_columns(), 1, "m: the 16 numbers of a 4 x 4 matrix, row after row",
       from_matrix}};
  return formats;
}

const PoseFormat& pose_format(const std::string& name) {
  Cells names;
  for (const PoseFormat& format : pose_formats()) {
    if (format.name == name) return format;
    names.push_back(format.name);
  }
  throw InputError("--pose-format: unknown format '" + name + "'" + nearest_names(name, names) +
                   "; valid: " + comma_separated(names));
}

double pose_unit(const std::string& name) {
  if (!name.empty() && name != "m" && name != "mm")
    throw InputError("--unit: 'm' or 'mm' is expected, not '" + name + "'");
  return name.empty() ? 0 : name == "m" ? 1 : 0.001;
}

Pose pose_of_matrix(const std::vector<double>& n, const std::string& where) {
  if (n.size() != 16 && n.size() != 12)
    throw InputError(where + ": the 16 numbers of a 4 x 4 matrix are expected, not " +
                     std::to_string(n.size()));
  const Matrix3d r = from_matrix(n);
  const bool last = n.size() == 12 || (n[12] == 0 && n[13] == 0 && n[14] == 0 && n[15] == 1);
  if (!last || !((r * r.transpose()).isIdentity(kRound)) || r.determinant() < 0)
    throw InputError(where +
                     ": is no rigid motion: rows of [R t; 0 0 0 1] are expected, R a rotation; "
                     "columns one after another are another order");
  return {rotation_from_quaternion(quaternion_from_rotation(r)), Vector3d(n[3], n[7], n[11])};
}

Pose pose_of_row(const PoseFormat& format, const std::vector<double>& n, double length,
                 const std::string& where) {
  if (format.rotation == from_matrix) {
    Pose pose = pose_of_matrix(n, where);
    pose.translation *= length;
    return pose;
  }
  if (is_quaternion(format)) {
    const double norm = Eigen::Map<const Eigen::Vector4d>(n.data() + 3).norm();
    if (!(std::abs(norm - 1) < kRound))
      throw InputError(where + ": a quaternion of length 1 is expected in " +
                       comma_separated({format.columns.begin() + 3, format.columns.end()}) +
                       ", not of " + shortest(norm) + "; is the --pose-format another one?");
  } else {
    const double most = in_degrees(format) ? 360 : 2 * kPi;
    for (size_t i = 3; i < 6; ++i)
      if (!(std::abs(n[i]) <= most * (1 + kRound)))
        throw InputError(where + ": " + format.columns[i] + ": " + shortest(n[i]) +
                         " is no angle in " + (in_degrees(format) ? "degrees" : "rad") +
                         "; is the --pose-format another one?");
  }
  return {format.rotation(n), length * Vector3d(n[0], n[1], n[2])};
}

std::vector<FlangePose> read_flange_poses(const std::string& path, const PoseFormat& format,
                                          double length) {
  std::istringstream in(read_file(path));
  std::vector<FlangePose> out;
  std::optional<PoseColumns> columns;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (number == 1 && line.compare(0, 3, "\xEF\xBB\xBF") == 0) line.erase(0, 3);  // of Excel
    const Cells cells = cells_of_line(line);
    if (cells.empty() || (line[0] == '#' && !columns)) continue;
    const std::string where = path + ":" + std::to_string(number);
    if (!columns && is_header(cells)) {
      columns = columns_of_header(cells, format, where);
      continue;
    }
    if (!columns) columns = columns_without_header(cells.size(), format, where);
    if (cells.size() != columns->count)
      throw InputError(where + ": " + std::to_string(cells.size()) + " cells; the first line has " +
                       std::to_string(columns->count));
    FlangePose pose;
    if (columns->id >= 0) pose.id = cells[columns->id];
    if (columns->image >= 0) pose.image = cells[columns->image];
    if (columns->time >= 0) pose.time = number_of_cell(cells[columns->time], where + ": time");
    if (columns->image < 0 && is_file_name(pose.id)) std::swap(pose.image, pose.id);
    std::vector<double> numbers;
    for (size_t i = 0; i < columns->numbers.size(); ++i)
      numbers.push_back(
          number_of_cell(cells[columns->numbers[i]], where + ": " + format.columns[i]));
    pose.pose = pose_of_row(format, numbers, length > 0 ? length : format.length, where);
    out.push_back(std::move(pose));
  }
  if (out.empty()) throw InputError(path + ": no pose in it");
  return out;
}

std::string doubt_of_unit(const std::string& path, const std::vector<Pose>& poses) {
  for (const Pose& pose : poses)
    if (pose.translation.norm() > kFarthestFlange)
      return path + ": a pose is " + std::to_string(static_cast<long>(pose.translation.norm())) +
             " m away: if lengths are in mm, take --unit mm";
  return "";
}

}  // namespace kincal
