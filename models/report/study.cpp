#include "study.h"

#include <cmath>
#include <stdexcept>

#include "../analysis/linearisation.h"
#include "../rig/numbers.h"
#include "../trials/estimate_noise.h"
#include "warnings.h"

namespace kincal {
namespace {

struct StudyCancelled {};
struct CannotStart {
  std::string message;
};

/// Steps from the data for a rig that has none: the same recording with them.
std::shared_ptr<const Recording> with_steps(const Recording& recording,
                                            const std::vector<Sample>& chosen_from,
                                            const StudyOptions& options, Report& report) {
  Rig rig = recording.rig;
  rig.steps.clear();
  StagingOptions staging;
  staging.noise = options.calibration.noise;
  staging.threads = options.calibration.threads;
  if (const auto& progress = options.calibration.progress)
    staging.progress = [&progress](const std::string& what) {
      return progress("staging: " + what, 0, kNan, kNan);
    };
  try {
    report.staging = stage(rig, chosen_from, staging);
  } catch (const std::runtime_error& error) {
    throw CannotStart{error.what()};
  }
  if (!report.staging) throw StudyCancelled();
  rig.steps = report.staging->steps;
  check_steps(Recording(rig, recording.samples));
  return make_recording(std::move(rig), recording.samples);
}

bool ended(const Solution& solution) {
  if (solution.status == Status::cancelled) throw StudyCancelled();
  return solution.status == Status::undefined_start;
}

/// Parts 1 to 4 up to the solution. The recording returned has the steps that were run, and the
/// samples as given.
std::shared_ptr<const Recording> solve(std::shared_ptr<const Recording> recording,
                                       const StudyOptions& options, Report& report) {
  const CalibrationOptions& calibration = options.calibration;
  const bool staged = recording->rig.steps.empty();
  if (staged) recording = with_steps(*recording, recording->samples, options, report);
  std::shared_ptr<const Recording> left = recording;
  bool solved = false;
  if (options.reject) {
    std::optional<Cleaned> clean = calibrate_without_outliers(left, calibration);
    if (clean && staged &&
        !clean->rejected.empty()) {  // the steps were chosen with the outliers in
      recording = with_steps(*recording, clean->solution.samples(), options, report);
      clean = calibrate_without_outliers(recording, calibration);
    }
    if (!clean) throw StudyCancelled();
    report.solution = std::move(clean->solution);
    report.rejected = std::move(clean->rejected);
    report.no_consensus = std::move(clean->no_consensus);
    left = report.solution.recording;
    solved = true;
    if (ended(report.solution)) return recording;
  }
  if (options.estimate_noise) {
    std::optional<NoiseEstimate> estimate = estimate_noise(left, calibration);
    if (!estimate) throw StudyCancelled();
    report.solution = std::move(estimate->solution);
    report.noise_levels = std::move(estimate->levels);
    report.noise_estimated = NoiseRounds{estimate->rounds, estimate->converged};
    report.no_consensus.clear();  // it was about the calibration before
    solved = true;
  }
  if (!solved) report.solution = calibrate(left, calibration);
  ended(report.solution);
  return recording;
}

void analyse(const StudyOptions& options, Report& report) {
  const Linearisation at = linearise(report.solution);
  report.leverage = leverage(at);
  report.explanation = explain(at);
  if (!report.noise_estimated) report.noise_levels = noise_levels(at);
  report.residuals = residuals(at);
  report.misfits = misfits(report.solution, report.residuals);
  const Solution& solution = report.solution;
  const bool badly =
      solution.status == Status::not_converged || solution.chi2_data > 10 * solution.dof_data;
  if (badly && !options.reject) {
    std::optional<std::vector<Rejected>> outliers =
        find_outliers(solution.recording, options.calibration);
    if (!outliers) throw StudyCancelled();
    report.outliers = std::move(*outliers);
  }
  if (options.restarts > 0 &&
      !(report.restarts = restarts(solution, options.calibration, options.restarts)))
    throw StudyCancelled();
  if (options.loops) report.loops = loops(solution);
  Validation& validation = report.validation;
  validation.held_out = options.held_out;
  validation.test = held_out_errors(solution, report.residuals);
  if (options.cross_validate > 0) {
    validation.cross_validation =
        cross_validate(solution.recording, options.calibration, options.cross_validate);
    if (!validation.cross_validation) throw StudyCancelled();
  }
  if (!options.frames.empty()) {
    const Unknowns unknowns = last_unknowns(at);
    for (const Frame& frame : options.frames)
      validation.frames.push_back(report_frame(solution, unknowns, frame));
  }
  for (const Requirement& r : options.requirements)
    validation.requirements.push_back(
        judge_requirement(r, validation, report.residuals.sensors, solution.chi2_per_dof()));
}

/// Mistakes are looked for in the samples as they were used, with the rig as it was given.
void add_diagnosis(const Rig& rig, const std::vector<Sample>& samples, const StudyOptions& options,
                   Report& report) {
  DoctorOptions doctor;
  doctor.noise = options.calibration.noise;
  doctor.threads = options.calibration.threads;
  if (const auto& progress = options.calibration.progress)
    doctor.progress = [&progress](int, int) {
      return progress("looking for mistakes", 0, kNan, kNan);
    };
  report.diagnosis = diagnose(rig, samples, doctor);
  if (!report.diagnosis) throw StudyCancelled();
}

}  // namespace

std::optional<Report> study(const std::shared_ptr<const Recording>& recording,
                            const StudyOptions& options) {
  Report report;
  try {
    std::shared_ptr<const Recording> given = recording;
    try {
      given = solve(recording, options, report);
    } catch (const CannotStart& undefined) {  // the search for steps
      report.solution.recording = recording;
      report.solution.status = Status::undefined_start;
      report.solution.message = undefined.message;
    }
    const Solution& solution = report.solution;
    const bool undefined = solution.status == Status::undefined_start;
    if (!undefined) analyse(options, report);
    const bool unexplained = solution.status != Status::converged ||
                             solution.chi2_data > kUnexplained * solution.dof_data;
    if (options.diagnose && unexplained)
      add_diagnosis(given->rig, undefined ? given->samples : solution.samples(), options, report);
  } catch (const StudyCancelled&) {
    return std::nullopt;
  }
  report.warnings = warnings(report);
  report.solution.last.reset();
  return report;
}

}  // namespace kincal
