// By how much the stamps of a camera's images are later than those of the joints' readings.
//
// What a robot at rest sees does not depend on time, so samples of rests determine the robot: a fit
// gives the values x of everything and, of each rest, the errors e of the readings and the poses of
// free targets. An image stamped t on the way from rest a to rest b was taken at t - offset, where
// the readings are q(t - offset), interpolated between messages. Their errors go from e_a to e_b as
// the joints go from q_a to q_b; a target in a hand stays in it (its pose in the hand likewise),
// one that stands at the same place in both rests stands there meanwhile. So the corners are
// predicted, and with r_i(offset) the residuals of image i and g_i = d r_i / d offset,
//     offset_i = offset - g_i' r_i / g_i' g_i,   u_i = (g_i' g_i / rows)^1/2   (px / s),
// is what this image says alone. The offset is their mean with the weights u_i^2 (errors of the
// prediction are alike in px), bounded by Huber's function at the scale that the residuals e_i =
// u_i (offset_i - offset) have. It is found on a grid first (+-0.4 s), then by iterations.
//
// Its sigma. Images of one way share what is wrong with the prediction, so the sum of their scores
// w_i u_i e_i, way by way, gives the variance,
//     sigma^2 = (C + 1) / (C - 1) sum_c (sum_(i in c) w_i u_i e_i)^2 / (sum w_i u_i^2)^2,   C ways,
// or that of independent images if it is larger. (C / (C - 1) would be right for many ways; few do
// not know their own scatter. C counts ways as they weigh, (sum I_c)^2 / sum I_c^2 with the
// informations I_c = sum_(i in c) w_i u_i^2: where all but one are bounded, that one knows no
// scatter.) Images that see nothing move from 20 ms before to 20 ms after, by 10 px / s and a tenth
// of the usual speed at least, tell nothing and are left out. To it 0.05 ms are added (squares): so
// much all images of one camera have in common, of how readings are interpolated and how moving
// corners are found (seen: 0.06 ms).
//
// Offsets alike. Where all pictures were taken when the robot began to move (or ceased), what they
// show suits every offset that puts them into the rest. So the cost sum log(1 + r_i^2 / s^2), with
// the scale s of the residuals (0.1 px at least), has to be larger by 9 at all offsets of the grid
// that are not next to the best; else none is known.
//
// Clocks. The same for at least four stretches of the recording, of three ways or more: a line
// through their offsets whose slope is more than four of its sigmas, and makes more than 1 ms from
// end to end, is a clock that drifts; two levels (a step between stretches, two or more on each
// side) that explain them better than a line, more than five sigmas and 1 ms apart, are one that
// jumps. Where one offset for all leaves more than 2 ms of sigma, or a quarter of the images far
// from it, stretches of two ways are each searched on the grid by themselves, so that a clock that
// changes by tenths of a second is seen too; stamps are corrected by the line or levels, and what
// is left is estimated again. Unless that leaves less than 0.3 ms, no offset is known.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "../../models/calibration/solution.h"

namespace kincal {

constexpr double kFarthestOffset = 0.4;  // s

/// A WaySighting is what an image shows of a target on the way from one sample's posture to the
/// next one's.
struct WaySighting {
  int before = -1, after = -1;  // samples
  View view;                    // of one camera on one target
  double time = 0;              // s, as stamped
};

/// A TimeOffset of one camera's stamps.
struct TimeOffset {
  int sensor = -1;
  double offset = 0, sigma = 0;  // s, in the middle of the recording: stamped so much later
  int images = 0, ways = 0;      // that tell
  std::string why_not;           // it is not known; else empty
  bool misfit = false;           // then: what it saw fits no offset up to kFarthestOffset

  enum class Clock { steady, drifts, jumps } clock = Clock::steady;
  double drift = 0, drift_sigma = 0;               // s per s
  double middle = 0;                               // s, when `offset` holds
  double jump_time = 0, jump = 0, jump_sigma = 0;  // s: after that time by so much more

  /// Returns the offset at a time.
  double at(double time) const {
    return clock == Clock::drifts  ? offset + drift * (time - middle)
           : clock == Clock::jumps ? offset + (time > jump_time ? jump : 0)
                                   : offset;
  }
};

struct OffsetInput {
  const Recording& recording;
  const Values& values;  // estimated from its samples
  /// Readings at a time, by joint index; NaN: none.
  std::function<std::vector<double>(double)> readings;
  /// Of targets that look alike after some quarter turns: which.
  std::map<int, std::vector<int>> open_turns;
};

/// Estimates the offset of one camera from what it saw on the ways.
TimeOffset time_offset(const OffsetInput& input, int sensor, std::vector<WaySighting> sightings);

}  // namespace kincal
