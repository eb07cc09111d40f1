// Tables of joint readings (or poses of the flange) beside what was measured there: samples.
#pragma once

#include <string>
#include <vector>

#include "../rig/rig_file.h"
#include "joint_table.h"
#include "pose_samples.h"

namespace kincal {

struct MeasuredWords {
  std::string sensor, target;  // of the rig; "": its only one
  JointWords joints;
  PoseWords flange, measured;  // of robots that are known by the poses of their flange, and of
                               // sensors that measure poses
};

/// Returns a line of samples.jsonl for every row: readings of the joints that the header names, or
/// the flange's pose, and what the sensor measured: x y z of a `point` sensor (of the target's
/// point 0, or of that in the column `point`), the pose of a `pose` sensor, the image of a camera,
/// which `kincal detect` fills in. `unit` of the measured poses is that of points, too. @throws
/// InputError
std::string measured_lines(const std::string& path, const Rig& rig, const MeasuredWords& words,
                           std::vector<std::string>& notes);

}  // namespace kincal
