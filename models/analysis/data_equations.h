// What the data alone say of the shared unknowns at a solution: what results of robots that share
// priors are compared by (models/fleet/family.h).
#pragma once

#include "linearisation.h"

namespace kincal {

/// Returns the equations of the last step's data, private unknowns eliminated, without the priors
/// of shared ones; on the automatic path also those of fixed parameters.
DataEquations data_equations(const Linearisation& at);

}  // namespace kincal
