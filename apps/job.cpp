#include "job.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>

namespace kincal {

const std::map<std::string, NoiseMode> kNoiseModes = {
    {"latent", NoiseMode::latent}, {"marginal", NoiseMode::marginal}, {"point", NoiseMode::point}, {"none", NoiseMode::none}};
const std::map<std::string, LinearSolver> kLinearSolvers = {
    {"auto", LinearSolver::automatic}, {"dense", LinearSolver::dense}, {"cholmod", LinearSolver::cholmod}};

ExitCode exit_code(Status status) {
  switch (status) {
    case Status::converged:
      return kConverged;
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
  const std::vector<Sample> samples = read_samples(samples_path, rig_file.rig);
  try {
    return Calibration(rig_file.rig, samples);
  } catch (const NameError& error) {
    throw InputError(error.what() + nearest_names(error.name, error.valid));
  } catch (const std::invalid_argument& error) {  // a step that frees or sees nothing: either file may be wrong
    const std::string what = error.what();
    throw InputError(what.rfind(rig_file.path, 0) == 0 ? what : rig_file.path + ": " + what + " (samples: " + samples_path + ")");
  }
}

Job read_job(const std::string& rig, const std::string& samples) {
  RigFile rig_file = read_rig(rig_path(rig));
  if (rig_file.rig.steps.empty()) throw InputError(rig + ": estimate: there are no steps: nothing is to be calibrated");
  Calibration calibration = make_calibration(rig_file, samples);
  if (std::none_of(calibration.samples().begin(), calibration.samples().end(), [](const Sample& s) { return s.train; }))
    throw InputError(samples + ": every sample has \"split\": \"test\": nothing is left to calibrate with");
  return {std::move(rig_file), samples, std::move(calibration)};
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

}  // namespace

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
  try {
    std::optional<CalibrationResult> result = job.calibration.run(options);
    if (result && !settings.no_report) result->loops = loops(job.calibration, *result);
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
  command.add_flag("--no-report", s.no_report, "leave out residuals.csv");
  command.add_flag(
      "--write-reduction", s.write_reduction,
      "write calibrated gear scales into robot.urdf's mechanicalReduction and set them to 1 in rig.yaml (for logs recorded from then on)");
}

}  // namespace kincal
