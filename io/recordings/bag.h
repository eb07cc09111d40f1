// Bags: what a robot logged, as streams of messages. Three containers are read: ROS 1 bags
// (format 2.0; chunks as they are, bz2, lz4), MCAP (as they are, lz4, zstd) and rosbag2's SQLite
// files (as they are, or zstd of the file or of each message); of rosbag2 also the folder with
// metadata.yaml and its split files. Messages come in the order of the file, one chunk in memory at
// a time. What is truncated or damaged is left out, and said.
#pragma once

#include <string>

#include "../../solver/progress.h"
#include "bag_contents.h"

namespace kincal {

/// Reads a bag from start to end.
/// @throws InputError where it is none, or cannot be opened; Cancelled
BagContents read_bag(const std::string& path, const BagVisitor& visit,
                     const Progress& progress = {});

}  // namespace kincal
