// The command line: arguments, progress, exit codes. Everything else is in the libraries.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "../io/results.h"
#include "../io/rig_file.h"
#include "../io/simulation_file.h"
#include "../models/calibration.h"
#include "tables.h"

namespace {

using namespace kincal;

enum ExitCode { kConverged = 0, kBadInput = 1, kUnobservable = 2, kNotConverged = 3, kInterrupted = 130 };

volatile std::sig_atomic_t interrupted = 0;

bool not_interrupted() { return interrupted == 0; }

const std::map<std::string, NoiseMode> kNoiseModes = {
    {"latent", NoiseMode::latent}, {"marginal", NoiseMode::marginal}, {"point", NoiseMode::point}, {"none", NoiseMode::none}};
const std::map<std::string, LinearSolver> kLinearSolvers = {
    {"auto", LinearSolver::automatic}, {"dense", LinearSolver::dense}, {"cholmod", LinearSolver::cholmod}};

int say_interrupted() {
  std::fprintf(stderr, "kincal: interrupted, nothing written\n");
  return kInterrupted;
}

/// A folder with a rig.yaml (a result) stands for that file.
std::string rig_path(const std::string& path) {
  return std::filesystem::is_directory(path) ? (std::filesystem::path(path) / "rig.yaml").string() : path;
}

template <class Map>
std::vector<std::string> keys(const Map& map) {
  std::vector<std::string> out;
  for (const auto& entry : map) out.push_back(entry.first);
  return out;
}

/// An unknown parameter name in terms that help: with the nearest ones.
InputError with_nearest(const NameError& error, const Calibration& calibration) {
  return InputError(error.what() + nearest_names(error.name, calibration.table().names()));
}

Calibration make_calibration(const RigFile& rig_file, const std::string& samples_path) {
  const std::vector<Sample> samples = read_samples(samples_path, rig_file.rig);
  try {
    return Calibration(rig_file.rig, samples);
  } catch (const NameError& error) {
    throw InputError(error.what() + nearest_names(error.name, ParameterTable(rig_file.rig).names()));
  } catch (const std::invalid_argument& error) {  // a step that frees or sees nothing: either file may be wrong
    const std::string what = error.what();
    throw InputError(what.rfind(rig_file.path, 0) == 0 ? what : rig_file.path + ": " + what + " (samples: " + samples_path + ")");
  }
}

struct CalibrateArguments {
  std::string rig, samples, out, noise = "latent", step, linear_solver = "auto";
  std::vector<std::string> free, fix;
  int threads = 1;
  bool no_report = false, write_reduction = false, force = false, dry_run = false, quiet = false, json = false;
};

int calibrate(const CalibrateArguments& a, const std::string& command) {
  if (!a.dry_run) {
    if (a.out.empty()) throw InputError("calibrate: --out DIR is required (only --dry-run does without)");
    check_output(a.out, a.force);
  }
  const RigFile rig_file = read_rig(rig_path(a.rig));
  if (rig_file.rig.steps.empty()) throw InputError(a.rig + ": estimate: there are no steps: nothing is to be calibrated");
  Calibration calibration = make_calibration(rig_file, a.samples);
  if (std::none_of(calibration.samples().begin(), calibration.samples().end(), [](const Sample& s) { return s.train; }))
    throw InputError(a.samples + ": every sample has \"split\": \"test\": nothing is left to calibrate with");
  for (const std::string& warning : rig_file.urdf.warnings) std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  CalibrationOptions options;
  options.noise = kNoiseModes.at(a.noise);
  options.linear_solver = kLinearSolvers.at(a.linear_solver);
  options.threads = a.threads;
  options.last_step = a.step;
  options.free = a.free;
  options.fix = a.fix;
  Progress progress(a.quiet || a.json);
  options.progress = [&](const std::string& step, int iteration, double chi2, double damping) {
    progress.update(step, iteration, chi2, damping);
    return not_interrupted();
  };
  try {
    if (a.dry_run) {
      std::cout << plan_table(calibration.plan(options), calibration.table());
      return kConverged;
    }
    const std::optional<CalibrationResult> result = calibration.run(options);
    if (!result || interrupted) {
      progress.interrupted();
      return say_interrupted();
    }
    progress.finish();
    ResultOptions result_options;
    result_options.command = command;
    result_options.samples_path = a.samples;
    result_options.version = KINCAL_VERSION;
    result_options.residuals = !a.no_report;
    result_options.write_reduction = a.write_reduction;
    const ResultFiles files = make_results(rig_file, calibration, *result, result_options);
    if (!write_results(a.out, files, a.force, not_interrupted)) return say_interrupted();
    if (a.json)
      std::cout << files.result_json;
    else if (!a.quiet)
      std::cout << report(*result, files) << "\nWritten to " << a.out << "\n";
    switch (result->status) {
      case Status::converged:
        return kConverged;
      case Status::unobservable:
        return kUnobservable;
      default:
        return kNotConverged;
    }
  } catch (const NameError& error) {
    throw with_nearest(error, calibration);
  }
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
      "  kincal evaluate result/rig.yaml samples.jsonl              residuals at the calibrated values\n"
      "  kincal simulate rig.yaml --samples 30 --seed 1 --out sim --spread 'joint/*/offset=0.01'\n"
      "  kincal apply result other_copy.urdf --out calibrated.urdf\n"
      "Exit codes: 0 converged; 1 bad input or usage, nothing written; 2 a freed direction is not determined by the data (named in the\n"
      "warnings); 3 a step did not converge; 130 interrupted, nothing written. With 2 and 3 results are written and marked.");

  CalibrateArguments c;
  CLI::App* calibrate_command =
      app.add_subcommand("calibrate", "Estimate the parameters that the rig's steps free and write a result directory");
  calibrate_command->add_option("RIG", c.rig, "rig.yaml: robot, sensors, targets, steps")->required();
  calibrate_command->add_option("SAMPLES", c.samples, "samples.jsonl: one posture of the robot a line")->required();
  calibrate_command->add_option("--out", c.out,
                                "new directory for robot.urdf, rig.yaml, result.json, changes.yaml, covariance.csv, residuals.csv");
  calibrate_command
      ->add_option(
          "--noise", c.noise,
          "how noise of joint readings counts: latent (an unknown error per joint and sample; honest sigmas), marginal, point, none")
      ->check(CLI::IsMember(keys(kNoiseModes)))
      ->capture_default_str();
  calibrate_command->add_option("--threads", c.threads, "threads; the result is the same for any number")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  calibrate_command->add_option("--step", c.step, "run all steps up to this one");
  calibrate_command
      ->add_option("--free", c.free, "name or glob to free in the last step that runs, e.g. 'joint/*_wrist_*/offset'; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  calibrate_command->add_option("--fix", c.fix, "name or glob to hold in the last step that runs; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  calibrate_command->add_option("--linear-solver", c.linear_solver, "of the reduced system")
      ->check(CLI::IsMember(keys(kLinearSolvers)))
      ->capture_default_str();
  calibrate_command->add_flag("--no-report", c.no_report, "leave out residuals.csv");
  calibrate_command->add_flag(
      "--write-reduction", c.write_reduction,
      "write calibrated gear scales into robot.urdf's mechanicalReduction and set them to 1 in rig.yaml (for logs recorded from then on)");
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
    const int code = *calibrate_command ? calibrate(c, command) : *evaluate_command ? evaluate(e) : *apply_command ? apply(p) : simulate(s);
    if (!std::cout.flush() || std::fflush(stdout) != 0 || std::ferror(stdout)) throw InputError("standard output cannot be written");
    return code;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    if (app.get_subcommands().empty() && (argc == 1 || argv[1][0] != '-')) {
      const std::string what = argc == 1 ? "a command is required"
                                         : "there is no command '" + std::string(argv[1]) + "'" +
                                               nearest_names(argv[1], {"calibrate", "evaluate", "simulate", "apply"});
      std::fprintf(stderr, "kincal: error: %s; known: calibrate, evaluate, simulate, apply. `kincal --help` says more\n", what.c_str());
      return kBadInput;
    }
    std::fprintf(stderr, "kincal: error: %s\nRun `kincal%s --help` for more.\n", error.what(),
                 app.get_subcommands().empty() ? "" : (" " + app.get_subcommands()[0]->get_name()).c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "kincal: error: %s\n", error.what());
  }
  return kBadInput;
}
