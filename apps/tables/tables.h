// What the command line prints: progress, residual tables, parameters, warnings.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../io/results/comparison.h"
#include "../../io/results/results.h"
#include "../../io/results/summary_file.h"
#include "../../models/calibration/calibration.h"
#include "../../models/doctor/doctor.h"
#include "../../models/trials/local.h"

namespace kincal {

/// A live line per iteration on a terminal, a plain line per step elsewhere; on standard error.
class Progress {
 public:
  explicit Progress(bool quiet);
  void update(const std::string& step, int iteration, double chi2, double damping);
  /// Ends the last step's line.
  void finish();
  /// Ends the line where it is.
  void interrupted();

 private:
  bool quiet_, terminal_;
  std::string step_;
  int iteration_ = 0;
  double chi2_ = 0;
};

/// The paper's table: per sensor rms before and after, train and held out. `before`: with that column.
std::string residual_table(const std::vector<SensorResult>& sensors, bool before);
/// The paper's figure 10: sensors that look down, sensors that are looked into across; training samples.
std::string loop_table(const CalibrationResult& result);
/// Minima that restarts found.
std::string restart_table(const Restarts& restarts);
/// The parameter components that changed most, with sigmas.
std::string parameter_table(const CalibrationResult& result, size_t most);
/// What each step frees and counts.
std::string plan_table(const std::vector<StepPlan>& plans, const ParameterTable& table);
/// What automatic staging will try, and what it has tried.
std::string staging_plan(const std::vector<std::pair<std::string, std::vector<std::string>>>& groups);
std::string staging_table(const std::vector<StagingTrial>& trials);
/// Held-out errors with intervals, folds, frames, tolerances; empty if there is nothing of these.
std::string validation_table(const CalibrationResult& result);
/// Two calibrations compared: the parameters that differ most in sigmas, and frames.
std::string comparison_table(const Comparison& comparison, size_t most);
/// The samples without which a parameter would move most.
std::string leverage_table(const std::vector<Leverage>& leverage);
/// What `--reject` took out: counts, and the first of it.
std::string rejected_table(const std::vector<Rejected>& rejected);
/// Steps, tables, what is not in the URDF, warnings.
std::string report(const CalibrationResult& result, const ResultFiles& files);
/// What the doctor found: findings, what was tested, the verdict.
std::string diagnosis_text(const Diagnosis& diagnosis);
/// A batch: how many of each status, chi2/dof and rms over the sets, and the sets that are not converged, with reasons.
std::string batch_table(const std::vector<SetSummary>& sets, size_t ignored);

/// Local offsets, their radius, and the errors with and without them.
std::string local_report(const Rig& rig, const LocalCalibration& local);

}  // namespace kincal
