// Local minima: the same steps from other places, and whether they end at the same one.
//
// Levenberg-Marquardt finds a minimum near its start; steps of estimation are there to make that the right one. This cannot be proved, but
// it can be tried: everything shared that some step frees is moved at random, all steps run again, and the ends are compared.
//
// How far. A component with a prior is moved by N(0, the largest prior's sigma), else by N(0, size):
//     lengths (poses, origins, prismatic offsets, baselines)  0.05 m,    angles of poses and origins  5 degrees,
//     offsets of revolute joints  0.05 rad,    gear scales  1 %,    intrinsics  5 % of fx and fy,    distortion  0.05,
//     board sizes  5 %,    target points  5 % of the target's extent.
// A pose moves by T exp(xi); xi of a partly freed pose has its freed components only. A start at which some residual is undefined (a point
// behind its camera) is drawn again at half the size, up to six times, as a person would not start there either.
//
// The same minimum. Two ends are the same if their costs agree to 1e-6, relatively, or to 1e-6, and no component of the last step's unknowns
// differs by more than 1e-2 of its sigma. What the data do not determine is not compared. An end above the least cost that is not
// `converged` counts as failed, whatever it looks like.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "calibration.h"

namespace kincal {

/// One end that some starts reached.
struct Minimum {
  double cost = 0, chi2 = 0;
  int count = 0;                                          // restarts that ended here; the rig's own start is not among them
  bool own = false;                                       // the rig's own start ended here: the result
  std::vector<std::pair<std::string, double>> differs;    // from the result, in its sigmas: the components that differ most (10), by size
};

}  // namespace kincal
