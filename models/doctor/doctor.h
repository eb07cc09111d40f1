// Finds the mistake in the input: the usual mistakes are tested as hypotheses, and the one that
// explains the data is reported, with the evidence.
//
// 1. The data alone: duplicated samples, implausible values (plausibility.h), joints that never
// move,
//    sensors without a connection to the rest.
// 2. The fit without corrections: everything that any step estimates, at once, over all samples
//    (also held-out ones, which may be wrong too). The best of three starts: the rig's values, the
//    rig's steps one after the other, and closed form for poses that are estimated completely.
// 3. If chi2/dof (of the whole, or of a sensor) is bad, or the estimate far from the rig's values:
//    each mistake of hypotheses.h is undone, and the fit repeated with the same unknowns. A few
//    iterations each shorten the list; the most likely ones are fitted to convergence. One is a
//    finding by its odds (alternatives.h); then the next one is sought in addition. A robust fit
//    proposes bad samples, outlier points, and views numbered from another corner (suspects.h);
//    turned_poses.h proposes fixed poses that are turned. If there is no finding, or noise cannot
//    explain the rest: whether the data before and after some sample contradict each other
//    (two_parts.h).
// 4. If no mistake was found: sigmas that differ from the noise (stated_sigmas.h), and other
//    explanations of the data: noise of the readings, errors of fixed parameters.
//
// Mistakes that cannot be found: docs/doctor.md.
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
  bool compare = false;  // weigh all tried models by evidence: Diagnosis::alternatives
  Progress progress;     // reports before each fit the completed share of the present ones
};

/// Diagnoses a recording, or a rig and its samples. nullopt: cancelled. @throws NameError,
/// std::invalid_argument as Calibration does.
std::optional<Diagnosis> diagnose(const Recording& recording, const DoctorOptions& options);
inline std::optional<Diagnosis> diagnose(const Rig& rig, const std::vector<Sample>& samples,
                                         const DoctorOptions& options) {
  return diagnose(Recording(rig, samples), options);
}

}  // namespace kincal
