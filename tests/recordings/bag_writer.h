// Writes the containers that bag.h reads, for the tests: from their specifications, not from our
// readers.
#pragma once

#include <bzlib.h>
#include <lz4frame.h>
#include <sqlite3.h>
#include <zlib.h>
#include <zstd.h>

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <vector>

namespace kincal::test {

template <class Number>
void put(std::string& to, Number n) {
  to.append(reinterpret_cast<const char*>(&n), sizeof n);
}

inline void put_text(std::string& to, const std::string& text) {
  put<std::uint32_t>(to, static_cast<std::uint32_t>(text.size()));
  to += text;
}

inline std::string packed(const std::string& how, const std::string& bytes) {
  if (how.empty() || how == "none") return bytes;
  std::string out;
  if (how == "lz4") {  // with a checksum, as ROS writes it
    LZ4F_preferences_t wanted{};
    wanted.frameInfo.contentChecksumFlag = LZ4F_contentChecksumEnabled;
    out.resize(LZ4F_compressFrameBound(bytes.size(), &wanted));
    out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), &wanted));
  } else if (how == "zstd") {
    out.resize(ZSTD_compressBound(bytes.size()));
    out.resize(ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), 3));
  } else {
    unsigned size = static_cast<unsigned>(bytes.size() + bytes.size() / 100 + 600);
    out.resize(size);
    BZ2_bzBuffToBuffCompress(out.data(), &size, const_cast<char*>(bytes.data()),
                             static_cast<unsigned>(bytes.size()), 9, 0, 0);
    out.resize(size);
  }
  return out;
}

struct WrittenMessage {
  int topic;
  std::int64_t time;  // ns
  std::string data;
};

struct WrittenTopic {
  std::string name, type, definition;
};

inline void save(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// ---- ROS 1, version 2.0
inline std::string ros1_field(const std::string& name, const std::string& value) {
  std::string out;
  put_text(out, name + "=" + value);
  return out;
}

template <class Number>
std::string raw(Number n) {
  std::string out;
  put(out, n);
  return out;
}

inline std::string ros1_record(const std::string& header, const std::string& data) {
  std::string out;
  put_text(out, header);
  put_text(out, data);
  return out;
}

inline std::string ros1_connection(int id, const WrittenTopic& topic) {
  return ros1_record(ros1_field("conn", raw<std::uint32_t>(id)) + ros1_field("op", "\x07") +
                         ros1_field("topic", topic.name),
                     ros1_field("topic", topic.name) + ros1_field("type", topic.type) +
                         ros1_field("md5sum", "0") +
                         ros1_field("message_definition", topic.definition));
}

/// Chunks of `per_chunk` messages, with an index; `bag_header_size`: what its first record is
/// filled up to.
inline std::string ros1_bag(const std::vector<WrittenTopic>& topics,
                            const std::vector<WrittenMessage>& messages, const std::string& how,
                            size_t per_chunk, size_t bag_header_size = 4096) {
  std::string out = "#ROSBAG V2.0\n";
  const auto bag_header = [&](std::uint64_t index, std::uint32_t chunks) {
    std::string header = ros1_field("op", "\x03") + ros1_field("index_pos", raw(index)) +
                         ros1_field("conn_count", raw<std::uint32_t>(topics.size())) +
                         ros1_field("chunk_count", raw(chunks));
    return ros1_record(header, std::string(bag_header_size - 8 - header.size(), ' '));
  };
  out += bag_header(0, 0);
  std::string index;
  std::uint32_t chunks = 0;
  std::vector<char> known(topics.size(), 0);
  for (size_t first = 0; first < messages.size(); first += per_chunk, ++chunks) {
    std::string records;
    std::map<int, std::uint32_t> counts;
    for (size_t i = first; i < std::min(messages.size(), first + per_chunk); ++i) {
      const WrittenMessage& m = messages[i];
      if (!known[m.topic]) records += ros1_connection(m.topic, topics[m.topic]);
      known[m.topic] = 1;
      ++counts[m.topic];
      const std::string time =
          raw<std::uint32_t>(m.time / 1000000000) + raw<std::uint32_t>(m.time % 1000000000);
      records += ros1_record(ros1_field("conn", raw<std::uint32_t>(m.topic)) +
                                 ros1_field("op", "\x02") + ros1_field("time", time),
                             m.data);
    }
    std::string text;
    for (const auto& [topic, count] : counts)
      text += raw<std::uint32_t>(topic) + raw<std::uint32_t>(count);
    index += ros1_record(ros1_field("op", "\x06") + ros1_field("ver", raw<std::uint32_t>(1)) +
                             ros1_field("chunk_pos", raw<std::uint64_t>(out.size())) +
                             ros1_field("count", raw<std::uint32_t>(counts.size())),
                         text);
    out += ros1_record(ros1_field("compression", how) + ros1_field("op", "\x05") +
                           ros1_field("size", raw<std::uint32_t>(records.size())),
                       packed(how, records));
  }
  const std::uint64_t at = out.size();
  for (size_t t = 0; t < topics.size(); ++t) out += ros1_connection(static_cast<int>(t), topics[t]);
  out += index;
  return out.replace(13, bag_header_size, bag_header(at, chunks));
}

// ---- MCAP
inline std::string mcap_record(char kind, const std::string& data) {
  return kind + raw<std::uint64_t>(data.size()) + data;
}

inline std::string mcap_text(const std::string& text) {
  std::string out;
  put_text(out, text);
  return out;
}

/// Chunks of `per_chunk` messages and a summary, on request without checksums.
inline std::string mcap(const std::vector<WrittenTopic>& topics,
                        const std::vector<WrittenMessage>& messages, const std::string& how,
                        size_t per_chunk, bool checksums = true) {
  const auto checksum = [&](const std::string& bytes) {
    return checksums
               ? static_cast<std::uint32_t>(crc32(0, reinterpret_cast<const Bytef*>(bytes.data()),
                                                  static_cast<unsigned>(bytes.size())))
               : 0;
  };
  const std::string magic("\x89MCAP0\r\n", 8);
  std::string channels;
  for (size_t t = 0; t < topics.size(); ++t) {
    const auto id = static_cast<std::uint16_t>(t + 1);
    channels += mcap_record(3, raw(id) + mcap_text(topics[t].type) + mcap_text("ros2msg") +
                                   mcap_text(topics[t].definition));
    channels += mcap_record(4, raw(id) + raw(id) + mcap_text(topics[t].name) + mcap_text("cdr") +
                                   raw<std::uint32_t>(0));
  }
  std::string out = magic + mcap_record(1, mcap_text("ros2") + mcap_text("a test")), index;
  for (size_t first = 0; first < messages.size(); first += per_chunk) {
    std::string records = first == 0 ? channels : "";
    for (size_t i = first; i < std::min(messages.size(), first + per_chunk); ++i) {
      const auto time = static_cast<std::uint64_t>(messages[i].time);
      records += mcap_record(5, raw<std::uint16_t>(messages[i].topic + 1) + raw<std::uint32_t>(i) +
                                    raw(time) + raw(time) + messages[i].data);
    }
    const std::string content = packed(how, records);
    const std::string chunk =
        mcap_record(6, raw<std::uint64_t>(0) + raw<std::uint64_t>(0) +
                           raw<std::uint64_t>(records.size()) + raw(checksum(records)) +
                           mcap_text(how) + raw<std::uint64_t>(content.size()) + content);
    index +=
        mcap_record(8, raw<std::uint64_t>(0) + raw<std::uint64_t>(0) +
                           raw<std::uint64_t>(out.size()) + raw<std::uint64_t>(chunk.size()) +
                           raw<std::uint32_t>(0) + raw<std::uint64_t>(0) + mcap_text(how) +
                           raw<std::uint64_t>(content.size()) + raw<std::uint64_t>(records.size()));
    out += chunk;
  }
  out += mcap_record(15, raw<std::uint32_t>(0));
  const std::uint64_t summary = out.size();
  out += channels + index +
         mcap_record(11, raw<std::uint64_t>(messages.size()) + std::string(34, '\0') +
                             raw<std::uint32_t>(0));
  const std::string footer =
      mcap_record(2, raw(summary) + raw<std::uint64_t>(0) + std::string(4, '\0'));
  out += footer.substr(0, footer.size() - 4);
  return out + raw(checksum(out.substr(summary))) + magic;
}

// ---- rosbag2's SQLite
inline void write_sqlite(const std::string& path, const std::vector<WrittenTopic>& topics,
                         const std::vector<WrittenMessage>& messages, bool definitions,
                         const std::string& how, int page_size = 4096) {
  std::remove(path.c_str());
  sqlite3* db = nullptr;
  sqlite3_open(path.c_str(), &db);
  sqlite3_exec(db, ("PRAGMA page_size = " + std::to_string(page_size)).c_str(), nullptr, nullptr,
               nullptr);
  sqlite3_exec(
      db,
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
      "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp "
      "INTEGER NOT NULL, data BLOB NOT NULL);"
      "CREATE INDEX timestamp_idx ON messages (timestamp ASC); BEGIN",
      nullptr, nullptr, nullptr);
  if (definitions)
    sqlite3_exec(db,
                 "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT "
                 "NULL, encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, "
                 "type_description_hash TEXT NOT NULL)",
                 nullptr, nullptr, nullptr);
  const auto run = [&](const char* query, const std::vector<std::string>& texts,
                       const std::vector<std::int64_t>& numbers, const std::string& blob) {
    sqlite3_stmt* row = nullptr;
    sqlite3_prepare_v2(db, query, -1, &row, nullptr);
    int at = 0;
    for (const std::int64_t n : numbers) sqlite3_bind_int64(row, ++at, n);
    for (const std::string& t : texts)
      sqlite3_bind_text(row, ++at, t.c_str(), -1, SQLITE_TRANSIENT);
    if (!blob.empty())
      sqlite3_bind_blob(row, ++at, blob.data(), static_cast<int>(blob.size()), SQLITE_TRANSIENT);
    sqlite3_step(row);
    sqlite3_finalize(row);
  };
  for (size_t t = 0; t < topics.size(); ++t) {
    run("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", {topics[t].name, topics[t].type},
        {static_cast<std::int64_t>(t + 1)}, "");
    if (definitions)
      run("INSERT INTO message_definitions VALUES(NULL, ?, 'ros2msg', ?, '')",
          {topics[t].type, topics[t].definition}, {}, "");
  }
  for (const WrittenMessage& m : messages)
    run("INSERT INTO messages VALUES(NULL, ?, ?, ?)", {}, {m.topic + 1, m.time},
        packed(how, m.data));
  sqlite3_exec(db, "COMMIT", nullptr, nullptr, nullptr);
  sqlite3_close(db);
}

}  // namespace kincal::test
