#include "bag.h"

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

namespace kincal {

namespace fs = std::filesystem;

namespace {

/// A file that is gone at the end.
struct Scratch {
  std::string path;
  int file = -1;

  Scratch() {
    path = (fs::temp_directory_path() / "kincal-XXXXXX").string();
    file = mkstemp(path.data());
    if (file < 0) throw InputError(path + ": " + std::strerror(errno));
  }
  ~Scratch() {
    close(file);
    unlink(path.c_str());
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  void write(const char* bytes, size_t count) {
    while (count > 0) {
      const ssize_t written = ::write(file, bytes, count);
      if (written < 0) throw InputError(path + ": " + std::strerror(errno));
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
  while (file.position() < file.size()) {
    const std::uint64_t count = std::min<std::uint64_t>(1 << 20, file.size() - file.position());
    const std::string_view part = file.read(count, packed);
    for (ZSTD_inBuffer in{part.data(), part.size(), 0}; in.pos < in.size;) {
      ZSTD_outBuffer out{unpacked.data(), unpacked.size(), 0};
      hint = ZSTD_decompressStream(context.get(), &out, &in);
      if (ZSTD_isError(hint))
        return reading.lost("what comes after byte " + std::to_string(file.position() - count) +
                            ": zstd: " + ZSTD_getErrorName(hint));
      to.write(unpacked.data(), out.pos);
    }
    if (reading.progress) reading.progress(file.position(), 2 * file.size());
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
      if (container_of(scratch.path) == Container::zstd)
        throw InputError(part.path + ": packed twice");
      return read_one({scratch.path, part.packed_messages}, reading);
    }
    case Container::none:
      break;
  }
  if (!fs::exists(part.path)) throw InputError(part.path + ": no such file");
  throw InputError(part.path +
                   ": neither a ROS 1 bag (#ROSBAG V2.0), nor MCAP, nor an SQLite file of rosbag2");
}

}  // namespace

BagContents read_bag(const std::string& path, const BagVisitor& visit,
                     const BagProgress& progress) {
  std::error_code status;
  if (!fs::exists(path, status)) throw InputError(path + ": no such file or folder");
  const bool folder = fs::is_directory(path, status);
  const std::vector<BagPart> parts = bag_parts(path);
  if (parts.empty())
    throw InputError(path + ": a folder without metadata.yaml, .mcap, .db3 or .bag");
  BagContents out;
  BagReading reading{visit, progress, out};
  for (const BagPart& part : parts) {
    if (reading.ended) break;
    const size_t before = out.losses.size();
    if (folder && container_of(part.path) == Container::none) {
      reading.lost("it is missing, or no recording");
    } else {
      read_one(part, reading);
    }
    for (size_t i = before; i < out.losses.size(); ++i)
      out.losses[i] = part.path + ": " + out.losses[i];
  }
  return out;
}

}  // namespace kincal
