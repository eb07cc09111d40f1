// A bag of a simulated recording: what a robot's joints, cameras and tilting lasers log while it
// goes from posture to posture of a simulation and rests in each.
#pragma once

#include <cstdint>
#include <string>

#include "../../models/simulation/journey.h"
#include "../../solver/progress.h"
#include "../images/render.h"
#include "../rig/rig_file.h"
#include "simulated_laser.h"

namespace kincal {

struct BagOptions {
  JourneyOptions journey;
  double joint_rate = 100, frame_rate = 10;  // Hz
  double camera_delay = 0;  // s, by which the stamps of images are later than those of joints
  SweepOptions sweep;       // of tilting lasers; rests become as long as they take
  Look look;
  std::uint64_t seed = 1;
  int threads = 1;     // the bag is the same for any number
  bool force = false;  // replace a file
  Progress progress;
  bool (*go_on)() = nullptr;  // asked before the file gets its name
};

struct RecordedBag {
  int images = 0, readings = 0, scans = 0;  // messages
  double duration = 0;                      // s
  bool written = false;                     // false: go_on() said no
};

/// The stamps of a simulated recording begin here: 2026-01-01 00:00:00 UTC, ns since 1970.
constexpr std::int64_t kRecordingStart = 1767225600000000000;

/// Writes a bag of ROS 1 (PATH.bag) or of ROS 2 (PATH.mcap) of the samples and the truth of a
/// simulation: /joint_states (all joints with readings), of each camera /NAME/image_raw (mono8) and
/// /NAME/camera_info (what the rig says), of each laser that sweeps /NAME/scan, and
/// /robot_description. @throws InputError
RecordedBag render_bag(const RigFile& rig, const std::string& samples, const std::string& truth,
                       const std::string& path, const BagOptions& options);

}  // namespace kincal
