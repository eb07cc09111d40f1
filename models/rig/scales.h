// One table of the usual sizes of parameter errors, used by priors, trial fits, warnings and
// verdicts. It is in scales.cpp, with a row and reasons for each kind of parameter and unit.
// The functions below return the scales of a component: the size of its error, the sigma that it
// should have, and how far it may move.
//
// Two columns are sizes of the error of the rig's value: `width` in a robot whose maker states
// the value and whose zeros were set, `usual` in one that nobody has measured. The automatic path
// begins with `width` and learns from the data by which factor that is wrong. Where nothing is
// learned (starts of restarts, the unit of a fleet's components) it uses `usual`, in the doctor's
// fits the smaller of `usual` and three widths.
#pragma once

#include <string>

#include "parameters.h"

namespace kincal {

/// Scales are sizes of the error of one component, in its own unit (m, rad, px or none). Sizes that
/// a kind does not have are infinite.
struct Scales {
  // Error of the rig's value, as a standard deviation:
  double width = 0;  // the maker states it, or it was measured
  double usual = 0;  // nobody has measured it
  // Uncertainty. A sigma above this is
  double yardstick = 0;  // weak; components of different units are compared in yardsticks
  double loose = 0;      // unfit for use
  double open = 0;       // practically undetermined
  // Distance of the estimate from the rig's value. Beyond this
  double least = 0;     // a mistake that the data prove is worth a finding
  double mistaken = 0;  // the stated value was mistaken, proof or not
  double reported = 0;  // a warning reports it (`moved`, `rescaled`)
  double far = 0;       // it was no starting value: even rough ones are nearer
};

/// Prior widths of offset (rad) and scale (share) of the joint that turns a scanning sensor. No
/// maker sets them.
constexpr double kScanningOffset = 0.01, kScanningScale = 0.02;

/// Returns the scales of a kind's components with this unit. Scales that the table has as shares
/// are multiplied by `nominal`; with 1 they stay shares. A unit without a row has the row without a
/// unit; without that row all scales are infinite. Width and usual error of joint_shape are
/// infinite, because each joint model has its own.
Scales scales(ParameterKind kind, const std::string& unit, double nominal = 1);
/// Returns the scales of a component. Shares count from its value (intrinsics: from fx). Width,
/// usual error and yardstick of a joint model's further parameters are the model's (JointNumber).
Scales scales(const ParameterTable& table, const Component& component, const VectorXd& values);
/// Returns the scales of a mount's components in m or rad; for other units all are infinite.
inline Scales pose_scales(const std::string& unit) {
  return scales(ParameterKind::sensor_pose, unit);
}

}  // namespace kincal
