#include "batch.h"

#include <sys/wait.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <optional>
#include <vector>

#include "../../io/document/files.h"
#include "../../io/document/names.h"
#include "../../io/report/report_page.h"
#include "../../io/results/summary_file.h"
#include "../job.h"
#include "../signals.h"
#include "../tables/batch_table.h"
#include "batch_progress.h"
#include "child.h"
#include "output.h"
#include "sets.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// "a, b, c and 12 more"
std::string some(const std::vector<std::string>& names, size_t most) {
  std::string out;
  for (size_t i = 0; i < names.size() && i < most; ++i) out += (i ? ", " : "") + names[i];
  if (names.size() > most) out += " and " + std::to_string(names.size() - most) + " more";
  return out;
}

/// While one exists, signals wait until they are asked for, so that none is missed between two
/// looks.
class Signals {
 public:
  Signals() {
    sigemptyset(&signals_);
    for (int s : {SIGCHLD, SIGINT, SIGTERM}) sigaddset(&signals_, s);
    std::signal(SIGCHLD, SIG_DFL);
    sigprocmask(SIG_BLOCK, &signals_, &before);
    begin_writing();
  }
  ~Signals() { sigprocmask(SIG_SETMASK, &before, nullptr); }

  /// Waits until a child ends or the time is over. True: the user wants to stop.
  bool wait(long milliseconds) const {
    const timespec time{milliseconds / 1000, milliseconds % 1000 * 1000000};
    const int s = sigtimedwait(&signals_, nullptr, &time);
    return s == SIGINT || s == SIGTERM;
  }

  sigset_t before;

 private:
  sigset_t signals_;
};

/// What is known of the sets before and while they are calibrated.
struct Work {
  std::vector<SetSummary> summaries;  // by set; status empty: not yet known
  std::vector<size_t> todo;           // sets to calibrate
  std::vector<std::string> redone;    // those of them that have a result, with why it does not do
  size_t failing = 0;                 // of `todo`, so far
};

/// Looks for what is done already.
Work find_work(const Sets& sets, const Output& output, const std::string& options) {
  Work work;
  work.summaries.resize(sets.all.size());
  for (size_t i = 0; i < sets.all.size(); ++i) {
    const Set& set = sets.all[i];
    const fs::path folder = output.result(set.name);
    std::string why;
    std::error_code ignored;
    if (!set.wrong.empty()) {
      work.summaries[i] = failed(set, kBadInput, set.wrong);
    } else if (fs::exists(folder, ignored) && !fs::exists(folder / "batch.json", ignored)) {
      work.summaries[i] = failed(
          set, kBadInput,
          folder.string() + ": is there already and was not written by a batch: move it away");
    } else if (std::optional<SetSummary> done = find_done(set, output, options, why)) {
      work.summaries[i] = *done;
    } else {
      work.todo.push_back(i);
      if (!why.empty()) work.redone.push_back(set.name + " (" + why + ")");
    }
  }
  return work;
}

/// A --step, --free or --fix that no set has is reported once, before anything runs. Sets that
/// cannot be read are reported later.
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
            wrong = "--step: there is no step '" + name + "' in any set" +
                    nearest_names(name, names) + "; " + sets.all[i].name + " has " + known;
        } else {
          const ParameterTable table(rig_file.rig);
          found = !table.select(name).empty();
          if (wrong.empty())
            wrong = option + ": '" + name + "' matches no parameter in any set" +
                    nearest_names(name, table.names());
        }
      } catch (const InputError&) {
      }
    }
    if (!found && !wrong.empty()) throw InputError(wrong);
  }
}

std::string failing_text(const SetSummary& s) {
  return "kincal: error: " + s.name + ": " + (s.status == "failed" ? "" : s.status + ": ") +
         s.error;
}

/// Calibrates what is to be done, each set in a child, at most `jobs` at once. Returns how many are
/// finished: all, or it was interrupted.
size_t calibrate_all(const Sets& sets, const Output& output, const BatchArguments& a,
                     const Signals& signals, Work& work, BatchProgress& progress) {
  struct Child {
    size_t set;
    Clock::time_point start;
  };
  std::map<pid_t, Child> running;
  size_t next = 0, finished = 0;
  const auto finish = [&](size_t i, SetSummary summary) {
    const fs::path folder = output.result(summary.name);
    std::error_code ignored;
    if (summary.status == "failed" && fs::exists(folder, ignored))
      summary.error += " (" + folder.string() + " is the result of before)";
    if (summary.fails()) ++work.failing, progress.say(failing_text(summary));
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
        finish(i, failed(sets.all[i], kBadInput,
                         std::string("no process can be started: ") + std::strerror(errno)));
      else
        running[pid] = {i, Clock::now()};
    }
    progress.update(finished, work.failing);
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
  progress.update(finished, work.failing);
  return finished;
}

}  // namespace

namespace {

/// The sets for the page that shows them all. Of a set without a result the error takes its place.
std::vector<OverviewEntry> overview(const std::vector<SetSummary>& sets, const Output& output) {
  std::vector<OverviewEntry> out;
  for (const SetSummary& set : sets) {
    const std::string folder = output.result(set.name).string();
    if (set.status == "failed")
      out.push_back({set.name, failed_result(set.error), ""});
    else
      out.push_back({set.name, read_file(folder + "/result.json"),
                     file_exists(folder + "/report.html") ? set.name + "/report.html" : ""});
  }
  return out;
}

}  // namespace

int batch(const BatchArguments& a) {
  std::error_code ignored;
  const Sets sets =
      fs::is_directory(a.sets, ignored) ? sets_of_folder(a.sets, a.out) : sets_of_list(a.sets);
  check_names(sets, a.settings);
  const Output output = open_output(a.out);
  const std::string options = options_text(a.settings), count = plural(sets.all.size(), "set");
  const bool silent = a.quiet || a.json;

  Work work = find_work(sets, output, options);
  BatchProgress progress(silent, work.todo.size());
  const size_t known = sets.all.size() - work.todo.size();
  size_t before = 0;
  for (const SetSummary& s : work.summaries) {
    if (s.status.empty()) continue;
    if (s.status != "failed") ++before;
    if (s.fails()) progress.say(failing_text(s));
  }
  if (!silent)
    progress.say(count + (before > 0 ? ", " + std::to_string(before) + " done before" : "") +
                 (work.redone.empty() ? ""
                                      : ", " + std::to_string(work.redone.size()) +
                                            " again: " + some(work.redone, 5)));

  // The summary is there only when the batch is done.
  const std::string csv = (output.folder / "summary.csv").string(),
                    json = (output.folder / "summary.json").string(),
                    page = (output.folder / "report.html").string();
  if (!work.todo.empty())
    for (const std::string& path : {csv, json, page}) fs::remove(path, ignored);
  for (const std::string& path : {csv, json, page}) say_cleared(clear_leftovers(path));
  const size_t finished = calibrate_all(sets, output, a, Signals(), work, progress);
  output.clean();
  if (finished < work.todo.size()) {
    progress.end();
    std::fprintf(stderr, "kincal: interrupted; %zu of %s done, the same command goes on\n",
                 known + finished, count.c_str());
    return kInterrupted;
  }

  const std::string text = summary_json(work.summaries, KINCAL_VERSION, options, sets.ignored);
  write_file(csv, summary_csv(work.summaries), true);
  write_file(json, text, true);
  if (!a.settings.no_report)
    write_file(page, overview_page(overview(work.summaries, output)), true);
  if (a.json)
    std::cout << text;
  else if (!a.quiet)
    std::cout << batch_table(work.summaries, sets.ignored) << "\nWritten to " << a.out
              << (a.settings.no_report ? ": summary.csv, summary.json and a folder for each set\n"
                                       : ": report.html shows all sets; summary.csv, summary.json "
                                         "and a folder for each\n");
  std::vector<std::string> names;
  for (const SetSummary& s : work.summaries)
    if (s.fails()) names.push_back(s.name);
  if (names.empty()) return kConverged;
  std::fprintf(stderr, "kincal: error: %zu of %s failed: %s\n", names.size(), count.c_str(),
               some(names, 100).c_str());
  return kBadInput;
}

}  // namespace kincal
