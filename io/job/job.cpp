#include "job.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>

#include "../document/files.h"
#include "../document/names.h"
#include "../report/report_page.h"
#include "../results/comparison.h"
#include "../results/intrinsics_file.h"
#include "../rig/rig_text.h"
#include "../rig/samples_file.h"
#include "require.h"

namespace kincal {

const std::map<std::string, NoiseMode> kNoiseModes = {{"latent", NoiseMode::latent},
                                                      {"marginal", NoiseMode::marginal},
                                                      {"point", NoiseMode::point},
                                                      {"none", NoiseMode::none}};
const std::map<std::string, LinearSolver> kLinearSolvers = {{"auto", LinearSolver::automatic},
                                                            {"dense", LinearSolver::dense},
                                                            {"sparse", LinearSolver::sparse},
                                                            {"cholmod", LinearSolver::cholmod}};

SampleSet parse_sample_set(const std::string& text, const std::string& path, const Rig& rig,
                           const Progress& progress) {
  const Progress reading = progress.in("reading " + path);
  reading.share(0);
  auto samples =
      std::make_shared<const std::vector<Sample>>(parse_samples(text, path, rig, reading));
  reading.share(1);
  return {path, sha256(text), std::move(samples)};
}

std::shared_ptr<const Recording> checked_recording(const RigFile& rig_file,
                                                   const SampleSet& samples, Words words) {
  const auto recording = std::make_shared<const Recording>(
      std::make_shared<const Rig>(rig_file.rig), nullptr, samples.samples);
  try {
    check_steps(*recording);
    return recording;
  } catch (const NameError& error) {
    throw with_nearest(error, words);
  } catch (const std::invalid_argument&
               error) {  // a step that frees or sees nothing: either file may be wrong
    const std::string what = error.what();
    throw InputError(what.rfind(rig_file.path, 0) == 0
                         ? what
                         : rig_file.path + ": " + what + " (samples: " + samples.path + ")");
  }
}

Job make_job(RigFile rig_file, const SampleSet& samples, const CalibrateSettings& settings) {
  std::string note;
  if (!rig_file.rig.priors.empty() && lenses_are_from(rig_file.path, samples.hash)) {
    forget_lenses(rig_file.rig);
    note = "the lenses of " + rig_file.path +
           " come from these samples: they are estimated again, with all else, so that no corner "
           "counts twice";
  }
  std::shared_ptr<const Recording> recording = checked_recording(rig_file, samples, settings.words);
  if (recording->training().empty())
    throw InputError(samples.path +
                     ": every sample has \"split\": \"test\": nothing is left to calibrate with");
  std::vector<std::string> held_out;
  if (settings.holdout > 0) {
    std::vector<Sample> split = recording->samples;
    try {
      const Folds folds = deal_folds(rig_file.rig, split, settings.holdout);
      held_out = folds.held_out(0);
      for (size_t i = 0; i < split.size(); ++i)
        if (folds.of[i] == 0) split[i].train = false;
      recording = make_recording(recording->with_samples(std::move(split)));
      check_steps(*recording);
    } catch (const std::invalid_argument& error) {
      throw InputError(option_name("holdout", settings.words) + ": " + error.what());
    }
  }
  return {std::move(rig_file),  samples.path,        samples.hash,
          std::move(recording), std::move(held_out), note};
}

namespace {

CalibrationOptions options_of(const CalibrateSettings& settings) {
  CalibrationOptions options;
  options.noise = kNoiseModes.at(settings.noise);
  options.linear_solver = kLinearSolvers.at(settings.linear_solver);
  if (settings.iterations > 0) {
    options.max_iterations = settings.iterations;
    options.stop = false;
  }
  options.threads = settings.threads;
  options.last_step = settings.step;
  options.free = settings.free;
  options.fix = settings.fix;
  return options;
}

std::vector<Requirement> read_requirements(const Job& job, const CalibrateSettings& settings) {
  std::vector<Requirement> out;
  for (const std::string& text : settings.require)
    for (const Requirement& r : parse_requirement(text, *job.recording, settings.words))
      out.push_back(r);
  return out;
}

/// The names of those to report, and of those that something is required of.
std::vector<std::string> read_frames(const Job& job, const CalibrateSettings& settings,
                                     const std::vector<Requirement>& requirements) {
  std::vector<std::string> out;
  const auto add = [&](const std::string& name) {
    frame_named(job.recording->rig, job.recording->table, name,
                option_name("report_frame", settings.words));
    if (!std::count(out.begin(), out.end(), name)) out.push_back(name);
  };
  for (const std::string& name : settings.report_frames) add(name);
  for (const Requirement& r : requirements)
    if (r.quantity == Requirement::Quantity::frame) add(r.name);
  return out;
}

void check_range(const char* option, int value, int low, int high) {
  if (value < low || value > high)
    throw InputError(std::string(option) + ": " + std::to_string(value) + " is not in " +
                     std::to_string(low) + " .. " + std::to_string(high));
}

template <class Map>
void check_choice(const char* option, const std::string& value, const Map& map) {
  std::vector<std::string> valid;
  for (const auto& entry : map) valid.push_back(entry.first);
  if (!map.count(value))
    throw InputError(std::string(option) + ": unknown value '" + value +
                     "'; valid: " + comma_separated(valid));
}

}  // namespace

void check_settings(const CalibrateSettings& s) {
  check_choice("noise", s.noise, kNoiseModes);
  check_choice("linear_solver", s.linear_solver, kLinearSolvers);
  check_range("threads", s.threads, 1, 1024);
  if (s.iterations != 0) check_range("iterations", s.iterations, 1, 100'000);
  if (s.restarts != 0) check_range("restarts", s.restarts, 1, 10'000);
  if (s.holdout != 0) check_range("holdout", s.holdout, 2, 1000);
  if (s.cross_validate != 0) check_range("cross_validate", s.cross_validate, 2, 1000);
}

void check_validation(const Job& job, const CalibrateSettings& settings) {
  read_frames(job, settings, read_requirements(job, settings));
  try {
    if (settings.cross_validate > 0)
      deal_folds(job.recording->rig, job.recording->samples, settings.cross_validate);
  } catch (const std::invalid_argument& error) {
    throw InputError(option_name("cross_validate", settings.words) + ": " + error.what());
  }
}

void check_names(const Job& job, const CalibrateSettings& settings) {
  try {
    for (size_t i = 0; i < settings.free.size(); ++i)
      job.recording->table.find(settings.free[i], "free[" + std::to_string(i) + "]");
    for (size_t i = 0; i < settings.fix.size(); ++i)
      job.recording->table.find(settings.fix[i], "fix[" + std::to_string(i) + "]");
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  } catch (const std::invalid_argument& error) {
    throw InputError(in_words(error.what(), settings.words));
  }
}

std::vector<StepPlan> plan(const Job& job, const CalibrateSettings& settings) {
  try {
    std::vector<StepPlan> out = resolve_steps(*job.recording, options_of(settings));
    for (StepPlan& plan : out) {
      count(*job.recording, kNoiseModes.at(settings.noise), plan);
      for (std::string& message : plan.without_effect) message = in_words(message, settings.words);
    }
    return out;
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(in_words(error.what(), settings.words));
  }
}

AutomaticGroups automatic_groups(const Job& job, const CalibrateSettings& settings) {
  try {
    return make_groups(*job.recording, {settings.groups, settings.no_groups});
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  }
}

void check_groups(const Rig& rig, const CalibrateSettings& settings) {
  if (rig.steps.empty() || (settings.groups.empty() && settings.no_groups.empty())) return;
  const bool with = !settings.groups.empty();
  const auto option = [&](const char* name) { return option_name(name, settings.words); };
  throw InputError(
      option(with ? "group" : "no_group") + ": '" +
      (with ? settings.groups : settings.no_groups)[0] +
      "' is for rigs without `estimate`; this rig's steps list the estimated parameters (" +
      (with ? option("free") + " frees" : option("fix") + " holds") + " more of them)");
}

Report run(Job& job, const CalibrateSettings& settings, bool diagnose, const Progress& progress) {
  check_validation(job, settings);
  StudyOptions options;
  options.calibration = options_of(settings);
  options.calibration.progress = progress;
  options.groups = {settings.groups, settings.no_groups};
  options.reject = settings.reject;
  options.estimate_noise = settings.estimate_noise;
  options.restarts = settings.restarts;
  options.cross_validate = settings.cross_validate;
  options.loops = !settings.no_report;
  options.diagnose = diagnose;
  options.held_out = job.held_out;
  options.requirements = read_requirements(job, settings);
  options.frames = read_frames(job, settings, options.requirements);
  try {
    Report report = uncancelled(study(job.recording, options));
    if (!report.automatic.empty()) set_nominal(job.rig_file, nominal_values(report.solution));
    for (Notice& w : report.warnings) in_words(w, Words::switches);
    if (report.diagnosis)
      for (Notice& f : report.diagnosis->findings) in_words(f, Words::switches);
    if (report.solution.status == Status::undefined_start && !report.no_consensus.empty())
      report.solution.message =
          option_name("reject", settings.words) + ": " + report.solution.message;
    report.verdict.why = in_words(report.verdict.why, Words::switches);
    for (std::vector<std::string>* words : {&report.verdict.next, &report.verdict.reasons})
      for (std::string& one : *words) one = in_words(one, Words::switches);
    return report;
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(in_words(error.what(), settings.words));
  }
}

namespace {

/// The date and time, UTC; SOURCE_DATE_EPOCH (seconds since 1970) stands for it where results are
/// compared byte by byte.
std::string date_now() {
  std::time_t seconds = std::time(nullptr);
  if (const char* given = std::getenv("SOURCE_DATE_EPOCH"))
    std::from_chars(given, given + std::strlen(given), seconds);
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[40];
  return std::string(text, std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts));
}

}  // namespace

ResultOptions record_of(const std::string& command, const std::string& samples_hash) {
  ResultOptions record;
  record.command = command;
  record.date = date_now();
  record.samples_hash = samples_hash;
  record.version = KINCAL_VERSION;
  return record;
}

ResultFiles make_texts(const Job& job, const Report& report, const CalibrateSettings& settings) {
  ResultOptions options = record_of(settings.command, job.samples_hash);
  options.residuals = !settings.no_report;
  options.write_reduction = settings.write_reduction;
  return make_results(job.rig_file, report, options);
}

std::string make_page(const ResultFiles& files) {
  return report_page({files.result_json, files.samples_csv, files.residuals_csv, files.loops_csv,
                      files.covariance_csv});
}

FinishedJob calibrate_job(const RigFile& rig_file, const SampleSet& samples,
                          const CalibrateSettings& settings, const Progress& progress) {
  Job job = make_job(rig_file, samples, settings);
  check_validation(job, settings);
  check_groups(job.rig_file.rig, settings);
  Report report = run(job, settings, true, progress);
  ResultFiles files;
  if (report.solution.status != Status::undefined_start) files = make_texts(job, report, settings);
  return {std::move(job), std::move(report), std::move(files)};
}

std::string why_no_start(const Report& report) {
  if (report.solution.status != Status::undefined_start) return "";
  if (!report.diagnosis || report.diagnosis->findings.empty()) return report.solution.message;
  return with_id(report.diagnosis->findings[0]) +
         "\nSo no calibration can start: " + report.solution.message;
}

}  // namespace kincal
