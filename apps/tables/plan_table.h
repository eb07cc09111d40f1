// What a calibration is going to do: its steps, and what automatic staging tries.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../models/calibration/plan.h"
#include "../../models/trials/staging.h"

namespace kincal {

/// Shows what each step frees and counts.
std::string plan_table(const std::vector<StepPlan>& plans, const ParameterTable& table);
/// Shows what automatic staging will try: each group's name and its parameters.
std::string staging_plan(
    const std::vector<std::pair<std::string, std::vector<std::string>>>& groups);
/// Shows what automatic staging has tried: the held-out error without and with each group.
std::string staging_table(const std::vector<StagingTrial>& trials);

}  // namespace kincal
