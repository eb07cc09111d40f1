// rosbag2's SQLite files: table topics (id, name, type, serialization_format), table messages (id,
// topic_id, timestamp, data), and from ROS 2 Iron on table message_definitions. Older ones carry no
// definitions. SQLite has no checksums; but messages are numbered from 1 on without gaps, and an
// index of their times has each of them once more: what is missing of either is said.
#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include <filesystem>
#include <limits>

#include "bytes.h"
#include "containers.h"
#include "decompress.h"

namespace kincal {

namespace {

using Database = std::unique_ptr<sqlite3, decltype(&sqlite3_close)>;
using Statement = std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)>;

constexpr std::int64_t kLargest = std::numeric_limits<std::int64_t>::max();

Statement prepared(sqlite3* database, const char* query) {
  sqlite3_stmt* raw = nullptr;
  sqlite3_prepare_v2(database, query, -1, &raw, nullptr);  // null where there is no such table
  return {raw, sqlite3_finalize};
}

std::string_view column_bytes(sqlite3_stmt* row, int column) {
  const auto* bytes = static_cast<const char*>(sqlite3_column_blob(row, column));
  return bytes ? std::string_view(bytes, sqlite3_column_bytes(row, column)) : std::string_view();
}

std::int64_t single_number(sqlite3* database, const char* query) {
  const Statement row = prepared(database, query);
  return row && sqlite3_step(row.get()) == SQLITE_ROW ? sqlite3_column_int64(row.get(), 0) : -1;
}

/// SQLite's files, but that the names of links are taken as they are: a file that has no name any
/// more is opened as /proc/self/fd/N (bag.cpp).
const char* file_system() {
  static sqlite3_vfs plain = *sqlite3_vfs_find(nullptr);
  static const bool added = [] {
    using Open = int (*)(const char*, int, int);
    const Open open_link = [](const char* path, int flags, int mode) {
      return open(path, flags & ~O_NOFOLLOW, mode);
    };
    plain.zName = "kincal";
    plain.pNext = nullptr;
    plain.xFullPathname = [](sqlite3_vfs*, const char* name, int room, char* out) {
      return static_cast<int>(sqlite3_snprintf(room, out, "%s", name) ? SQLITE_OK : SQLITE_ERROR);
    };
    plain.xSetSystemCall(&plain, "open", reinterpret_cast<sqlite3_syscall_ptr>(open_link));
    return sqlite3_vfs_register(&plain, 0) == SQLITE_OK;
  }();
  return added ? plain.zName : nullptr;
}

/// Opens a file that nobody writes to: no lock, no journal, and folders that cannot be written are
/// no hindrance. Nothing that its tables say is run, and no row is larger than a part may be. Who
/// may write the schema (nobody does) may read what is cut off.
Database opened(const std::string& path) {
  std::string uri = "file:";
  for (const char c : path)
    if (c == '%' || c == '?' || c == '#') {
      static const char* digits = "0123456789ABCDEF";
      uri += {'%', digits[(c >> 4) & 15], digits[c & 15]};
    } else {
      uri += c;
    }
  sqlite3* raw = nullptr;
  const int status = sqlite3_open_v2((uri + "?immutable=1").c_str(), &raw,
                                     SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, file_system());
  Database database(raw, sqlite3_close);
  if (status != SQLITE_OK) throw Unreadable(raw ? sqlite3_errmsg(raw) : "no memory for it");
  sqlite3_limit(raw, SQLITE_LIMIT_LENGTH, static_cast<int>(kLargestPart));
  sqlite3_db_config(raw, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(raw, SQLITE_DBCONFIG_WRITABLE_SCHEMA, 1, nullptr);
  return database;
}

/// Whether both tables are tables (no views, nothing that is computed) with these columns.
bool is_bag(sqlite3* database) {
  return single_number(database,
                       "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND rootpage > 0 "
                       "AND name IN ('topics', 'messages')") == 2 &&
         single_number(database,
                       "SELECT count(*) FROM pragma_table_xinfo('messages') WHERE hidden = 0 AND "
                       "name IN ('topic_id', 'timestamp', 'data')") == 3 &&
         single_number(database,
                       "SELECT count(*) FROM pragma_table_xinfo('topics') WHERE hidden = 0 AND "
                       "name IN ('id', 'name', 'type', 'serialization_format')") == 4;
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
                                  "message_definitions WHERE "
                                  "length(encoded_message_definition) < 1000000");
  while (rows && sqlite3_step(rows.get()) == SQLITE_ROW)
    if (column_bytes(rows.get(), 1) == "ros2msg")
      out[message_type(std::string(column_bytes(rows.get(), 0)))] =
          std::string(column_bytes(rows.get(), 2));
  return out;
}

using Topics = std::map<std::int64_t, std::shared_ptr<const Topic>>;

Topics listed_topics(sqlite3* database, BagReading& reading) {
  const std::map<std::string, std::string> types = definitions(database);
  Topics out;
  const Statement rows =
      prepared(database, "SELECT id, name, type, serialization_format FROM topics ORDER BY id");
  int step = SQLITE_ERROR;
  while (rows && (step = sqlite3_step(rows.get())) == SQLITE_ROW) try {
      Topic topic;
      topic.name = std::string(column_bytes(rows.get(), 1));
      topic.type = message_type(std::string(column_bytes(rows.get(), 2)));
      topic.encoding = std::string(column_bytes(rows.get(), 3));
      const auto found = types.find(topic.type);
      if (found != types.end()) topic.definition = found->second;
      out[sqlite3_column_int64(rows.get(), 0)] = reading.add(std::move(topic));
    } catch (const Damage& damage) {
      reading.lost(std::string("a topic: ") + damage.what());
    }
  if (step != SQLITE_DONE) reading.lost(std::string("topics: ") + sqlite3_errmsg(database));
  return out;
}

struct Rows {
  sqlite3_stmt* rows;  // rowid, topic_id, timestamp, data; of those from ?1 on
  const Topics& topics;
  bool packed;
  BagReading& reading;
  std::string unpacked;

  void message(std::int64_t id) try {
    const auto topic = topics.find(sqlite3_column_int64(rows, 1));
    if (topic == topics.end()) throw Damage("its topic is not there");
    if (sqlite3_column_type(rows, 2) != SQLITE_INTEGER) throw Damage("its time is not a number");
    if (sqlite3_column_type(rows, 3) != SQLITE_BLOB) throw Damage("it has no data");
    std::string_view data = column_bytes(rows, 3);
    if (packed) {
      decompress("zstd", data, 0, unpacked);
      reading.compressed("zstd");
      data = unpacked;
    }
    reading.give(*topic->second, static_cast<std::uint64_t>(sqlite3_column_int64(rows, 2)), data);
  } catch (const Damage& damage) {
    reading.lost("message " + std::to_string(id) + ": " + damage.what());
  }

  /// All of them; `last`: the largest number. Behind a damaged page it goes on farther each time,
  /// as behind rows that come again, to which a damaged tree leads.
  void read(std::int64_t last) {
    constexpr std::int64_t farthest = std::int64_t{1} << 40;
    std::int64_t from = std::numeric_limits<std::int64_t>::min(), expected = 1, jump = 1;
    sqlite3_bind_int64(rows, 1, from);
    while (!reading.ended) {
      const int step = sqlite3_step(rows);
      if (step == SQLITE_DONE) break;
      const std::int64_t id = step == SQLITE_ROW ? sqlite3_column_int64(rows, 0) : 0;
      if (step != SQLITE_ROW || id < from) {
        if (jump == 1)
          reading.lost("from message " + std::to_string(expected) + " on: " +
                       (step == SQLITE_ROW ? "messages come twice"
                                           : sqlite3_errmsg(sqlite3_db_handle(rows))));
        from = std::max<std::int64_t>(from, 0);
        if (jump > farthest || from > kLargest - jump || from + jump > last) break;
        from += jump;
        jump *= 2;
        sqlite3_reset(rows);
        sqlite3_bind_int64(rows, 1, from);
        continue;
      }
      if (id > expected)
        reading.lost("messages " + std::to_string(expected) + " to " + std::to_string(id - 1) +
                     " are not there");
      jump = 1;
      if (last > 0)
        reading.progress.share(static_cast<double>(std::clamp<std::int64_t>(id, 0, last)),
                               static_cast<double>(last));
      message(id);
      if (id == kLargest) break;
      from = id + 1;
      expected = std::max(expected, from);
    }
  }
};

/// Says whether the file is shorter than its header says. SQLite takes what is missing of its last
/// page for zeros.
void look_for_the_end(const std::string& path, BagReading& reading) {
  BagFile file(path);
  std::string header;
  const std::string_view bytes = file.read(std::min<std::uint64_t>(100, file.size()), header);
  if (bytes.size() < 100) throw Unreadable("it is cut off within its header");
  const std::uint64_t width = Bytes::number_at<std::uint16_t>(bytes.substr(16), 0, true),
                      pages = Bytes::number_at<std::uint32_t>(bytes.substr(28), 0, true),
                      page = width == 1 ? 65536 : width;
  const bool counted = bytes.substr(24, 4) == bytes.substr(92, 4);  // by those who wrote it last
  if (page > 0 && (file.size() % page > 0 || (counted && file.size() < page * pages)))
    reading.lost("the data after byte " + std::to_string(file.size()) +
                 ": the file is cut off. Its last messages may be partly zeros");
}

}  // namespace

void read_sqlite_bag(const std::string& path, bool packed_messages, BagReading& reading) {
  reading.contents.container = "rosbag2 SQLite";
  for (const char* ending : {"-wal", "-journal"}) {
    std::error_code none;
    const std::uintmax_t size = std::filesystem::file_size(path + ending, none);
    if (!none && size > 0)
      reading.lost("the contents of " + path + ending +
                   ": the recorder was stopped while it wrote, and did not merge them into the "
                   "bag. `sqlite3 " +
                   path + " 'PRAGMA wal_checkpoint'` does");
  }
  look_for_the_end(path, reading);
  const Database database = opened(path);
  if (!is_bag(database.get()))
    throw Unreadable(std::string("an SQLite file that is no bag: ") +
                     (sqlite3_errcode(database.get()) == SQLITE_OK
                          ? "it has no tables of topics and messages"
                          : sqlite3_errmsg(database.get())));
  const Topics topics = listed_topics(database.get(), reading);
  const Statement rows = prepared(
      database.get(),
      "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid >= ?1 ORDER BY rowid");
  if (!rows)
    throw Unreadable(std::string("an SQLite file that is no bag: ") +
                     sqlite3_errmsg(database.get()));
  const std::int64_t last = single_number(database.get(), "SELECT max(rowid) FROM messages"),
                     counted = single_number(
                         database.get(), "SELECT count(*) FROM messages INDEXED BY timestamp_idx");
  const std::uint64_t before = reading.given;
  Rows{rows.get(), topics, packed_messages, reading, {}}.read(last);
  const std::uint64_t given = reading.given - before;
  if (!reading.ended && counted > 0 && given < static_cast<std::uint64_t>(counted))
    reading.lost(std::to_string(static_cast<std::uint64_t>(counted) - given) + " of " +
                 std::to_string(counted) + " messages");
}

}  // namespace kincal
