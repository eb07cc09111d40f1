// The three containers of bag.h, and what their readers share. Each reads one file.
#pragma once

#include <fstream>
#include <map>

#include "bag_contents.h"
#include "bytes.h"

namespace kincal {

/// A file whose parts are read into a text that is used again.
class BagFile {
 public:
  /// @throws InputError where it cannot be opened
  explicit BagFile(const std::string& path);

  std::uint64_t size() const { return size_; }
  std::uint64_t position() const { return position_; }
  void seek(std::uint64_t to);

  /// The next bytes, valid until the next read into the same text. @throws Damage where there are
  /// fewer
  std::string_view read(std::uint64_t count, std::string& into);

 private:
  std::ifstream in_;
  std::uint64_t size_ = 0, position_ = 0;
};

/// What a reader fills in, and whom it asks.
struct BagReading {
  const BagVisitor& visit;
  const BagProgress& progress;
  BagContents& contents;
  bool ended = false;  // the visitor wants no more

  void lost(const std::string& what);
  void compressed(const std::string& how);
};

/// Goes on behind what is damaged from `start` on: where the next of `chunks` (ascending) starts,
/// else at the end of the file. Says what is lost.
void go_on_behind(const Damage& damage, std::uint64_t start,
                  const std::vector<std::uint64_t>& chunks, BagFile& file, BagReading& reading);

void read_ros1_bag(const std::string& path, BagReading& reading);
void read_mcap(const std::string& path, BagReading& reading);
void read_sqlite_bag(const std::string& path, bool packed_messages, BagReading& reading);

}  // namespace kincal
