// Words about what was tried beside the calibration itself: other priors, fewer samples, fewer
// numbers.
#pragma once

#include <string>
#include <vector>

#include "report.h"

namespace kincal {

/// Returns "3 mm", "3 mrad", or "3 px": metres and radians in thousandths.
std::string shown_text(double value, const std::string& unit);

/// Warns of priors of the rig that the data contradict (automatic path).
void warn_of_doubted_priors(const Report& report, Notices& out);
/// Warns where held-out samples contradict what the others say, or cannot be judged at all.
void warn_of_contradicted(const Report& report, Notices& out);
/// Warns where the robot's own software, which takes readings as they are, sees larger errors than
/// before.
void warn_of_use(const Residuals& residuals, Notices& out);
/// Warns of so many outliers that the majority need not be right.
void warn_of_rejected(const Report& report, Notices& out);
/// Warns where the mounts alone are better on data that were not used.
void warn_of_held_out(const Validation& validation, Notices& out);

}  // namespace kincal
