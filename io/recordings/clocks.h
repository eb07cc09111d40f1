// The offsets in time between joints and cameras (time_offset.h), from a calibration by the rests.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../../models/rig/numbers.h"
#include "rest_samples.h"
#include "time_offset.h"

namespace kincal {

constexpr double kNoFit = 100;  // chi2/dof that no noise explains

struct Clocks {
  std::vector<TimeOffset> offsets;  // of cameras with images
  std::string without_steps;        // why the rig's steps are not those of the calibration
  double per_dof = kNan;            // chi2/dof of the rests; NaN: they could not be calibrated

  /// True if the rests do not fit each other.
  bool unfit() const { return per_dof > kNoFit; }
};

/// Compares them, by what cameras saw on the ways from rest to rest.
Clocks compare_clocks(const Recorded& recorded, const RestSamples& samples,
                      const std::vector<Sighting>& sightings,
                      const std::map<int, std::vector<int>>& open_turns, int threads);

/// Corrects the times of sightings by the offsets that are known.
void correct_times(const std::vector<TimeOffset>& offsets, std::vector<Sighting>& sightings);

}  // namespace kincal
