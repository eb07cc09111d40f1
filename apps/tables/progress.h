// How far a calibration is, on standard error.
#pragma once

#include <string>

namespace kincal {

/// Progress shows a live line per iteration on a terminal, a plain line per step elsewhere; on
/// standard error.
class Progress {
 public:
  explicit Progress(bool quiet);
  void update(const std::string& step, int iteration, double chi2, double damping);
  /// Ends the last step's line.
  void finish();
  /// Ends the line where it is.
  void interrupted();

 private:
  bool quiet_, terminal_;
  std::string step_;
  int iteration_ = 0;
  double chi2_ = 0;
};

}  // namespace kincal
