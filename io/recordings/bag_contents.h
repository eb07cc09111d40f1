// What a bag has: streams of messages, and what was lost of them.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace kincal {

/// One stream of messages, by one publisher.
struct Topic {
  std::string name;        // /joint_states
  std::string type;        // sensor_msgs/JointState, so in every container
  std::string definition;  // of the message and all that it uses; empty: the bag has none
  std::string encoding;    // ros1, cdr, or another that is not decoded
};

struct BagMessage {
  const Topic* topic;
  std::int64_t received;  // ns since 1970, by the recorder's clock; never negative
  std::string_view data;  // valid until the visitor returns
};

/// Gets each message; false ends the reading. It does not throw Damage (bytes.h): what is wrong
/// inside a message is its own affair.
using BagVisitor = std::function<bool(const BagMessage&)>;

/// What a bag has besides its messages.
struct BagContents {
  std::string container;                             // "ROS 1 bag", "MCAP", "rosbag2 SQLite"
  std::vector<std::shared_ptr<const Topic>> topics;  // those without messages as well
  std::vector<std::string> compressions;             // that occur: lz4, zstd, ...
  std::vector<std::string> losses;  // what could not be read, and where; the first 20
  std::uint64_t more_losses = 0;    // than these
};

}  // namespace kincal
