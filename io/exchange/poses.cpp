#include "poses.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

#include "../document/error.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "read_table.h"

namespace kincal {
namespace {

constexpr double kDegree = kPi / 180;
constexpr double kFarthestFlange = 20;  // m: no robot reaches so far
constexpr double kRound = 1e-2;         // how far from a rotation rounded numbers may be

using Row = std::vector<double>;
using Cells = std::vector<std::string>;

Matrix3d from_matrix(const Row& n) {
  Matrix3d r;
  r << n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10];
  return r;
}

bool is_rigid(const Row& n) {
  const Matrix3d r = from_matrix(n);
  const bool last = n.size() == 12 || (n[12] == 0 && n[13] == 0 && n[14] == 0 && n[15] == 1);
  return last && (r * r.transpose()).isIdentity(kRound) && r.determinant() > 0;
}

Cells matrix_columns() {
  Cells out;
  for (const char* row : {"0", "1", "2", "3"})
    for (const char* column : {"0", "1", "2", "3"}) out.push_back(std::string("m") + row + column);
  return out;
}

bool is_quaternion(const PoseFormat& format) {
  return format.turn == PoseFormat::Turn::xyzw || format.turn == PoseFormat::Turn::wxyz;
}

/// The rotation of a row behind x y z.
Matrix3d rotation_of(const PoseFormat& format, const Row& n) {
  if (format.turn == PoseFormat::Turn::xyzw)
    return rotation_from_quaternion({n[3], n[4], n[5], n[6]});
  if (format.turn == PoseFormat::Turn::wxyz)
    return rotation_from_quaternion({n[4], n[5], n[6], n[3]});
  return angle_convention(format.angles).rotation(format.angle * Vector3d(n[3], n[4], n[5]));
}

// ------------------------------------------------------------------------------------------------
// tables
/// Which column of a table has what; -1: none has it.
struct PoseColumns {
  int id = -1, image = -1, time = -1;
  std::vector<int> others;
};

PoseColumns columns_of(const Table& table) {
  PoseColumns out;
  for (size_t i = 0; i < table.header.size(); ++i) {
    const std::string name = lower_case(table.header[i]);
    const int at = static_cast<int>(i);
    if (name == "id" || name == "name")
      out.id = at;
    else if (name == "image" || name == "file" || name == "filename")
      out.image = at;
    else if (name == "time" || name == "timestamp" || name == "stamp")
      out.time = at;
    else
      out.others.push_back(at);
  }
  return out;
}

/// The columns of a format in a header by their names, each with something in front of it ("" of
/// the flange's; "m" of mx, my, ...): -1 where there is none.
std::vector<int> named_columns(const Table& table, const PoseFormat& format,
                               const std::string& prefix) {
  std::vector<int> out;
  for (const std::string& column : format.columns) {
    const int at = column_of(table, prefix + column);
    if (at < 0) return {};
    out.push_back(at);
  }
  return out;
}

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

/// UR's recorder of real-time data names the columns of a flange's pose so.
constexpr const char* kTcpPose = "actual_TCP_pose_";

std::vector<int> recorded_by_ur(const Table& table) {
  std::vector<int> out;
  for (int i = 0; i < 6; ++i) out.push_back(column_of(table, kTcpPose + std::to_string(i)));
  return std::count(out.begin(), out.end(), -1) > 0 ? std::vector<int>() : out;
}

/// Columns of numbers that are no pose by their names, so by their order, if they are as many.
std::vector<int> columns_by_order(const Table& table, const PoseFormat& format,
                                  const PoseColumns& columns) {
  const std::string where = table.where;
  const size_t needed = format.columns.size();
  if (table.header.empty()) {
    const size_t cells = table.columns();
    const size_t least = format.turn == PoseFormat::Turn::matrix ? needed - 4 : needed;  // 3 x 4
    const size_t numbers = cells == least || cells == least + 1 ? least : needed;
    if (cells != numbers && cells != numbers + 1)
      throw InputError(where + ": --pose-format " + format.name + " needs " +
                       std::to_string(needed) + " numbers in a row (" +
                       comma_separated(format.columns) + "), or a name and these; there are " +
                       std::to_string(cells) + " cells");
    std::vector<int> out;
    for (size_t i = cells - numbers; i < cells; ++i) out.push_back(static_cast<int>(i));
    return out;
  }
  Cells names;
  for (const int i : columns.others) names.push_back(lower_case(table.header[i]));
  const PoseFormat* other = format_of(names);
  if (other)
    throw InputError(where + ": the columns " + comma_separated(names) + " are those of " +
                     "--pose-format " + other->name + ", not of " + format.name + " (its are " +
                     comma_separated(format.columns) + ")");
  if (columns.others.size() != needed)
    throw InputError(where + ": --pose-format " + format.name + " needs the columns " +
                     comma_separated(format.columns) + " (beside id, image, time); there are " +
                     comma_separated(table.header));
  return columns.others;
}

/// img_001.png, not 1.5.
bool is_file_name(const std::string& text) {
  const std::string end = std::filesystem::path(text).extension().string();
  return end.size() > 1 && std::isalpha(static_cast<unsigned char>(end[1]));
}

}  // namespace

const std::vector<PoseFormat>& pose_formats() {
  using Turn = PoseFormat::Turn;
  const Angles rpy = Angles::roll_pitch_yaw, vector = Angles::rotation_vector;
  static const std::vector<PoseFormat> formats = {
      {"xyzw", {"x", "y", "z", "qx", "qy", "qz", "qw"}, 1, "m and a quaternion (ROS)", Turn::xyzw},
      {"wxyz", {"x", "y", "z", "qw", "qx", "qy", "qz"}, 1, "m and a quaternion", Turn::wxyz},
      {"rpy",
       {"x", "y", "z", "roll", "pitch", "yaw"},
       1,
       "m, rad: Rz(yaw) Ry(pitch) Rx(roll)",
       Turn::angles,
       rpy},
      {"rpy_deg",
       {"x", "y", "z", "roll", "pitch", "yaw"},
       1,
       "the same in m and degrees",
       Turn::angles,
       rpy,
       kDegree},
      {"rotvec",
       {"x", "y", "z", "rx", "ry", "rz"},
       1,
       "m, rad: a rotation vector (Universal Robots)",
       Turn::angles,
       vector},
      {"rotvec_deg",
       {"x", "y", "z", "rx", "ry", "rz"},
       1,
       "the same in m and degrees",
       Turn::angles,
       vector,
       kDegree},
      {"abb", {"x", "y", "z", "q1", "q2", "q3", "q4"}, 0.001, "mm, quaternion w x y z", Turn::wxyz},
      {"kuka",
       {"x", "y", "z", "a", "b", "c"},
       0.001,
       "mm, degrees: Rz(A) Ry(B) Rx(C)",
       Turn::angles,
       Angles::a_b_c,
       kDegree},
      {"fanuc",
       {"x", "y", "z", "w", "p", "r"},
       0.001,
       "mm, degrees: Rz(R) Ry(P) Rx(W)",
       Turn::angles,
       rpy,
       kDegree},
      {"yaskawa",
       {"x", "y", "z", "rx", "ry", "rz"},
       0.001,
       "mm, degrees: Rz(RZ) Ry(RY) Rx(RX)",
       Turn::angles,
       rpy,
       kDegree},
      {"zyz",
       {"x", "y", "z", "a", "b", "c"},
       0.001,
       "mm, degrees: Rz(A) Ry(B) Rz(C) (Doosan; Kawasaki: O A T; Comau)",
       Turn::angles,
       Angles::z_y_z,
       kDegree},
      {"staubli",
       {"x", "y", "z", "rx", "ry", "rz"},
       0.001,
       "mm, degrees: Rx(RX) Ry(RY) Rz(RZ), about axes that move along",
       Turn::angles,
       Angles::moving_x_y_z,
       kDegree},
      {"matrix", matrix_columns(), 1,
       "m: the 16 (or 12) numbers of a 4 x 4 matrix, row after row, or rows of 4 below each other",
       Turn::matrix}};
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
  if (!is_rigid(n))
    throw InputError(where +
                     ": is not a rigid motion: rows of [R t; 0 0 0 1] are expected, R a rotation; "
                     "columns one after another are a different order");
  return {rotation_from_quaternion(quaternion_from_rotation(from_matrix(n))),
          Vector3d(n[3], n[7], n[11])};
}

Pose pose_of_row(const PoseFormat& format, const std::vector<double>& n, double length,
                 const std::string& where) {
  if (format.turn == PoseFormat::Turn::matrix) {
    Pose pose = pose_of_matrix(n, where);
    pose.translation *= length;
    return pose;
  }
  if (is_quaternion(format)) {
    const double norm = Eigen::Map<const Eigen::Vector4d>(n.data() + 3).norm();
    if (!(std::abs(norm - 1) < kRound))
      throw InputError(where + ": a quaternion of length 1 is expected in " +
                       comma_separated({format.columns.begin() + 3, format.columns.end()}) +
                       ", not of " + shortest(norm) + "; is the --pose-format wrong?");
  } else {
    const double most = 2 * kPi / format.angle;
    for (size_t i = 3; i < 6; ++i)
      if (!(std::abs(n[i]) <= most * (1 + kRound)))
        throw InputError(where + ": " + format.columns[i] + ": " + shortest(n[i]) +
                         " is not an angle in " + (format.angle < 1 ? "degrees" : "rad") +
                         "; is the --pose-format wrong?");
  }
  return {rotation_of(format, n), length * Vector3d(n[0], n[1], n[2])};
}

std::vector<double> numbers_of_pose(const PoseFormat& format, const Pose& pose) {
  const Vector3d p = pose.translation / format.length;
  if (format.turn == PoseFormat::Turn::matrix) {
    std::vector<double> out;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) out.push_back(pose.rotation(row, column));
      out.push_back(p(row));
    }
    out.insert(out.end(), {0, 0, 0, 1});
    return out;
  }
  std::vector<double> out = {p(0), p(1), p(2)};
  if (is_quaternion(format)) {
    const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
    const bool first = format.turn == PoseFormat::Turn::wxyz;
    if (first) out.push_back(q(3));
    out.insert(out.end(), {q(0), q(1), q(2)});
    if (!first) out.push_back(q(3));
    return out;
  }
  const Vector3d angles = angle_convention(format.angles).numbers(pose.rotation)[0] / format.angle;
  out.insert(out.end(), {angles(0), angles(1), angles(2)});
  return out;
}

std::vector<FlangePose> poses_of_columns(const Table& table, const PoseFormat& format,
                                         double length, const std::vector<int>& numbers) {
  const PoseColumns columns = columns_of(table);
  const bool named_first = table.header.empty() && !numbers.empty() && numbers[0] == 1;
  const double unit = length > 0 ? length : table.length > 0 ? table.length : format.length;
  std::vector<FlangePose> out;
  for (const TableRow& row : table.rows) {
    FlangePose pose;
    pose.where = row.where;
    if (columns.id >= 0 || named_first) pose.id = row.cells[named_first ? 0 : columns.id];
    if (columns.image >= 0) pose.image = row.cells[columns.image];
    if (columns.time >= 0) pose.time = number_of(row, columns.time, "time");
    if (columns.image < 0 && is_file_name(pose.id)) std::swap(pose.image, pose.id);
    std::vector<double> values;
    for (size_t i = 0; i < numbers.size(); ++i)
      values.push_back(number_of(row, numbers[i], format.columns[i]));
    pose.pose = pose_of_row(format, values, unit, row.where);
    out.push_back(std::move(pose));
  }
  return out;
}

std::vector<int> pose_columns(const Table& table, const PoseFormat& format,
                              const std::string& prefix) {
  std::vector<int> out = named_columns(table, format, prefix);
  if (out.empty() && prefix.empty() && format.columns.size() == 6 &&
      format.turn == PoseFormat::Turn::angles)
    out = recorded_by_ur(table);
  return out;
}

std::vector<FlangePose> poses_of(const Table& table, const PoseFormat& format, double length) {
  std::vector<int> columns = pose_columns(table, format, "");
  if (columns.empty()) columns = columns_by_order(table, format, columns_of(table));
  return poses_of_columns(table, format, length, columns);
}

bool is_matrices(const Table& table) {
  if (!table.header.empty() || (table.columns() != 16 && table.columns() != 12)) return false;
  return std::all_of(table.rows.begin(), table.rows.end(), [](const TableRow& row) {
    Row n;
    for (const std::string& cell : row.cells) {
      double value = 0;
      if (!read_number(cell, value)) return false;
      n.push_back(value);
    }
    return is_rigid(n);
  });
}

const PoseFormat* likely_format(const Table& table) {
  if (!recorded_by_ur(table).empty()) return &pose_format("rotvec");
  if (!table.format.empty()) return &pose_format(table.format);
  if (table.header.empty()) return is_matrices(table) ? &pose_format("matrix") : nullptr;
  for (const PoseFormat& format : pose_formats())
    if (!named_columns(table, format, "").empty()) return &format;
  return nullptr;
}

std::vector<FlangePose> read_flange_poses(const std::string& path, const PoseFormat& format,
                                          double length) {
  return poses_of(read_table(path), format, length);
}

std::string doubt_of_unit(const std::string& path, const std::vector<Pose>& poses) {
  for (const Pose& pose : poses)
    if (pose.translation.norm() > kFarthestFlange)
      return path + ": a pose is " + std::to_string(static_cast<long>(pose.translation.norm())) +
             " m away: if lengths are in mm, take --unit mm";
  return "";
}

}  // namespace kincal
