// Derivatives compared with differences, for whoever writes a sensor or a joint model: wrong ones
// still converge, slowly, and give wrong sigmas.
//
// Both functions return the largest error of a derivative, divided by the derivative where that is
// above 1. Differences are central, with a step of 1e-6 (of numbers above 1 in size: times that),
// and know a derivative of ordinary size to some 1e-9: derivatives are right where the error is
// below 1e-6. Where a residual is undefined at the point or one step beside it, it is infinite.
#pragma once

#include <vector>

#include "sensor.h"

namespace kincal {

/// Checks SensorModel::evaluate() at a view: the derivatives of its residuals by a motion of the
/// target, by the first `parameters` numbers of view.parameters (all that the sensor has), by the
/// target's points where it sees points, and of a scanning sensor by a motion of its own side and
/// by the numbers of its joint.
double check_jacobian(const SensorModel& sensor, const ViewInput& view, int parameters = 0);

/// Checks JointModel::by_reading() and by_own() at a reading, with the model's numbers.
double check_jacobian(const JointModel& model, double reading, const std::vector<double>& own);

}  // namespace kincal
