// `kincal batch`: the options; the work is done in batch/.
#include "../batch/batch.h"

#include <algorithm>
#include <memory>
#include <thread>

#include "../job.h"
#include "command.h"

namespace kincal {

Command batch_command(CLI::App& app, const std::string& command_line,
                      const std::vector<std::string>& arguments) {
  auto a = std::make_shared<BatchArguments>();
  a->settings.command = command_line;
  a->slurm.arguments = arguments;
  CLI::App* command = app.add_subcommand(
      "batch", "Calibrate many sample sets, each into a result directory of its own");
  command
      ->add_option("SETS", a->sets,
                   "a folder whose folders have a rig.yaml and a samples.jsonl each, or a list "
                   "file with lines RIG SAMPLES [NAME], relative to\n"
                   "the list's folder")
      ->required();
  command
      ->add_option("--out", a->out,
                   "directory for the result directories, report.html, summary.csv and "
                   "summary.json; the same "
                   "one to go on")
      ->required();
  command
      ->add_option(
          "--jobs", a->jobs,
          "how many calibrations run at once (default: as many as there are cores; with --slurm "
          "1, in each task)")
      ->check(CLI::Range(1, 1024));
  add_settings(*command, a->settings);
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->add_flag("--json", a->json, "print summary.json on standard output instead of tables");
  CLI::Option* slurm = command->add_flag(
      "--slurm", a->slurm.use,
      "on a cluster: submit an array of tasks and wait for it; Ctrl-C cancels it. DIR must be "
      "shared between the nodes");
  command->add_option("--partition", a->slurm.partition, "the partition that Slurm takes")
      ->needs(slurm);
  command
      ->add_option("--tasks", a->slurm.tasks,
                   "how many tasks share the sets (default: one for 200 sets, at most 1000)")
      ->check(CLI::Range(1, 1000000))
      ->needs(slurm);
  command
      ->add_option(
          "--sbatch", a->slurm.sbatch,
          "more options of sbatch, in one word: --sbatch '--time=1:00:00 --mem-per-cpu=1G'")
      ->needs(slurm);
  command
      ->add_flag("--detach", a->slurm.detach,
                 "do not wait: the same command later shows how far it is, or ends with the "
                 "summary")
      ->needs(slurm);
  command->footer(
      "A set whose result is there, of the same inputs, options and version, is not calibrated "
      "again; so the same command goes on after "
      "an\n"
      "interruption. A set that fails stops no other; failing sets are named at the end.\n"
      "Exit codes: 0 all sets converged; 1 some did not (failed, not_converged, unobservable, "
      "unexplained: see "
      "`status` in summary.csv) or do not\n"
      "meet a --require, or bad usage; 130 interrupted, what is finished stays.");
  return {command, [a] {
            if (a->jobs == 0)
              a->jobs = a->slurm.use
                            ? 1
                            : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
            return batch(*a);
          }};
}

}  // namespace kincal
