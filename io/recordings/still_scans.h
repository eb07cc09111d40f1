// Targets in the laser scans and point clouds of rests: these are read from the bags in a pass of
// their own, one rest of one sensor in memory at a time.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "robot_readings.h"
#include "still_images.h"

namespace kincal {

/// ScannedRests are what was found in them.
struct ScannedRests {
  /// In how many rests a sensor found a target.
  struct Success {
    int rests = 0, found = 0;
    std::map<std::string, int> not_found;  // rests, by the reason
  };
  std::map<int, std::vector<View>> views;  // by rest
  std::map<int, Success> sensors;
  std::set<std::string> doubts;
};

/// Looks for targets in the scans and clouds of rests. @throws InputError as read_bag
ScannedRests look_at_scans(const Recorded& recorded, const Intervals& rests,
                           const TargetSearch& search);

}  // namespace kincal
