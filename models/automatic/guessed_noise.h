// Noise that nobody states, on the automatic path: estimated along with the widths, a step at each
// linearisation (analysis/noise_levels.h).
#pragma once

#include <memory>

#include "../estimation/estimation.h"
#include "widths.h"

namespace kincal {

/// Returns the recording with readings of joints between what sees and what is seen as noisy as is
/// guessed where nobody states that, or where they are stated exact, which no reading is.
std::shared_ptr<const Recording> with_guessed_noise(const Recording& recording, NoiseMode mode);

/// Moves noise that nobody states towards what the data show of it, at a fit of `data` (prepared at
/// `state`) with these widths; returns the largest change, of a logarithm. 0: all of it is stated.
double move_noise(Estimation& data, const VectorXd& state, const WidthProblem& problem,
                  const VectorXd& factor, std::shared_ptr<const Recording>& recording);

}  // namespace kincal
