// Ripple of a gear whose ratio the rig does not state, looked for in the residuals of a fit.
//
// With the private unknowns of sample s eliminated, an error x_s of a joint's position costs
//     r_s'r_s + 2 b_s x_s + A_s x_s^2,   A_s = a_s'a_s,   b_s = a_s'r_s,
// a_s the column of the joint's offset. A ripple of N cycles in a turn, x_s = f_s'c with
// f_s = (1, cos N q_s, sin N q_s), lowers chi2 by
//     g'M^-1 g - g_1^2 / M_11,   M = sum A_s f_s f_s',   g = -sum b_s f_s,
// the other parameters as they are; the constant is the offset. The noise of the fit contains the
// ripple (and that of joints that it cannot tell from this one as well), so what counts is the gain
// over what it leaves of sum b_s^2 / A_s, a sample. The largest over all joints and N is compared
// with what chance gives: the largest of kDraws draws in which the residuals of each sample get a
// random sign, which holds where they are clustered or unequal. (With 17 sets of real
// arms: at that size 5 to 17 % of rigid robots would get a ripple, at 1.25 times it none of 160,
// and those that helped on held-out data were at 1.8 to 8 times it. 36 postures gave false ones.)
// The ripple found is tried as one of a stated ratio is, but was chosen from many: its evidence is
// less by the logarithm of their number, as each had that prior odds against it, and counts with
// the noise that the ripple leaves.
#pragma once

#include <optional>
#include <vector>

#include "further.h"

namespace kincal {

/// JointErrors are what each sample says of errors of one joint's position, at a fit.
struct JointErrors {
  int joint = -1;
  std::vector<double> reading;           // rad
  std::vector<double> curvature, slope;  // A_s (1/rad^2) and b_s (1/rad)
};
/// Returns those of joints that may have a ripple, whose offsets are estimated, and whose ratios
/// nobody states; none if there are too few samples.
std::vector<JointErrors> joint_errors(const FitWithGroups& fit);

struct FoundRipple {
  int joint = -1, cycles = 0;
  double log_candidates = 0;  // logarithm of the number of ripples that it was chosen from
  double left = 1;            // of the sum of b_s^2 / A_s with it, a sample
};
/// Returns the ripple with the largest gain, if it is well above what chance gives. All errors are
/// of the same samples.
std::optional<FoundRipple> find_ripple(const std::vector<JointErrors>& errors);

}  // namespace kincal
