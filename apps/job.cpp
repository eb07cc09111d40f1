#include "job.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "../io/document/files.h"
#include "../io/rig/samples_file.h"

namespace kincal {

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

std::vector<Sample> parse_samples(const std::string& text, const std::string& path, const Rig& rig,
                                  ProgressLine& line) {
  const Progress reading = line.progress().in("reading " + path);
  reading.share(0);
  std::vector<Sample> samples = parse_samples(text, path, rig, reading);
  reading.share(1);
  return samples;
}

SampleSet read_sample_set(const std::string& path, const Rig& rig, ProgressLine& line) {
  now("reading " + path);
  const std::string text = read_file(path);  // once: it may be a pipe
  return parse_sample_set(text, path, rig, line.progress());
}

Job read_job(const std::string& rig, const std::string& samples, const CalibrateSettings& settings,
             ProgressLine& line) {
  now("reading " + rig);
  RigFile rig_file = read_rig(rig_path(rig));
  const SampleSet read = read_sample_set(samples, rig_file.rig, line);
  return make_job(std::move(rig_file), read, settings);
}

Report run(Job& job, const CalibrateSettings& settings, bool diagnose, ProgressLine& line) {
  now("calibrating");
  return run(job, settings, diagnose, Progress([&](const Progress::News& news) {
               if (news.iteration >= 0) now("calibrating, step '" + news.what + "'");
               line.tell(news);
               return true;
             }));
}

ResultFiles make_files(const Job& job, const Report& report, const CalibrateSettings& settings) {
  now("writing the files of the result");
  ResultFiles files = make_texts(job, report, settings);
  if (!settings.no_report) files.report_html = make_page(files);
  return files;
}

void add_page_settings(CLI::App& command, PageSettings& s) {
  command.add_option("--report", s.file, "write a report page (HTML) to this file")
      ->type_name("FILE");
  command.add_flag("--force", s.force, "replace an existing page")->needs("--report");
}

void check_page_file(const PageSettings& s) {
  if (s.file.empty()) return;
  say_cleared(clear_leftovers(s.file));
  check_output_file(s.file, s.force);
}

void write_page(const PageSettings& s, const ResultFiles& files, bool say) {
  const std::string page = make_page(files);
  begin_writing();
  write_file(s.file, page, s.force);
  if (say) std::cout << "Written to " << s.file << "\n";
}

void add_settings(CLI::App& command, CalibrateSettings& s) {
  command
      .add_option("--noise", s.noise,
                  "model of the noise of joint readings: latent (an unknown error per joint and "
                  "sample; correct sigmas), marginal, point, none")
      ->check(CLI::IsMember(keys(kNoiseModes)))
      ->capture_default_str();
  command
      .add_option("--threads", s.threads,
                  "threads of one calibration; the result does not depend on their number")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command.add_option("--step", s.step, "run all steps up to this one");
  command
      .add_option("--free", s.free,
                  "name or pattern of parameters to estimate in the last step that runs, e.g. "
                  "'joint/*_wrist_*/offset'; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  command
      .add_option(
          "--fix", s.fix,
          "name or pattern of parameters to fix in the last step that runs; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  command
      .add_option("--group", s.groups,
                  "without `estimate` in rig.yaml: also estimate this group of parameters (gears: "
                  "the gear scales); may be repeated")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command
      .add_option("--no-group", s.no_groups,
                  "without `estimate` in rig.yaml: fix this group of parameters (offsets, "
                  "lengths/*, sizes, ...: see --dry-run; curve/*: no error curves of joints; "
                  "compliance*: no bending of joints); may be repeated")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command.add_option("--linear-solver", s.linear_solver, "solver of the reduced linear system")
      ->check(CLI::IsMember(keys(kLinearSolvers)))
      ->capture_default_str();
  command
      .add_option(
          "--iterations", s.iterations,
          "make exactly N iterations per step, even at the minimum (to check the stop rule)")
      ->check(CLI::Range(1, 100000))
      ->type_name("N");
  command.add_flag("--reject", s.reject,
                   "first remove gross outliers (points, views, samples) by a robust fit and list "
                   "them; then fit the rest");
  command.add_flag("--estimate-noise", s.estimate_noise,
                   "also estimate the sigmas of sensors and joints where the data determine them, "
                   "and write them to rig.yaml (latent and none)");
  command
      .add_option("--holdout", s.holdout,
                  "hold out one K-th of the training samples, besides those with split: test; "
                  "whole targets if a sensor's samples are\n"
                  "spread over several mounted ones")
      ->check(CLI::Range(2, 1000))
      ->type_name("K");
  command
      .add_option(
          "--cross-validate", s.cross_validate,
          "K more calibrations, each tested on the K-th of the training samples that it leaves out")
      ->check(CLI::Range(2, 1000))
      ->type_name("K");
  command
      .add_option("--report-frame", s.report_frames,
                  "report the predicted sigma of a link, sensor/NAME or target/NAME relative to "
                  "the base over the workspace; may be repeated")
      ->allow_extra_args(false)
      ->type_name("FRAME");
  command
      .add_option(
          "--require", s.require,
          "tolerance, exit code 4 if it is not met: 'sensor/NAME<0.2mm' (rms as read, of held-out "
          "data if there are any), 'frame/LINK<1mm'\n"
          "(predicted sigma), 'chi2/dof<1.5'; units px, m, mm, um, rad, mrad, deg; may be repeated")
      ->allow_extra_args(false)
      ->type_name("QUANTITY<LIMIT");
  command.add_flag("--no-report", s.no_report,
                   "do not write report.html, residuals.csv, loops.csv and the table of loops");
  command.add_flag("--write-reduction", s.write_reduction,
                   "write calibrated gear scales into mechanicalReduction of robot.urdf and set "
                   "them to 1 in rig.yaml (for logs recorded afterwards)");
}

}  // namespace kincal
