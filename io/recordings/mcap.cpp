// MCAP (mcap.dev/spec): after eight magic bytes records of one byte for their kind and an uint64
// length. Chunks hold schemas, channels and messages; a checksum of each, and a summary at the end
// that tells where chunks start and how many messages there are: not needed to read a whole file,
// and finds what comes after a damaged part of another.
#include <zlib.h>

#include <algorithm>

#include "../document/error.h"
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
constexpr std::uint64_t kFooter = 1 + 8 + 8 + 8 + 4;  // before the magic at the end

struct Schema {
  std::string name, encoding, text;
};

struct McapReader {
  BagFile file;
  BagReading& reading;
  std::map<std::uint16_t, Schema> schemas;
  std::map<std::uint16_t, std::shared_ptr<const Topic>> channels;
  std::vector<std::uint64_t> chunks;  // where they start, by the summary
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
    if (channels.count(id)) return;
    auto topic = std::make_shared<Topic>();
    topic->name = std::string(bytes.text());
    topic->encoding = std::string(bytes.text());
    topic->type = of.name;
    const size_t at = topic->type.find("/msg/");
    if (at != std::string::npos) topic->type.erase(at, 4);
    if (of.encoding == "ros2msg" || of.encoding == "ros1msg") topic->definition = of.text;
    reading.contents.topics.push_back(topic);
    channels[id] = topic;
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
    if (!reading.visit({found->second.get(), static_cast<std::int64_t>(received), bytes.left}))
      reading.ended = true;
  }

  void record(unsigned char kind, std::string_view text) {
    if (kind == kSchemaRecord) schema({text});
    if (kind == kChannelRecord) channel({text});
    if (kind == kMessageRecord) message({text});
  }

  void chunk(std::string_view text, std::uint64_t start) try {
    Bytes bytes{text};
    bytes.take(16);  // times of the first and last message
    const auto size = bytes.number<std::uint64_t>();
    const auto sum = bytes.number<std::uint32_t>();
    const std::string how(bytes.text());
    std::string_view records = bytes.take(bytes.number<std::uint64_t>());
    if (!how.empty()) {
      reading.compressed(how);
      decompress(how, records, size, unpacked);
      records = unpacked;
    }
    if (sum != 0 &&
        crc32_z(0, reinterpret_cast<const Bytef*>(records.data()), records.size()) != sum)
      throw Damage("its checksum is another: bytes have changed");
    for (Bytes inside{records}; !inside.left.empty() && !reading.ended;) {
      const auto kind = inside.number<unsigned char>();
      record(kind, inside.take(inside.number<std::uint64_t>()));
    }
  } catch (const Damage& damage) {
    reading.lost("the chunk at byte " + std::to_string(start) + ": " + damage.what());
  }

  /// One record of the file. False at the end of the data.
  bool next() {
    const std::uint64_t start = file.position();
    Bytes first{file.read(9, head)};
    const auto kind = first.number<unsigned char>();
    const auto size = first.number<std::uint64_t>();
    if (kind == kDataEndRecord || kind == kFooterRecord) return false;
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
      record(kind, text);
    return true;
  }

  /// Chunks and the number of messages, as the summary says. What is damaged there is no loss.
  void read_summary() try {
    file.seek(file.size() - std::min(file.size(), kFooter + kMagic.size()));
    Bytes footer{file.read(kFooter, head)};
    if (footer.number<unsigned char>() != kFooterRecord) return;
    footer.number<std::uint64_t>();
    const auto summary = footer.number<std::uint64_t>();
    if (summary == 0 || summary >= file.size()) return;
    file.seek(summary);
    while (true) {
      Bytes first{file.read(9, head)};
      const auto kind = first.number<unsigned char>();
      const auto size = first.number<std::uint64_t>();
      if (kind == kFooterRecord || size > kLargestPart) return;
      Bytes text{file.read(size, data)};
      if (kind == kStatisticsRecord) counted = text.number<std::uint64_t>();
      if (kind == kSchemaRecord || kind == kChannelRecord) record(kind, text.left);
      if (kind != kChunkIndexRecord) continue;
      text.take(16);
      chunks.push_back(text.number<std::uint64_t>());
    }
  } catch (const Damage&) {
  }
};

}  // namespace

void read_mcap(const std::string& path, BagReading& reading) {
  reading.contents.container = "MCAP";
  McapReader reader{BagFile(path), reading, {}, {}, {}, 0, 0, {}, {}, {}};
  reader.read_summary();
  std::sort(reader.chunks.begin(), reader.chunks.end());
  reader.file.seek(kMagic.size());
  while (!reading.ended) {
    const std::uint64_t start = reader.file.position();
    if (reading.progress) reading.progress(start, reader.file.size());
    try {
      if (!reader.next()) break;
    } catch (const Damage& damage) {
      go_on_behind(damage, start, reader.chunks, reader.file, reading);
      if (reader.file.position() == reader.file.size()) break;
    }
  }
  if (!reading.ended && reader.read < reader.counted)
    reading.lost(std::to_string(reader.counted - reader.read) + " of " +
                 std::to_string(reader.counted) + " messages");
}

}  // namespace kincal
