// `kincal batch`: many sample sets, each calibrated in a process of its own into a result directory of its own.
#include <fcntl.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>
#include <thread>

#include "../../io/document/files.h"
#include "../../io/document/names.h"
#include "../../io/results/summary_file.h"
#include "../commands/command.h"
#include "../job.h"
#include "../tables/tables.h"

namespace kincal {
namespace {

struct BatchArguments {
  std::string sets;  // a folder of sets, or a list file
  std::string out;
  int jobs = 1;
  bool quiet = false, json = false;
  CalibrateSettings settings;
};

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

std::string plural(size_t n, const std::string& what) { return std::to_string(n) + " " + what + (n == 1 ? "" : "s"); }

// ------------------------------------------------------------------------------------------------ what is to be done
struct Set {
  std::string name, rig, samples;
  std::string wrong;  // why it cannot even be tried
};

struct Sets {
  std::vector<Set> all;
  size_t ignored = 0;  // folders that have neither file
};

void check_name(const std::string& name, const std::string& where) {
  if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos)
    throw InputError(where + ": '" + name + "' cannot be the name of a folder");
  if (name == ".batch" || name == "summary.csv" || name == "summary.json")
    throw InputError(where + ": a set cannot be named '" + name + "': this is a file of the batch");
}

/// Every folder of `directory` with a rig.yaml and a samples.jsonl; one of the two alone is a set that fails.
Sets sets_of_folder(const std::string& directory, const std::string& out) {
  Sets sets;
  std::error_code error, ignored;
  fs::directory_iterator entries(directory, error);
  if (error) throw InputError(directory + ": cannot be read: " + error.message());
  for (const fs::directory_entry& entry : entries) {
    if (!entry.is_directory(ignored) || fs::equivalent(entry.path(), out, ignored)) continue;
    const std::string name = entry.path().filename().string();
    const fs::path rig = entry.path() / "rig.yaml", samples = entry.path() / "samples.jsonl";
    const bool has_rig = fs::exists(rig, ignored), has_samples = fs::exists(samples, ignored);
    if (!has_rig && !has_samples) {
      ++sets.ignored;
      continue;
    }
    check_name(name, entry.path().string());
    std::string wrong;
    if (!has_rig) wrong = entry.path().string() + ": has a samples.jsonl but no rig.yaml";
    if (!has_samples) wrong = entry.path().string() + ": has a rig.yaml but no samples.jsonl";
    sets.all.push_back({name, rig.string(), samples.string(), wrong});
  }
  std::sort(sets.all.begin(), sets.all.end(), [](const Set& a, const Set& b) { return a.name < b.name; });
  if (sets.all.empty()) {
    const bool is_set = fs::exists(fs::path(directory) / "samples.jsonl", ignored);
    throw InputError(directory + ": no folder in it has a rig.yaml and a samples.jsonl" +
                     (is_set             ? "; it is a set itself: `kincal calibrate` takes a single one"
                      : sets.ignored > 0 ? " (" + plural(sets.ignored, "folder") + " with neither)"
                                         : ""));
  }
  return sets;
}

/// The words of a line: between tabs if there are any, else between spaces; in double quotes as they are. # begins a comment.
std::vector<std::string> words_of(const std::string& line, const std::string& where) {
  const bool tabs = line.find('\t') != std::string::npos;
  const auto separates = [&](char c) { return tabs ? c == '\t' : c == ' '; };
  std::vector<std::string> words;
  for (size_t i = 0; i < line.size();) {
    if (separates(line[i]) || line[i] == ' ') {
      ++i;
    } else if (line[i] == '#') {
      break;
    } else if (line[i] == '"') {
      const size_t end = line.find('"', i + 1);
      if (end == std::string::npos) throw InputError(where + ": a quote is never closed");
      words.push_back(line.substr(i + 1, end - i - 1));
      i = end + 1;
      if (i < line.size() && line[i] != ' ' && line[i] != '\t')
        throw InputError(where + ": a space or tab is expected after a closing quote");
    } else {
      const size_t begin = i;
      while (i < line.size() && !separates(line[i])) ++i;
      size_t end = i;
      while (line[end - 1] == ' ') --end;
      words.push_back(line.substr(begin, end - begin));
    }
  }
  return words;
}

/// Lines `RIG SAMPLES [NAME]`, relative to the list's own folder.
Sets sets_of_list(const std::string& path) {
  Sets sets;
  const fs::path folder = fs::path(path).parent_path();
  std::map<std::string, int> lines;
  std::istringstream text(read_file(path));
  std::string line;
  for (int n = 1; std::getline(text, line); ++n) {
    const std::string where = path + ":" + std::to_string(n);
    if (!line.empty() && line.back() == '\r') line.pop_back();
    const std::vector<std::string> words = words_of(line, where);
    if (words.empty()) continue;
    if (words.size() < 2 || words.size() > 3)
      throw InputError(where +
                       ": RIG SAMPLES or RIG SAMPLES NAME is expected (paths with spaces in double quotes, or tabs between them), not " +
                       plural(words.size(), "word"));
    const fs::path samples = folder / words[1];
    std::string name = samples.stem().string();
    if (words.size() == 3)
      name = words[2];
    else if (samples.filename() == "samples.jsonl")
      name = fs::absolute(samples).lexically_normal().parent_path().filename().string();
    check_name(name, where);
    const auto inserted = lines.emplace(name, n);
    if (!inserted.second)
      throw InputError(where + ": the set is named '" + name + "' like that of line " + std::to_string(inserted.first->second) +
                       "; a third word on the line is its name");
    sets.all.push_back({name, (folder / words[0]).string(), samples.string(), ""});
  }
  if (sets.all.empty()) throw InputError(path + ": there is no set in it; a line is RIG SAMPLES");
  return sets;
}

/// What makes a difference to results, as a command line.
std::string options_text(const CalibrateSettings& s) {
  std::string out = "--noise " + s.noise + " --linear-solver " + s.linear_solver;
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

// ------------------------------------------------------------------------------------------------ the output folder
/// OUT with a folder .batch, which marks it as a batch's and has what is being written. Locked as long as this process or one of its
/// children lives.
struct Output {
  fs::path folder, scratch;

  fs::path result(const std::string& name) const { return folder / name; }
  fs::path error(const std::string& name) const { return scratch / (name + ".error"); }
  void clean() const {
    std::error_code ignored;
    for (const fs::directory_entry& entry : fs::directory_iterator(scratch, ignored))
      if (entry.path().filename() != "lock") fs::remove_all(entry.path(), ignored);
  }
};

Output open_output(const std::string& out) {
  const Output output{out, fs::path(out) / ".batch"};
  std::error_code error, ignored;
  if (fs::exists(output.folder, ignored) && !fs::is_directory(output.scratch, ignored)) {
    if (!fs::is_directory(output.folder, ignored)) throw InputError(out + ": is not a directory");
    if (!fs::is_empty(output.folder, ignored)) throw InputError(out + ": exists already and is not of a batch: choose another --out");
  }
  for (const fs::path& path : {output.folder, output.scratch}) {
    fs::create_directory(path, error);
    if (error) throw InputError(path.string() + ": cannot be made: " + error.message());
  }
  const int lock = open((output.scratch / "lock").c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
  if (lock < 0) throw InputError((output.scratch / "lock").string() + ": cannot be made: " + std::strerror(errno));
  // Children of a batch that was just killed hold the lock for a moment. (A file system without locks goes without.)
  for (int tries = 0; flock(lock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK; ++tries) {
    if (tries == 50) throw InputError(out + ": another batch is writing here");
    usleep(100000);
  }
  output.clean();
  return output;
}

/// Whether a set's result is there and of these inputs and options: then its summary; else why not ("": never calibrated).
std::optional<SetSummary> find_done(const Set& set, const Output& output, const std::string& options, std::string& why) {
  std::error_code ignored;
  const fs::path folder = output.result(set.name);
  if (!fs::exists(folder / "batch.json", ignored)) return std::nullopt;
  const std::optional<BatchRecord> record = read_record((folder / "batch.json").string());
  if (!record || !fs::exists(folder / "result.json", ignored)) {
    why = "result damaged";
    return std::nullopt;
  }
  const auto same = [](const std::string& path, const std::string& hash) {
    try {
      return sha256(read_file(path)) == hash;
    } catch (const InputError&) {
      return false;  // the calibration will say what is wrong
    }
  };
  const std::string rig = rig_path(set.rig);
  if (record->version != KINCAL_VERSION)
    why = "version of kincal changed";
  else if (record->options != options)
    why = "options changed";
  else if (!same(rig, record->rig))
    why = "rig changed";
  else if (!same((fs::path(rig).parent_path() / record->robot).string(), record->urdf))
    why = "robot changed";
  else if (!same(set.samples, record->samples))
    why = "samples changed";
  if (!why.empty()) return std::nullopt;
  SetSummary summary = record->set;
  summary.name = set.name;
  return summary;
}

// ------------------------------------------------------------------------------------------------ one set, in the child
/// Calibrates a set into its result directory, or leaves what went wrong in a file for the parent, and ends the process with the exit code:
/// at once, since nobody needs its memory given back piece by piece.
[[noreturn]] void calibrate_set(const Set& set, const Output& output, const CalibrateSettings& settings) {
  const Clock::time_point start = Clock::now();
  try {
    Job job = read_job(set.rig, set.samples, settings.holdout);
    const std::optional<CalibrationResult> result = run(job, settings, nullptr);
    ResultFiles files = make_files(job, *result, settings);
    BatchRecord record;
    record.version = KINCAL_VERSION;
    record.options = options_text(settings);
    record.rig = files.rig_hash;
    record.samples = files.samples_hash;
    record.urdf = files.urdf_hash;
    record.robot = top(job.rig_file.node, job.rig_file.path)["robot"].string();
    record.set = summarize(*result);
    for (const std::string& warning : job.rig_file.urdf.warnings) record.set.warnings.push_back("urdf: " + warning);
    record.set.exit_code = exit_code(*result);
    record.set.seconds = seconds_since(start);
    files.batch_json = record_text(record);
    write_results(output.result(set.name).string(), files, true, nullptr, output.scratch.string());
    _exit(record.set.exit_code);
  } catch (const std::exception& error) {
    std::string text = error.what();
    std::replace(text.begin(), text.end(), '\n', ' ');
    try {
      write_file(output.error(set.name).string(), text);
    } catch (const InputError&) {  // a full disk: the parent has words for it
    }
    _exit(kBadInput);
  }
}

/// Starts calibrate_set in a child; returns its process id, -1 if there cannot be one more.
pid_t start_set(const Set& set, const Output& output, const CalibrateSettings& settings, const sigset_t& signals_before) {
  const pid_t parent = getpid(), child = fork();
  if (child != 0) return child;
#ifdef __linux__
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // nobody would read what a child of a dead parent finds
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

/// What became of a child that ended with `status` (of waitpid).
SetSummary summary_of(const Set& set, const Output& output, int status) {
  if (WIFSIGNALED(status))
    return failed(set, 128 + WTERMSIG(status),
                  "ended by signal " + std::to_string(WTERMSIG(status)) + " (" + strsignal(WTERMSIG(status)) + ")");
  const int code = WEXITSTATUS(status);
  std::error_code ignored;
  if (code == kConverged || code == kUnobservable || code == kNotConverged || code == kToleranceNotMet) {
    std::optional<BatchRecord> record = read_record((output.result(set.name) / "batch.json").string());
    if (record) {
      record->set.name = set.name;
      return record->set;
    }
  } else if (fs::exists(output.error(set.name), ignored)) {
    return failed(set, code, read_file(output.error(set.name).string()));
  }
  return failed(set, kBadInput, output.result(set.name).string() + ": cannot be written");
}

// ------------------------------------------------------------------------------------------------ progress
std::string time_text(double seconds) {
  char text[32];
  if (seconds < 100)
    std::snprintf(text, sizeof text, "%.0f s", seconds);
  else if (seconds < 6000)
    std::snprintf(text, sizeof text, "%.0f min", seconds / 60);
  else
    std::snprintf(text, sizeof text, "%.1f h", seconds / 3600);
  return text;
}

/// How far it is, on standard error: one line that is written anew on a terminal, else a line every ten seconds.
class BatchProgress {
 public:
  BatchProgress(bool quiet, size_t todo) : quiet_(quiet), terminal_(isatty(STDERR_FILENO)), todo_(todo) {}

  void update(size_t done, size_t failing) {
    const double now = seconds_since(start_);
    if (quiet_ || todo_ == 0 || (done < todo_ && now - last_ < (terminal_ ? 0.1 : 10))) return;
    last_ = now;
    std::fprintf(stderr, "%s%zu of %s, %zu failing", terminal_ ? "\r\033[K" : "", done, plural(todo_, "set").c_str(), failing);
    if (done > 0 && now > 0) {
      std::fprintf(stderr, ", %.3g a second", static_cast<double>(done) / now);
      if (done < todo_)
        std::fprintf(stderr, ", %s left", time_text(now / static_cast<double>(done) * static_cast<double>(todo_ - done)).c_str());
    }
    if (!terminal_ || done == todo_) std::fprintf(stderr, "\n");
    open_ = terminal_ && done < todo_;
  }

  /// Ends the line where it is.
  void end() {
    if (open_) std::fprintf(stderr, "\n");
    open_ = false;
  }

  /// A line of its own.
  void say(const std::string& line) {
    std::fprintf(stderr, "%s%s\n", open_ ? "\r\033[K" : "", line.c_str());
    open_ = false;
    if (terminal_) last_ = -1e9;  // it comes back at once
  }

 private:
  bool quiet_, terminal_, open_ = false;
  size_t todo_;
  Clock::time_point start_ = Clock::now();
  double last_ = 0;
};

/// "a, b, c and 12 more"
std::string some(const std::vector<std::string>& names, size_t most) {
  std::string out;
  for (size_t i = 0; i < names.size() && i < most; ++i) out += (i ? ", " : "") + names[i];
  if (names.size() > most) out += " and " + std::to_string(names.size() - most) + " more";
  return out;
}

// ------------------------------------------------------------------------------------------------ the parent
/// While one exists, signals wait until they are asked for, so that none is missed between two looks.
class Signals {
 public:
  Signals() {
    sigemptyset(&ours_);
    for (int s : {SIGCHLD, SIGINT, SIGTERM}) sigaddset(&ours_, s);
    std::signal(SIGCHLD, SIG_DFL);
    sigprocmask(SIG_BLOCK, &ours_, &before);
  }
  ~Signals() { sigprocmask(SIG_SETMASK, &before, nullptr); }

  /// Waits until a child ends or the time is over. True: the user wants to stop.
  bool wait(long milliseconds) const {
    const timespec time{milliseconds / 1000, milliseconds % 1000 * 1000000};
    const int s = sigtimedwait(&ours_, nullptr, &time);
    return s == SIGINT || s == SIGTERM;
  }

  sigset_t before;

 private:
  sigset_t ours_;
};

/// What is known of the sets before and while they are calibrated.
struct Work {
  std::vector<SetSummary> summaries;  // by set; status empty: not yet known
  std::vector<size_t> todo;           // sets to calibrate
  std::vector<std::string> again;     // those of them that have a result, with why it does not do
};

/// Looks for what is done already; false: interrupted.
bool find_work(const Sets& sets, const Output& output, const std::string& options, const Signals& signals, Work& work) {
  work.summaries.resize(sets.all.size());
  for (size_t i = 0; i < sets.all.size(); ++i) {
    if (signals.wait(0)) return false;
    const Set& set = sets.all[i];
    const fs::path folder = output.result(set.name);
    std::string why;
    std::error_code ignored;
    if (!set.wrong.empty()) {
      work.summaries[i] = failed(set, kBadInput, set.wrong);
    } else if (fs::exists(folder, ignored) && !fs::exists(folder / "batch.json", ignored)) {
      work.summaries[i] = failed(set, kBadInput, folder.string() + ": is there already and was not written by a batch: move it away");
    } else if (std::optional<SetSummary> done = find_done(set, output, options, why)) {
      work.summaries[i] = *done;
    } else {
      work.todo.push_back(i);
      if (!why.empty()) work.again.push_back(set.name + " (" + why + ")");
    }
  }
  return true;
}

/// A --step, --free or --fix that no set has is told once, before anything runs. Sets that cannot be read say so later.
/// @throws InputError
void check_names(const Sets& sets, const CalibrateSettings& settings) {
  std::vector<std::pair<std::string, std::string>> wanted;  // option, name
  if (!settings.step.empty()) wanted.push_back({"--step", settings.step});
  for (const std::string& pattern : settings.free) wanted.push_back({"--free", pattern});
  for (const std::string& pattern : settings.fix) wanted.push_back({"--fix", pattern});
  for (const auto& [option, name] : wanted) {
    std::string wrong;
    bool found = false;
    for (size_t i = 0; i < sets.all.size() && !found; ++i) {
      try {
        const RigFile rig_file = read_rig(rig_path(sets.all[i].rig));
        const std::vector<Step>& steps = rig_file.rig.steps;
        std::vector<std::string> names;
        std::string known;
        for (const Step& step : steps) {
          names.push_back(step.name);
          known += (known.empty() ? "" : ", ") + step.name;
        }
        if (option == "--step") {
          found = std::count(names.begin(), names.end(), name) > 0;
          if (wrong.empty())
            wrong = "--step: there is no step '" + name + "' in any set" + nearest_names(name, names) + "; " + sets.all[i].name + " has " +
                    known;
        } else {
          const ParameterTable table(rig_file.rig);
          found = !table.select(name).empty();
          if (wrong.empty()) wrong = option + ": '" + name + "' matches no parameter in any set" + nearest_names(name, table.names());
        }
      } catch (const InputError&) {
      }
    }
    if (!found && !wrong.empty()) throw InputError(wrong);
  }
}

std::string failing_text(const SetSummary& s) {
  return "kincal: error: " + s.name + ": " + (s.status == "failed" ? "" : s.status + ": ") + s.error;
}

/// Calibrates what is to be done, each set in a child, at most `jobs` at once. Returns how many are finished: all, or it was interrupted.
size_t calibrate_all(const Sets& sets, const Output& output, const BatchArguments& a, const Signals& signals, Work& work,
                     BatchProgress& progress, size_t failing) {
  struct Child {
    size_t set;
    Clock::time_point start;
  };
  std::map<pid_t, Child> running;
  size_t next = 0, finished = 0;
  const auto finish = [&](size_t i, SetSummary summary) {
    const fs::path folder = output.result(summary.name);
    std::error_code ignored;
    if (summary.status == "failed" && fs::exists(folder, ignored)) summary.error += " (" + folder.string() + " is the result of before)";
    if (summary.fails()) ++failing, progress.say(failing_text(summary));
    work.summaries[i] = std::move(summary);
    ++finished;
  };
  std::fflush(nullptr);  // else children would write it a second time
  while (finished < work.todo.size()) {
    while (running.size() < static_cast<size_t>(a.jobs) && next < work.todo.size()) {
      const size_t i = work.todo[next];
      const pid_t pid = start_set(sets.all[i], output, a.settings, signals.before);
      if (pid < 0 && !running.empty()) break;  // not now: when one of them has ended
      ++next;
      if (pid < 0)
        finish(i, failed(sets.all[i], kBadInput, std::string("no process can be started: ") + std::strerror(errno)));
      else
        running[pid] = {i, Clock::now()};
    }
    progress.update(finished, failing);
    if (running.empty()) continue;
    if (signals.wait(500)) {
      for (const auto& child : running) kill(child.first, SIGKILL);
      for (const auto& child : running) waitpid(child.first, nullptr, 0);
      return finished;
    }
    int status;
    for (pid_t pid; (pid = waitpid(-1, &status, WNOHANG)) > 0;) {
      const auto child = running.find(pid);
      if (child == running.end()) continue;
      const size_t i = child->second.set;
      SetSummary summary = summary_of(sets.all[i], output, status);
      if (summary.status == "failed") summary.seconds = seconds_since(child->second.start);
      running.erase(child);
      finish(i, std::move(summary));
    }
  }
  progress.update(finished, failing);
  return finished;
}

/// Returns the exit code: 0 all converged, 1 some did not, 130 interrupted. @throws InputError where nothing can be started
int batch(const BatchArguments& a) {
  std::error_code ignored;
  const Sets sets = fs::is_directory(a.sets, ignored) ? sets_of_folder(a.sets, a.out) : sets_of_list(a.sets);
  check_names(sets, a.settings);
  const Output output = open_output(a.out);
  const std::string options = options_text(a.settings), count = plural(sets.all.size(), "set");
  const bool silent = a.quiet || a.json;
  const auto interrupted = [&](const std::string& done) {
    std::fprintf(stderr, "kincal: interrupted%s, the same command goes on\n", done.c_str());
    return kInterrupted;
  };

  const Signals signals;
  Work work;
  if (!find_work(sets, output, options, signals, work)) return interrupted("");
  BatchProgress progress(silent, work.todo.size());
  const size_t known = sets.all.size() - work.todo.size();
  size_t before = 0, failing = 0;
  for (const SetSummary& s : work.summaries) {
    if (s.status.empty()) continue;
    if (s.status != "failed") ++before;
    if (s.fails()) ++failing, progress.say(failing_text(s));
  }
  if (!silent)
    progress.say(count + (before > 0 ? ", " + std::to_string(before) + " done before" : "") +
                 (work.again.empty() ? "" : ", " + std::to_string(work.again.size()) + " again: " + some(work.again, 5)));

  // The summary is there only when the batch is done.
  const std::string csv = (output.folder / "summary.csv").string(), json = (output.folder / "summary.json").string();
  if (!work.todo.empty())
    for (const std::string& path : {csv, json}) fs::remove(path, ignored);
  const size_t finished = calibrate_all(sets, output, a, signals, work, progress, failing);
  output.clean();
  if (finished < work.todo.size()) {
    progress.end();
    return interrupted("; " + std::to_string(known + finished) + " of " + count + " done");
  }

  const std::string text = summary_json(work.summaries, KINCAL_VERSION, options, sets.ignored);
  write_file(csv, summary_csv(work.summaries));
  write_file(json, text);
  if (a.json)
    std::cout << text;
  else if (!a.quiet)
    std::cout << batch_table(work.summaries, sets.ignored) << "\nWritten to " << a.out
              << ": summary.csv, summary.json and a folder for each set\n";
  std::vector<std::string> names;
  for (const SetSummary& s : work.summaries)
    if (s.fails()) names.push_back(s.name);
  if (names.empty()) return kConverged;
  std::fprintf(stderr, "kincal: error: %zu of %s failed: %s\n", names.size(), count.c_str(), some(names, 100).c_str());
  return kBadInput;
}

}  // namespace

Command batch_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<BatchArguments>();
  a->settings.command = command_line;
  a->jobs = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  CLI::App* command = app.add_subcommand("batch", "Calibrate many sample sets, each into a result directory of its own");
  command
      ->add_option(
          "SETS", a->sets,
          "a folder whose folders have a rig.yaml and a samples.jsonl each, or a list file with lines RIG SAMPLES [NAME], relative to\n"
          "the list's folder")
      ->required();
  command->add_option("--out", a->out, "directory for the result directories, summary.csv and summary.json; the same one to go on")
      ->required();
  command->add_option("--jobs", a->jobs, "how many calibrations run at once (default: as many as there are cores)")
      ->check(CLI::Range(1, 1024));
  add_settings(*command, a->settings);
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->add_flag("--json", a->json, "print summary.json on standard output instead of tables");
  command->footer(
      "A set whose result is there, of the same inputs, options and version, is not calibrated again; so the same command goes on after "
      "an\n"
      "interruption. A set that fails stops no other; failing sets are named at the end.\n"
      "Exit codes: 0 all sets converged; 1 some did not (failed, not_converged, unobservable: see `status` in summary.csv) or do not\n"
      "meet a --require, or bad usage; 130 interrupted, what is finished stays.");
  return {command, [a] { return batch(*a); }};
}

}  // namespace kincal
