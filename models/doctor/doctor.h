// What is wrong with these data? The usual mistakes are tested as hypotheses, and the one that
// explains the data is reported, with the evidence.
//
// 1. The data alone: samples that are duplicated, numbers that nobody can mean (plausibility.h),
//    joints that never move, sensors tied to nothing.
// 2. The fit as it is: everything that any step frees, at once, over all samples (held-out ones
// too: they can be wrong as well). The best
//    of three starts: the rig's values, the rig's steps one after the other, and closed form for
//    poses that are freed wholly.
// 3. If chi2/dof (of the whole, or of a sensor) is bad, or the estimate far from the rig's values:
//    each mistake of hypotheses.h undone, and fitted again with the same unknowns. The list is
//    shortened by a few iterations each; the likeliest of them are fitted to the end. One is a
//    finding by its odds (alternatives.h), and then the next is looked for on top of it. Bad
//    samples, single points that lie far off and views that are numbered from the other corner are
//    proposed by a robust fit (suspects.h); held poses that are turned by turned_poses.h. Where
//    nothing is found, or what was found leaves what no noise explains: whether the data before and
//    after some sample contradict each other (two_parts.h).
// 4. Where no mistake was found: sigmas that are not of the size of the noise (stated_sigmas.h),
// and
//    what else would explain the data: noise of the readings, errors of what is held.
//
// What cannot be seen: docs/doctor.md.
#pragma once

#include <optional>
#include <vector>

#include "../../solver/progress.h"
#include "../rig/recording.h"
#include "diagnosis.h"

namespace kincal {

/// The outcome of the calibration whose data are diagnosed; the texts depend on it.
enum class FailureMode { not_told, cannot_start, not_converged };

struct DoctorOptions {
  NoiseMode noise = NoiseMode::latent;
  int threads = 1;
  FailureMode failure = FailureMode::not_told;
  bool compare = false;  // weigh all that is tried by its evidence: Diagnosis::alternatives
  Progress progress;     // is told before each fit which share is done of those to do now
};

/// Diagnoses a recording, or a rig and its samples; nullopt: cancelled. @throws
/// NameError, std::invalid_argument as Calibration does.
std::optional<Diagnosis> diagnose(const Recording& recording, const DoctorOptions& options);
inline std::optional<Diagnosis> diagnose(const Rig& rig, const std::vector<Sample>& samples,
                                         const DoctorOptions& options) {
  return diagnose(Recording(rig, samples), options);
}

}  // namespace kincal
