// What calibrate prints of a result: residuals, parameters, what is weak, warnings.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../io/results/results.h"
#include "../../models/report/report.h"

namespace kincal {

/// Shows the rms of each sensor after the calibration, train and held out. `before` adds the column
/// of the rms before it.
std::string residual_table(const std::vector<SensorResult>& sensors, bool before);
/// Shows what the doctor found: findings, what was tested, the verdict.
std::string diagnosis_text(const Diagnosis& diagnosis);
/// Returns why a calibration could not start: what the doctor found first, then where it ended.
std::string no_start_text(const std::string& message, const std::optional<Diagnosis>& found);
/// Shows the essentials, in 80 columns: verdict, errors, largest changes, warnings, and what
/// options asked for (validation, restarts, outliers taken out).
std::string short_text(const Report& report, const ResultFiles& files);
/// Shows the whole report: verdict, steps, tables, what is not in the URDF, warnings.
std::string report_text(const Report& report, const ResultFiles& files);

}  // namespace kincal
