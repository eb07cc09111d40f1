// What a batch asks of Slurm, by Slurm's own commands: sbatch, squeue, scontrol, scancel, srun.
// Each gets a time limit, since a controller may not answer for a while.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace kincal {

/// SlurmOptions are those of `kincal batch` for Slurm, as given.
struct SlurmOptions {
  bool use = false, detach = false;
  int tasks = 0;                       // 0: one for 200 sets
  std::string partition, sbatch;       // sbatch: more of its options, as a shell would take them
  std::vector<std::string> arguments;  // the command itself, for the tasks
};

/// Refuses where the commands of Slurm are not in PATH, and options that cannot be read.
/// @throws InputError
void check_slurm(const SlurmOptions& options);

/// Returns the options of sbatch that the user gave: words between blanks; in single or double
/// quotes as they are. @throws InputError where a quote is never closed
std::vector<std::string> words_for_sbatch(const SlurmOptions& options);

/// An Array is a job of `tasks` tasks with `cpus` processors each, which all run `script`.
struct Array {
  size_t tasks = 0, cpus = 1;
  std::string script, output;        // output: of what a task prints, in sbatch's patterns
  std::vector<std::string> options;  // more of sbatch's
};

/// Submits an array and returns the job's id. @throws InputError with sbatch's own words
std::string submit(const Array& array);

/// Returns whether a node sees the file: "there", "missing", or "" where no node had time for the
/// question within seconds.
std::string seen_by_a_node(const std::string& path, const std::vector<std::string>& options);

/// A JobState is what squeue says of a job. Where it does not answer, `over` is false and `words`
/// has what is wrong.
struct JobState {
  bool over = false;
  size_t running = 0, waiting = 0;
  std::string words;  // or why tasks wait: "Resources"
};
JobState look_at_job(const std::string& id);

/// A TaskEnd is how a task of a job ended: state ("COMPLETED", "NODE_FAIL", ...) and node.
struct TaskEnd {
  size_t task = 0;
  std::string state, node;
};
/// Returns what Slurm still knows: it forgets within minutes.
std::vector<TaskEnd> ends_of_tasks(const std::string& id);

/// Cancels a job. Returns "" or what is wrong.
std::string cancel(const std::string& id);

}  // namespace kincal
