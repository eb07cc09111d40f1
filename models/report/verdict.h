// Whether the model explains the data, and whether to use the result.
//
// The model does not explain the data if chi2/dof is above kBeyondNoise, or above kMistaken and the
// doctor found a mistake by a fit. What is likelier then, a mistake or noise that is stated too
// small? Noise is spread evenly: no sample, view or sensor sticks out, and neighbouring points of a
// view do not err alike, as they do where something is bent, turned or shifted.
#pragma once

#include <string>

#include "report.h"

namespace kincal {

constexpr double kMistaken = 25;      // chi2/dof at which noise is not believed beside a finding
constexpr double kBeyondNoise = 100;  // chi2/dof at which noise or model are wrong by ten times

/// Returns chi2/dof of the data. Where the last step has a loss, which is there for what does not
/// fit, it is that of the middle view. NaN: there are no degrees of freedom.
double data_misfit(const Report& report);
/// Returns why the model does not explain the data, which of the two is likelier and what to do; ""
/// where it does, or where there is no solution to judge.
std::string why_unexplained(const Report& report);
/// Names the pose that is known worst, if that is no better than what a mount is good for, and what
/// to do; "" where all are better. (What the zero of the first or last joint decides does not
/// count: free_zeros.h.)
std::string loose_mount(const Report& report);
/// Returns whether a pose is known to no better than 0.3 m or 30 degrees.
bool has_open_mount(const Report& report);
/// Whether the number of a pose that is known worst would be known if a target's size were.
bool hangs_on_a_size(const Report& report);
/// Returns the verdict of a report that is otherwise complete.
Verdict verdict(const Report& report);

}  // namespace kincal
