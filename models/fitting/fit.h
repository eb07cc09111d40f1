// One fit of a recording: poses of free targets are started, everything that the setup frees is
// minimised, and the values come back. All other code starts and minimises through it.
//
// Samples that cannot start. A residual is undefined where a point lies behind its camera. By
// default that is an error: no pose can be proposed for a free target (an exception), or a residual
// is undefined at the start (the outcome, with the solver's undefined_group). With
// `leave_out_undefined` these samples take no part and are listed instead.
//
// Losses whose scale comes from the data (Loss::from_data) are solved by a graduated fit
// (robust.h), whose scales stay; then the solver goes on to convergence.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "../../solver/levenberg_marquardt.h"
#include "../estimation/estimation.h"
#include "free_targets.h"

namespace kincal {

struct FitOptions {
  SolverOptions solver;
  std::optional<Loss> start_loss;  // of the fits that start single targets; absent: the setup's
  /// Where a residual is undefined at the start, poses of targets that are not given are found
  /// anew: false: those that cannot be evaluated; true: all. It has no effect if samples may be
  /// left out.
  bool trust_start = false;
  bool leave_out_undefined =
      false;  // samples that cannot start are left out and listed instead of an error
  bool converge =
      true;  // false: a graduated fit is enough, the last solve to convergence is left out
  /// Free targets of samples that end badly are started anew from there, and what fits better is
  /// taken: where they were started, what is estimated may have been far off.
  bool restart_targets = false;
  bool keep_solver = false;             // for another solve; it has as much memory as all else
  std::shared_ptr<Estimation> problem;  // of these samples, if there is one already
  TargetStarts targets;                 // how free targets start; its progress is told their share
  const std::vector<double>* noise_ratios =
      nullptr;  // by sensor: where a graduated fit ends; null: at what the residuals show
};

/// A fit holds its problem, which shares the recording.
struct Fit {
  std::shared_ptr<Estimation> problem;  // of the samples that took part
  VectorXd state;  // of the problem. Call problem->renew(state) before its residuals are asked for
  Values values;   // the start, with what was estimated in place
  /// With undefined_start nothing was minimised, and `values` has the started targets; the same if
  /// no sample is left. A problem without measurements is converged, without history.
  SolveSummary summary;
  const char* linear_solver = "";  // that made it; "": nothing but a graduated fit was made
  std::unique_ptr<LevenbergMarquardt> solver;  // with keep_solver
  std::vector<int> left_out;                   // samples that could not start, ascending

  bool defined() const { return summary.outcome != Outcome::undefined_start; }
};

/// `samples` are the indices of those that take part; `start` has shared values, and targets' poses
/// and joint errors where they are known.
/// @throws std::runtime_error naming sample and target where no pose of a target can be evaluated,
/// unless such samples are left out; std::invalid_argument as Estimation does; Cancelled.
Fit fit(const Recording& recording, const std::vector<int>& samples, const EstimationSetup& setup,
        Values start, const FitOptions& options = {});

}  // namespace kincal
