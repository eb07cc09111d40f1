// How far sensors and mounted targets move when the robot bends under its weights
// (kinematics/bending.h), in the samples of a solution.
#pragma once

#include <string>
#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// A Deflection is how far bending moves a frame, seen from the base: over all samples
/// that have the readings.
struct Deflection {
  std::string frame;  // sensor/NAME or target/NAME
  long samples = 0;
  double mean = 0, largest = 0;  // m
  int largest_in = -1;           // sample
};
/// Returns those of frames that move with a joint that bends; empty where nothing bends.
std::vector<Deflection> deflections(const Solution& solution);

/// Returns the joints whose compliance about the axis is below zero by more than three sigmas: what
/// goes with the load there is no elasticity.
std::vector<int> bent_against_load(const Solution& solution);

}  // namespace kincal
