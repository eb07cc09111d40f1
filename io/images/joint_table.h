// Joint readings that were logged beside images: a table by file name or by time.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace kincal {

struct JointRow {
  std::string image;  // file name without folders, or its stem; "": by time only
  std::optional<double> time;
  std::map<std::string, double> joints;
};

/// Reads a CSV with a header (columns `image`, `file`, `id` or `time`; all others are joints) or
/// JSON lines ({"image" or "id" or "time", "joints": {...}}). @throws InputError
std::vector<JointRow> read_joint_table(const std::string& path);

/// Returns the row of an image: that of its name, else that nearest in time, if the name of the
/// image is a time (seconds, or nanoseconds as ROS writes them) and the row is within `tolerance`.
const JointRow* row_of_image(const std::vector<JointRow>& rows, const std::string& image,
                             double tolerance);

}  // namespace kincal
