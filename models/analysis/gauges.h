// Gauges of the robot: directions in the space of unknowns along which no target moves relative to
// the sensors that see it, in any posture.
//
// With J the motion of each target in the frame of a sensor that sees it (of a target of one point,
// that of the point) by the unknowns, in postures drawn within the limits of the joints (of those
// that moved in the samples; others stand where they stood), a gauge is a
// direction d with J d = 0: J'J has an eigenvalue of zero. Where all axes are parallel (SCARA,
// palletizer) the heights at the base and at the other end are one parameter; if all joints slide,
// so are all three coordinates; if two cameras see free targets only, their common pose. More
// samples do not determine a gauge, and no measurement depends on it, so one component is fixed.
#pragma once

#include <vector>

#include "../rig/recording.h"
#include "../rig/selection.h"
#include "frames.h"

namespace kincal {

/// Returns J'J (m and rad) at these values. The same rig always gives the same postures. `charts`
/// are as in Unknowns (frames.h).
MatrixXd squared_motions(const Recording& recording, const VectorXd& shared,
                         const std::vector<Component>& columns, const Charts& charts = {});

/// Returns the last body on which all sensors and mounted targets depend: joints between it and the
/// base do not move these relative to each other.
int common_body(const Rig& rig);

/// A Gauge is one of these directions.
struct Gauge {
  Component fixed;              // of a pose that the rig gives, if one takes part; gauges fix
                                // components of as few poses as possible
  bool given = false;           // the rig gives that pose
  std::vector<Component> with;  // move along with it, that which moves most first
};
/// Returns the gauges among the components of poses, at these values.
std::vector<Gauge> find_gauges(const Recording& recording, const VectorXd& shared,
                               const std::vector<Freed>& poses);

}  // namespace kincal
