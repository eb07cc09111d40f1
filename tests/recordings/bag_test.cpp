// Recordings: each container with each compression gives back what was written; what is cut off or
// changed is said, and the rest is read; messages of any type are decoded as their definition says.
// The containers are written by the tests' own writer: what other programs write is tested on a
// real recording (tests/program/bags_test.py).
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cmath>
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
  std::ifstream in(folder / "a.db3", std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  save(folder / "b.db3.zstd", packed("zstd", bytes));
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
  CHECK(got.contents.losses[0].find("gone.db3: it is missing") != std::string::npos);
}

TEST_CASE("bags: what is cut off is said, and what stands before is read", "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(120);
  const std::map<std::string, std::string> whole = {
      {"a.bag", ros1_bag(kTopics, messages, "none", 10)},
      {"b.bag", ros1_bag(kTopics, messages, "lz4", 10)},
      {"a.mcap", mcap(kTopics, messages, "zstd", 10)}};
  std::mt19937 random(3);
  for (const auto& [name, bytes] : whole) {
    const bool ros1 = name.back() == 'g';
    size_t before = 0;
    for (int i = 1; i <= 100; ++i) {
      const size_t cut = 4200 + (bytes.size() - 4201) * i / 101;
      CAPTURE(name, cut, bytes.size());
      save(folder / name, bytes.substr(0, cut));
      const Got got = read(folder / name);
      CHECK(some_of(got.messages, messages));
      CHECK(got.messages.size() >= before);  // the longer the more
      CHECK((!got.contents.losses.empty() ||
             (got.messages.size() == messages.size() || ros1)));  // ROS 1: cut between two chunks
      before = got.messages.size();
    }
    CHECK(before >= 110);
  }
}

TEST_CASE("bags: a changed byte is no crash, and no message is lost without a word", "[bags]") {
  const Folder folder;
  const std::vector<WrittenMessage> messages = some_messages(120);
  write_sqlite(folder / "whole.db3", kTopics, messages, true, "none");
  std::ifstream in(folder / "whole.db3", std::ios::binary);
  const std::map<std::string, std::string> whole = {
      {"a.bag", ros1_bag(kTopics, messages, "none", 10)},
      {"b.bag", ros1_bag(kTopics, messages, "bz2", 10)},
      {"c.bag", ros1_bag(kTopics, messages, "lz4", 10)},
      {"a.mcap", mcap(kTopics, messages, "", 10)},
      {"b.mcap", mcap(kTopics, messages, "zstd", 10)},
      {"a.db3", std::string(std::istreambuf_iterator<char>(in), {})}};
  std::mt19937 random(11);
  for (const auto& [name, bytes] : whole) {
    int most_lost = 0, silent = 0, unreadable = 0;
    for (int i = 0; i < 300; ++i) {
      std::string changed = bytes;
      const size_t at = random() % bytes.size();
      changed[at] = static_cast<char>(changed[at] ^ static_cast<char>(1 + random() % 255));
      save(folder / name, changed);
      CAPTURE(name, at);
      try {
        const Got got = read(folder / name);
        const int lost = static_cast<int>(messages.size()) - static_cast<int>(got.messages.size());
        most_lost = std::max(most_lost, lost);
        silent += lost > 0 && got.contents.losses.empty();
      } catch (const InputError&) {  // its first bytes, or SQLite's own tables
        ++unreadable;
      }
    }
    CAPTURE(name, most_lost, silent, unreadable);
    CHECK(silent == 0);
    if (name.substr(2) != "db3") {  // of SQLite a page of the tree may be gone
      CHECK(most_lost <= 20);
      CHECK(unreadable <= 6);
    }
  }
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
  }
}
