// Joint readings that were logged beside images: a table by file name or by time.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

struct JointRow {
  std::string image;  // file name without folders, or its stem; "": by time only
  std::optional<double> time;
  std::map<std::string, double> joints;
  std::map<std::string, Pose> poses;  // of floating joints
};

/// Reads a CSV with a header (columns `image`, `file`, `id` or `time`; all others are joints) or
/// JSON lines ({"image" or "id" or "time", "joints": {...}}, a pose as {"xyz", "quat"}).
/// @throws InputError
std::vector<JointRow> read_joint_table(const std::string& path);

/// Reads a table of the flange's poses (exchange/poses.h) as readings of the joint `flange`.
/// @throws InputError
std::vector<JointRow> read_flange_table(const std::string& path, const std::string& pose_format,
                                        const std::string& unit);

/// Returns the row of an image: that of its name, else that nearest in time, if the name of the
/// image is a time (seconds, or nanoseconds as ROS writes them) and the row is within `tolerance`.
const JointRow* row_of_image(const std::vector<JointRow>& rows, const std::string& image,
                             double tolerance);

}  // namespace kincal
