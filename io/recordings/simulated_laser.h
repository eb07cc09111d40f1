// A tilting laser of a simulated recording: it sweeps while the robot rests.
//
// Half a second after the robot has come to rest in a posture the joint goes from the lowest
// reading to the highest and back, along a cosine, and waits at the lowest. These two are where the
// samples of the simulation have rays, and 0.15 rad (m) beyond, within the joint's limits; where
// they have none, the joint's range. Scans are taken all the time.
#pragma once

#include <vector>

#include "../../models/simulation/journey.h"
#include "../images/studio.h"
#include "simulated_sweep.h"

namespace kincal {

struct SweepOptions {
  double seconds = 0;     // of one way; 0: lasers rest and log nothing
  double scan_rate = 40;  // Hz
};

/// How long before and after the sweeps of a rest the joint rests too, s.
constexpr double kQuiet = 0.5;

/// A SimulatedLaser keeps references to its arguments.
class SimulatedLaser {
 public:
  /// @throws InputError where a camera moves with the laser's joint, or it is not known where the
  /// laser stands
  SimulatedLaser(const Studio& studio, int sensor, const std::vector<Sample>& samples,
                 const std::vector<Stop>& stops, const SweepOptions& sweep,
                 const JourneyOptions& journey);

  int sensor() const { return sensor_; }
  int joint() const { return joint_; }
  /// Returns the joint's true reading at a time, s.
  double reading(double time) const;
  /// Returns the scan that begins at a time, s.
  LaserScan scan(const Journey& journey, double time, RandomStream draws) const;

 private:
  Pose base_T_laser(const Posture& posture, double time) const;

  const Studio& studio_;
  int sensor_, joint_;
  double low_, high_;
  SweepOptions sweep_;
  double period_;  // s, of a rest and a move
  LaserLook look_;
};

}  // namespace kincal
