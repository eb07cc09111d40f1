#include "batch_progress.h"

#include <unistd.h>

#include <cstdio>

#include "../progress.h"
#include "../signals.h"
#include "sets.h"

namespace kincal {
double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

BatchProgress::BatchProgress(bool quiet, size_t todo)
    : quiet_(quiet), terminal_(isatty(STDERR_FILENO)), todo_(todo) {}

void BatchProgress::update(size_t done, size_t failing) {
  const double now = seconds_since(start_);
  if (quiet_ || todo_ == 0 || (done < todo_ && (!terminal_ || now - last_ < 0.1))) return;
  last_ = now;
  std::fprintf(stderr, "%s%zu of %s, %zu failing", terminal_ ? "\r\033[K" : "", done,
               plural(todo_, "set").c_str(), failing);
  if (done > 0 && now > 0) {
    std::fprintf(stderr, ", %.3g a second", static_cast<double>(done) / now);
    if (done < todo_)
      std::fprintf(
          stderr, ", %s left",
          time_text(now / static_cast<double>(done) * static_cast<double>(todo_ - done)).c_str());
  }
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
