// The entry `elasticity` of a rig.yaml: how joints bend under weights (models/rig/elasticity.h).
#pragma once

#include "../../models/rig/rig.h"
#include "../document/document.h"

namespace kincal {

/// Reads it for a rig whose joints, sensors and targets are there. Compliances that are not stated
/// are 0, loads those of the URDF's inertials or rods.
Elasticity read_elasticity(const Field& field, const Rig& rig);
/// Returns it as it is written, whole.
Node elasticity_node(const Elasticity& elasticity, const Tree& tree);

}  // namespace kincal
