// kincal in a program of yours: everything but files (files.h), sensors and joint models of your
// own (extend.h) and the solver by itself (solver.h). It needs the component `models`.
//
//   core.h             The data, and calibrations of explicit steps.
//   study()            Does the same as the program `calibrate`; its Report, with Notice and
//   Verdict. Automatic          calibrate_automatically(), if the rig has no steps. Analyses
//   linearise() a solution, then residuals(), noise_levels(), explain(),
//                      leverage(), loops(), misfits(), errors of frames and of held-out samples.
//   Trials             estimate_noise(), cross_validate(), restarts(),
//                      calibrate_without_outliers(), calibrate_locally() around a posture.
//   diagnose()         Looks for mistakes in the input.
//   simulate()         Samples of a simulated robot.
//   Others             calibrate_intrinsics(): lenses without a robot. study_fleet(): results of
//                      many robots. evidence(): the odds of several models of the data.
#pragma once

// Calibrations
#include "core.h"
#include "detail/models/automatic/automatic.h"
// The quality of a solution
#include "detail/models/analysis/data_equations.h"
#include "detail/models/analysis/frames.h"
#include "detail/models/analysis/held_out.h"
#include "detail/models/analysis/leverage.h"
#include "detail/models/analysis/linearisation.h"
#include "detail/models/analysis/loops.h"
#include "detail/models/analysis/misfits.h"
#include "detail/models/analysis/noise_levels.h"
#include "detail/models/analysis/residuals.h"
#include "detail/models/analysis/trends.h"
#include "detail/models/analysis/weak_directions.h"
#include "detail/models/evidence/evidence.h"
// The same again, changed; mistakes
#include "detail/models/doctor/diagnosis.h"
#include "detail/models/doctor/doctor.h"
#include "detail/models/trials/cross_validation.h"
#include "detail/models/trials/estimate_noise.h"
#include "detail/models/trials/local.h"
#include "detail/models/trials/outliers.h"
#include "detail/models/trials/restarts.h"
// Everything in the right order, and its words
#include "detail/models/notices/notice.h"
#include "detail/models/report/report.h"
#include "detail/models/report/requirements.h"
#include "detail/models/report/study.h"
#include "detail/models/report/validation.h"
#include "detail/models/report/verdict.h"
#include "detail/models/report/warnings.h"
// Simulation, lenses, fleets
#include "detail/models/fleet/fleet.h"
#include "detail/models/intrinsics/intrinsics.h"
#include "detail/models/simulation/posture.h"
#include "detail/models/simulation/simulation.h"
