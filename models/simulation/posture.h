// Requested postures with their views, and views that are not possible.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../rig/samples.h"

namespace kincal {

/// A Posture is a requested posture of the robot with its views.
struct Posture {
  std::string id;
  std::vector<double> readings;  // true readings, by joint index, NaN: absent
  std::vector<std::pair<int, int>>
      views;                    // (sensor, target) in the samples' order; empty: all possible ones
  std::map<int, Pose> targets;  // base_T_target of free targets that no chain holds
  std::vector<double> from{};   // readings that the robot comes from; empty: it does not matter
  Conditions conditions{};
};

/// A DroppedView is a requested view that is not possible.
struct DroppedView {
  std::string sample;
  int sensor, target;
  std::string why;
};

}  // namespace kincal
