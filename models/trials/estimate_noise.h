// Sigmas from the data: calibrate, take the noise levels for the sigmas, again until they no longer
// change.
//
// Each round is a step of Fisher's scoring for the variances, so few are needed where the assumed
// sigmas were not far off. A round changes a sigma by at most a factor of 3; from the 6th on it
// goes half the way (in the logarithm), which ends cycles. What cannot be estimated keeps its
// value. Sigmas of single views (samples files) are multiplied by the factor of their sensor's.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "../analysis/noise_levels.h"
#include "../calibration/calibration.h"

namespace kincal {

struct NoiseEstimate {
  Solution solution;  // of the same rig and samples but for the sigmas: those of its recording
  std::vector<NoiseLevel> levels;  // `assumed` are the sigmas of the first rig
  int rounds = 0;                  // calibrations that estimated the noise
  bool converged = false;          // the last of them moved no sigma by more than 1 %
};

/// Estimates the noise in at most 20 rounds; it ends at once where a calibration cannot start (the
/// solution's status). Levels that `which` does not choose stay as they are. nullopt: cancelled.
/// @throws as calibrate(); std::invalid_argument in modes marginal and point, where a sensor's
/// noise is mixed with that of the joints.
std::optional<NoiseEstimate> estimate_noise(const std::shared_ptr<const Recording>& given,
                                            const CalibrationOptions& options,
                                            bool (*which)(const Rig&, const NoiseLevel&) = nullptr);

}  // namespace kincal
