// What no posture tells: directions in the space of unknowns along which nothing that is seen moves
// against what sees it.
//
// With J the motion of each target in the frame of a sensor that sees it (of a target of one point,
// that of the point) by the unknowns, in postures drawn within the joints' limits, a gauge is a
// direction d with J d = 0: J'J has an eigenvalue of zero. Where all axes are parallel (SCARA,
// palletizer) the heights of what stands at the base and of what is carried are one parameter;
// where things only slide, all three coordinates; of two cameras that see free targets, where both
// are. More samples do not determine it, and no measurement depends on it, so one component is
// fixed and the choice is said.
#pragma once

#include <vector>

#include "../rig/recording.h"
#include "../rig/selection.h"

namespace kincal {

/// Returns J'J (m and rad) at these values, in postures that are the same for a rig.
MatrixXd squared_motions(const Recording& recording, const VectorXd& shared,
                         const std::vector<Component>& columns);

/// Returns the body behind which all sensors and mounted targets stand: what is between it and the
/// base moves nothing that is seen.
int common_body(const Rig& rig);

/// A Gauge is a direction that no posture tells.
struct Gauge {
  Component fixed;              // decides it; of a pose that the rig gives, if one takes part
  bool given = false;           // that is so
  std::vector<Component> with;  // move along with it, that which moves most first
};
/// Returns the gauges among components of poses at these values.
std::vector<Gauge> find_gauges(const Recording& recording, const VectorXd& shared,
                               const std::vector<Freed>& poses);

}  // namespace kincal
