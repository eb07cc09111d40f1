#include "clocks.h"

#include "../../models/automatic/automatic.h"
#include "../../models/calibration/calibration.h"
#include "../../models/rig/words.h"

namespace kincal {
namespace {

std::vector<WaySighting> on_ways(const Rig& rig, const RestSamples& samples,
                                 const std::vector<Sighting>& sightings, int sensor) {
  std::map<int, int> sample_of_rest;
  for (size_t i = 0; i < samples.rests.size(); ++i)
    sample_of_rest[samples.rests[i]] = static_cast<int>(i);
  std::vector<WaySighting> all;
  for (const Sighting& one : sightings) {
    if (one.way_from < 0 || one.sensor != sensor) continue;
    const auto a = sample_of_rest.find(one.way_from), b = sample_of_rest.find(one.way_from + 1);
    if (a == sample_of_rest.end() || b == sample_of_rest.end()) continue;
    WaySighting seen{a->second, b->second, {}, one.frame.time};
    seen.view.sensor = sensor;
    seen.view.target = one.target;
    seen.view.ids = one.frame.ids;
    seen.view.z = one.frame.pixels;
    seen.view.sigma = rig.sensors[sensor].sigma;
    all.push_back(std::move(seen));
  }
  return all;
}

/// Calibrates by the rig's steps or the automatic ones. @return why there is no solution; "": there
/// is one
std::string calibrate_rests(Rig rig, const std::vector<Sample>& samples, bool automatic,
                            int threads, Solution& solution) {
  try {
    if (automatic) rig.steps = automatic_steps(Recording(rig, samples), AutomaticOptions{});
    CalibrationOptions how;
    how.threads = threads;
    solution = calibrate(make_recording(rig, samples), how);
    return solution.usable() || solution.status == Status::not_converged ? "" : solution.message;
  } catch (const std::exception& error) {
    return error.what();
  }
}

/// What there is to say of rests that do not fit each other.
std::string unfit_rests(const Clocks& clocks) {
  if (!clocks.unfit()) return "";
  return text(
      ". The rests do not fit each other either (chi2/dof %.2g): a target was moved, clocks differ "
      "by seconds, or there is another mistake; `kincal check` looks for it",
      clocks.per_dof);
}

}  // namespace

Clocks compare_clocks(const Recorded& recorded, const RestSamples& samples,
                      const std::vector<Sighting>& sightings,
                      const std::map<int, std::vector<int>>& open_turns, int threads) {
  const Rig& rig = recorded.rig;
  Clocks out;
  Solution solution;
  std::string why_not;
  if (!rig.steps.empty()) why_not = calibrate_rests(rig, samples.samples, false, threads, solution);
  if (rig.steps.empty() || !why_not.empty()) {  // the steps may free what is not seen here
    const std::string without = calibrate_rests(rig, samples.samples, true, threads, solution);
    if (without.empty()) out.without_steps = why_not;
    if (without.empty() || why_not.empty()) why_not = without;
  }
  if (why_not.empty()) out.per_dof = solution.chi2_per_dof();
  for (int s = 0; s < static_cast<int>(recorded.topics.images.size()); ++s) {
    if (recorded.topics.images[s] < 0) continue;
    TimeOffset offset;
    offset.sensor = s;
    offset.why_not = why_not;
    if (why_not.empty()) {
      OffsetInput input{*solution.recording, solution.values,
                        [&](double time) { return recorded.readings.at(time); }, open_turns};
      offset = time_offset(input, s, on_ways(rig, samples, sightings, s));
      if (!offset.why_not.empty()) offset.why_not += unfit_rests(out);
    }
    out.offsets.push_back(offset);
  }
  return out;
}

void correct_times(const std::vector<TimeOffset>& offsets, std::vector<Sighting>& sightings) {
  for (const TimeOffset& offset : offsets)
    for (Sighting& one : sightings)
      if (one.sensor == offset.sensor && offset.why_not.empty())
        one.frame.time -= offset.at(one.frame.time);
}

}  // namespace kincal
