// Gross outliers taken out of a calibration: points, views, samples.
//
//   1. A graduated fit of every step (robust.h) to everything: no plain fit, which gross outliers would ruin.
//   2. Every training sample is judged by that fit (consensus.h).
//   3. A plain calibration of what is left, and 2. again at its values, until the same things are out. What was out may come back, once.
// Found are they in mode `latent`; the result is an ordinary calibration of what is left in the mode and with the losses that were asked
// for. Judged are the views of the last step's sensors. Held-out samples are never touched.
#pragma once

#include <optional>

#include "../calibration/calibration.h"

namespace kincal {

/// A calibration of what is left, and its result with `rejected`.
struct Cleaned {
  Calibration calibration;
  CalibrationResult result;
};

/// Where more than half of the training samples would be out there is no majority to trust: nothing is taken out, and the result has the
/// warning `no_consensus`. nullopt: progress cancelled. @throws as Calibration::run().
std::optional<Cleaned> calibrate_without_outliers(const Calibration& calibration, const CalibrationOptions& options);

/// After a plain calibration that ended badly: warnings `outlier_sample`, `outlier_view`, `outlier_point` with what
/// calibrate_without_outliers() would take out, in place of those of misfits.h, which such a fit may mislead. Nothing found: as they were.
/// False: progress cancelled.
bool name_outliers(const Calibration& calibration, const CalibrationOptions& options, CalibrationResult& result);

}  // namespace kincal
