// rosbag2's SQLite files: table topics (id, name, type, serialization_format), table messages (id,
// topic_id, timestamp, data), and from ROS 2 Iron on table message_definitions. Older ones carry no
// definitions.
#include <sqlite3.h>

#include "../document/error.h"
#include "bytes.h"
#include "containers.h"
#include "decompress.h"

namespace kincal {

namespace {

using Database = std::unique_ptr<sqlite3, decltype(&sqlite3_close)>;
using Statement = std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)>;

Statement prepared(sqlite3* database, const char* query) {
  sqlite3_stmt* raw = nullptr;
  sqlite3_prepare_v2(database, query, -1, &raw, nullptr);  // null where there is no such table
  return {raw, sqlite3_finalize};
}

std::string_view column_bytes(sqlite3_stmt* row, int column) {
  const auto* bytes = static_cast<const char*>(sqlite3_column_blob(row, column));
  return bytes ? std::string_view(bytes, sqlite3_column_bytes(row, column)) : std::string_view();
}

std::string message_type(std::string name) {
  const size_t at = name.find("/msg/");
  if (at != std::string::npos) name.erase(at, 4);
  return name;
}

/// Definitions by type, where the file has them.
std::map<std::string, std::string> definitions(sqlite3* database) {
  std::map<std::string, std::string> out;
  const Statement rows = prepared(database,
                                  "SELECT topic_type, encoding, encoded_message_definition FROM "
                                  "message_definitions");
  while (rows && sqlite3_step(rows.get()) == SQLITE_ROW)
    if (column_bytes(rows.get(), 1) == "ros2msg")
      out[message_type(std::string(column_bytes(rows.get(), 0)))] =
          std::string(column_bytes(rows.get(), 2));
  return out;
}

std::int64_t single_number(sqlite3* database, const char* query) {
  const Statement row = prepared(database, query);
  return row && sqlite3_step(row.get()) == SQLITE_ROW ? sqlite3_column_int64(row.get(), 0) : -1;
}

}  // namespace

void read_sqlite_bag(const std::string& path, bool packed_messages, BagReading& reading) {
  reading.contents.container = "rosbag2 SQLite";
  sqlite3* raw = nullptr;
  // Nobody writes to it: no lock, no journal, and folders that cannot be written are no hindrance.
  std::string uri = "file:";
  for (const char c : path)
    if (c == '%' || c == '?' || c == '#') {
      static const char* digits = "0123456789ABCDEF";
      uri += {'%', digits[(c >> 4) & 15], digits[c & 15]};
    } else {
      uri += c;
    }
  const int opened = sqlite3_open_v2((uri + "?immutable=1").c_str(), &raw,
                                     SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, nullptr);
  const Database database(raw, sqlite3_close);
  if (opened != SQLITE_OK)
    throw InputError(path + ": " + (raw ? sqlite3_errmsg(raw) : "no memory for it"));
  const std::map<std::string, std::string> types = definitions(raw);
  std::map<std::int64_t, std::shared_ptr<const Topic>> topics;
  const Statement listed =
      prepared(raw, "SELECT id, name, type, serialization_format FROM topics ORDER BY id");
  if (!listed) throw InputError(path + ": an SQLite file that is no bag: " + sqlite3_errmsg(raw));
  while (sqlite3_step(listed.get()) == SQLITE_ROW) {
    auto topic = std::make_shared<Topic>();
    topic->name = std::string(column_bytes(listed.get(), 1));
    topic->type = message_type(std::string(column_bytes(listed.get(), 2)));
    topic->encoding = std::string(column_bytes(listed.get(), 3));
    const auto found = types.find(topic->type);
    if (found != types.end()) topic->definition = found->second;
    reading.contents.topics.push_back(topic);
    topics[sqlite3_column_int64(listed.get(), 0)] = topic;
  }
  const std::int64_t last = single_number(raw, "SELECT max(id) FROM messages");
  const Statement rows =
      prepared(raw, "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? ORDER BY id");
  if (!rows) throw InputError(path + ": an SQLite file that is no bag: " + sqlite3_errmsg(raw));
  std::string unpacked;
  std::int64_t at = -1, jump = 1;
  sqlite3_bind_int64(rows.get(), 1, at);
  if (packed_messages) reading.compressed("zstd");
  while (!reading.ended) {
    const int step = sqlite3_step(rows.get());
    if (step == SQLITE_DONE) break;
    if (step != SQLITE_ROW) {  // a damaged page: behind it, farther each time
      if (jump == 1)
        reading.lost("messages from number " + std::to_string(at + 1) +
                     " on: " + sqlite3_errmsg(raw));
      at += jump;
      jump *= 2;
      if (at >= last || jump > (std::int64_t{1} << 40)) break;
      sqlite3_reset(rows.get());
      sqlite3_bind_int64(rows.get(), 1, at);
      continue;
    }
    if (jump > 1)
      reading.lost("it goes on with number " + std::to_string(sqlite3_column_int64(rows.get(), 0)));
    jump = 1;
    at = sqlite3_column_int64(rows.get(), 0);
    if (reading.progress && last > 0)
      reading.progress(static_cast<std::uint64_t>(at), static_cast<std::uint64_t>(last));
    const auto topic = topics.find(sqlite3_column_int64(rows.get(), 1));
    try {
      if (topic == topics.end()) throw Damage("its topic is not there");
      std::string_view data = column_bytes(rows.get(), 3);
      if (packed_messages) {
        decompress("zstd", data, 0, unpacked);
        data = unpacked;
      }
      if (!reading.visit({topic->second.get(), sqlite3_column_int64(rows.get(), 2), data}))
        reading.ended = true;
    } catch (const Damage& damage) {
      reading.lost("message " + std::to_string(at) + ": " + damage.what());
    }
  }
}

}  // namespace kincal
