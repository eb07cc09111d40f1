// How well a frame of the robot is known, and how far two calibrations put it apart.
//
// A frame's pose base_T_frame depends on the joints' offsets, gear scales and origins along the
// path from the base, and for the frame of a sensor or of a mounted target on its own pose. With
// the twist [v | w], seen from the base, that each unknown gives to what lies behind it
// (kinematics/tree.h; a revolute joint's offset: its position's twist; its scale: that times the
// reading; an origin's or pose's increment xi: Ad xi, for partly freed poses Ad J_r(xi),
// models/estimation/estimation.h), the frame's origin p and its axes move by
//     dp = v + w x p,   dtheta = w,
// the rows of J (6 x unknowns). With the unknowns' covariance C of a calibration's last step
//     covariance of (dp, dtheta) = J C J',
//     sigma of the position = sqrt(trace of its upper block), of the rotation = that of the lower:
// the root mean square that the length of the error would have over many such calibrations. What
// the last step held is taken as exact. Noise of the joint readings when the robot is used (one
// draw a joint) adds, with Jq the motion by the readings, Jq S Jq'.
//
// A direction d that the data do not determine moves the frame if J d is not zero: then the
// position, or rotation, is not determined.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "linearisation.h"

namespace kincal {

/// A Frame is a link, or the frame of a sensor or mounted target on it (for a chain: of the target
/// that it holds).
struct Frame {
  std::string name;  // LINK, sensor/NAME, target/NAME
  int link = -1;
  int pose = -1;  // parameter link_T_frame, -1: the link itself
};
/// Returns every frame that a path leads to from the base.
std::vector<Frame> all_frames(const Rig& rig, const ParameterTable& table);
/// Returns the frame of a name; nullopt if there is none.
std::optional<Frame> find_frame(const Rig& rig, const ParameterTable& table,
                                const std::string& name);

/// Unknowns are what a step freed, with their covariance.
struct Unknowns {
  std::vector<Component> columns;
  std::map<int, Matrix6d> charts;  // J_r(xi) of partly freed poses, by parameter
  MatrixXd covariance;             // 0 along `undetermined`
  MatrixXd undetermined;           // columns: directions, real units
  std::vector<int> unseen;         // parameters: open poses that no training sample tells of
};
/// Returns what the last step freed, and its covariance at the solution. It builds and linearises
/// the problem anew.
Unknowns last_unknowns(const Linearisation& at);

using Readings = std::vector<double>;  // by joint index; NaN: absent

/// Draws postures uniformly within the joints' limits (without: +-pi, +-0.5 m); they are the same
/// for a seed.
std::vector<Readings> random_postures(const Rig& rig, int count, std::uint64_t seed);

/// Returns base_T_frame at readings.
Pose base_T_frame(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                  const Frame& frame, const Readings& readings);

/// Poses of sensors and mounted targets that no training sample shows although the calibration
/// would estimate them.
struct UnseenPoses {
  std::vector<int> open;   // parameters: the rig does not give them, so nothing is known of them
  std::vector<int> given;  // they keep the rig's value
};
UnseenPoses unseen_poses(const Solution& solution);

/// A FrameDerivative is that of [position | rotation vector] of the frame, base axes: by the
/// unknowns (6 x columns) and by the noise of the readings, one sigma each (6 x joints with a
/// reading and a sigma on the path).
struct FrameDerivative {
  MatrixXd by_unknowns, by_readings;
  std::vector<int> joints;  // whose readings these are
};
FrameDerivative frame_derivative(const Rig& rig, const ParameterTable& table,
                                 const VectorXd& values, const Unknowns& unknowns,
                                 const Frame& frame, const Readings& readings);

/// SigmaStatistics are taken over postures; sigmas are in m or rad. NaN: not determined.
struct SigmaStatistics {
  double rms, median, worst;
};
struct FrameSigma {
  std::string workspace;  // `samples`: the readings of the samples; `limits`: random within the
                          // joints' limits
  long postures = 0;
  SigmaStatistics position, rotation;  // of the calibration alone
  SigmaStatistics position_with_readings,
      rotation_with_readings;  // and the noise of one reading of each joint
};
struct FrameReport {
  std::string frame, base;
  std::vector<FrameSigma> workspaces;  // without `samples` where no sample has the readings
  std::vector<std::string> held;  // parameters on the path that earlier steps estimated and the
                                  // last one held: taken as exact
};
/// Predicts the sigma of a frame relative to the base. `unknowns` are last_unknowns() of the same
/// result.
FrameReport report_frame(const Solution& solution, const Unknowns& unknowns, const Frame& frame);

/// Returns the covariance of the position relative to the base (m², base axes) of every sensor and
/// mounted target, by its pose's parameter, at the readings of the first sample that has those on
/// the way to it. Those that are not determined are missing.
std::map<int, Matrix3d> position_covariances(const Solution& solution, const Unknowns& unknowns);

/// A CalibratedRobot has a rig, its parameters and their values, and what is known of their errors.
struct CalibratedRobot {
  const Rig* rig;
  const ParameterTable* table;
  VectorXd values;
  std::optional<Unknowns> unknowns;
};
struct FrameDifference {
  std::string frame;
  long postures = 0;
  double position_rms, position_worst, rotation_rms,
      rotation_worst;                     // m, rad; NaN without postures
  double position_sigma, rotation_sigma;  // predicted rms of the difference, from both covariances;
                                          // NaN: unknown or not determined
};
/// Compares E = a_T_frame^-1 b_T_frame over postures, given by the joint indices of either.
FrameDifference compare_frame(const CalibratedRobot& a, const CalibratedRobot& b, const Frame& in_a,
                              const Frame& in_b, const std::vector<Readings>& postures_a,
                              const std::vector<Readings>& postures_b);

}  // namespace kincal
