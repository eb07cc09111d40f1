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
  now("making the files of the result");
  ResultFiles files = make_texts(job, report, settings);
  if (!settings.no_report) files.report_html = make_page(files);
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

void write_page(const PageSettings& s, const ResultFiles& files, bool say) {
  const std::string page = make_page(files);
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
