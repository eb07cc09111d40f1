// Names and globs of parameters: the error that the selecting functions of ParameterTable
// (parameters.h) throw, and sets of selected components.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "parameters.h"

namespace kincal {

/// A NameError is a name or glob that matches no parameter. `name` is the unknown name and `valid`
/// are the possible ones, so that callers can list the nearest.
class NameError : public std::invalid_argument {
 public:
  NameError(const std::string& where, const std::string& n, std::vector<std::string> v = {})
      : NameError(where + ": '" + n + "' matches no parameter", n, std::move(v), 0) {}
  /// Returns the error of a geometry/BASE..TIP whose link does not exist.
  static NameError link(const std::string& where, const std::string& pattern, const std::string& n,
                        std::vector<std::string> v) {
    return NameError(where + ": '" + pattern + "': there is no link '" + n + "'", n, std::move(v),
                     0);
  }
  /// Returns the error of an unknown group name (automatic/groups.h).
  static NameError group(const std::string& where, const std::string& n,
                         std::vector<std::string> v) {
    return NameError(where + ": there is no group '" + n + "'", n, std::move(v), 0);
  }
  std::string name;
  std::vector<std::string> valid;

 private:
  NameError(const std::string& what, std::string n, std::vector<std::string> v, int)
      : std::invalid_argument(what), name(std::move(n)), valid(std::move(v)) {}
};

/// Returns whether a glob (`*`, `?`, `[...]`; a backslash is an ordinary character) matches the
/// whole name. It is POSIX's fnmatch, not C++'s.
bool glob_matches(const std::string& glob, const std::string& name);

/// Adds components to `into`, parameter by parameter; new parameters are appended.
void merge(std::vector<Freed>& into, const std::vector<Freed>& more);

/// Returns the entry of a parameter; null if there is none.
const Freed* find_freed(const std::vector<Freed>& free, int parameter);

/// Returns the entry that estimates a whole parameter.
Freed whole(const ParameterTable& table, int parameter);

/// Returns false if a parameter is the pose of a sensor or target that the rig does not give.
bool is_given(const Rig& rig, const Parameter& parameter);
/// Returns the poses of sensors and mounted targets without a value in the rig that a step
/// estimates completely and without a prior. If the rig has no steps, these are all absent poses.
/// (Other absent poses are the identity.)
std::vector<int> open_poses(const Rig& rig, const ParameterTable& table);
/// Removes the steps from a rig. An absent pose that is not open becomes the identity.
void clear_steps(Rig& rig);

/// Returns the components one by one, in order: the columns of a problem that estimates them.
std::vector<Component> components_of(const std::vector<Freed>& free);

/// Returns values with components changed by `by`; poses change by increments on the right.
VectorXd changed_values(const ParameterTable& table, VectorXd values,
                        const std::vector<Component>& components, const VectorXd& by);

}  // namespace kincal
