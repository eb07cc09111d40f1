// What a scanner measured of a scene at rest, direction by direction.
#pragma once

#include <functional>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// A Beam is what was measured in one direction: `u` to the right and `v` down, in rad (v may be in
/// m, of a joint that shifts), as seen from the sensor.
struct Beam {
  double u = 0, v = 0;
  double range = 0;  // m; 0: nothing was measured
  double intensity = 0, time = 0;
  Eigen::Vector2d place() const { return {u, v}; }
};

/// A Ray starts at `origin` and has a unit direction.
struct Ray {
  Vector3d origin, direction;
};

/// Beams are all that a sensor measured of a scene at rest.
struct Beams {
  std::vector<Beam> all;
  double step_u = 0, step_v = 0;               // how far neighbours are apart
  std::function<Ray(double u, double v)> ray;  // in any frame that is at rest
};

}  // namespace kincal
