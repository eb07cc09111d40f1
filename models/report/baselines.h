// Compares the automatic path with simpler calibrations on held-out data: the rig as given (absent
// poses estimated from the training samples, as by evaluate()), and the mounts alone. All are
// judged as read (as the robot's own software uses raw readings) on the same held-out samples; with
// cross-validation, each on the fold that its calibration lacks.
//
// A calibration that is worse than its mounts alone has harmed the robot: the data do not determine
// all estimated parameters, or the arm's parameters absorb a mistake. It counts as worse if the
// lower end of the 95 % interval of the ratio of both rms is above 1 by more than kHarmless (paired
// by block: rms_ratio_interval() of analysis/held_out.h).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../analysis/held_out.h"
#include "../calibration/calibration.h"

namespace kincal {

constexpr double kHarmless = 0.01;  // of the rms: a smaller difference is irrelevant

/// A Baseline is a row of the comparison: the rms of one sensor's held-out residuals with raw
/// readings (poses: one row of translations and one of rotations) by three calibrations. NaN: none.
struct Baseline {
  std::string sensor, unit;
  long points = 0, blocks = 0;
  bool by_target = false;  // blocks are targets
  double rig = kNan, mounts = kNan, automatic = kNan;
  double ratio = kNan;  // automatic / mounts
  Interval of_ratio = {};
  bool worse() const { return of_ratio.low > 1 + kHarmless; }
};

struct Baselines {
  bool cross_validated = false;  // else the held-out samples
  bool rig = false;              // the rig gives poses, so it can be judged as given
  std::vector<Baseline> rows;
};

/// BaselineSums are residuals of the same held-out samples by three calibrations.
struct BaselineSums {
  HeldOutSums rig, mounts, automatic;
};

/// Adds the held-out residuals of the rig as given (without steps) and of the mounts alone, with
/// the shared values `mounts`. `index` is as in HeldOutSums::add(). @throws Cancelled
void add_baselines(const Rig& given, const Solution& solution, const VectorXd& mounts,
                   const CalibrationOptions& options, const std::vector<int>& index,
                   BaselineSums& sums);

/// Returns the shared values with only the mounts estimated from the training samples of an
/// automatic solution; nullopt: no start. @throws Cancelled
std::optional<VectorXd> mounts_alone(const Solution& solution, const CalibrationOptions& options);

/// Compares the calibrations on data where both the mounts alone and the whole calibration could be
/// judged.
std::vector<Baseline> compare_baselines(const Rig& rig, const Blocks& blocks,
                                        const BaselineSums& sums);

/// Returns whether a rig gives the pose of a sensor or of a mounted target.
bool gives_poses(const Rig& rig);

}  // namespace kincal
