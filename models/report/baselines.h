// Simpler calibrations beside that of the automatic path, on data that none of them used: the rig
// as it is (poses that it leaves open estimated from the training samples, as evaluate() would),
// and the mounts alone. All are judged as read, what the robot's own software will see, on the same
// held-out samples; cross-validated, each on the fold that its calibration lacks.
//
// A calibration that is worse than its mounts alone has harmed the robot: too many numbers are free
// for the data, or a mistake somewhere is taken up by the arm's numbers. It is called worse where
// the ratio of both rms is above 1 by more than kHarmless at the lower end of its 95 % interval
// (paired by block: rms_ratio_interval() of analysis/held_out.h).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../analysis/held_out.h"
#include "../calibration/calibration.h"

namespace kincal {

constexpr double kHarmless = 0.01;  // of the rms: less than this matters to nobody

/// A Baseline is a row of the comparison: the rms of one sensor's held-out residuals with raw
/// readings (poses: one row of translations and one of rotations) by three calibrations; NaN: none.
struct Baseline {
  std::string sensor, unit;
  long points = 0, blocks = 0;
  bool by_target = false;  // blocks are targets
  double rig = kNan, mounts = kNan, automatic = kNan;
  double ratio = kNan;  // automatic / mounts
  Interval of_ratio;
  bool worse() const { return of_ratio.low > 1 + kHarmless; }
};

struct Baselines {
  bool cross_validated = false;  // else the held-out samples
  bool rig = false;              // the rig gives poses, so that it can be judged as it is
  std::vector<Baseline> rows;
};

/// BaselineSums are residuals of the same held-out samples by three calibrations.
struct BaselineSums {
  HeldOutSums rig, mounts, automatic;
};

/// Adds the held-out residuals of the rig as given, which has no steps, and of the mounts alone,
/// whose shared values are `mounts`; `index` as of HeldOutSums::add(). @throws Cancelled
void add_baselines(const Rig& given, const Solution& solution, const VectorXd& mounts,
                   const CalibrationOptions& options, const std::vector<int>& index,
                   BaselineSums& sums);

/// Returns the shared values with the mounts alone estimated from the training samples of a
/// solution of the automatic path; nullopt: no start. @throws Cancelled
std::optional<VectorXd> mounts_alone(const Solution& solution, const CalibrationOptions& options);

/// Compares on what both the mounts alone and the whole calibration could be judged on.
std::vector<Baseline> compare_baselines(const Rig& rig, const Blocks& blocks,
                                        const BaselineSums& sums);

/// Returns whether a rig gives the pose of a sensor or of a mounted target.
bool gives_poses(const Rig& rig);

}  // namespace kincal
