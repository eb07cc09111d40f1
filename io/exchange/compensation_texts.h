// A calibrated robot with what no URDF can hold, for other programs: as data (compensation.json),
// as a C99 header without heap, and as a Python module (numpy). Both have the pose of the tip at
// readings, of the real robot and of the planned one, and the readings with which the real one is
// where the planned one would be (models/analysis/compensation.h).
#pragma once

#include <string>
#include <vector>

#include "../../models/analysis/compensation.h"

namespace kincal {

/// A FlatJoint is a joint of a robot in numbers:  link_above_T_link = origin * exp(delta) *
/// motion(axis, factor * (scale * reading + offset + curve(reading) + temperature * (T - 20) +
/// ripple(reading) + coupling * other readings) + shift),  delta = B diag(c) B' tau where it bends,
/// B its basis (of a rotor turned by the motion), tau the moment of what it carries.
struct FlatJoint {
  std::string name;
  int above = -1;  // index of the joint above
  int type = 0;    // 0: fixed, 1: turns, 2: slides
  Pose origin;
  Vector3d axis = Vector3d::Zero();
  int reading = -1;  // index
  double scale = 1, offset = 0, factor = 1, shift = 0;
  std::vector<double> curve;    // values of a period (joints/curve_joint.h); empty: none
  double temperature = 0;       // per kelvin
  std::vector<double> ripple;   // ratio and kRipple values (models/rig/conditions.h), of each ratio
  std::vector<int> coupled_to;  // indices of readings
  std::vector<double> coupling;
  bool bends = false;
  Matrix3d basis = Matrix3d::Identity();
  Vector3d compliance = Vector3d::Zero(), load = Vector3d::Zero();
};

/// A FlatRobot is what a pose of a tip takes: its joints, those above first.
struct FlatRobot {
  std::vector<FlatJoint> joints;
  int base = -1, tip = -1;              // the joint above the link; -1: the root
  Pose base_frame, tip_frame;           // in that joint's child
  Vector3d gravity = Vector3d::Zero();  // seen from the root
  bool rotor = false;
};

/// A Compensation is both robots, with the same readings.
struct Compensation {
  std::string base, tip;
  std::vector<std::string> readings;
  FlatRobot real, planned;
};
/// @throws std::invalid_argument: a joint on the way has a model or a motion that cannot be
/// written.
Compensation make_compensation(const RobotTip& real, const RobotTip& planned);

std::string compensation_json(const Compensation& compensation);
std::string compensation_header(const Compensation& compensation);
std::string compensation_module(const Compensation& compensation);

}  // namespace kincal
