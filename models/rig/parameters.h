// Every number that can be freed: its name, components, units, and where it stands in the vector of values.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "rig.h"

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A parameter of the formats' table. Values stand in one vector: a pose as 12 numbers (rotation column by column, translation),
/// anything else as its numbers. The unknowns of a pose are its 6 components, increments from the initial value.
struct Parameter {
  std::string name;                     // e.g. "joint/l_elbow_flex_joint/offset"
  std::vector<std::string> components;  // names after the dot; {""} for a single number
  std::vector<std::string> units;       // one a component
  bool pose = false;
  int start = 0;  // in the vector of values

  int size() const { return static_cast<int>(components.size()); }
  std::string component_name(int c) const { return components[c].empty() ? name : name + "." + components[c]; }
};

/// Some components of a parameter.
struct Freed {
  int parameter = -1;
  std::vector<int> components;  // ascending

  bool whole(const Parameter& p) const { return static_cast<int>(components.size()) == p.size(); }
};

/// A name or glob of parameters that matches nothing; `name` is what is unknown and `valid` what it could be, so that callers can add
/// the nearest ones.
class NameError : public std::invalid_argument {
 public:
  NameError(const std::string& where, const std::string& n, std::vector<std::string> v = {})
      : NameError(where + ": '" + n + "' matches no parameter", n, std::move(v), 0) {}
  /// A geometry/BASE..TIP whose link does not exist.
  static NameError link(const std::string& where, const std::string& pattern, const std::string& n, std::vector<std::string> v) {
    return NameError(where + ": '" + pattern + "': there is no link '" + n + "'", n, std::move(v), 0);
  }
  std::string name;
  std::vector<std::string> valid;

 private:
  NameError(const std::string& what, std::string n, std::vector<std::string> v, int)
      : std::invalid_argument(what), name(std::move(n)), valid(std::move(v)) {}
};

struct ParameterTable {
  std::vector<Parameter> all;
  VectorXd initial;  // the rig's values
  // Indices into `all`, -1 where there is none.
  std::vector<int> joint_offset, joint_scale, joint_origin;    // by joint
  std::vector<int> sensor_pose;                                // by sensor
  std::vector<int> sensor_block;                               // by sensor: its first own block; blocks follow one another
  std::vector<int> target_pose, target_square, target_points;  // by target

  explicit ParameterTable(const Rig& rig);

  /// What a name, component name, glob or geometry/BASE..TIP (models/rig/geometry.h) means. Exact names go before globs. Nothing found: empty.
  std::vector<Freed> select(const std::string& pattern) const;
  /// The same, with something found. @throws NameError beginning with `where`; std::invalid_argument where a geometry/BASE..TIP is not
  /// written so, has nothing to free, or a floating or planar joint on its way.
  std::vector<Freed> find(const std::string& pattern, const std::string& where) const;
  /// The name of a whole parameter or of one component, as written: no glob.
  bool is_plain_name(const std::string& pattern) const { return !select_exact(pattern).empty(); }
  /// All names and component names, for messages.
  std::vector<std::string> names() const;

 private:
  std::vector<Freed> select_exact(const std::string& name) const;
  std::vector<Freed> select_geometry(const std::string& pattern, const std::string& where) const;

  Tree tree_;                   // of the rig, for geometry/BASE..TIP
  std::vector<char> has_pose_;  // by link: a sensor or mounted target stands on it
};

Pose get_pose(const VectorXd& values, int start);
void set_pose(VectorXd& values, int start, const Pose& pose);

/// Adds components to those already there, parameter by parameter; new parameters go to the end.
void merge(std::vector<Freed>& into, const std::vector<Freed>& more);

}  // namespace kincal
