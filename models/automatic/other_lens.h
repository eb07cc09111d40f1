// Another lens of a camera: Kannala and Brandt's in place of Brown and Conrady's, which lacks
// tangential terms, or the reverse. What a lens cannot express the mount's tilt, zeros and the
// board's pose absorb, and residuals need not show it.
//
// At a fit, the camera gets the other lens with the coefficients that come nearest to the present
// one over the angles seen, with the same focal lengths and centre. From there two steps of the
// quadratic model (widths.h) lead to its best values and widths, where its log evidence is taken;
// for the present lens likewise. Errors count from no distortion (r = tan(angle)).
//
// With m the change of all other parameters, predicted errors cover the other lens (widths.h).
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "../sensors/sensors.h"
#include "further.h"
#include "other_models.h"

namespace kincal {

/// Returns the other lens of a camera; none: it is no camera with one of these two.
std::optional<Lens> other_lens(const Sensor& sensor);

/// Returns the recording with the other lens of a camera. Its distortion coefficients come nearest
/// to the present lens at these values, by least squares over the angles that the views have; its
/// initial ones are no distortion. `shared` has the values of the given recording, and gets those
/// of the new one.
std::shared_ptr<const Recording> with_other_lens(const Recording& recording, int sensor,
                                                 VectorXd& shared);

/// An OtherLens is another lens of a camera.
struct OtherLens {
  OtherModel model;                // intrinsics, of the camera
  std::vector<Component> columns;  // that both lenses have
  VectorXd moved;                  // m, by column
};
/// Weighs the other lens of each camera whose distortion is among `estimated` and has no prior of
/// the rig's own and no component that is fixed.
std::vector<OtherLens> other_lenses(const FitWithGroups& fit,
                                    const std::vector<Component>& estimated);

}  // namespace kincal
