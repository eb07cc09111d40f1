// Is the robot still the one that was calibrated? A monitor is given samples one at a time and says
// of each how well it fits the calibration, and of all whether something has moved since: what, by
// how much, since when.
//
// A sample is linearised at the calibrated values, with poses of free targets and errors of joints
// as this sample alone has them. Its residuals, divided by their sigmas, are split by orthogonal
// transformations (estimation.h, noise_rows()) into
//   - what no parameter changes: the noise of the sensor alone (scans have no such part: their
//     derivatives depend on the noise);
//   - what only the sample's own unknowns change, which says nothing;
//   - the rest, y = J d + e: how all parameters differ from the calibrated values. Its innovation
//     (drift_watch.h) has the covariance of the noise, of the joints' readings and of the
//     uncertainty that the calibration and the samples before leave.
// Each kind of noise, of a part of a sensor or of a joint's readings, has a factor over the stated
// one, that of all samples so far; it begins at 1, as if kNoiseKnown residuals had been seen.
// A sample is an outlier where one of these parts is larger than by chance in kOutlier of all
// samples. One outlier is left out. From the second in a row on the drift watch counts them, the
// first too: outliers come alone, and what has moved stays there. The estimate is not changed by
// any. Where outliers raise the alarm and the likeliest group leaves them outliers, it is no drift:
// they are unexplained.
//
// A group is what moves together (moving_groups.h).
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "../rig/recording.h"
#include "drift_watch.h"

namespace kincal {

/// A CalibratedState is the result of a calibration: values (ParameterTable's layout) and the
/// covariance of the components that were estimated; all others are known exactly.
struct CalibratedState {
  Rig rig;
  VectorXd values;
  std::vector<Component> columns;
  MatrixXd covariance;             // 0 along `undetermined`
  std::map<int, Matrix6d> charts;  // J_r(xi) of partly estimated poses, by parameter
  MatrixXd undetermined;           // directions that the data left open, one a column
};

struct MonitorOptions {
  double samples_between_alarms = 10000;  // the mean, while nothing has moved
};

enum class SampleState {
  fits,
  outlier,        // it does not fit; left out until others do not fit either
  tells_nothing,  // no view of it has more measurements than unknowns of its own
  undefined       // nothing can be computed of it: a point behind a camera, no start for a target
};

/// A SensorInnovation is how a sensor fits what the calibration, and the sample's other sensors,
/// let expect.
struct SensorInnovation {
  int sensor = -1;
  double chi2 = 0;  // with the noise factors as they were before this sample
  double dof = 0;
  double probability = 1;  // of more than that
};

struct Innovation {
  SampleState state = SampleState::fits;
  std::string why;  // undefined
  double chi2 = 0, dof = 0, probability = 1;
  std::vector<SensorInnovation> sensors;
  double log_odds = 0;       // log R of the drift watch
  bool alarm = false;        // something has moved; Monitor::moved() says what
  bool unexplained = false;  // outliers in a row, and no group that moved explains them
};

/// A NoiseSeen is a noise factor: the noise of a part of a sensor (SensorModel::noise_parts()), or
/// of a joint's readings, over the stated one.
struct NoiseSeen {
  int sensor = -1;  // -1: of a joint
  int part = 0;     // of the sensor, or the joint
  double factor = 1, residuals = 0;
};

/// A Recalibration is a calibration by the last one and some samples since then.
struct Recalibration {
  CalibratedState state;           // for another monitor; its columns are this one's
  VectorXd change;                 // of the columns, from the last calibration
  std::vector<char> undetermined;  // by column: it may have moved, and the samples do not tell
  int samples = 0;                 // that count; the others do not fit or cannot be evaluated
};

class Monitor {
 public:
  /// @throws std::invalid_argument: sizes that do not fit
  explicit Monitor(CalibratedState state, const MonitorOptions& options = {});
  ~Monitor();
  Monitor(const Monitor&);
  Monitor(Monitor&&) noexcept;
  Monitor& operator=(Monitor&&) noexcept;

  /// Takes a sample of the rig. Nothing changes where it throws.
  /// @throws std::invalid_argument: sizes or indices are not those of the rig, or a number is not
  /// finite
  Innovation add(const Sample& sample);

  /// Returns what may have moved, the likeliest first.
  std::vector<Moved> moved() const;
  /// Counts changes from now on. With `accept` the likeliest of moved() has happened: the estimate
  /// contains it from now on.
  void restart(bool accept);

  /// Calibrates again: what the calibration knew, without what these groups may have moved by, and
  /// the samples of a window, with so many Gauss-Newton iterations. The worse half of the samples
  /// that do not fit after an iteration does not count in the next. The monitor stays as it is.
  /// @throws std::invalid_argument: no such group, or a sample as add() refuses it
  Recalibration recalibrated(const std::vector<Sample>& window, const std::vector<int>& groups,
                             int iterations = 5) const;

  /// Returns what the monitor has learnt, as bytes for load().
  std::string save() const;
  /// Takes over what a monitor of the same calibration and options has learnt. Nothing changes
  /// where it throws. @throws std::invalid_argument: the bytes are damaged, truncated, of another
  /// version, or belong to another calibration
  void load(const std::string& bytes);

  const std::vector<DriftGroup>& groups() const;
  /// Returns the component that every column is.
  const std::vector<Component>& columns() const;
  /// Returns what is known of the columns now: by how much they differ from the calibrated values,
  /// and the covariance of that.
  const VectorXd& difference() const;
  const MatrixXd& covariance() const;
  std::vector<NoiseSeen> noise() const;
  long samples() const;   // that were added
  long outliers() const;  // of these
  const ParameterTable& table() const;
  const Rig& rig() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace kincal
