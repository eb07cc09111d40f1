// The command line: arguments, progress, exit codes. Everything else is in the libraries.

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <thread>

#include "../io/simulation_file.h"
#include "batch.h"
#include "calibrate.h"
#include "tables.h"

namespace {

using namespace kincal;

volatile std::sig_atomic_t interrupted = 0;

bool not_interrupted() { return interrupted == 0; }

int say_interrupted() {
  std::fprintf(stderr, "kincal: interrupted, nothing written\n");
  return kInterrupted;
}

template <class Map>
std::vector<std::string> keys(const Map& map) {
  std::vector<std::string> out;
  for (const auto& entry : map) out.push_back(entry.first);
  return out;
}

struct CalibrateArguments {
  std::string rig, samples, out;
  CalibrateSettings settings;
  bool force = false, dry_run = false, quiet = false, json = false;
};

int calibrate(const CalibrateArguments& a) {
  if (!a.dry_run) {
    if (a.out.empty()) throw InputError("calibrate: --out DIR is required (only --dry-run does without)");
    check_output(a.out, a.force);
  }
  Job job = read_job(a.rig, a.samples);
  for (const std::string& warning : job.rig_file.urdf.warnings) std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  if (a.dry_run) {
    std::cout << plan_table(plan(job, a.settings), job.calibration.table());
    return kConverged;
  }
  Progress progress(a.quiet || a.json);
  const std::optional<CalibrationResult> result =
      run(job, a.settings, [&](const std::string& step, int iteration, double chi2, double damping) {
        progress.update(step, iteration, chi2, damping);
        return not_interrupted();
      });
  if (!result || interrupted) {
    progress.interrupted();
    return say_interrupted();
  }
  progress.finish();
  const ResultFiles files = make_files(job, *result, a.settings);
  if (!write_results(a.out, files, a.force, not_interrupted)) return say_interrupted();
  if (a.json)
    std::cout << files.result_json;
  else if (!a.quiet)
    std::cout << report(*result, files) << "\nWritten to " << a.out << "\n";
  return exit_code(result->status);
}

struct EvaluateArguments {
  std::string rig, samples, urdf, noise = "latent";
  std::vector<std::string> free;
  bool json = false;
};

int evaluate(const EvaluateArguments& a) {
  const RigFile rig_file = read_rig(rig_path(a.rig), a.urdf);
  const Calibration calibration = make_calibration(rig_file, a.samples);
  try {
    const Evaluation evaluation = calibration.evaluate(kNoiseModes.at(a.noise), a.free);
    if (a.json) {
      std::cout << evaluation_json(evaluation);
    } else {
      std::cout << residual_table(evaluation.sensors, false);
      std::printf("chi2 of all samples %.8g, %ld degrees of freedom", evaluation.chi2, evaluation.dof);
      if (evaluation.dof > 0) std::printf(", chi2/dof %.4g", evaluation.chi2 / evaluation.dof);
      std::printf("\n");
    }
    if (!evaluation.converged) std::fprintf(stderr, "kincal: warning: the estimation of targets or joint errors did not converge\n");
    return evaluation.converged ? kConverged : kNotConverged;
  } catch (const NameError& error) {
    throw with_nearest(error, calibration);
  }
}

struct ApplyArguments {
  std::string result, urdf, out;
  bool force = false;
};

int apply(const ApplyArguments& a) {
  if (!a.force && std::ifstream(a.out).good()) throw InputError(a.out + ": exists already; --force replaces it");
  write_file(a.out, apply_result(a.result, read_urdf(a.urdf), a.force));
  std::cout << "Written to " << a.out << "\n";
  return kConverged;
}

struct SimulateArguments {
  std::string rig, out, truth, postures;
  std::vector<std::string> spread;
  int samples = 0;
  unsigned long long seed = 0;
  bool force = false;
};

int simulate(const SimulateArguments& a) {
  check_output(a.out, a.force);
  const RigFile rig_file = read_rig(rig_path(a.rig));
  const ParameterTable table(rig_file.rig);
  SimulationOptions options;
  options.seed = a.seed;
  options.samples = a.samples;
  if (!a.postures.empty()) options.postures = read_postures(a.postures, rig_file.rig);
  VectorXd truth = table.initial;
  if (!a.truth.empty()) truth = read_truth(a.truth, table);
  std::vector<Spread> spread;
  for (const std::string& s : a.spread) {
    const size_t equals = s.rfind('=');
    Node value;
    value.kind = Node::Kind::scalar;
    value.text = equals == std::string::npos ? "" : s.substr(equals + 1);
    const std::string where = "--spread";
    if (equals == std::string::npos || equals == 0) throw InputError("--spread: GLOB=SIGMA is expected, not '" + s + "'");
    spread.push_back({s.substr(0, equals), Field{&value, &where, s}.number_at_least(0)});
  }
  try {
    if (!spread.empty()) truth = draw_truth(table, spread, a.seed);
  } catch (const NameError& error) {
    throw InputError(error.what() + nearest_names(error.name, table.names()));
  }
  const Simulation simulation = kincal::simulate(rig_file.rig, table, truth, options);
  for (const Simulation::Dropped& d : simulation.dropped)
    std::fprintf(stderr, "kincal: warning: sample '%s': sensor '%s' does not see target '%s': %s\n", d.sample.c_str(),
                 rig_file.rig.sensors[d.sensor].name.c_str(), rig_file.rig.targets[d.target].name.c_str(), d.why.c_str());
  for (int s : simulation.idle)
    std::fprintf(stderr, "kincal: warning: sensor '%s' %s nothing\n", rig_file.rig.sensors[s].name.c_str(),
                 rig_file.rig.sensors[s].type == "chain" ? "holds" : "sees");
  if (simulation.samples.size() < static_cast<size_t>(a.samples))
    std::fprintf(stderr,
                 "kincal: warning: %zu of %d samples are left out: in these postures no sensor sees a whole target from its printed side\n",
                 a.samples - simulation.samples.size(), a.samples);
  if (simulation.samples.empty()) throw InputError("simulate: no sample is left: no posture has a view that is possible");
  if (!write_directory(
          a.out,
          {{"samples.jsonl", samples_text(rig_file.rig, simulation.samples)}, {"truth.json", truth_text(rig_file.rig, table, simulation)}},
          a.force, not_interrupted))
    return say_interrupted();
  std::map<int, int> views;
  for (const Sample& sample : simulation.samples)
    for (const View& view : sample.views) ++views[view.sensor];
  std::printf("%zu samples", simulation.samples.size());
  for (const auto& v : views) std::printf(", %s %d views", rig_file.rig.sensors[v.first].name.c_str(), v.second);
  std::printf("\nWritten to %s: samples.jsonl, truth.json\n", a.out.c_str());
  return kConverged;
}

/// The options of calibrate that batch has as well.
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

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGINT, [](int) { interrupted = 1; });
  std::signal(SIGTERM, [](int) { interrupted = 1; });

  CLI::App app{
      "kincal calibrates robots: joint offsets, gear scales, mounts, intrinsics, baselines and target poses that best explain\n"
      "all measurements at once (bundle adjustment over kinematic chains)."};
  app.set_version_flag("--version", "kincal " KINCAL_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Examples:\n"
      "  kincal calibrate rig.yaml samples.jsonl --dry-run          what each step frees and counts\n"
      "  kincal calibrate rig.yaml samples.jsonl --out result       calibrate; result/robot.urdf is the calibrated robot\n"
      "  kincal batch fleet --out results                           the same for every folder of fleet\n"
      "  kincal evaluate result/rig.yaml samples.jsonl              residuals at the calibrated values\n"
      "  kincal simulate rig.yaml --samples 30 --seed 1 --out sim --spread 'joint/*/offset=0.01'\n"
      "  kincal apply result other_copy.urdf --out calibrated.urdf\n"
      "Exit codes: 0 converged; 1 bad input or usage, nothing written; 2 a freed direction is not determined by the data (named in the\n"
      "warnings); 3 a step did not converge; 130 interrupted, nothing written. With 2 and 3 results are written and marked. batch: 0 all\n"
      "sets converged; 1 some did not; 130 interrupted, what is finished stays.");

  CalibrateArguments c;
  CLI::App* calibrate_command =
      app.add_subcommand("calibrate", "Estimate the parameters that the rig's steps free and write a result directory");
  calibrate_command->add_option("RIG", c.rig, "rig.yaml: robot, sensors, targets, steps")->required();
  calibrate_command->add_option("SAMPLES", c.samples, "samples.jsonl: one posture of the robot a line")->required();
  calibrate_command->add_option("--out", c.out,
                                "new directory for robot.urdf, rig.yaml, result.json, changes.yaml, covariance.csv, residuals.csv");
  add_settings(*calibrate_command, c.settings);
  calibrate_command->add_flag("--force", c.force, "replace an existing result");
  calibrate_command->add_flag("--dry-run", c.dry_run, "only print what each step frees, the counts and the degrees of freedom");
  calibrate_command->add_flag("--quiet", c.quiet, "print errors only");
  calibrate_command->add_flag("--json", c.json, "print result.json on standard output instead of tables");
  calibrate_command->footer(
      "Parameters: joint/NAME/offset, /scale, /origin[.x .y .z .rx .ry .rz]; sensor/NAME/pose, /intrinsics[.fx ...], /distortion, "
      "/baseline;\n"
      "target/NAME/pose, /square, /points. `*` in globs crosses `/`. The tables show rms before and after; `as read` takes the joint "
      "readings\n"
      "as exact: what the robot's own software will see.\n"
      "Exit codes: 0 converged; 1 bad input, nothing written; 2 a freed direction is not determined; 3 a step did not converge (2 and 3:\n"
      "results are written, `status` in result.json says so); 130 interrupted, nothing written.");

  BatchArguments b;
  b.jobs = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  CLI::App* batch_command = app.add_subcommand("batch", "Calibrate many sample sets, each into a result directory of its own");
  batch_command
      ->add_option(
          "SETS", b.sets,
          "a folder whose folders have a rig.yaml and a samples.jsonl each, or a list file with lines RIG SAMPLES [NAME], relative to\n"
          "the list's folder")
      ->required();
  batch_command->add_option("--out", b.out, "directory for the result directories, summary.csv and summary.json; the same one to go on")
      ->required();
  batch_command->add_option("--jobs", b.jobs, "how many calibrations run at once (default: as many as there are cores)")
      ->check(CLI::Range(1, 1024));
  add_settings(*batch_command, b.settings);
  batch_command->add_flag("--quiet", b.quiet, "print errors only");
  batch_command->add_flag("--json", b.json, "print summary.json on standard output instead of tables");
  batch_command->footer(
      "A set whose result is there, of the same inputs, options and version, is not calibrated again; so the same command goes on after "
      "an\n"
      "interruption. A set that fails stops no other; failing sets are named at the end.\n"
      "Exit codes: 0 all sets converged; 1 some did not (failed, not_converged, unobservable: see `status` in summary.csv), or bad usage;\n"
      "130 interrupted, what is finished stays.");

  EvaluateArguments e;
  CLI::App* evaluate_command =
      app.add_subcommand("evaluate", "Print the residuals at the rig's values, with free targets and joint errors re-estimated");
  evaluate_command->add_option("RIG", e.rig, "rig.yaml")->required();
  evaluate_command->add_option("SAMPLES", e.samples, "samples.jsonl")->required();
  evaluate_command->add_option(
      "--urdf", e.urdf,
      "a robot in place of the rig's; joint offsets of the rig are taken as folded into it, scales stay. For a calibrated robot.urdf\n"
      "use the rig.yaml beside it: what a URDF cannot express is there");
  evaluate_command->add_option("--free", e.free, "name or glob to re-estimate in each split; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  evaluate_command->add_option("--noise", e.noise, "as in calibrate")->check(CLI::IsMember(keys(kNoiseModes)))->capture_default_str();
  evaluate_command->add_flag("--json", e.json, "print {chi2, dof, sensors} as JSON");

  ApplyArguments p;
  CLI::App* apply_command = app.add_subcommand("apply", "Put the changes of a result into another copy of the robot's URDF");
  apply_command->add_option("RESULT", p.result, "result directory or its result.json")->required();
  apply_command->add_option("URDF", p.urdf, "the copy; only numbers of its joint origins are replaced")->required();
  apply_command->add_option("--out", p.out, "file to write")->required();
  apply_command->add_flag("--force", p.force, "replace an existing file; apply a result that is not converged or not determined");

  SimulateArguments s;
  CLI::App* simulate_command =
      app.add_subcommand("simulate", "Make samples with known truth and noise from a rig: the way to try out a set-up");
  simulate_command->add_option("RIG", s.rig, "rig.yaml: the nominal robot, sensors, targets and their sigmas")->required();
  simulate_command->add_option("--samples", s.samples, "how many samples")->required()->check(CLI::Range(1, 1000000));
  simulate_command->add_option("--seed", s.seed, "the same seed makes the same samples")->required()->check(CLI::Range(0LL, 1LL << 62));
  simulate_command->add_option("--out", s.out, "new directory for samples.jsonl and truth.json")->required();
  CLI::Option* truth_option =
      simulate_command->add_option("--truth", s.truth, "JSON: {\"parameters\": {NAME: true value, ...}}; poses as increments");
  simulate_command->add_option("--spread", s.spread, "GLOB=SIGMA: draw true values around the rig's, e.g. 'joint/*/offset=0.01'")
      ->allow_extra_args(false)
      ->type_name("GLOB")
      ->excludes(truth_option);
  simulate_command->add_option("--postures", s.postures,
                               "JSON lines with postures, views and poses of targets; default: uniform within the joint limits");
  simulate_command->add_flag("--force", s.force, "replace an existing simulation");

  for (CLI::App* sub : app.get_subcommands({})) sub->set_version_flag("--version", "kincal " KINCAL_VERSION);

  std::string command;
  for (int i = 0; i < argc; ++i) command += (i ? " " : "") + std::string(argv[i]);
  try {
    app.parse(argc, argv);
    c.settings.command = b.settings.command = command;
    const int code = *calibrate_command  ? calibrate(c)
                     : *batch_command    ? batch(b)
                     : *evaluate_command ? evaluate(e)
                     : *apply_command    ? apply(p)
                                         : simulate(s);
    if (!std::cout.flush() || std::fflush(stdout) != 0 || std::ferror(stdout)) throw InputError("standard output cannot be written");
    return code;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    if (app.get_subcommands().empty() && (argc == 1 || argv[1][0] != '-')) {
      const std::string what = argc == 1 ? "a command is required"
                                         : "there is no command '" + std::string(argv[1]) + "'" +
                                               nearest_names(argv[1], {"calibrate", "batch", "evaluate", "simulate", "apply"});
      std::fprintf(stderr, "kincal: error: %s; known: calibrate, batch, evaluate, simulate, apply. `kincal --help` says more\n",
                   what.c_str());
      return kBadInput;
    }
    std::fprintf(stderr, "kincal: error: %s\nRun `kincal%s --help` for more.\n", error.what(),
                 app.get_subcommands().empty() ? "" : (" " + app.get_subcommands()[0]->get_name()).c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "kincal: error: %s\n", error.what());
  }
  return kBadInput;
}
