// The second pass over bags: of all images only those taken in rests, and some on the ways between
// them, are decoded and searched for targets.
//
// In each rest the images of a camera are taken evenly, at most so many; the first two are searched
// for every target, the others for those that were found in them. On the way from a rest to the
// next a few more are searched for what was seen before: they tell the offset in time
// (time_offset.h). What is searched depends on the recording alone, not on threads.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/progress.h"
#include "robot_readings.h"
#include "settled_view.h"
#include "sweep.h"

namespace kincal {

/// A Sighting is what one image shows of one target.
struct Sighting {
  int sensor = -1, target = -1;
  int rest = -1;                 // that it was taken in
  int way_from = -1;             // or the rest after which, on the way to the next
  std::array<int, 2> layouts{};  // as a Detection of io/images has them
  CornerFrame frame;
};

/// A LookResult is what was found in one image.
struct LookResult {
  std::vector<Sighting> seen;  // targets and corners
  std::string unusable;        // why the image cannot be used at all
  std::vector<std::string> notes;
};

/// What there is to say of a target among beams.
struct BeamWords {
  std::vector<std::string> doubts;
  std::string why_not;  // it was not found
};

/// A TargetSearch finds targets of the rig in the images of one of its cameras. It is called from
/// several threads.
struct TargetSearch {
  std::vector<int> targets;                    // that can be found in images
  std::map<int, std::vector<int>> open_turns;  // of those that look alike after some quarter
                                               // turns: which
  std::function<LookResult(const MessageValue& image, bool compressed, int sensor,
                           const std::vector<int>& targets)>
      look;
  /// Finds a target in what a laser logged in a rest: a view for each way of its joint.
  std::function<std::vector<View>(int sensor, int target, const Sweep& recorded, BeamWords& words)>
      sweep;
  /// The same in a cloud: one view, or none.
  std::function<std::vector<View>(int sensor, int target, const Cloud& cloud, BeamWords& words)>
      cloud;
  /// Takes out what was read otherwise than most; returns what there is to say.
  std::function<std::vector<std::string>(std::vector<Sighting>&)> agree;
};

struct LookOptions {
  int in_rest = 10, on_way = 4;  // images of a camera
  int most_on_ways = 300;        // of all ways
  bool all_targets = false;      // search every image for all targets
  int threads = 1;
  Progress progress;
};

/// LookedAt is what came of it.
struct LookedAt {
  std::vector<Sighting> sightings;  // in the order of the bag
  std::vector<int> images;          // by sensor: how many were looked at
  std::vector<std::string> notes;
};

/// Looks at images of cameras in the rests, and on the ways. @throws InputError as read_bag
LookedAt look_at_images(const Recorded& recorded, const Intervals& rests,
                        const TargetSearch& search, const LookOptions& options);

/// Returns the time that a recording and its images take, and how to look at images all through it.
TimeInterval recorded_time(const RecordedStreams& streams);
LookOptions look_through(const TimeInterval& whole, LookOptions look);

/// Frames of each target before each camera in each rest, by their times.
using FramesOfRest = std::map<int, std::vector<CornerFrame>>;       // by rest
using FramesOfViews = std::map<std::pair<int, int>, FramesOfRest>;  // by sensor and target
FramesOfViews frames_of_views(const std::vector<Sighting>& sightings);

/// Gives the image in the middle of each rest of each camera on: sensor, rest, and the message.
using GetImage =
    std::function<void(int sensor, int rest, const MessageValue& image, bool compressed)>;
void visit_middle_images(const Recorded& recorded, const Intervals& rests, const GetImage& visit);

}  // namespace kincal
