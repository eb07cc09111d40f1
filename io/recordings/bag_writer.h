// Writes recordings as robots do: bags of ROS 1 (version 2.0) and MCAP files of ROS 2, with an
// index, not compressed; MCAP with its checksums. What is in a message: written_messages.h.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "message.h"

namespace kincal {

/// A BagWriter makes the bytes of a bag and gives them on as they come. Messages should come in the
/// order of their times.
class BagWriter {
 public:
  /// Gets bytes and where in the file they belong: at its end so far, but for a header that is
  /// written once more at the end.
  using Put = std::function<void(std::uint64_t at, std::string_view bytes)>;

  /// `wire` says which it is: ros1, or cdr for MCAP.
  BagWriter(Wire wire, Put put);

  Wire wire() const { return wire_; }
  /// Begins a stream of one of the usual messages ("sensor_msgs/Image"); returns its number.
  int add_topic(const std::string& name, const std::string& type);
  /// Writes a message; `time` in ns since 1970.
  void write(int topic, std::int64_t time, const std::string& message);
  /// Writes what stands at the end. Nothing may be written afterwards.
  void finish();

 private:
  struct Entry {
    std::int64_t time;
    std::uint64_t offset;  // in the chunk
  };
  struct WrittenTopic {
    std::string record;  // that says what it is
    std::uint64_t count = 0;
    std::vector<Entry> in_chunk;
  };
  struct Chunk {
    std::uint64_t at, records;  // where it is; bytes of its records
    std::int64_t first, last;
    struct Part {
      int topic;
      std::uint64_t count, index_at;  // messages; where their index is
    };
    std::vector<Part> parts;
    std::uint64_t index_end;
  };

  void append(const std::string& bytes);
  void end_chunk();
  std::string chunk_record(const Chunk& chunk) const;
  std::string index_record(int topic) const;
  std::string chunk_info(const Chunk& chunk) const;
  void finish_ros1();
  void finish_mcap();

  Wire wire_;
  Put put_;
  std::uint64_t size_ = 0;
  std::uint32_t sum_ = 0;  // of MCAP: of what was put, since the file or its summary began
  std::string records_;    // of the chunk in the making
  std::int64_t first_ = 0, last_ = 0;
  std::vector<WrittenTopic> topics_;
  std::vector<Chunk> chunks_;
};

}  // namespace kincal
