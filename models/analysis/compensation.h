// Readings that make a real robot, whose joints bend and have error curves, reach the poses planned
// for one that is rigid.
//
// With T(q) the pose of the tip at readings q, * what was planned, the readings wanted are those
// of T_real(q)^-1 T* = 1. From those on at which each joint is where it was planned, each step adds
// J'(J J' + c)^-1 e (or, of a robot with less than six joints on the path, (J'J + c)^-1 J'e, least
// squares, 1 rad as 1 m), e = [p | theta] that pose's translation and rotation vector, J the motion
// of the tip, seen from itself, of the joints as if they were rigid, c = 1e-12 tr. What bending
// changes in J is a thousandth of it, so each step gains three digits.
#pragma once

#include <optional>
#include <vector>

#include "frames.h"

namespace kincal {

/// A RobotTip is a robot, the frame of it that is to be somewhere, and the frame that this is seen
/// from: one that does not move with the joints. (Two calibrations put the base link itself at
/// different places: what stands at the base and sees or is seen is the same in both.)
struct RobotTip {
  CalibratedRobot robot;
  Frame tip, from;
  Conditions conditions = {};

  Pose base_T_tip(const Readings& readings) const { return base_T(tip, readings); }
  Pose base_T_from(const Readings& readings) const { return base_T(from, readings); }
  Pose at(const Readings& readings) const {
    return inverse(base_T_from(readings)) * base_T_tip(readings);
  }

 private:
  Pose base_T(const Frame& frame, const Readings& readings) const {
    return base_T_frame(*robot.rig, *robot.table, robot.values, frame, readings, conditions);
  }
};

/// Returns the frames of sensors and targets that stand still relative to the base.
std::vector<Frame> still_frames(const Rig& rig, const ParameterTable& table);

struct Compensated {
  Readings readings;
  double position = 0, rotation = 0;  // m and rad that are left
};

/// Returns the readings with which `real` is where `planned`, of the same URDF, is at `at`.
/// `position_only`: how the tip is turned does not matter. Readings of joints that do not stand
/// between base and tip stay. It allocates. @throws std::invalid_argument: no joint moves the tip
Compensated compensate(const RobotTip& real, const RobotTip& planned, const Readings& at,
                       bool position_only);
/// Returns the readings with which the tip stands at a pose, from readings near them.
Compensated compensate(const RobotTip& real, const Pose& from_T_tip, const Readings& near,
                       bool position_only);

/// Returns readings within the joints' usual ranges at which a point of the tip (tip's frame, m) is
/// within 1 um of `wanted` (base frame, m), by damped Gauss-Newton steps from `start`; joints that
/// stand at a limit and would leave it stay. nullopt: these steps do not lead there.
std::optional<Readings> reach_point(const RobotTip& robot, const Vector3d& point,
                                    const Vector3d& wanted, const Readings& start);
/// Returns readings at which the tip is within 1 um and 1 urad of a pose (`position_only`: however
/// it is turned), otherwise as reach_point().
std::optional<Readings> reach_pose(const RobotTip& robot, const Pose& from_T_tip,
                                   const Readings& start, bool position_only);

}  // namespace kincal
