// The CSV files of a result: residuals and covariance written, and read again.
#pragma once

#include <string>
#include <vector>

#include "../../models/report/report.h"

namespace kincal {

std::string residuals_csv(const Report& report);
/// Rows and columns of what the data do not determine are empty: a covariance of it there is none.
std::string covariance_csv(const Solution& solution);

/// Returns a field, quoted where commas, quotes or line ends ask for it.
std::string csv_field(const std::string& text);

/// Reads the rows of a CSV file as this program writes them. @throws InputError
std::vector<std::vector<std::string>> read_csv(const std::string& path);

/// Reads a field as a finite number; `place` (path:line) begins the message of the error. @throws
/// InputError
double csv_number(const std::string& text, const std::string& place);

}  // namespace kincal
