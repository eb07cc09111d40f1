// The error on data that a calibration did not use, sensor by sensor, with intervals.
//
// Intervals: for the mean square q of a sensor's residuals over m blocks (squares s_i of n_i
// points, q = sum s_i / sum n_i) the jackknife over blocks on the logarithm (Efron, Stein 1981),
// with theta_i = ln q without block i and theta its mean,
//     e^2 = (m - 1) / m  sum (theta_i - theta)^2,
//     95 % interval of rms = sqrt(q) exp(-+ t e / 2),
// t the 97.5 % quantile of Student's t with m - 1 degrees of freedom. So blocks may be correlated
// inside and of any size. Nothing is random. The interval is how far rms would scatter with other
// blocks of the same kind for this calibration; with fewer than three targets, or views, the blocks
// are samples, and with fewer than three of those there is no interval.
//
// Of two calibrations judged on the same blocks, with squares a_i and b_i, the ratio of their rms
// is sqrt(sum a_i / sum b_i), and its interval comes from the same jackknife with theta_i = ln(sum
// a / sum b) without block i: paired, so that what makes a block hard for both does not widen it.
//
// Each root mean square has a median beside it: a few gross outliers dominate the former and hardly
// affect the latter.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "../rig/folds.h"
#include "../rig/numbers.h"
#include "residuals.h"

namespace kincal {

struct Interval {
  double low = kNan, high = kNan;  // NaN: none
};
/// Returns the 95 % interval of a root mean square. `squares` and `points` are by block.
Interval rms_interval(const std::vector<double>& squares, const std::vector<long>& points);

/// Returns the 95 % interval of the ratio of two root mean squares over the same points, by block.
Interval rms_ratio_interval(const std::vector<double>& squares, const std::vector<double>& others);

/// A HeldOutError has the root mean squares of one sensor's residuals on held-out data, with
/// intervals. NaN: none. Units are as in SensorResult.
struct HeldOutError {
  std::string sensor, unit;
  bool measures_pose = false;
  long points = 0;
  long missing = 0;        // views that cannot be evaluated at the estimate
  long blocks = 0;         // from which the intervals are made
  bool by_target = false;  // blocks are targets
  double rms, rms_as_read, rotation, rotation_as_read;
  double median = kNan, median_as_read = kNan;  // of the residuals' lengths; poses: translation
  Interval of_rms, of_rms_as_read, of_rotation, of_rotation_as_read;
};

/// Returns the errors of the solution's held-out samples, sensor by sensor; empty if there are
/// none.
std::vector<HeldOutError> held_out_errors(const Solution& solution, const Residuals& residuals);

/// BlockSums are sums of squares of a sensor's residuals in one block.
struct BlockSums {
  long points = 0;
  double squared = 0, as_read = 0, rotation = 0, rotation_as_read = 0;
};

/// HeldOutSums are sums of held-out residuals by sensor and sample.
struct HeldOutSums {
  std::map<std::pair<int, int>, BlockSums> all;                 // (sensor, sample of the whole set)
  std::map<int, long> missing;                                  // sensor -> views
  std::map<int, std::vector<double>> lengths, lengths_as_read;  // of residuals, by sensor

  /// Adds the held-out residuals of a calibration of some samples. `index` has the index of each of
  /// these in the whole set.
  void add(const Recording& recording, const Residuals& residuals, const std::vector<int>& index);
};

/// Returns the errors from the sums, sensor by sensor. `blocks` are those of the whole set.
std::vector<HeldOutError> held_out_errors(const Rig& rig, const Blocks& blocks,
                                          const HeldOutSums& held_out);

/// A ComparedError has the errors as read of one sensor (poses: of its translations or rotations)
/// by several calibrations on the same points.
struct ComparedError {
  std::string sensor, unit;
  long points = 0, blocks = 0;
  bool by_target = false;        // blocks are targets
  std::vector<double> rms = {};  // by calibration; NaN: it lacks points of the others
  std::vector<std::vector<double>> squares = {};  // by calibration, by block
  /// Returns the interval of the ratio of two of them.
  Interval ratio(size_t of, size_t to) const {
    return rms_ratio_interval(squares[of], squares[to]);
  }
};
/// Returns the errors where each calibration but the first `may_lack` has as many points as the
/// last, sensor by sensor.
std::vector<ComparedError> compare_errors(const Rig& rig, const Blocks& blocks,
                                          const std::vector<const HeldOutSums*>& sums,
                                          size_t may_lack = 0);

}  // namespace kincal
