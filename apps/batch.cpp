#include "batch.h"

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
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>

#include "../io/summary_file.h"
#include "tables.h"

namespace kincal {
namespace {

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
  if (s.no_report) out += " --no-report";
  if (s.write_reduction) out += " --write-reduction";
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
    Job job = read_job(set.rig, set.samples);
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
    record.set.exit_code = exit_code(result->status);
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
  if (code == kConverged || code == kUnobservable || code == kNotConverged) {
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

}  // namespace

int batch(const BatchArguments& a) {
  std::error_code ignored;
  const Sets sets = fs::is_directory(a.sets, ignored) ? sets_of_folder(a.sets, a.out) : sets_of_list(a.sets);
  const Output output = open_output(a.out);
  const std::string options = options_text(a.settings);

  // Signals are taken where they are waited for, below, so that none is missed.
  sigset_t signals, signals_before;
  sigemptyset(&signals);
  for (int s : {SIGCHLD, SIGINT, SIGTERM}) sigaddset(&signals, s);
  std::signal(SIGCHLD, SIG_DFL);
  sigprocmask(SIG_BLOCK, &signals, &signals_before);
  const auto wait_signal = [&](double seconds) {
    timespec time{static_cast<time_t>(seconds), static_cast<long>(std::fmod(seconds, 1) * 1e9)};
    const int s = sigtimedwait(&signals, nullptr, &time);
    return s == SIGINT || s == SIGTERM;
  };
  const auto interrupted = [&](size_t done) {
    std::fprintf(stderr, "kincal: interrupted; %zu of %s done, the same command goes on\n", done, plural(sets.all.size(), "set").c_str());
    return kInterrupted;
  };

  // What is done already.
  std::vector<SetSummary> summaries(sets.all.size());
  std::vector<size_t> todo;
  std::vector<std::string> again;
  for (size_t i = 0; i < sets.all.size(); ++i) {
    if (wait_signal(0)) return interrupted(i - todo.size());
    const Set& set = sets.all[i];
    const fs::path folder = output.result(set.name);
    std::string why;
    if (!set.wrong.empty()) {
      summaries[i] = failed(set, kBadInput, set.wrong);
    } else if (fs::exists(folder, ignored) && !fs::exists(folder / "batch.json", ignored)) {
      summaries[i] = failed(set, kBadInput, folder.string() + ": is there already and was not written by a batch: move it away");
    } else if (std::optional<SetSummary> done = find_done(set, output, options, why)) {
      summaries[i] = *done;
    } else {
      todo.push_back(i);
      if (!why.empty()) again.push_back(set.name + " (" + why + ")");
    }
  }
  const size_t before = static_cast<size_t>(
      std::count_if(summaries.begin(), summaries.end(), [](const SetSummary& s) { return !s.status.empty() && s.status != "failed"; }));
  size_t failing = 0;
  const bool silent = a.quiet || a.json;
  BatchProgress progress(silent, todo.size());
  const auto say_failing = [&](const SetSummary& s) {
    if (s.status == "converged") return;
    ++failing;
    progress.say("kincal: error: " + s.name + ": " + (s.status == "failed" ? "" : s.status + ": ") + s.error);
  };
  if (!silent) {
    std::string line = plural(sets.all.size(), "set");
    if (before > 0) line += ", " + std::to_string(before) + " done before";
    if (!again.empty()) line += ", " + std::to_string(again.size()) + " again: " + some(again, 5);
    progress.say(line);
  }
  for (const SetSummary& s : summaries)
    if (!s.status.empty()) say_failing(s);

  // The summary is there only when the batch is done.
  const fs::path csv = output.folder / "summary.csv", json = output.folder / "summary.json";
  if (!todo.empty())
    for (const fs::path& path : {csv, json}) fs::remove(path, ignored);

  // Children, at most a.jobs at once.
  struct Child {
    size_t set;
    Clock::time_point start;
  };
  std::map<pid_t, Child> running;
  size_t next = 0, finished = 0;
  const auto finish = [&](size_t i, SetSummary summary) {
    if (summary.status == "failed" && fs::exists(output.result(sets.all[i].name), ignored))
      summary.error += " (" + output.result(sets.all[i].name).string() + " is the result of before)";
    summaries[i] = std::move(summary);
    ++finished;
    say_failing(summaries[i]);
  };
  std::fflush(nullptr);  // a child must not write it a second time
  while (finished < todo.size()) {
    while (running.size() < static_cast<size_t>(a.jobs) && next < todo.size()) {
      const size_t i = todo[next++];
      const pid_t pid = start_set(sets.all[i], output, a.settings, signals_before);
      if (pid > 0)
        running[pid] = {i, Clock::now()};
      else
        finish(i, failed(sets.all[i], kBadInput, std::string("no process can be started: ") + std::strerror(errno)));
    }
    progress.update(finished, failing);
    if (running.empty()) continue;
    if (wait_signal(0.5)) {
      for (const auto& child : running) kill(child.first, SIGKILL);
      for (const auto& child : running) waitpid(child.first, nullptr, 0);
      output.clean();
      progress.end();
      return interrupted(sets.all.size() - (todo.size() - finished));
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
  output.clean();

  const std::string text = summary_json(summaries, KINCAL_VERSION, options, sets.ignored);
  write_file(csv.string(), summary_csv(summaries));
  write_file(json.string(), text);
  if (a.json)
    std::cout << text;
  else if (!a.quiet)
    std::cout << batch_table(summaries, sets.ignored) << "\nWritten to " << a.out
              << ": summary.csv, summary.json and a folder for each set\n";
  if (failing == 0) return kConverged;
  std::vector<std::string> names;
  for (const SetSummary& s : summaries)
    if (s.status != "converged") names.push_back(s.name);
  std::fprintf(stderr, "kincal: error: %zu of %s failed: %s\n", failing, plural(summaries.size(), "set").c_str(), some(names, 100).c_str());
  return kBadInput;
}

}  // namespace kincal
