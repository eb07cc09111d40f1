// Other models of the data than the groups of the automatic path, at the linearisation where their
// widths were learned (widths.h): each with its odds against the groups as they are.
//
//   arm_scale    all lengths of the arm have a factor in common: what measures it, a tracker,
//   motion
//                capture or a depth camera, has another scale than the URDF
//   link_length  one length of the arm is wrong alone; with sizes: in place of these (boards'
//                squares, baselines), which came out as others
//   prior        a prior that the rig states is too narrow
//   gears        scales of joints, which were not asked for, are not as stated
//
// Factor in common. Lengths l_i of the URDF are taken to be off by x_i ~ N(0, t^2) (groups.h). With
// a factor 1 + m they are off by x_i ~ N(m l_i, t^2): values count from x0_i - m l_i. The log
// evidence is a parabola in m, whose top and curvature follow from three values of it; widths are
// learned anew there, for a factor in common makes lengths look wide.
//
// A length alone. One that is off by many times as much as the others, for somebody mistyped it, is
// less likely in its group than a board of another size: board and arm have one scale, and only the
// rest of that length, which is no scale, is left to the others. With the sizes put to what the rig
// has and the widths learned anew, the length sticks out; with a width of its own it explains the
// data as well. Let m be what all unknowns move by and P the probability of that: the second moment
// of the errors grows by P m m'.
//
// A prior. Each is a group whose width is learned along with the others'. They begin far wider than
// stated: with the prior as it is other unknowns have taken the errors' place, and the way out of
// there may be long.
//
// Told is what is a finding by its odds (kFound), unless another model is likelier by more than
// kAsLikely; of a length in place of sizes, which came out as others, it is enough that it is as
// likely as these.
#pragma once

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

/// Returns all that the data can judge. `initial` has the URDF's values.
std::vector<OtherModel> other_models(const Recording& recording, const FitWidths& at,
                                     const Widths& widths, const VectorXd& initial);
/// Returns what evidence for gears makes of them. `gain`: of log evidence.
OtherModel other_gears(double gain);
/// Returns those of a kind that are told.
std::vector<const OtherModel*> told_models(const std::vector<OtherModel>& all, NoticeKind kind);

}  // namespace kincal
