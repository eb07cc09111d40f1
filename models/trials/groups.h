// The groups of parameters that automatic staging (staging.h) tries, one after the other.
//
// Groups. `mounts`: poses of sensors and mounted targets (always kept: everything else is measured
// from them); joint offsets; the independent geometry of each chain between what sees and what is
// seen (models/rig/geometry.h); gear scales; what joint models add; sizes of boards; baselines;
// intrinsics; distortion. All groups but the mounts have priors, around the rig's values, wide
// enough for what robots are off by, so that what is weak stays put.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../estimation/estimation.h"

namespace kincal {

/// A Group is freed together, or not at all.
struct Group {
  std::string name;
  std::vector<Freed> free;
  std::vector<Prior> priors;           // one a component; none: the mounts
  std::vector<int> contained_offsets;  // parameters: offsets of the joints of a chain
};

/// Returns the recording that groups are made from: the rig without steps and the training samples
/// with views, sorted by id so that their order in the file does not matter. @throws
/// std::invalid_argument where there are none.
Recording staging_recording(const Rig& rig, const std::vector<Sample>& samples);

/// Returns the groups of such a recording, the mounts first, with everything in them that some
/// measurement depends on.
std::vector<Group> make_groups(const Recording& recording);

/// Returns the names of the groups that there are for this rig and these samples, with the names of
/// everything in them.
std::vector<std::pair<std::string, std::vector<std::string>>> staging_groups(
    const Rig& rig, const std::vector<Sample>& samples);

/// Returns a without b.
std::vector<Freed> without(const std::vector<Freed>& a, const std::vector<Freed>& b);

/// Returns whether a component is among those freed.
bool has(const std::vector<Freed>& all, int parameter, int component);

/// Returns names of whole parameters, and of components.
std::vector<std::string> names_of(const ParameterTable& table, const std::vector<Freed>& free);

}  // namespace kincal
