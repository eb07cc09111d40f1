// Noise that nobody states, on the automatic path: estimated along with the widths, a step at each
// linearisation (analysis/noise_levels.h). Levels that hide behind each other move slowly: the
// steps are accelerated (solver/fixed_point.h).
#pragma once

#include <memory>
#include <optional>

#include "../../solver/fixed_point.h"
#include "../analysis/noise_levels.h"
#include "width_problem.h"

namespace kincal {

/// Returns the recording with readings of joints between what sees and what is seen as noisy as is
/// guessed where nobody states that, or where they are stated exact, which no reading is.
std::shared_ptr<const Recording> with_guessed_noise(const Recording& recording, NoiseMode mode);

/// Returns what a calibration accelerates its steps of the noise with.
FixedPoint noise_steps();

/// A recording whose noise is estimated.
struct NoisyRecording {
  std::shared_ptr<const Recording> recording;
  DoubtedNoise doubted;  // its factor is applied in the recording
};

/// Moves noise that is not stated, and the factors, towards what the data show, at a fit with these
/// widths. Returns how far the largest step is from rest: below 1 all levels are at rest. 0:
/// nothing is unknown.
double move_noise(const DataProblem& data, const WidthProblem& problem, const VectorXd& factor,
                  FixedPoint& steps, NoisyRecording& noisy);

/// Returns the recording with stated noise as the data show it at a fit, where that is more.
std::shared_ptr<const Recording> with_seen_noise(const DataProblem& data,
                                                 const WidthProblem& problem,
                                                 const VectorXd& factor,
                                                 std::shared_ptr<const Recording> recording);

}  // namespace kincal
