// kincal on a robot's own computer: one calibration of explicit steps, without files. It needs the
// component `core`, which needs Eigen alone, and can be read without exceptions and run-time types.
//
//   The data           Rig (with Tree, Sensor, Target, Step), Sample, make_recording(); sensors by
//                      make_camera() ..., joint models by joint_models(); ParameterTable (the
//                      parameters) and Configuration (all poses).
//   Calibration        Runs the steps of a rig, also again with other measurements; Solution.
//   Monitor            Samples one at a time: the fit of each, and what has moved since.
//
// kincal.h has the other functions of kincal.
#pragma once

// Robots, sensors, targets, samples
#include "detail/kinematics/floating.h"
#include "detail/kinematics/transform.h"
#include "detail/kinematics/tree.h"
#include "detail/models/joints/joint_models.h"
#include "detail/models/rig/configuration.h"
#include "detail/models/rig/folds.h"
#include "detail/models/rig/parameters.h"
#include "detail/models/rig/recording.h"
#include "detail/models/rig/rig.h"
#include "detail/models/rig/samples.h"
#include "detail/models/rig/scales.h"
#include "detail/models/rig/selection.h"
#include "detail/models/rig/targets.h"
#include "detail/models/sensors/sensors.h"
// Calibrations
#include "detail/models/calibration/calibration.h"
#include "detail/models/calibration/plan.h"
#include "detail/models/calibration/solution.h"
// Afterwards
#include "detail/models/monitor/monitor.h"
#include "detail/models/monitor/static_view.h"
