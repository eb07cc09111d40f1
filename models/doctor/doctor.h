// What is wrong with these data? The usual mistakes are tested as hypotheses, and the one that
// explains the data is reported, with the evidence.
//
// 1. The data alone: samples that are duplicated, numbers that nobody can mean (plausibility.h),
//    joints that never move, sensors tied to nothing.
// 2. The fit as it is: everything that any step frees, at once, over all samples (held-out ones
// too: they can be wrong as well). The best
//    of three starts: the rig's values, the rig's steps one after the other, and closed form for
//    poses that are freed wholly.
// 3. If chi2/dof (of the whole, or of a sensor) is bad: each mistake of hypotheses.h undone, with
// the same unknowns, and fitted again. The
//    list is shortened by a few iterations each; the best of them are fitted to the end. One is
//    believed if chi2 falls by a large factor (Thresholds::decisive where what remains is noise,
//    Thresholds::overwhelming else: model errors must not look like mistakes), and then the next is
//    looked for on top of it. Of several that explain equally much, that counts which leaves the
//    poses nearest to the rig's. Bad samples are found by a robust fit (Cauchy, its scale taken
//    from the data and lowered to 3 sigmas): those whose rows have more than 25 times the median
//    sample's mean square. Views numbered from the other corner likewise: a view that half a turn
//    fits far better, with everything else as it is; and single points that lie far off. Held poses
//    that are turned: turned_poses.h. Where nothing is found, or what was found leaves what no
//    noise explains: whether the data before and after some sample contradict each other
//    (two_parts.h).
// 4. Start values. A wrong pose that is freed wholly disappears in the estimate. It shows if the
// estimate is far from the rig's pose but
//    near to its inverse, or to the pose turned as another numbering of the board would turn it.
// 5. Sigmas, where no mistake was found: the noise levels of the data, if these are noise
//    (stated_sigmas.h).
//
// What cannot be seen: docs/doctor.md.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "../rig/recording.h"
#include "data_checks.h"  // find_duplicates()
#include "diagnosis.h"

namespace kincal {

/// How a calibration ended whose data are diagnosed, for words that agree with that.
enum class Ended { not_told, cannot_start, not_converged };

struct DoctorOptions {
  NoiseMode noise = NoiseMode::latent;
  int threads = 1;
  Ended ended = Ended::not_told;
  bool compare = false;  // weigh all that is tried by its evidence: Diagnosis::alternatives
  /// It is called before each fit with the number of fits done and the number there are to do now;
  /// false cancels.
  std::function<bool(int, int)> progress;
};

/// Diagnoses a recording, or a rig and its samples; nullopt: `progress` cancelled. @throws
/// NameError, std::invalid_argument as Calibration does.
std::optional<Diagnosis> diagnose(const Recording& recording, const DoctorOptions& options);
inline std::optional<Diagnosis> diagnose(const Rig& rig, const std::vector<Sample>& samples,
                                         const DoctorOptions& options) {
  return diagnose(Recording(rig, samples), options);
}

}  // namespace kincal
