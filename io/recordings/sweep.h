// Boards in the sweeps of a tilting laser, and boards and reflectors in the clouds of a 3-D lidar:
// pure functions from what was logged to a view.
//
// A sweep is what a planar scanner measures while its joint turns one way. Every beam has its own
// reading of that joint, at its own time, between two logged readings; so a beam is a direction
// (reading, bearing), a range and an intensity. How they become points of a target, and how well
// these are known, stands in beam_target.h.
//
// What the view's sigmas mean. They are seen in the beams themselves and are those of the corners,
// not of single beams: a corner's direction comes from all the beams on its four squares, its range
// from those on its two bright ones. No two corners share a beam, so errors of one view's rays are
// independent, as the sensor's model (models/sensors/tilting_laser.h) takes them to be. The joint's
// noise is seen in its readings, and added: corners of one row share it, so it counts as often as a
// row has corners. What all beams have in common is no noise and not in them: an error of the
// ranges as a whole, or of the stamps (up and down then differ: use both).
#pragma once

#include <string>
#include <vector>

#include "../../models/rig/samples.h"
#include "../rig/rig_file.h"

namespace kincal {

/// A LaserScan is one turn of a planar scanner, as the message of that name has it.
struct LaserScan {
  double time = 0;                                                // s, of the first beam
  double angle_min = 0, angle_increment = 0, time_increment = 0;  // rad, rad, s, from beam to beam
  std::vector<float> ranges, intensities;  // m; 0, infinite or NaN: nothing was measured
};

/// A TiltReading is what the scanning joint's encoder said.
struct TiltReading {
  double time = 0, reading = 0;  // s, rad (or m)
};

/// A Sweep is scans, and readings from before the first to after the last.
struct Sweep {
  std::vector<LaserScan> scans;
  std::vector<TiltReading> tilt;
};

/// Cuts a recording where the joint rests or turns back: each sweep goes one way, over at least
/// `least` (rad or m). Both must be in the order of their times.
std::vector<Sweep> one_way_sweeps(const Sweep& recorded, double least = 0.05);

/// A BeamView is what was found of a target.
struct BeamView {
  View view;  // with ids, measured numbers, and sigma (of a cloud: a covariance for each point); no
              // ids: not found
  std::vector<double> times;       // s, of each point: when the beam passed it
  std::string reason;              // why nothing was found
  std::vector<std::string> notes;  // what is doubtful
  std::string words() const;       // of a line for people: points, sigmas, or the reason
};

/// Finds a target in a sweep of one way: a chessboard, a ChArUco board, or a reflector (a target of
/// type `points` with one point), which has to be the brightest thing. The joints between the
/// scanning joint and the laser, if any, have to be fixed.
/// @throws InputError where the target is of another type
BeamView find_in_sweep(const RigFile& rig, int sensor, int target, const Sweep& sweep);

/// A Cloud is points with intensities in the sensor's frame, in any order; points at the origin and
/// those that are not finite were not measured.
struct Cloud {
  double time = 0;               // s
  std::vector<Vector3d> points;  // m
  std::vector<double> intensities;
};

/// Finds the same in a cloud, for a sensor of type `point`.
/// @throws InputError as above
BeamView find_in_cloud(const RigFile& rig, int sensor, int target, const Cloud& cloud);

}  // namespace kincal
