// Starting values, in closed form: poses of free targets, and unknown poses of sensors and mounted targets.
//
// Free targets. Every view of the target proposes poses: a chain its hand, a pose sensor its pose, points and rays a rigid fit
// (Kabsch), a camera its PnP (homography of a plane with both of its mirror solutions, else a direct linear transform). The two best
// proposals, by a robust cost over all views of the sample, are refined with exact joints; the better one stays.
//
// Unknown poses. Views relate poses: with L_s = base_T_link of a sensor, X_s its pose, B = sensor_T_target as the view sees it, and
// G = base_T_target (a mounted target's: L_t Z_t),  L_s X_s B = G.  Poses are found one after the other: where everything else of a
// relation is known, as the robust mean over all samples; point correspondences, and directions of all views together, serve
// where single views do not determine a pose. Where two are unknown, A_i X = Y B_i is solved over all samples
// (robot-world-hand-eye): rotations from the largest singular vectors of sum R_B (x) R_A (Shah 2013), translations by linear
// least squares.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../estimation/estimation.h"
#include "../rig/configuration.h"
#include "../rig/targets.h"

namespace kincal {

/// Kabsch: the rigid motion with b ~ T a for points in columns; fewer than three points or all on a line: what they tell.
Pose fit_points(const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b);

/// sensor_T_target as one view by itself says it: a chain's (the identity), a measured one, a rigid fit of points, a camera's perspective
/// pose with its residuals minimised. nullopt where it does not tell (fewer than four pixels or three points, points on a line, a scan).
std::optional<Pose> pose_from_view(const Rig& rig, const ParameterTable& table, const VectorXd& values, const View& view);

/// Finds values.targets of every free target that the given samples' views (of `sensors`) see. A pose that is there already
/// stays if it can be evaluated. `refine`: false leaves the best proposal as it is (cheap). @throws std::runtime_error naming sample and target where no proposal can be evaluated.
void start_targets(const Recording& recording, const std::vector<int>& samples, const std::vector<int>& sensors, const Loss& loss,
                   Values& values, bool refine = true);

/// Finds the poses of `unknown` parameters (sensors' and mounted targets') and sets them in values.shared.
/// Returns the names of those that could not be found and stay at the identity.
std::vector<std::string> start_unknown_poses(const Recording& recording, const std::vector<int>& samples, const std::vector<int>& unknown,
                                             Values& values);

}  // namespace kincal
