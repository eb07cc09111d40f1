// Alternatives to the groups of the automatic path, at the linearisation where their widths were
// learned (widths.h), each with its odds against these groups.
//
//   arm_scale    all lengths of the arm have a factor in common: the tracker, motion capture or
//                depth camera that measures it has another scale than the URDF
//   link_length  only one length of the arm is wrong; with sizes: instead of boards' spacings or
//                baselines that were estimated as changed
//   prior        a prior in the rig is too narrow
//   intrinsics   a camera has another lens (other_lens.h)
//
// Common factor. Lengths l_i of the URDF have errors x_i ~ N(0, t^2) (groups.h). With a factor 1 +
// m the errors are x_i ~ N(m l_i, t^2): values count from x0_i - m l_i. The log evidence is a
// parabola in m, whose top and curvature follow from three values of it; widths are learned again
// there, because a common factor makes lengths appear wide.
//
// A single length. The error of a mistyped length is many times that of the others. With the width
// of its group it is less likely than a board of another size: board and arm share one scale, and
// the other lengths absorb the rest of the error. With the sizes fixed at the rig's values and the
// widths learned again, that length's error is far larger than the others; with a width of its own
// it explains the data equally well. Let m be the change of all unknowns: predicted errors cover
// this model's (widths.h).
//
// A prior. Each stated prior is a group whose width is learned with the others, starting far wider
// than stated: under the stated prior other unknowns have absorbed the error, and the search
// from there may be long.
//
// A model is reported if its odds make it a finding (kFoundOdds) and no model of another kind is
// more likely by more than kAsLikelyOdds. A length instead of sizes is reported if it is as likely
// as the changed sizes.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "../evidence/evidence.h"
#include "groups.h"
#include "unchecked_scales.h"
#include "widths.h"

namespace kincal {

/// An OtherModel is one of these. `where` has: for arm_scale the sensors that measure lengths; for
/// link_length the length, then the sizes; for prior the prior; for intrinsics the
/// camera.
struct OtherModel : Alternative {
  double value = 0, sigma = 0;  // arm_scale: the factor; prior: of its width
  VectorXd moved;               // link_length in place of sizes: m, by unknown

  double probability() const { return 1 / (1 + std::exp(-log_odds)); }
  bool replaces_sizes() const { return kind == NoticeKind::link_length && where.size() > 1; }
};

/// Returns all models that the data can judge. `initial` has the URDF's values. It allocates.
std::vector<OtherModel> other_models(const Recording& recording, const FitWidths& at,
                                     const Widths& widths, const VectorXd& initial);
/// Whether the measurements of some sensor would also suit a robot of no size: a chain's, whose
/// hand is where the readings have it, and points at the sensor itself, as of a ball in a socket.
bool some_suit_no_size(const Recording& recording, const FitWidths& at, const VectorXd& initial);
/// Returns the models of a kind to report.
std::vector<const OtherModel*> told_models(const std::vector<OtherModel>& all, NoticeKind kind);

}  // namespace kincal
