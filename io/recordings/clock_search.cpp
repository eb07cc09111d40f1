#include "clock_search.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "held_targets.h"

namespace kincal {
namespace {

constexpr double kStillGlimpses = 0.1;  // of the frames rest at least
constexpr double kBin = 0.1;            // s, of differences between middles of rests
constexpr double kApart = 0.5;          // s, of candidates
constexpr size_t kLeastSamples = 4;
constexpr size_t kMostCandidates = 24;  // that are tried
constexpr double kAsGood = 0.5;         // of the best agreement
constexpr double kEdge = 0.25;          // of a way, where motion begins and ends
constexpr double kNear = 0.9;           // of the offsets that are looked for before
constexpr double kLess = 4;             // times, chi2/dof of the others

/// Whether what one frame shows stands still.
struct Glimpse {
  double time;
  bool still;
};

/// What a camera tells by itself: when it stands still.
struct CameraMotion {
  std::vector<Glimpse> glimpses;
  std::vector<double> middles;  // of its rests
};

CameraMotion motion_of(const Rig& rig, const std::vector<Sighting>& sightings, double still) {
  CameraMotion out;
  for (const auto& [which, by_rest] : frames_of_views(sightings)) {
    const std::vector<CornerFrame>& all = by_rest.at(0);
    const double scatter = corner_scatter({all}, kStillGlimpses);
    const double allowed =
        frame_tolerance(still, scatter, scatter, rig.sensors[which.first].sigma[0]);
    std::vector<double> times;
    for (const CornerFrame& frame : all) times.push_back(frame.time);
    const double gap = longest_gap(times);
    const Intervals rests = still_frames(all, allowed, gap);
    for (const TimeInterval& one : rests) out.middles.push_back((one.begin + one.end) / 2);
    for (size_t i = 0; i < times.size(); ++i) {
      const bool before = i > 0 && times[i] - times[i - 1] <= gap,
                 after = i + 1 < times.size() && times[i + 1] - times[i] <= gap;
      if (before && after) out.glimpses.push_back({times[i], interval_at(rests, times[i]) >= 0});
    }
  }
  return out;
}

/// Agreements less contradictions of the frames with joints that rest at some times, a frame.
double agreement(const CameraMotion& camera, const Intervals& rests, double offset) {
  double sum = 0;
  for (const Glimpse& one : camera.glimpses) {
    const double time = one.time - offset;
    const auto next = std::lower_bound(rests.begin(), rests.end(), time,
                                       [](const TimeInterval& r, double t) { return r.end < t; });
    if (next == rests.end()) continue;
    const bool rest = next->begin <= time;
    if (!rest) {
      if (next == rests.begin()) continue;
      const TimeInterval way{(next - 1)->end, next->begin};
      if (std::min(time - way.begin, way.end - time) < kEdge * way.length()) continue;
    }
    sum += rest == one.still ? 1 : -1;
  }
  return camera.glimpses.empty() ? 0 : sum / static_cast<double>(camera.glimpses.size());
}

struct ClockCandidate {
  double offset = 0, agreement = 0;
  Clocks clocks;
};

/// Offsets at which rests of the camera are rests of the joints, the best first.
std::vector<ClockCandidate> candidates_of(const CameraMotion& camera, const Intervals& rests) {
  std::set<long> bins;
  for (const double middle : camera.middles)
    for (const TimeInterval& rest : rests)
      bins.insert(std::lround((middle - (rest.begin + rest.end) / 2) / kBin));
  std::vector<ClockCandidate> all, out;
  for (const long bin : bins) {
    const double offset = static_cast<double>(bin) * kBin;
    all.push_back({offset, agreement(camera, rests, offset), {}});
  }
  std::stable_sort(all.begin(), all.end(), [](const ClockCandidate& a, const ClockCandidate& b) {
    return a.agreement > b.agreement;
  });
  for (ClockCandidate& one : all) {
    const auto near = [&](const ClockCandidate& other) {
      return std::abs(one.offset - other.offset) < kApart;
    };
    if (!(one.agreement > 0) || one.agreement < kAsGood * all[0].agreement ||
        out.size() == kMostCandidates)
      break;
    if (std::none_of(out.begin(), out.end(), near)) out.push_back(std::move(one));
  }
  return out;
}

/// The same sightings where stamps are late by an offset: of which rest or way.
std::vector<Sighting> with_offset(std::vector<Sighting> sightings, const Intervals& rests,
                                  double offset) {
  for (Sighting& one : sightings) {
    one.frame.time -= offset;
    one.rest = interval_at(rests, one.frame.time);
    one.way_from = -1;
    for (int r = 0; one.rest < 0 && r + 1 < static_cast<int>(rests.size()); ++r)
      if (rests[r].end < one.frame.time && one.frame.time < rests[r + 1].begin) one.way_from = r;
  }
  return sightings;
}

/// What clocks are tried with.
struct ClockTrial {
  const Recorded& recorded;
  const Intervals& rests;
  const TargetSearch& search;
  int threads;
  double still_pixels;

  /// What is known of a camera's clock if its stamps are late by an offset.
  Clocks at(const std::vector<Sighting>& sightings, double offset) const {
    const std::vector<Sighting> moved = with_offset(sightings, rests, offset);
    RestSamples samples = samples_of_rests(recorded, rests, moved, {}, still_pixels);
    if (samples.samples.size() < kLeastSamples) return {};
    turn_boards(recorded.rig, search.open_turns, samples.samples);
    add_holding_chains(recorded.rig, samples.samples);
    return compare_clocks(recorded, samples, moved, search.open_turns, threads);
  }
};

const TimeOffset* offset_of(const Clocks& clocks, int sensor) {
  for (const TimeOffset& one : clocks.offsets)
    if (one.sensor == sensor) return &one;
  return nullptr;
}

CameraClock clock_of(const ClockTrial& trial, int sensor, const std::vector<Sighting>& sightings) {
  CameraClock out;
  out.sensor = sensor;
  const CameraMotion camera = motion_of(trial.recorded.rig, sightings, trial.still_pixels);
  std::vector<ClockCandidate> all = candidates_of(camera, trial.rests);
  if (all.empty()) return out;
  const ClockCandidate* best = nullptr;
  for (ClockCandidate& one : all) {
    out.candidates.push_back(one.offset);
    one.clocks = trial.at(sightings, one.offset);
    if (std::isfinite(one.clocks.per_dof) && (!best || one.clocks.per_dof < best->clocks.per_dof))
      best = &one;
  }
  double as_stamped = -1;
  for (double offset = -kFarthestOffset; offset <= kFarthestOffset; offset += kBin)
    as_stamped = std::max(as_stamped, agreement(camera, trial.rests, offset));
  out.contradicted = as_stamped < kAsGood * all[0].agreement;
  if (!best || best->clocks.unfit()) return out;
  for (const ClockCandidate& one : all)
    if (&one != best && one.clocks.per_dof < kLess * best->clocks.per_dof) return out;
  const TimeOffset* left = offset_of(best->clocks, sensor);
  if (!left || !left->why_not.empty()) return out;
  out.offset = best->offset + left->offset;
  out.found = std::abs(out.offset) > kNear * kFarthestOffset;  // else it was searched already
  out.contradicted = false;
  return out;
}

}  // namespace

std::vector<CameraClock> search_clocks(const Recorded& recorded, const Intervals& rests,
                                       const std::vector<int>& sensors, const TargetSearch& search,
                                       const LookOptions& look, double still_pixels) {
  const TimeInterval whole = recorded_time(recorded.streams);
  LookedAt looked = look_at_images(recorded, {whole}, search, look_through(whole, look));
  search.agree(looked.sightings);
  std::vector<CameraClock> out;
  for (const int sensor : sensors) {
    std::vector<Sighting> own;
    for (const Sighting& one : looked.sightings)
      if (one.sensor == sensor) own.push_back(one);
    out.push_back(clock_of({recorded, rests, search, look.threads, still_pixels}, sensor, own));
  }
  return out;
}

}  // namespace kincal
