// Pages of what is no calibration and leaves no folder: the residuals at a rig's own values (kincal
// evaluate), and which mistakes its samples show (kincal check). They are made as a result's page
// is (report_page.h), of the same texts.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../../models/report/report.h"
#include "../results/results.h"
#include "../rig/rig_file.h"

namespace kincal {

/// Returns the page of an evaluation; of `record` command, date, version and samples_hash are
/// shown.
std::string evaluation_page(const RigFile& rig_file,
                            const std::shared_ptr<const Recording>& recording,
                            const Evaluation& evaluation, const std::vector<Warning>& warnings,
                            const ResultOptions& record);

/// Returns the page of a check. `explained`: there is nothing that a mistake would have to explain.
std::string check_page(const RigFile& rig_file, const std::shared_ptr<const Recording>& recording,
                       const Diagnosis& diagnosis, bool explained, const ResultOptions& record);

}  // namespace kincal
