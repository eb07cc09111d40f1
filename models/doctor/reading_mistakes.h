// Mistakes about what a reading means: its unit, its zero, whose it is, what it counts from; and
// lengths of the URDF in another unit. Functions that add append their hypotheses.
#pragma once

#include <vector>

#include "observation_index.h"

namespace kincal {

/// Returns an Undo that replaces the readings of some joints, also those that a scanner has of them
/// in its rays.
Undo of_readings(const std::vector<int>& joints, std::function<double(double)> change);

/// Makes the hypothesis that joints turn the other way.
Hypothesis wrong_signs(const Rig& rig, const std::vector<int>& joints);

/// A LengthUnit is one that is written in place of the metre.
struct LengthUnit {
  const char *name, *cure;  // "millimetres", what to do with a number to get metres
  double metres;
};

/// Returns the units in which lengths are written by mistake, the likeliest first.
const std::vector<LengthUnit>& other_length_units();

/// Adds readings of sliding joints, and lengths in the URDF, that are not metres: those that are
/// far too large.
void add_length_units(const Rig& rig, const ObservationIndex& observations,
                      std::vector<Hypothesis>& out);

/// Adds what is tried only where nothing else explains the data, for it is much: readings that
/// count from another zero, turn about another axis, joints or arms exchanged, absolute angles, two
/// joints (or all) with the wrong sign, gears.
void add_rarer_readings(const Rig& rig, const ParameterTable& table,
                        const std::vector<Sample>& samples, const FreedNames& freed,
                        std::vector<Hypothesis>& out);

}  // namespace kincal
