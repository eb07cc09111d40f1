// Recordings: each container with each compression gives back what was written; what is cut off or
// changed is said, and the rest is read; messages of any type are decoded as their definition says.
// The containers are written by the tests' own writer: what other programs write is tested on a
// real recording (tests/program/bags_test.py).
#include <sys/stat.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <random>

#include "../../io/document/error.h"
#include "../../io/recordings/bag.h"
#include "../../io/recordings/bag_files.h"
#include "../../io/recordings/bag_writer.h"
#include "../../io/recordings/bytes.h"
#include "../../io/recordings/decompress.h"
#include "../../io/recordings/message.h"
#include "../../io/recordings/written_messages.h"
#include "bag_writer.h"

namespace bag_test {

using namespace kincal;
using namespace kincal::test;

namespace {

struct Folder {
  std::string path;
  Folder() {
    path = (std::filesystem::temp_directory_path() / "kincal-bags-XXXXXX").string();
    REQUIRE(mkdtemp(path.data()));
  }
  ~Folder() { std::filesystem::remove_all(path); }
  std::string operator/(const std::string& name) const { return path + "/" + name; }
};

const std::vector<WrittenTopic> kTopics = {
    {"/joints", "pkg/Joints", "float64[] position\nstring[] name"},
    {"/picture", "pkg/Picture", "uint32 width\nuint8[] data"}};

std::vector<WrittenMessage> some_messages(int count) {
  std::mt19937 random(7);
  std::vector<WrittenMessage> out;
  for (int i = 0; i < count; ++i) {
    std::string data;
    for (unsigned k = 0; k < 20 + random() % 200; ++k)
      data += static_cast<char>(k % 7 ? 'a' : random() % 256);
    out.push_back({i % 3 == 2, 1700000000000000000 + i * std::int64_t{12345678}, data});
  }
  return out;
}

std::string contents_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(in), {});
}

struct Got {
  std::vector<WrittenMessage> messages;
  BagContents contents;
};

Got read(const std::string& path) {
  Got out;
  out.contents = read_bag(path, [&](const BagMessage& m) {
    const int topic = m.topic->name == kTopics[1].name;
    out.messages.push_back({topic, m.received, std::string(m.data)});
    return true;
  });
  return out;
}

bool same(const std::vector<WrittenMessage>& a, const std::vector<WrittenMessage>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const WrittenMessage& x, const WrittenMessage& y) {
                      return x.topic == y.topic && x.time == y.time && x.data == y.data;
                    });
}

/// Whether `some` are of `all`, in their order.
bool some_of(const std::vector<WrittenMessage>& some, const std::vector<WrittenMessage>& all) {
  size_t at = 0;
  for (const WrittenMessage& m : some) {
    while (at < all.size() && !(all[at].time == m.time && all[at].data == m.data)) ++at;
    if (at++ == all.size()) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("bags: every container and compression gives back what was written", "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(200);
  for (const std::string how : {"none", "bz2", "lz4"}) {
    CAPTURE(how);
    save(folder / "a.bag", ros1_bag(kTopics, messages, how, 30));
    const Got got = read(folder / "a.bag");
    CHECK(same(got.messages, messages));
    CHECK(got.contents.losses.empty());
    CHECK(got.contents.topics.size() == 2);
    CHECK(got.contents.topics[0]->definition == kTopics[0].definition);
    CHECK(got.contents.compressions.size() == (how == "none" ? 0 : 1));
  }
  for (const std::string how : {"", "lz4", "zstd"}) {
    CAPTURE(how);
    save(folder / "a.mcap", mcap(kTopics, messages, how, 30));
    const Got got = read(folder / "a.mcap");
    CHECK(same(got.messages, messages));
    CHECK(got.contents.losses.empty());
    CHECK(got.contents.topics.size() == 2);
    CHECK(got.contents.topics[1]->definition == kTopics[1].definition);
  }
  for (const bool definitions : {false, true}) {
    write_sqlite(folder / "a.db3", kTopics, messages, definitions, "none");
    const Got got = read(folder / "a.db3");
    CHECK(same(got.messages, messages));
    CHECK(got.contents.losses.empty());
    CHECK(got.contents.topics[0]->definition == (definitions ? kTopics[0].definition : ""));
  }
  save(folder / "b.db3.zstd", packed("zstd", contents_of(folder / "a.db3")));
  const Got got = read(folder / "b.db3.zstd");
  CHECK(same(got.messages, messages));
  CHECK(got.contents.losses.empty());
}

TEST_CASE("bags: a folder is read as its metadata.yaml says, part after part", "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(90);
  const auto part = [&](int from, int to) {
    return std::vector<WrittenMessage>(messages.begin() + from, messages.begin() + to);
  };
  write_sqlite(folder / "x_0.db3", kTopics, part(0, 40), true, "zstd");
  write_sqlite(folder / "x_1.db3", kTopics, part(40, 90), true, "zstd");
  const auto metadata = [&](const std::string& files) {
    save(folder / "metadata.yaml",
         "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n"
         "  relative_file_paths:\n" +
             files + "  compression_format: zstd\n  compression_mode: MESSAGE\n");
  };
  metadata("    - x_0.db3\n    - x_1.db3\n");
  CHECK(is_bag(folder.path));
  CHECK(same(read(folder.path).messages, messages));
  metadata("    - x_0.db3\n    - gone.db3\n    - x_1.db3\n");
  const Got got = read(folder.path);
  CHECK(same(got.messages, messages));
  REQUIRE(got.contents.losses.size() == 1);
  CHECK(got.contents.losses[0].find("gone.db3: no such file") != std::string::npos);
}

namespace {

/// Files of every container with the same messages.
std::map<std::string, std::string> all_containers(const Folder& folder,
                                                  const std::vector<WrittenMessage>& messages) {
  std::map<std::string, std::string> out;
  for (const std::string how : {"none", "bz2", "lz4"})
    out["ros1 " + how + ".bag"] = ros1_bag(kTopics, messages, how, 10);
  for (const std::string how : {"", "lz4", "zstd"}) {
    out["mcap " + how + ".mcap"] = mcap(kTopics, messages, how, 10);
    out["mcap without checksums " + how + ".mcap"] = mcap(kTopics, messages, how, 10, false);
  }
  write_sqlite(folder / "whole.db3", kTopics, messages, true, "none");
  out["sqlite.db3"] = contents_of(folder / "whole.db3");
  out["sqlite packed.db3.zstd"] = packed("zstd", out["sqlite.db3"]);
  return out;
}

/// What became of a file whose reading should have said if anything is amiss.
struct Reading {
  bool unreadable = false, silent_loss = false, silent_change = false;
  int lost = 0;

  Reading(const std::string& path, const std::vector<WrittenMessage>& messages) {
    const auto start = std::chrono::steady_clock::now();
    try {
      const Got got = read(path);
      const bool said = !got.contents.losses.empty();
      lost = static_cast<int>(messages.size()) - static_cast<int>(got.messages.size());
      silent_loss = lost > 0 && !said;
      silent_change = lost <= 0 && !same(got.messages, messages) && !said;
    } catch (const InputError&) {
      unreadable = true;
    }
    CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(5));
  }
};

}  // namespace

TEST_CASE("bags: what is cut off is said, and what stands before is read", "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(120);
  std::mt19937 random(3);
  for (const auto& [name, bytes] : all_containers(folder, messages)) {
    std::vector<size_t> cuts(100);
    for (size_t& cut : cuts) cut = random() % bytes.size();
    cuts.back() = bytes.size() - 1;
    std::sort(cuts.begin(), cuts.end());
    const bool one_after_another = name.rfind("sqlite", 0) != 0;
    size_t before = 0;
    for (const size_t cut : cuts) {
      CAPTURE(name, cut, bytes.size());
      save(folder / name, bytes.substr(0, cut));
      const Reading reading(folder / name, messages);
      CHECK(!reading.silent_loss);
      CHECK(!reading.silent_change);
      if (reading.unreadable) continue;
      const Got got = read(folder / name);
      if (one_after_another) {  // of a page of SQLite some may be there, and zeros
        CHECK(some_of(got.messages, messages));
        CHECK(got.messages.size() >= before);  // the longer the more
      }
      before = got.messages.size();
    }
    if (one_after_another) CHECK(before == messages.size());  // only the last byte is missing
  }
}

TEST_CASE("bags: a changed byte is no crash, and nothing is lost without a word", "[bags]") {
  // What has no checksums (ROS 1 and SQLite as they are, zstd as recorders use it, MCAP without)
  // can lose nothing in silence, but a message in it may change.
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(120);
  std::mt19937 random(11);
  for (const auto& [name, bytes] : all_containers(folder, messages)) {
    const bool checked = name == "ros1 bz2.bag" || name == "ros1 lz4.bag" || name == "mcap .mcap" ||
                         name == "mcap lz4.mcap" || name == "mcap zstd.mcap";
    int most_lost = 0, losses = 0, changes = 0, unreadable = 0;
    for (int i = 0; i < 1000; ++i) {
      std::string changed = bytes;
      const size_t at = random() % bytes.size();
      changed[at] = static_cast<char>(changed[at] ^ static_cast<char>(1 + random() % 255));
      save(folder / name, changed);
      CAPTURE(name, at);
      const Reading reading(folder / name, messages);
      unreadable += reading.unreadable;
      // Only the first line says what a file is. (A page of SQLite's tree may be the only one.)
      if (reading.unreadable && name.rfind("sqlite", 0) != 0) CHECK(at < 13);
      if (!reading.unreadable) most_lost = std::max(most_lost, reading.lost);
      losses += reading.silent_loss;
      changes += reading.silent_change;
      if (reading.silent_loss || (checked && reading.silent_change)) CHECK(at == 0);  // shows where
    }
    CAPTURE(name, most_lost, losses, changes, unreadable);
    if (std::getenv("KINCAL_BAGS_TABLE"))
      std::printf(
          "%-32s %6zu bytes: %4d unreadable, at most %d of 120 lost, %d silent losses, %d silent "
          "changes\n",
          name.c_str(), bytes.size(), unreadable, most_lost, losses, changes);
    CHECK(losses == 0);
    if (checked) CHECK(changes == 0);
    if (name.rfind("sqlite", 0) != 0) CHECK(most_lost <= 10);  // a chunk
  }
}

TEST_CASE("bags: a ROS 1 bag that was not closed, or tells two things of a topic, is said",
          "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(30);
  const std::string bytes = ros1_bag(kTopics, messages, "none", 10);
  std::string open = bytes;
  const size_t index = bytes.find("index_pos=") + 10;
  open.replace(index, 8, std::string(8, '\0'));
  save(folder / "a.bag", open);
  Got got = read(folder / "a.bag");
  CHECK(same(got.messages, messages));
  REQUIRE(got.contents.losses.size() == 1);
  CHECK(got.contents.losses[0].find("not closed") != std::string::npos);
  std::string other = bytes;
  other.replace(bytes.find("/picture"), 8, "/bicture");
  save(folder / "a.bag", other);
  got = read(folder / "a.bag");
  REQUIRE(got.contents.losses.size() == 1);
  CHECK(got.contents.losses[0].find("two versions") != std::string::npos);
}

TEST_CASE("bags: metadata.yaml leads nowhere else, and its count is compared", "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(20);
  std::filesystem::create_directory(folder / "bag");
  save(folder / "outside.mcap", mcap(kTopics, messages, "", 10));
  save(folder / "bag/a.mcap", mcap(kTopics, messages, "", 10));
  const auto metadata = [&](const std::string& files, const std::string& more) {
    save(folder / "bag/metadata.yaml",
         "rosbag2_bagfile_information:\n  relative_file_paths: " + files + "\n" + more);
    return folder / "bag";
  };
  CHECK_THROWS_WITH(read(metadata("[a.mcap, a.mcap]", "")), Catch::Contains("there twice"));
  CHECK_THROWS_WITH(read(metadata("['..']", "")), Catch::Contains("no name of a file"));
  CHECK_THROWS_WITH(read(metadata("[/]", "")), Catch::Contains("no name of a file"));
  Got got = read(metadata("['../outside.mcap']", ""));
  CHECK(got.messages.empty());
  CHECK(!got.contents.losses.empty());
  got = read(metadata("[bag/a.mcap]", "  message_count: 20\n"));  // as ROS 2's first versions
  CHECK(same(got.messages, messages));
  CHECK(got.contents.losses.empty());
  got = read(metadata("[a.mcap]", "  message_count: 22\n"));
  REQUIRE(got.contents.losses.size() == 1);
  CHECK(got.contents.losses[0].find("2 of 22 messages") != std::string::npos);
  save(folder / "bag/b.db3", "SQLite format 3" + std::string(100, '\0'));
  got = read(metadata("[b.db3, a.mcap]", ""));  // one that is none does not lose the other
  CHECK(same(got.messages, messages));
  CHECK(got.contents.losses.size() == 1);
}

TEST_CASE("bags: pipes, folders and links in place of files", "[bags]") {
  const Folder folder;
  REQUIRE(mkfifo((folder / "pipe.bag").c_str(), 0600) == 0);
  CHECK_THROWS_AS(read(folder / "pipe.bag"), InputError);  // and does not wait for a writer
  std::filesystem::create_directory(folder / "empty.bag");
  CHECK_THROWS_AS(read(folder / "empty.bag"), InputError);
  std::filesystem::create_symlink("loop.bag", folder / "loop.bag");
  CHECK_THROWS_AS(read(folder / "loop.bag"), InputError);
  const std::vector<WrittenMessage> messages = some_messages(20);
  write_sqlite(folder / "100% a?b#c.db3", kTopics, messages, true, "none");
  std::filesystem::create_symlink("100% a?b#c.db3", folder / "link.db3");
  CHECK(same(read(folder / "100% a?b#c.db3").messages, messages));
  CHECK(same(read(folder / "link.db3").messages, messages));
}

TEST_CASE("bags: SQLite files with other tables, gaps, or what a recorder left beside them",
          "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(20);
  const auto changed = [&](const std::string& by) {
    write_sqlite(folder / "a.db3", kTopics, messages, true, "none");
    sqlite3* db = nullptr;
    sqlite3_open((folder / "a.db3").c_str(), &db);
    char* error = nullptr;
    sqlite3_exec(db, by.c_str(), nullptr, nullptr, &error);
    CAPTURE(error ? error : "");
    CHECK(!error);
    sqlite3_close(db);
    return folder / "a.db3";
  };
  const auto said = [&](const std::string& by, const std::string& what) {
    CAPTURE(by);
    const Got got = read(changed(by));
    REQUIRE(!got.contents.losses.empty());
    CHECK(got.contents.losses[0].find(what) != std::string::npos);
    return got.messages.size();
  };
  // A view that never ends, columns that are computed: not even looked at.
  for (const std::string by :
       {"ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS WITH RECURSIVE r(id, topic_id, "
        "timestamp, data) AS (SELECT 1, 1, 1, x'00' UNION ALL SELECT id + 1, 1, 1, x'00' FROM r) "
        "SELECT * FROM r",
        "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, "
        "timestamp INTEGER, data BLOB AS (zeroblob(1000000000)))",
        "DROP TABLE topics", "DROP TABLE messages"})
    CHECK_THROWS_WITH(read(changed(by)), Catch::Contains("no bag"));
  CHECK(said("DELETE FROM messages WHERE id IN (3, 4)", "messages 3 to 4 are not there") == 18);
  CHECK(said("UPDATE messages SET timestamp = -5 WHERE id = 7", "message 7: the time") == 19);
  CHECK(said("UPDATE messages SET timestamp = 'now' WHERE id = 7", "message 7: its time") == 19);
  CHECK(said("UPDATE messages SET data = 12 WHERE id = 7", "message 7: it has no data") == 19);
  CHECK(said("UPDATE messages SET topic_id = 9 WHERE id = 7", "message 7: its topic") == 19);
  CHECK(said("UPDATE messages SET id = 9223372036854775807 WHERE id = 20", "messages 20 to ") ==
        20);
  CHECK(said("UPDATE topics SET name = '/x' || char(27) || '[2J' WHERE id = 1", "a topic: ") < 20);
  write_sqlite(folder / "a.db3", kTopics, messages, true, "none");
  save(folder / "a.db3-wal", "what was not put into it");
  const Got got = read(folder / "a.db3");
  CHECK(same(got.messages, messages));
  REQUIRE(got.contents.losses.size() == 1);
  CHECK(got.contents.losses[0].find("PRAGMA wal_checkpoint") != std::string::npos);
}

TEST_CASE("bags: what is packed as a whole leaves no file behind", "[bags]") {
  const Folder folder, scratch;
  const std::vector<WrittenMessage> messages = some_messages(20);
  setenv("TMPDIR", scratch.path.c_str(), 1);
  for (const std::string& bytes :
       {mcap(kTopics, messages, "lz4", 10), ros1_bag(kTopics, messages, "none", 10)}) {
    save(folder / "a.zstd", packed("zstd", bytes));
    int files = 0;
    read_bag(folder / "a.zstd", [&](const BagMessage&) {
      files += !std::filesystem::is_empty(scratch.path);
      return true;
    });
    CHECK(files == 0);
  }
  save(folder / "twice.zstd", packed("zstd", packed("zstd", "x")));
  CHECK_THROWS_WITH(read(folder / "twice.zstd"), Catch::Contains("twice.zstd: packed twice"));
  unsetenv("TMPDIR");
}

TEST_CASE("bags: what is made to ask for much gets little", "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(20);
  // One large definition for thousands of channels.
  std::string bytes("\x89MCAP0\r\n", 8);
  bytes += mcap_record(3, raw<std::uint16_t>(1) + mcap_text("a/B") + mcap_text("ros2msg") +
                              mcap_text(std::string(1 << 20, '#')));
  for (int i = 0; i < 20000; ++i)
    bytes += mcap_record(4, raw<std::uint16_t>(i) + raw<std::uint16_t>(1) +
                                mcap_text("/t" + std::to_string(i)) + mcap_text("cdr") +
                                raw<std::uint32_t>(0));
  save(folder / "a.mcap", bytes);
  const BagContents contents = read(folder / "a.mcap").contents;
  CHECK(contents.topics.size() <= 64);
  CHECK(!contents.losses.empty());
  // An index that leads back into a chunk that cannot be read, again and again.
  std::string back = ros1_bag(kTopics, messages, "none", 10);
  std::string large = ros1_record(ros1_field("compression", "none") + ros1_field("op", "\x05") +
                                      ros1_field("size", raw<std::uint32_t>(0)),
                                  std::string(8 << 20, '\xff'));
  std::string infos;
  for (std::uint64_t i = 0; i < 20000; ++i)
    infos += ros1_record(ros1_field("op", "\x06") + ros1_field("chunk_pos", raw(4109 + 4 * i)) +
                             ros1_field("count", raw<std::uint32_t>(0)),
                         "");
  for (int i = 0; i < 2000; ++i)  // chunks in the chunk, each as large as what follows
    large.replace(100 + 80 * i, 80,
                  ros1_record(ros1_field("compression", "x") + ros1_field("op", "\x05") +
                                  ros1_field("size", raw<std::uint32_t>(0)),
                              std::string(8 << 20, ' '))
                      .substr(0, 80));
  back = back.substr(0, 4109) + large + infos;
  const size_t index = back.find("index_pos=") + 10;
  back.replace(index, 8, raw<std::uint64_t>(4109 + large.size()));
  save(folder / "back.bag", back);
  const auto start = std::chrono::steady_clock::now();
  CHECK(!read(folder / "back.bag").contents.losses.empty());
  CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(5));
  // Times beyond what counts nanoseconds, names with control characters.
  std::vector<WrittenMessage> late = messages;
  late[3].time = -5;
  save(folder / "late.mcap", mcap(kTopics, late, "", 10));
  Got got = read(folder / "late.mcap");
  CHECK(got.messages.size() == 19);
  CHECK(!got.contents.losses.empty());
  std::vector<WrittenTopic> topics = kTopics;
  topics[0].name = "/joints\x1b[2J";
  save(folder / "name.mcap", mcap(topics, messages, "", 10));
  got = read(folder / "name.mcap");
  CHECK(got.contents.topics.size() == 1);
  CHECK(!got.contents.losses.empty());
}

TEST_CASE("messages: ROS 1 and CDR as their definition says, whatever the order of bytes",
          "[bags]") {
  const std::string definition =
      "# a remark\n"
      "int32 SIZE=3\nstring NAME = a # b\n"
      "Header header\nuint8 small\nfloat64 large\nbool[3] flags\nfloat32[] ranges\n"
      "Part[] parts\npkg/Part one\nstring<=10 word\nint16[<=4] few\nuint8 last\n"
      "================================================================================\n"
      "MSG: std_msgs/Header\ntime stamp\nstring frame_id\n"
      "================================================================================\n"
      "MSG: pkg/Part\nstring name\nint64 number\nduration wait\n";
  const MessageTypes types = read_definition("pkg/msg/Thing", definition);
  REQUIRE(types[0].fields.size() == 10);
  for (const bool cdr : {false, true})
    for (const bool swapped : {false, true}) {
      if (swapped && !cdr) continue;
      std::string data, body;
      const auto number = [&](auto n) {
        while (cdr && body.size() % sizeof n) body += '\0';
        std::string bytes;
        put(bytes, n);
        if (swapped) std::reverse(bytes.begin(), bytes.end());
        body += bytes;
      };
      const auto text = [&](const std::string& t) {
        number(static_cast<std::uint32_t>(t.size() + cdr));
        body += t;
        if (cdr) body += '\0';
      };
      const auto part = [&](const std::string& name, std::int64_t n) {
        text(name);
        number(n);
        number(std::int32_t{-2});
        number(std::uint32_t{500000000});
      };
      number(std::uint32_t{1700000000}), number(std::uint32_t{5}), text("base");
      number(std::uint8_t{200}), number(2.5), body += std::string("\x01\x00\x01", 3);
      number(std::uint32_t{2}), number(1.5f), number(-2.25f);
      number(std::uint32_t{2}), part("a", 1), part("bcd", -7), part("", 1LL << 40);
      text("word"), number(std::uint32_t{1}), number(std::int16_t{-3}), number(std::uint8_t{9});
      data = cdr ? std::string(swapped ? "\0\0\0\0" : "\0\1\0\0", 4) + body : body;
      const MessageValue value = decode_message(types, cdr ? Wire::cdr : Wire::ros1, data);
      CHECK(nanoseconds_of(field(value, "header.stamp")) == 1700000000000000005);
      CHECK(text_of(field(value, "header.frame_id")) == "base");
      CHECK(number_of(field(value, "small")) == 200);
      CHECK(number_of(field(value, "LARGE")) == 2.5);  // capitals or not
      CHECK(numbers_of(field(value, "flags"))[2] == 1);
      CHECK(numbers_of(field(value, "ranges")).size() == 2);
      CHECK(numbers_of(field(value, "ranges"))[1] == -2.25);
      REQUIRE(list_of(field(value, "parts")).size() == 2);
      CHECK(number_of(field(list_of(field(value, "parts"))[1], "number")) == -7);
      CHECK(nanoseconds_of(field(value, "one.wait")) == -1500000000);
      CHECK(number_of(field(value, "one.number")) == static_cast<double>(1LL << 40));
      CHECK(text_of(field(value, "word")) == "word");
      CHECK(numbers_of(field(value, "few"))[0] == -3);
      CHECK(number_of(field(value, "last")) == 9);
      for (size_t cut = 0; cut < data.size(); ++cut)
        CHECK_THROWS_AS(decode_message(types, cdr ? Wire::cdr : Wire::ros1, data.substr(0, cut)),
                        Damage);
      CHECK_THROWS_WITH(field(value, "header.nothing"),
                        "field 'nothing' is not there, in std_msgs/Header");
    }
}

TEST_CASE("messages: definitions that are wrong, and messages that ask for too much", "[bags]") {
  CHECK_THROWS_AS(read_definition("a/B", "Unknown x"), Damage);
  CHECK_THROWS_AS(read_definition("a/B", "B again"), Damage);
  CHECK_THROWS_AS(read_definition("a/B", "int32[x] y"), Damage);
  CHECK_THROWS_AS(read_definition("a/B", ""), Damage);  // none of the usual messages
  const MessageTypes many = read_definition("a/B", "string[] s");
  std::string data;
  put<std::uint32_t>(data, 4000000000u);
  CHECK_THROWS_AS(decode_message(many, Wire::ros1, data), Damage);
  // Types without fields take no byte, so that few bytes could have values without end.
  const std::string line = std::string(80, '=') + "\nMSG: ";
  std::string nested = "C1[200] c\n", wide = "C1 a\nC1 b\n";
  for (int i = 1; i < 20; ++i) {
    const std::string name = "C" + std::to_string(i + 1);
    nested += line + "a/C" + std::to_string(i) + "\n" + name + "[200] c\n";
    wide += line + "a/C" + std::to_string(i) + "\n" + name + " a\n" + name + " b\n";
  }
  for (const std::string& text : {nested, wide})
    CHECK_THROWS_AS(decode_message(read_definition("a/B", text + line + "a/C20\n"), Wire::ros1,
                                   std::string(1000, '\0')),
                    Damage);
  // A chain of types that is read from its end, so that no step of it goes deep.
  std::string chain;
  for (int i = 0; i < 5000; ++i) chain += "C" + std::to_string(i) + " c" + std::to_string(i) + "\n";
  for (int i = 0; i < 5000; ++i)
    chain += line + "a/C" + std::to_string(i) + "\n" +
             (i ? "C" + std::to_string(i - 1) + " c\n" : "int8 x\n");
  CHECK_THROWS_WITH(read_definition("a/B", chain), Catch::Contains("32 deep"));
  CHECK_THROWS_AS(decode_message(read_definition("a/B", "int8 x"), Wire::ros1, "ab"), Damage);
  const MessageTypes floats = read_definition("a/B", "float64[] s");
  CHECK_THROWS_AS(decode_message(floats, Wire::ros1, data), Damage);
  for (const char* type : {"sensor_msgs/JointState", "sensor_msgs/Image", "sensor_msgs/CameraInfo",
                           "sensor_msgs/LaserScan", "sensor_msgs/PointCloud2", "tf2_msgs/TFMessage",
                           "geometry_msgs/PoseStamped", "sensor_msgs/CompressedImage"})
    CHECK_NOTHROW(read_definition(type, ""));
}

TEST_CASE("recordings: nothing unpacks to more than a part may have", "[bags]") {
  std::string out;
  const std::string zeros(3 << 20, '\0');
  for (const std::string how : {"lz4", "zstd", "bz2"}) {
    CAPTURE(how);
    const std::string bytes = packed(how, zeros);
    decompress(how, bytes, zeros.size(), out);
    CHECK(out == zeros);
    decompress(how, bytes, 0, out);
    CHECK(out == zeros);
    CHECK_THROWS_AS(decompress(how, bytes, 17, out), Damage);
    CHECK_THROWS_AS(decompress(how, bytes, kLargestPart + 1, out), Damage);
    CHECK_THROWS_AS(decompress(how, bytes.substr(0, bytes.size() - 9), 0, out), Damage);
    CHECK_THROWS_AS(decompress(how, "nothing of the kind", 0, out), Damage);
  }
  CHECK_THROWS_AS(decompress("rar", "", 0, out), Damage);
}

TEST_CASE("bags: what is written of the usual messages is read again", "[bags][writer]") {
  const Folder folder;
  constexpr std::int64_t start = 1700000000000000000;
  for (const Wire wire : {Wire::ros1, Wire::cdr}) {
    const std::string path = folder / (wire == Wire::ros1 ? "w.bag" : "w.mcap");
    CAPTURE(path);
    std::string bytes;
    BagWriter bag(wire, [&](std::uint64_t at, std::string_view part) {
      bytes.resize(std::max(bytes.size(), static_cast<size_t>(at) + part.size()));
      bytes.replace(static_cast<size_t>(at), part.size(), part);
    });
    const int joints = bag.add_topic("/joint_states", "sensor_msgs/JointState"),
              images = bag.add_topic("/eye/image_raw", "sensor_msgs/Image"),
              infos = bag.add_topic("/eye/camera_info", "sensor_msgs/CameraInfo"),
              text = bag.add_topic("/robot_description", "std_msgs/String");
    bag.write(text, start, text_message(wire, "<robot name=\"r\"/>"));
    const std::string pixels(300 * 200, '\x7f');
    constexpr int count = 40;  // several chunks of them
    for (int i = 0; i < count; ++i) {
      const std::int64_t time = start + i * std::int64_t{100000001};
      bag.write(joints, time,
                joint_state_message(wire, time, {"a", "bc", "d"}, {0.5, std::nan(""), -1.0 * i}));
      bag.write(images, time, image_message(wire, time, "eye_link", {300, 200, pixels}));
      CameraNumbers camera;
      camera.width = 300, camera.height = 200, camera.model = "plumb_bob";
      camera.distortion = {0.1, 0.2, 0.3, 0.4, 0.5};
      std::copy_n(std::vector<double>{400, 401, 150, 100}.begin(), 4, camera.intrinsics);
      camera.baseline = 0.1;
      bag.write(infos, time, camera_info_message(wire, time, "eye_link", camera));
    }
    bag.finish();
    save(path, bytes);
    std::map<std::string, int> counts;
    const BagContents contents = read_bag(path, [&](const BagMessage& m) {
      const MessageTypes types = read_definition(m.topic->type, m.topic->definition);
      const MessageValue value = decode_message(types, wire, m.data);
      const int i = counts[m.topic->name]++;
      const std::int64_t time = start + i * std::int64_t{100000001};
      CHECK(m.received == time);
      if (m.topic->type == "std_msgs/String") {
        CHECK(text_of(field(value, "data")) == "<robot name=\"r\"/>");
        return true;
      }
      CHECK(nanoseconds_of(field(value, "header.stamp")) == time);
      if (m.topic->type == "sensor_msgs/JointState") {
        const NumberArray position = numbers_of(field(value, "position"));
        REQUIRE(position.size() == 2);  // what is not known is left out
        CHECK(position[0] == 0.5);
        CHECK(position[1] == -i);
        CHECK(text_of(list_of(field(value, "name"))[1]) == "d");
      } else if (m.topic->type == "sensor_msgs/Image") {
        CHECK(number_of(field(value, "width")) == 300);
        CHECK(number_of(field(value, "step")) == 300);
        CHECK(text_of(field(value, "encoding")) == "mono8");
        CHECK(numbers_of(field(value, "data")).bytes == pixels);
      } else {
        CHECK(numbers_of(field(value, "D"))[4] == 0.5);
        CHECK(numbers_of(field(value, "K"))[2] == 150);
        CHECK(numbers_of(field(value, "P"))[3] == Approx(-40));
        CHECK(text_of(field(value, "header.frame_id")) == "eye_link");
      }
      return true;
    });
    CHECK(contents.losses.empty());
    CHECK(contents.topics.size() == 4);
    CHECK(counts["/eye/image_raw"] == count);
    CHECK(counts["/joint_states"] == count);
    CHECK(counts["/eye/camera_info"] == count);
    CHECK(counts["/robot_description"] == 1);
    if (wire == Wire::ros1) continue;  // which has no checksums
    for (const size_t at : {bytes.find(pixels) + 100, bytes.rfind("plumb_bob") + 30,
                            bytes.rfind("/robot_description") + 2}) {
      std::string changed = bytes;
      changed[at] = static_cast<char>(changed[at] ^ 1);
      save(path, changed);
      CHECK(!read_bag(path, [](const BagMessage&) { return true; }).losses.empty());
    }
  }
}

}  // namespace bag_test
