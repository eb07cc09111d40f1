// Simulation: a rig, what its robot really is, and postures in; the samples that such a robot would
// log out.
//
// Truth and noise. The true position of a joint is  scale * true reading + offset  at the true
// parameters; its logged reading is the true one plus N(0, sigma), one draw a joint and sample,
// which all views of the sample share. A target that a chain holds really is at link_T_target E,
// one that a `pose` sensor sees is measured at sensor_T_target E^-1; translation of E and Log of
// its rotation are N(0, sigma), so that the residuals of models/sensors/pose.h are exactly that. A
// ray's true reading t, bearing and range come from where the point crosses the scan plane (z = 0
// in the sensor's frame): with n the plane's normal, c its offset, u the axis, x the point, in the
// joint's frame,
//     prismatic:  n.(x + q u) + c = 0,      rotation:  A cos q + B sin q + C = 0,
//     A = n.(x - u (u.x)),  B = n.(u x x),  C = (n.u)(u.x) + c;
//     t = (direction q - offset) / scale.
// Everything else is prediction plus N(0, sigma). With all sigmas 0 every residual at the truth is
// 0.
//
// What is seen: whole targets only. Camera: every point inside the image (without image_size: as
// far beyond the principal point as before it), where the lens is one to one. Laser: every point at
// a reading within the joint's limits, |bearing| <= 135 degrees, range > 0.1 m. Views that are not
// asked for by name also need the target's front, at 80 degrees or less from its normal. Nothing
// hides anything.
//
// Draws: std::mt19937_64, uniform numbers of 53 bits and Box-Muller, nothing that differs between
// standard libraries. Truth, postures and the noise of each sample have streams of their own, and a
// sigma of 0 draws like any other: two simulations that differ in one of these have the others in
// common.
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
  /// They are taken in turn, from the first again when there are fewer than samples. Empty: at
  /// random.
  std::vector<Posture> postures;
  /// These pairs (sensor, target) may see, or hold, each other where a posture lists no views;
  /// empty: usual_pairs().
  std::vector<std::pair<int, int>> pairs;
  Progress progress;  // is told before each sample; cancelling leaves the samples so far
};

struct Simulation {
  std::vector<Sample> samples;
  VectorXd truth;                                  // ParameterTable's layout
  std::vector<std::vector<double>> true_readings;  // by sample, as Sample::readings
  std::map<std::pair<int, int>, Pose>
      targets;  // true base_T_target of free targets by (sample, target)

  using Dropped = DroppedView;
  std::vector<Dropped> dropped;  // a sample left without any view is not in `samples`
  std::vector<int> idle;         // sensors without a view
  long trials = 0;               // random postures that were tried
};

/// A Spread is a standard deviation for what a name or glob means; later ones win.
struct Spread {
  std::string pattern;
  double sigma = 0;
};

/// Draws the rig's values plus N(0, sigma), for poses as increments on the right, component by
/// component in the table's order.
/// @throws NameError (models/rig/selection.h) beginning with "spread[N]", the place in `spread`;
/// std::invalid_argument where a value comes out improper.
VectorXd draw_truth(const ParameterTable& table, const std::vector<Spread>& spread,
                    std::uint64_t seed);

/// Returns the usual pairs. Cameras and lasers look at boards (without any: at points), `point`
/// sensors at points (without any: at boards), `pose` sensors at all. Chains hold free targets of
/// at most 0.5 m (without any: all) that have three points not on a line.
std::vector<std::pair<int, int>> usual_pairs(const Rig& rig);

/// Simulates samples. Random postures have readings of all joints that the pairs need, uniform
/// within limits (without: +-pi, +-0.5 m). Sample by sample in turn they show one free target with
/// one of the chains that may hold it, or without chain placed before one of its sensors, or the
/// mounted targets; all sensors in turn are those that must see it, unless 1000 postures do not
/// show it to them. A free target needs two views (one if only one sensor may see it); of mounted
/// ones, one is enough if joints move between it and its sensor.
/// @throws std::invalid_argument: no samples, no pairs; a posture's view without readings or pose;
/// sensors of unknown kinds.
/// @throws std::runtime_error when 1000 postures a sample were not enough, naming what was never
/// seen.
Simulation simulate(const Rig& rig, const ParameterTable& table, const VectorXd& truth,
                    const SimulationOptions& options);

}  // namespace kincal
