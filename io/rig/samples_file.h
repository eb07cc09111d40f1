// Reads and writes samples.jsonl; reading is strict and errors name their place.
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
/// Parses samples from a text; `path` is for messages. @throws InputError, Cancelled
std::vector<Sample> parse_samples(const std::string& text, const std::string& path, const Rig& rig,
                                  const Progress& progress = {});

/// Reads a floating joint's reading, a complete pose. @throws InputError
Pose read_pose_reading(const Field& field);
/// Returns readings (by joint, NaN: absent) as one JSON object.
std::string readings_text(const Tree& tree, const std::vector<double>& readings);

/// Returns one JSON line per sample in the format of read_samples; numbers have the shortest form
/// that reads back exactly. `images` are file names by sample and view ("" or missing: none). A
/// view with an image and no points is written without points, so that `kincal detect` finds them.
std::string samples_text(const Rig& rig, const std::vector<Sample>& samples,
                         const std::vector<std::vector<std::string>>& images = {});

}  // namespace kincal
