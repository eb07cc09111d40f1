// How well a sample fits the calibration, and the noise that was learned: results of a monitor.
#pragma once

#include <string>
#include <vector>

namespace kincal {

enum class SampleState {
  fits,
  outlier,        // does not fit; left out unless the next ones do not fit either
  tells_nothing,  // no view has more measurements than private unknowns
  undefined       // cannot be evaluated: a point behind a camera, no start for a target
};

/// A SensorInnovation is the fit of one sensor to the prediction from the calibration and the
/// sample's other sensors.
struct SensorInnovation {
  int sensor = -1;
  double chi2 = 0;  // with the noise factors before this sample, alike in all samples
  double dof = 0;
  double probability = 1;  // of a larger chi2
};

struct Innovation {
  SampleState state = SampleState::fits;
  std::string why;  // undefined
  double chi2 = 0, dof = 0, probability = 1;
  std::vector<SensorInnovation> sensors;
  double log_odds = 0;       // log R of the drift watch
  bool alarm = false;        // something has moved: Monitor::moved()
  bool unexplained = false;  // outliers in a row, and no group that moved explains them
};

/// A NoiseSeen is a noise factor: the noise of a part of a sensor (SensorModel::noise_parts()), or
/// of a joint's readings, over the stated one.
struct NoiseSeen {
  int sensor = -1;  // -1: a joint's noise
  int part = 0;     // of the sensor, or the joint
  double factor = 1, residuals = 0;
};

}  // namespace kincal
