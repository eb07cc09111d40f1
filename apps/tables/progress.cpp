#include "progress.h"

#include <unistd.h>

#include <cstdio>

namespace kincal {

Progress::Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO)) {}

void Progress::update(const std::string& step, int iteration, double chi2, double damping) {
  if (quiet_) return;
  if (step != step_) finish();
  step_ = step;
  if (iteration == 0) {
    if (terminal_) std::fprintf(stderr, "\r\033[K%s: starting values", step.c_str());
    iteration_ = 0;
    return;
  }
  iteration_ = iteration;
  chi2_ = chi2;
  if (terminal_)
    std::fprintf(stderr, "\r\033[K%s: iteration %d, chi2 %.8g, damping %.0e", step.c_str(),
                 iteration, chi2, damping);
}

void Progress::interrupted() {
  if (terminal_ && !quiet_ && !step_.empty()) std::fprintf(stderr, "\n");
  step_.clear();
}

void Progress::finish() {
  if (quiet_ || step_.empty() || iteration_ == 0) return;
  std::fprintf(stderr, "%s%s: %d iterations, chi2 %.8g\n", terminal_ ? "\r\033[K" : "",
               step_.c_str(), iteration_, chi2_);
  step_.clear();
}

}  // namespace kincal
