// Displacements of sensors and mounted targets by the robot's bending (kinematics/bending.h), in
// the samples of a solution.
#pragma once

#include <string>
#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// A Deflection is the displacement of a frame by bending, seen from the base, over all samples
/// that have the readings.
struct Deflection {
  std::string frame;  // sensor/NAME or target/NAME
  long samples = 0;
  double mean = 0, largest = 0;  // m
  int largest_in = -1;           // sample
};
/// Returns the deflections of frames that move with a bending joint; empty if no joint bends.
std::vector<Deflection> deflections(const Solution& solution);

/// Returns the joints whose compliance about the axis is negative by more than three sigmas: the
/// effect that varies with the load is then no elasticity.
std::vector<int> bent_against_load(const Solution& solution);

}  // namespace kincal
