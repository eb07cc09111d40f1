// Log odds of a mistake, undone, against the data as they are: what the doctor decides by.
//
// Both are fitted with all errors free that a robot has which was built from its drawing
// (with_usual_errors()), so that errors of its own geometry favour neither. Their evidence is the
// log marginal likelihood with unknown noise (evidence/evidence.h), plus these terms.
//
// - A pose that the rig gives and the steps free, moved by d (5 cm and 5 degrees each count as 1):
//   -7/2 ln(1 + d^2), Cauchy's density in six dimensions.
//
// - A pose that the rig omits, found t metres from its link: -2 ln(1 + t^2), Cauchy's density in
//   three dimensions, because robots are some metres large.
//
// - Another number that the steps free without a prior, moved by d of its usual error:
//   -2 ln(1 + d^2 / 3), Student's density with three degrees of freedom; where the mistake itself
//   frees it: -ln(1 + d^2), Cauchy's. A focal length that changes its sign, or a principal point
//   that moves by a focal length: -690. No lens is like that.
//
// - A number that is wrong in views or points that are left out: -ln(300 / sqrt(2 pi)). It may be
//   anywhere within 300 sigmas (of the noise that the fit leaves), where a number that is kept is
//   normal. Six numbers are wrong with the views of a target from one body (a rigid motion), two
//   with a point. All their effective residuals have that noise as those that are kept: -ln of it
//   over the stated one.
//
// - If undoing the mistake multiplies what a sensor measures by k (a unit): n ln k for the n
//   effective residuals of that sensor. The densities are of the same numbers then.
//
// Prior odds: each kind of mistake is in one recording of a hundred, a rarer one in one of a
// thousand, shared by all of its kind. A finding has odds of 99 to 1 against the data as they are,
// beyond what differs by chance where neither explains them. A mistake that frees parameters, and
// then explains the data, may also have these odds where everything else is as the rig states it:
// among the errors of any robot is also a square or a baseline that is some percent off. (Not so a
// different lens: other values of the rig's own explain as much.)
#pragma once

#include <cmath>
#include <optional>

#include "../evidence/evidence.h"
#include "trial_fits.h"

namespace kincal {

/// Log odds from which on a mistake is a finding: 99 %.
const double kFound = std::log(Thresholds::found);
/// Log odds within which another mistake may be the cause as well: 90 %.
const double kAsLikely = std::log(Thresholds::as_likely);
/// Returns by how much the log odds of mistakes differ that explain the same: their fits end a
/// little apart.
double precision(double log_odds);

/// Returns the log odds of a mistake before the data are looked at. `alike`: mistakes of its kind.
double log_prior(bool rarer, size_t alike);

/// A FreerFit is one with all usual errors free besides, and its evidence.
struct FreerFit {
  TrialFit fit;
  ModelEvidence evidence;
};
/// Returns that of a trial, where the numbers `as_stated` are not among the errors; nothing: it has
/// no evidence.
std::optional<FreerFit> fit_with_usual_errors(const Recording& recording,
                                              const TrialContext& context, const FitSpec& spec,
                                              const TrialFit& fit,
                                              const std::vector<std::string>& as_stated = {});

/// Returns whether a focal length changed its sign, or a principal point moved by a focal length.
bool is_impossible(const Recording& recording, const TrialFit& fit);

/// Returns the log evidence of a trial, or of the data as they are (`h` null), without what is left
/// out.
double log_evidence(const Recording& recording, const TrialContext& context, const FitSpec& spec,
                    const TrialFit& fit, const Hypothesis* h = nullptr,
                    const std::vector<std::string>& as_stated = {});
/// Returns the larger of the log evidence with usual errors and with everything as stated.
double log_evidence_either_way(const Recording& recording, const TrialContext& context,
                               const TrialFit& fit);

/// A FittedPart is a part of the samples, and a fit of it alone.
struct FittedPart {
  Recording recording;
  TrialFit fit;
};
/// An EvidenceApart is that of parts that have nothing in common but their noise, with everything
/// as stated that the steps do not free.
struct EvidenceApart {
  double log = 0;
  ModelEvidence noise;
};
/// Returns it; nothing: a part has none.
std::optional<EvidenceApart> evidence_apart(const std::vector<FittedPart>& parts);
/// Returns the log evidence of such parts where the noise is known, without what is the same for
/// all fits of the data.
double log_evidence_at(const std::vector<FittedPart>& parts, const ModelEvidence& noise);

/// Returns the log density of the views and points that a fit of a recording leaves out of the
/// given one.
double log_left_out(const Recording& given, const Recording& kept, const TrialFit& fit);

/// Returns three standard deviations of the gain in log evidence, summed over samples (Vuong,
/// Econometrica 57, 1989); 0 if the fits without the mistake explain the data. `about` are the
/// subjects of the mistake; their samples are counted apart.
double log_by_chance(const std::vector<FittedPart>& with, const std::vector<FittedPart>& without,
                     const Subjects& about = {});

/// Returns about the log evidence, from what a fit has left, without further fits: residuals of any
/// view count as at most twelve, with one unknown factor of the noise. To rank trials by.
double rough_log_evidence(const Recording& recording, const TrialFit& fit, const Hypothesis* h);

}  // namespace kincal
