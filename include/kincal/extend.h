// Interfaces for a sensor or a joint model of your own; docs/adding-a-sensor.md makes one of each.
//
//   SensorModel        The interface of sensors: ViewInput, Columns, MeasurementKind, NoisePart.
//   PointwiseSensor    Makes a SensorModel from a function of one point.
//   Scan               The joint that moves while a sensor scans.
//   JointModel         The interface of joint models; JointNumber, LinearJoint, linear_joint().
//   joint_models()     The built-in joint models, by name.
//   check_jacobian()   Compares derivatives with differences.
//
// Poses, rotations and twists are included (exp_se3(), log_so3(), adjoint() ...). A rig has a model
// in Sensor::model and JointSettings::model: kincal.h.
#pragma once

#include "detail/kinematics/transform.h"
#include "detail/models/joints/joint_model.h"
#include "detail/models/joints/joint_models.h"
#include "detail/models/sensors/check_jacobian.h"
#include "detail/models/sensors/sensor.h"
