// Messages that have all of one posture: calibration_msgs/RobotMeasurement, what the capture tools
// of ROS's `calibration` packages write (the paper's own): joints, corners and rays; and
// robot_calibration_msgs/CalibrationData, what robot_calibration writes: joints and points.
#pragma once

#include <string>
#include <vector>

#include "../../models/rig/samples.h"
#include "../../solver/progress.h"
#include "../rig/rig_file.h"
#include "bag.h"

namespace kincal {

constexpr const char* kRobotMeasurement = "calibration_msgs/RobotMeasurement";
constexpr const char* kCalibrationData = "robot_calibration_msgs/CalibrationData";
bool is_whole_posture(const std::string& type);

struct ImportedSamples {
  std::vector<Sample> samples;
  std::vector<std::string> notes;  // what was left out, and why
};

/// Samples of all such messages of some bags. An id of a message is the name of the rig's sensor or
/// target, or its `topic`, or there is only one of the kind. Sets `losses` to what the bags lost.
/// @throws InputError where none of the bags has one, or a bag is none
ImportedSamples read_robot_measurements(const std::vector<std::string>& bags, const RigFile& rig,
                                        std::vector<std::string>& losses,
                                        const Progress& progress = {});

}  // namespace kincal
