// Random postures: the readings of all joints that matter are drawn until enough is seen. The rules
// stand at simulate() of simulation.h.
//
// Where a thousand draws do not show a mounted target to a sensor, as a camera on an arm that
// seldom looks at its board, the joints are moved to where it does: a place of the target before
// the sensor is drawn as for free targets, and damped Gauss-Newton steps on the readings, within
// their limits, go towards it.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "world.h"

namespace kincal {

/// A PostureGroup is what random postures are about: a free target in a chain's hand or placed
/// (holder -1), or all mounted ones (target -1).
struct PostureGroup {
  int target, holder;
  std::vector<SensorTarget> observers;  // pairs that may see it
};

/// RandomPostures draws postures until they show enough. It keeps references to its arguments.
class RandomPostures {
 public:
  /// @throws std::invalid_argument if nothing is seen by any pair.
  RandomPostures(const Rig& rig, const World& world, const std::vector<SensorTarget>& pairs,
                 std::uint64_t seed, int samples);

  /// Draws sample k. @throws std::runtime_error when 1000 postures a sample were not enough, naming
  /// what was never seen.
  Draft next(int k);
  /// Returns how many postures were tried.
  long trials() const { return trials_; }

 private:
  std::optional<Draft> attempt(int k, const PostureGroup& group, const SensorTarget* goal);
  std::optional<Draft> carry_out(const Posture& posture, const PostureGroup& group,
                                 const SensorTarget* goal, const RandomStream& noise);
  std::optional<Draft> reach(int k, const PostureGroup& group, const SensorTarget& goal);
  Posture random_posture(int k);
  [[noreturn]] void give_up(const PostureGroup& group) const;

  const Rig& rig_;
  const World& world_;
  const std::vector<SensorTarget>& pairs_;
  std::uint64_t seed_;
  int samples_;
  std::vector<PostureGroup> groups_;
  RandomStream draws_;
  std::vector<int> joints_;
  std::set<SensorTarget> moving_;  // pairs of mounted targets that a posture moves
  std::set<std::pair<int, SensorTarget>>
      failed_goals_;  // goals, with the holder, that were not met once
  std::set<SensorTarget> seen_;
  std::set<SensorTarget> reached_;  // pairs of mounted targets that had to be reached
  long trials_ = 0, relaxed_ = 0;
};

}  // namespace kincal
