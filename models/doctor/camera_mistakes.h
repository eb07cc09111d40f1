// Mistakes about what a camera's numbers mean: u and v exchanged, images of another size than the
// intrinsics, intrinsics in another order, normalised coordinates for pixels. Each function appends
// its hypotheses.
#pragma once

#include <vector>

#include "../notices/notice.h"
#include "observation_index.h"

namespace kincal {

/// Adds views that have v first.
void add_exchanged_axes(const Rig& rig, const ObservationIndex& observations,
                        std::vector<Hypothesis>& out);
/// Adds intrinsics of another resolution, where the pixels lie as if of it, and images that were
/// cropped, and focal lengths that are wrong, where the intrinsics are held.
void add_resolutions(const Rig& rig, const ParameterTable& table,
                     const std::vector<Sample>& samples, const ObservationIndex& observations,
                     const FreedNames& freed, std::vector<Hypothesis>& out);
/// Adds other orders of fx fy cx cy that are as plausible.
void add_orders(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds the hypothesis that views hold normalised coordinates while the intrinsics are in pixels,
/// and the reverse.
void add_normalised(const Rig& rig, const std::vector<Sample>& samples,
                    const ObservationIndex& observations, std::vector<Hypothesis>& out);

/// Finds cameras whose views can only be normalised coordinates although their intrinsics are in
/// pixels: a fit need not be bad with them.
std::vector<Notice> find_normalised(const Rig& rig, const std::vector<Sample>& samples);

}  // namespace kincal
