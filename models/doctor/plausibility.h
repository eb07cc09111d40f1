// What cannot be meant: numbers of a rig and its samples that show a mistake by themselves, before
// any fit and for next to nothing. Only what is far from everything usual is named, for nothing
// proves it.
#pragma once

#include <vector>

#include "../notices/notice.h"
#include "../rig/rig.h"
#include "../rig/samples.h"

namespace kincal {

/// Finds duplicates of samples, points outside of a camera's image or all in a corner of it,
/// intrinsics in another order or of another resolution, lengths in millimetres and angles in
/// degrees. No finding has a chi2.
std::vector<Notice> find_implausible(const Rig& rig, const std::vector<Sample>& samples);

}  // namespace kincal
