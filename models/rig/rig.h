// A rig as plain data: the robot, its sensors and targets, and the steps;
// samples.h has the logged data. io reads files into these; a program may also fill them
// in itself.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../kinematics/bending.h"
#include "../../solver/loss.h"
#include "../joints/joint_model.h"
#include "../sensors/sensor.h"

namespace kincal {

/// Assumed noise if none is stated: of a floating joint's pose (m and rad), of readings of joints
/// that turn (rad) and that slide (m).
constexpr double kGuessedPoseNoise = 3e-4, kGuessedTurnNoise = 2e-4, kGuessedSlideNoise = 1e-4;
inline double guessed_noise(const Joint& joint) {
  return joint.axis_of_pose != PoseAxis::none ? kGuessedPoseNoise
         : joint.type == JointType::prismatic ? kGuessedSlideNoise
                                              : kGuessedTurnNoise;
}

/// JointTerms are the terms of a joint's position in addition to its model (conditions.h), with
/// initial values. A term that is not set has no parameter.
struct JointTerms {
  std::optional<double> backlash = {};     // half width, rad or m
  std::optional<double> temperature = {};  // rad/K or m/K
  std::vector<double> gear_ratios = {};    // cycles of a ripple in a turn of the joint
  bool ratios_found = false;               // in the data: nobody states them
  std::vector<double> ripple = {};         // rad, kRipple values of each ratio; empty: not set
  std::vector<int> coupled_to = {};        // joints whose readings count as well
  std::vector<double> coupling = {};       // by how much, in their order

  bool operator==(const JointTerms& o) const {
    return backlash == o.backlash && temperature == o.temperature && gear_ratios == o.gear_ratios &&
           ripple == o.ripple && coupled_to == o.coupled_to && coupling == o.coupling;
  }
};
/// Values of a ripple: of cos and sin of one cycle, then of cos and sin of two.
constexpr int kRipple = 4;

/// Temperature (degrees Celsius) at which `temperature` moves no joint (ISO 1).
constexpr double kReferenceTemperature = 20;

struct JointSettings {
  double sigma = 0;              // noise of one reading, rad or m; 0: exact
  double offset = 0, scale = 1;  // initial values of the model's first two parameters
  std::shared_ptr<const JointModel> model = linear_joint();
  std::vector<double> further = {};  // initial values of its further parameters; missing ones
                                     // have the model's default (further_values())
  double noise_guess = 0;  // the noise is not stated: the automatic path estimates it, starting
                           // with this; 0: it is stated
  JointTerms terms = {};
};

struct Target {
  std::string name, type;   // type as in the file: chessboard, points, ...
  bool grid = true;         // points = square * layout; else `points` themselves are the parameter
  Eigen::Matrix3Xd layout;  // grid: points for a spacing of 1
  double square = 1;        // m
  bool y_up = false;        // grid: y of the layout points up on the printed side, else down
  Eigen::Matrix2Xd bulge;   // grid that may be warped: height of each point for a warp of
                            // (1, 0) and (0, 1), targets.h; empty: it is flat
  Eigen::Vector2d warp{0, 0};                 // m, of these two shapes
  std::optional<Eigen::Vector2d> print = {};  // grid whose print may be out of scale: stretch and
                                              // shear, targets.h
  Eigen::Matrix3Xd points;                    // not a grid: m, target's frame
  int link = -1;       // mounted on this link; -1: free, its own pose in every sample
  Pose link_T_target;  // where mounted
  bool pose_given =
      false;  // in the rig; else the identity, or unknown (see the formats' "Starting values")
  int mount_joint = -1;  // fixed joint whose origin is calibrated in place of the pose; -1: none

  int count() const { return static_cast<int>(grid ? layout.cols() : points.cols()); }
};

struct Sensor {
  std::string name, type;  // type as in the file: camera, chain, ...
  int link = -1;
  Pose link_T_sensor;  // chain: link_T_target
  bool pose_given = false;
  int mount_joint = -1;  // as a target's
  int pose_of = -1;      // an earlier sensor with the same pose (a rectified pair); -1: none
  std::shared_ptr<const SensorModel> model;
  std::vector<ParameterBlock> parameters;
  std::vector<double> sigma;               // model->sigmas() values
  std::vector<double> noise_guess;         // the noise is not stated: it is estimated, starting
                                           // with these; empty: it is stated
  int scanning_joint = -1;                 // of a scanning sensor
  std::optional<double> time_offset = {};  // s (conditions.h); none: no parameter
  std::optional<double> line_time = {};   // s a row, of a camera (conditions.h); none: no parameter
  int image_width = 0, image_height = 0;  // of a camera, 0: unknown
};

/// A Payload is a mass on a link that the robot carries in the samples that name it.
struct Payload {
  std::string name;
  int link = -1;
  double mass = 0;                     // kg
  Vector3d centre = Vector3d::Zero();  // of mass, m, in the link's frame
};

/// A PriorSetting is a prior as written: one sigma for all components, or separate ones for the
/// translation and rotation of poses.
struct PriorSetting {
  std::string pattern;
  double translation = 0, rotation = 0;
  bool split = false;  // written as {translation, rotation}: poses only
  std::string where;   // file:line: field, for messages
};

struct Step {
  std::string name;
  std::vector<int> sensors;             // indices, in the rig's order
  std::vector<std::string> free;        // names and globs, in the file's order
  std::vector<std::string> free_where;  // file:line: field of each, for messages
  std::optional<Loss> loss;
  std::vector<PriorSetting> priors;
};

/// An Elasticity describes the bending of joints under the weight that they carry
/// (kinematics/bending.h). Values are by joint index, zero if a joint does not bend or carries
/// nothing that moves.
struct Elasticity {
  Vector3d gravity{0, 0, -9.81};  // m/s^2, seen from the base
  Matrix3d root_R_base = Matrix3d::Identity();
  bool rotor = false;                // compliances turn with the joints' outputs
  bool added = false;                // by the automatic path, which tries it again
  std::vector<Vector3d> compliance;  // about the axis and across it, rad/Nm
  std::vector<double> turned;        // rotation of the directions across the axis about it, rad
  std::vector<Vector3d> load;        // first moment of the link that the joint moves, kg m
  std::shared_ptr<const Skeleton> skeleton;
};

/// A NominalValue is a parameter's value before any calibration. The automatic path's priors are
/// centred on it. The value of a pose is in `pose`.
struct NominalValue {
  std::string parameter;
  std::vector<double> numbers;
  Pose pose;
};

struct Rig {
  Tree tree;
  int base = 0;                       // link: frame of free target poses
  std::vector<JointSettings> joints;  // by joint index; meaningless for joints without a reading
  std::vector<Target> targets;
  std::vector<Sensor> sensors;
  std::vector<LinkMass> masses;          // by link, as the URDF has them; empty: unknown
  std::optional<Elasticity> elasticity;  // none: joints do not bend (elasticity.h)
  std::vector<Payload> payloads;         // that samples may name
  std::vector<Step> steps;
  std::vector<PriorSetting> priors;   // of the automatic path, if there are no steps
  std::vector<NominalValue> nominal;  // of the parameters that an automatic calibration changed
};

enum class NoiseMode { latent, marginal, point, none };

}  // namespace kincal
