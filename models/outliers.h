// Measurements that do not belong to the others: found, named, taken out.
//
// Taking out (calibrate_without_outliers).
//   1. A graduated fit of every step (robust.h) to everything: no plain fit, which gross outliers would ruin.
//   2. Every sample by itself, shared parameters held at that fit, its targets and joint errors estimated (mode `latent`, whatever the
//      mode of the calibration: a view may miss by what the joints' noise explains). If a plain fit leaves no residual block and no joint
//      error beyond chi2_bound() levels of its sensor, the sample belongs. Else by a graduated fit of the sample alone: blocks beyond the
//      bound are outliers; a view with more than a third of them is one as a whole; so is the sample if no majority of its views is left
//      that hang together, or if the odd one out is a chain, whose measurement is the joint readings.
//   3. A plain calibration of what is left, and 2. again at its values, until the same things are out. Something that is out may miss
//      because it did not take part: it is judged by what one Newton step of all parameters, from their estimate and its covariance,
//      would leave of its residuals; if that fits, it comes back (once).
// The final result is an ordinary calibration of what is left. Held-out samples are never touched.
//
#pragma once

#include <optional>
#include <vector>

#include "calibration.h"

namespace kincal {

/// A calibration of what is left, and its result with `rejected`.
struct Cleaned {
  Calibration calibration;
  CalibrationResult result;
};

/// Where more than half of the training samples would be out there is no majority to trust: nothing is taken out, and the result has the
/// warning `no_consensus`. nullopt: progress cancelled. @throws as Calibration::run().
std::optional<Cleaned> calibrate_without_outliers(const Calibration& calibration, const CalibrationOptions& options);

/// Warnings `outlier_sample` and `outlier_view`: what fits much worse than the other samples, or than the other views of its sensor, in a
/// finished result (with residuals).
std::vector<Warning> misfits(const Calibration& calibration, const CalibrationResult& result);

}  // namespace kincal
