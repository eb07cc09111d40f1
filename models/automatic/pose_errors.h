// Errors of a flange's poses that depend on the pose. A robot computes its flange's pose from its
// readings: wrong zeros and lengths make errors that look like noise, but many poses do not average
// them out, and what is the same in all poses goes into the mounts.
//
// The error of a floating joint's reading (R, p), a twist of its child, is
//     d = A (1, R) + Ad(R, p)^-1 B (1, p / 0.5 m) + noise
// with 6 x 10 numbers A of the nine elements of R, and 6 x 4 numbers B: joints near the flange err
// alike in its frame, those near the base in the base's. All are N(0, w^2), with one factor w of
// 1 mm and 1 mrad; the columns that are always the same 4 w, for a posture changes only a part of
// what the first and last joints add. The factor is the best of six by evidence with unknown noise,
// times its prior with a spread of ln 3.
//
// Noise that nobody stated may be such errors even where these functions do not show it, as of
// postures with the elbow up and down: what is always the same is then at least as large as the
// noise that was found, and its size adds the ratio of its densities about a robot's 1 mm and
// 1 mrad and about the guess, each with a spread of ln 3, to the odds, which are even otherwise.
//
// Predicted errors cover noise alone and such errors (widths.h). (Of forty simulated robots with
// wrong zeros and lengths, known by their flanges, 24 had an error beyond three predicted sigmas by
// noise alone, with this none; predicted over actual is 2.3 in the median, with 6 w and 1.5 times
// the noise 3.5. With p / 1 m 2 of 60 further ones, with 0.5 m 1. Where poses err by noise alone
// it is 1.7, and was 1.6, and of 60 none is doubted: 0 to 6 %.)
#pragma once

#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// A PoseErrors says how likely errors of a floating joint's readings depend on the pose.
struct PoseErrors {
  int joint = -1;
  double log_odds = 0;  // against noise alone
};

/// Returns them for each floating joint that is estimated to have noise, and adds what they change
/// to the solution's prediction. It allocates.
std::vector<PoseErrors> add_pose_errors(Solution& solution);

}  // namespace kincal
