// Whether the model explains the data, and whether to use the result.
//
// The model does not explain the data if chi2/dof is above kBeyondNoise, or above kMistaken and the
// doctor found a mistake by a fit. What is likelier then, a mistake or noise that is stated too
// small? Noise is spread evenly: no sample, view or sensor sticks out, and neighbouring points of a
// view do not err alike, as they do where something is bent, turned or shifted.
#pragma once

#include <optional>
#include <string>

#include "report.h"

namespace kincal {

constexpr double kMistaken = 25;      // chi2/dof at which noise is not believed beside a finding
constexpr double kBeyondNoise = 100;  // chi2/dof at which noise or model are wrong by ten times

/// Returns chi2/dof of the data. Where the last step has a loss, which is there for what does not
/// fit, it is that of the middle view. NaN: there are no degrees of freedom.
double data_misfit(const Report& report);

/// Returns how many times larger than guessed noise came out that nobody states, squared: as
/// chi2/dof would be with the guess; at least 1.
double beyond_guess(const Report& report);
/// Returns why the model does not explain the data, the likelier cause (mistake or noise) and the
/// action; empty if it does explain them, or without a solution.
std::optional<Notice> why_unexplained(const Report& report);
/// Returns the verdict of a report that is otherwise complete: `no` if a warning is a fault or the
/// run did not converge, `doubts` if a finding or warning is a doubt, else `good`. Its text gives
/// the first of these, and before it the finding that explains it.
Verdict verdict(const Report& report);

}  // namespace kincal
