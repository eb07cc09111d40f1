// Names and globs of parameters: the selecting functions of ParameterTable (parameters.h), the
// error that they throw, sets of what was selected.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "parameters.h"

namespace kincal {

/// A NameError is a name or glob of parameters that matches nothing; `name` is what is unknown and
/// `valid` what it could be, so that callers can add the nearest ones.
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
  /// Returns the error of a name of a group (automatic/groups.h).
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

/// Whether a glob (`*`, `?`, `[...]`; a backslash is a letter) means the whole name. It is POSIX's
/// fnmatch, not C++'s.
bool glob_matches(const std::string& glob, const std::string& name);

/// Adds components to those already there, parameter by parameter; new parameters go to the end.
void merge(std::vector<Freed>& into, const std::vector<Freed>& more);

/// Returns the entry of a parameter, null if it is not among them.
const Freed* find_freed(const std::vector<Freed>& free, int parameter);

/// Frees a whole parameter.
Freed whole(const ParameterTable& table, int parameter);

/// Returns the poses of sensors and mounted targets without a value in the rig that one of its
/// steps estimates completely and without a prior. If the rig has no steps, every absent pose is
/// such a pose. (Any other absent pose is the identity.)
std::vector<int> open_poses(const Rig& rig, const ParameterTable& table);
/// Takes the steps out of a rig; an absent pose that is not open is the identity from then on.
void clear_steps(Rig& rig);

/// Returns the components one by one, in order: the columns of a problem that frees them.
std::vector<Component> components_of(const std::vector<Freed>& free);

/// Returns values with components changed: of poses by increments on the right.
VectorXd changed_values(const ParameterTable& table, VectorXd values,
                        const std::vector<Component>& components, const VectorXd& by);

}  // namespace kincal
