// Words about noise that is not as stated: levels that were estimated, what nobody stated, and
// joints whose noise looks like a gear of another ratio.
#pragma once

#include "trial_warnings.h"

namespace kincal {

constexpr double kNoisy = 3;  // times as noisy as stated: a joint that something else is wrong with

/// Returns what a good result supposes of poses of a flange that err by more than robots repeat by,
/// where nobody stated their noise, as a sentence without full stop; "": nothing.
std::string own_errors_words(const Report& report);

/// Returns whether the noise that the automatic path estimated leaves a doubt: residuals are larger
/// than stated and no mistake explains it, so that what the model lacks may have been taken for
/// noise; or all sigmas, of several kinds of noise, were multiplied by one factor, which is below a
/// half or makes joints more exact than they are seen to be: if only one of them was stated too
/// large, the result's sigmas are too small. Or --estimate-noise found a sensor far noisier than
/// stated and kept the noise of joints, which may be the cause.
bool noise_is_doubtful(const Report& report);
/// Warns of errors of readings that go with the posture: no noise, but what the model lacks.
void warn_of_trends(const Report& report, Notices& out);
/// Errors of readings that change from some sample on.
void warn_of_jumps(const Report& report, Notices& out);
/// Warns of joints that are far less noisy than stated, where that was not estimated.
void warn_of_quiet_joints(const Report& report, Notices& out);
/// Warns where sigmas were estimated from the data (the automatic path, --estimate-noise).
void warn_of_noise(const Report& report, Notices& out);

}  // namespace kincal
