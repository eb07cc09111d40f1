// Simulation: from a rig, the true parameters of its robot, and postures to the samples that the
// robot would log.
//
// Truth and noise. The true position of a joint is  scale * true reading + offset  at the true
// parameters; its logged reading is the true one plus N(0, sigma), one draw per joint and sample,
// common to all views of the sample. Conditions that the rig's parameters depend on
// (models/rig/conditions.h) are drawn if a posture states none, and logged without noise. The true
// pose of a target held by a chain is link_T_target E, one that a `pose` sensor sees is measured at
// sensor_T_target E^-1; translation of E and Log of its rotation are N(0, sigma), so that the
// residuals of models/sensors/pose.h are exactly that. A ray's true reading t, bearing and range
// come from where the point crosses the scan plane (z = 0 in the sensor's frame): with n the
// plane's normal, c its offset, u the axis, x the point, in the joint's frame,
//     prismatic:  n.(x + q u) + c = 0,      rotation:  A cos q + B sin q + C = 0,
//     A = n.(x - u (u.x)),  B = n.(u x x),  C = (n.u)(u.x) + c;
//     t = (direction q - offset) / scale.
// Everything else is prediction plus N(0, sigma). With all sigmas 0 every residual at the truth is
// 0.
//
// Visibility: whole targets only. Camera: every point inside the image (without image_size: as
// far beyond the principal point as before it), where the lens is one to one. Laser: every point at
// a reading within the joint's limits, |bearing| <= 135 degrees, range > 0.1 m. Views that are not
// requested by name also need the target's front, at 80 degrees or less from its normal. There is
// no occlusion.
//
// Draws: std::mt19937_64, uniform numbers of 53 bits and Box-Muller, identical in all standard
// libraries. Truth, postures and the noise of each sample have streams of their own, and a
// sigma of 0 draws like any other: two simulations that differ in one of these agree in the
// others.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/progress.h"
#include "../rig/recording.h"
#include "posture.h"

namespace kincal {

struct SimulationOptions {
  std::uint64_t seed = 1;
  int samples = 0;
  /// Postures of the samples, used repeatedly if there are fewer than `samples`. Empty: random
  /// postures.
  std::vector<Posture> postures;
  /// Pairs (sensor, target) in which the sensor may see or hold the target if a posture lists no
  /// views; empty: usual_pairs().
  std::vector<std::pair<int, int>> pairs;
  Progress progress;  // reports before each sample; cancelling keeps the samples so far
};

struct Simulation {
  std::vector<Sample> samples;
  VectorXd truth;                                  // ParameterTable's layout
  std::vector<std::vector<double>> true_readings;  // by sample, as Sample::readings
  std::map<std::pair<int, int>, Pose>
      targets;  // true base_T_target of free targets by (sample, target)

  using Dropped = DroppedView;
  std::vector<Dropped> dropped;  // a sample without any remaining view is not in `samples`
  /// Why samples were left out, the reason of most of their views (of equals the first), and how
  /// many.
  std::map<std::string, int> left_out;
  std::vector<int> idle;  // sensors without a view
  long trials = 0;        // number of random postures tried
};

/// A Spread is a standard deviation for all components that a name or glob selects; later ones
/// override earlier ones.
struct Spread {
  std::string pattern;
  double sigma = 0;
};

/// Returns the rig's values plus N(0, sigma), component by component in the table's order; poses
/// get increments on the right.
/// @throws NameError (models/rig/selection.h) beginning with "spread[N]", the place in `spread`;
/// std::invalid_argument if a drawn value is not permitted.
VectorXd draw_truth(const ParameterTable& table, const std::vector<Spread>& spread,
                    std::uint64_t seed);

/// Returns the usual pairs. Cameras and lasers see boards (if there are none: points), `point`
/// sensors points (if there are none: boards), `pose` sensors all targets. Chains hold free targets
/// of at most 0.5 m (if there are none: all) that have three points not on a line.
std::vector<std::pair<int, int>> usual_pairs(const Rig& rig);

/// Simulates samples. Random postures have readings of all joints that the pairs need, uniform
/// within limits (without limits: +-pi, +-0.5 m). In turn, a sample contains one free target held
/// by one of its chains, or (without a chain) placed before one of its sensors, or the mounted
/// targets. Each sensor in turn must see the target, unless 1000 postures do not achieve this. A
/// free target needs two views (one if only one sensor may see it); for mounted ones, one is
/// sufficient if joints move between target and sensor.
/// @throws std::invalid_argument: no samples, no pairs; a posture's view without readings or pose;
/// sensors of unknown kinds.
/// @throws std::runtime_error if 1000 postures per sample were not sufficient, naming the pairs
/// that were never seen.
Simulation simulate(const Rig& rig, const ParameterTable& table, const VectorXd& truth,
                    const SimulationOptions& options);

}  // namespace kincal
