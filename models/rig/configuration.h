// The robot in one configuration: at given values of all parameters and given readings of its
// joints, where everything is.
//
// The position of a joint with a reading is its model's (models/joints/joint_model.h); a follower's
// is that of the joint it mimics, times and plus constants (driver() of kinematics/tree.h). Every
// position of a joint and every pose of a link comes from here; the formula stands nowhere else.
// (Derivatives: models/estimation, models/analysis/frames.)
#pragma once

#include <memory>
#include <vector>

#include "parameters.h"
#include "samples.h"

namespace kincal {

/// A Configuration refers to all that it is made from, so it is for use on the spot. It is cheap to
/// make and to copy.
class Configuration {
 public:
  /// `readings` are by joint index, in rad or m. NaN means absent, which is an error only where the
  /// joint is queried.
  Configuration(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                const std::vector<double>& readings)
      : rig_(&rig), table_(&table), values_(&values), readings_(&readings) {
    if (rig.elasticity) bend_joints();
  }

  /// Returns the same configuration with another reading of one joint (of a scanning one: a ray's
  /// own).
  Configuration with(int joint, double reading) const {
    Configuration out = *this;
    out.joint_ = joint;
    out.reading_ = reading;
    return out;
  }

  const Rig& rig() const { return *rig_; }
  const ParameterTable& table() const { return *table_; }
  const std::vector<double>& readings() const { return *readings_; }
  double reading(int joint) const { return joint == joint_ ? reading_ : (*readings_)[joint]; }
  /// Returns the numbers of a joint's model, from the offset on; the joint must have a reading.
  const double* own_numbers(int joint) const {
    return values_->data() + table_->all[table_->joint_offset[joint]].start;
  }
  /// Returns the position of a joint, in rad or m, of followers too; it is 0 for joints without an
  /// axis.
  double position(int joint) const;
  /// Returns parent_T_joint as it stands in the values.
  Pose origin(int joint) const {
    return get_pose(*values_, table_->all[table_->joint_origin[joint]].start);
  }
  /// Returns what a joint does to its origin: how it bends, then how it moves.
  Pose motion(int joint) const {
    const Pose moved = joint_motion(rig_->tree.joints[joint], position(joint));
    return bent_ ? Pose{bend_of(joint) * moved.rotation, bend_of(joint) * moved.translation}
                 : moved;
  }
  /// Returns the equilibrium of the rig's elasticity; null where joints do not bend. Where there is
  /// none, poses are NaN.
  const BentPosture* bent() const { return bent_.get(); }
  /// Returns exp(delta) of a joint that bends, else the identity.
  Matrix3d bend_of(int joint) const;

  /// Returns the pose of link b in link a. @throws std::invalid_argument if a floating or planar
  /// joint lies between.
  Pose a_T_b(int a, int b) const;
  Pose base_T_link(int link) const { return a_T_b(rig_->base, link); }
  Pose link_T_sensor(int sensor) const {
    return get_pose(*values_, table_->all[table_->sensor_pose[sensor]].start);
  }
  Pose base_T_sensor(int sensor) const {
    return base_T_link(rig_->sensors[sensor].link) * link_T_sensor(sensor);
  }
  /// The target must be mounted.
  Pose base_T_target(int target) const {
    return base_T_link(rig_->targets[target].link) *
           get_pose(*values_, table_->all[table_->target_pose[target]].start);
  }

 private:
  void bend_joints();

  std::shared_ptr<const BentPosture> bent_;
  const Rig* rig_;
  const ParameterTable* table_;
  const VectorXd* values_;
  const std::vector<double>* readings_;
  int joint_ = -1;
  double reading_ = 0;
};

/// Returns the joints whose readings place link b relative to link a, in the order of the path,
/// without `except` (-1: none).
std::vector<int> joints_between(const Rig& rig, int a, int b, int except = -1);
/// Returns the same for a view: between its sensor and its target (of a free one: the base).
std::vector<int> joints_between(const Rig& rig, const View& view);
/// Returns the joints whose readings place a sensor (-1: none) and a target (-1: none; free ones
/// need none) relative to the base, without the sensor's scanning joint unless the target needs it.
std::vector<int> needed_readings(const Rig& rig, int sensor, int target);
/// Returns the joints whose readings a view of the sensor on the target needs: of a mounted target
/// those that place one relative to the other. A joint that carries both cancels, but for a sensor
/// whose own scanning joint carries both: their readings of that differ.
std::vector<int> view_readings(const Rig& rig, int sensor, int target);
/// Returns readings with 0 in place of absent ones, for computations that do not depend on them.
std::vector<double> completed(std::vector<double> readings);
/// Returns whether there is a reading of every joint that places `link` relative to the base.
bool has_readings(const Rig& rig, int link, const std::vector<double>& readings);

}  // namespace kincal
