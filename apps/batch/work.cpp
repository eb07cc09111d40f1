#include "work.h"

#include <filesystem>
#include <optional>

#include "../job.h"

namespace kincal {

namespace fs = std::filesystem;

Signals::Signals() {
  sigemptyset(&signals_);
  for (int s : {SIGCHLD, SIGINT, SIGTERM}) sigaddset(&signals_, s);
  std::signal(SIGCHLD, SIG_DFL);
  sigprocmask(SIG_BLOCK, &signals_, &before);
  begin_writing();
}

bool Signals::wait(long milliseconds) const {
  const timespec time{milliseconds / 1000, milliseconds % 1000 * 1000000};
  const int s = sigtimedwait(&signals_, nullptr, &time);
  return s == SIGINT || s == SIGTERM;
}

std::string some(const std::vector<std::string>& names, size_t most) {
  std::string out;
  for (size_t i = 0; i < names.size() && i < most; ++i) out += (i ? ", " : "") + names[i];
  if (names.size() > most) out += " and " + std::to_string(names.size() - most) + " more";
  return out;
}

std::string failing_text(const SetSummary& s) {
  return "kincal: error: " + s.name + ": " + (s.status == "failed" ? "" : s.status + ": ") +
         s.error;
}

void Work::finish(size_t set, SetSummary summary, BatchProgress& progress) {
  const fs::path folder = output.result(summary.name);
  std::error_code ignored;
  if (summary.status == "failed" && fs::exists(folder, ignored))
    summary.error += " (" + folder.string() + " is the result of before)";
  if (summary.fails()) ++failing, progress.say(failing_text(summary));
  summaries[set] = std::move(summary);
  ++finished;
}

Work find_work(const std::vector<Set>& sets, const Output& output, const std::string& options) {
  Work work{sets, output, {}, {}, {}};
  work.summaries.resize(sets.size());
  for (size_t i = 0; i < sets.size(); ++i) {
    const Set& set = sets[i];
    const fs::path folder = output.result(set.name);
    std::string why;
    std::error_code ignored;
    if (!set.wrong.empty()) {
      work.summaries[i] = failed(set, kBadInput, set.wrong);
    } else if (fs::exists(folder, ignored) && !fs::exists(folder / "batch.json", ignored)) {
      work.summaries[i] =
          failed(set, kBadInput,
                 folder.string() + ": already exists and was not written by a batch: move it away");
    } else if (std::optional<SetSummary> done = find_done(set, output, options, why)) {
      work.summaries[i] = *done;
    } else {
      work.todo.push_back(i);
      if (!why.empty()) work.redone.push_back(set.name + " (" + why + ")");
    }
  }
  return work;
}

}  // namespace kincal
