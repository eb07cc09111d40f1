// kincal-bal: one file of Bundle Adjustment in the Large, solved by kincal's solver.
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>

#include "bal.h"

int main(int argc, char** argv) {
  using namespace kincal;
  using namespace kincal::benchmarks;
  CLI::App app(
      "Solves one problem of Bundle Adjustment in the Large (grail.cs.washington.edu/projects/bal) "
      "with kincal's solver: prints the cost\n"
      "1/2 sum |r|^2 at the start and after each iteration, the time and the memory.\n\n"
      "  kincal-bal problem-16-22106-pre.txt.xz               until a step lowers the cost by at "
      "most 1e-6 of it\n"
      "  kincal-bal problem-16-22106-pre.txt.xz --decrease 0  until nothing moves any more\n"
      "  kincal-bal synthetic                                 500 cameras in a ring, 100000 "
      "points\n");
  std::string file;
  KincalBalOptions options;
  const std::map<std::string, LinearSolver> solvers = {{"automatic", LinearSolver::automatic},
                                                       {"dense", LinearSolver::dense},
                                                       {"sparse", LinearSolver::sparse},
                                                       {"cholmod", LinearSolver::cholmod}};
  app.add_option("FILE", file, "Text file as published, plain or .xz; or 'synthetic'")->required();
  app.add_option("--threads", options.threads, "Threads; the result is the same to the last bit")
      ->capture_default_str()
      ->check(CLI::Range(1, 1024));
  std::string solver = "automatic";
  app.add_option(
         "--linear-solver", solver,
         "Of the cameras' reduced system. automatic: dense if small or full, else sparse (cholmod)")
      ->capture_default_str()
      ->check(CLI::IsMember({"automatic", "dense", "cholmod"}));
  app.add_option("--decrease", options.relative_decrease,
                 "Stop when a step lowers the cost by at most this share of it")
      ->capture_default_str();
  app.add_option("--iterations", options.max_iterations, "At most so many")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  options.linear_solver = solvers.at(solver);
  try {
    const double before = cpu_seconds();
    const BundleAdjustmentData data =
        file == "synthetic" ? synthetic_bal(500, 100000) : read_bal(file);
    std::printf("%s, read in %.2f s\n", describe(data).c_str(), cpu_seconds() - before);
    const KincalBalRun run = solve_with_kincal(data, options);
    std::printf("  iteration             cost\n");
    for (size_t i = 0; i < run.costs.size(); ++i) std::printf("  %9zu  %15.9g\n", i, run.costs[i]);
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    std::printf("%s after %d iterations, linear solver %s\n",
                run.converged ? "converged" : "NOT converged", run.iterations,
                run.linear_solver.c_str());
    std::printf(
        "solved in %.3f s (CPU %.3f s, %.2f ms an iteration), after %.3f s to build the problem; "
        "peak memory %.0f MB\n",
        run.wall, run.seconds, 1e3 * run.seconds / std::max(1, run.iterations), run.setup,
        static_cast<double>(usage.ru_maxrss) / 1024);
    return run.converged ? 0 : 3;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "kincal-bal: %s\n", error.what());
    return 1;
  }
}
