// How far a command is, on a terminal.
#pragma once

#include <chrono>
#include <string>

#include "../solver/progress.h"

namespace kincal {

/// A ProgressLine shows what a command does, how far it is and how long that will take, where this
/// can be told: on standard error, only if that is a terminal, in one line that is written anew and
/// gone at the end.
class ProgressLine {
 public:
  explicit ProgressLine(bool quiet);
  ~ProgressLine() { clear(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// Returns a progress that is shown here and cancels nothing; it must not outlive the line.
  Progress progress();
  void tell(const Progress::News& news);
  /// As Progress::stage().
  void stage(const std::string& what, double share);
  /// Removes the line, for something else to be printed.
  void clear();

 private:
  void show(bool at_once);

  using Clock = std::chrono::steady_clock;
  /// A Stage is what is done, and its share if that can be told.
  struct Stage {
    std::string what;
    double share = 0;
    Clock::time_point begin;
    void go_on(const std::string& now, double done);
    std::string text(Clock::time_point now) const;
  };
  bool shown_;
  Stage whole_, part_;  // what of the whole is done now
  Clock::time_point last_;
};

/// Returns how long a line of progress may be: longer ones would be broken, and their beginnings
/// stay.
size_t columns_of_terminal();

/// "12 s", "3 min", "1.5 h"
std::string time_text(double seconds);

}  // namespace kincal
