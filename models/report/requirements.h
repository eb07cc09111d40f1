// Tolerances: whether the error of a calibration is small enough.
#pragma once

#include <string>
#include <vector>

namespace kincal {

/// A Requirement is a tolerance. For a sensor it applies to the rms with raw readings: of the
/// held-out samples if they have points of the sensor, else cross-validated, else of training. For
/// a frame it applies to the rms of the predicted sigma over the samples' postures (without
/// samples: over the joint limits), of the calibration alone.
struct Requirement {
  enum class Quantity { sensor, frame, chi2_per_dof };
  std::string text;  // as given
  Quantity quantity = Quantity::sensor;
  std::string name;  // of the sensor or frame
  bool rotation = false;
  double limit = 0;   // m, px, rad
  std::string unit;   // as given
  double factor = 1;  // limit of `unit` in m, px, rad
};
struct Judgement {
  Requirement requirement;
  std::string from;  // `test`, `cross_validation`, `train`, `samples`, `limits`, ``
  double measured;   // m, px, rad; NaN: none
  std::string why;   // reason: nothing was measured, or it does not count
  bool met = false;
};

/// Returns "sensor/tracker<0.2mm: 0.169 mm, held out", or the reason why it cannot be measured.
std::string judgement_text(const Judgement& judgement);

}  // namespace kincal
