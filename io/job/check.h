// What is asked of samples without calibrating: which mistakes they show, and their residuals at a
// rig's own values.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "../../models/doctor/doctor.h"
#include "../results/json_values.h"
#include "job.h"

namespace kincal {

/// A CheckedJob is what was found in samples, and in which ones of each target nothing decides how
/// its points are numbered (looked for only where nothing was found).
struct CheckedJob {
  std::shared_ptr<const Recording> recording;
  Diagnosis diagnosis;
  std::map<std::string, std::vector<std::string>> open_numbers;  // target -> samples
};
/// Looks for the usual mistakes (models/doctor/doctor.h) in all samples, held-out ones too.
/// @throws InputError, Cancelled
CheckedJob check_samples(const RigFile& rig_file, const SampleSet& samples,
                         const DoctorOptions& options, Words words);
/// Returns whether a diagnosis found that there is nothing to explain.
bool explained(const Diagnosis& diagnosis);
/// Returns {findings, chi2, dof, verdict, tested, open_numbering}.
Json check_json(const CheckedJob& checked);

/// An EvaluatedJob is what samples say at the rig's values.
struct EvaluatedJob {
  std::shared_ptr<const Recording> recording;
  Evaluation evaluation;
  Notices warnings;
};
/// Evaluates samples; of a rig whose samples are all held out the steps are not looked at. `free`
/// are names or globs that are estimated in each split. @throws InputError, Cancelled
EvaluatedJob evaluate_samples(RigFile& rig_file, const SampleSet& samples,
                              const CalibrateSettings& settings, const Progress& progress);

}  // namespace kincal
