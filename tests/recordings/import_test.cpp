// From messages to samples without images: streams.h, topics.h, robot_readings.h, raw_image.h,
// held_targets.h and import.h, on bags that are written here.
//
// Proves: joint states on two topics with rates of their own, of joints in messages of changing
// names, become one sample a rest with the mean and its sigma; stamps of 0 and stamps of another
// clock are said and replaced, also of clocks that are seconds apart; the busiest topic of a joint
// is taken and no command, topics that contradict each other are refused, names may have a prefix;
// poses of /tf (through a chain, static ones too), PoseStamped for a floating joint and for motion
// capture; which topic is which camera: by frame, name, size, what is left, and what is not
// decided; another lens and another robot, missing joints, slow readings, clocks that were set back
// and messages that are there again are said; every encoding of an image gives the same grey; what
// the hand holds; a diagnosis where nothing rests; near postures are left out. Images that are
// searched: tests/program/recordings_test.py. Does not prove: that other recorders write such
// messages.
#include "../../io/recordings/import.h"

#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "../../io/document/error.h"
#include "../../io/recordings/bag_writer.h"
#include "../../io/recordings/bytes.h"
#include "../../io/recordings/held_targets.h"
#include "../../io/recordings/raw_image.h"
#include "../../io/recordings/robot_readings.h"
#include "../../io/recordings/written_messages.h"
#include "../../kinematics/floating.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/random_stream.h"
#include "../fixtures/example.h"

namespace import_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

constexpr std::int64_t kStart = 1700000000000000000;

std::int64_t at(double time) { return kStart + std::llround(time * 1e9); }

/// A folder with a bag and a rig in it.
struct Place {
  std::string path;
  std::ofstream file;
  std::unique_ptr<BagWriter> bag;

  Place() {
    path = (std::filesystem::temp_directory_path() / "kincal-import-XXXXXX").string();
    REQUIRE(mkdtemp(path.data()));
  }
  ~Place() { std::filesystem::remove_all(path); }

  void open(Wire wire) {
    file.open(path + "/a", std::ios::binary | std::ios::trunc);
    bag = std::make_unique<BagWriter>(wire, [this](std::uint64_t where, std::string_view bytes) {
      file.seekp(static_cast<std::streamoff>(where));
      file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    });
  }
  RecordedStreams streams() {
    bag->finish();
    file.close();
    return read_streams({path + "/a"});
  }
  RigFile rig(const std::string& text, const std::string& urdf = "") const {
    if (!urdf.empty()) std::ofstream(path + "/robot.urdf") << urdf;
    std::ofstream(path + "/rig.yaml") << text;
    return read_rig(path + "/rig.yaml");
  }
};

const std::string kRobot =
    "<robot name='r'><link name='base'/><link name='one'/><link name='two'/><link name='wheel'/>"
    "<joint name='a' type='revolute'><parent link='base'/><child link='one'/><origin xyz='0 0 1'/>"
    "<axis xyz='0 0 1'/><limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
    "<joint name='b' type='continuous'><parent link='one'/><child link='two'/><origin xyz='1 0 0'/>"
    "<axis xyz='0 1 0'/></joint>"
    "<joint name='w' type='continuous'><parent link='base'/><child link='wheel'/>"
    "<axis xyz='0 1 0'/></joint></robot>";

const std::string kMocap =
    "format: kincal/1\nrobot: robot.urdf\nbase: base\njoints: {a: {sigma: 0.0001}, b: {sigma: "
    "0.0001}}\ntargets:\n  plate: {type: points, points: [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], "
    "mount: {link: two, pose: {}}}\nsensors:\n  mocap: {type: pose, link: base, pose: {}, sigma: "
    "{translation: 0.0001, rotation: 0.0002}}\n";

std::string pose_message(Wire wire, std::int64_t time, const Pose& pose) {
  MessageBytes out(wire);
  out.header(time, "world");
  const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  for (int i = 0; i < 3; ++i) out.number(pose.translation[i]);
  for (int i = 0; i < 4; ++i) out.number(q[i]);
  return out.str();
}

std::string tf_message(Wire wire, std::int64_t time, const std::string& frame,
                       const std::string& child, const Pose& pose) {
  MessageBytes out(wire);
  out.number(std::uint32_t{1}).header(time, frame).text(child);
  const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  for (int i = 0; i < 3; ++i) out.number(pose.translation[i]);
  for (int i = 0; i < 4; ++i) out.number(q[i]);
  return out.str();
}

/// Where joints are that rest for 2 s and move for 1 s, by turns.
double path_of(double t, double step) {
  const double k = std::floor(t / 3), u = std::max(0., t - 3 * k - 2);
  return step * (k + u * u * (3 - 2 * u));
}

/// Takes readings and poses of a time away.
void forget(RecordedStreams& streams, const TimeInterval& time, const std::string& joint = "") {
  for (JointStream& s : streams.joints) {
    if (!joint.empty() && s.joint != joint) continue;
    Series left;
    for (size_t i = 0; i < s.readings.size(); ++i)
      if (!time.contains(s.readings.times[i])) {
        left.times.push_back(s.readings.times[i]);
        left.values.push_back(s.readings.values[i]);
      }
    s.readings = left;
  }
}

/// Writes 5 rests: joint a at 100 Hz, b at 40 Hz on a topic of its own, poses at 50 Hz.
void write_rests(Place& place, Wire wire, double a_scatter, double clock, bool stamped) {
  place.open(wire);
  RandomStream draws(3);
  BagWriter& bag = *place.bag;
  const int fast = bag.add_topic("/arm/joint_states", "sensor_msgs/JointState"),
            slow = bag.add_topic("/hand/joint_states", "sensor_msgs/JointState"),
            order = bag.add_topic("/arm/command", "sensor_msgs/JointState"),
            poses = bag.add_topic("/vrpn/plate/pose", "geometry_msgs/PoseStamped");
  for (int i = 0; i <= 2800; ++i) {
    const double t = 0.005 * i, a = path_of(t, 0.2), b = path_of(t, -0.3);
    if (i % 2 == 0) {
      const double reading = a + a_scatter * draws.normal();
      if (i % 4 == 0)
        bag.write(fast, at(t),
                  joint_state_message(wire, stamped ? at(t) : 0, {"a", "w"}, {reading, 5 * t}));
      else
        bag.write(fast, at(t), joint_state_message(wire, stamped ? at(t) : 0, {"a"}, {reading}));
    }
    if (i % 5 == 0) {
      double turned = b;  // as readings of a joint that goes round: within half a turn
      while (turned < -kPi) turned += 2 * kPi;
      bag.write(slow, at(t), joint_state_message(wire, at(t), {"b", "gripper"}, {turned, 0.01}));
      bag.write(order, at(t), joint_state_message(wire, at(t), {"a", "b"}, {7, 7}));
    }
    if (i % 4 == 0) {
      const Pose pose{exp_so3(Vector3d(0, 0, a)), Vector3d(a, b, 1)};
      bag.write(poses, at(t), pose_message(wire, at(t) - std::llround(clock * 1e9), pose));
    }
  }
}

}  // namespace

TEST_CASE("import: joints on several topics and poses become samples of the rests") {
  for (const Wire wire : {Wire::ros1, Wire::cdr}) {
    Place place;
    const double scatter = 2e-4;
    write_rests(place, wire, scatter, 0, true);
    const RigFile rig = place.rig(kMocap, kRobot);
    RecordedStreams streams = place.streams();
    CHECK(streams.losses.empty());
    CHECK(streams.notes.empty());
    ImportOptions options;
    const RecordedSamples found = import_recordings({}, rig, streams, nullptr, options);
    CHECK(found.notes.empty());
    REQUIRE(found.samples.size() == 5);
    for (size_t k = 0; k < 5; ++k) {
      const Sample& sample = found.samples[k];
      const auto n = static_cast<double>(k);
      CHECK(sample.id == "rest_000" + std::to_string(k + 1));
      CHECK(*sample.time == Approx(1700000001 + 3 * n).margin(0.2));
      const int a = rig.rig.tree.find_joint("a"), b = rig.rig.tree.find_joint("b");
      const double sigma = joint_sigma(rig.rig, sample, a);  // about 180 readings
      CHECK(sigma == Approx(std::hypot(1e-4, scatter / std::sqrt(180.))).epsilon(0.02));
      CHECK(sample.readings[static_cast<size_t>(a)] ==
            Approx(0.2 * n).margin(5 * scatter / std::sqrt(180.)));
      CHECK(sample.readings[static_cast<size_t>(b)] == Approx(-0.3 * n).margin(1e-6));
      REQUIRE(sample.views.size() == 1);
      CHECK(sample.views[0].z[0] == Approx(0.2 * n).margin(1e-6));
      CHECK(sample.views[0].sigma[0] == Approx(1e-4).epsilon(0.01));
    }
  }
}

TEST_CASE("import: what --still-joints allows is rest") {
  Place place;
  write_rests(place, Wire::cdr, 2e-4, 0, true);
  const RigFile rig = place.rig(kMocap, kRobot);
  RecordedStreams streams = place.streams();
  for (JointStream& s : streams.joints)  // brakes hold three of five rests
    for (size_t i = 1; i < s.readings.size() && s.joint == "a"; ++i) {
      const double t = s.readings.times[i], k = std::floor(t / 3);
      if (static_cast<int>(k) % 2 == 0 && t - 3 * k > 0.1 && t - 3 * k < 2)
        s.readings.values[i] = s.readings.values[i - 1];
    }
  RecordedStreams again = streams;
  ImportOptions options;
  const RecordedSamples by_noise = import_recordings({}, rig, streams, nullptr, options);
  options.still_joints = 0.0015;
  CHECK(import_recordings({}, rig, again, nullptr, options).samples.size() == 5);
  REQUIRE(by_noise.samples.size() == 5);
  const int a = rig.rig.tree.find_joint("a");  // a repeated reading has the sigma of one
  CHECK(joint_sigma(rig.rig, by_noise.samples[2], a) ==
        Approx(std::hypot(1e-4, 2e-4)).epsilon(0.3));
}

TEST_CASE("import: a pause between two bags parts the rests before and after it") {
  for (const char* joint : {"", "a"}) {  // of all joints, or of one
    Place place;
    write_rests(place, Wire::ros1, 1e-5, 0, true);
    const RigFile rig = place.rig(kMocap, kRobot);
    RecordedStreams streams = place.streams();
    forget(streams, {7.8, 9.2}, joint);  // from the third rest to the fourth one
    const RecordedSamples found = import_recordings({}, rig, streams, nullptr, ImportOptions());
    CHECK(found.samples.size() == 5);
    for (size_t k = 0; k < found.samples.size(); ++k)
      CHECK(found.samples[k].views[0].z[0] == Approx(0.2 * static_cast<double>(k)).margin(1e-5));
  }
}

TEST_CASE("import: joints that are missing, by name") {
  const auto notes_of = [](const std::string& urdf, const std::string& rig_text) {
    Place place;
    write_rests(place, Wire::ros1, 1e-5, 0, true);
    const RigFile rig = place.rig(rig_text, urdf);
    RecordedStreams streams = place.streams();
    std::string notes;
    const RecordedSamples found = import_recordings({}, rig, streams, nullptr, ImportOptions());
    for (const std::string& note : found.notes) notes += note + "\n";
    return notes + found.diagnosis;
  };
  std::string urdf = kRobot, rig = kMocap;
  urdf.replace(urdf.find("'b'"), 3, "'arm_b'");
  rig.replace(rig.find("b: {s"), 1, "arm_b");
  const std::string notes = notes_of(urdf, rig);
  CHECK(notes.find("joint 'arm_b' is on no topic: views that depend on it give no samples; the "
                   "recording has: a, b") != std::string::npos);
  CHECK(notes.find("joint 'arm_b' has no readings when targets are seen") != std::string::npos);

  Place place;  // one that stops midway
  write_rests(place, Wire::ros1, 1e-5, 0, true);
  const RigFile whole = place.rig(kMocap, kRobot);
  RecordedStreams streams = place.streams();
  forget(streams, {7, 100}, "b");
  const RecordedSamples found = import_recordings({}, whole, streams, nullptr, ImportOptions());
  REQUIRE(found.notes.size() == 1);
  CHECK(found.notes[0].find("joint 'b' has no readings for 7.0 s, starting at 7.0 s") == 0);
  std::string lines;
  for (const std::string& line : found.lines) lines += line + "\n";
  CHECK(lines.find("left out, joint 'b' has no reading then: 2 of 5 rests: rest_0004") !=
        std::string::npos);
}

TEST_CASE("import: messages that are there again count once") {
  Place place;
  place.open(Wire::cdr);
  const int topic = place.bag->add_topic("/joint_states", "sensor_msgs/JointState"),
            images = place.bag->add_topic("/eye/image_raw", "sensor_msgs/Image");
  for (int i = 0; i < 20; ++i)
    for (int copy = 0; copy < 2; ++copy) {
      const double reading = i == 7 ? kInfinity : 0.1;
      place.bag->write(topic, at(0.1 * i),
                       joint_state_message(Wire::cdr, at(0.1 * i), {"a", "b"}, {reading, 0}));
      place.bag->write(images, at(0.1 * i),
                       image_message(Wire::cdr, at(0.1 * i), "eye", {2, 2, "abcd"}));
      if (i == 3)  // the same picture without stamps, at another time: two
        place.bag->write(images, at(5 + copy), image_message(Wire::cdr, 0, "eye", {2, 2, "abcd"}));
    }
  const RecordedStreams streams = place.streams();
  std::string notes;
  for (const std::string& note : streams.notes) notes += note + "\n";
  INFO(notes);
  REQUIRE(streams.notes.size() == 3);
  CHECK(streams.notes[0].find("40 messages of /eye/image_raw, /joint_states are there again") == 0);
  CHECK(streams.notes[1].find("/joint_states: 1 readings of joint 'a' are not finite") == 0);
  CHECK(streams.joints[0].readings.size() == 19);
  REQUIRE(streams.images[0].times.size() == 42);  // in the order of the bag
  CHECK(streams.images[0].times[2] == Approx(0.1));
  CHECK(std::isnan(streams.images[0].times[3]));
  CHECK(streams.images[0].times[7] == Approx(5));
  CHECK(streams.images[0].times[9] == Approx(6));
}

TEST_CASE("import: readings that come too slowly are said") {
  Place place;
  place.open(Wire::ros1);
  const int topic = place.bag->add_topic("/joint_states", "sensor_msgs/JointState");
  for (int i = 0; i < 40; ++i)
    place.bag->write(topic, at(0.5 * i),
                     joint_state_message(Wire::ros1, at(0.5 * i), {"a", "b"}, {0.1, 0.2}));
  const RecordedStreams streams = place.streams();
  const TopicMap topics = find_topics(place.rig(kMocap, kRobot), streams);
  bool said = false;
  for (const std::string& note : topics.notes)
    said = said || note.find("/joint_states: 2 readings per second are too few") == 0;
  CHECK(said);
}

TEST_CASE("import: stamps of 0 and of another clock are said and replaced") {
  Place place;
  write_rests(place, Wire::ros1, 1e-5, 5e5, false);
  const RigFile rig = place.rig(kMocap, kRobot);
  RecordedStreams streams = place.streams();
  REQUIRE(streams.notes.size() == 2);
  CHECK(streams.notes[0].find("/arm/joint_states: 1401 messages have no stamp (0)") == 0);
  CHECK(streams.notes[1].find("/vrpn/plate/pose: its stamps are of another clock, 500000.0 s "
                              "before those of the joints by the times of reception") == 0);
  CHECK(import_recordings({}, rig, streams, nullptr, ImportOptions()).samples.size() == 5);
}

TEST_CASE("import: clocks seconds apart are told by the times of reception") {
  for (const double apart : {-37., 1.3}) {
    Place place;
    write_rests(place, Wire::cdr, 1e-5, apart, true);
    const RigFile rig = place.rig(kMocap, kRobot);
    RecordedStreams streams = place.streams();
    REQUIRE(streams.notes.size() == 1);
    CHECK_THAT(streams.notes[0],
               Catch::StartsWith(apart < 0 ? "/vrpn/plate/pose: its stamps are of another clock, "
                                             "37.0 s after those of the joints"
                                           : "/vrpn/plate/pose: its stamps are of another clock, "
                                             "1.3 s before those of the joints"));
    const RecordedSamples found = import_recordings({}, rig, streams, nullptr, ImportOptions());
    REQUIRE(found.samples.size() == 5);
    for (const Sample& sample : found.samples) {  // poses have a and b as x and y
      const int a = rig.rig.tree.find_joint("a"), b = rig.rig.tree.find_joint("b");
      CHECK(std::abs(sample.views[0].z[0] - sample.readings[a]) < 1e-4);
      CHECK(std::abs(sample.views[0].z[1] - sample.readings[b]) < 1e-4);
    }
  }
}

TEST_CASE("import: stamps in another unit are said") {
  Place place;
  place.open(Wire::ros1);
  const int joints = place.bag->add_topic("/joint_states", "sensor_msgs/JointState"),
            images = place.bag->add_topic("/eye/image_raw", "sensor_msgs/Image");
  for (int i = 0; i < 40; ++i) {
    place.bag->write(joints, at(0.1 * i),
                     joint_state_message(Wire::ros1, at(0.1 * i), {"a", "b"}, {0.1, 0.2}));
    place.bag->write(images, at(0.1 * i),
                     image_message(Wire::ros1, at(100. * i + 1), "eye", {2, 2, "abcd"}));
  }
  const RecordedStreams streams = place.streams();
  REQUIRE(streams.notes.size() == 1);
  CHECK(streams.notes[0].find("/eye/image_raw: its stamps pass 1e+03 times as fast as the clock of "
                              "the recording: are they in another unit (milliseconds") == 0);
}

TEST_CASE("import: stamps that go back are said") {
  Place place;
  place.open(Wire::ros1);
  const int joints = place.bag->add_topic("/joint_states", "sensor_msgs/JointState"),
            images = place.bag->add_topic("/eye/image_raw", "sensor_msgs/Image");
  for (int i = 0; i < 400; ++i) {
    const double late = i >= 160 ? 2 : 0;  // of the joints; images come out of order by a little
    place.bag->write(
        joints, at(0.1 * i),
        joint_state_message(Wire::ros1, at(0.1 * i - late), {"a", "b"}, {0.1, 1e-4 * i}));
    place.bag->write(
        images, at(0.1 * i),
        image_message(Wire::ros1, at(0.1 * i - (i % 2 ? 0.15 : 0)), "eye", {2, 2, "abcd"}));
  }
  const RecordedStreams streams = place.streams();
  REQUIRE(streams.notes.size() == 1);
  CHECK_THAT(streams.notes[0],
             Catch::StartsWith("/joint_states: its stamps go back by 1.9 s, 16.0 s after the "
                               "start: ") &&
                 Catch::Contains("Record again"));
}

TEST_CASE("import: a bag without messages") {
  Place place;
  place.open(Wire::ros1);
  place.bag->add_topic("/joint_states", "sensor_msgs/JointState");
  RecordedStreams streams = place.streams();
  const RigFile rig = place.rig(kMocap, kRobot);
  CHECK(import_recordings({}, rig, streams, nullptr, ImportOptions()).diagnosis ==
        "it has no messages of joints, poses, images or scans");
}

TEST_CASE("import: joints that only a command has") {
  Place place;
  place.open(Wire::ros1);
  const int topic = place.bag->add_topic("/arm/command", "sensor_msgs/JointState");
  for (int i = 0; i < 400; ++i)
    place.bag->write(topic, at(0.01 * i),
                     joint_state_message(Wire::ros1, at(0.01 * i), {"a", "b"}, {0.1, 0.2}));
  const TopicMap topics = find_topics(place.rig(kMocap, kRobot), place.streams());
  REQUIRE(topics.notes.size() >= 1);
  CHECK_THAT(
      topics.notes[0],
      Catch::StartsWith("views that depend on joints a, b give no samples: only /arm/command has "
                        "them") &&
          Catch::Contains("write `topic: /arm/command`"));
}

TEST_CASE("import: topics that contradict each other are refused") {
  const auto streams_of = [](double off) {
    Place place;
    place.open(Wire::ros1);
    RandomStream draws(4);
    const int one = place.bag->add_topic("/joint_states", "sensor_msgs/JointState"),
              other = place.bag->add_topic("/left/joint_states", "sensor_msgs/JointState");
    for (int i = 0; i < 900; ++i) {
      const double t = 0.01 * i, a = path_of(t, 0.2);
      place.bag->write(
          one, at(t),
          joint_state_message(Wire::ros1, at(t), {"a", "b"}, {a + 1e-5 * draws.normal(), -a}));
      if (i % 2 == 0)
        place.bag->write(other, at(t),
                         joint_state_message(Wire::ros1, at(t), {"a", "b"},
                                             {a + off + 1e-5 * draws.normal(), 2 * kPi - a}));
    }
    return place.streams();
  };
  Place place;
  const RigFile rig = place.rig(kMocap, kRobot);
  const RecordedStreams wrong = streams_of(0.01), right = streams_of(0);
  CHECK_THROWS_WITH(
      find_topics(rig, wrong),
      Catch::Contains("joints: topics '/joint_states' and '/left/joint_states' contradict each "
                      "other: joint 'a' is ") &&
          Catch::Contains("write `topic: /joint_states` or `topic: /left/joint_states` into "
                          "`joints` of the rig"));
  CHECK_NOTHROW(find_topics(rig, right));  // a joint that turns on and on: whole turns
  const std::string chosen = std::string(kMocap).replace(kMocap.find("joints: {"), 9,
                                                         "joints: {topic: /left/joint_states, ");
  CHECK(find_topics(place.rig(chosen), wrong).joints[0] >= 0);
}

TEST_CASE("import: names of joints with something before them") {
  Place place;
  place.open(Wire::cdr);
  const int topic = place.bag->add_topic("/joint_states", "sensor_msgs/JointState");
  for (int i = 0; i < 400; ++i)
    place.bag->write(topic, at(0.01 * i),
                     joint_state_message(Wire::cdr, at(0.01 * i),
                                         {"left_a", "left_b", "right_a", "right_b", "w"},
                                         {0.1, 0.2, 0.3, 0.4, 0.5}));
  const RecordedStreams streams = place.streams();
  CHECK_THROWS_WITH(find_topics(place.rig(kMocap, kRobot), streams),
                    Catch::Contains("no joint of the recording is one of the robot's, but all are "
                                    "with something before it: write `prefix: left_` or `prefix: "
                                    "right_` into `joints` of the rig"));
  const auto with = [&](const std::string& prefix) {
    return place.rig(std::string(kMocap).replace(kMocap.find("joints: {"), 9,
                                                 "joints: {prefix: " + prefix + ", "));
  };
  const RigFile rig = with("right_");
  const TopicMap topics = find_topics(rig, streams);
  const int a = topics.joints[static_cast<size_t>(rig.rig.tree.find_joint("a"))];
  REQUIRE(a >= 0);
  CHECK(streams.joints[static_cast<size_t>(a)].joint == "right_a");
  CHECK_THROWS_WITH(find_topics(with("middle_"), streams),
                    Catch::Contains("no joint of the recording is 'middle_' and the name of one of "
                                    "the robot's") &&
                        Catch::Contains("`prefix: left_` or `prefix: right_`"));
}

TEST_CASE("import: which topics are the joints'") {
  Place place;
  write_rests(place, Wire::cdr, 1e-5, 0, true);
  const RecordedStreams streams = place.streams();
  const RigFile rig = place.rig(kMocap, kRobot);
  TopicMap topics = find_topics(rig, streams);
  const auto topic = [&](const char* joint) {
    const int i = topics.joints[static_cast<size_t>(rig.rig.tree.find_joint(joint))];
    return i < 0 ? "" : streams.joints[static_cast<size_t>(i)].topic;
  };
  CHECK(topic("a") == "/arm/joint_states");
  CHECK(topic("b") == "/hand/joint_states");
  CHECK(topics.lines.size() == 3);
  const std::string chosen =
      std::string(kMocap).replace(kMocap.find("joints: {"), 9, "joints: {topic: [/arm/command], ");
  topics = find_topics(place.rig(chosen), streams);
  CHECK(topic("a") == "/arm/command");
  const std::string wrong = std::string(kMocap).replace(kMocap.find("joints: {"), 9,
                                                        "joints: {topic: /arm/joint_state, ");
  CHECK_THROWS_WITH(find_topics(place.rig(wrong), streams),
                    Catch::Contains("joints.topic: '/arm/joint_state' is not in the recording; "
                                    "nearest: /arm/joint_states"));
}

TEST_CASE("import: nothing rests, and postures that are there already") {
  Place place;
  place.open(Wire::ros1);
  const int topic = place.bag->add_topic("/joint_states", "sensor_msgs/JointState");
  for (int i = 0; i < 1000; ++i)
    place.bag->write(
        topic, at(0.01 * i),
        joint_state_message(Wire::ros1, at(0.01 * i), {"a", "b"}, {std::sin(0.01 * i), 0.1}));
  const RigFile rig = place.rig(kMocap, kRobot);
  RecordedStreams streams = place.streams();
  const RecordedSamples none = import_recordings({}, rig, streams, nullptr, ImportOptions());
  CHECK(none.samples.empty());
  CHECK(none.diagnosis.find("joint 'a' is never still for 0.5 s: it moves by") == 0);

  Place other;
  write_rests(other, Wire::ros1, 1e-5, 0, true);
  RecordedStreams rests = other.streams();
  ImportOptions options;
  options.distinct = 0.35;  // every second posture is further away
  CHECK(import_recordings({}, rig, rests, nullptr, options).samples.size() == 3);
}

TEST_CASE("import: the reading of a floating joint by poses and by frames") {
  const std::string flange =
      "format: kincal/1\nrobot: {base: base, flange: tool0}\njoints: {flange: {sigma: "
      "{translation: 0.0001, rotation: 0.0002}}}\ntargets:\n  plate: {type: points, points: [[0, "
      "0, "
      "0], [0.1, 0, 0], [0, 0.1, 0]], mount: {link: tool0}}\nsensors:\n  mocap: {type: pose, link: "
      "base, topic: /mocap/pose, sigma: {translation: 0.0001, rotation: 0.0002}}\n";
  const Pose fixed{exp_so3(Vector3d(0.3, 0, 0)), Vector3d(0, 0, 0.5)};
  const Pose tip{exp_so3(Vector3d(0, 0.2, 0)), Vector3d(0.1, 0, 0)};
  for (const bool frames : {true, false}) {
    Place place;
    place.open(Wire::cdr);
    const int tf =
                  place.bag->add_topic(frames ? "/tf" : "/tcp_pose",
                                       frames ? "tf2_msgs/TFMessage" : "geometry_msgs/PoseStamped"),
              still = place.bag->add_topic("/tf_static", "tf2_msgs/TFMessage"),
              mocap = place.bag->add_topic("/mocap/pose", "geometry_msgs/PoseStamped");
    place.bag->write(still, at(0), tf_message(Wire::cdr, at(0), "base", "stand", fixed));
    place.bag->write(still, at(0), tf_message(Wire::cdr, at(0), "wrist", "tool0", tip));
    const auto stand_T_wrist = [](double t) {
      return Pose{exp_so3(Vector3d(0, 0, path_of(t, 0.2))), Vector3d(path_of(t, 0.1), 0, 0)};
    };
    for (int i = 0; i <= 700; ++i) {
      const double t = 0.02 * i;
      const Pose whole = fixed * stand_T_wrist(t) * tip;
      place.bag->write(tf, at(t),
                       frames ? tf_message(Wire::cdr, at(t), "stand", "wrist", stand_T_wrist(t))
                              : pose_message(Wire::cdr, at(t), whole));
      place.bag->write(mocap, at(t), pose_message(Wire::cdr, at(t), whole));
    }
    const RigFile rig = place.rig(flange);
    RecordedStreams streams = place.streams();
    const RecordedSamples found = import_recordings({}, rig, streams, nullptr, ImportOptions());
    INFO((found.notes.empty() ? "" : found.notes[0]) << found.diagnosis);
    REQUIRE(found.samples.size() == 5);
    const int joint = rig.rig.tree.find_joint("flange");
    for (size_t k = 0; k < 5; ++k) {
      const Pose reading = pose_reading(rig.rig.tree, joint, found.samples[k].readings);
      const Pose truth = fixed * stand_T_wrist(3. * static_cast<double>(k) + 1) * tip;
      CHECK(log_se3(inverse(truth) * reading).norm() < 1e-6);
      CHECK(found.samples[k].views.size() == 1);
    }
  }
}

namespace {

const std::string kCameras =
    "format: kincal/1\nrobot: robot.urdf\nbase: base\ntargets:\n  plate: {type: points, points: "
    "[[0, "
    "0, 0], [0.1, 0, 0], [0, 0.1, 0]], mount: free}\nsensors:\n";

std::string camera_entry(const std::string& name, const std::string& more) {
  return "  " + name +
         ": {type: camera, model: pinhole, intrinsics: [500, 500, 3, 2], sigma: 0.1, " + more +
         "}\n";
}

void add_camera(Place& place, const std::string& space, const std::string& frame, int width,
                double focal) {
  const std::string pixels(static_cast<size_t>(width) * 4, 'x');
  const int images = place.bag->add_topic(space + "/image_raw", "sensor_msgs/Image"),
            infos = place.bag->add_topic(space + "/camera_info", "sensor_msgs/CameraInfo");
  CameraNumbers numbers;
  numbers.width = static_cast<std::uint32_t>(width);
  numbers.height = 4;
  numbers.model = "plumb_bob";
  numbers.distortion.assign(5, 0);
  numbers.intrinsics[0] = numbers.intrinsics[1] = focal;
  numbers.intrinsics[2] = 3;
  numbers.intrinsics[3] = 2;
  for (int i = 0; i < 3; ++i) {
    place.bag->write(images, at(i),
                     image_message(place.bag->wire(), at(i), frame, {numbers.width, 4, pixels}));
    place.bag->write(infos, at(i), camera_info_message(place.bag->wire(), at(i), frame, numbers));
  }
}

}  // namespace

TEST_CASE("import: which topics are the cameras'") {
  Place place;
  place.open(Wire::ros1);
  add_camera(place, "/front", "one", 6, 500);
  add_camera(place, "/stereo/left", "x", 6, 510);
  add_camera(place, "/stereo/right", "x", 6, 500);
  add_camera(place, "/other", "y", 8, 500);
  const int text = place.bag->add_topic("/robot_description", "std_msgs/String");
  place.bag->write(text, at(0),
                   text_message(Wire::ros1, "<robot name='q'><link name='base'/></robot>"));
  const RecordedStreams streams = place.streams();
  const auto found = [&](const std::string& sensors) {
    const RigFile rig = place.rig(kCameras + sensors, kRobot);
    return std::pair(find_topics(rig, streams), rig.rig.sensors.size());
  };
  const auto topic = [&](const TopicMap& map, size_t sensor) {
    const int i = map.images[sensor];
    return i < 0 ? "" : streams.images[static_cast<size_t>(i)].topic;
  };
  SECTION("by frame, name and size") {
    const TopicMap map = found(camera_entry("eye", "link: one, image_size: [6, 4]") +
                               camera_entry("left", "link: two, image_size: [6, 4]") +
                               camera_entry("right", "link: two, image_size: [6, 4]") +
                               camera_entry("wide", "link: two, image_size: [8, 4]"))
                             .first;
    CHECK(topic(map, 0) == "/front/image_raw");
    CHECK(topic(map, 1) == "/stereo/left/image_raw");
    CHECK(topic(map, 2) == "/stereo/right/image_raw");
    CHECK(topic(map, 3) == "/other/image_raw");  // what is left
    std::string notes;
    for (const std::string& note : map.notes) notes += note + "\n";
    CHECK(notes.find("sensor 'left': /stereo/left/camera_info has another lens than the rig: fx fy "
                     "cx cy are 510 510 3 2, the rig's 500 500 3 2") != std::string::npos);
    CHECK(notes.find("is another than the rig's") != std::string::npos);
    CHECK(notes.find("it has no joint a, b, w") != std::string::npos);
    CHECK(notes.find("no topic has joint states: the readings of a, b are missing") !=
          std::string::npos);
    CHECK(map.notes.size() == 3);
  }
  SECTION("what is not clear stays open") {
    const TopicMap map = found(camera_entry("eye", "link: two, image_size: [6, 4]")).first;
    CHECK(topic(map, 0).empty());
    bool said = false;
    for (const std::string& note : map.notes)
      said = said || note.find("several topics may have its images") != std::string::npos;
    CHECK(said);
  }
  SECTION("as the rig says") {
    const TopicMap map = found(camera_entry("eye", "link: two, topic: /other") +
                               camera_entry("ear", "link: two, topic: /front/image_raw") +
                               camera_entry("lost", "link: two, topic: /frond/image_raw"))
                             .first;
    CHECK(topic(map, 0) == "/other/image_raw");
    CHECK(topic(map, 1) == "/front/image_raw");
    CHECK(topic(map, 2).empty());
    bool said = false;
    for (const std::string& note : map.notes)
      said = said || note.find("nearest: /front/image_raw") != std::string::npos;
    CHECK(said);
  }
}

TEST_CASE("import: cameras that are exchanged, at the root, or of another size") {
  Place place;
  place.open(Wire::ros1);
  for (const auto& [space, frames] : std::map<std::string, std::array<const char*, 2>>{
           {"/left", {"two", "one"}}, {"/right", {"one", "two"}}}) {
    const int images = place.bag->add_topic(space + "/image_raw", "sensor_msgs/Image"),
              infos = place.bag->add_topic(space + "/camera_info", "sensor_msgs/CameraInfo");
    CameraNumbers numbers;
    numbers.width = 6, numbers.height = 4;
    numbers.intrinsics[0] = numbers.intrinsics[1] = 500;
    numbers.intrinsics[2] = 3, numbers.intrinsics[3] = 2;
    place.bag->write(images, at(0),
                     image_message(Wire::ros1, at(0), frames[0], {6, 4, std::string(24, 'x')}));
    place.bag->write(infos, at(0), camera_info_message(Wire::ros1, at(0), frames[1], numbers));
  }
  for (const char* topic : {"/cam0", "/cam1"})
    place.bag->write(place.bag->add_topic(topic, "sensor_msgs/Image"), at(0),
                     image_message(Wire::ros1, at(0), "", {7, 4, std::string(28, 'x')}));
  const int text = place.bag->add_topic("/robot_description", "std_msgs/String");
  std::string robot = kRobot;
  robot.replace(robot.find("1 0 0"), 5, "1.02 0 0");
  robot.replace(robot.find("revolute"), 8, "continuous");
  robot.replace(robot.rfind("0 1 0"), 5, "0 0 1");
  place.bag->write(text, at(0), text_message(Wire::ros1, robot));
  const RecordedStreams streams = place.streams();
  const auto found = [&](const std::string& sensors, std::string& notes) {
    const TopicMap map = find_topics(place.rig(kCameras + sensors, kRobot), streams);
    for (const std::string& note : map.notes) notes += note + "\n";
    return map;
  };
  std::string notes;
  const TopicMap map = found(camera_entry("left", "link: one, image_size: [6, 4]") +
                                 camera_entry("right", "link: two, image_size: [6, 4]") +
                                 camera_entry("hand", "link: two, image_size: [7, 4]") +
                                 camera_entry("big", "link: two, image_size: [9, 9]"),
                             notes);
  INFO(notes);
  CHECK(streams.images[static_cast<size_t>(map.images[0])].topic == "/right/image_raw");
  CHECK(streams.images[static_cast<size_t>(map.images[1])].topic == "/left/image_raw");
  const auto said = [&](const std::string& what) { return notes.find(what) != std::string::npos; };
  CHECK(
      said("sensor 'left': its images (/right/image_raw) are of frame 'one', /right/camera_info "
           "is of frame 'two'"));
  CHECK(said("sensor 'hand': several topics may have its images (/cam0, /cam1)"));
  CHECK(
      said("sensor 'big': no images of its image_size, 9 x 9, in the recording, but /cam0 (7 x 4)"
           ", /cam1 (7 x 4)"));
  CHECK(said("differs from the rig's (" + place.path +
             "/robot.urdf): joint 'a' is continuous, the "
             "rig's revolute; joint 'w' has another axis; 1 joints have another origin, 'b' most: "
             "20 mm, 0 mrad"));
}

namespace {

/// An image of 6 x 4 pixels in an encoding, whose colour at a place is `colour`.
Picture grey_of(const std::string& encoding, int bytes, int channels,
                const std::function<int(int row, int column, int channel)>& value,
                bool big_endian = false) {
  MessageBytes message(Wire::ros1);
  std::string pixels;
  const int step = 6 * channels * bytes + 4;  // lines may be longer than their pixels
  for (int r = 0; r < 4; ++r) {
    std::string line;
    for (int c = 0; c < 6; ++c)
      for (int k = 0; k < channels; ++k) {
        const int v = value(r, c, k);
        const char low = static_cast<char>(v & 255), high = static_cast<char>(v >> 8);
        if (bytes == 1)
          line += low;
        else
          line += big_endian ? std::string{high, low} : std::string{low, high};
      }
    line.resize(static_cast<size_t>(step), '\x7f');
    pixels += line;
  }
  message.header(0, "").number(std::uint32_t{4}).number(std::uint32_t{6}).text(encoding);
  message.number(static_cast<std::uint8_t>(big_endian)).number(static_cast<std::uint32_t>(step));
  message.bytes(pixels);
  static const MessageTypes types = read_definition(
      "sensor_msgs/Image", message_identity(Wire::ros1, "sensor_msgs/Image").definition);
  return grey_picture(decode_message(types, Wire::ros1, message.str()));
}

}  // namespace

TEST_CASE("import: every encoding gives the same grey") {
  const auto grey = [](int r, int c) { return 20 * r + 7 * c + 10; };
  const auto check = [&](const Picture& picture, int tolerance) {
    REQUIRE(picture.width == 6);
    REQUIRE(picture.height == 4);
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 6; ++c)
        CHECK(std::abs(picture.pixels[static_cast<size_t>(6 * r + c)] - grey(r, c)) <= tolerance);
  };
  const auto same = [&](int r, int c, int) { return grey(r, c); };
  for (const char* encoding : {"mono8", "8UC1"}) check(grey_of(encoding, 1, 1, same), 0);
  for (const char* encoding : {"bgr8", "rgb8", "8UC3"}) check(grey_of(encoding, 1, 3, same), 0);
  for (const char* encoding : {"bgra8", "rgba8", "8UC4"}) check(grey_of(encoding, 1, 4, same), 0);
  check(grey_of("yuv422", 1, 2, [&](int r, int c, int k) { return k == 1 ? grey(r, c) : 128; }), 0);
  check(grey_of("yuv422_yuy2", 1, 2, [&](int r, int c, int k) { return k ? 128 : grey(r, c); }), 0);
  // Red counts 0.299, blue 0.114, wherever they stand.
  const auto red = [](const char* e, int channel) {
    return grey_of(e, 1, 3, [=](int, int, int k) { return k == channel ? 200 : 0; }).pixels[0];
  };
  CHECK(red("rgb8", 0) == 60);
  CHECK(red("bgr8", 2) == 60);
  CHECK(red("rgb8", 2) == 23);
  CHECK(red("bgr8", 0) == 23);
  // Of a mosaic of one colour each pixel is that colour; red alone counts as much as it does.
  for (const std::string pattern : {"rggb", "bggr", "gbrg", "grbg"}) {
    const auto one = [&](char colour) {
      return grey_of("bayer_" + pattern + "8", 1, 1, [&](int r, int c, int) {
        return pattern[static_cast<size_t>(r % 2 * 2 + c % 2)] == colour ? 200 : 0;
      });
    };
    for (const auto& pixel : one('r').pixels) CHECK(pixel == 60);
    for (const auto& pixel : one('g').pixels) CHECK(pixel == 117);
    for (const auto& pixel : one('b').pixels) CHECK(pixel == 23);
  }
  // 16 bits: the picture's own range, in either order of bytes.
  for (const bool big : {false, true}) {
    const Picture deep = grey_of(
        "mono16", 2, 1, [](int r, int c, int) { return 1000 + 100 * (6 * r + c); }, big);
    CHECK(deep.pixels[0] == 0);
    CHECK(deep.pixels[23] == 255);
    CHECK(std::abs(deep.pixels[12] - 133) <= 1);
  }
  CHECK_THROWS_AS(grey_of("32FC1", 4, 1, same), Damage);
  CHECK(compressed_format("\xff\xd8\xff\xe0") == "jpg");
  CHECK(compressed_format("\x89PNG\r\n") == "png");
  CHECK(compressed_format("theora").empty());
}

TEST_CASE("import: which hand holds the board") {
  Laboratory lab(2, 64);
  std::vector<int> holders;  // as they were simulated
  for (Sample& sample : lab.samples) {
    int holder = -1;
    std::vector<View> others;
    for (const View& view : sample.views)
      if (lab.rig.sensors[static_cast<size_t>(view.sensor)].type == "chain")
        holder = view.sensor;
      else
        others.push_back(view);
    sample.views = others;
    holders.push_back(holder);
  }
  add_holding_chains(lab.rig, lab.samples);
  int held = 0, right = 0;
  for (size_t i = 0; i < lab.samples.size(); ++i) {
    int found = -1;
    for (const View& view : lab.samples[i].views)
      if (lab.rig.sensors[static_cast<size_t>(view.sensor)].type == "chain") found = view.sensor;
    held += holders[i] >= 0;
    right += found == holders[i];
  }
  CHECK(held == 60);
  CHECK(right == static_cast<int>(lab.samples.size()));
}

}  // namespace import_test
