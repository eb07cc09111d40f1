// MCAP (mcap.dev/spec): after eight magic bytes records of one byte for their kind and an uint64
// length. Chunks hold schemas, channels and messages; a checksum of each, and a summary at the end
// that tells where chunks start and how many messages there are: not needed to read a whole file,
// and finds what comes after a damaged part of another.
#include <zlib.h>

#include <algorithm>

#include "bytes.h"
#include "containers.h"
#include "decompress.h"

namespace kincal {

namespace {

enum Kind : unsigned char {
  kHeaderRecord = 1,
  kFooterRecord = 2,
  kSchemaRecord = 3,
  kChannelRecord = 4,
  kMessageRecord = 5,
  kChunkRecord = 6,
  kChunkIndexRecord = 8,
  kStatisticsRecord = 11,
  kDataEndRecord = 15
};

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
constexpr std::uint64_t kFooterSize = 8 + 8 + 4, kFooter = 1 + 8 + kFooterSize;

std::uint32_t checksum(std::uint32_t before, std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

struct Schema {
  std::string name, encoding, text;
};

struct McapReader {
  BagFile file;
  BagReading& reading;
  std::map<std::uint16_t, Schema> schemas;
  std::map<std::uint16_t, std::shared_ptr<const Topic>> channels;
  ChunkStarts chunks;
  std::uint64_t read = 0, counted = 0;
  std::string head, data, unpacked;

  void schema(Bytes bytes) {
    const auto id = bytes.number<std::uint16_t>();
    Schema& to = schemas[id];
    to.name = std::string(bytes.text());
    to.encoding = std::string(bytes.text());
    to.text = std::string(bytes.text());
  }

  void channel(Bytes bytes) {
    const auto id = bytes.number<std::uint16_t>();
    const Schema& of = schemas[bytes.number<std::uint16_t>()];
    Topic topic;
    topic.name = std::string(bytes.text());
    topic.encoding = std::string(bytes.text());
    topic.type = of.name;
    const size_t at = topic.type.find("/msg/");
    if (at != std::string::npos) topic.type.erase(at, 4);
    if (of.encoding == "ros2msg" || of.encoding == "ros1msg") topic.definition = of.text;
    const auto known = channels.find(id);
    if (known != channels.end())
      reading.compare(*known->second, topic);
    else
      channels[id] = reading.add(std::move(topic));
  }

  void message(Bytes bytes) {
    const auto id = bytes.number<std::uint16_t>();
    const auto found = channels.find(id);
    if (found == channels.end())
      throw Damage("a message is of channel " + std::to_string(id) + ", which is not there");
    bytes.number<std::uint32_t>();  // its place in the sequence
    const auto received = bytes.number<std::uint64_t>();
    bytes.number<std::uint64_t>();  // when it was published
    ++read;
    reading.give(*found->second, received, bytes.left);
  }

  /// A record that stands in a chunk, or in the file itself; `where` it stands.
  void record(unsigned char kind, std::string_view text, const std::string& where) try {
    if (kind == kSchemaRecord) schema({text});
    if (kind == kChannelRecord) channel({text});
    if (kind == kMessageRecord) message({text});
  } catch (const Damage& damage) {
    reading.lost("a record of " + where + ": " + damage.what());
  }

  void chunk(std::string_view text, std::uint64_t start) {
    const std::string where = "the chunk at byte " + std::to_string(start);
    try {
      records(text, where);
    } catch (const Damage& damage) {
      reading.lost(where + ": " + damage.what());
      chunks.after_damaged_chunk(start, file);
    }
  }

  void records(std::string_view text, const std::string& where) {
    Bytes bytes{text};
    bytes.take(16);  // times of the first and last message
    const auto size = bytes.number<std::uint64_t>();
    const auto sum = bytes.number<std::uint32_t>();
    const std::string how(bytes.text());
    std::string_view content = bytes.take(bytes.number<std::uint64_t>());
    if (!how.empty()) {
      decompress(how, content, size, unpacked);
      reading.compressed(how);
      content = unpacked;
    }
    if (content.size() != size) throw Damage("its size differs from the stated size");
    if (sum != 0 && checksum(0, content) != sum)
      throw Damage("its checksum differs: bytes have changed");
    for (Bytes inside{content}; !inside.left.empty() && !reading.ended;) {
      const auto kind = inside.number<unsigned char>();
      record(kind, inside.take(inside.number<std::uint64_t>()), where);
    }
  }

  /// One record of the file. False at the end of the data.
  bool next() {
    const std::uint64_t start = file.position();
    Bytes first{file.read(9, head)};
    const auto kind = first.number<unsigned char>();
    const auto size = first.number<std::uint64_t>();
    if (kind == kDataEndRecord || kind == kFooterRecord) {
      if (size != (kind == kFooterRecord ? kFooterSize : 4)) throw Damage("its end is none");
      return false;
    }
    if (kind == 0) throw Damage("a record has no kind");
    if (kind >= 0x80 || kind < kSchemaRecord || kind > kChunkRecord) {
      if (size > file.size() - file.position()) throw Damage("it ends too early");
      file.seek(file.position() + size);
      return true;
    }
    if (size > kLargestPart) throw Damage("a part is larger than 512 MB");
    const std::string_view text = file.read(size, data);
    if (kind == kChunkRecord)
      chunk(text, start);
    else
      record(kind, text, "byte " + std::to_string(start));
    return true;
  }

  /// Whether the summary that starts there, and the footer up to its checksum, have this sum.
  bool has_sum(std::uint64_t start, std::uint32_t sum) {
    std::uint32_t is = 0;
    file.seek(start);
    for (std::uint64_t left = file.size() - kMagic.size() - 4 - start; left > 0;) {
      const std::string_view part = file.read(std::min<std::uint64_t>(left, 1 << 20), data);
      is = checksum(is, part);
      left -= part.size();
    }
    return is == sum;
  }

  /// Chunks and the number of messages, as the summary says. What is damaged there is no loss.
  void read_summary() try {
    if (file.size() < kFooter + kMagic.size()) return;
    file.seek(file.size() - kFooter - kMagic.size());
    Bytes footer{file.read(kFooter, head)};
    if (footer.number<unsigned char>() != kFooterRecord) return;
    footer.number<std::uint64_t>();
    const auto summary = footer.number<std::uint64_t>();
    footer.number<std::uint64_t>();
    const auto sum = footer.number<std::uint32_t>();
    if (summary == 0 || summary > file.size() - kFooter - kMagic.size()) return;
    if (sum != 0 && !has_sum(summary, sum))
      return reading.lost(
          "the summary at its end: bytes have changed; it is unknown whether messages are "
          "missing");
    file.seek(summary);
    while (true) {
      Bytes first{file.read(9, head)};
      const auto kind = first.number<unsigned char>();
      const auto size = first.number<std::uint64_t>();
      if (kind == kFooterRecord || size > kLargestPart) return;
      Bytes text{file.read(size, data)};
      if (kind == kStatisticsRecord) counted = text.number<std::uint64_t>();
      if (kind == kSchemaRecord || kind == kChannelRecord) record(kind, text.left, "the summary");
      if (kind != kChunkIndexRecord) continue;
      text.take(16);
      chunks.starts.push_back(text.number<std::uint64_t>());
    }
  } catch (const Damage&) {
  }
};

}  // namespace

void read_mcap(const std::string& path, BagReading& reading) {
  reading.contents.container = "MCAP";
  McapReader reader{BagFile(path), reading, {}, {}, {}, 0, 0, {}, {}, {}};
  reader.read_summary();
  std::sort(reader.chunks.starts.begin(), reader.chunks.starts.end());
  reader.file.seek(kMagic.size());
  while (!reading.ended) {
    const std::uint64_t start = reader.file.position();
    reading.progress.share(static_cast<double>(start), static_cast<double>(reader.file.size()));
    try {
      if (!reader.next()) break;
    } catch (const Damage& damage) {
      reader.chunks.skip_damage(damage, start, reader.file, reading);
      if (reader.file.position() == reader.file.size()) break;
    }
  }
  if (!reading.ended && reader.read < reader.counted)
    reading.lost(std::to_string(reader.counted - reader.read) + " of " +
                 std::to_string(reader.counted) + " messages");
}

}  // namespace kincal
