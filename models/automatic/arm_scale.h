// A factor that all lengths of an arm have in common: what measures it, a tracker, motion capture
// or a depth camera, has another scale than the URDF.
//
// Lengths l_i of the URDF are taken to be off by x_i ~ N(0, t^2) (groups.h). With a common factor 1
// + m they are off by x_i ~ N(m l_i, t^2): in the quadratic model of a fit (widths.h) the values
// count from x0_i - m l_i. The log evidence is a parabola in m, whose top and curvature follow from
// three values of it; widths are learned anew there, for a factor in common makes lengths look
// wide. One length that is wrong alone looks like a factor too: where a width of its own explains
// the data better (lone_lengths.h), there is none.
#pragma once

#include <optional>

#include "groups.h"
#include "widths.h"

namespace kincal {

/// Returns the factor, where a sensor measures lengths and the arm has lengths that the data tell.
/// nullopt: they do not. `columns` are the problem's unknowns; `initial` has the URDF's values.
std::optional<ArmScale> arm_scale(const Recording& recording, const WidthProblem& problem,
                                  const std::vector<Component>& columns, const Widths& widths,
                                  const VectorXd& initial);

}  // namespace kincal
