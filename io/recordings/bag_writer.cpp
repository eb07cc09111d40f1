#include "bag_writer.h"

#include <algorithm>
#include <array>

#include "written_messages.h"

namespace kincal {
namespace {

constexpr size_t kChunk = 768 * 1024;  // bytes of records, at least, as rosbag has it
constexpr size_t kBagHeader = 4096;    // bytes, padded
const std::string kMcapMagic("\x89MCAP0\r\n", 8);

template <class Number>
std::string plain(Number n) {
  return std::string(reinterpret_cast<const char*>(&n), sizeof n);
}

std::string counted(const std::string& bytes) {
  return plain(static_cast<std::uint32_t>(bytes.size())) + bytes;
}

/// The CRC-32 of what had another one `before`, and bytes.
std::uint32_t checksum(std::uint32_t before, const std::string& bytes) {
  static const std::array<std::uint32_t, 256> table = [] {
    std::array<std::uint32_t, 256> out{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      out[i] = i;
      for (int k = 0; k < 8; ++k) out[i] = (out[i] >> 1) ^ (out[i] & 1 ? 0xEDB88320u : 0);
    }
    return out;
  }();
  std::uint32_t sum = ~before;
  for (const char c : bytes) sum = (sum >> 8) ^ table[(sum ^ static_cast<unsigned char>(c)) & 255];
  return ~sum;
}

std::string ros1_time(std::int64_t nanoseconds) {
  constexpr std::int64_t second = 1000000000;
  return plain(static_cast<std::uint32_t>(nanoseconds / second)) +
         plain(static_cast<std::uint32_t>(nanoseconds % second));
}

std::string header_field(const std::string& name, const std::string& value) {
  return counted(name + "=" + value);
}

std::string ros1_record(const std::string& header, const std::string& data) {
  return counted(header) + counted(data);
}

std::string bag_header(std::uint64_t index, size_t connections, size_t chunks) {
  const std::string header =
      header_field("op", "\x03") + header_field("index_pos", plain(index)) +
      header_field("conn_count", plain(static_cast<std::uint32_t>(connections))) +
      header_field("chunk_count", plain(static_cast<std::uint32_t>(chunks)));
  return ros1_record(header, std::string(kBagHeader - 8 - header.size(), ' '));
}

std::string mcap_record(char kind, const std::string& data) {
  return kind + plain(static_cast<std::uint64_t>(data.size())) + data;
}

/// Of MCAP: channels are numbered from 1.
std::string channel_id(int topic) { return plain(static_cast<std::uint16_t>(topic + 1)); }

std::string u64(std::uint64_t n) { return plain(n); }

std::string ros1_connection(int id, const std::string& name, const std::string& type) {
  const MessageIdentity identity = message_identity(Wire::ros1, type);
  return ros1_record(
      header_field("conn", plain(id)) + header_field("op", "\x07") + header_field("topic", name),
      header_field("topic", name) + header_field("type", type) +
          header_field("md5sum", identity.md5sum) +
          header_field("message_definition", identity.definition));
}

/// Schema and channel.
std::string mcap_channel(int id, const std::string& name, const std::string& type) {
  const size_t slash = type.find('/');
  const std::string full = type.substr(0, slash) + "/msg" + type.substr(slash);
  return mcap_record(3, channel_id(id) + counted(full) + counted("ros2msg") +
                            counted(message_identity(Wire::cdr, type).definition)) +
         mcap_record(
             4, channel_id(id) + channel_id(id) + counted(name) + counted("cdr") + counted(""));
}

}  // namespace

BagWriter::BagWriter(Wire wire, Put put) : wire_(wire), put_(std::move(put)) {
  if (wire == Wire::ros1)
    append("#ROSBAG V2.0\n" + bag_header(0, 0, 0));
  else
    append(kMcapMagic + mcap_record(1, counted("ros2") + counted("kincal")));
}

void BagWriter::append(const std::string& bytes) {
  put_(size_, bytes);
  size_ += bytes.size();
  if (wire_ == Wire::cdr) sum_ = checksum(sum_, bytes);
}

int BagWriter::add_topic(const std::string& name, const std::string& type) {
  const int id = static_cast<int>(topics_.size());
  topics_.push_back(
      {wire_ == Wire::ros1 ? ros1_connection(id, name, type) : mcap_channel(id, name, type),
       0,
       {}});
  return id;
}

void BagWriter::write(int topic, std::int64_t time, const std::string& message) {
  WrittenTopic& to = topics_[topic];
  if (records_.empty()) first_ = last_ = time;
  first_ = std::min(first_, time), last_ = std::max(last_, time);
  if (to.count++ == 0) records_ += to.record;
  to.in_chunk.push_back({time, records_.size()});
  if (wire_ == Wire::ros1)
    records_ += ros1_record(header_field("conn", plain(topic)) + header_field("op", "\x02") +
                                header_field("time", ros1_time(time)),
                            message);
  else
    records_ += mcap_record(5, channel_id(topic) + plain(static_cast<std::uint32_t>(to.count)) +
                                   plain(time) + plain(time) + message);
  if (records_.size() > kChunk) end_chunk();
}

std::string BagWriter::chunk_record(const Chunk& chunk) const {
  if (wire_ == Wire::ros1)
    return ros1_record(header_field("compression", "none") + header_field("op", "\x05") +
                           header_field("size", plain(static_cast<std::uint32_t>(records_.size()))),
                       records_);
  return mcap_record(6, plain(chunk.first) + plain(chunk.last) + u64(records_.size()) +
                            plain(checksum(0, records_)) + counted("") + u64(records_.size()) +
                            records_);
}

std::string BagWriter::index_record(int topic) const {
  std::string data;
  for (const Entry& e : topics_[topic].in_chunk)
    data += wire_ == Wire::ros1 ? ros1_time(e.time) + plain(static_cast<std::uint32_t>(e.offset))
                                : plain(e.time) + u64(e.offset);
  if (wire_ == Wire::cdr) return mcap_record(7, channel_id(topic) + counted(data));
  return ros1_record(
      header_field("ver", plain(1)) + header_field("op", "\x04") +
          header_field("conn", plain(topic)) +
          header_field("count", plain(static_cast<std::uint32_t>(topics_[topic].in_chunk.size()))),
      data);
}

void BagWriter::end_chunk() {
  if (records_.empty()) return;
  Chunk chunk{size_, records_.size(), first_, last_, {}, 0};
  append(chunk_record(chunk));
  for (size_t t = 0; t < topics_.size(); ++t) {
    WrittenTopic& topic = topics_[t];
    if (topic.in_chunk.empty()) continue;
    chunk.parts.push_back({static_cast<int>(t), topic.in_chunk.size(), size_});
    append(index_record(static_cast<int>(t)));
    topic.in_chunk.clear();
  }
  chunk.index_end = size_;
  chunks_.push_back(std::move(chunk));
  records_.clear();
}

std::string BagWriter::chunk_info(const Chunk& chunk) const {
  std::string parts;
  if (wire_ == Wire::ros1) {
    for (const Chunk::Part& part : chunk.parts)
      parts += plain(part.topic) + plain(static_cast<std::uint32_t>(part.count));
    return ros1_record(
        header_field("ver", plain(1)) + header_field("op", "\x06") +
            header_field("chunk_pos", u64(chunk.at)) +
            header_field("start_time", ros1_time(chunk.first)) +
            header_field("end_time", ros1_time(chunk.last)) +
            header_field("count", plain(static_cast<std::uint32_t>(chunk.parts.size()))),
        parts);
  }
  for (const Chunk::Part& part : chunk.parts) parts += channel_id(part.topic) + u64(part.index_at);
  const std::uint64_t index = chunk.parts.front().index_at;
  return mcap_record(8, plain(chunk.first) + plain(chunk.last) + u64(chunk.at) +
                            u64(index - chunk.at) + counted(parts) + u64(chunk.index_end - index) +
                            counted("") + u64(chunk.records) + u64(chunk.records));
}

void BagWriter::finish() {
  end_chunk();
  if (wire_ == Wire::ros1)
    finish_ros1();
  else
    finish_mcap();
}

void BagWriter::finish_ros1() {
  const std::uint64_t index = size_;
  for (const WrittenTopic& topic : topics_) append(topic.record);
  for (const Chunk& chunk : chunks_) append(chunk_info(chunk));
  put_(13, bag_header(index, topics_.size(), chunks_.size()));  // after the magic line
}

void BagWriter::finish_mcap() {
  append(mcap_record(15, plain(sum_)));
  sum_ = 0;
  const std::uint64_t summary = size_;
  std::uint64_t messages = 0;
  std::int64_t first = 0, last = 0;
  std::string counts;
  for (size_t t = 0; t < topics_.size(); ++t) {
    append(topics_[t].record);
    messages += topics_[t].count;
    counts += channel_id(static_cast<int>(t)) + u64(topics_[t].count);
  }
  for (const Chunk& chunk : chunks_) {
    append(chunk_info(chunk));
    first = &chunk == chunks_.data() ? chunk.first : std::min(first, chunk.first);
    last = std::max(last, chunk.last);
  }
  const auto n = static_cast<std::uint32_t>(topics_.size());
  append(mcap_record(11, u64(messages) + plain(static_cast<std::uint16_t>(n)) + plain(n) +
                             plain(std::uint32_t{0}) + plain(std::uint32_t{0}) +
                             plain(static_cast<std::uint32_t>(chunks_.size())) + plain(first) +
                             plain(last) + counted(counts)));
  std::string footer = mcap_record(2, u64(summary) + u64(0) + plain(std::uint32_t{0}));
  footer.resize(footer.size() - 4);  // its checksum is of what stands before
  append(footer + plain(checksum(sum_, footer)) + kMcapMagic);
}

}  // namespace kincal
