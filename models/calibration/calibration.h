// The main interface: runs the steps of a recording and returns a solution. It prints nothing and
// touches no files. Use:
//     Calibration calibration(make_recording(rig, samples), options);
//     const Solution& solution = calibration.solve();
// Analyses of a solution are functions in models/analysis, other calibrations of the same recording
// in models/trials; models/report/study.h runs everything in the right order.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../../solver/levenberg_marquardt.h"
#include "../../solver/progress.h"
#include "../rig/numbers.h"
#include "plan.h"
#include "solution.h"

namespace kincal {

struct CalibrationOptions : StepSelection {
  NoiseMode noise = NoiseMode::latent;
  int threads = 1;
  LinearSolver linear_solver = LinearSolver::automatic;
  int max_iterations = 200;  // of each step
  bool stop = true;          // false: each step makes all its iterations, for comparisons
  Progress progress;         // a cancelled calibration has Status::cancelled
};

/// StepVariations are changes that trials make to the same steps.
struct StepVariations {
  std::optional<VectorXd> start;  // starting values of the shared parameters in the first step;
                                  // estimates still count from the rig's
  /// Called before each step with its plan, the values that estimates count from, and the step's
  /// starting values, which it may change.
  std::function<void(const StepPlan&, const VectorXd&, VectorXd&)> before_step;
  /// By sensor: final scales of the last step's loss if they come from the data; empty: from the
  /// residuals.
  std::vector<double> noise_ratios;
  bool robust = false;  // every step by a graduated fit (fitting/robust.h), not to convergence;
                        // samples that cannot start are left out
};

/// Runs the steps of a recording. The outcome is the solution's status and message.
/// @throws NameError, std::invalid_argument as resolve_steps() (plan.h).
Solution calibrate(const std::shared_ptr<const Recording>& recording,
                   const CalibrationOptions& options, const StepVariations& variations = {});

/// A Calibration can be repeated: a robot that monitors itself replaces samples and solves again,
/// without analysis or allocation.
class Calibration {
 public:
  /// @throws NameError, std::invalid_argument: no samples, or as resolve_steps() (plan.h).
  explicit Calibration(const std::shared_ptr<const Recording>& recording,
                       CalibrationOptions options = {});
  ~Calibration();
  Calibration(Calibration&&) noexcept;
  Calibration& operator=(Calibration&&) noexcept;

  const Recording& recording() const;
  /// Returns the plan of the first solve(), with counts.
  std::vector<StepPlan> plan() const;

  /// The first call runs all steps. Later calls run only the last step again, from the last values,
  /// for other measured values in the same samples. They allocate nothing (if the solver does not:
  /// solver/levenberg_marquardt.h), and set the solution's status, message, chi2, cost and values.
  /// Quantities computed from these (estimates, covariance, unobservable directions, dof_data) stay
  /// empty until last() computes them. The reference is valid until the next call.
  const Solution& solve();
  /// Returns the complete solution of the last solve(), with estimates and covariance at its
  /// values.
  const Solution& last();

  /// Replaces the values (readings, measured values, sigmas of both) of a sample, without
  /// allocation. If `sample` has no sigmas for its readings (`noise`), the rig's apply, even if the
  /// replaced sample had its own. Solutions of earlier solves keep their values but share this
  /// recording: analyses of them use the new values. @throws std::invalid_argument: no such sample,
  /// or its views, points or count of sigmas differ from those of the sample that it replaces.
  void replace(int slot, const Sample& sample);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace kincal
