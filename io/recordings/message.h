// ROS messages of any type, read as the definition that a bag carries says. Numbers, texts and
// arrays of numbers stay where they are in the message; nothing is copied but the tree.
//
// Wire formats. ROS 1: everything little-endian, one after the other; a text or an array of no
// fixed size has its count (uint32) before it. CDR (ROS 2; OMG's DDSI-RTPS 2.2, 9.3): four bytes
// that say the order of bytes, then the same, but that each number starts at a multiple of its
// size, counted from after these four, and that a text's count includes a zero at its end.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace kincal {

enum class Wire { ros1, cdr };

enum class FieldKind {
  boolean,
  int8,
  uint8,
  int16,
  uint16,
  int32,
  uint32,
  int64,
  uint64,
  float32,
  float64,
  time,      // ROS 1's, two uint32: s, ns; ROS 2's message of int32 and uint32
  duration,  // two int32
  text,
  message,
};

struct MessageField {
  std::string name;
  FieldKind kind = FieldKind::message;
  int type = -1;  // of a message: which of all types
  bool array = false;
  std::uint64_t count = 0;  // of an array of fixed size; 0: it stands before it
};

struct MessageType {
  std::string name;  // sensor_msgs/JointState
  std::vector<MessageField> fields;
};

/// A message's type and all that it uses; the first is the message's own.
using MessageTypes = std::vector<MessageType>;

/// Reads a definition as ROS 1's bags and rosbag2 (ros2msg) have it: the message's fields, then
/// after lines of "=" "MSG: package/Type" and that type's fields, and so on. What it uses and does
/// not have is taken from the usual messages (standard_definition). @throws Damage saying what is
/// wrong
MessageTypes read_definition(const std::string& type, const std::string& text);

/// The definition of one of the usual messages of std_msgs, sensor_msgs, geometry_msgs and tf2_msgs
/// as ROS 2 has it, for files that carry none; empty: it is not one of them.
std::string standard_definition(const std::string& type);

/// An array of numbers as it lies in the message.
struct NumberArray {
  FieldKind kind = FieldKind::uint8;
  std::string_view bytes;
  bool swapped = false;

  size_t size() const;
  double operator[](size_t i) const;
};

/// One value of a message: nothing, an integer (times in ns), a number, a text, an array of
/// numbers, or several values: of a message's fields (`type` is set) or of an array.
struct MessageValue {
  std::variant<std::monostate, std::int64_t, double, std::string_view, NumberArray,
               std::vector<MessageValue>>
      value;
  const MessageType* type = nullptr;
};

/// Decodes a message. The value refers to `types` and `data`. @throws Damage
MessageValue decode_message(const MessageTypes& types, Wire wire, std::string_view data);

/// A field, or the field of a field: "header.stamp". A step in capitals is tried in small letters
/// as well (ROS 2 has k for K). @throws Damage naming what is not there
const MessageValue& field(const MessageValue& message, std::string_view path);

double number_of(const MessageValue& value);  ///< @throws Damage where it is none; so the next
std::int64_t nanoseconds_of(const MessageValue& value);
std::string_view text_of(const MessageValue& value);
NumberArray numbers_of(const MessageValue& value);
const std::vector<MessageValue>& list_of(const MessageValue& value);  ///< of an array

}  // namespace kincal
