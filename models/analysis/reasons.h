// Why the data determine a direction weakly, looked for in the model and not in names. With J_p d_p
// what parameter p does to the whitened residuals along the direction d:
//   - |J_p d_p| = 0: nothing depends on it, or all that is seen lies on the axis about which it
//   turns.
//   - |sum J_p d_p| is small beside the parts: they cancel. Their motions of the target as seen
//   from the sensor (finite differences of the
//     kinematics, scene.h) show how: the same turn, the same shift, or other motions that move the
//     seen points alike (points on an axis or a line; size against distance).
//   - it is small only after the elimination of the free targets: these go along.
// A cure is tried out: every joint on the path is moved by 0.4 rad (0.1 m) in all samples, and
// those after which the parts no longer cancel are the ones to move; if there is none, no posture
// helps.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "scene.h"

namespace kincal {

/// Effects are those of a direction on the whitened residuals.
struct Effects {
  double together = 0,
         left = 0;  // squared: of all parts at once; what poses of free targets cannot take up
  std::map<int, double> part;  // squared, by column
  std::vector<char> sensors;   // that notice a part
  double parts() const {
    double sum = 0;
    for (const auto& p : part) sum += p.second;
    return sum;
  }
};

/// Computes the effects of each direction, given as one coefficient a column of the scene's
/// problem.
std::vector<Effects> effects_of(Scene& scene, const std::vector<VectorXd>& directions);

/// WeakColumns are a direction that the data determine weakly.
struct WeakColumns {
  VectorXd coefficients;     // of all columns, real units
  std::vector<int> columns;  // those that are named, the one to hold first
  bool determined = false;   // weakly; else not at all
};

struct Reason {
  std::string kind;  // nothing_depends, on_axis, same_axis, same_shift, same_points, size, lens,
                     // one_orientation, free_targets, unknown
  std::string why, cure;
  std::vector<std::string> joints;  // that would have to move (more)
};

/// Finds the reason of a direction with these effects.
Reason find_reason(const Scene& scene, const WeakColumns& direction, const Effects& effects);

}  // namespace kincal
