#include "bag.h"

#include <fcntl.h>
#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "../document/error.h"
#include "bag_files.h"
#include "bytes.h"
#include "containers.h"
#include "decompress.h"

namespace kincal {

namespace fs = std::filesystem;

namespace {

/// A file without a name, which is gone however the program ends.
struct Scratch {
  std::string name, path;
  int file = -1;

  Scratch() {
    name = (fs::temp_directory_path() / "kincal-XXXXXX").string();
    file = mkostemp(name.data(), O_CLOEXEC);
    if (file < 0) throw InputError(name + ": " + std::strerror(errno));
    unlink(name.c_str());
    path = "/proc/self/fd/" + std::to_string(file);
  }
  ~Scratch() { close(file); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  void write(const char* bytes, size_t count) {
    while (count > 0) {
      const ssize_t written = ::write(file, bytes, count);
      if (written < 0)
        throw InputError(name + ": " + std::strerror(errno) +
                         ", where a packed bag is unpacked: give the folder of another disk in the "
                         "environment variable TMPDIR, or unpack it with `zstd -d`");
      bytes += written;
      count -= static_cast<size_t>(written);
    }
  }
};

/// Unpacks a file that is packed as a whole.
void unpack_file(const std::string& path, Scratch& to, BagReading& reading) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     ZSTD_freeDCtx);
  BagFile file(path);
  std::string packed, unpacked(size_t{1} << 20, '\0');
  size_t hint = 1;
  const std::uint64_t most = kLargestPart + 1000 * file.size();
  std::uint64_t filled = 0;
  while (file.position() < file.size()) {
    const std::uint64_t count = std::min<std::uint64_t>(1 << 20, file.size() - file.position());
    const std::string_view part = file.read(count, packed);
    for (ZSTD_inBuffer in{part.data(), part.size(), 0}; in.pos < in.size;) {
      ZSTD_outBuffer out{unpacked.data(), unpacked.size(), 0};
      hint = ZSTD_decompressStream(context.get(), &out, &in);
      if (ZSTD_isError(hint))
        return reading.lost("the data after byte " + std::to_string(file.position() - count) +
                            ": zstd: " + ZSTD_getErrorName(hint));
      to.write(unpacked.data(), out.pos);
      filled += out.pos;
      if (filled > most)
        return reading.lost("the data after byte " + std::to_string(file.position() - count) +
                            ": it unpacks to more than 1000 times its size");
    }
    reading.progress.share(static_cast<double>(file.position()),
                           2 * static_cast<double>(file.size()));
  }
  if (hint != 0) reading.lost("the packed file ends too early");
}

void read_one(const BagPart& part, BagReading& reading) {
  switch (container_of(part.path)) {
    case Container::ros1:
      return read_ros1_bag(part.path, reading);
    case Container::mcap:
      return read_mcap(part.path, reading);
    case Container::sqlite:
      return read_sqlite_bag(part.path, part.packed_messages, reading);
    case Container::zstd: {
      Scratch scratch;
      unpack_file(part.path, scratch, reading);
      reading.compressed("zstd");
      if (container_of(scratch.path) == Container::zstd) throw Unreadable("packed twice");
      return read_one({scratch.path, part.packed_messages}, reading);
    }
    case Container::none:
      break;
  }
  std::error_code status;
  if (!fs::exists(part.path, status)) throw Unreadable("no such file");
  throw Unreadable("neither a ROS 1 bag (#ROSBAG V2.0), nor MCAP, nor an SQLite file of rosbag2");
}

}  // namespace

BagContents read_bag(const std::string& path, const BagVisitor& visit, const Progress& progress) {
  std::error_code status;
  if (!fs::exists(path, status)) throw InputError(path + ": no such file or folder");
  const bool folder = fs::is_directory(path, status);
  const BagParts bag = bag_parts(path);
  if (bag.parts.empty())
    throw InputError(path + ": a folder without metadata.yaml, .mcap, .db3 or .bag");
  BagContents out;
  BagReading reading{visit, progress, out};
  for (const BagPart& part : bag.parts) {
    if (reading.ended) break;
    const size_t before = out.losses.size();
    try {
      read_one(part, reading);
    } catch (const Unreadable& error) {
      if (!folder) throw InputError(part.path + ": " + error.what());
      reading.lost(error.what());
    }
    for (size_t i = before; i < out.losses.size(); ++i)
      out.losses[i] = part.path + ": " + out.losses[i];
  }
  if (!reading.ended && bag.messages > 0 &&
      reading.given < static_cast<std::uint64_t>(bag.messages))
    reading.lost(std::to_string(static_cast<std::uint64_t>(bag.messages) - reading.given) + " of " +
                 std::to_string(bag.messages) + " messages that metadata.yaml counts");
  return out;
}

}  // namespace kincal
