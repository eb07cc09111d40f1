// Lengths that everything hangs on and nothing checks: readings of a sliding joint, or the squares
// of all boards.
//
// In the quadratic model of a fit (widths.h) with the scaled unknowns S moved by v, one percent of
// their values, the others O follow by
//     d = -(N + P)_OO^-1 N_OS v,
// and twice the cost of the data and of the others' widths grows by v' N_SS v + v' N_SO d. Where
// that is less than three sigmas the data do not tell, and where d is more than a sigma of some
// mount or lens, all of these are as right as that length.
#pragma once

#include <string>
#include <vector>

#include "groups.h"
#include "widths.h"

namespace kincal {

/// FitWidths are a problem of widths and what its unknowns are.
struct FitWidths {
  WidthProblem problem;
  std::vector<Component> columns;
};

/// Returns the lengths that nothing checks, at these factors of the groups' widths; gears should be
/// among the unknowns. `sigma` is by unknown, 0: it is not estimated; `shared` has the values.
std::vector<UncheckedScale> unchecked_scales(const Recording& recording, const FitWidths& widths,
                                             const VectorXd& factor, const VectorXd& sigma,
                                             const VectorXd& shared);

}  // namespace kincal
