// ROS 1's bags (wiki.ros.org/Bags/Format/2.0). After a line "#ROSBAG V2.0" come records: a header
// (uint32 length; fields of uint32 length, "name=value") and data (uint32 length). Chunks hold
// records of messages and connections; an index follows at the end, which tells where chunks start
// and how many messages of which connection they have: it is not needed to read a whole bag, and
// finds what comes after a damaged part of another.
#include <algorithm>
#include <optional>

#include "bytes.h"
#include "containers.h"
#include "decompress.h"

namespace kincal {

namespace {

enum Operation : unsigned char {
  kMessage = 2,
  kBagHeader = 3,
  kIndex = 4,
  kChunk = 5,
  kChunkInfo = 6,
  kConnection = 7
};

constexpr std::uint32_t kLargestHeader = 1 << 16;
constexpr std::uint32_t kHeaderPart = 4096;  // the first record is filled up to this

struct Fields {
  std::map<std::string_view, std::string_view> values;

  std::string_view text(std::string_view name) const {
    const auto found = values.find(name);
    if (found == values.end()) throw Damage("a record has no field '" + std::string(name) + "'");
    return found->second;
  }
  template <class Number>
  Number number(std::string_view name) const {
    return Bytes{text(name)}.number<Number>();
  }
  unsigned char operation() const { return number<unsigned char>("op"); }
};

Fields fields_of(std::string_view header) {
  Fields out;
  for (Bytes bytes{header}; !bytes.left.empty();) {
    const std::string_view one = bytes.text();
    const size_t equals = one.find('=');
    if (equals == std::string_view::npos) throw Damage("a field of a record has no name");
    out.values[one.substr(0, equals)] = one.substr(equals + 1);
  }
  return out;
}

struct Ros1Reader {
  BagFile file;
  BagReading& reading;
  std::map<std::uint32_t, std::shared_ptr<const Topic>> connections;
  std::map<std::uint32_t, std::uint64_t> read, indexed;  // messages by connection
  ChunkStarts chunks;
  std::string header, data, unpacked;

  void connection(const Fields& fields, std::string_view about) {
    const auto id = fields.number<std::uint32_t>("conn");
    const Fields more = fields_of(about);
    Topic topic{std::string(fields.text("topic")), std::string(more.text("type")),
                std::string(more.text("message_definition")), "ros1"};
    const auto known = connections.find(id);
    if (known != connections.end())
      reading.compare(*known->second, topic);
    else
      connections[id] = reading.add(std::move(topic));
  }

  void message(const Fields& fields, std::string_view text) {
    const auto id = fields.number<std::uint32_t>("conn");
    const auto found = connections.find(id);
    if (found == connections.end())
      throw Damage("a message is of connection " + std::to_string(id) + ", which is not there");
    Bytes time{fields.text("time")};
    const auto s = time.number<std::uint32_t>(), ns = time.number<std::uint32_t>();
    ++read[id];
    reading.give(*found->second, std::uint64_t{s} * 1000000000 + ns, text);
  }

  /// A record that stands in a chunk, or in the file itself; `where` it stands.
  void record(const Fields& fields, std::string_view text, const std::string& where) {
    const unsigned char operation = fields.operation();
    if (operation != kMessage && operation != kConnection)
      throw Damage("a record of kind " + std::to_string(operation) + " is not known");
    try {
      operation == kMessage ? message(fields, text) : connection(fields, text);
    } catch (const Damage& damage) {
      reading.lost("a record of " + where + ": " + damage.what());
    }
  }

  void chunk(const Fields& fields, std::string_view text, std::uint64_t start) {
    const std::string where = "the chunk at byte " + std::to_string(start);
    try {
      const std::string how(fields.text("compression"));
      if (how != "none") {
        decompress(how, text, fields.number<std::uint32_t>("size"), unpacked);
        reading.compressed(how);
        text = unpacked;
      }
      for (Bytes bytes{text}; !bytes.left.empty() && !reading.ended;) {
        const Fields inside = fields_of(bytes.text());
        record(inside, bytes.text(), where);
      }
    } catch (const Damage& damage) {
      reading.lost(where + ": " + damage.what());
      chunks.after_damaged_chunk(start, file);
    }
  }

  /// One record of the file. False at its end.
  bool next() {
    const std::uint64_t start = file.position();
    if (start == file.size()) return false;
    const auto length = Bytes{file.read(4, header)}.number<std::uint32_t>();
    if (length > kLargestHeader) throw Damage("the header of a record is larger than 64 kB");
    const Fields fields = fields_of(file.read(length, header));
    const auto size = Bytes{file.read(4, data)}.number<std::uint32_t>();
    const unsigned char operation = fields.operation();
    if (operation == kIndex || operation == kChunkInfo || operation == kBagHeader) {
      if (size > file.size() - file.position()) throw Damage("it ends too early");
      file.seek(file.position() + size);
      return true;
    }
    if (operation != kChunk && operation != kConnection && operation != kMessage)
      throw Damage("a record of kind " + std::to_string(operation) + " is not known");
    if (size > kLargestPart) throw Damage("a part is larger than 512 MB");
    const std::string_view text = file.read(size, data);
    if (operation == kChunk)
      chunk(fields, text, start);
    else
      record(fields, text, "byte " + std::to_string(start));
    return true;
  }

  /// Chunks and numbers of messages, as the index at the end says. What is damaged there is no
  /// loss; a bag without it was not ended by its recorder, or is cut off.
  void read_index(std::uint64_t first) {
    try {
      const auto length = Bytes{file.read(4, header)}.number<std::uint32_t>();
      if (length > kLargestHeader) throw Damage("the header of the bag is larger than 64 kB");
      const Fields fields = fields_of(file.read(length, header));
      const auto index = fields.number<std::uint64_t>("index_pos");
      const bool has_one = fields.number<std::uint32_t>("conn_count") > 0;
      if (index == 0 || index > file.size() || (index == file.size() && has_one))
        reading.lost(
            "the index at its end: the bag was not closed by its recorder, or is cut off; its last "
            "messages may be missing");
      else if (index > first)
        file.seek(index), index_records();
    } catch (const Damage&) {
    }
    chunks.starts.push_back(first + kHeaderPart);
    std::sort(chunks.starts.begin(), chunks.starts.end());
    file.seek(first);
  }

  void index_records() {
    while (file.position() < file.size()) {
      const auto length = Bytes{file.read(4, header)}.number<std::uint32_t>();
      if (length > kLargestHeader) return;
      const Fields fields = fields_of(file.read(length, header));
      const auto size = Bytes{file.read(4, data)}.number<std::uint32_t>();
      if (size > kLargestPart) return;
      const std::string_view text = file.read(size, data);
      if (fields.operation() == kConnection) connection(fields, text);
      if (fields.operation() != kChunkInfo) continue;
      chunks.starts.push_back(fields.number<std::uint64_t>("chunk_pos"));
      Bytes counts{text};
      for (auto n = fields.number<std::uint32_t>("count"); n > 0; --n) {
        const auto id = counts.number<std::uint32_t>();
        indexed[id] += counts.number<std::uint32_t>();
      }
    }
  }

  /// Says which messages the index has that were not found.
  void compare() {
    std::uint64_t missing = 0;
    std::string where;
    for (const auto& [id, count] : indexed)
      if (count > read[id]) {
        missing += count - read[id];
        const auto topic = connections.find(id);
        where +=
            (where.empty() ? "" : ", ") + std::to_string(count - read[id]) + " of " +
            (topic == connections.end() ? "connection " + std::to_string(id) : topic->second->name);
      }
    if (missing > 0) reading.lost(std::to_string(missing) + " messages: " + where);
  }
};

}  // namespace

void read_ros1_bag(const std::string& path, BagReading& reading) {
  reading.contents.container = "ROS 1 bag";
  Ros1Reader reader{BagFile(path), reading, {}, {}, {}, {}, {}, {}, {}};
  const std::string_view first =
      reader.file.read(std::min<std::uint64_t>(13, reader.file.size()), reader.header);
  if (first != "#ROSBAG V2.0\n")
    throw Unreadable("a ROS 1 bag of a version other than 2.0: convert it with `rosbag migrate`");
  reader.read_index(reader.file.position());
  while (!reading.ended) {
    const std::uint64_t start = reader.file.position();
    reading.progress.share(static_cast<double>(start), static_cast<double>(reader.file.size()));
    try {
      if (!reader.next()) break;
    } catch (const Damage& damage) {
      reader.chunks.skip_damage(damage, start, reader.file, reading);
    }
  }
  if (!reading.ended) reader.compare();
}

}  // namespace kincal
