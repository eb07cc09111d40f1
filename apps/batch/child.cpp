#include "child.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <map>
#include <optional>

#include "../../io/document/files.h"
#include "batch_progress.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// Calibrates a set into its result directory, or leaves what went wrong in a file for the parent;
/// returns the exit code.
int calibrate_set(const Set& set, const Output& output, const CalibrateSettings& settings) {
  const Clock::time_point start = Clock::now();
  try {
    ProgressLine silent(true);
    Job job = read_job(set.rig, set.samples, settings, silent);
    const Report report = run(job, settings, true, silent);
    if (report.solution.status == Status::undefined_start) {
      const bool found = report.diagnosis && !report.diagnosis->findings.empty();
      throw std::runtime_error(found ? with_id(report.diagnosis->findings[0])
                                     : report.solution.message);
    }
    ResultFiles files = make_files(job, report, settings);
    BatchRecord record;
    record.version = KINCAL_VERSION;
    record.options = options_text(settings);
    record.rig = files.rig_hash;
    record.samples = files.samples_hash;
    record.urdf = files.urdf_hash;
    if (!job.rig_file.flange_only)
      record.robot = top(job.rig_file.node, job.rig_file.path)["robot"].string();
    record.set = summarize(report);
    for (const std::string& warning : job.rig_file.urdf.warnings)
      record.set.warnings.push_back("urdf: " + warning);
    record.set.exit_code = exit_code(report);
    record.set.seconds = seconds_since(start);
    files.batch_json = record_text(record);
    write_results(output.result(set.name).string(), files, true, nullptr, output.scratch.string());
    return record.set.exit_code;
  } catch (const std::exception& error) {
    std::string text = error_text(error);
    std::replace(text.begin(), text.end(), '\n', ' ');
    try {
      write_file(output.error(set.name).string(), text, true);
    } catch (const InputError&) {  // a full disk: the parent has words for it
    }
    return kBadInput;
  }
}

/// Most sets of a child: one after the other in the same memory, which starts a process and lays
/// out its memory once for all of them.
constexpr size_t kShare = 16;

/// A Child calibrates some sets. It writes the exit code of each that is done to the pipe.
struct Child {
  std::vector<size_t> share;
  size_t done = 0;
  int pipe = -1;
  Clock::time_point start;  // of the set at hand
};

/// What a child does: the parent is woken after each set.
[[noreturn]] void calibrate_share(const std::vector<Set>& sets, const std::vector<size_t>& share,
                                  const Output& output, const CalibrateSettings& settings,
                                  pid_t parent, int pipe) {
  for (const size_t i : share) {
    const int code = calibrate_set(sets[i], output, settings);
    if (write(pipe, &code, sizeof code) != sizeof code) break;
    if (getppid() == parent) kill(parent, SIGCHLD);
  }
  _exit(0);  // at once, since its memory need not be given back piece by piece
}

/// Starts a child; returns its process id, -1 if there cannot be one more.
pid_t start_child(const std::vector<Set>& sets, Child& child, const Output& output,
                  const CalibrateSettings& settings, const sigset_t& signals_before) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return -1;
  const pid_t parent = getpid(), pid = fork();
  if (pid == 0) {
#ifdef __linux__
    prctl(PR_SET_PDEATHSIG, SIGKILL);  // what a child of a dead parent finds would not be read
#endif
    if (getppid() != parent) _exit(kInterrupted);
    close(ends[0]);
    for (const int s : {SIGINT, SIGTERM})
      std::signal(s, SIG_IGN);  // they reach all; the parent decides
    sigprocmask(SIG_SETMASK, &signals_before, nullptr);
    calibrate_share(sets, child.share, output, settings, parent, ends[1]);
  }
  close(ends[1]);
  if (pid < 0) {
    close(ends[0]);
    return -1;
  }
  fcntl(ends[0], F_SETFL, O_NONBLOCK);
  child.pipe = ends[0];
  child.start = Clock::now();
  return pid;
}

/// Returns the summary of a set that a child has done with this exit code.
SetSummary summary_of(const Set& set, const Output& output, int code) {
  std::error_code ignored;
  if (code == kConverged || code == kUnobservable || code == kNotConverged ||
      code == kToleranceNotMet || code == kNotExplained) {
    std::optional<BatchRecord> record =
        read_record((output.result(set.name) / "batch.json").string());
    if (record) {
      record->set.name = set.name;
      return record->set;
    }
  } else if (fs::exists(output.error(set.name), ignored)) {
    return failed(set, code, read_file(output.error(set.name).string()));
  }
  return failed(set, kBadInput, output.result(set.name).string() + ": cannot be written");
}

/// Returns the summary of the set at which a child ended with `status` (of waitpid): it may have
/// been done, but not told yet.
SetSummary ended_at(const Set& set, const Output& output, const std::string& options, int status) {
  std::string why;
  if (std::optional<SetSummary> done = find_done(set, output, options, why)) return *done;
  if (WIFSIGNALED(status))
    return failed(set, 128 + WTERMSIG(status),
                  "ended by signal " + std::to_string(WTERMSIG(status)) + " (" +
                      strsignal(WTERMSIG(status)) + ")");
  return summary_of(set, output, WEXITSTATUS(status));
}

}  // namespace

std::string options_text(const CalibrateSettings& s) {
  std::string out = "--noise " + s.noise + " --linear-solver " + s.linear_solver;
  for (const std::string& g : s.groups) out += " --group " + g;
  for (const std::string& g : s.no_groups) out += " --no-group " + g;
  if (s.iterations > 0) out += " --iterations " + std::to_string(s.iterations);
  if (!s.step.empty()) out += " --step " + s.step;
  for (const std::string& f : s.free) out += " --free " + f;
  for (const std::string& f : s.fix) out += " --fix " + f;
  if (s.holdout) out += " --holdout " + std::to_string(s.holdout);
  if (s.cross_validate) out += " --cross-validate " + std::to_string(s.cross_validate);
  for (const std::string& f : s.report_frames) out += " --report-frame " + f;
  for (const std::string& r : s.require) out += " --require " + r;
  if (s.reject) out += " --reject";
  if (s.no_report) out += " --no-report";
  if (s.write_reduction) out += " --write-reduction";
  if (s.estimate_noise) out += " --estimate-noise";
  return out;
}

bool calibrate_each(const std::vector<Set>& sets, const Output& output, const BatchArguments& a,
                    const Signals& signals, const std::function<void(size_t, SetSummary)>& ended,
                    const std::function<void()>& look) {
  std::map<pid_t, Child> running;
  std::deque<size_t> waiting;
  for (size_t i = 0; i < sets.size(); ++i) waiting.push_back(i);
  const auto jobs = static_cast<size_t>(a.jobs);
  const auto take_done = [&](Child& child) {
    for (int code; read(child.pipe, &code, sizeof code) == sizeof code;) {
      const size_t i = child.share[child.done++];
      SetSummary summary = summary_of(sets[i], output, code);
      if (summary.status == "failed") summary.seconds = seconds_since(child.start);
      child.start = Clock::now();
      ended(i, std::move(summary));
    }
  };
  std::fflush(nullptr);  // else children would write it a second time
  while (!waiting.empty() || !running.empty()) {
    while (running.size() < jobs && !waiting.empty()) {
      Child child;
      const size_t size = std::clamp<size_t>(waiting.size() / (4 * jobs), 1, kShare);
      child.share.assign(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(size));
      const pid_t pid = start_child(sets, child, output, a.settings, signals.before);
      if (pid < 0 && !running.empty()) break;  // not now: when one of them has ended
      if (pid < 0) {
        ended(waiting.front(),
              failed(sets[waiting.front()], kBadInput,
                     std::string("no process can be started: ") + std::strerror(errno)));
        waiting.pop_front();
      } else {
        waiting.erase(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(size));
        running[pid] = std::move(child);
      }
    }
    look();
    if (running.empty()) continue;
    if (signals.wait(500)) {
      for (const auto& child : running) kill(child.first, SIGKILL);
      for (const auto& child : running) waitpid(child.first, nullptr, 0);
      return false;
    }
    for (auto& child : running) take_done(child.second);
    int status;
    for (pid_t pid; (pid = waitpid(-1, &status, WNOHANG)) > 0;) {
      const auto found = running.find(pid);
      if (found == running.end()) continue;
      Child child = std::move(found->second);
      running.erase(found);
      take_done(child);
      close(child.pipe);
      if (child.done == child.share.size()) continue;
      // The set that it ended at has failed; those behind it wait for another child.
      const size_t i = child.share[child.done];
      SetSummary summary = ended_at(sets[i], output, options_text(a.settings), status);
      if (summary.status == "failed") summary.seconds = seconds_since(child.start);
      waiting.insert(waiting.begin(),
                     child.share.begin() + static_cast<std::ptrdiff_t>(child.done) + 1,
                     child.share.end());
      ended(i, std::move(summary));
    }
  }
  look();
  return true;
}

}  // namespace kincal
