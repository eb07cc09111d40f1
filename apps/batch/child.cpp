#include "child.h"

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
#include <filesystem>
#include <map>
#include <optional>

#include "../../io/document/files.h"
#include "batch_progress.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// Calibrates a set into its result directory, or leaves what went wrong in a file for the parent,
/// and ends the process with the exit code: at once, since its memory need not be given back piece
/// by piece.
[[noreturn]] void calibrate_set(const Set& set, const Output& output,
                                const CalibrateSettings& settings) {
  const Clock::time_point start = Clock::now();
  try {
    Progress silent(true);
    Job job = read_job(set.rig, set.samples, settings.holdout, silent);
    const Report report = run(job, settings, true, silent);
    if (report.solution.status == Status::undefined_start) {
      const bool found = report.diagnosis && !report.diagnosis->findings.empty();
      const Finding* first = found ? &report.diagnosis->findings[0] : nullptr;
      throw std::runtime_error(found ? first->id + ": " + first->text : report.solution.message);
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
    _exit(record.set.exit_code);
  } catch (const std::exception& error) {
    std::string text = error_text(error);
    std::replace(text.begin(), text.end(), '\n', ' ');
    try {
      write_file(output.error(set.name).string(), text, true);
    } catch (const InputError&) {  // a full disk: the parent has words for it
    }
    _exit(kBadInput);
  }
}

/// Starts a child that calibrates a set into its result directory; returns its process id, -1 if
/// there cannot be one more.
pid_t start_set(const Set& set, const Output& output, const CalibrateSettings& settings,
                const sigset_t& signals_before) {
  const pid_t parent = getpid(), child = fork();
  if (child != 0) return child;
#ifdef __linux__
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // what a child of a dead parent finds would not be read
#endif
  if (getppid() != parent) _exit(kInterrupted);
  for (const int s : {SIGINT, SIGTERM})
    std::signal(s, SIG_IGN);  // they reach all; the parent decides
  sigprocmask(SIG_SETMASK, &signals_before, nullptr);
  calibrate_set(set, output, settings);
}

/// Returns the summary of a child that ended with `status` (of waitpid).
SetSummary summary_of(const Set& set, const Output& output, int status) {
  if (WIFSIGNALED(status))
    return failed(set, 128 + WTERMSIG(status),
                  "ended by signal " + std::to_string(WTERMSIG(status)) + " (" +
                      strsignal(WTERMSIG(status)) + ")");
  const int code = WEXITSTATUS(status);
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
  struct Child {
    size_t set;
    Clock::time_point start;
  };
  std::map<pid_t, Child> running;
  std::fflush(nullptr);  // else children would write it a second time
  for (size_t next = 0; next < sets.size() || !running.empty();) {
    while (running.size() < static_cast<size_t>(a.jobs) && next < sets.size()) {
      const size_t i = next;
      const pid_t pid = start_set(sets[i], output, a.settings, signals.before);
      if (pid < 0 && !running.empty()) break;  // not now: when one of them has ended
      ++next;
      if (pid < 0)
        ended(i, failed(sets[i], kBadInput,
                        std::string("no process can be started: ") + std::strerror(errno)));
      else
        running[pid] = {i, Clock::now()};
    }
    look();
    if (running.empty()) continue;
    if (signals.wait(500)) {
      for (const auto& child : running) kill(child.first, SIGKILL);
      for (const auto& child : running) waitpid(child.first, nullptr, 0);
      return false;
    }
    int status;
    for (pid_t pid; (pid = waitpid(-1, &status, WNOHANG)) > 0;) {
      const auto child = running.find(pid);
      if (child == running.end()) continue;
      const size_t i = child->second.set;
      SetSummary summary = summary_of(sets[i], output, status);
      if (summary.status == "failed") summary.seconds = seconds_since(child->second.start);
      running.erase(child);
      ended(i, std::move(summary));
    }
  }
  look();
  return true;
}

}  // namespace kincal
