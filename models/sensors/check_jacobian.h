// Compares derivatives with differences, for authors of sensors and joint models: wrong derivatives
// still converge, slowly, and give wrong sigmas.
//
// Both functions return the largest error of a derivative, divided by the derivative where that is
// above 1. Differences are central with a step of 1e-6 (times the value's size if that is above 1)
// and accurate to about 1e-9 for a derivative of ordinary size: derivatives are correct if the
// error is below 1e-6. The error is infinite if a residual is undefined at the point or one step
// beside it.
#pragma once

#include <vector>

#include "sensor.h"

namespace kincal {

/// Checks SensorModel::evaluate() at a view: the derivatives of its residuals by a motion of the
/// target, by the first `parameters` components of view.parameters (the number that the sensor
/// has), and by the target's points if the sensor sees points; for a scanning sensor also by a
/// motion of its own side and by the parameters of its joint.
double check_jacobian(const SensorModel& sensor, const ViewInput& view, int parameters = 0);

/// Checks JointModel::by_reading() and by_own() at a reading and at the model's parameters `own`.
double check_jacobian(const JointModel& model, double reading, const std::vector<double>& own);

}  // namespace kincal
