// Where the robot is asked to stand, what is looked at, and what of that cannot be.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// A Posture is where the robot is asked to stand, and what is looked at.
struct Posture {
  std::string id;
  std::vector<double> readings;  // true ones, by joint index, NaN: absent
  std::vector<std::pair<int, int>>
      views;  // (sensor, target) in the samples' order; empty: all that see something
  std::map<int, Pose> targets;  // base_T_target of free targets that no chain holds
};

/// A DroppedView is one that a posture asks for and that cannot be.
struct DroppedView {
  std::string sample;
  int sensor, target;
  std::string why;
};

}  // namespace kincal
