// Which files are recordings. It needs none of the libraries that read them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace kincal {

enum class Container { none, ros1, mcap, sqlite, zstd };

/// What a file is, by its first bytes; `zstd`: something that is packed as a whole.
Container container_of(const std::string& path);

/// A file of a recording.
struct BagPart {
  std::string path;
  bool packed_messages = false;  // SQLite: each message is packed by zstd
};

/// The files of a recording, in their order.
struct BagParts {
  std::vector<BagPart> parts;
  std::int64_t messages = -1;  // that metadata.yaml counts; -1: it does not say
};

/// The files of a folder of rosbag2, as its metadata.yaml lists them, else by name; of a file
/// itself. None: a folder that has none. @throws InputError where metadata.yaml is wrong, or names
/// what is not in the folder
BagParts bag_parts(const std::string& path);

/// Whether a path is a recording, or a folder with one. @throws as bag_parts
bool is_bag(const std::string& path);

}  // namespace kincal
