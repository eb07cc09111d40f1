// Which of the hypotheses explains the data: each is undone, fitted and compared with what the fit
// leaves as it is. doctor.h proves and words what is chosen here.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "trial_fits.h"

namespace kincal {

/// An AcceptedHypothesis explains something; its trial has all samples.
struct AcceptedHypothesis {
  Hypothesis hypothesis;
  Trial trial;
  double log_odds;                     // against the data as they are (alternatives.h)
  std::vector<Alternative> as_likely;  // other kinds that may be the cause as well
};

/// Returns factors by which the sizes of a hypothesis are to be changed. Empty where the scale
/// factors contradict each other, change nothing or collapse the target.
std::vector<double> size_factors(const Rig& rig, const Hypothesis& h, const Trial& t);

/// Returns what the numbers that a trial found say (Hypothesis::told): the mistake and its cure.
std::pair<std::string, std::string> told(const Hypothesis& h, const Trial& t);

/// Weighs all mistakes and returns the likeliest; nothing if none is a finding. `now`: the fit of
/// the data as they are; where it leaves nothing to explain, only where its parameters came out
/// counts.
std::optional<AcceptedHypothesis> choose(const Recording& recording, const TrialContext& context,
                                         const TrialFit& now);

/// Returns the fit of all samples of a recording with one mistake undone.
Trial fit_without(const Recording& recording, const TrialContext& context, const Hypothesis& h);

/// Returns what may be the first of two mistakes, undone: the likeliest few, however little they
/// explain.
std::vector<AcceptedHypothesis> first_looks(const Recording& recording, const TrialContext& context,
                                            const TrialFit& now);

}  // namespace kincal
