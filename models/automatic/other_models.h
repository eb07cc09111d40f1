// Other models of the data than the groups of the automatic path, at the linearisation where their
// widths were learned (widths.h): each with its odds against the groups as they are.
//
//   arm_scale    all lengths of the arm have a factor in common: the tracker, motion capture or
//                depth camera that measures it has another scale than the URDF
//   link_length  one length of the arm is wrong alone; with sizes: in place of boards' squares or
//                baselines that were estimated as changed
//   prior        a prior that the rig states is too narrow
//   gears        scales of joints that were not estimated are not as stated
//
// Factor in common. Lengths l_i of the URDF are taken to be off by x_i ~ N(0, t^2) (groups.h). With
// a factor 1 + m they are off by x_i ~ N(m l_i, t^2): values count from x0_i - m l_i. The log
// evidence is a parabola in m, whose top and curvature follow from three values of it; widths are
// learned anew there, for a factor in common makes lengths look wide.
//
// A length alone. A mistyped length is off by many times as much as the others. With the width of
// its group it is less likely than a board of another size: board and arm have one scale, and the
// other lengths take up the part of the error that is no scale. With the sizes fixed at the rig's
// values and the widths learned anew, that length is far larger than the others; with a width of
// its own it explains the data as well. Let m be the change of all unknowns and P the probability
// of this model: the second moment of the errors grows by P m m'.
//
// A prior. Each stated prior is a group whose width is learned with the others, starting far wider
// than stated: under the stated prior other unknowns have taken up the error, and the search from
// there may be long.
//
// A model is told if its odds make it a finding (kFoundOdds) and no model of another kind is
// likelier by more than kAsLikelyOdds. A length in place of sizes is told if it is as likely as the
// changed sizes.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "../evidence/evidence.h"
#include "groups.h"
#include "unchecked_scales.h"
#include "widths.h"

namespace kincal {

/// An OtherModel is one of these. `where`: sensors that measure lengths; the length, behind it the
/// sizes; the prior; nothing.
struct OtherModel : Alternative {
  double value = 0, sigma = 0;  // arm_scale: the factor; prior: of its width
  VectorXd moved;               // link_length in place of sizes: m, by unknown

  double probability() const { return 1 / (1 + std::exp(-log_odds)); }
  bool replaces_sizes() const { return kind == NoticeKind::link_length && where.size() > 1; }
};

/// Returns all models that the data can judge. `initial` has the URDF's values. It allocates.
std::vector<OtherModel> other_models(const Recording& recording, const FitWidths& at,
                                     const Widths& widths, const VectorXd& initial);
/// Returns the model of other gears. `gain`: of log evidence.
OtherModel other_gears(double gain);
/// Returns the models of a kind that are told.
std::vector<const OtherModel*> told_models(const std::vector<OtherModel>& all, NoticeKind kind);

}  // namespace kincal
