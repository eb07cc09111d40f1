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
bool ended(const Solution& solution) {
  if (solution.status == Status::cancelled) throw StudyCancelled();
  return solution.status == Status::undefined_start;
}

AutomaticOptions automatic_options(const StudyOptions& options) {
  AutomaticOptions out;
  static_cast<CalibrationOptions&>(out) = options.calibration;
  out.groups = options.groups;
  return out;
}

/// A recording with the steps that run, and the options for them: on the automatic path those of
/// its starting widths, in which nothing is free that was to be held.
std::shared_ptr<const Recording> with_steps(const std::shared_ptr<const Recording>& recording,
                                            const StudyOptions& options,
                                            CalibrationOptions& calibration) {
  if (!recording->rig.steps.empty()) return recording;
  Rig rig = recording->rig;
  rig.steps = automatic_steps(*recording, automatic_options(options));
  calibration.fix.clear();
  return make_recording(std::move(rig), recording->samples);
}

/// Parts 1 to 4 up to the solution. The recording returned has the samples as given.
std::shared_ptr<const Recording> solve(const std::shared_ptr<const Recording>& given,
                                       const StudyOptions& options, Report& report) {
  CalibrationOptions calibration = options.calibration;
  const bool automatic = given->rig.steps.empty();
  const std::shared_ptr<const Recording> recording = with_steps(given, options, calibration);
  std::shared_ptr<const Recording> left = recording;
  bool solved = false;
  if (options.reject) {
    std::optional<Cleaned> clean = calibrate_without_outliers(left, calibration);
    if (!clean) throw StudyCancelled();
    report.solution = std::move(clean->solution);
    report.rejected = std::move(clean->rejected);
    report.no_consensus = std::move(clean->no_consensus);
    left = report.solution.recording;
    solved = !automatic;
    if (ended(report.solution)) return recording;
  }
  if (automatic) {
    AutomaticCalibration found = calibrate_automatically(*left, automatic_options(options));
    report.solution = std::move(found.solution);
    report.automatic = std::move(found.groups);
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
  return automatic ? make_recording(report.solution.rig(), recording->samples) : recording;
}

/// What cross-validation is made of: the samples as given, with the sigmas of the result.
std::shared_ptr<const Recording> recording_to_fold(const Recording& given, const Report& report) {
  std::vector<Sample> samples = given.samples;
  std::vector<NoiseLevel> levels = report.noise_levels;
  for (NoiseLevel& level : levels) level.seen = level.used;
  Rig ignored = given.rig;
  if (report.noise_estimated) scale_noise(ignored, samples, levels);
  return make_recording(report.solution.rig(), std::move(samples));
}

void analyse(const Recording& given, const StudyOptions& options, Report& report) {
  const Linearisation at = linearise(report.solution);
  report.leverage = leverage(at);
  report.explanation = explain(at);
  if (!report.noise_estimated) report.noise_levels = noise_levels(at);
  report.residuals = residuals(at);
  report.misfits = misfits(report.solution, report.residuals);
  const Solution& solution = report.solution;
  const bool badly = solution.status == Status::not_converged ||
                     solution.chi2 > 10 * static_cast<double>(solution.dof);
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
        cross_validate(options.reject ? recording_to_fold(given, report) : solution.recording,
                       options.calibration, options.cross_validate, options.reject);
    if (!validation.cross_validation) throw StudyCancelled();
  }
  if (!options.frames.empty()) {
    const Unknowns unknowns = last_unknowns(at);
    for (const Frame& frame : options.frames)
      validation.frames.push_back(report_frame(solution, unknowns, frame));
  }
  for (const Requirement& r : options.requirements)
    validation.requirements.push_back(
        judge_requirement(r, validation, report.residuals.sensors, solution.chi2, solution.dof));
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
    const std::shared_ptr<const Recording> given = solve(recording, options, report);
    const Solution& solution = report.solution;
    const bool undefined = solution.status == Status::undefined_start;
    if (!undefined) analyse(*given, options, report);
    const bool unexplained = solution.status != Status::converged ||
                             solution.chi2 > kUnexplained * static_cast<double>(solution.dof);
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
