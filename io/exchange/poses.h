// Poses of a robot's flange as controllers and programs write them: tables (CSV) in the conventions
// of several makers.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// How a row of numbers says a pose.
struct PoseFormat {
  std::string name;                  // as --pose-format names it
  std::vector<std::string> columns;  // of the numbers, in their order
  double length;  // of one unit of x, y and z in m, unless the user says otherwise
  std::string about;
  /// The rotation of the numbers behind x y z; of a matrix of all of them.
  Matrix3d (*rotation)(const std::vector<double>& numbers);
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

struct FlangePose {
  std::string id, image;
  std::optional<double> time;
  Pose pose;  // base_T_flange
};

/// Reads a table: a header, if there is one, names the columns (id, image or file, time and the
/// format's; others are left out); without one a row has the numbers, and may begin with a name.
/// `length` 0: the format's own. @throws InputError
std::vector<FlangePose> read_flange_poses(const std::string& path, const PoseFormat& format,
                                          double length);

/// Returns what to say of the unit of a file's lengths if a pose is farther away than robots reach,
/// else "".
std::string doubt_of_unit(const std::string& path, const std::vector<Pose>& poses);

}  // namespace kincal
