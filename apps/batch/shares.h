// The folder of a Slurm job, OUT/.batch/slurm, by which a batch and the tasks of its job know of
// each other. It is there from before the job is submitted until its end is in the summary.
//
//   job            what is calibrated, and how, with the job's token
//   id             Slurm's number of the job
//   TOKEN/         of this job: what goes on of one that was given up finds its own no more
//     task         the script that Slurm runs
//     K.sets       the sets of task K: its share
//     K.done       what became of them, a line a set, appended by the task
//     K.out        what the task printed
//     K.work       what the task is writing
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "../../io/results/summary_file.h"
#include "sets.h"

namespace kincal {

struct SlurmJob {
  std::string id;  // empty: it was not submitted
  std::string token, options, command;
  size_t tasks = 0;
};

struct JobFolder {
  std::filesystem::path path;
  std::string token;

  std::filesystem::path file(const std::string& name) const { return path / token / name; }
  std::filesystem::path file(size_t task, const char* kind) const {
    return file(std::to_string(task) + kind);
  }
};

/// Returns the job of the folder; nullopt: there is none.
std::optional<SlurmJob> read_slurm_job(const std::filesystem::path& folder);
/// Writes a job that is not submitted yet, in place of any other: set i is of the share i % tasks.
/// @throws InputError
void write_job(const JobFolder& folder, const SlurmJob& job, const std::vector<Set>& sets);
void write_id(const JobFolder& folder, const std::string& id);
void remove_job(const std::filesystem::path& folder);
/// @throws InputError
std::vector<Set> read_share(const JobFolder& folder, size_t task);

/// Appends to a task's K.done that it runs on this node.
void note_start(const JobFolder& folder, size_t task);
/// Appends how a set of the share ended. Of a result that is the SHA-256 of its batch.json, so that
/// nobody takes an older one, which a network may show for a while, for it.
void note_end(const JobFolder& folder, size_t task, size_t set, const SetSummary& summary,
              const std::filesystem::path& result);

/// A JournalReader reads K.done of a task as it grows.
class JournalReader {
 public:
  JournalReader(const JobFolder& folder, size_t task, const std::filesystem::path& out);

  /// Calls `ended` for each set that is new in it. A result that cannot be seen yet holds it up
  /// until a later call. Returns whether it is read to its end.
  bool read(const std::function<void(const Set&, SetSummary)>& ended);
  bool started() const { return started_; }
  bool complete() const { return known_ == sets_.size(); }

 private:
  bool read_line(const std::string& line, const std::function<void(const Set&, SetSummary)>& ended);

  std::filesystem::path path_, out_;
  std::vector<Set> sets_;
  std::vector<bool> seen_;
  size_t at_ = 0, known_ = 0;
  bool started_ = false;
};

/// Returns the numbers of the sets that a share's K.done knows.
std::vector<bool> sets_noted(const JobFolder& folder, size_t task, size_t sets);

}  // namespace kincal
