// What a scanning laser measures of a simulated scene, beam by beam.
//
// A beam is a spot: many rays around its direction (a Gaussian), each of which sees the nearest
// sheet, or else the wall, a sphere around everything. Intensity is the mean of what the rays see,
// less with distance, with noise and in steps. The range is their mean as well, by how much light
// comes back, so that a beam on the edge of a board measures something between the board and the
// wall. Ink gives less light: its ranges are noisier, and may be longer by a constant.
#pragma once

#include <functional>
#include <vector>

#include "../images/render.h"
#include "beam_target.h"
#include "sweep.h"

namespace kincal {

struct LaserLook {
  double half_angle = 2.35619449, increment = 0.00436332313;  // rad: 1081 beams over 270 degrees
  double turn = 0.025;                        // s, of the mirror; the beams take its share of it
  double spot = 0.0015;                       // rad, sigma of a beam
  double range_noise = 0.008, ink_range = 0;  // m: sigma on paper; how much farther ink is
  double intensity_noise = 60, step = 1;      // of 4000 for paper at 1 m
  double wall = 6;                            // m
};

/// A LaserScene is sheets in a frame at rest, and a seed for the wall.
struct LaserScene {
  std::vector<Sheet> sheets;           // their pose is in that frame
  Vector3d middle = Vector3d::Zero();  // of the wall
  std::uint64_t seed = 1;
};

/// Returns one beam: range and intensity along x of `scene_T_beam`.
Beam shoot(const LaserScene& scene, const Pose& scene_T_beam, const LaserLook& look,
           RandomStream& draws);

/// Returns one turn of the mirror that begins at `time`; `scene_T_sensor` says where the laser is,
/// at every time.
LaserScan simulate_scan(const LaserScene& scene, const std::function<Pose(double)>& scene_T_sensor,
                        double time, const LaserLook& look, RandomStream& draws);

}  // namespace kincal
