// How far a batch is.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace kincal {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start);

/// A BatchProgress shows how far a batch is, on standard error: one line that is written anew on a
/// terminal, and everywhere a last line when all is done.
class BatchProgress {
 public:
  BatchProgress(bool quiet, size_t todo);

  /// `note`: what else there is to say.
  void update(size_t done, size_t failing, const std::string& note = "");
  /// The rate counts from here: what is done so far was not done in the time that this has seen.
  void restart(size_t done);

  /// Removes the line.
  void end();

  /// Writes a line of its own.
  void say(const std::string& line);

 private:
  bool quiet_, terminal_, open_ = false;
  size_t todo_, before_ = 0;
  Clock::time_point start_ = Clock::now();
  double last_ = 0;
};

}  // namespace kincal
