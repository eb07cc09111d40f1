#include "progress_line.h"

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

ProgressLine::ProgressLine(bool quiet) : shown_(!quiet && isatty(STDERR_FILENO)) {}

void ProgressLine::Stage::go_on(const std::string& now, double done) {
  if (now != what || done < share || std::isnan(done)) begin = Clock::now();
  what = now;
  share = done;
}

std::string ProgressLine::Stage::text(Clock::time_point now) const {
  if (what.empty() || !(share > 0)) return what;
  std::string out = what + " " + std::to_string(static_cast<int>(100 * share)) + " %";
  const double seconds = std::chrono::duration<double>(now - begin).count();
  if (seconds > 1) out += ", " + time_text(seconds * (1 - share) / share) + " left";
  return out;
}

void ProgressLine::stage(const std::string& what, double share) {
  if (!shown_ || (std::isnan(share) && what == whole_.what)) return;
  const bool of_whole = !std::isnan(share) && (whole_.what.empty() || what == whole_.what);
  Stage& at = of_whole ? whole_ : part_;
  const bool is_new = what != at.what;
  at.go_on(what, share);
  if (of_whole && (is_new || share >= 1)) part_ = Stage();
  if (share >= 1) at = Stage();
  show(is_new || share >= 1);
}

Progress ProgressLine::progress() {
  return Progress([this](const Progress::News& news) {
    tell(news);
    return true;
  });
}

void ProgressLine::tell(const Progress::News& news) {
  if (!shown_) return;
  if (news.iteration < 0) return stage(news.what, news.share);
  if (news.iteration == 0) return stage(news.what + ": starting values", std::nan(""));
  char text[64];
  std::snprintf(text, sizeof text, ": iteration %d, chi2 %.8g", news.iteration, news.chi2);
  part_.go_on(news.what + text, std::nan(""));
  show(news.iteration == 1);
}

void ProgressLine::show(bool at_once) {
  const Clock::time_point now = Clock::now();
  if (!at_once && now - last_ < std::chrono::milliseconds(100)) return;
  last_ = now;
  std::string line = whole_.text(now), part = part_.text(now);
  line += (line.empty() || part.empty() ? "" : "; ") + part;
  std::fprintf(stderr, "\r%s\033[K", line.substr(0, columns_of_terminal()).c_str());
  set_line_shown(true);
}

void ProgressLine::clear() {
  if (last_ == Clock::time_point()) return;
  std::fprintf(stderr, "\r\033[K");
  set_line_shown(false);
  last_ = Clock::time_point();
}

}  // namespace kincal
