// What result.json has of a calibration: a function a section, put together in result_json(). It is
// not for users of the library (they have Report): it brings the JSON library along and is not
// installed.
#pragma once

#include <string>
#include <vector>

#include "../../models/doctor/doctor.h"
#include "../../models/report/report.h"
#include "json_values.h"

namespace kincal {

/// Returns the name that a status has in result.json.
std::string status_name(Status status);

/// Returns all of result.json but for the program's version, the inputs and the changes of the
/// robot.
Json result_json(const Report& report);

/// Returns {chi2, dof, sensors, warnings}.
Json evaluation_json(const Evaluation& evaluation, const Notices& warnings);

/// Returns [{id, text, where, chi2_as_is, chi2_corrected}].
Json findings_json(const Notices& findings, const std::vector<NoticeKind>& about = {});
/// Returns {use, text, why, next, see}.
Json verdict_json(const Verdict& verdict);
/// Returns {findings, chi2, dof, verdict, tested}.
Json diagnosis_json(const Diagnosis& diagnosis);

}  // namespace kincal
