// What nothing can tell of the zeros of joints, and of where the base frame is.
//
// Things that stand at the base (a camera in the room, a tracker, a board on the table) with a pose
// to be estimated move with the first joint: its zero and origin, and where the base frame is, are
// the same numbers. Likewise what sits behind the last joint (a camera, a board in the hand) and
// that joint's zero; of few joints (a head that pans and tilts) numbers of all of them. No posture
// tells them apart, and no measurement depends on the choice; a prior, or the width of a group,
// makes it, and is all that these poses are known to. At the base that is harmless; at the other
// end it matters for what else sits there (a tool), and is said. Neither is mended by more samples,
// unlike the same sigma of anything else.
//
// A choice is a component of a joint that moves targets before sensors as the other unknowns do, in
// every posture: with J the motions by all unknowns in postures drawn within the joints' limits
// (analysis/gauges.h), Cholesky's elimination of J'J leaves next to nothing of its column. Poses
// are eliminated first, components that only a prior determines last. (Two components equivalent to
// a motion of the base frame share its uncertainty, so that one may seem determined. A joint that
// hardly moved is no choice: the data would determine it.) How well poses are known otherwise is
// their covariance given the choices.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "report.h"

namespace kincal {

/// A ZeroGauge has numbers of joints that are one with the poses at the base, or at the other ends.
struct ZeroGauge {
  bool at_base = true;                // else behind the last joints
  std::vector<std::string> numbers;   // of joints, that which matters most first
  std::string joint;                  // of the first of them
  bool is_zero = true;                // that is its offset; else a number of its origin
  std::map<Component, double> sigma;  // of poses there, were all choices known
};

/// GaugeFreedoms are what makes poses loose and no posture tells.
struct GaugeFreedoms {
  std::vector<ZeroGauge> zeros;
  std::map<Component, double> fixed;  // sigmas of poses, were the gauges' components known that
                                      // were fixed (analysis/gauges.h)
  std::map<Component, std::string>
      sizes;  // by number of a pose: the size of a target that makes it loose, to be measured
};

/// Finds it for a report that has all analyses; nothing where joints and sizes are determined or
/// held, or no pose is loose.
GaugeFreedoms find_gauge_freedoms(const Report& report);
/// Returns the report's own.
const GaugeFreedoms& gauge_freedoms(const Report& report);

/// Returns the sigma of a component by which to judge how well it is known, and which free zero, if
/// any, makes it less than it seems: what it would be without gauges. (One that is open,
/// rig/scales.h, stays as it is: that is no choice.)
struct JudgedSigma {
  double sigma;
  const ZeroGauge* zero;  // null: as it is
  std::string size;  // to be measured, for it is that alone which makes the pose loose; "": none
};
JudgedSigma judged_sigma(const GaugeFreedoms& freedoms, const ParameterEstimate& e, size_t c);

/// Returns what to do about a pose that depends on the sizes of targets.
std::string measure_words(const std::vector<std::string>& sizes);

}  // namespace kincal
