// The poses of ISO 9283: five points on an inclined plane of the largest cube in the workspace.
//
// The cube's edges are parallel to the axes of the base. With centre c and edge a, P1 = c, and P2
// to P5 = c + 0.4 a (+-1, +-1, +-1) stand on both diagonals of a plane through two opposite edges,
// at 0.8 of the half diagonal. The cube is in the workspace where 27 points of it are reached: all
// c + a/2 (i, j, k) with i, j, k of -1, 0, 1. It is the largest cube of a lattice of 13 points
// along the longest side of the box around all known positions (of equal ones the one with the
// largest x, then z), and then grows and moves by ever smaller steps down to 1/16 of a lattice
// step.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

/// Readings by joint index with which a point (base frame, m) is reached; nullopt: it is not.
using ReachPoint = std::function<std::optional<std::vector<double>>(const Vector3d& point)>;

struct TestPose {
  std::string name;  // P1 to P5
  Vector3d point;    // m, base frame
  std::vector<double> readings;
};

struct TestPoses {
  Vector3d centre{0, 0, 0};     // of the cube, m, base frame
  double edge = 0;              // m; 0: no cube was found
  std::vector<TestPose> poses;  // empty: on none of four planes are all five reached
};

/// Finds cube and poses. `known`: positions that are reached, m, base frame, at least one.
TestPoses find_test_poses(const std::vector<Vector3d>& known, const ReachPoint& reach);

}  // namespace kincal
