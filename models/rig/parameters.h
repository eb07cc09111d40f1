// Every parameter that can be estimated: its kind, name, components, units, and its place in
// the vector of values.
#pragma once

#include <string>
#include <vector>

#include "rig.h"

namespace kincal {

/// A ParameterKind is the kind of a parameter. `own_number` is a sensor's parameter of no other
/// kind.
enum class ParameterKind {
  joint_offset,
  joint_scale,
  joint_shape,  // the parameters of a joint model beyond offset and scale
  backlash,     // of a joint, half width
  temperature,  // of a joint, per kelvin
  ripple,       // of a joint's gears
  coupling,     // of a joint to readings of others
  joint_origin,
  compliance,  // of a joint, about its axis and across it
  load,        // of a link that a joint moves; its owner is the joint
  sensor_pose,
  intrinsics,
  distortion,
  baseline,
  range_scale,  // of a sensor of points, along its rays
  range_offset,
  own_number,
  time_offset,  // of a sensor
  line_time,    // of a camera
  target_pose,
  square,
  warp,
  print,
  points
};

/// A Parameter is a row of the formats' table. Values are in one vector: a pose as 12 numbers
/// (rotation column by column, translation), other parameters as their components. The unknowns of
/// a pose are its 6 components, increments from the initial value.
struct Parameter {
  std::string name;                     // e.g. "joint/l_elbow_flex_joint/offset"
  std::vector<std::string> components;  // names after the dot; {""} if there is only one
  std::vector<std::string> units;       // one per component
  bool pose = false;
  int start = 0;  // in the vector of values
  ParameterKind kind = ParameterKind::own_number;
  int owner = -1;                         // index of the joint, sensor or target that it belongs to
  double usual_error = 0, yardstick = 0;  // of joint_shape: those of its model (JointNumber)
  int replaced_by =
      -1;  // of a pose: the joint's origin (the rig's `mount`), or the pose of another
           // sensor, that is calibrated instead; no name or glob then matches this one

  /// True for the components of a floating joint's pose: they are not unknowns, and no name or
  /// pattern matches them.
  bool hidden() const { return name.empty(); }
  int size() const { return static_cast<int>(components.size()); }
  std::string component_name(int c) const {
    return components[c].empty() ? name : name + "." + components[c];
  }
};

/// A Component is one component of one parameter, a possible unknown.
struct Component {
  int parameter = -1, index = 0;
  bool operator==(const Component& o) const { return parameter == o.parameter && index == o.index; }
  bool operator!=(const Component& o) const { return !(*this == o); }
  bool operator<(const Component& o) const {
    return parameter != o.parameter ? parameter < o.parameter : index < o.index;
  }
};

/// Freed lists the estimated components of a parameter.
struct Freed {
  int parameter = -1;
  std::vector<int> components;  // ascending

  bool whole(const Parameter& p) const { return static_cast<int>(components.size()) == p.size(); }
};

struct ParameterTable {
  std::vector<Parameter> all;
  VectorXd initial;  // the rig's values
  // Indices into `all`, -1 where there is none.
  std::vector<int> joint_offset, joint_scale,
      joint_origin;  // by joint; the parameters of a joint's position, its own numbers, are those
                     // from the offset on, up to its origin
  std::vector<int> compliance, load;  // by joint, where joints bend
  std::vector<int> sensor_pose;       // by sensor
  std::vector<int> sensor_block;      // by sensor: its first own block; blocks follow one another
  std::vector<int> time_offset, line_time;  // by sensor
  std::vector<int> target_pose, target_square, target_warp, target_print,
      target_points;                            // by target
  std::vector<int> sensor_mount, target_mount;  // the calibrated mount: its pose, or
                                                // the origin that replaces it

  explicit ParameterTable(const Rig& rig);

  /// Returns whether there is a parameter of a kind.
  bool has(ParameterKind kind) const;
  /// Returns the first parameter of a kind that a joint, sensor or target has; -1: none.
  int index_of(ParameterKind kind, int owner) const;
  std::string name(const Component& c) const { return all[c.parameter].component_name(c.index); }
  const std::string& unit(const Component& c) const { return all[c.parameter].units[c.index]; }

  /// Returns the components that a name, component name, glob or geometry/BASE..TIP (geometry.h)
  /// selects. Exact names have precedence over globs. Empty if nothing matches.
  std::vector<Freed> select(const std::string& pattern) const;
  /// Returns the same if something matches. @throws NameError (selection.h) beginning with `where`;
  /// std::invalid_argument if a geometry/BASE..TIP is malformed, has no parameter to estimate, or
  /// has a floating or planar joint on its path.
  std::vector<Freed> find(const std::string& pattern, const std::string& where) const;
  /// Returns whether this is the name of a whole parameter or of one component, not a glob.
  bool is_plain_name(const std::string& pattern) const { return !select_exact(pattern).empty(); }
  /// Returns all names and component names, for messages.
  std::vector<std::string> names() const;

 private:
  std::vector<Freed> select_exact(const std::string& name) const;
  std::vector<Freed> select_geometry(const std::string& pattern, const std::string& where) const;

  Tree tree_;                   // of the rig, for geometry/BASE..TIP
  std::vector<char> has_pose_;  // by link: a sensor or mounted target is on it
};

/// Returns the rig's initial values of a joint model's parameters beyond offset and scale.
std::vector<double> further_values(const JointSettings& joint);

/// Returns a joint's terms with their values in `values`.
JointTerms terms_at(const Rig& rig, const ParameterTable& table, const VectorXd& values, int joint);

/// Returns a sensor's block of intrinsics, distortion or baseline; null if it has none.
const ParameterBlock* find_block(const Sensor& sensor, ParameterKind kind);

/// Returns the rig with its nominal values applied and its list of these empty.
Rig centred(Rig rig);

Pose get_pose(const VectorXd& values, int start);
void set_pose(VectorXd& values, int start, const Pose& pose);

/// Returns the reason why a component cannot have this value ("a scale is not 0", ...); null if it
/// can.
const char* improper_value(const Parameter& parameter, int component, double value);

}  // namespace kincal
