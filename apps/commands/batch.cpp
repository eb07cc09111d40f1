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
  CLI::App* command =
      app.add_subcommand("batch", "Calibrate many sample sets, each into its own result directory");
  command
      ->add_option("SETS", a->sets,
                   "a folder whose subfolders each have a rig.yaml and a samples.jsonl, or a list "
                   "file with lines RIG SAMPLES [NAME], relative to\n"
                   "the list's folder")
      ->required();
  command
      ->add_option("--out", a->out,
                   "directory for the result directories, report.html, summary.csv and "
                   "summary.json; give the same one to continue")
      ->required();
  command
      ->add_option("--jobs", a->jobs,
                   "number of calibrations run at once (default: the number of cores; with --slurm "
                   "1 in each task)")
      ->check(CLI::Range(1, 1024));
  add_settings(*command, a->settings);
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->add_flag("--json", a->json, "print summary.json on standard output instead of tables");
  CLI::Option* slurm = command->add_flag("--slurm", a->slurm.use,
                                         "on a cluster: submit an array of tasks and wait for it; "
                                         "Ctrl-C cancels it. All nodes must share DIR");
  command->add_option("--partition", a->slurm.partition, "the Slurm partition")->needs(slurm);
  command
      ->add_option("--tasks", a->slurm.tasks,
                   "number of tasks that share the sets (default: one per 200 sets, at most 1000)")
      ->check(CLI::Range(1, 1000000))
      ->needs(slurm);
  command
      ->add_option(
          "--sbatch", a->slurm.sbatch,
          "more options for sbatch, in one argument: --sbatch '--time=1:00:00 --mem-per-cpu=1G'")
      ->needs(slurm);
  command
      ->add_flag(
          "--detach", a->slurm.detach,
          "do not wait: the same command later shows the progress, or the summary at the end")
      ->needs(slurm);
  command->footer(
      "A set is skipped if its result exists and has the same inputs, options and version; so the "
      "same command continues after an\n"
      "interruption. A failing set does not stop the others; failing sets are listed at the end.\n"
      "Exit codes: 0 all sets converged; 1 some did not (failed, not_converged, unobservable, "
      "unexplained: see `status` in summary.csv) or do not\n"
      "meet a --require, or bad usage; 130 interrupted, finished results are kept.");
  return {command, [a] {
            if (a->jobs == 0)
              a->jobs = a->slurm.use
                            ? 1
                            : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
            return batch(*a);
          }};
}

}  // namespace kincal
