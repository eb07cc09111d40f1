// The facade: a rig and its samples in, steps of estimation, and everything that is known afterwards out. Prints nothing, touches no
// files. Use:
//     Calibration calibration(rig, samples);
//     CalibrationResult result = calibration.run(options);
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/levenberg_marquardt.h"
#include "../doctor/finding.h"
#include "../estimation/estimation.h"
#include "../rig/selection.h"
#include "../analysis/explain.h"
#include "../analysis/noise_levels.h"
#include "../analysis/loops.h"
#include "../trials/restarts.h"
#include "../trials/staging.h"
#include "../analysis/validation.h"

namespace kincal {

struct StepPlan;

struct CalibrationOptions {
  NoiseMode noise = NoiseMode::latent;
  int threads = 1;
  LinearSolver linear_solver = LinearSolver::automatic;
  std::string last_step;                 // run all steps up to this one; empty: all
  std::vector<std::string> free, fix;    // names and globs, added to and taken from the last step that runs
  std::optional<VectorXd> start;         // shared values for the first step to start from; `initial` and T0 stay the rig's
  bool judge = true;                     // residuals before, after and as read of both splits (`sensors`, `residuals`), noise_levels, explanation
  /// Called before each step: may move the shared values that it starts from.
  std::function<void(const StepPlan&, VectorXd&)> scatter;
  bool robust = false;                   // every step by a graduated fit (robust.h), not to convergence; what cannot start stays out
  /// Called at the start of a step (iteration 0) and after each iteration: step, iteration, chi2, damping. False cancels.
  std::function<bool(const std::string&, int, double, double)> progress;
};

/// What a step will do.
struct StepPlan {
  std::string name;
  std::vector<Freed> free;
  std::vector<Prior> priors;
  std::vector<std::string> unused, held_out;
  std::vector<std::string> without_effect;  // of the last step: `free` and `fix` of the options that change nothing, and why
  long rows = 0, unknowns = 0;           // whitened residuals, joint-error and prior terms; shared and private unknowns
  int samples = 0;
};

struct StepResult {
  std::string name;
  bool converged = false;
  int iterations = 0;
  double chi2_initial = 0, chi2 = 0, cost = 0, seconds = 0;
  long dof = 0;
  const char* linear_solver = "";
  std::vector<std::pair<double, double>> history;
  std::vector<std::string> unused, held_out;
  std::vector<Direction> unobservable;
};

struct ParameterEstimate {
  std::string name;
  std::vector<std::string> components, units;
  std::vector<double> initial, value;
  std::vector<double> sigma;             // NaN: unobservable; 0: held
  std::vector<char> freed;               // components that some step freed
  std::vector<double> prior;             // sigmas of the last step's priors, 0: none
  std::string step;                      // the last that freed it
  std::optional<Pose> pose;              // absolute, of poses
};

/// Residuals of one sensor in one split; root mean squares over points (a view, for whole poses), NaN: none.
struct SplitStatistics {
  long points = 0;
  double rms_before, rms, rms_as_read;                             // px or m; poses: translation
  double rotation_before, rotation, rotation_as_read;              // rad, poses only
  double whitened_squared = 0;                                     // of the rms column
  long whitened_count = 0;
};

struct SensorResult {
  std::string name, unit;
  bool whole_pose = false;
  SplitStatistics train, test;
};

struct Warning {
  std::string id, text;
};

/// What was taken out as a gross outlier: points of a view, a view (no ids), a sample (no sensor and target).
struct Rejected {
  std::string sample, sensor, target;
  std::vector<int> ids;
  std::string reason;
};

/// Without the sample the parameter component would move by this many of its sigmas (one Newton step); infinite: not determined then.
struct Leverage {
  std::string sample, parameter;
  double moved_sigmas;
};

enum class Status { converged, unobservable, not_converged };

struct CalibrationResult {
  Status status = Status::converged;
  NoiseMode noise = NoiseMode::latent;
  double chi2 = 0, cost = 0;
  long dof = 0;
  std::vector<StepResult> steps;
  std::vector<ParameterEstimate> parameters;       // everything that any step freed, in the order of the steps
  std::vector<Direction> unobservable;             // of the last step
  std::vector<SensorResult> sensors;               // that see something
  std::vector<NoiseLevel> noise_levels;            // of the last step's sensors and joints
  int noise_rounds = 0;                            // calibrations that estimated the noise (estimate_noise()), 0: it is the rig's
  bool noise_rests = false;                        // the last of them moved no sigma by more than 1 %
  Explanation explanation;                         // what the data of the last step hardly tell
  std::vector<Warning> warnings;
  std::vector<Rejected> rejected;                  // by calibrate_without_outliers() (outliers.h)
  std::vector<Leverage> leverage;                  // above 1 sigma, largest first
  std::vector<std::string> computed_starts;        // poses absent from the rig whose initial value comes from the data
  std::vector<std::string> covariance_names;       // of the last step
  MatrixXd covariance;
  EstimationSetup setup;                           // of the last step: Estimation(rig, table, samples, training(), setup) at pack(values)
  Values values;                                   // shared parameters; poses and joint errors of the training samples
  std::vector<ViewResiduals> residuals, residuals_before, residuals_as_read;  // of all samples, the same views in the same order

  // What others than run() fill in where it is asked for.
  std::optional<Restarts> restarts;                // models/trials/restarts.h
  std::vector<StagingTrial> staging;               // models/trials/staging.h: what was tried for a rig without steps
  std::optional<Diagnosis> diagnosis;              // models/doctor/doctor.h
  std::vector<Loop> loops;                         // by loops() of models/analysis/loops.h, where somebody wants them
  Validation validation;                           // likewise, by the functions of models/analysis/validation.h
};

/// Residual table at given parameters.
struct Evaluation {
  bool converged = true;
  double chi2 = 0;
  long dof = 0;
  std::vector<SensorResult> sensors;               // without rms_before
  std::vector<Warning> warnings;
};

class Calibration {
 public:
  /// Resolves every step. @throws NameError, std::invalid_argument naming the place: a pattern without a match, a prior that covers
  /// nothing freed, a step that frees nothing or whose sensors see nothing.
  Calibration(Rig rig, std::vector<Sample> samples);

  const Recording& recording() const { return recording_; }
  const Rig& rig() const { return recording_.rig; }
  const std::vector<Sample>& samples() const { return recording_.samples; }
  const ParameterTable& table() const { return recording_.table; }
  /// Indices of the samples that are not held out.
  std::vector<int> training() const { return recording_.training(); }
  /// Shared values that estimates count from: the rig's; after run() with closed-form values of poses that the rig leaves open.
  const VectorXd& initial() const { return initial_; }

  /// What run() would do, step by step. @throws as run().
  std::vector<StepPlan> plan(const CalibrationOptions& options) const;

  /// @throws NameError, std::invalid_argument (options), std::runtime_error (a point behind its camera at the start, naming the view);
  /// returns nullopt if progress cancelled.
  std::optional<CalibrationResult> run(const CalibrationOptions& options);

  /// Residuals of both splits at the rig's values; free targets, joint errors and what `free` names are estimated in each split.
  Evaluation evaluate(NoiseMode noise, const std::vector<std::string>& free) const;

 private:
  struct Judged;
  std::vector<int> that_can_start(const std::vector<int>& samples, const std::vector<int>& sensors, Values& values) const;
  StepPlan resolve(size_t step, const std::vector<std::string>& free, const std::vector<std::string>& fix) const;
  std::vector<StepPlan> resolve_all(const CalibrationOptions& options) const;
  std::vector<std::string> without_effect(const CalibrationOptions& options) const;
  std::vector<const Step*> steps_to_run(const CalibrationOptions& options) const;
  Judged judge(const std::vector<int>& samples, const VectorXd& shared, NoiseMode noise, const Loss& loss, const std::vector<Freed>& free,
               const Values* start, bool with_dof, const std::vector<double>& levels = {}) const;
  void collect(CalibrationResult& result, const Estimation& last, const VectorXd& state, const Step& last_step,
               const std::vector<Freed>& held_out) const;
  void warn(CalibrationResult& result) const;

  Recording recording_;
  VectorXd initial_;
  std::vector<std::vector<char>> used_;  // by step: which parameters its measurements depend on
};

}  // namespace kincal
