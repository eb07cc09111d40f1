#include "progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>

#include "signals.h"

namespace kincal {

size_t columns_of_terminal() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col - 1u : 79;
}

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

Progress::Progress(bool quiet) : shown_(!quiet && isatty(STDERR_FILENO)) {}

void Progress::stage(const std::string& what, double share) {
  if (!shown_) return;
  if (std::isnan(share)) {
    part_ = what;
    return show(true);
  }
  const bool is_new = what != whole_;
  if (is_new) begin_ = Clock::now();
  whole_ = share < 1 ? what : "";
  share_ = share;
  if (is_new || share >= 1) part_.clear();
  show(is_new || share >= 1);
}

void Progress::iteration(const std::string& step, int iteration, double chi2) {
  if (!shown_) return;
  if (iteration == 0) {
    if (step != whole_) stage(step + ": starting values", std::nan(""));
    return;
  }
  char text[64];
  std::snprintf(text, sizeof text, ": iteration %d, chi2 %.8g", iteration, chi2);
  part_ = step + text;
  show(iteration == 1);
}

void Progress::show(bool at_once) {
  const Clock::time_point now = Clock::now();
  if (!at_once && now - last_ < std::chrono::milliseconds(100)) return;
  last_ = now;
  std::string line = whole_;
  const double seconds = std::chrono::duration<double>(now - begin_).count();
  if (!whole_.empty() && share_ > 0) {
    line += " " + std::to_string(static_cast<int>(100 * share_)) + " %";
    if (seconds > 1) line += ", " + time_text(seconds * (1 - share_) / share_) + " left";
  }
  line += (line.empty() || part_.empty() ? "" : "; ") + part_;
  std::fprintf(stderr, "\r%s\033[K", line.substr(0, columns_of_terminal()).c_str());
  set_line_shown(true);
}

void Progress::clear() {
  if (last_ == Clock::time_point()) return;
  std::fprintf(stderr, "\r\033[K");
  set_line_shown(false);
  last_ = Clock::time_point();
}

}  // namespace kincal
