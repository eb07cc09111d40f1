#include "rests.h"

#include <algorithm>
#include <cmath>

#include "../../models/rig/numbers.h"
#include "../../models/rig/words.h"

namespace kincal {
namespace {

constexpr double kRestMargin = 0.1, kRestMarginShare = 0.15;  // s, of a rest, cut off at both ends
constexpr double kStillShare = 0.1;  // of the frames rest at least, where no joints tell

}  // namespace

FoundRests rests_of_joints(const RobotReadings& readings, double shortest, double tolerance) {
  FoundRests out;
  out.shortest = shortest;
  for (const TimeInterval& band : readings.still(readings.span(), tolerance)) {
    if (band.length() < shortest) continue;
    const TimeInterval one = readings.without_slow_ends(band, tolerance);
    if (one.length() < shortest) {
      out.creeping.push_back(band.begin);
      continue;
    }
    const double margin = std::min(kRestMargin, kRestMarginShare * one.length());
    out.rests.push_back({one.begin + margin, one.end - margin});
  }
  if (out.rests.empty()) out.why_none = readings.restless(shortest, tolerance);
  return out;
}

FoundRests rests_of_images(const Rig& rig, const TimeInterval& recorded, double shortest,
                           double tolerance, std::vector<Sighting>& sightings) {
  FoundRests out;
  out.shortest = shortest;
  Intervals still{recorded};
  double quietest_frames = kInfinity;
  for (const auto& [which, by_rest] : frames_of_views(sightings)) {
    const std::vector<CornerFrame>& all = by_rest.at(0);
    const double scatter = corner_scatter({all}, kStillShare);
    const double allowed =
        frame_tolerance(tolerance, scatter, scatter, rig.sensors[which.first].sigma[0]);
    quietest_frames = std::min(quietest_frames, scatter);
    std::vector<double> times;
    for (const CornerFrame& frame : all) times.push_back(frame.time);
    const double gap = longest_gap(times);
    still =
        intersected(still, united(still_frames(all, allowed, gap),
                                  complement(coverage(times, gap), recorded.begin, recorded.end)));
  }
  for (const TimeInterval& one : still)
    if (one.length() >= shortest) out.rests.push_back(one);
  for (Sighting& one : sightings) one.rest = interval_at(out.rests, one.frame.time);
  if (!out.rests.empty()) return out;
  out.why_none = std::isinf(quietest_frames)
                     ? "no target was found in the images"
                     : text(
                           "the views of the cameras are never at rest for %.3g s: from image to "
                           "image they move by %.2g px in the quietest tenth of the time",
                           shortest, quietest_frames);
  return out;
}

}  // namespace kincal
