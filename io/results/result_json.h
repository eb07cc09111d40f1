// What result.json says of a calibration: a function a section, put together in result_json(). Not for users of the library
// (they have CalibrationResult): it brings the JSON library along and is not installed.
#pragma once

#include <nlohmann/json.hpp>

#include "../../models/calibration/calibration.h"
#include "../../models/doctor/doctor.h"

namespace kincal {

using Json = nlohmann::ordered_json;

/// null where not finite.
Json number(double v);
Json numbers(const std::vector<double>& v);
Json vector3(const Vector3d& v);
/// {xyz, quat}
Json pose(const Pose& p);

/// All of result.json but for the program's version, the inputs and the changes of the robot.
Json result_json(const Calibration& calibration, const CalibrationResult& result);

/// [{id, text, where, chi2_as_is, chi2_corrected}]
Json findings_json(const std::vector<Finding>& findings);
/// {findings, chi2, dof, verdict, tested}
Json diagnosis_json(const Diagnosis& diagnosis);

}  // namespace kincal
