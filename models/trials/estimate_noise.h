// Sigmas from the data: calibrate, take what noise_levels() sees for the sigmas, again until they rest.
//
// Each round is a step of Fisher's scoring for the variances, so few are needed where the assumed sigmas were not far off. A round changes
// a sigma by at most a factor of 3; from the 6th on it goes half the way (in the logarithm), which ends cycles. What cannot be told keeps
// its value. Sigmas of single views (samples files) are taken times the factor of their sensor's.
#pragma once

#include <optional>

#include "../calibration/calibration.h"

namespace kincal {

struct NoiseEstimate {
  Calibration calibration;   // the same rig and samples but for the sigmas
  CalibrationResult result;  // with them; its noise_levels have the sigmas of the first rig as `assumed`
};

/// At most 20 rounds. nullopt: progress cancelled. @throws as Calibration::run; std::invalid_argument in modes marginal and point, where
/// a sensor's noise is mixed with that of the joints.
std::optional<NoiseEstimate> estimate_noise(const Calibration& given, const CalibrationOptions& options);

}  // namespace kincal
