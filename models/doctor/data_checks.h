// Mistakes that the data show by themselves, without a fit.
#pragma once

#include <vector>

#include "../notices/notice.h"
#include "../rig/rig.h"
#include "../rig/samples.h"

namespace kincal {

struct FreedNames;
class Recording;

/// Finds samples with the same readings and the same measured numbers: one finding of all, those
/// that are one measurement beside each other. Chain views measure nothing: samples that have no
/// others are no duplicates.
std::vector<Notice> find_duplicates(const Rig& rig, const std::vector<Sample>& samples);

/// Appends joints that never move although freed numbers of theirs are determined by their motion
/// only.
void check_still_joints(const Recording& recording, const FreedNames& freed,
                        std::vector<Notice>& out);

/// Appends freed poses that no sample shows, and sensors and targets that are tied to nothing whose
/// place is known. `sensors` are those that some step uses.
void check_connections(const Recording& recording, const FreedNames& freed,
                       const std::vector<int>& sensors, std::vector<Notice>& out);

}  // namespace kincal
