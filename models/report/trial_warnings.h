// Words about what was tried beside the calibration itself: other priors, fewer samples, fewer
// numbers.
#pragma once

#include <string>
#include <vector>

#include "report.h"

namespace kincal {

/// Returns "3 mm", "3 mrad", or "3 px": metres and radians in thousandths.
std::string shown_text(double value, const std::string& unit);

/// Warns of models of the data that are likelier than the groups (automatic path): a prior of the
/// rig that they contradict, a scale of the whole arm, gears.
void warn_of_other_models(const Report& report, Notices& out);
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
