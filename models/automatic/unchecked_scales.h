// Lengths that no measurement checks, although others depend on them: readings of a sliding joint,
// or the spacings of all boards.
//
// In the quadratic model of a fit (widths.h) with the scaled unknowns S moved by v, one percent of
// their values, the others O follow by
//     d = -(N + P)_OO^-1 N_OS v,
// and twice the cost of the data and of the others' widths grows by v' N_SS v + v' N_SO d. If
// that is less than three sigmas the data do not determine v; if d is also more than a sigma of
// some mount or lens, these are only as accurate as that length.
#pragma once

#include <string>
#include <vector>

#include "groups.h"
#include "widths.h"

namespace kincal {

/// FitWidths are a problem of widths with the components of its unknowns.
struct FitWidths {
  WidthProblem problem;
  std::vector<Component> columns;
  double cost = 0;  // twice that of the data at present
};

/// Returns the lengths that no measurement checks, at these factors of the groups' widths. The
/// unknowns should include gears. `sigma` is by unknown (0: not estimated); `shared` has the
/// values.
std::vector<UncheckedScale> unchecked_scales(const Recording& recording, const FitWidths& widths,
                                             const VectorXd& factor, const VectorXd& sigma,
                                             const VectorXd& shared);

}  // namespace kincal
