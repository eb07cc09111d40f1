// Sigmas from the data: calibrate, set the sigmas to the noise levels, and repeat until they no
// longer change.
//
// Each round is a step of Fisher's scoring for the variances, so few are needed if the assumed
// sigmas are nearly right. A round changes a sigma by at most a factor of 3; from the 6th on it
// goes half the way (in the logarithm), which ends cycles. Sigmas that cannot be estimated keep
// their values. Sigmas of single views (samples files) are multiplied by the factor of their
// sensor.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "../analysis/noise_levels.h"
#include "../calibration/calibration.h"

namespace kincal {

struct NoiseEstimate {
  Solution solution;  // of the same rig and samples except for the sigmas in its recording
  std::vector<NoiseLevel> levels;  // `assumed` are the sigmas of the first rig
  int rounds = 0;                  // calibrations that estimated the noise
  bool converged = false;          // the last of them moved no sigma by more than 1 %
};

/// Estimates the noise in at most 20 rounds; it ends at once if a calibration cannot start (see the
/// solution's status). Levels that `which` does not select are unchanged. nullopt: cancelled.
/// @throws as calibrate(); std::invalid_argument in modes marginal and point, where a sensor's
/// noise is mixed with that of the joints.
std::optional<NoiseEstimate> estimate_noise(const std::shared_ptr<const Recording>& given,
                                            const CalibrationOptions& options,
                                            bool (*which)(const Rig&, const NoiseLevel&) = nullptr);

}  // namespace kincal
