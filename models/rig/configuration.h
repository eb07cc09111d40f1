// The robot in one configuration: all poses at given values of all parameters and given readings of
// its joints.
//
// The position of a joint with a reading is position_of() of conditions.h; a follower's
// is that of the joint it mimics, times and plus constants (driver() of kinematics/tree.h). Every
// joint position and link pose is computed here; the formula occurs in no other place.
// (Derivatives: models/estimation, models/analysis/frames.)
#pragma once

#include <memory>
#include <vector>

#include "conditions.h"
#include "parameters.h"
#include "samples.h"

namespace kincal {

/// A MeasuringTime is that of a sensor, of a camera with a rolling shutter that of a row of its
/// image; sensor -1: that of the readings.
struct MeasuringTime {
  int sensor = -1;
  double row = 0;
};
/// Returns the time of a view; with a rolling shutter that of the mean row of its points.
MeasuringTime time_of(const Rig& rig, const View& view);

/// A Configuration refers to its inputs, so it must not outlive them. It is cheap to make and to
/// copy.
class Configuration {
 public:
  /// `readings` are by joint index, in rad or m. NaN means absent, which matters only if the joint
  /// is queried. `at` is the time at which everything is.
  Configuration(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                const std::vector<double>& readings, const Conditions& conditions = no_conditions(),
                const MeasuringTime& at = {})
      : rig_(&rig),
        table_(&table),
        values_(&values),
        readings_(&readings),
        conditions_(&conditions) {
    if (at.sensor >= 0 && table.time_offset[at.sensor] >= 0)
      later_ = values(table.all[table.time_offset[at.sensor]].start);
    if (at.sensor >= 0 && table.line_time[at.sensor] >= 0)
      later_ += at.row * values(table.all[table.line_time[at.sensor]].start);
    if (rig.elasticity) bend_joints();
  }

  /// Returns the same configuration with another reading of one joint (a scanning joint: a ray's
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
  double reading(int joint) const {
    return joint == joint_ ? reading_
                           : (*readings_)[joint] + later_ * stated(conditions_->rates, joint);
  }
  /// Returns the parameters of a joint's model, from the offset on. The joint must have a reading.
  const double* own_numbers(int joint) const {
    return values_->data() + table_->all[table_->joint_offset[joint]].start;
  }
  /// Returns the position of a joint or follower, in rad or m; 0 for joints without an axis.
  double position(int joint) const;
  /// Returns d position / d own_numbers()[k] of a joint with a reading.
  double by_own_number(int joint, int k) const {
    return kincal::by_own_number(
        *rig_, joint, k, [this](int j) { return reading(j); }, own_numbers(joint),
        conditions(joint));
  }
  /// Returns d position / d reading of joint `by` of a joint with a reading.
  double by_reading_of(int joint, int by) const {
    return kincal::by_reading_of(*rig_, joint, by, reading(joint), own_numbers(joint));
  }
  /// Returns parent_T_joint from the values.
  Pose origin(int joint) const {
    return get_pose(*values_, table_->all[table_->joint_origin[joint]].start);
  }
  /// Returns the motion of a joint behind its origin: its deflection, then its position.
  Pose motion(int joint) const {
    const Pose moved = joint_motion(rig_->tree.joints[joint], position(joint));
    return bent_ ? Pose{bend_of(joint) * moved.rotation, bend_of(joint) * moved.translation}
                 : moved;
  }
  /// Returns the equilibrium of the rig's elasticity; null if joints do not bend. Without an
  /// equilibrium all poses are NaN.
  const BentPosture* bent() const { return bent_.get(); }
  /// Returns exp(delta) of a joint that bends, else the identity.
  Matrix3d bend_of(int joint) const;

  /// Returns the pose of link b in link a. @throws std::invalid_argument if there is a floating or
  /// planar joint between the two links.
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
  const Conditions& conditions(int joint) const {
    return joint == joint_ ? no_conditions() : *conditions_;
  }

  std::shared_ptr<const BentPosture> bent_;
  const Rig* rig_;
  const ParameterTable* table_;
  const VectorXd* values_;
  const std::vector<double>* readings_;
  const Conditions* conditions_;
  double later_ = 0;  // s, than the readings
  int joint_ = -1;
  double reading_ = 0;
};

/// Returns the joints whose readings determine the pose of link b in link a, in the order of the
/// path, without `except` (-1: none).
std::vector<int> joints_between(const Rig& rig, int a, int b, int except = -1);
/// Returns those between the sensor and the target of a view; for a free target, between the sensor
/// and the base.
std::vector<int> joints_between(const Rig& rig, const View& view);
/// Returns the joints whose readings are needed for the poses of a sensor and a target relative to
/// the base. -1 omits either; a free target needs no readings. The sensor's scanning joint is left
/// out unless the target needs it.
std::vector<int> needed_readings(const Rig& rig, int sensor, int target);
/// Returns the joints whose readings a view of the sensor on the target needs: for a mounted target
/// those between both (a joint that carries both cancels), for a free one needed_readings(). The
/// latter also apply if the sensor's scanning joint is not between both, because its rays have
/// readings of their own.
std::vector<int> view_readings(const Rig& rig, int sensor, int target);
/// Returns readings with 0 in place of absent ones, for computations that do not depend on these.
std::vector<double> completed(std::vector<double> readings);
/// Returns whether every joint between the base and `link` has a reading.
bool has_readings(const Rig& rig, int link, const std::vector<double>& readings);

}  // namespace kincal
