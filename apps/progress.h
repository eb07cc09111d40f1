// How far a command is, on a terminal.
#pragma once

#include <chrono>
#include <string>

namespace kincal {

/// A Progress shows what a command does, how far it is and how long that will take, where this can
/// be told: on standard error, only if that is a terminal, in one line that is written anew and
/// gone at the end. Its first two functions are for the callbacks of the libraries.
class Progress {
 public:
  explicit Progress(bool quiet);
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// As CalibrationOptions::stage.
  void stage(const std::string& what, double share);
  /// As CalibrationOptions::progress.
  void iteration(const std::string& step, int iteration, double chi2);
  /// Removes the line, for something else to be printed.
  void clear();

 private:
  void show(bool at_once);

  bool shown_;
  std::string whole_, part_;  // what is done, with a share; what of it is done now
  double share_ = 0;
  using Clock = std::chrono::steady_clock;
  Clock::time_point begin_, last_;
};

/// Returns how long a line of progress may be: longer ones would be broken, and their beginnings
/// stay.
size_t columns_of_terminal();

/// "12 s", "3 min", "1.5 h"
std::string time_text(double seconds);

}  // namespace kincal
