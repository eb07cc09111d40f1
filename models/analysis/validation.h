// Validation: the error on data that a calibration did not use, and whether it is small enough.
//
// Blocks. What is held out together: a sample; or, where a sensor's samples are spread over several mounted targets whose poses some step
// frees, one in each sample (placements: a block of sockets put here and there), all samples of one target. A placement of which some
// samples are in the fit is known already and tells nothing of the others' error; held out as a whole, its pose is estimated from its own
// samples when it is judged (the formats' `held_out`).
//
// Folds. Blocks are sorted by what is seen in them (names of sensors, and of targets that are no placements) and, where that is the same, by
// a hash of their names, and dealt like cards to the K folds; so every fold has its share of every kind, and neither the order nor the
// number of other samples of the file plays a role. If all blocks of a sensor or of a target (placements aside) came into one fold, the first
// of them is never held out, so that the fit always has something of it. Fold 0 is what --holdout K holds out.
//
// Intervals: for the mean square q of a sensor's residuals over m blocks (squares s_i of n_i points, q = sum s_i / sum n_i) the jackknife
// over blocks on the logarithm (Efron, Stein 1981), with theta_i = ln q without block i and theta its mean,
//     e^2 = (m - 1) / m  sum (theta_i - theta)^2,     95 % interval of rms = sqrt(q) exp(-+ t e / 2),
// t the 97.5 % quantile of Student's t with m - 1 degrees of freedom. So blocks may be correlated inside and of any size. Nothing is
// random. It says how far rms would scatter with other blocks of the same kind for this calibration; with fewer than three targets, or
// views, the blocks are samples, and with fewer than three of those there is no interval.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "frames.h"

namespace kincal {

struct CalibrationOptions;

/// What is held out together.
struct Blocks {
  std::vector<int> of;             // by sample
  std::vector<std::string> names;  // by block: the sample's id, or the target's name
  std::vector<char> target;        // by block: a placement
};
Blocks make_blocks(const Rig& rig, const std::vector<Sample>& samples);

/// Fold of each sample, 0 to count - 1; -1: never held out, or no training sample.
struct Folds {
  int count = 0;
  Blocks blocks;
  std::vector<int> of;
  std::vector<std::string> held_out(int fold) const;  // names of blocks; fold -1: of those of training samples that are never held out
  bool by_target() const;                             // some block is a placement

  std::vector<char> training;  // by sample
};
/// @throws std::invalid_argument where there are fewer than `count` blocks that can be held out.
Folds deal_folds(const Rig& rig, const std::vector<Sample>& samples, int count);

struct Interval {
  double low = std::numeric_limits<double>::quiet_NaN(), high = std::numeric_limits<double>::quiet_NaN();  // NaN: none
};
/// 95 % interval of a root mean square; `squares` and `points` by block.
Interval rms_interval(const std::vector<double>& squares, const std::vector<long>& points);

/// Root mean squares of one sensor's residuals on data not used, with intervals; NaN: none. Units as SensorResult's.
struct HeldOutError {
  std::string sensor, unit;
  bool whole_pose = false;
  long points = 0;
  long missing = 0;        // views that cannot be evaluated at the estimate
  long blocks = 0;         // that the intervals are made from
  bool by_target = false;  // blocks are targets
  double rms, rms_as_read, rotation, rotation_as_read;
  Interval of_rms, of_rms_as_read, of_rotation, of_rotation_as_read;
};

/// Of the result's test split, sensor by sensor; empty: nothing is held out.
std::vector<HeldOutError> held_out_errors(const Calibration& calibration, const CalibrationResult& result);

struct CrossValidation {
  struct Fold {
    std::vector<std::string> held_out;  // blocks
    bool converged = false, determined = false;
    std::string error;  // why there is no calibration without this fold; its views are missing
  };
  bool by_target = false;
  std::vector<Fold> folds;
  std::vector<std::string> never;  // blocks that are never held out
  std::vector<HeldOutError> sensors;
};
/// K calibrations of the training samples from the rig's values, each without one fold, judged on that fold. Samples that are held out
/// already take no part. nullopt: options.progress cancelled. @throws std::invalid_argument as deal_folds.
std::optional<CrossValidation> cross_validate(const Calibration& calibration, const CalibrationOptions& options, int folds);

/// A tolerance. Sensor: rms as read, of the test split if it has points of the sensor, else cross-validated, else of training. Frame: rms
/// of the predicted sigma over the samples' postures (without such over the joints' limits), of the calibration alone.
struct Requirement {
  enum class Quantity { sensor, frame, chi2_per_dof };
  std::string text;  // as given
  Quantity quantity = Quantity::sensor;
  std::string name;  // of the sensor or frame
  bool rotation = false;
  double limit = 0;   // m, px, rad
  std::string unit;   // as given
  double factor = 1;  // limit of `unit` in m, px, rad
};
struct Judgement {
  Requirement requirement;
  std::string from;  // `test`, `cross_validation`, `train`, `samples`, `limits`, ``
  double measured;   // m, px, rad; NaN: none
  std::string why;   // there is none, or it does not count
  bool met = false;
};

/// What a calibration knows about its error on other data.
struct Validation {
  std::vector<std::string> held_out;  // blocks that --holdout took out of the training
  std::vector<HeldOutError> test;
  std::optional<CrossValidation> cross_validation;
  std::vector<FrameReport> frames;
  std::vector<Judgement> requirements;

  bool met() const;
};

/// "sensor/tracker<0.2mm: 0.169 mm, held out", or why there is nothing to measure.
std::string judgement_text(const Judgement& judgement);

/// With what `result.validation` has. Frames of requirements must be among its frames.
Judgement judge(const Requirement& requirement, const CalibrationResult& result);

}  // namespace kincal
