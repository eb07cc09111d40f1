// Whether the model explains the data, and whether to use the result.
//
// The model does not explain the data if chi2/dof is above kBeyondNoise, or above kMistaken and the
// doctor found a mistake by a fit. The cause is then a mistake, or a stated noise that is too
// small. Noise is spread evenly: no sample, view or sensor is an outlier, and errors of
// neighbouring points of a view are uncorrelated. If something is bent, turned or shifted they are
// correlated.
#pragma once

#include <optional>
#include <string>

#include "report.h"

namespace kincal {

constexpr double kMistaken = 25;      // chi2/dof above which a finding is more likely than noise
constexpr double kBeyondNoise = 100;  // chi2/dof above which noise or model are wrong tenfold

/// Returns false if chi2/dof is further from 1 than noise of the stated sigmas would have it: by a
/// fifth or more, and by as much as chance makes it once in 30,000.
bool is_of_stated_size(double chi2_per_dof, double dof);

/// Returns chi2/dof of the data. If the last step has a loss, which reduces the weight of large
/// residuals, it is the median over the views instead. NaN: there are no degrees of freedom.
double data_misfit(const Report& report);

/// Returns the largest factor, squared, by which noise without a stated sigma exceeds its guess,
/// comparable to a chi2/dof with the guess; at least 1.
double beyond_guess(const Report& report);
/// Returns a notice if the model does not explain the data: the more likely cause (mistake or
/// noise) and the action. Empty if the model explains the data, or if there is no solution.
std::optional<Notice> why_unexplained(const Report& report);
/// Returns the verdict of a report that is otherwise complete: `no` if a warning is a fault or the
/// run did not converge, `doubts` if a finding or warning is a doubt, else `good`. Its text gives
/// the first of these, preceded by the finding that explains it.
Verdict verdict(const Report& report);

}  // namespace kincal
