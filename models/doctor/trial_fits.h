// Fits of a recording as it is and with something changed, to be compared: what they free, how far
// they go, what they find.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/progress.h"
#include "../estimation/estimation.h"
#include "../fitting/free_targets.h"
#include "../rig/numbers.h"
#include "diagnosis.h"
#include "observation_index.h"

namespace kincal {

/// These are the Thresholds of the doctor's beliefs. Ratios have no unit.
struct Thresholds {
  /// A fit needs no explanation if chi2/dof of the whole and the mean square of each sensor's
  /// residuals are below this.
  static constexpr double good = 1.5;
  /// What a fit leaves counts as noise if chi2/dof is below this, because the rig's sigmas are
  /// guesses.
  static constexpr double noise = 3;
  /// No noise and no robot as it is built explains chi2/dof above this.
  static constexpr double no_noise = 100;
  /// One corrected value explains the data by itself if chi2/dof falls by this factor.
  static constexpr double clean_gain = 1.6;
  /// Of a few samples, half a turn of views or a joint that never moved: chi2 falls by this factor.
  static constexpr double decisive = 4;
  /// A sample is bad if the mean square of its rows is above the median sample's by this factor.
  static constexpr double sample_excess = 25;
  /// Bad samples are a hypothesis only if they are at most this share of all.
  static constexpr double most_bad = 0.4;
  /// Two mistakes at once are looked for if chi2/dof is above this.
  static constexpr double hopeless = 100;
  /// A point lies far off at this many sigmas, if at most this share of all points does.
  static constexpr double far_point = 10, most_far = 0.2;
  // Odds (alternatives.h). By all of these together 2 of 1000 right recordings of 14 kinds of
  // robots have a false alarm (benchmarks/healthy.py).
  /// A mistake is a finding from these odds on; another is named with it within these.
  static constexpr double found = kFoundOdds, as_likely = kAsLikelyOdds;
  /// Shares of recordings that have a mistake of a kind, and of a rare kind.
  static constexpr double of_a_kind = 0.01, rarer = 0.001;
  /// A residual that is left out may be anywhere within this, sigmas: some hundred pixels.
  static constexpr double anywhere = 300;
  /// A given pose is about as near as this, m and rad: where a mount was measured by hand.
  static constexpr double pose_near = 0.05, turn_near = 0.0873;
  /// Log density of a lens that cannot be (is_impossible()): 1e-300.
  static constexpr double impossible = -690;
  /// What differs by chance, standard deviations.
  static constexpr double by_chance = 3;
  /// A noise that nobody states is guessed so, m or rad, where its size is estimated.
  static constexpr double guessed_reading = 1e-3;
  /// Mistakes are looked for on top of each other in at most this many rounds.
  static constexpr int rounds = 4;
};

/// A FitSpec is what one minimisation frees, by name, so that it fits rigs whose tables differ.
struct FitSpec {
  std::vector<int> sensors;
  std::vector<std::string> free;                       // components
  std::vector<std::pair<std::string, double>> priors;  // component, sigma
  Loss loss;
};

/// A TrialContext is what trial fits of a recording have in common.
struct TrialContext {
  NoiseMode noise = NoiseMode::latent;
  int threads = 1;
  Progress progress;           // as in DoctorOptions
  std::vector<FitSpec> steps;  // the rig's
  FitSpec all;                 // what the steps free together
  bool usual_steps = false;    // the rig has no steps: these are usual ones
  bool given_poses_freed =
      false;  // the rig gives a pose that `all` frees wholly: closed form may find a better start
  bool explained_as_given = false;  // the data as given need no explanation, or none with a robot's
                                    // usual errors, which calibrations without steps estimate
  std::shared_ptr<std::vector<Alternative>> tried;  // is told all that is tried; null: nobody asks
  std::shared_ptr<ViewPosesMemory> memory = std::make_shared<ViewPosesMemory>();  // of all trials
};

struct TrialOptions {
  int iterations = 100;
  double relative_decrease = 1e-9;
  bool closed_form = false;  // for given poses too that are freed wholly
  const Values* start = nullptr;
  std::optional<Loss> loss;
  StartEffort target_starts = StartEffort::refined;
  double give_up = kInfinity;  // chi2 that after some iterations is not worth more
};

/// A Movement is how far a parameter is from the rig's value; far is more than 1 time.
struct Movement {
  double by = 0;     // m, rad, share of a length
  double times = 0;  // the same over what is far (Scales::far)
};

struct TrialFit {
  double chi2 = 0, cost = 0;
  long dof = 0;
  std::vector<int>
      undefined;  // samples without a start, or with a point behind a camera there; not in chi2
  Values values;
  std::vector<double> sample;   // mean square of a sample's rows, by index; NaN: not part of it
  std::vector<double> trimmed;  // the same without the worst tenth of each view's points
  std::vector<double> sensor;   // of a sensor's residuals
  std::map<std::string, Movement> moved;  // freed parameters, from the rig's values
  EstimationSetup setup;                  // of the fit
  std::vector<int> samples;               // that took part

  /// Returns the largest movement; of more than 1 some parameter is far from where it started.
  double farthest() const {
    double out = 0;
    for (const auto& m : moved) out = std::max(out, m.second.times);
    return out;
  }

  bool complete() const { return undefined.empty() && std::isfinite(chi2); }
  double score() const { return complete() ? cost : kInfinity; }
  double per_dof() const {
    return complete() ? chi2 / static_cast<double>(std::max(1L, dof)) : kInfinity;
  }
};

/// A Trial is a hypothesis tried: the recording with the mistake undone, and the fit of it.
struct Trial {
  Recording recording;
  FitSpec spec;
  TrialFit fit;
  double cost;  // for comparison; infinite: the fit cannot start
};

/// True if the fit needs no explanation.
bool good(const TrialFit& f);

/// Returns what a spec frees, in the terms of a table.
FreedNames freed_names(const ParameterTable& table, const FitSpec& spec);

/// True if the rig gives a pose that the spec frees wholly.
bool frees_given_poses(const Recording& recording, const FitSpec& spec);

/// Makes the recording that trials are about: all samples are in training, without views that no
/// step uses; a rig without steps gets the usual ones. It fills in the context's specs. @throws
/// NameError, std::invalid_argument as Calibration does.
Recording plan_trials(const Recording& given, TrialContext& context);

/// Minimises spec after spec; the fit that it returns is that of the last one. @throws
/// std::invalid_argument where a path cannot be walked; Cancelled.
TrialFit trial_fit(const Recording& recording, const TrialContext& context,
                   const std::vector<FitSpec>& specs, const TrialOptions& options);

/// An Effort is how far a fit goes.
struct Effort {
  int iterations;
  double decrease;             // relative, below which it stops
  bool closed_form = false;    // try it anyway
  double give_up = kInfinity;  // TrialOptions::give_up
};

/// Returns the spec with everything free besides that something depends on, as far as such numbers
/// are off in a robot that was built from its drawing: three widths (rig/scales.h), and no more
/// than usual; poses that the steps hold as well as such things can be measured (their yardstick).
/// What `held` names stays as the spec has it.
FitSpec with_usual_errors(const Recording& recording, FitSpec spec,
                          const std::vector<std::string>& held = {});

/// Returns the fit from the rig's values, or from closed form where these do not lead anywhere.
TrialFit best_fit(const Recording& recording, const TrialContext& context, const FitSpec& spec,
                  const Effort& effort);

/// Returns the best fit of everything that the steps free: from the rig's values, closed form, or
/// the steps one after the other.
TrialFit fit_as_is(const Recording& recording, const TrialContext& context);

/// Returns enough samples for a first look: every pair of sensor and target some times, and several
/// times as many numbers as unknowns.
std::vector<Sample> some_samples(const Recording& recording, size_t unknowns);

}  // namespace kincal
