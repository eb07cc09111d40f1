// What result.json says of a calibration: a function a section, put together in result_json(). Not for users of the library
// (they have Report): it brings the JSON library along and is not installed.
#pragma once

#include <string>
#include <vector>

#include "../../models/report/report.h"
#include "../../models/doctor/doctor.h"
#include "json_values.h"

namespace kincal {

/// The status is named as result.json has it.
std::string status_name(Status status);

/// All of result.json but for the program's version, the inputs and the changes of the robot.
Json result_json(const Report& report);

/// "sensors" of result.json as text; `before`: with rms_before.
std::string evaluation_json(const Evaluation& evaluation, const std::vector<Warning>& warnings);

/// [{id, text, where, chi2_as_is, chi2_corrected}]
Json findings_json(const std::vector<Finding>& findings);
/// {findings, chi2, dof, verdict, tested}
Json diagnosis_json(const Diagnosis& diagnosis);

}  // namespace kincal
