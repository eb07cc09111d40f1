// The information of the data alone about the shared unknowns at a solution, by which results of
// robots with common priors are compared (models/fleet/family.h).
#pragma once

#include "linearisation.h"

namespace kincal {

/// Returns the equations of the last step's data without the priors of shared unknowns, private
/// unknowns eliminated. On the automatic path they include fixed parameters.
DataEquations data_equations(const Linearisation& at);

}  // namespace kincal
