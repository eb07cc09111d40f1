#include "batch_progress.h"

#include <unistd.h>

#include <cstdio>

#include "../progress_line.h"
#include "../signals.h"
#include "sets.h"

namespace kincal {
double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

BatchProgress::BatchProgress(bool quiet, size_t todo)
    : quiet_(quiet), terminal_(isatty(STDERR_FILENO)), todo_(todo) {}

void BatchProgress::restart(size_t done) {
  before_ = done;
  start_ = Clock::now();
  last_ = -1e9;
}

void BatchProgress::update(size_t done, size_t failing, const std::string& note) {
  const double now = seconds_since(start_);
  if (quiet_ || todo_ == 0 || (done < todo_ && (!terminal_ || now - last_ < 0.1))) return;
  last_ = now;
  std::string line = std::to_string(done) + " of " + plural(todo_, "set") + ", " +
                     std::to_string(failing) + " failing";
  if (done > before_ && now > 0) {
    char rate[32];
    const double each = now / static_cast<double>(done - before_);
    std::snprintf(rate, sizeof rate, ", %.3g a second", 1 / each);
    line += rate;
    if (done < todo_) line += ", " + time_text(each * static_cast<double>(todo_ - done)) + " left";
  }
  if (!note.empty() && done < todo_) line += "; " + note;
  if (terminal_) line = "\r\033[K" + line.substr(0, columns_of_terminal());
  std::fprintf(stderr, "%s", line.c_str());
  if (!terminal_ || done == todo_) std::fprintf(stderr, "\n");
  open_ = terminal_ && done < todo_;
  set_line_shown(open_);
}

void BatchProgress::end() {
  if (open_) std::fprintf(stderr, "\r\033[K");
  open_ = false;
}

void BatchProgress::say(const std::string& line) {
  std::fprintf(stderr, "%s%s\n", open_ ? "\r\033[K" : "", line.c_str());
  open_ = false;
  if (terminal_) last_ = -1e9;  // it comes back at once
}

}  // namespace kincal
