// A simulated recording: how a robot goes from posture to posture, and what it logs on the way.
//
// The robot rests at each posture for `rest` seconds and goes to the next in `move` seconds, all
// joints at once along the polynomial 10 u^3 - 15 u^4 + 6 u^5, which starts and ends at rest. What
// the sample's logged readings differ from the true ones by is what encoders, gears and bending do
// in this posture: it stays while the robot rests and goes over into the next posture's as the
// joints do. Each reading has scatter of its own besides, `scatter` times the joint's sigma, which
// averaging removes. A free target that the same chain holds before and after goes with that
// chain's frame, another that is there before and after goes through base, and one that is not
// there in both is gone while the robot moves.
#pragma once

#include <vector>

#include "../rig/random_stream.h"
#include "simulation.h"

namespace kincal {

/// A Stop is a posture that the robot rests in.
struct Stop {
  Posture truth;               // true readings, and poses base_T_target of free targets
  std::vector<double> logged;  // readings of the sample, by joint index
  std::map<int, int> holders;  // chain sensor by free target that it holds
};

struct JourneyOptions {
  double rest = 1.5, move = 1;  // s
  double scatter = 0.3;         // of a reading, in sigmas of the joint
};

/// A Journey goes through all stops, from the beginning of the first rest (time 0) to the end of
/// the last. It keeps references to its arguments.
class Journey {
 public:
  Journey(const Rig& rig, const ParameterTable& table, const VectorXd& truth,
          const std::vector<Stop>& stops, const JourneyOptions& options)
      : rig_(rig), table_(table), truth_(truth), stops_(stops), options_(options) {}

  /// Returns how long it takes, s.
  double duration() const {
    return static_cast<double>(stops_.size()) * (options_.rest + options_.move) - options_.move;
  }
  /// Returns the stop that the robot rests in at a time, s; -1: it moves.
  int resting(double time) const;
  /// Returns how the robot really stands at a time, s: true readings, and poses of free targets.
  Posture at(double time) const;
  /// Returns what it logs at a time, s, by joint index.
  std::vector<double> logged(double time, RandomStream& draws) const;

 private:
  struct Phase {
    size_t from, to;  // stops
    double share;     // of the way, 0 to 1
  };
  Phase phase(double time) const;

  const Rig& rig_;
  const ParameterTable& table_;
  const VectorXd& truth_;
  const std::vector<Stop>& stops_;
  JourneyOptions options_;
};

}  // namespace kincal
