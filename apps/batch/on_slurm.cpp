#include "on_slurm.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <random>
#include <sstream>

#include "../../io/document/files.h"
#include "child.h"
#include "shares.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

constexpr size_t kSetsOfTask = 200, kMostTasks = 1000;
constexpr double kUntilSeen = 90;  // seconds; what other nodes wrote, a network may show that late
const char kTask[] = "KINCAL_SLURM_TASK";

fs::path job_folder(const fs::path& out) { return out / ".batch" / "slurm"; }

/// A word for the shell.
std::string shell_quoted(const std::string& word) {
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? "'\\''" : std::string(1, c);
  return out + "'";
}

/// The last line of a text file; "" without one.
std::string last_line(const fs::path& path) {
  std::string last;
  if (!file_exists(path.string())) return last;
  std::istringstream lines(read_file(path.string()));
  for (std::string line; std::getline(lines, line);)
    if (!line.empty()) last = line;
  return last;
}

std::string whole_path(const fs::path& path) {
  return fs::absolute(path).lexically_normal().string();
}

/// The program and its arguments, as the tasks run them.
std::string task_script(const std::string& token, const std::vector<std::string>& arguments) {
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  std::string text = "#!/bin/sh\n# A task of `kincal batch --slurm`.\nexport " +
                     std::string(kTask) + "=" + token + "\nexec " +
                     shell_quoted(program.empty() ? arguments[0] : program.string());
  for (size_t i = 1; i < arguments.size(); ++i) text += " " + shell_quoted(arguments[i]);
  return text + "\n";
}

/// Submits a job for all sets that are not known.
SlurmJob start_job(const Work& work, const BatchArguments& a, const std::string& options) {
  std::vector<Set> sets;
  for (const size_t i : work.todo)
    if (!work.known(i)) sets.push_back(work.sets[i]);
  SlurmJob job;
  std::random_device random;
  job.token = std::to_string(random()) + std::to_string(random());
  job.options = options;
  job.command = a.settings.command;
  job.tasks = a.slurm.tasks > 0
                  ? std::min(static_cast<size_t>(a.slurm.tasks), sets.size())
                  : std::min((sets.size() + kSetsOfTask - 1) / kSetsOfTask, kMostTasks);
  const JobFolder folder{job_folder(a.out), job.token};
  work.output.tidy();
  write_job(folder, job, sets);
  try {
    const std::string path = whole_path(folder.file(""));
    Array array;
    array.tasks = job.tasks;
    array.cpus = static_cast<size_t>(a.jobs) * static_cast<size_t>(std::max(a.settings.threads, 1));
    array.options = words_for_sbatch(a.slurm);
    if (seen_by_a_node(path + "0.sets", array.options) == "missing")
      throw InputError("--slurm: a node does not see " + whole_path(a.out) +
                       ": the folder must be shared between this machine and all nodes, by the "
                       "same path");
    array.script = path + "task";
    for (const char c : path) array.output += c == '%' ? "%%" : std::string(1, c);
    array.output += "%a.out";
    write_file(array.script, task_script(job.token, a.slurm.arguments), true);
    job.id = submit(array);
    write_id(folder, job.id);
  } catch (const InputError&) {
    if (job.id.empty()) remove_job(folder.path);
    throw;
  }
  return job;
}

/// A JobWatch knows how far a job is.
class JobWatch {
 public:
  /// `own`: this process submitted the job, so that no input was changed since without its knowing.
  JobWatch(const SlurmJob& job, bool own, Work& work, BatchProgress& progress)
      : job_(job),
        own_(own),
        folder_{job_folder(work.output.folder), job.token},
        work_(work),
        progress_(progress) {
    for (size_t i = 0; i < work.sets.size(); ++i) places_[work.sets[i].name] = i;
    for (size_t task = 0; task < job.tasks; ++task)
      readers_.emplace_back(folder_, task, work.output.folder);
  }

  /// Waits until all sets are done, or the job is over, or (with `once`) until Slurm has said how
  /// it is. Returns false: the user wants to stop.
  bool wait(const Signals& signals, bool once) {
    const Clock::time_point begin = Clock::now();
    Clock::time_point over;
    for (double next_look = 0;;) {
      const bool was_over = state_.over, whole = read();
      if (work_.done()) return true;
      if (was_over && (whole || seconds_since(over) > kUntilSeen)) return true;
      const double now = seconds_since(begin);
      if (!state_.over && now >= next_look) {
        state_ = look_at_job(job_.id);
        over = Clock::now();
        if (once && !state_.over) return true;
        next_look = now + std::clamp(now / 4, 2.0, 30.0);
      }
      progress_.update(work_.finished, work_.failing, tasks());
      if (signals.wait(state_.over ? 200 : 500 + 10 * static_cast<long>(job_.tasks))) return false;
    }
  }

  /// "12 tasks run, 30 wait (Resources)"
  std::string tasks() const {
    if (state_.over || state_.running + state_.waiting == 0) return state_.words;
    return plural(state_.running, "task") + " run" + (state_.running == 1 ? "s" : "") + ", " +
           std::to_string(state_.waiting) + " wait" +
           (state_.waiting > 0 && !state_.words.empty() ? " (" + state_.words + ")" : "");
  }

  bool over() const { return state_.over; }

  /// Which tasks did not do their share, and why, as far as can be told.
  std::string losses() const {
    std::map<size_t, TaskEnd> ends;
    for (const TaskEnd& end : ends_of_tasks(job_.id)) ends[end.task] = end;
    std::map<std::string, std::vector<std::string>> tasks;  // by what became of them
    for (size_t task = 0; task < readers_.size(); ++task) {
      if (readers_[task].complete()) continue;
      const TaskEnd& end = ends[task];
      const std::string printed = last_line(folder_.file(task, ".out"));
      std::string why = end.state.empty() || end.state == "COMPLETED" ? "ended" : end.state;
      if (end.state == "FAILED" && !readers_[task].started() &&
          !file_exists(folder_.file(task, ".out").string()))
        why += " (on " + end.node + ", where " + whole_path(folder_.path) +
               " cannot be written: the folder must be shared between this machine and all nodes, "
               "by the same path)";
      if (!printed.empty()) why += " (" + printed + ")";
      tasks[why].push_back(std::to_string(task));
    }
    std::string text;
    for (const auto& [why, numbers] : tasks)
      text += (text.empty() ? "task " : "; task ") + some(numbers, 5) + ": " + why;
    return text;
  }

 private:
  bool read() {
    bool whole = true, started = false;
    for (JournalReader& reader : readers_) {
      if (reader.complete()) continue;
      whole = reader.read([&](const Set& set, SetSummary summary) {
        take(set, std::move(summary));
      }) && whole;
      started = started || reader.started();
    }
    if (started && !started_) progress_.restart(work_.finished);
    started_ = started_ || started;
    return whole;
  }

  void take(const Set& set, SetSummary summary) {
    const auto place = places_.find(set.name);
    if (place == places_.end() || work_.known(place->second)) return;
    const Set& wanted = work_.sets[place->second];
    std::string why;
    if (wanted.rig == set.rig && wanted.samples == set.samples &&
        (own_ || summary.status == "failed" || find_done(set, work_.output, job_.options, why)))
      work_.finish(place->second, std::move(summary), progress_);
  }

  const SlurmJob& job_;
  const bool own_;
  const JobFolder folder_;
  Work& work_;
  BatchProgress& progress_;
  std::map<std::string, size_t> places_;
  std::vector<JournalReader> readers_;
  JobState state_;
  bool started_ = false;
};

int end_by_user(const SlurmJob& job, const Work& work) {
  const std::string wrong = cancel(job.id);
  std::fprintf(stderr, "kincal: interrupted; %zu of %s done, the same command goes on\n",
               work.sets_done(), plural(work.sets.size(), "set").c_str());
  if (!wrong.empty())
    std::fprintf(stderr, "kincal: error: Slurm job %s could not be cancelled and runs on: %s\n",
                 job.id.c_str(), wrong.c_str());
  return kInterrupted;
}

}  // namespace

bool goes_on_slurm(const Output& output, const BatchArguments& a, const std::string& options) {
  const fs::path folder = job_folder(a.out);
  const std::optional<SlurmJob> job = read_slurm_job(folder);
  if (!job) return false;
  if (!job->id.empty()) {
    if (a.slurm.use && job->options == options) return true;
    const JobState state = look_at_job(job->id);
    if (!state.over)
      throw InputError(
          a.out + ": Slurm job " + job->id +
          (state.running + state.waiting > 0 ? " is writing here"
                                             : " may be writing here (" + state.words + ")") +
          (a.slurm.use ? ", with other options (" + job->options + ")" : "") + ": `scancel " +
          job->id + "` ends it" + (a.slurm.use ? "" : ", --slurm waits for it"));
  }
  remove_job(folder);
  output.tidy();
  return false;
}

std::optional<int> calibrate_on_slurm(Work& work, const BatchArguments& a,
                                      const std::string& options, BatchProgress& progress) {
  const fs::path folder = job_folder(a.out);
  const bool silent = a.quiet || a.json;
  std::optional<SlurmJob> job = read_slurm_job(folder);
  const Signals signals;
  for (bool submitted = false; !work.done();) {
    if (!job) {
      job = start_job(work, a, options);
      submitted = true;
      if (!silent)
        progress.say(
            "Slurm job " + job->id + ": " + plural(work.todo.size() - work.finished, "set") +
            " in " + plural(job->tasks, "task") +
            (a.slurm.detach ? "; the same command shows how far it is" : "; Ctrl-C cancels it"));
      if (a.slurm.detach) return kConverged;
    }
    JobWatch watch(*job, submitted, work, progress);
    if (!watch.wait(signals, a.slurm.detach)) {
      progress.end();
      return end_by_user(*job, work);
    }
    if (work.done()) break;
    progress.end();
    const std::string so_far =
        std::to_string(work.sets_done()) + " of " + plural(work.sets.size(), "set") + " done";
    if (!watch.over()) {
      if (!silent) progress.say("Slurm job " + job->id + ": " + so_far + "; " + watch.tasks());
      return kConverged;
    }
    const std::string losses = watch.losses(), end = "Slurm job " + job->id + " ended with " +
                                                     so_far + (losses.empty() ? "" : ": " + losses);
    if (submitted) {
      std::fprintf(stderr, "kincal: error: %s; the same command goes on\n", end.c_str());
      return kBadInput;
    }
    if (!silent) progress.say(end);
    job.reset();
  }
  progress.update(work.finished, work.failing);
  remove_job(folder);
  return std::nullopt;
}

const char* task_token() { return std::getenv(kTask); }

int run_task(const BatchArguments& a, const std::string& token) {
  const JobFolder folder{job_folder(a.out), token};
  const std::optional<SlurmJob> job = read_slurm_job(folder.path);
  if (!job)
    throw InputError(whole_path(folder.path) +
                     ": there is no job: the folder must be shared between all nodes and the "
                     "machine that submits, by the same path");
  const char* number = std::getenv("SLURM_ARRAY_TASK_ID");
  const size_t task = number ? std::strtoul(number, nullptr, 10) : 0;
  if (job->token != token || !number || task >= job->tasks)
    throw InputError(whole_path(folder.path) + ": this task belongs to an abandoned job");
  const Output output = open_scratch(a.out, folder.file(task, ".work"));
  note_start(folder, task);

  // A task that Slurm starts again goes on where it was.
  const std::vector<Set> share = read_share(folder, task);
  const std::vector<bool> known = sets_noted(folder, task, share.size());
  std::vector<Set> todo;
  std::vector<size_t> places;
  for (size_t i = 0; i < share.size(); ++i) {
    std::string why;
    if (known[i]) continue;
    if (const auto done = find_done(share[i], output, job->options, why)) {
      note_end(folder, task, i, *done, output.result(share[i].name));
      continue;
    }
    todo.push_back(share[i]);
    places.push_back(i);
  }
  BatchArguments own = a;
  own.settings.command = job->command;
  const bool all = calibrate_each(
      todo, output, own, Signals(),
      [&](size_t i, const SetSummary& summary) {
        note_end(folder, task, places[i], summary, output.result(todo[i].name));
      },
      [] {});
  std::error_code ignored;
  fs::remove_all(output.scratch, ignored);
  return all ? kConverged : kInterrupted;
}

}  // namespace kincal
