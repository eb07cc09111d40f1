// The predicted error of a frame of the robot, and the difference of a frame in two calibrations.
//
// A frame's pose base_T_frame depends on the joints' offsets, gear scales and origins along the
// path from the base, and for the frame of a sensor or of a mounted target on its own pose. With
// the twist [v | w], seen from the base, that each unknown gives to everything behind it
// (kinematics/tree.h; a revolute joint's offset: its position's twist; its scale: that times the
// reading; an origin's or pose's increment xi: Ad xi, for partly estimated poses Ad J_r(xi),
// models/estimation/estimation.h), the frame's origin p and its axes move by
//     dp = v + w x p,   dtheta = w,
// the rows of J (6 x unknowns). With the unknowns' covariance C of a calibration's last step
//     covariance of (dp, dtheta) = J C J',
//     sigma of the position = sqrt(trace of its upper block), of the rotation = that of the lower:
// the root mean square length of the error over many such calibrations. Components that the last
// step fixed count as exact. Noise of the joint readings when the robot is used (one draw per
// joint) adds Jq S Jq', with Jq the motion by the readings.
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

/// A Frame of a rig and its table is a link, or the frame of a sensor or mounted target on it (for
/// a chain: of the target that it holds).
struct Frame {
  std::string name;  // LINK, sensor/NAME, target/NAME
  int link = -1;
  int pose = -1;  // parameter link_T_frame in that table, -1: the link itself
};
/// Returns all frames connected to the base by a path.
std::vector<Frame> all_frames(const Rig& rig, const ParameterTable& table);
/// Returns the frame with this name; nullopt if there is none.
std::optional<Frame> find_frame(const Rig& rig, const ParameterTable& table,
                                const std::string& name);

/// Charts are J_r(xi) of partly estimated poses, by parameter.
using Charts = std::map<int, Matrix6d>;
Charts charts_of(const Solution& solution);

/// Unknowns are the components that a step estimated, with their covariance.
struct Unknowns {
  std::vector<Component> columns;
  Charts charts;
  MatrixXd covariance;      // 0 along `undetermined`
  MatrixXd undetermined;    // columns: directions, real units
  std::vector<int> unseen;  // parameters: open poses on which no training sample depends
};
/// Returns the components that the last step estimated, with their covariance at the solution. It
/// builds and linearises the problem again.
Unknowns last_unknowns(const Linearisation& at);

using Readings = std::vector<double>;  // by joint index; NaN: absent

/// Draws postures uniformly within the joint limits (if there are none: +-pi, +-0.5 m). The same
/// seed gives the same postures.
std::vector<Readings> random_postures(const Rig& rig, int count, std::uint64_t seed);

/// Returns base_T_frame at readings.
Pose base_T_frame(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                  const Frame& frame, const Readings& readings,
                  const Conditions& conditions = no_conditions());

/// Poses of sensors and mounted targets that the calibration would estimate, but on which no
/// training sample depends.
struct UnseenPoses {
  std::vector<int> open;   // parameters: absent from the rig, so unknown
  std::vector<int> given;  // they keep the rig's value
};
UnseenPoses unseen_poses(const Solution& solution);

/// A FrameDerivative is the derivative of the frame's [position | rotation vector] (base axes) by
/// the unknowns (6 x columns) and by the reading noise, one sigma each (6 x joints on the path with
/// a reading and a sigma).
struct FrameDerivative {
  MatrixXd by_unknowns, by_readings;
  std::vector<int> joints;  // joints of the columns of by_readings
  MatrixXd by_joints;       // by all readings that move it, not by their noise
  std::vector<int> moving;  // joints of its columns
};
FrameDerivative frame_derivative(const Rig& rig, const ParameterTable& table,
                                 const VectorXd& values, const Unknowns& unknowns,
                                 const Frame& frame, const Readings& readings);

/// SigmaStatistics are over postures; sigmas are in m or rad. NaN: not determined.
struct SigmaStatistics {
  double rms, median, worst;
};
struct FrameSigma {
  std::string workspace;  // `samples`: the readings of the samples; `limits`: random within the
                          // joints' limits
  long postures = 0;
  SigmaStatistics position, rotation;  // of the calibration alone
  SigmaStatistics position_with_readings,
      rotation_with_readings;  // with the noise of one reading of each joint
};
struct FrameReport {
  std::string frame, base;
  std::vector<FrameSigma> workspaces;  // without `samples` where no sample has the readings
  std::vector<std::string> held;  // parameters on the path that earlier steps estimated and the
                                  // last one fixed: they count as exact
};
/// Predicts the sigma of a frame relative to the base. `unknowns` are last_unknowns() of the same
/// result.
FrameReport report_frame(const Solution& solution, const Unknowns& unknowns, const Frame& frame);

/// Returns the covariance of the position relative to the base (m², base axes) of every sensor and
/// mounted target, by its pose's parameter. The posture is that of the first sample with all
/// readings on the path. Positions that the data do not determine are omitted.
std::map<int, Matrix3d> position_covariances(const Solution& solution, const Unknowns& unknowns);

/// A CalibratedRobot has a rig, its parameter table, their values, and the covariance of their
/// errors.
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
/// Compares E = a_T_frame^-1 b_T_frame over postures. Each robot's postures are by its own joint
/// indices.
FrameDifference compare_frame(const CalibratedRobot& a, const CalibratedRobot& b, const Frame& in_a,
                              const Frame& in_b, const std::vector<Readings>& postures_a,
                              const std::vector<Readings>& postures_b);

}  // namespace kincal
