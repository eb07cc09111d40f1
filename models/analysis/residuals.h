// Residuals of every view: after a calibration, before it, and as read (raw readings taken as
// exact, as the robot's own software uses them), of the training and of the held-out samples; and
// the root mean squares that tables show.
//
// Shared parameters are fixed. Free targets, joint errors and parameters that only held-out samples
// see are estimated from the judged samples: one by one, or together where several depend on the
// same parameter. A pose among these that the rig does not give starts in closed form.
#pragma once

#include <string>
#include <vector>

#include "../../solver/progress.h"
#include "../calibration/solution.h"
#include "../rig/numbers.h"

namespace kincal {

/// SplitStatistics are those of one sensor's residuals in one split: root mean squares over points
/// (over views, if the sensor measures poses). NaN: none.
struct SplitStatistics {
  long points = 0;
  double rms_before, rms, rms_as_read;                         // px or m; of poses the translation
  double rotation_before, rotation, rotation_as_read;          // rad, poses only
  double rms_uncorrected = kNan, rotation_uncorrected = kNan;  // as read, by another solution
  double whitened_squared = 0;                                 // squares behind `rms`, whitened
  long whitened_count = 0;
};

struct SensorResult {
  std::string name, unit;
  bool measures_pose = false;
  SplitStatistics train, test;
};

/// An UndefinedSample cannot be evaluated: at every pose of its targets, some point lies behind a
/// camera.
struct UndefinedSample {
  std::string id;
  bool before = false;  // at the initial values; else (held out) at the estimate
};

/// An Unfinished is a column of root mean squares for which a minimisation (of free targets, joint
/// errors or parameters that only held-out samples see) did not converge: its values are not final.
struct Unfinished {
  bool train = true;                 // the split
  std::string column;                // "rms", "rms_as_read", "rms_before"
  std::vector<std::string> samples;  // samples of the minimisation
};

struct Residuals {
  std::vector<SensorResult> sensors;       // sensors with views
  std::vector<ViewResiduals> after;        // of all samples
  std::vector<ViewResiduals> before;       // the same views in the same order, raw ones only
  std::vector<ViewResiduals> as_read;      // of the held-out samples, raw ones only
  std::vector<UndefinedSample> undefined;  // missing from these
  std::vector<Unfinished> unfinished;
};

struct Linearisation;
/// Returns the residuals of a solution. It throws nothing; samples that cannot be evaluated are in
/// `undefined`.
Residuals residuals(const Linearisation& at);
/// Returns the same from given residuals of the last problem (Estimation::residuals()). @throws
/// Cancelled
Residuals residuals(const Linearisation& at, std::vector<ViewResiduals> views,
                    const Progress& progress = {});

/// Adds the rms as read of the solution `rigid`, for software that cannot use all of the
/// calibration. @throws Cancelled
void add_uncorrected(const Solution& rigid, Residuals& residuals);

/// Returns only the as-read residuals of the held-out samples, with these shared values in place of
/// the solution's.
Residuals held_out_as_read(const Solution& solution, const VectorXd& shared);

/// An Evaluation is the table of residuals at given parameters.
struct Evaluation {
  bool converged = true;  // the estimation of targets and joint errors converged everywhere
  std::vector<Unfinished> unfinished;
  double chi2 = 0;
  long dof = 0;
  std::vector<SensorResult> sensors;   // without rms_before
  std::vector<ViewResiduals> views;    // the residuals behind their rms
  std::string worst_sample;            // sample with the largest part of the views' sum of squares
  double worst_share = 0;              // that part, 0 .. 1
  std::vector<std::string> undefined;  // samples missing from these, as UndefinedSample
  std::vector<std::string> open;  // poses absent from the rig that were estimated in each split
  std::vector<std::string> without_effect;  // names to be estimated on which no measurement depends
};

/// Evaluates both splits at the rig's values. Free targets, joint errors, the parameters named in
/// `free` and the poses that the rig leaves open (rig/selection.h) are estimated in each split.
/// @throws NameError beginning with "free[N]"; std::runtime_error if no sample can be evaluated;
/// Cancelled.
Evaluation evaluate(const Recording& recording, NoiseMode noise,
                    const std::vector<std::string>& free, const Progress& progress = {});

/// Returns whether the errors of neighbouring points in the training views are correlated. Noise is
/// not correlated; a bent, turned, shifted or wrongly sized object causes correlation.
bool neighbours_err_alike(const std::vector<Sample>& samples,
                          const std::vector<ViewResiduals>& views);
/// Returns whether a few residuals of a sensor in training views are far larger than its others:
/// the middle one is far below the root mean square (of noise it is two thirds of it).
bool few_are_far(const std::vector<Sample>& samples, const std::vector<ViewResiduals>& views);

/// Returns the result of a sensor without any view.
SensorResult unseen(const Sensor& sensor);

}  // namespace kincal
