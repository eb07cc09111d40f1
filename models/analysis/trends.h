// Errors of readings that depend on the joint's position, or on time. Systematic errors of a joint
// or a flange (a gear, sag, bending; the zeros of a robot that reports only its flange's poses)
// look like noise of its readings, but noise does not depend on the posture.
//
// In mode latent each sample has an error d of each noisy joint, of a floating joint six. They are
// regressed on its position: for n samples
//     turning     1, q, sin q, cos q
// (of the reading q)
//     sliding     1, q, q^2
//     floating    1, the nine elements of its rotation, the three of its translation; of few
//     samples
//                 1 and the increment from the first pose
// whose columns have rank k + 1. With the p x p scatter T of the errors and E of what the
// regression leaves, Wilks' lambda = det E / det T of errors independent of the posture is such
// that
//     chi2 = -(n - 1 - (p + k + 1) / 2) ln lambda
// has p k degrees of freedom (Bartlett 1938), for any size of the errors.
//
// A curve over a joint's angle may have many cycles in a turn. With the regression's residuals of a
// joint's errors, y = M d, in the order of its readings,
//     r = y'S y / y'y,   S half on both neighbouring diagonals,   A = M S M,   m = n - rank,
// is how far neighbours agree. Of independent normal errors its mean is tr A / m and its variance
// 2 (tr A^2 - (tr A)^2 / m) / (m (m + 2)), as r does not depend on y'y. Where neighbours agree
// more, the square of the excess over the mean, in standard deviations, is added to chi2, with a
// degree of freedom. The excess is the share of the squares that a curve has.
//
// A trend is one that occurs by chance in one of 30,000 joints (4 standard deviations), is a good
// part of the scatter, and is of errors that the data show: the mean square of their estimates is
// at least 2 % of the variance of the readings' noise.
//
// Consecutive samples whose readings hardly differ (by half a sigma) are of a robot at rest: their
// errors are the same, and their mean counts once.
//
// Nor does noise depend on time. If a joint is homed again, or a sensor or target is bumped,
// between two samples, errors jump there. With the residuals y of the regression above and its
// residuals of the step s (0 before sample k, 1 from there on), b = s'y / s's is the jump,
//     t^2 = nu b^2 s's / (y'y - b^2 s's),   nu = n - rank - 1,
// is that of Student's t with nu degrees of freedom. The largest over k is a jump from 4.8 standard
// deviations on, if it is a third of the scatter. (Of 4,787 joints of 797 simulated recordings
// without one the largest was 4.3.)
#pragma once

#include <string>
#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// A Trend is a joint whose errors depend on its position.
struct Trend {
  int joint;         // of a floating joint that joint, not its axes
  double clear;      // how clearly, in standard deviations
  double share = 0;  // of the squared errors, that the posture explains (of six the largest)
  double turn = 0, shift = 0;  // root mean square of that part: rad, m
};

/// A Jump is a joint whose errors change permanently from some sample on.
struct Jump {
  int joint;     // of a floating joint the axis
  int sample;    // the first after it, in the order of logging
  double by;     // rad, m; estimates of errors, so rather too small
  double clear;  // how clearly, in standard deviations
};

/// Returns the trends of a solution's training samples, clearest first. Only mode latent has any.
std::vector<Trend> trends(const Solution& solution);

/// Returns the jumps of errors in time, likewise.
std::vector<Jump> jumps(const Solution& solution);

}  // namespace kincal
