// Loops: the agreement of every pair of sensors through the robot (the paper's figure 10).
//
// Where two sensors see the same target in the same sample, the points of the one are carried
// through the kinematics into the residual of the other, compared with its measurement:
//     hub_p = hub_T_from p_from,    r = h_to(to_T_hub hub_p) - z_to,
//     hub: the base, or the link that carries the target.
// Joint readings are raw and shared parameters unchanged; no target's pose is estimated, and only
// the two sensors take part. So a loop shows the error of a robot that looks with one sensor and
// acts with the other.
//
// Points p_from of a view, in its sensor's frame: a point sensor's and a laser's as measured (a
// ray's at its own reading of the scanning joint); a camera's the points that it saw, at the pose
// that best explains this view alone (perspective pose); a pose's and a chain's all points of the
// target, at the measured pose and in the hand. Residual of `to`: as in the formats' table, at the
// points that both have; of a chain or pose the translation of E = Z^-1 to_T_hub hub_T_target with
// hub_T_target the rigid fit of the carried points, where these are not on a line.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// LoopStatistics are root mean squares in the unit of the sensor `to`. NaN: none, or a transformed
/// point lies behind the camera.
struct LoopStatistics {
  long points = 0;  // of a chain or pose: views
  double rms_before = std::numeric_limits<double>::quiet_NaN(),
         rms = std::numeric_limits<double>::quiet_NaN();
};

/// A Loop is one ordered pair of sensors.
struct Loop {
  std::string from, to, unit;
  LoopStatistics train, test;
};

/// A LoopView is one view transformed into another one of the same sample: r_h, one column per
/// point. NaN: the point was not transformed; infinite: it lies behind the camera.
struct LoopView {
  int sample = -1;
  const View *from = nullptr, *to = nullptr;
  std::vector<int> ids;  // of the target's points; empty: a chain's or pose's one translation
  MatrixXd before, after;
};

/// Returns all pairs of views that contain the same points of a target in one sample, in the order
/// of the samples. "before" is at the rig's values (absent poses: at their starting values),
/// "after" at the solution's. They point into the solution's samples.
std::vector<LoopView> loop_views(const Solution& solution);

/// Returns the root mean squares of all pairs of sensors that have a common sample, in the rig's
/// order.
std::vector<Loop> loops(const Solution& solution, const std::vector<LoopView>& views);

}  // namespace kincal
