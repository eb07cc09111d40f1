// What there is to do in a batch, and what is done of it.
#pragma once

#include <csignal>
#include <string>
#include <vector>

#include "../../io/results/summary_file.h"
#include "batch_progress.h"
#include "output.h"
#include "sets.h"

namespace kincal {

/// While one exists, signals wait until they are asked for, so that none is missed between two
/// looks.
class Signals {
 public:
  Signals();
  ~Signals() { sigprocmask(SIG_SETMASK, &before, nullptr); }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

  /// Waits until a child ends or the time is over. True: the user wants to stop.
  bool wait(long milliseconds) const;

  sigset_t before;

 private:
  sigset_t signals_;
};

/// "a, b, c and 12 more"
std::string some(const std::vector<std::string>& names, size_t most);

/// What is known of the sets before and while they are calibrated.
struct Work {
  const std::vector<Set>& sets;
  const Output& output;
  std::vector<SetSummary> summaries;  // by set; status empty: not yet known
  std::vector<size_t> todo;           // sets to calibrate
  std::vector<std::string> redone;    // those of them that have a result, with why it does not do
  size_t finished = 0, failing = 0;   // of `todo`, so far

  bool done() const { return finished == todo.size(); }
  size_t sets_done() const { return sets.size() - todo.size() + finished; }
  bool known(size_t set) const { return !summaries[set].status.empty(); }
  /// Notes how a set of `todo` ended, and says so if it failed.
  void finish(size_t set, SetSummary summary, BatchProgress& progress);
};

/// Looks for what is done already.
Work find_work(const std::vector<Set>& sets, const Output& output, const std::string& options);

/// "kincal: error: NAME: what is wrong"
std::string failing_text(const SetSummary& summary);

}  // namespace kincal
