// A calibration around one posture.
#pragma once

#include <string>

#include "../../models/trials/local.h"

namespace kincal {

/// Shows local offsets, their radius, and the errors with and without them.
std::string local_report(const Rig& rig, const LocalCalibration& local);

}  // namespace kincal
