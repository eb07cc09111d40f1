// The readers of recordings: containers as files, messages by the definition before them, and the
// messages of ROS's calibration packages made to samples. Proved beside what fuzz.cpp says: no
// message comes from a container with a time that is none, and every message that is decoded can
// be looked at, down to the last number.
#include <cmath>

#include "../../io/document/error.h"
#include "../../io/recordings/bag.h"
#include "../../io/recordings/bytes.h"
#include "../../io/recordings/message.h"
#include "../../io/recordings/robot_measurement.h"
#include "../../io/rig/samples_file.h"
#include "../recordings/bag_writer.h"
#include "fuzz.h"

namespace {

using namespace kincal;

/// Looks at everything of a message, and returns how much there is.
size_t looked_at(const MessageValue& value) {
  if (const auto* list = std::get_if<std::vector<MessageValue>>(&value.value)) {
    if (value.type && value.type->fields.size() != list->size())
      throw std::logic_error("a message has not as many values as its type has fields");
    size_t count = 1;
    for (const MessageValue& one : *list) count += looked_at(one);
    return count;
  }
  if (const auto* numbers = std::get_if<NumberArray>(&value.value)) {
    size_t count = 1;
    for (size_t i = 0; i < numbers->size(); ++i) count += !std::isnan((*numbers)[i]);
    return count;
  }
  if (const auto* text = std::get_if<std::string_view>(&value.value))
    return static_cast<size_t>(std::count(text->begin(), text->end(), ' '));
  return 1;
}

void bag(const std::string& text) {
  std::map<const Topic*, MessageTypes> types;
  const BagContents contents = read_bag(in_file("any.bag", text), [&](const BagMessage& m) {
    if (m.received < 0) throw std::logic_error("a time before 1970");
    try {
      if (!types.count(m.topic))
        types[m.topic] = read_definition(m.topic->type, m.topic->definition);
      looked_at(decode_message(types[m.topic], m.topic->encoding == "ros1" ? Wire::ros1 : Wire::cdr,
                               m.data));
    } catch (const Damage&) {
    }
    return true;
  });
  if (contents.losses.size() < 20 && contents.more_losses > 0)
    throw std::logic_error("losses are not said");
}

/// A line "package/Type ros1" (or cdr), a definition, a line ---, a message.
void message(const std::string& text) {
  const size_t line = text.find('\n'), end = text.find("---\n");
  if (line == std::string::npos || end == std::string::npos || end < line) return;
  const std::string first = text.substr(0, line), type = first.substr(0, first.find(' '));
  const bool ros1 = first.find(" ros1") != std::string::npos;
  try {
    const MessageTypes types = read_definition(type, text.substr(line + 1, end - line - 1));
    looked_at(decode_message(types, ros1 ? Wire::ros1 : Wire::cdr,
                             std::string_view(text).substr(end + 4)));
  } catch (const Damage& damage) {
    throw InputError(damage.what());
  }
}

/// A message of calibration_msgs/RobotMeasurement in ROS 1's format.
void measurement(const std::string& text) {
  const std::string line = std::string(80, '=') + "\nMSG: ";
  const std::string definition =
      "string sample_id\nstring target_id\nstring chain_id\nCameraMeasurement[] M_cam\n"
      "LaserMeasurement[] M_laser\nChainMeasurement[] M_chain\n" +
      line + "calibration_msgs/CameraMeasurement\nHeader header\nstring camera_id\n" +
      "geometry_msgs/Point[] image_points\n" + line +
      "calibration_msgs/LaserMeasurement\nHeader header\nstring laser_id\n" +
      "sensor_msgs/JointState[] joint_points\n" + line +
      "calibration_msgs/ChainMeasurement\nHeader header\nstring chain_id\n" +
      "sensor_msgs/JointState chain_state\n" + line +
      "std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
  const std::string bag = test::ros1_bag({{"/m", kRobotMeasurement, definition}},
                                         {{0, 1700000000000000000, text}}, "none", 1);
  std::vector<std::string> losses;
  const ImportedSamples found =
      read_robot_measurements({in_file("measurement.bag", bag)}, usual_rig(), losses);
  if (found.samples.empty() && losses.empty()) throw std::logic_error("a message is lost");
  if (found.samples.empty()) throw InputError(losses[0]);
  const Rig& rig = usual_rig().rig;
  const std::string written = samples_text(rig, found.samples);
  try {
    parse_samples(written, "written.jsonl", rig);
  } catch (const InputError& error) {
    // (A message may lack readings: whoever reads the samples is told which.)
    if (std::string(error.what()).find("which the sample lacks") == std::string::npos)
      throw std::logic_error(std::string("what was written cannot be read: ") + error.what());
  }
}

}  // namespace

Readers bag_readers() {
  return {{"ros1", bag},
          {"mcap", bag},
          {"sqlite", bag},
          {"message", message},
          {"measurement", measurement}};
}
