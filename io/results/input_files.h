// What a page shows of what is no calibration and leaves no folder: the residuals at a rig's own
// values (kincal evaluate), which mistakes its samples show (kincal check), and planned postures
// (kincal plan). They are the texts that a result has (results.h), as far as there are any:
// result_json, samples_csv, residuals_csv.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../../models/report/report.h"
#include "../rig/rig_file.h"
#include "json_values.h"
#include "results.h"

namespace kincal {

/// Returns the texts of a page of some kind with the scene and the samples of a report, and what
/// `found` has at the top level of result_json.
ResultFiles page_files(const char* kind, const RigFile& rig_file, const ResultOptions& record,
                       const Report& report, const Json& found);

/// Returns the texts of an evaluation; of `record` command, date, version and samples_hash stand in
/// them.
ResultFiles evaluation_files(const RigFile& rig_file,
                             const std::shared_ptr<const Recording>& recording,
                             const Evaluation& evaluation, const Notices& warnings,
                             const ResultOptions& record);

/// Returns the texts of a check. `explained`: there is nothing that a mistake would have to
/// explain.
ResultFiles check_files(const RigFile& rig_file, const std::shared_ptr<const Recording>& recording,
                        const Diagnosis& diagnosis, bool explained, const ResultOptions& record);

}  // namespace kincal
