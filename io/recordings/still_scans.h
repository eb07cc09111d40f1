// The laser scans and point clouds of rests: read from the bags in a pass of their own, one rest of
// one sensor in memory at a time.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "streams.h"
#include "sweep.h"

namespace kincal {

/// RestScans are what one sensor logged in one rest: scans, or the cloud nearest to the middle.
struct RestScans {
  int sensor = -1, rest = -1;
  std::vector<LaserScan> scans;
  Cloud cloud;  // without points: there is none
};

/// Reads the scans and clouds of sensors. `scans`: by sensor which of the streams, -1: none.
/// @throws InputError as read_bag
void visit_scans(const std::vector<std::string>& bags, const RecordedStreams& streams,
                 const std::vector<int>& scans, const Intervals& rests,
                 const std::function<void(RestScans&)>& visit);

/// Decode the messages of these names; times are given. @throws Damage
LaserScan laser_scan(const MessageValue& message, double time);
Cloud point_cloud(const MessageValue& message, double time);

}  // namespace kincal
