// The CSV files of a result: residuals and covariance written, and read again.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "../../models/report/report.h"

namespace kincal {

std::string residuals_csv(const Report& report);
/// Readings of the joints, their estimated errors and the poses of free targets, one line a sample.
std::string samples_csv(const Solution& solution);
/// Returns 1 where loops.csv has the points of every sample; of thousands of samples, which would
/// make it larger than all else together, every so-manieth (by its place in the file) of them.
size_t loops_every(const Report& report);
/// Residuals of every point carried from one sensor into another, one line each, of the samples
/// that loops_every() says.
std::string loops_csv(const Report& report);
/// ReportedCovariance is what a result says of the errors of its numbers: that of the last step, or
/// of what it predicts (Prediction). Rows and columns of what the data do not determine are NaN.
struct ReportedCovariance {
  std::vector<std::string> names;  // of components
  MatrixXd matrix;
};
ReportedCovariance reported_covariance(const Solution& solution);
/// Rows and columns of what the data do not determine are empty: a covariance of it there is none.
std::string covariance_csv(const Solution& solution);

/// The normal equations of the data alone: lower triangle, and what they pull to.
std::string information_csv(const Report& report);

/// Returns a field, quoted where commas, quotes or line ends ask for it.
std::string csv_field(const std::string& text);

/// Visits the rows of a CSV text as this program writes them; the fields live until the next one.
void for_each_csv_row(const std::string& text,
                      const std::function<void(const std::vector<std::string>&)>& visit);

/// Reads a field as a finite number; `place` (path:line) begins the message of the error. @throws
/// InputError
double csv_number(const std::string& text, const std::string& place);

}  // namespace kincal
