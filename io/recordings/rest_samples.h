// Samples of rests: readings and what the sensors saw, averaged over the time of a rest in which
// all of it is still.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../../models/rig/numbers.h"
#include "robot_readings.h"
#include "still_images.h"
#include "still_scans.h"

namespace kincal {

/// A SeenTarget is how still a target is before a camera, in all rests.
struct SeenTarget {
  int sensor = -1, target = -1;
  double scatter = 0;         // px: of corners from frame to frame
  int rests = 0, moving = 0;  // in which it is seen; and is not still
  double least = kInfinity;   // px: its motion in the quietest rest
  double allowed = 0;         // px: what is taken for rest
};

struct RestSamples {
  std::vector<Sample> samples;
  std::vector<int> rests;                        // by sample
  std::vector<std::vector<std::string>> images;  // by sample and view, where they were written
  std::vector<SeenTarget> seen;
  std::map<int, std::string> lost;                             // by rest without a sample: why
  std::map<std::pair<int, std::string>, int> without_reading;  // views, by sensor and joint
};

/// Returns "rest_0001" for the first.
std::string rest_name(int rest);

/// Makes samples of sightings, poses, and `beams` (by rest). `still_pixels` as for frame_tolerance.
RestSamples samples_of_rests(const Recorded& recorded, const Intervals& rests,
                             const std::vector<Sighting>& sightings,
                             const std::map<int, std::vector<View>>& beams, double still_pixels);

/// Makes samples whose views have images instead of corners: one image of each rest and camera is
/// written into a folder, paths are relative to the samples file. @throws InputError
RestSamples samples_with_images(const Recorded& recorded, const Intervals& rests,
                                const std::string& folder, const std::string& samples_file,
                                bool force);

/// Numbers boards that look alike from several sides as the joint readings say. `open_turns` as in
/// TargetSearch. Returns how many views were turned.
int turn_boards(const Rig& rig, const std::map<int, std::vector<int>>& open_turns,
                std::vector<Sample>& samples);

/// Leaves out postures that are there already: readings closer than `distinct` (rad, m), and every
/// view as near. Returns how many.
size_t leave_out_alike(const Rig& rig, double distinct, std::vector<Sample>& samples);

}  // namespace kincal
