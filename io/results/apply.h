// The changes of a result put into another copy of the robot, a URDF or a MuJoCo model (MJCF).
#pragma once

#include <string>
#include <vector>

#include "../urdf/urdf.h"

namespace kincal {

struct AppliedResult {
  std::string text;                // of the robot
  std::vector<std::string> notes;  // parts of the result that the text cannot express
};

/// Returns the text of `urdf` with the changes of a result (a result directory or its result.json).
/// @throws InputError if the robot differs from the calibrated one at a changed place, or already
/// has the changes; if the result's status is not `converged`, unless `force`.
AppliedResult apply_result(const std::string& result_path, const Urdf& urdf, bool force);

/// Returns the text of a MuJoCo model with its bodies at the poses of the equally named links in
/// the result's robot.urdf (../urdf/edit_mjcf.h). `path` is the model's, for messages. @throws
/// InputError
AppliedResult apply_to_mjcf(const std::string& result_path, const std::string& text,
                            const std::string& path, bool force);

}  // namespace kincal
