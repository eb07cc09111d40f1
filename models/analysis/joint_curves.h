// Error curves of joints: the part of a joint model that is not scale * reading + offset
// (joints/curve_joint.h), with its standard deviation.
//
// With the terms t(q) of that part at a reading q, linear in its parameters, and their mean over
// the readings of the training samples, the curve is (t(q) - mean)' x and its variance
// (t(q) - mean)' C (t(q) - mean). The mean is left out because the offset expresses it as well: the
// data determine only their sum. Where no sample was, C is that of the prior.
#pragma once

#include <string>
#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// A JointCurve is the error curve of a joint over its range: rad, or m of a sliding joint.
struct JointCurve {
  int joint = -1;
  std::vector<double> reading, error;
  std::vector<double> sigma;  // of each error; NaN: not determined
  double rms = 0;             // of the errors at the readings of the training samples
};
/// Returns the curves of joints whose model has further terms, unless these are all zero and fixed.
std::vector<JointCurve> joint_curves(const Solution& solution);

}  // namespace kincal
