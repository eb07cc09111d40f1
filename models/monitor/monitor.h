// Checks whether the robot still matches its calibration. A monitor receives samples one at a time.
// It reports how well each fits, and whether something has moved since: what, by how much, since
// when.
//
// A sample is linearised at the calibrated values, with poses of free targets and joint errors
// estimated from this sample alone. Its residuals, divided by their sigmas, are split by orthogonal
// transformations (estimation.h, noise_rows()) into
//   - a part that no parameter changes: the noise of the sensor alone (scans have none, because
//     their derivatives depend on the noise);
//   - a part that only the sample's own unknowns change, which has no information;
//   - the rest, y = J d + e: the difference of all parameters from the calibrated values. Its
//     innovation (drift_watch.h) has the covariance of the noise, of the joints' readings and of
//     the uncertainty that remains after the calibration and the earlier samples.
// Each kind of noise (of a part of a sensor or of a joint's readings) has a factor over the stated
// noise, from all samples so far, and each sensor's noise differs from sample to sample as it did
// so far (noise_factors.h).
// A sample is an outlier if one of these parts is larger than it is by chance in kOutlier of all
// samples. A single outlier is left out. From the second in a row, the drift watch counts them, the
// first included: outliers are isolated, and a change persists. No outlier changes the estimate. If
// outliers raise the alarm and the most likely group does not explain them, it is no drift: they
// are unexplained.
//
// A group is a set of parameters that move together (moving_groups.h).
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "../rig/recording.h"
#include "drift_watch.h"
#include "sample_fit.h"

namespace kincal {

/// A CalibratedState is the result of a calibration: values (ParameterTable's layout) and the
/// covariance of the estimated components; all others count as exact.
struct CalibratedState {
  Rig rig;
  VectorXd values;
  std::vector<Component> columns;
  MatrixXd covariance;             // 0 along `undetermined`
  std::map<int, Matrix6d> charts;  // J_r(xi) of partly estimated poses, by parameter
  MatrixXd undetermined;           // directions that the data do not determine, one per column
};

struct MonitorOptions {
  double samples_between_alarms = 10000;  // mean, while nothing has moved
};

/// Returns how many bytes a monitor of this calibration takes before its first sample, at most 5 %
/// above, by the sizes: nothing is made. @throws std::invalid_argument: columns that do not exist
size_t monitor_memory(const CalibratedState& state);

/// A Recalibration is a calibration from the last one and later samples.
struct Recalibration {
  CalibratedState state;  // for another monitor, with this one's columns
  VectorXd change;        // of the columns, from the last calibration
  std::vector<char>
      undetermined;  // by column: it may have moved, and the samples do not determine it
  int samples = 0;   // used; the others do not fit or cannot be evaluated
};

class Monitor {
 public:
  /// @throws std::invalid_argument: sizes that do not match
  explicit Monitor(CalibratedState state, const MonitorOptions& options = {});
  ~Monitor();
  Monitor(const Monitor&);
  Monitor(Monitor&&) noexcept;
  Monitor& operator=(Monitor&&) noexcept;

  /// Prepares for samples of this form (the same views of the same points), so that the first of
  /// them allocates nothing. This one does not count. @throws as add()
  void prepare(const Sample& like);
  /// Adds a sample of the rig. If it throws, the monitor is unchanged.
  /// @throws std::invalid_argument: sizes or indices are not those of the rig, or a value is not
  /// finite
  Innovation add(const Sample& sample);
  /// The same into `to`, whose memory is used again. The first sample of a form allocates unless it
  /// was prepared, and so do samples that no start explains, views of few or nearly flat points of
  /// a free target, and outliers during an alarm; others do not.
  void add(const Sample& sample, Innovation& to);

  /// Returns the groups that may have moved, most likely first.
  std::vector<Moved> moved() const;
  /// Starts counting changes again. With `accept`, the estimate includes the most likely change of
  /// moved() from now on.
  void restart(bool accept);

  /// Recalibrates from the calibration, with the uncertainty of these groups enlarged by their
  /// usual changes, and the samples of a window, by this number of Gauss-Newton iterations. Of the
  /// samples that do not fit after an iteration, the worse half is left out of the next. The
  /// monitor is unchanged.
  /// @throws std::invalid_argument: no such group, less than one iteration, or a sample that add()
  /// refuses
  Recalibration recalibrated(const std::vector<Sample>& window, const std::vector<int>& groups,
                             int iterations = 5) const;

  /// Returns the learned state as bytes for load().
  std::string save() const;
  /// Loads the learned state of a monitor with the same calibration and options. If it throws, the
  /// monitor is unchanged. @throws std::invalid_argument: the bytes are damaged, truncated, of
  /// another version, or belong to another calibration
  void load(const std::string& bytes);

  const std::vector<DriftGroup>& groups() const;
  /// Returns the component of each column.
  const std::vector<Component>& columns() const;
  /// Both return the current estimate of the columns: the differences from the calibrated values,
  /// and their covariance.
  const VectorXd& difference() const;
  MatrixXd covariance() const;
  std::vector<NoiseSeen> noise() const;
  long samples() const;   // added
  long outliers() const;  // of these
  const ParameterTable& table() const;
  const Rig& rig() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace kincal
