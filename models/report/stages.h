// The held-out errors of a calibration with bending and error curves, and of each calibration
// before the next of these was added (Stage of automatic/outcome.h), on the same samples.
//
// Each stage is compared with the one before by the ratio of both rms as read, with the paired
// jackknife over blocks of analysis/held_out.h: what makes a sample hard for both does not widen
// the interval, and samples of any number of points count by their points. Nothing is decided by
// it.
#pragma once

#include <string>
#include <vector>

#include "../analysis/held_out.h"
#include "../automatic/outcome.h"

namespace kincal {

/// A StageError is the rms of one sensor's held-out residuals, as read, at one stage (poses: one of
/// translations and one of rotations).
struct StageError {
  std::vector<std::string> added;  // groups that the stage before lacks; of the first stage none
  std::string sensor, unit;
  long points = 0, blocks = 0;
  bool by_target = false;  // blocks are targets
  double rms = kNan;
  double ratio = kNan;  // to the stage before; NaN: first stage
  Interval of_ratio;
};

struct StageErrors {
  bool cross_validated = false;  // else the held-out samples
  std::vector<StageError> rows;  // by sensor, then by stage
};

/// Returns the errors from the sums of the stages and, last, of the final calibration with the
/// groups `further`. Points that some stage cannot judge are left out.
std::vector<StageError> compare_stages(const Rig& rig, const Blocks& blocks,
                                       const std::vector<Stage>& stages,
                                       const std::vector<std::string>& further,
                                       const std::vector<HeldOutSums>& sums);

}  // namespace kincal
