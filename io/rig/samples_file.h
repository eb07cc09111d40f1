// samples.jsonl: strict reading, with the place of everything wrong, and writing.
#pragma once

#include <string>
#include <vector>

#include "../../models/rig/rig.h"
#include "../../models/rig/samples.h"
#include "../../solver/progress.h"
#include "../document/document.h"

namespace kincal {

/// Reads samples. Every joint that a used chain needs must have a reading. @throws InputError
/// "path:line: views[2].ids: ..."
std::vector<Sample> read_samples(const std::string& path, const Rig& rig);
/// Reads them from the text of a file; `path` is for messages. @throws InputError, Cancelled
std::vector<Sample> parse_samples(const std::string& text, const std::string& path, const Rig& rig,
                                  const Progress& progress = {});

/// The reading of a floating joint: a complete pose. @throws InputError
Pose read_pose_reading(const Field& field);
/// Writes readings (by joint, NaN: absent) as one JSON mapping.
std::string readings_text(const Tree& tree, const std::vector<double>& readings);

/// Writes one JSON line a sample, as read_samples takes it (numbers in the shortest form that reads
/// back the same). `images` of its views, by sample and view, may be fewer, "" is none; a view that
/// has one and no points is written without: `kincal detect` finds them.
std::string samples_text(const Rig& rig, const std::vector<Sample>& samples,
                         const std::vector<std::vector<std::string>>& images = {});

}  // namespace kincal
