// The three containers of bag.h, and what their readers share. Each reads one file.
#pragma once

#include <fstream>
#include <map>

#include "../../solver/progress.h"
#include "../document/error.h"
#include "bag_contents.h"
#include "bytes.h"

namespace kincal {

/// A file whose parts are read into a text that is used again.
class BagFile {
 public:
  /// @throws Unreadable where it cannot be opened
  explicit BagFile(const std::string& path);

  std::uint64_t size() const { return size_; }
  std::uint64_t position() const { return position_; }
  void seek(std::uint64_t to);  ///< at most to its end

  /// The next bytes, valid until the next read into the same text. @throws Damage where there are
  /// fewer
  std::string_view read(std::uint64_t count, std::string& into);

 private:
  std::ifstream in_;
  std::uint64_t size_ = 0, position_ = 0;
};

/// A file that is no recording at all; who knows its name adds it.
struct Unreadable : InputError {
  using InputError::InputError;
};

/// What a reader fills in, and whom it asks.
struct BagReading {
  const BagVisitor& visit;
  const Progress& progress;
  BagContents& contents;
  bool ended = false;             // the visitor wants no more
  std::uint64_t given = 0;        // messages
  std::uint64_t definitions = 0;  // bytes of them

  void lost(const std::string& what);
  void compressed(const std::string& how);
  /// @throws Damage where its names or its definition are none that a robot could have
  std::shared_ptr<const Topic> add(Topic topic);
  /// Says so where a topic is described once more, and differently.
  void compare(const Topic& known, const Topic& again);
  /// Gives the visitor a message. @throws Damage where its time (ns) is beyond the year 2262
  void give(const Topic& topic, std::uint64_t received, std::string_view data);
};

/// Where chunks start, as the index at the end of a file says: that is how a reader finds what
/// comes after damaged bytes.
struct ChunkStarts {
  std::vector<std::uint64_t> starts;  // ascending
  int returns = 0;

  /// Goes on behind what cannot be read from `start` on: at the next chunk, else at the end of the
  /// file. Says what is lost.
  void skip_damage(const Damage& damage, std::uint64_t start, BagFile& file, BagReading& reading);
  /// After a damaged chunk: its length may be damaged too, so that it has the next one in it.
  void after_damaged_chunk(std::uint64_t start, BagFile& file);
};

/// @throws Unreadable, as the next ones do
void read_ros1_bag(const std::string& path, BagReading& reading);
void read_mcap(const std::string& path, BagReading& reading);
void read_sqlite_bag(const std::string& path, bool packed_messages, BagReading& reading);

}  // namespace kincal
