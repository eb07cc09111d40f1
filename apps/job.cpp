#include "job.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "../io/document/names.h"
#include "../io/results/comparison.h"
#include "../io/rig/rig_text.h"
#include "../io/rig/samples_file.h"
#include "../models/trials/estimate_noise.h"
#include "../models/trials/outliers.h"
#include "require.h"
#include "../models/rig/selection.h"

namespace kincal {

const std::map<std::string, NoiseMode> kNoiseModes = {
    {"latent", NoiseMode::latent}, {"marginal", NoiseMode::marginal}, {"point", NoiseMode::point}, {"none", NoiseMode::none}};
const std::map<std::string, LinearSolver> kLinearSolvers = {
    {"auto", LinearSolver::automatic}, {"dense", LinearSolver::dense}, {"cholmod", LinearSolver::cholmod}};

ExitCode exit_code(const CalibrationResult& result) {
  switch (result.status) {
    case Status::converged:
      return result.validation.met() ? kConverged : kToleranceNotMet;
    case Status::unobservable:
      return kUnobservable;
    default:
      return kNotConverged;
  }
}

std::string rig_path(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::is_directory(path, ignored) ? (std::filesystem::path(path) / "rig.yaml").string() : path;
}

InputError with_nearest(const NameError& error, const Calibration& calibration) {
  return InputError(error.what() + nearest_names(error.name, error.valid.empty() ? calibration.table().names() : error.valid));
}

Calibration make_calibration(const RigFile& rig_file, const std::string& samples_path) {
  return make_calibration(rig_file, read_samples(samples_path, rig_file.rig), samples_path);
}

Calibration make_calibration(const RigFile& rig_file, const std::vector<Sample>& samples, const std::string& samples_path) {
  try {
    return Calibration(rig_file.rig, samples);
  } catch (const NameError& error) {
    throw InputError(error.what() + nearest_names(error.name, error.valid));
  } catch (const std::invalid_argument& error) {  // a step that frees or sees nothing: either file may be wrong
    const std::string what = error.what();
    throw InputError(what.rfind(rig_file.path, 0) == 0 ? what : rig_file.path + ": " + what + " (samples: " + samples_path + ")");
  }
}

Job read_job(const std::string& rig, const std::string& samples, int holdout) {
  RigFile rig_file = read_rig(rig_path(rig));
  Calibration calibration = make_calibration(rig_file, samples);
  if (std::none_of(calibration.samples().begin(), calibration.samples().end(), [](const Sample& s) { return s.train; }))
    throw InputError(samples + ": every sample has \"split\": \"test\": nothing is left to calibrate with");
  std::vector<std::string> held_out;
  if (holdout > 0) {
    std::vector<Sample> split = calibration.samples();
    try {
      const Folds folds = deal_folds(rig_file.rig, split, holdout);
      held_out = folds.held_out(0);
      for (size_t i = 0; i < split.size(); ++i)
        if (folds.of[i] == 0) split[i].train = false;
      calibration = Calibration(rig_file.rig, std::move(split));
    } catch (const std::invalid_argument& error) {
      throw InputError("--holdout: " + std::string(error.what()));
    }
  }
  return {std::move(rig_file), samples, std::move(calibration), std::move(held_out)};
}

namespace {

CalibrationOptions options_of(const CalibrateSettings& settings) {
  CalibrationOptions options;
  options.noise = kNoiseModes.at(settings.noise);
  options.linear_solver = kLinearSolvers.at(settings.linear_solver);
  options.threads = settings.threads;
  options.last_step = settings.step;
  options.free = settings.free;
  options.fix = settings.fix;
  return options;
}

std::vector<Requirement> read_requirements(const Job& job, const CalibrateSettings& settings) {
  std::vector<Requirement> out;
  for (const std::string& text : settings.require)
    for (const Requirement& r : parse_requirement(text, job.calibration)) out.push_back(r);
  return out;
}

/// Those to report, and those that something is required of.
std::vector<Frame> read_frames(const Job& job, const CalibrateSettings& settings, const std::vector<Requirement>& requirements) {
  std::vector<Frame> out;
  const auto add = [&](const std::string& name) {
    if (std::none_of(out.begin(), out.end(), [&](const Frame& f) { return f.name == name; }))
      out.push_back(frame_named(job.rig_file.rig, job.calibration.table(), name, "--report-frame"));
  };
  for (const std::string& name : settings.report_frames) add(name);
  for (const Requirement& r : requirements)
    if (r.quantity == Requirement::Quantity::frame) add(r.name);
  return out;
}

}  // namespace

void check_validation(const Job& job, const CalibrateSettings& settings) {
  read_frames(job, settings, read_requirements(job, settings));
  try {
    if (settings.cross_validate > 0) deal_folds(job.rig_file.rig, job.calibration.samples(), settings.cross_validate);
  } catch (const std::invalid_argument& error) {
    throw InputError("--cross-validate: " + std::string(error.what()));
  }
}

std::vector<StepPlan> plan(const Job& job, const CalibrateSettings& settings) {
  try {
    return job.calibration.plan(options_of(settings));
  } catch (const NameError& error) {
    throw with_nearest(error, job.calibration);
  }
}

std::optional<CalibrationResult> run(Job& job, const CalibrateSettings& settings,
                                     const std::function<bool(const std::string&, int, double, double)>& progress) {
  CalibrationOptions options = options_of(settings);
  options.progress = progress;
  check_validation(job, settings);
  const std::vector<Requirement> requirements = read_requirements(job, settings);
  const std::vector<Frame> frames = read_frames(job, settings, requirements);
  std::vector<StagingTrial> tried;
  const bool staged = job.rig_file.rig.steps.empty();
  const std::vector<Sample> all = job.calibration.samples();
  const auto choose_steps = [&](const std::vector<Sample>& samples) {
    Rig open = job.rig_file.rig;
    open.steps.clear();
    StagingOptions staging_options;
    staging_options.noise = kNoiseModes.at(settings.noise);
    staging_options.threads = settings.threads;
    if (progress)
      staging_options.progress = [&](const std::string& what) { return progress("staging: " + what, 0, std::nan(""), std::nan("")); };
    std::optional<Staging> staging = stage(open, samples, staging_options);
    if (!staging) return false;
    set_steps(job.rig_file, staging->steps);
    job.calibration = Calibration(job.rig_file.rig, all);
    tried = std::move(staging->trials);
    return true;
  };
  if (staged && !choose_steps(all)) return std::nullopt;
  try {
    std::optional<CalibrationResult> result;
    if (settings.reject) {
      std::optional<Cleaned> clean = calibrate_without_outliers(job.calibration, options);
      if (!clean) return std::nullopt;
      if (staged &&
          !clean->result.rejected.empty()) {  // the steps were chosen with the outliers in: once more without, then all samples again
        if (!choose_steps(clean->calibration.samples())) return std::nullopt;
        clean = calibrate_without_outliers(job.calibration, options);
        if (!clean) return std::nullopt;
      }
      job.calibration = std::move(clean->calibration);
      result = std::move(clean->result);
    }
    if (settings.estimate_noise) {
      std::optional<NoiseEstimate> estimate = estimate_noise(job.calibration, options);
      if (!estimate) return std::nullopt;
      if (result) estimate->result.rejected = std::move(result->rejected);
      job.calibration = std::move(estimate->calibration);
      result = std::move(estimate->result);
    }
    if (!result) result = job.calibration.run(options);
    if (!result) return std::nullopt;
    const bool badly = result->status == Status::not_converged || result->chi2 > 10 * static_cast<double>(result->dof);
    if (badly && !settings.reject && !name_outliers(job.calibration, options, *result)) return std::nullopt;
    result->staging = std::move(tried);
    if (settings.restarts > 0 && !add_restarts(job.calibration, options, settings.restarts, *result)) return std::nullopt;
    if (!settings.no_report) result->loops = loops(job.calibration, *result);
    Validation& validation = result->validation;
    validation.held_out = job.held_out;
    validation.test = held_out_errors(job.calibration, *result);
    if (settings.cross_validate > 0) {
      validation.cross_validation = cross_validate(job.calibration, options, settings.cross_validate);
      if (!validation.cross_validation) return std::nullopt;
    }
    if (!frames.empty()) {
      const Unknowns unknowns = last_unknowns(job.calibration, *result);
      for (const Frame& frame : frames) validation.frames.push_back(report_frame(job.calibration, *result, unknowns, frame));
    }
    for (const Requirement& r : requirements) validation.requirements.push_back(judge_requirement(r, *result));
    return result;
  } catch (const NameError& error) {
    throw with_nearest(error, job.calibration);
  }
}

ResultFiles make_files(const Job& job, const CalibrationResult& result, const CalibrateSettings& settings) {
  ResultOptions options;
  options.command = settings.command;
  options.samples_path = job.samples_path;
  options.version = KINCAL_VERSION;
  options.residuals = !settings.no_report;
  options.write_reduction = settings.write_reduction;
  return make_results(job.rig_file, job.calibration, result, options);
}

void add_settings(CLI::App& command, CalibrateSettings& s) {
  command
      .add_option(
          "--noise", s.noise,
          "how noise of joint readings counts: latent (an unknown error per joint and sample; honest sigmas), marginal, point, none")
      ->check(CLI::IsMember(keys(kNoiseModes)))
      ->capture_default_str();
  command.add_option("--threads", s.threads, "threads of one calibration; the result is the same for any number")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command.add_option("--step", s.step, "run all steps up to this one");
  command.add_option("--free", s.free, "name or glob to free in the last step that runs, e.g. 'joint/*_wrist_*/offset'; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  command.add_option("--fix", s.fix, "name or glob to hold in the last step that runs; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  command.add_option("--linear-solver", s.linear_solver, "of the reduced system")
      ->check(CLI::IsMember(keys(kLinearSolvers)))
      ->capture_default_str();
  command.add_flag("--reject", s.reject,
                   "take gross outliers out first (points, views, samples), by a robust fit; say which; then fit what is left");
  command.add_flag("--estimate-noise", s.estimate_noise,
                   "estimate the sigmas of sensors and joints along, as far as the data tell them; rig.yaml gets them (latent and none)");
  command
      .add_option("--holdout", s.holdout,
                  "hold out one K-th of the training samples, besides those with split: test; whole targets where a sensor's samples are\n"
                  "spread over several mounted ones")
      ->check(CLI::Range(2, 1000))
      ->type_name("K");
  command.add_option("--cross-validate", s.cross_validate, "K more calibrations, each judged on the K-th of the training that it lacks")
      ->check(CLI::Range(2, 1000))
      ->type_name("K");
  command
      .add_option("--report-frame", s.report_frames,
                  "predicted sigma over the workspace of a link, sensor/NAME or target/NAME relative to the base; may be repeated")
      ->allow_extra_args(false)
      ->type_name("FRAME");
  command
      .add_option(
          "--require", s.require,
          "tolerance, exit code 4 if it is not met: 'sensor/NAME<0.2mm' (rms as read, held out where there is any), 'frame/LINK<1mm'\n"
          "(predicted sigma), 'chi2/dof<1.5'; units px, m, mm, um, rad, mrad, deg; may be repeated")
      ->allow_extra_args(false)
      ->type_name("QUANTITY<LIMIT");
  command.add_flag("--no-report", s.no_report, "leave out residuals.csv and the table of loops");
  command.add_flag(
      "--write-reduction", s.write_reduction,
      "write calibrated gear scales into robot.urdf's mechanicalReduction and set them to 1 in rig.yaml (for logs recorded from then on)");
}

}  // namespace kincal
