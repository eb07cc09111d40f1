#include "job.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <iostream>

#include "../io/document/files.h"
#include "../io/document/names.h"
#include "../io/report/report_page.h"
#include "../io/results/comparison.h"
#include "../io/results/intrinsics_file.h"
#include "../io/rig/rig_text.h"
#include "../io/rig/samples_file.h"
#include "../models/rig/selection.h"
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

namespace {

std::string activity = "starting";

}  // namespace

void now(const std::string& what) { activity = what; }

std::string error_text(const std::exception& error) {
  const bool memory =
      dynamic_cast<const std::bad_alloc*>(&error) || dynamic_cast<const std::length_error*>(&error);
  return memory ? "out of memory while " + activity : error.what();
}

ExitCode exit_code(const Report& report) {
  switch (report.solution.status) {
    case Status::converged:
      return report.validation.met() ? kConverged : kToleranceNotMet;
    case Status::unobservable:
      return kUnobservable;
    case Status::unexplained:
      return kNotExplained;
    default:
      return kNotConverged;
  }
}

void say_cleared(const std::vector<std::string>& notes) {
  for (const std::string& note : notes) std::fprintf(stderr, "kincal: warning: %s\n", note.c_str());
}

std::string rig_path(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::is_directory(path, ignored)
             ? (std::filesystem::path(path) / "rig.yaml").string()
             : path;
}

std::string in_program_words(std::string message) {
  // Places in the library's options, as "free[2]".
  for (const auto& [place, option] : {std::pair("free", "--free"),
                                      {"fix", "--fix"},
                                      {"group", "--group"},
                                      {"no_group", "--no-group"},
                                      {"spread", "--spread"}}) {
    const size_t end = message.find(']');
    if (message.rfind(std::string(place) + "[", 0) == 0 && end != std::string::npos)
      message.replace(0, end + 1, option);
  }
  if (message.rfind("last_step", 0) == 0) message.replace(0, 9, "--step");
  // Options of the library that a text names, as "`fix`".
  for (const auto& [mark, option] : {std::pair("`free`", "--free"),
                                     {"`fix`", "--fix"},
                                     {"`group`", "--group"},
                                     {"`no_group`", "--no-group"},
                                     {"`reject`", "--reject"},
                                     {"`estimate_noise`", "--estimate-noise"},
                                     {"`check`", "kincal check"}})
    for (size_t at; (at = message.find(mark)) != std::string::npos;)
      message.replace(at, std::strlen(mark), option);
  return message;
}

void in_program_words(Notice& notice) {
  for (std::string* words : {&notice.what, &notice.why, &notice.cure, &notice.otherwise})
    *words = in_program_words(std::move(*words));
}

InputError with_nearest(const NameError& error) {
  const std::string what = in_program_words(error.what()),
                    near = nearest_names(error.name, error.valid);
  if (!near.empty() || what.find("matches no parameter") == std::string::npos)
    return InputError(what +
                      (near.empty() ? nearest_or_all(error.name, error.valid, "there are") : near));
  return InputError(
      what +
      "; parameters are called joint/NAME/offset, /scale or /origin, sensor/NAME/pose, "
      "/intrinsics, /distortion or /baseline, target/NAME/pose, /square or /points, "
      "and * stands for anything");
}

std::shared_ptr<const Recording> checked_recording(const RigFile& rig_file,
                                                   std::vector<Sample> samples,
                                                   const std::string& samples_path) {
  const std::shared_ptr<const Recording> recording =
      make_recording(rig_file.rig, std::move(samples));
  try {
    check_steps(*recording);
    return recording;
  } catch (const NameError& error) {
    throw with_nearest(error);
  } catch (const std::invalid_argument&
               error) {  // a step that frees or sees nothing: either file may be wrong
    const std::string what = error.what();
    throw InputError(what.rfind(rig_file.path, 0) == 0
                         ? what
                         : rig_file.path + ": " + what + " (samples: " + samples_path + ")");
  }
}

std::vector<Sample> parse_samples(const std::string& text, const std::string& path, const Rig& rig,
                                  ProgressLine& line) {
  const Progress reading = line.progress().in("reading " + path);
  reading.share(0);
  std::vector<Sample> samples = parse_samples(text, path, rig, reading);
  reading.share(1);
  return samples;
}

Job read_job(const std::string& rig, const std::string& samples, int holdout, ProgressLine& line) {
  now("reading " + rig);
  RigFile rig_file = read_rig(rig_path(rig));
  now("reading " + samples);
  const std::string text = read_file(samples);  // once: it may be a pipe
  const std::string hash = sha256(text);
  std::string note;
  if (!rig_file.rig.priors.empty() && lenses_are_from(rig_file.path, hash)) {
    forget_lenses(rig_file.rig);
    note = "the lenses of " + rig_file.path +
           " come from these samples: they are found again, with all else, so that no corner "
           "counts twice";
  }
  std::shared_ptr<const Recording> recording =
      checked_recording(rig_file, parse_samples(text, samples, rig_file.rig, line), samples);
  if (recording->training().empty())
    throw InputError(samples +
                     ": every sample has \"split\": \"test\": nothing is left to calibrate with");
  std::vector<std::string> held_out;
  if (holdout > 0) {
    std::vector<Sample> split = recording->samples;
    try {
      const Folds folds = deal_folds(rig_file.rig, split, holdout);
      held_out = folds.held_out(0);
      for (size_t i = 0; i < split.size(); ++i)
        if (folds.of[i] == 0) split[i].train = false;
      recording = make_recording(recording->with_samples(std::move(split)));
      check_steps(*recording);
    } catch (const std::invalid_argument& error) {
      throw InputError("--holdout: " + std::string(error.what()));
    }
  }
  return {std::move(rig_file), samples, hash, std::move(recording), std::move(held_out), note};
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
    for (const Requirement& r : parse_requirement(text, *job.recording)) out.push_back(r);
  return out;
}

/// Those to report, and those that something is required of.
std::vector<Frame> read_frames(const Job& job, const CalibrateSettings& settings,
                               const std::vector<Requirement>& requirements) {
  std::vector<Frame> out;
  const auto add = [&](const std::string& name) {
    if (std::none_of(out.begin(), out.end(), [&](const Frame& f) { return f.name == name; }))
      out.push_back(frame_named(job.recording->rig, job.recording->table, name, "--report-frame"));
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
    if (settings.cross_validate > 0)
      deal_folds(job.recording->rig, job.recording->samples, settings.cross_validate);
  } catch (const std::invalid_argument& error) {
    throw InputError("--cross-validate: " + std::string(error.what()));
  }
}

void check_names(const Job& job, const CalibrateSettings& settings) {
  try {
    for (size_t i = 0; i < settings.free.size(); ++i)
      job.recording->table.find(settings.free[i], "free[" + std::to_string(i) + "]");
    for (size_t i = 0; i < settings.fix.size(); ++i)
      job.recording->table.find(settings.fix[i], "fix[" + std::to_string(i) + "]");
  } catch (const NameError& error) {
    throw with_nearest(error);
  } catch (const std::invalid_argument& error) {
    throw InputError(in_program_words(error.what()));
  }
}

std::vector<StepPlan> plan(const Job& job, const CalibrateSettings& settings) {
  try {
    std::vector<StepPlan> out = resolve_steps(*job.recording, options_of(settings));
    for (StepPlan& plan : out) {
      count(*job.recording, kNoiseModes.at(settings.noise), plan);
      for (std::string& message : plan.without_effect) message = in_program_words(message);
    }
    return out;
  } catch (const NameError& error) {
    throw with_nearest(error);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(in_program_words(error.what()));
  }
}

AutomaticGroups automatic_groups(const Job& job, const CalibrateSettings& settings) {
  try {
    return make_groups(*job.recording, {settings.groups, settings.no_groups});
  } catch (const NameError& error) {
    throw with_nearest(error);
  }
}

void check_groups(const Rig& rig, const CalibrateSettings& settings) {
  if (rig.steps.empty() || (settings.groups.empty() && settings.no_groups.empty())) return;
  const bool with = !settings.groups.empty();
  throw InputError(std::string(with ? "--group" : "--no-group") + ": '" +
                   (with ? settings.groups : settings.no_groups)[0] +
                   "' is for rigs without `estimate`; this rig's steps say what is free (" +
                   (with ? "--free frees" : "--fix holds") + " more of them)");
}

Report run(Job& job, const CalibrateSettings& settings, bool diagnose, ProgressLine& line) {
  check_validation(job, settings);
  StudyOptions options;
  options.calibration = options_of(settings);
  now("calibrating");
  options.calibration.progress = Progress([&](const Progress::News& news) {
    if (news.iteration >= 0) now("calibrating, step '" + news.what + "'");
    line.tell(news);
    return true;
  });
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
    Report report = study(job.recording, options).value();  // nothing cancels it
    if (!report.automatic.empty()) set_nominal(job.rig_file, nominal_values(report.solution));
    for (Notice& w : report.warnings) in_program_words(w);
    if (report.diagnosis)
      for (Notice& f : report.diagnosis->findings) in_program_words(f);
    if (report.solution.status == Status::undefined_start && !report.no_consensus.empty())
      report.solution.message = "--reject: " + report.solution.message;
    report.verdict.why = in_program_words(report.verdict.why);
    for (std::vector<std::string>* words : {&report.verdict.next, &report.verdict.reasons})
      for (std::string& one : *words) one = in_program_words(one);
    return report;
  } catch (const NameError& error) {
    throw with_nearest(error);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(in_program_words(error.what()));
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

ResultFiles make_files(const Job& job, const Report& report, const CalibrateSettings& settings) {
  now("making the files of the result");
  ResultOptions options;
  options.command = settings.command;
  options.date = date_now();
  options.samples_hash = job.samples_hash;
  options.version = KINCAL_VERSION;
  options.residuals = !settings.no_report;
  options.write_reduction = settings.write_reduction;
  ResultFiles files = make_results(job.rig_file, report, options);
  if (!settings.no_report)
    files.report_html = report_page({files.result_json, files.samples_csv, files.residuals_csv,
                                     files.loops_csv, files.covariance_csv});
  return files;
}

void add_page_settings(CLI::App& command, PageSettings& s) {
  command.add_option("--report", s.file, "write a page for a browser into this file")
      ->type_name("FILE");
  command.add_flag("--force", s.force, "replace an existing page")->needs("--report");
}

void check_page_file(const PageSettings& s) {
  if (s.file.empty()) return;
  say_cleared(clear_leftovers(s.file));
  check_output_file(s.file, s.force);
}

ResultOptions page_record(const PageSettings& s, const std::string& samples) {
  ResultOptions record;
  record.command = s.command;
  record.date = date_now();
  record.samples_hash = sha256(samples);
  record.version = KINCAL_VERSION;
  return record;
}

void write_page(const PageSettings& s, const ResultFiles& files, bool say) {
  const std::string page =
      report_page({files.result_json, files.samples_csv, files.residuals_csv, "", ""});
  begin_writing();
  write_file(s.file, page, s.force);
  if (say) std::cout << "Written to " << s.file << "\n";
}

void add_settings(CLI::App& command, CalibrateSettings& s) {
  command
      .add_option("--noise", s.noise,
                  "how noise of joint readings counts: latent (an unknown error per joint and "
                  "sample; honest sigmas), marginal, point, none")
      ->check(CLI::IsMember(keys(kNoiseModes)))
      ->capture_default_str();
  command
      .add_option("--threads", s.threads,
                  "threads of one calibration; the result is the same for any number")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command.add_option("--step", s.step, "run all steps up to this one");
  command
      .add_option("--free", s.free,
                  "name or glob to free in the last step that runs, e.g. 'joint/*_wrist_*/offset'; "
                  "may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  command
      .add_option("--fix", s.fix,
                  "name or glob to hold in the last step that runs; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  command
      .add_option(
          "--group", s.groups,
          "of a rig without `estimate`: also let this group of numbers be wrong (gears: the "
          "gear scales); may be repeated")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command
      .add_option(
          "--no-group", s.no_groups,
          "of a rig without `estimate`: take this group of numbers as the rig has it "
          "(offsets, lengths/*, sizes, ...: see --dry-run; curve/*, compliance*: joints have no "
          "error curves, do not bend); may be repeated")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command.add_option("--linear-solver", s.linear_solver, "of the reduced system")
      ->check(CLI::IsMember(keys(kLinearSolvers)))
      ->capture_default_str();
  command
      .add_option("--iterations", s.iterations,
                  "make so many iterations a step, also at the minimum: to see what the stop rule "
                  "leaves undone")
      ->check(CLI::Range(1, 100000))
      ->type_name("N");
  command.add_flag("--reject", s.reject,
                   "take gross outliers out first (points, views, samples), by a robust fit; say "
                   "which; then fit what is left");
  command.add_flag(
      "--estimate-noise", s.estimate_noise,
      "estimate the sigmas of sensors and joints along, as far as the data determine them; "
      "rig.yaml gets them (latent and none)");
  command
      .add_option("--holdout", s.holdout,
                  "hold out one K-th of the training samples, besides those with split: test; "
                  "whole targets where a sensor's samples are\n"
                  "spread over several mounted ones")
      ->check(CLI::Range(2, 1000))
      ->type_name("K");
  command
      .add_option("--cross-validate", s.cross_validate,
                  "K more calibrations, each judged on the K-th of the training that it lacks")
      ->check(CLI::Range(2, 1000))
      ->type_name("K");
  command
      .add_option("--report-frame", s.report_frames,
                  "predicted sigma over the workspace of a link, sensor/NAME or target/NAME "
                  "relative to the base; may be repeated")
      ->allow_extra_args(false)
      ->type_name("FRAME");
  command
      .add_option(
          "--require", s.require,
          "tolerance, exit code 4 if it is not met: 'sensor/NAME<0.2mm' (rms as read, held out "
          "where there is any), 'frame/LINK<1mm'\n"
          "(predicted sigma), 'chi2/dof<1.5'; units px, m, mm, um, rad, mrad, deg; may be repeated")
      ->allow_extra_args(false)
      ->type_name("QUANTITY<LIMIT");
  command.add_flag("--no-report", s.no_report,
                   "leave out report.html, residuals.csv, loops.csv and the table of loops");
  command.add_flag("--write-reduction", s.write_reduction,
                   "write calibrated gear scales into robot.urdf's mechanicalReduction and set "
                   "them to 1 in rig.yaml (for logs recorded from then on)");
}

}  // namespace kincal
