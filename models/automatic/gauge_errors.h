// Errors along gauges (analysis/gauges.h). A gauge is one only where the robot is as drawn: axes
// that are parallel in the URDF are tilted by a milliradian in truth, and then a component that was
// fixed 0.1 m from where it is moves lengths by a tenth of a millimetre.
//
// The fixed components z are normal about where they were fixed, by 1 m or 1 rad. In the quadratic
// model of a fit (widths.h) with H = N + P of all others o, these follow by  f = -H_oo^-1 N_oz, and
// what the tilts and the widths of lengths say of z is  S = N_zz + N_zo f + 1,  s = -S^-1 (g_z +
// f'g_o). The second moment of the errors is larger by  (f, 1) (S^-1 + s s') (f, 1)'.
#pragma once

#include <vector>

#include "../analysis/gauges.h"
#include "further.h"

namespace kincal {

/// Adds the uncertainty along gauges whose poses the rig does not give to a prediction at a fit,
/// which has these components fixed.
void add_gauges(const FitWithGroups& fit, const std::vector<Gauge>& gauges, Prediction& out);

}  // namespace kincal
