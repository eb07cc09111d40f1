#include "child.h"

#include <sys/wait.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#include <algorithm>
#include <cstring>
#include <filesystem>

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

pid_t start_set(const Set& set, const Output& output, const CalibrateSettings& settings,
                const sigset_t& signals_before) {
  const pid_t parent = getpid(), child = fork();
  if (child != 0) return child;
#ifdef __linux__
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // what a child of a dead parent finds would not be read
#endif
  if (getppid() != parent) _exit(kInterrupted);
  std::signal(SIGINT, SIG_IGN);  // Ctrl-C reaches all; the parent decides
  std::signal(SIGTERM, SIG_DFL);
  sigprocmask(SIG_SETMASK, &signals_before, nullptr);
  calibrate_set(set, output, settings);
}

SetSummary failed(const Set& set, int code, const std::string& error) {
  SetSummary summary;
  summary.name = set.name;
  summary.status = "failed";
  summary.exit_code = code;
  summary.error = error;
  return summary;
}

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

}  // namespace kincal
