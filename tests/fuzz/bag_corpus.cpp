// Makes the first texts of the readers of recordings, which are part of the repository:
//   cmake --build --preset fuzz --target kincal_fuzz_bag_corpus
//   build/fuzz/tests/fuzz/kincal_fuzz_bag_corpus tests/fuzz/corpus
// Small ones: few messages, narrow pages, short headers; MCAP without checksums, so that a changed
// byte is not the end of it.
#include <filesystem>

#include "../recordings/bag_writer.h"

using namespace kincal::test;

namespace {

const std::string kLine(80, '=');
const std::string kHeader =
    kLine + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
const std::string kThing =
    "int32 SIZE=3\nHeader header\nfloat64[3] xyz\nint16[] n\nPart[] parts\nstring word\nbool ok\n" +
    kLine + "\nMSG: pkg/Part\nfloat32 x\nduration wait\n" + kHeader;
const std::string kRos2Thing =
    "float64[3] xyz\nint16[] n\nPart[<=4] parts\nstring<=9 word\nbool ok\n" + kLine +
    "\nMSG: pkg/Part\nfloat32 x\nbuiltin_interfaces/Time at\n";

/// Numbers one after the other; in CDR each at a multiple of its size.
struct Message {
  bool cdr;
  std::string bytes;

  template <class Number>
  Message& add(Number n) {
    while (cdr && bytes.size() % sizeof n) bytes += '\0';
    put(bytes, n);
    return *this;
  }
  Message& text(const std::string& t) {
    add(static_cast<std::uint32_t>(t.size() + cdr));
    bytes += cdr ? t + '\0' : t;
    return *this;
  }
  Message& header(const std::string& frame) {
    return add(std::uint32_t{1}).add(std::uint32_t{1700000000}).add(std::uint32_t{5}).text(frame);
  }
  std::string done() const { return cdr ? std::string("\0\1\0\0", 4) + bytes : bytes; }
};

std::string thing(bool cdr, int n) {
  Message m{cdr, {}};
  if (!cdr) m.header("base");
  m.add(1.5).add(-2.25).add(1e9);
  m.add(std::uint32_t{2}).add(std::int16_t{-3}).add(static_cast<std::int16_t>(n));
  m.add(std::uint32_t{2}).add(1.5f).add(std::int32_t{1}).add(std::uint32_t{7});
  m.add(2.5f).add(std::int32_t{-1}).add(std::uint32_t{8});
  return m.text("word").add(std::uint8_t{1}).done();
}

Message& joint_state(Message& m, const std::vector<std::pair<std::string, double>>& joints) {
  m.header("").add(static_cast<std::uint32_t>(joints.size()));
  for (const auto& [name, position] : joints) m.text(name);
  m.add(static_cast<std::uint32_t>(joints.size()));
  for (const auto& [name, position] : joints) m.add(position);
  return m.add(std::uint32_t{0}).add(std::uint32_t{0});
}

/// Of the corpus's rig: a camera, a board of 2 x 3 corners, a laser (tests/fuzz/corpus/rig).
std::string measurement() {
  Message m{false, {}};
  m.text("s0").text("board").text("hand").add(std::uint32_t{1});
  m.header("").text("eye").add(std::uint32_t{6});
  for (int i = 0; i < 6; ++i) m.add(10.0 * i).add(20.5 + i % 3).add(0.0);
  m.add(std::uint32_t{1}).header("").text("laser").add(std::uint32_t{6});
  for (int i = 0; i < 6; ++i)
    joint_state(m, {{"tilt", 0.01 * i}, {"bearing", 0.02 * i}, {"range", 1.5}});
  m.add(std::uint32_t{1}).header("").text("arm");
  return joint_state(m, {{"turn", 0.25}, {"push", 0.1}, {"gripper", 0.01}}).done();
}

}  // namespace

int main(int, char** arguments) {
  const std::filesystem::path corpus = arguments[1];
  const auto file = [&](const std::string& reader, const std::string& name) {
    std::filesystem::create_directories(corpus / reader);
    return (corpus / reader / name).string();
  };
  const std::vector<WrittenTopic> ros1 = {{"/a", "pkg/Thing", kThing},
                                          {"/b", "std_msgs/String", "string data"}},
                                  ros2 = {{"/a", "pkg/msg/Thing", kRos2Thing},
                                          {"/b", "std_msgs/msg/String", "string data"}};
  std::vector<WrittenMessage> messages, cdr;
  for (int i = 0; i < 4; ++i) {
    const std::int64_t time = 1700000000000000000 + i * std::int64_t{100000000};
    messages.push_back(
        {i % 2, time, i % 2 ? Message{false, {}}.text("hello").done() : thing(false, i)});
    cdr.push_back({i % 2, time, i % 2 ? Message{true, {}}.text("hello").done() : thing(true, i)});
  }
  for (const std::string how : {"none", "bz2", "lz4"})
    save(file("ros1", how + ".bag"), ros1_bag(ros1, messages, how, 2, 200));
  for (const std::string how : {"", "lz4", "zstd"})
    save(file("mcap", (how.empty() ? "none" : how) + ".mcap"), mcap(ros2, cdr, how, 2, false));
  write_sqlite(file("sqlite", "bag.db3"), ros2, cdr, true, "none", 512);
  save(file("message", "ros1"), "pkg/Thing ros1\n" + kThing + "---\n" + thing(false, 3));
  save(file("message", "cdr"), "pkg/msg/Thing cdr\n" + kRos2Thing + "---\n" + thing(true, 3));
  save(file("message", "usual"), "sensor_msgs/JointState cdr\n---\n" + Message{true, {}}
                                                                           .add(std::int32_t{5})
                                                                           .add(std::uint32_t{6})
                                                                           .text("")
                                                                           .add(std::uint32_t{1})
                                                                           .text("j")
                                                                           .add(std::uint32_t{1})
                                                                           .add(0.5)
                                                                           .add(std::uint32_t{0})
                                                                           .add(std::uint32_t{0})
                                                                           .done());
  save(file("measurement", "message"), measurement());
}
