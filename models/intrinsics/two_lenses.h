// Views of one camera that two lenses made: pictures of two cameras in one folder, a lens that was
// focused or zoomed in between, or some pictures turned by 180 degrees, whose principal point lies
// at the other side of the middle. Each view fits nearly any lens, for its board is free; so the
// mean of both comes out, with small sigmas, and nothing sticks out.
//
// Near the solution, view i by itself would have the lens err by d with the cost
// q_i(d) = d' N_i d - 2 d' g_i (analysis/projection.h: its board's pose eliminated). Two lenses are
// sought that make sum_i min(q_i(a), q_i(b)) least: by turns each view goes to the lens that it
// suits better, and each lens becomes that of its views, from the signs along the directions in
// which the views' own wishes N^-1/2 g_i, N = sum N_i, scatter most. The gain is what that takes
// off the cost. Of all that a lens for each view would gain, sum g_i' N_i^+ g_i, noise gives two
// lenses a small share, and an error of the model that differs from view to view at most
// 2 / pi, if it is one number with Gauss's distribution. Two lenses give nearly all of it. Turned
// pictures need no other lens, so that a fit with these turned back proves them, if what a lens for
// each view would then still gain is little: as much as noise gives, or a tenth of what it was;
// where the split misses some, each view is then turned as it suits the lens found so far, until
// none changes.
#pragma once

#include <vector>

#include "../analysis/projection.h"
#include "intrinsics_notes.h"
#include "one_camera.h"

namespace kincal {

/// A LensSplit has the views that are of another lens than most.
struct LensSplit {
  std::vector<int> samples;     // the fewer, ascending
  long views = 0;               // of both
  double gain = 0, of_all = 0;  // what two lenses take off the cost, and one for each view
  double of_noise = 0;          // what noise alone, of chi2/dof 1, gains with one for each view
  double largest = 0;           // of the gain: the share of one of the fewer in that of these
};

/// Of what a lens for each view would gain two lenses give nearly all, not some.
constexpr double kNearlyAll = 0.9;

/// Whether a split is far more than noise gives, where `left` is the mean square of what two lenses
/// leave, and no single view makes it.
bool is_decisive(const LensSplit& split, double left);

/// Returns the split of the views that gains most; fewer than two samples in either part: none.
LensSplit split_by_lens(const std::vector<LensEquations>& views);

/// Says which views of a camera are of another lens than the others, or were turned: two fits that
/// leave as much less as the split says. Nothing where none are. `camera`
/// is fitted with `model`.
std::vector<IntrinsicsNote> views_of_another_lens(const LensModel& model,
                                                  const CalibrationOptions& options,
                                                  OneCamera camera);

}  // namespace kincal
