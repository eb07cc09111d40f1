// What a calibration is going to do: its steps, and what the automatic path lets be wrong.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../models/automatic/automatic.h"
#include "../../models/calibration/plan.h"

namespace kincal {

/// Shows what each step frees and counts.
std::string plan_table(const std::vector<StepPlan>& plans, const ParameterTable& table);
/// Shows what the automatic path lets be wrong: the mounts, each group's name, widths and numbers.
std::string automatic_plan(const AutomaticGroups& groups, const ParameterTable& table);
/// Shows what it found: widths, how many numbers the data determine, evidence.
std::string automatic_table(const std::vector<AutomaticGroup>& groups);
/// Returns a line with the groups of bending and error curves that were tried without effect; "":
/// none.
std::string dropped_text(const std::vector<TriedGroup>& tried);

}  // namespace kincal
