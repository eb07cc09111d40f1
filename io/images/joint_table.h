// Joint readings that were logged beside images: a table by file name or by time.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

struct JointRow {
  std::string image;  // path with / between folders, file name or its stem; "": by time only
  std::string where;  // path:line
  std::optional<double> time;
  std::map<std::string, double> joints;
  std::map<std::string, Pose> poses;  // of floating joints
};

/// Reads a table with a header (columns `image`, `file`, `filename`, `id` or `time`, and joints;
/// other columns are left out), with commas, semicolons or tabs between cells,
/// or JSON lines ({"image" or "id" or "time", "joints": {...}}, a pose as {"xyz", "quat"}).
/// `joints`: those of the robot, of which a table must have one; a name near to one that has no
/// reading is misspelt, and a column that is there twice an error. @throws InputError
std::vector<JointRow> read_joint_table(const std::string& path,
                                       const std::vector<std::string>& joints);

/// Reads a table of the flange's poses (exchange/poses.h) as readings of the joint `flange`.
/// @throws InputError
std::vector<JointRow> read_flange_table(const std::string& path, const std::string& pose_format,
                                        const std::string& unit);

/// Returns the row of an image: that of its name, else that nearest in time, if the name of the
/// image is a time (seconds, or nanoseconds as ROS writes them) and the row is within `tolerance`.
/// A name in the table may have folders, which then decide, no ending or another one, and other
/// case; the nearest such name counts. @throws InputError where rows of one image contradict
/// each other.
const JointRow* row_of_image(const std::vector<JointRow>& rows, const std::string& image,
                             double tolerance);

}  // namespace kincal
