// Gross outliers taken out of a calibration: points, views, samples.
//
//   1. A graduated fit of every step (fitting/robust.h) to everything: no plain fit, which gross
//   outliers would ruin.
//   2. Every training sample is judged by that fit (consensus.h).
//   3. A plain calibration of what is left, and 2. again at its values, until the same things are
//   out. What was out may come back, once.
// Joints that are clearly noisier than the rig states (by the median of their errors) are judged by
// what is seen of them: that their sigmas are too small is a finding of its own, and no reason to
// take right samples out. The result has the sigmas of the rig.
//
// They are found in mode `latent`; the result is an ordinary calibration of what is left in the
// mode and with the losses that were asked for. The views of the last step's sensors are judged.
// Held-out samples are never touched.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../calibration/calibration.h"

namespace kincal {

/// A Rejected is a gross outlier that was removed: points of a view, a view (no ids), a sample (no
/// sensor and target).
struct Rejected {
  std::string sample, sensor, target;
  std::vector<int> ids;
  std::string reason;
};

/// Cleaned is a calibration of the remaining data: its recording is that of the solution.
struct Cleaned {
  Solution solution;  // of status undefined_start where it, or a fit before it, cannot start
  std::vector<Rejected> rejected;
  std::string no_consensus;  // not empty: more than half would be out, so nothing was taken out
  std::vector<int> kept;     // where each sample of the solution stands in the given recording
};

/// Calibrates without gross outliers. If more than half of the training samples would be removed
/// there is no majority to trust, and nothing is removed. nullopt: cancelled. @throws as
/// calibrate(); std::invalid_argument if no parameter can be estimated from the remaining data.
std::optional<Cleaned> calibrate_without_outliers(const std::shared_ptr<const Recording>& recording,
                                                  const CalibrationOptions& options);

/// Returns what calibrate_without_outliers() would take out, after a plain calibration that ended
/// badly; it is empty also where nothing would be. nullopt: cancelled.
std::optional<std::vector<Rejected>> find_outliers(
    const std::shared_ptr<const Recording>& recording, const CalibrationOptions& options);

}  // namespace kincal
