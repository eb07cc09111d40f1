// Where frames of a robot are at given readings, and which readings compensate: as Python and C ask
// for it, by names.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../models/analysis/compensation.h"
#include "../rig/rig_file.h"

namespace kincal {

/// A KnownRig is a rig as read, with its parameters.
struct KnownRig {
  explicit KnownRig(RigFile read) : file(std::move(read)), table(file.rig) {}
  RigFile file;
  ParameterTable table;
};

/// Returns the names of the joints that have a reading, in the order of the URDF.
std::vector<std::string> joint_names(const Rig& rig);

/// Postures are readings of joints, a row a posture and a column a joint of `joints` (rad or m).
struct Postures {
  std::vector<std::string> joints;
  const double* values = nullptr;
  size_t rows = 0;
};

/// Writes the poses base_T_frame at postures to `out`, 4 x 4 each, row by row. `base` and `frame`
/// are a link, sensor/NAME or target/NAME. @throws InputError: there is no such name, a number is
/// not finite, a joint that moves one of both has no reading
void forward_poses(const KnownRig& rig, const Postures& postures, const std::string& frame,
                   const std::string& base, double* out);

/// A CompensationWish is the tip that is to be where it was planned, seen from `base`, which stands
/// still; "": the only such frame there is.
struct CompensationWish {
  std::string tip, base;
  bool position_only = false;              // how the tip is turned does not matter
  std::optional<double> temperature = {};  // of the robot, degrees Celsius
};
/// Returns what compensates (models/analysis/compensation.h), one a posture. Readings are by joint
/// of the tree. @throws InputError as forward_poses, and where `base` moves or is ambiguous, or
/// joints depend on a temperature that is not given
std::vector<Compensated> compensate_postures(const KnownRig& real, const KnownRig& planned,
                                             const Postures& postures,
                                             const CompensationWish& wish);

}  // namespace kincal
