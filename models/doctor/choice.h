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

/// Mistakes that explain together what neither does alone; the trial is without them.
struct Mistakes {
  std::vector<Hypothesis> hypotheses;  // two; one that is as likely alone
  Trial trial;
  double log_prior;     // of all
  double log_evidence;  // with it
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

/// Looks for a second mistake on top of each of the few that lower chi2 most, however little, and
/// for samples, views and points that are wrong besides on top of each of the few that explain most
/// samples best.
std::optional<Mistakes> choose_two(const Recording& recording, const TrialContext& context,
                                   const TrialFit& now);

}  // namespace kincal
