// kincal-compare: whole problems, kincal beside Ceres, run in turns so that both meet the same
// disturbances.
//
// Measured is the CPU time of the process from a built problem to the solution: kincal's
// LevenbergMarquardt (analysis, workspace) and solve; Ceres' Solve. Nothing is reported before
// start and final costs agree.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

#include "../io/rig/rig_file.h"
#include "../io/rig/samples_file.h"
#include "../models/calibration/calibration.h"
#include "../solver/levenberg_marquardt.h"
#include "bal.h"
#include "ceres_bal.h"
#include "ceres_cell.h"
#include "ceres_pr2_like.h"
#include "other_program.h"
#include "pr2_like.h"

namespace kincal::benchmarks {
namespace {

using nlohmann::json;

constexpr int kPairs = 20;            // of one thread and two
constexpr double kLongEnough = 0.2;   // s, of each side of them
constexpr double kSameStart = 1e-12;  // relative, of costs at the start: the same function
const std::vector<std::string> kProblems = {"pr2-like-60",  "pr2-like-500", "cell-20",
                                            "bal-16-22106", "bal-49-7776",  "synthetic-500"};

struct Settings {
  int rounds = 7;
  std::vector<std::string> problems;
  bool threads_only = false;
  std::string data;    // folder with bal/
  OtherProgram other;  // for files of bundle adjustment; none without a command
  bool wanted(const std::string& problem) const {
    return problems.empty() ||
           std::find(problems.begin(), problems.end(), problem) != problems.end();
  }
};

struct Contestant {
  std::string name;
  std::function<Run()> run;
  bool dropped_if_slow = false;  // one of several that compete for "best of"
  std::vector<Run> runs = {};
};

double quantile(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  const double at = q * static_cast<double>(v.size() - 1);
  const size_t below = static_cast<size_t>(at);
  return below + 1 < v.size()
             ? v[below] + (at - static_cast<double>(below)) * (v[below + 1] - v[below])
             : v[below];
}
std::vector<double> times(const std::vector<Run>& runs, double Run::*time) {
  std::vector<double> t;
  for (const Run& r : runs) t.push_back(r.*time);
  return t;
}
double median(const std::vector<Run>& runs, double Run::*time = &Run::seconds) {
  return quantile(times(runs, time), 0.5);
}
/// Interquartile range over median.
double spread(const std::vector<Run>& runs, double Run::*time = &Run::seconds) {
  const std::vector<double> t = times(runs, time);
  return (quantile(t, 0.75) - quantile(t, 0.25)) / quantile(t, 0.5);
}
double relative_difference(double a, double b) {
  return std::abs(a - b) / std::max(std::abs(a), std::abs(b));
}

/// One run of each that does not count, in which costs are compared; then `rounds` in turns.
/// @throws std::runtime_error if they do not minimise the same.
void race(const std::string& problem, std::vector<Contestant>& contestants, int rounds,
          double same_end) {
  std::vector<Run> first;
  double fastest_peer = 1e300;
  for (const Contestant& c : contestants) {
    first.push_back(c.run());
    if (!first.back().converged)
      throw std::runtime_error(problem + ": " + c.name + " did not converge");
    if (first.size() > 1 && !std::isnan(first.back().start_cost))  // (another program's is NaN)
      fastest_peer = std::min(fastest_peer, first.back().seconds);
    for (const auto& [what, difference, allowed] :
         {std::make_tuple("at the start",
                          std::isnan(first.back().start_cost)
                              ? 0
                              : relative_difference(first.back().start_cost, first[0].start_cost),
                          kSameStart),
          std::make_tuple("at the end", relative_difference(first.back().cost, first[0].cost),
                          same_end)})
      if (!(difference <= allowed)) {
        char text[300];
        std::snprintf(text, sizeof text,
                      "%s: costs %s differ by %.2g of them between %s (%.12g -> %.12g) and %s "
                      "(%.12g -> %.12g)",
                      problem.c_str(), what, difference, contestants[0].name.c_str(),
                      first[0].start_cost, first[0].cost, c.name.c_str(), first.back().start_cost,
                      first.back().cost);
        throw std::runtime_error(text);
      }
  }
  for (size_t i = contestants.size(); i-- > 1;)
    if (contestants[i].dropped_if_slow && first[i].seconds > 2 * fastest_peer) {
      std::printf("  %s: %.4g s in its first run, more than twice the best: not repeated\n",
                  contestants[i].name.c_str(), first[i].seconds);
      contestants.erase(contestants.begin() + static_cast<long>(i));
    }
  for (int round = 0; round < rounds; ++round)
    for (Contestant& c : contestants) c.runs.push_back(c.run());
}

void print_contestant(const Contestant& c) {
  const Run& r = c.runs.back();
  std::printf("  %-52s %9.2f ms  +-%4.1f %%  %3d it  %8.2f ms/it  %.9g -> %.9g\n", c.name.c_str(),
              1e3 * median(c.runs), 100 * spread(c.runs), r.iterations,
              1e3 * median(c.runs) / std::max(1, r.iterations), r.start_cost, r.cost);
}

void compare_with(const std::string& problem, const Contestant& kincal, const Contestant& peer,
                  const std::string& name, json& report) {
  const double ratio = median(peer.runs) / median(kincal.runs);
  std::printf("  kincal is %.2f times as fast as %s\n", ratio, name.c_str());
  report["comparisons"].push_back({{"problem", problem},
                                   {"peer", name},
                                   {"kincal_seconds", median(kincal.runs)},
                                   {"kincal_setup_seconds", median(kincal.runs, &Run::setup)},
                                   {"peer_seconds", median(peer.runs)},
                                   {"ratio", ratio},
                                   {"spread", std::max(spread(kincal.runs), spread(peer.runs))},
                                   {"runs", kincal.runs.size()},
                                   {"cost_start", kincal.runs.back().start_cost},
                                   {"cost_kincal", kincal.runs.back().cost},
                                   {"cost_peer", peer.runs.back().cost},
                                   {"iterations_kincal", kincal.runs.back().iterations},
                                   {"iterations_peer", peer.runs.back().iterations}});
}

/// Wall time (s) of `times` runs in a row.
double wall_of(const std::function<Run(int)>& run, int threads, int times) {
  double wall = 0;
  for (int i = 0; i < times; ++i) wall += run(threads).wall;
  return wall;
}
/// The same where two programs are at it, each with one thread and problems of its own.
double wall_of_two_programs(const std::function<Run(int)>& run, int times) {
  double other = 0;
  std::thread thread([&] { other = wall_of(run, 1, times); });
  const double mine = wall_of(run, 1, times);
  thread.join();
  return std::max(mine, other);
}

/// Wall time of one thread and of two, in turns: median and lowest of the pairs' ratios. A side of
/// a pair is as many runs in a row as fill kLongEnough: of a single solve of 8 ms a daemon that
/// takes a processor for its slice of 3 ms would be a third. With `beside`, which asks that runs
/// may be at once, a control in each turn: what two programs gain that share nothing but the
/// machine. What they lack of 2 is the machine's.
void compare_threads(const std::string& problem, const std::string& who,
                     const std::function<Run(int)>& run, int pairs, bool beside, json& report) {
  const Run one = run(1), two = run(2);
  const int times = std::max(1, static_cast<int>(std::ceil(kLongEnough / one.wall)));
  std::vector<double> alone, together, gains, controls;
  for (int pair = 0; pair < pairs; ++pair) {
    alone.push_back(wall_of(run, 1, times));
    together.push_back(wall_of(run, 2, times));
    gains.push_back(alone.back() / together.back());
    if (beside) controls.push_back(2 * alone.back() / wall_of_two_programs(run, times));
  }
  const double a = quantile(alone, 0.5) / times, b = quantile(together, 0.5) / times,
               gain = quantile(gains, 0.5);
  std::printf(
      "  %s: wall time with 1 thread %.2f ms, with 2 threads %.2f ms; %d pairs (of %d runs): %.2f "
      "times as fast, lowest %.2f%s\n",
      who.c_str(), 1e3 * a, 1e3 * b, pairs, times, gain, quantile(gains, 0),
      one.cost == two.cost ? ", the same cost to the last bit" : "");
  report["threads"].push_back({{"problem", problem},
                               {"program", who},
                               {"seconds_1", a},
                               {"seconds_2", b},
                               {"speedup", gain},
                               {"speedup_lowest", quantile(gains, 0)},
                               {"pairs", pairs},
                               {"runs_in_a_row", times},
                               {"spread", (quantile(gains, 0.75) - quantile(gains, 0.25)) / gain},
                               {"same_cost", one.cost == two.cost}});
  if (!beside) return;
  std::printf(
      "    two programs at once, each with 1 thread, in the same turns: %.2f times, lowest %.2f\n",
      quantile(controls, 0.5), quantile(controls, 0));
  report["threads"].back()["two_programs"] = quantile(controls, 0.5);
  report["threads"].back()["two_programs_lowest"] = quantile(controls, 0);
}

// ---------------------------------------------------------------- robots

Run solve_robot(const RobotProblem& p, int threads,
                LinearSolver linear_solver = LinearSolver::automatic) {
  Run run;
  const double before = cpu_seconds();
  Estimation estimation(p, p.training(), p.setup);
  VectorXd state = estimation.pack(p.start);
  const double cpu = cpu_seconds(), wall = wall_seconds();
  SolverOptions options;
  options.threads = threads;
  options.relative_decrease = 1e-6;
  options.linear_solver = linear_solver;
  LevenbergMarquardt lm(estimation, options);
  const SolveSummary summary = lm.solve(state);
  run.seconds = cpu_seconds() - cpu;
  run.wall = wall_seconds() - wall;
  run.setup = cpu - before;
  run.start_cost = summary.history.empty()
                       ? 0
                       : 0.5 * summary.history.front().first;  // no losses: chi2 is twice the cost
  run.cost = 0.5 * summary.cost.doubled;
  run.iterations = summary.iterations;
  run.converged = summary.outcome == Outcome::converged;
  return run;
}

/// kincal's and the strongest peer's seconds, for the growth.
std::pair<double, double> robot(int boards, const Settings& settings, json& report) {
  const RobotProblem p = pr2_like(boards);
  const Counts c = count(Estimation(p, p.training(), p.setup));
  std::printf("\n%s: %ld residuals, %ld shared and %ld private unknowns\n", p.name.c_str(), c.rows,
              c.shared, c.private_unknowns);
  const auto solve = [&](int threads) { return solve_robot(p, threads); };
  if (settings.threads_only) {
    compare_threads(p.name, "kincal", solve, kPairs, true, report);
    return {0, 0};
  }
  CeresPr2Like usual(p, PeerForm::usual), strongest(p, PeerForm::strongest),
      compressed(p, PeerForm::compressed);
  std::vector<Contestant> contestants = {
      {"kincal", [&] { return solve_robot(p, 1); }},
      {"ceres strongest (analytic, block a view, DENSE_SCHUR)", [&] { return strongest.solve(); }},
      {"ceres with kincal's compression of views", [&] { return compressed.solve(); }},
      {"ceres usual (autodiff, block a corner)", [&] { return usual.solve(); }}};
  race(p.name, contestants, settings.rounds, 1e-6);
  for (const Contestant& contestant : contestants) print_contestant(contestant);
  std::printf("  building kincal's Estimation, before that: %.2f ms\n",
              1e3 * median(contestants[0].runs, &Run::setup));
  for (size_t i = contestants.size(); i-- > 1;)
    compare_with(p.name, contestants[0], contestants[i], contestants[i].name, report);
  compare_threads(p.name, "kincal", solve, kPairs, true, report);
  return {median(contestants[0].runs), median(contestants[1].runs)};
}

/// 20 boards between each two of 20 stations: kincal by fronts (its own choice) and dense.
void cell_of_robots(const Settings& settings, json& report) {
  const RobotProblem p = cell(20, 400);
  const Counts c = count(Estimation(p, p.training(), p.setup));
  std::printf("\n%s: %ld residuals, %ld shared and %ld private unknowns\n", p.name.c_str(), c.rows,
              c.shared, c.private_unknowns);
  const auto solve = [&](int threads) { return solve_robot(p, threads); };
  if (settings.threads_only) return compare_threads(p.name, "kincal", solve, kPairs, true, report);
  CeresCell ceres(p);
  std::vector<Contestant> contestants = {
      {"kincal", [&] { return solve_robot(p, 1); }},
      {"kincal, reduced system dense", [&] { return solve_robot(p, 1, LinearSolver::dense); }},
      {"kincal, reduced system by CHOLMOD",
       [&] { return solve_robot(p, 1, LinearSolver::cholmod); }},
      {"ceres analytic, SPARSE_SCHUR", [&] { return ceres.solve(true); }},
      {"ceres analytic, DENSE_SCHUR", [&] { return ceres.solve(false); }, true},
  };
  race(p.name, contestants, settings.rounds, 1e-6);
  for (const Contestant& contestant : contestants) print_contestant(contestant);
  for (size_t i = 1; i < contestants.size(); ++i)
    compare_with(p.name, contestants[0], contestants[i], contestants[i].name, report);
  compare_threads(p.name, "kincal", solve, kPairs, true, report);
}

// ---------------------------------------------------------------- joint noise

/// What errors of joint readings as unknowns cost: seconds of an iteration of the last step of a
/// calibration from files, `latent` against `none`, all steps before it run as well. Medians over
/// all iterations but the first (which has set-up in it) of runs in turns.
void compare_noise(const std::string& folder, const Settings& settings, json& report) {
  const RigFile rig = read_rig(folder + "/rig.yaml");
  const std::shared_ptr<const Recording> recording =
      make_recording(rig.rig, read_samples(folder + "/samples.jsonl", rig.rig));
  const std::string last = rig.rig.steps.back().name;
  std::vector<double> seconds[2];
  for (int round = 0; round < settings.rounds; ++round)
    for (const NoiseMode mode : {NoiseMode::latent, NoiseMode::none}) {
      CalibrationOptions options;
      options.noise = mode;
      double before = 0;
      options.progress = Progress([&](const Progress::News& news) {
        const double now = cpu_seconds();
        if (news.what == last && news.iteration > 1)
          seconds[mode == NoiseMode::none].push_back(now - before);
        before = now;
        return true;
      });
      calibrate(recording, options);
    }
  const double latent = quantile(seconds[0], 0.5), none = quantile(seconds[1], 0.5);
  std::printf(
      "\npr2-simulated-large, step %s: an iteration takes %.2f ms with joint noise latent, %.2f ms "
      "with none: %.2f times\n",
      last.c_str(), 1e3 * latent, 1e3 * none, latent / none);
  report["noise"] = {{"latent_seconds", latent}, {"none_seconds", none}, {"ratio", latent / none}};
}

// ---------------------------------------------------------------- bundle adjustment

/// `file`: where the data are from, empty: generated.
void bundle(const std::string& name, const std::string& file, const BundleAdjustmentData& data,
            const Settings& settings, json& report) {
  std::printf("\n%s: %s\n", name.c_str(), describe(data).c_str());
  const auto solve = [&](int threads) { return Run(solve_with_kincal(data, {threads})); };
  if (settings.threads_only) return compare_threads(name, "kincal", solve, kPairs, true, report);
  CeresBal automatic(data, false), analytic(data, true);
  std::vector<Contestant> contestants = {
      {"kincal", [&] { return Run(solve_with_kincal(data, {})); }},
      {"ceres analytic, SPARSE_SCHUR", [&] { return analytic.solve(true); }, true},
      {"ceres analytic, DENSE_SCHUR", [&] { return analytic.solve(false); }, true},
      {"ceres usual (autodiff, SPARSE_SCHUR)", [&] { return automatic.solve(true); }},
  };
  if (data.cameras.size() > 9 * 200)
    contestants.erase(contestants.begin() + 2);  // thousands of dense columns: minutes a run
  std::unique_ptr<PlainFile> plain;
  const bool with_other = !settings.other.command.empty() && !file.empty();
  if (with_other) {
    plain = std::make_unique<PlainFile>(file);
    contestants.insert(contestants.begin() + 1, {settings.other.command, [&] {
                                                   return run_other(settings.other, plain->path());
                                                 }});
  }
  race(name, contestants, settings.rounds, 1e-5);
  for (const Contestant& contestant : contestants) print_contestant(contestant);
  if (with_other) {
    compare_with(name, contestants[0], contestants[1], contestants[1].name, report);
    contestants.erase(contestants.begin() + 1);
  }
  compare_with(name, contestants[0], contestants.back(), contestants.back().name, report);
  const Contestant* best = &contestants[1];
  for (size_t i = 2; i + 1 < contestants.size(); ++i)
    if (median(contestants[i].runs) < median(best->runs)) best = &contestants[i];
  compare_with(name, contestants[0], *best, "ceres best of DENSE_SCHUR and SPARSE_SCHUR", report);
  report["comparisons"].back()["peer_solver"] = best->name;
  compare_threads(name, "kincal", solve, kPairs, true, report);
  compare_threads(
      name, best->name,
      [&](int threads) {
        return analytic.solve(best->name.find("SPARSE") != std::string::npos, threads);
      },
      2 * std::min(3, settings.rounds), false, report);
}

/// Largest memory of a process of its own that does `work`, in MB.
double peak_memory(const std::function<void()>& work) {
  std::fflush(stdout);
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("fork failed");
  if (child == 0) {
    work();
    _exit(0);
  }
  int status = 0;
  rusage usage{};
  wait4(child, &status, 0, &usage);
  if (status != 0) throw std::runtime_error("a run for its memory failed");
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

/// First of all, while this process is small: a child starts with its parent's memory.
void memory(json& report) {
  const double data = peak_memory([] { synthetic_bal(500, 100000); });
  const double ceres = peak_memory([] {
    const BundleAdjustmentData d = synthetic_bal(500, 100000);
    CeresBal(d, true).solve(true);
  });
  std::printf("\nsynthetic-500, peak memory of a process: the data alone %.0f MB, ceres %.0f MB",
              data, ceres);
  report["memory"] = {{"problem", "synthetic-500"}, {"data_mb", data}, {"ceres_mb", ceres}};
  const double kincal = peak_memory([] { solve_with_kincal(synthetic_bal(500, 100000), {}); });
  std::printf(", kincal %.0f MB: %.2f times less than ceres", kincal, ceres / kincal);
  report["memory"]["kincal_mb"] = kincal;
  report["memory"]["ratio"] = ceres / kincal;
  std::printf("\n");
}

// ---------------------------------------------------------------- the whole

std::string first_line_of(const std::string& command) {
  FILE* pipe = popen(command.c_str(), "r");
  if (!pipe) return "";
  char line[256] = "";
  if (!std::fgets(line, sizeof line, pipe)) line[0] = 0;
  pclose(pipe);
  std::string text = line;
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
  return text;
}

json heading() {
  char date[32];
  double load = 0;  // of the last minute, before anything ran here
  if (getloadavg(&load, 1) != 1) load = -1;
  const std::time_t now = std::time(nullptr);
  std::strftime(date, sizeof date, "%Y-%m-%d", std::gmtime(&now));
  return {{"date", date},
          {"machine",
           first_line_of("sed -n 's/^model name[[:space:]]*: //p' /proc/cpuinfo | head -n 1") +
               ", " + std::to_string(sysconf(_SC_NPROCESSORS_ONLN)) + " cores"},
          {"compiler", KINCAL_COMPILER},
          {"flags", KINCAL_FLAGS},
          {"commit",
           first_line_of("git -C '" KINCAL_SOURCE_DIR "' describe --always --dirty 2>/dev/null")},
          {"load", load},
          {"comparisons", json::array()},
          {"threads", json::array()},
          {"growth", json::object()},
          {"memory", json::object()}};
}

int run(int argc, char** argv) {
  CLI::App app(
      "Compares kincal with Ceres on whole problems: same data, same cost, same start, same "
      "stopping rule (relative decrease 1e-6).\n"
      "Runs take turns; medians of CPU seconds on one thread are compared, the spread (+-) is the "
      "interquartile range over the median.");
  Settings settings;
  std::string file;
  bool quick = false;
  const char* data = std::getenv("KINCAL_DATA");
  settings.data = data ? data : KINCAL_SOURCE_DIR "/../shared/data";
  app.add_option("--json", file, "Write the results to this file as well");
  app.add_flag("--quick", quick, "5 runs of each instead of 7");
  app.add_flag("--threads", settings.threads_only, "Only two threads beside one, no Ceres");
  app.add_option(
         "--problem", settings.problems,
         "Only this one (may be repeated): pr2-like-60, pr2-like-500, cell-20, bal-16-22106,\n"
         "bal-49-7776, synthetic-500. The bal files are looked for in $KINCAL_DATA/bal.")
      ->check(CLI::IsMember(kProblems))
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  CLI::Option* other = app.add_option(
      "--other", settings.other.command,
      "Another solver for BAL files, timed in the same turns: its command, {} stands for the "
      "file.\n"
      "Let it use one thread, double, and end where kincal does: costs must agree to 1e-5");
  CLI::Option* cost =
      app.add_option("--other-cost", settings.other.cost,
                     "Regular expression: the first group of its last match in the output of "
                     "--other is the final cost, 1/2 sum |r|^2")
          ->needs(other);
  other->needs(cost);
  app.add_option("--other-cost-factor", settings.other.factor,
                 "Factor of that number (0.5 if it is sum |r|^2)")
      ->needs(other);
  app.add_option("--other-seconds", settings.other.seconds,
                 "The same for its time (s); without it: the CPU time of its process, reading "
                 "included")
      ->needs(other);
  CLI11_PARSE(app, argc, argv);
  if (quick) settings.rounds = 5;

  json report = heading();
  report["rounds"] = settings.rounds;
  std::printf("%s, load %.1f; %s; %s; %s\n", report["machine"].get<std::string>().c_str(),
              report["load"].get<double>(), KINCAL_COMPILER, KINCAL_FLAGS,
              report["commit"].get<std::string>().c_str());
  if (report["load"] > 0.5)
    std::printf("This machine is busy: times of two threads will not be worth much\n");
  if (settings.wanted("synthetic-500") && !settings.threads_only) memory(report);
  std::pair<double, double> small{0, 0}, large{0, 0};
  if (settings.wanted("pr2-like-60")) small = robot(60, settings, report);
  if (settings.wanted("pr2-like-500")) large = robot(500, settings, report);
  if (small.first > 0 && large.first > 0) {
    const double kincal = large.first / small.first, ceres = large.second / small.second;
    std::printf(
        "\nFrom 60 to 500 boards (8.33 times the data): kincal takes %.2f times as long, ceres "
        "strongest %.2f times\n",
        kincal, ceres);
    report["growth"] = {{"from", "pr2-like-60"},
                        {"to", "pr2-like-500"},
                        {"data", 500.0 / 60},
                        {"kincal", kincal},
                        {"ceres_strongest", ceres}};
  }
  if (settings.wanted("cell-20")) cell_of_robots(settings, report);
  const std::string large_set = settings.data + "/pr2-simulated-large";
  if (settings.problems.empty() && !settings.threads_only &&
      access((large_set + "/rig.yaml").c_str(), R_OK) == 0)
    compare_noise(large_set, settings, report);
  for (const std::string name : {"16-22106", "49-7776"}) {
    if (!settings.wanted("bal-" + name)) continue;
    const std::string path = settings.data + "/bal/problem-" + name + "-pre.txt";
    const std::string found = access(path.c_str(), R_OK) == 0             ? path
                              : access((path + ".xz").c_str(), R_OK) == 0 ? path + ".xz"
                                                                          : "";
    if (found.empty())
      std::printf(
          "\nbal-%s: skipped, there is no %s[.xz] (set KINCAL_DATA to the folder that holds "
          "bal/)\n",
          name.c_str(), path.c_str());
    else
      bundle("bal-" + name, found, read_bal(found), settings, report);
  }
  if (settings.wanted("synthetic-500"))
    bundle("synthetic-500", "", synthetic_bal(500, 100000), settings, report);
  if (!file.empty()) {
    std::ofstream out(file);
    out << report.dump(1) << "\n";
    if (!out) throw std::runtime_error(file + ": cannot be written");
  }
  return 0;
}

}  // namespace
}  // namespace kincal::benchmarks

int main(int argc, char** argv) {
  try {
    return kincal::benchmarks::run(argc, argv);
  } catch (const std::exception& error) {
    std::fflush(stdout);
    std::fprintf(stderr, "\nkincal-compare: %s\n", error.what());
    return 1;
  }
}
