// When the robot rests: by its joints' readings, or where there are none by what its cameras see.
#pragma once

#include <string>
#include <vector>

#include "robot_readings.h"
#include "still_images.h"

namespace kincal {

/// FoundRests are the rests of a recording.
struct FoundRests {
  Intervals rests;
  double shortest = 0;           // s
  std::vector<double> creeping;  // s: begins of those that are too short without slow ends of ways
  std::string why_none;          // else empty
};

/// Finds rests of `shortest` s at least, cut off a little at both ends. `tolerance` as for
/// RobotReadings::still.
FoundRests rests_of_joints(const RobotReadings& readings, double shortest, double tolerance);

/// Finds rests between the ends of a recording: all targets that are seen stand still at once,
/// within `tolerance` px (NaN: see frame_tolerance). Sightings get the rest that they are of.
FoundRests rests_of_images(const Rig& rig, const TimeInterval& recorded, double shortest,
                           double tolerance, std::vector<Sighting>& sightings);

}  // namespace kincal
