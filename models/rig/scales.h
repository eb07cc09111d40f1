// One table of how large errors of parameters are: what priors, trial fits, warnings and verdicts
// go by. It stands in scales.cpp, a row for each kind of parameter and unit, with its reasons; who
// needs to know how far a number is off, how well it should be known or how far it may move asks
// here, for the scales of a component.
//
// Two columns say how far the rig's value of a number is off: `width` in a robot whose maker states
// it and whose zeros were set, `usual` in one that nobody has measured. The automatic path begins
// with `width` and learns from the data by which factor that is wrong. Where nothing is learned
// (starts of restarts, the unit of a fleet's numbers) it is `usual`, in the doctor's fits the
// smaller of `usual` and three widths.
#pragma once

#include <string>

#include "parameters.h"

namespace kincal {

/// Scales are sizes of the error of one number, in its own unit (m, rad, px or none). A size that a
/// kind does not have is infinite.
struct Scales {
  // How far the rig's value is off, as a standard deviation:
  double width = 0;  // the maker states it, or it was measured
  double usual = 0;  // nobody has measured it
  // How well it is known. A sigma above this is
  double yardstick = 0;  // weak; numbers of unlike units are compared in yardsticks
  double loose = 0;      // unfit for use
  double open = 0;       // as good as unknown
  // How far the estimate is from the rig's value. Beyond this
  double least = 0;     // a mistake that the data prove is worth a finding
  double mistaken = 0;  // whoever stated it was mistaken, proof or not
  double reported = 0;  // a warning says so (`moved`, `rescaled`)
  double far = 0;       // it was no start value: rough ones are nearer
};

/// The width of offset (rad) and scale (share) of the joint that turns a scanning sensor: no maker
/// sets it.
constexpr double kScanningOffset = 0.01, kScanningScale = 0.02;

/// Returns the scales of a kind's components with this unit. `nominal`: what shares count from; of
/// 1 they are shares. A unit without a row has those of none; where there are none either, all are
/// infinite. So are width and usual error of joint_shape: each joint model has its own.
Scales scales(ParameterKind kind, const std::string& unit, double nominal = 1);
/// Returns the scales of a component: shares count from its value, of intrinsics from fx. Width,
/// usual error and yardstick of a joint model's further numbers are the model's (JointNumber).
Scales scales(const ParameterTable& table, const Component& component, const VectorXd& values);
/// Returns the scales of a mount's components in m or rad; of other units all are infinite.
inline Scales pose_scales(const std::string& unit) {
  return scales(ParameterKind::sensor_pose, unit);
}

}  // namespace kincal
