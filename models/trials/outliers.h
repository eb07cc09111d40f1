// Removes gross outliers from a calibration: points, views, samples.
//
//   1. A graduated fit of every step (fitting/robust.h) to all data, because gross outliers would
//      corrupt a plain fit.
//   2. Every training sample is judged by that fit (consensus.h).
//   3. A plain calibration of the remaining data, and 2. again at its values, until the outliers no
//      longer change. Each may return once.
// Joints that are clearly noisier than the rig states (by the median of their errors) are judged by
// their actual noise: a sigma that is too small is a finding of its own, and no reason to remove
// good samples. The result has the rig's sigmas.
//
// Outliers are sought in mode `latent`; the result is an ordinary calibration of the remaining data
// with the requested mode and losses. Only views of the last step's sensors are judged. Held-out
// samples remain unchanged.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../calibration/calibration.h"

namespace kincal {

/// A Rejected is a gross outlier that was removed: points of a view, a view (no ids), or a sample
/// (no sensor and target).
struct Rejected {
  std::string sample, sensor, target;
  std::vector<int> ids;
  std::string reason;
};

/// Cleaned is a calibration of the remaining data. Its recording is that of the solution.
struct Cleaned {
  Solution solution;  // status undefined_start if it, or a fit before it, cannot start
  std::vector<Rejected> rejected;
  std::string no_consensus;  // not empty: more than half would be outliers, so none was removed
  std::vector<int> kept;     // index of each of the solution's samples in the given recording
};

/// Calibrates without gross outliers. If more than half of the training samples would be removed
/// there is no majority to trust, and nothing is removed. nullopt: cancelled. @throws as
/// calibrate(); std::invalid_argument if no parameter can be estimated from the remaining data.
std::optional<Cleaned> calibrate_without_outliers(const std::shared_ptr<const Recording>& recording,
                                                  const CalibrationOptions& options);

/// Returns the outliers that calibrate_without_outliers() would remove (none: empty), to explain
/// why a plain calibration ended badly. nullopt: cancelled.
std::optional<std::vector<Rejected>> find_outliers(
    const std::shared_ptr<const Recording>& recording, const CalibrationOptions& options);

}  // namespace kincal
