// Sets of a batch, calibrated in child processes: what ends one of them costs the set at hand.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "../job.h"
#include "batch_arguments.h"
#include "output.h"
#include "work.h"

namespace kincal {

/// Returns the options that make a difference to results, as a command line.
std::string options_text(const CalibrateSettings& settings);

/// Calibrates each of these sets in a child, at most a.jobs of them at once. `ended` hears of each
/// one that has ended, by its place; `look` is called between. Returns false if it was interrupted.
bool calibrate_each(const std::vector<Set>& sets, const Output& output, const BatchArguments& a,
                    const Signals& signals, const std::function<void(size_t, SetSummary)>& ended,
                    const std::function<void()>& look);

}  // namespace kincal
