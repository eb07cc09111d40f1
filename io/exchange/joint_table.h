// Joint readings that were logged beside images: a table by file name or by time.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "../../models/rig/rig.h"
#include "table.h"

namespace kincal {

struct JointRow {
  std::string image;  // path with / between folders, file name or its stem; "": by time only
  std::string where;  // path:line
  std::optional<double> time;
  std::map<std::string, double> joints;
  std::map<std::string, Pose> poses;  // of floating joints
};

/// What a table's columns are to be taken for.
struct JointWords {
  std::map<std::string, std::string> names;  // column: what it is to be called
  bool degrees = false;                      // readings of joints that turn
  double length = 1;                         // m: unit of readings of joints that slide
};

struct JointTable {
  std::vector<JointRow> rows;
  std::vector<std::string> notes;  // what was taken for what
};

/// Returns the names of a rig's joints that have a number as reading, in the order of the tree.
std::vector<std::string> joints_with_readings(const Rig& rig);

/// Gives columns the names of joints, or of other columns that have a meaning (x, y, z, image,
/// ...).
/// @throws InputError: there is no such column, or no such meaning
void rename_columns(Table& table, const std::map<std::string, std::string>& names,
                    const std::vector<std::string>& joints);

/// Returns which joint each column of a header is a reading of (of UR's recorder actual_q_0 to _5,
/// where the robot has six); "": of none. @throws InputError: a joint that is there twice
std::vector<std::string> joints_of_columns(const Table& table, const Rig& rig,
                                           const JointWords& words,
                                           std::vector<std::string>& notes);

/// Returns the readings of a row. @throws InputError
std::map<std::string, double> readings_of(const TableRow& row,
                                          const std::vector<std::string>& joints, const Rig& rig,
                                          const JointWords& words);

/// Reads a table with a header (columns `image`, `file`, `filename`, `id` or `time`, and joints;
/// other columns are left out), or JSON lines ({"image" or "id" or "time", "joints": {...}}, a pose
/// as {"xyz", "quat"}). Rows without a name and time go by their order. A name near to a joint that
/// has no reading is misspelt. @throws InputError
JointTable read_joint_table(const std::string& path, const Rig& rig, const JointWords& words);

/// Reads a table of the flange's poses (exchange/poses.h) as readings of the joint `flange`.
/// @throws InputError
JointTable read_flange_table(const std::string& path, const std::string& pose_format,
                             const std::string& unit);

/// Reads "A1=joint_1" as the column A1 for joint_1. @throws InputError
std::map<std::string, std::string> joint_names(const std::vector<std::string>& pairs);
/// Whether angles are in degrees: of "deg", "rad" and "". @throws InputError
bool angles_in_degrees(const std::string& unit);

/// Returns the row of an image: that of its name, else that nearest in time, if the name of the
/// image is a time (seconds, or nanoseconds as ROS writes them) and the row is within `tolerance`.
/// A name in the table may have folders, which then decide, no ending or another one, and other
/// case; the nearest such name counts. @throws InputError where rows of one image contradict
/// each other.
const JointRow* row_of_image(const std::vector<JointRow>& rows, const std::string& image,
                             double tolerance);

}  // namespace kincal
