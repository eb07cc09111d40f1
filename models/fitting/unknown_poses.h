// Starting values of poses of sensors and mounted targets that the rig does not give.
//
// Views relate poses: with L_s = base_T_link of a sensor, X_s its pose, B = sensor_T_target as the
// view sees it, and G = base_T_target (a mounted target's: L_t Z_t),  L_s X_s B = G.  Poses are
// found one after the other: where everything else of a relation is known, as the robust mean over
// all samples; point correspondences, and directions of all views together, serve where single
// views do not determine a pose. Where two are unknown, A_i X = Y B_i is solved over all samples
// (closed_form.h). Where a sensor and a target are unknown whose single views give no pose (a
// tracker and its reflector), all their points together do, seen from the target's link.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../estimation/setup.h"
#include "../rig/recording.h"
#include "free_targets.h"

namespace kincal {

struct UnknownStarts {
  std::vector<std::string> lost;  // names of poses that could not be found and stay as they were
  std::vector<AmbiguousStart> ambiguous;
};

/// Returns the samples that poses start from, ascending: all, or where there are many so many that
/// each pair of a sensor and a target has kEnoughViews of its views (or all of them), spread
/// evenly. More would cost time and give the same start.
std::vector<int> samples_to_start(const Recording& recording, const std::vector<int>& samples);
constexpr int kEnoughViews = 200;

/// Finds the poses of `unknown` parameters (sensors' and mounted targets') and sets them in
/// values.shared. `how`: the start of the free targets' poses that lead there.
UnknownStarts start_unknown_poses(const Recording& recording, const std::vector<int>& samples,
                                  const std::vector<int>& unknown, Values& values,
                                  const TargetStarts& how = {});

/// An OriginProxy is the pose of a sensor or mounted target, `body`, behind a fixed joint with
/// nothing but fixed joints between: where it is found, the joint's origin is.
struct OriginProxy {
  int origin, body;         // parameters
  Pose child_T_link;        // from the joint's child to the link of the body
  std::vector<int> others;  // poses that hang there as well: as wrong as the origin, so that they
                            // are unknown while the body is looked for
};

/// Returns the first that may stand in for a joint's origin, of what the rig mounts by this joint
/// before others; none of those `taken` (by parameter).
std::optional<OriginProxy> find_origin_proxy(const Recording& recording, int origin,
                                             const std::vector<char>& taken);
/// Moves the origin to where its body was found, and what hangs on it back to where it is initially
/// on its link.
void move_origin(const ParameterTable& table, const OriginProxy& proxy, const VectorXd& initial,
                 VectorXd& shared);

}  // namespace kincal
