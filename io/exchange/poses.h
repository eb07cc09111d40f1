// Poses of a robot's flange as controllers and programs write them: tables (CSV) in the conventions
// of several makers.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/angles.h"
#include "table.h"

namespace kincal {

/// How a row of numbers says a pose.
struct PoseFormat {
  std::string name;                  // as --pose-format names it
  std::vector<std::string> columns;  // of the numbers, in their order
  double length;  // of one unit of x, y and z in m, unless the user says otherwise
  std::string about;
  enum class Turn { xyzw, wxyz, angles, matrix } turn;  // how the numbers behind x y z say it
  Angles angles = Angles::roll_pitch_yaw;               // of Turn::angles
  double angle = 1;                                     // of one unit of them in rad
};
const std::vector<PoseFormat>& pose_formats();

/// Looks up a format by its name. @throws InputError with the valid ones
const PoseFormat& pose_format(const std::string& name);

/// Returns the pose of a row; `length` is one unit of it in m. `where` begins the message of an
/// error. @throws InputError: quaternions of another length, angles that are none, no rotation
Pose pose_of_row(const PoseFormat& format, const std::vector<double>& numbers, double length,
                 const std::string& where);

/// Returns the rigid motion of 16 (or 12) numbers, row after row; what rounding did to the rotation
/// is undone. @throws InputError
Pose pose_of_matrix(const std::vector<double>& numbers, const std::string& where);

/// Returns the length of a unit in m: of m and mm; 0 of "", the format's own. @throws InputError
double pose_unit(const std::string& name);

/// Returns the numbers of a pose in a format, in its units: the inverse of pose_of_row(). Of two
/// triples of angles it is that which programs write.
std::vector<double> numbers_of_pose(const PoseFormat& format, const Pose& pose);

struct FlangePose {
  std::string where, id, image;
  std::optional<double> time;
  Pose pose;  // base_T_flange
};

/// Returns the columns of a format's numbers by their names in the header, each with `prefix` in
/// front; empty: they are not all there. Of UR's recorder the columns actual_TCP_pose_0..5.
std::vector<int> pose_columns(const Table& table, const PoseFormat& format,
                              const std::string& prefix);

/// Reads the poses that stand in these columns; the columns id, image (or file) and time go along,
/// and a name in front of a row without a header. `length` 0: the table's, else the format's own.
/// @throws InputError
std::vector<FlangePose> poses_of_columns(const Table& table, const PoseFormat& format,
                                         double length, const std::vector<int>& columns);

/// The same of the columns that the header names, or that stand in the format's order. @throws
/// InputError
std::vector<FlangePose> poses_of(const Table& table, const PoseFormat& format, double length);
std::vector<FlangePose> read_flange_poses(const std::string& path, const PoseFormat& format,
                                          double length);

/// Whether every row of a table without a header is a rigid motion of 16 or 12 numbers.
bool is_matrices(const Table& table);

/// Returns the first format whose columns the header names (a matrix without a header: by its
/// columns); null: none. Others may have the same columns.
const PoseFormat* likely_format(const Table& table);

/// Returns what to say of the unit of a file's lengths if a pose is farther away than robots reach,
/// else "".
std::string doubt_of_unit(const std::string& path, const std::vector<Pose>& poses);

}  // namespace kincal
