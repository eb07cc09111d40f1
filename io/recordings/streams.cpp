#include "streams.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <string_view>
#include <unordered_set>

#include "../../models/rig/numbers.h"
#include "bytes.h"
#include "robot_measurement.h"

namespace kincal {
namespace {

constexpr double kOtherRate = 2;   // of a clock; those that drift do by less than a thousandth
constexpr double kSetBack = 0.1;   // s; several publishers of a topic are less apart
constexpr double kUnderWay = 0.4;  // s, that messages of one stream are longer than another's
constexpr const char* kCodecs[] = {"h264", "h265", "hevc", "avc", "av1", "vp8", "vp9", "mpeg4"};
constexpr const char* kJointState = "sensor_msgs/JointState";

/// What one topic's messages have had of stamps so far.
struct Clock {
  std::vector<double> under_way;  // s, of messages with a stamp
  long without = 0;               // messages whose stamp is 0
  struct Time {
    std::int64_t stamp = 0, received = 0;  // ns
  } first, last;                           // messages with a stamp
  long set_back = 0;                       // times that a stamp is before the last one's
  std::int64_t largest = 0, when = 0;      // ns: by how much at most, and when received

  /// True if it has stamps and was not set meanwhile: only then it differs from others by one time.
  bool is_one() const { return !under_way.empty() && set_back == 0; }

  /// Returns how many times as fast as the recording's clock the stamps pass; 1 where they are few.
  double rate() const {
    const double passed = static_cast<double>(last.received - first.received);
    return passed > 2e9 ? static_cast<double>(last.stamp - first.stamp) / passed : 1;
  }
};

/// A Reader fills in the streams.
struct StreamReader {
  RecordedStreams out;
  MessageReader messages;
  std::map<std::string, Clock> clocks;  // by topic
  std::map<std::pair<std::string, std::string>, size_t> joints;
  std::map<std::array<std::string, 3>, size_t> poses;
  std::map<std::string, size_t> images, scans;
  std::set<std::string> infos, descriptions;
  std::unordered_set<std::uint64_t> seen;  // topic, stamp and bytes of messages
  std::map<std::string, long> repeated;    // by topic
  std::map<std::pair<std::string, std::string>, long> not_finite;  // by topic and joint
  std::optional<std::int64_t> first, last;

  double time_of(const BagMessage& raw, const MessageValue& header) {
    Clock& clock = clocks[raw.topic->name];
    const std::int64_t stamp = nanoseconds_of(field(header, "stamp"));
    if (stamp == 0) {
      ++clock.without;
      return seconds(raw.received);
    }
    const std::int64_t back = clock.under_way.empty() ? 0 : clock.last.stamp - stamp;
    if (static_cast<double>(back) > kSetBack * 1e9 && raw.received >= clock.last.received) {
      ++clock.set_back;
      if (back > clock.largest) clock.largest = back, clock.when = raw.received;
    }
    clock.last = {stamp, raw.received};
    if (clock.under_way.empty()) clock.first = clock.last;
    clock.under_way.push_back(static_cast<double>(raw.received - stamp) * 1e-9);
    return seconds(stamp);
  }

  /// True if the same message of the same topic was there before.
  bool again(const BagMessage& raw, const MessageValue& header) {
    const std::int64_t stamp = nanoseconds_of(field(header, "stamp"));
    std::uint64_t key = std::hash<std::string_view>()(raw.data);
    const auto mix = [&](std::uint64_t with) {
      key ^= with + 0x9e3779b97f4a7c15u + (key << 6) + (key >> 2);
    };
    mix(std::hash<std::string>()(raw.topic->name));
    mix(static_cast<std::uint64_t>(stamp != 0 ? stamp : raw.received));
    if (seen.insert(key).second) return false;
    ++repeated[raw.topic->name];
    return true;
  }

  /// The time of an image or scan; NaN: it is there again.
  double time_of_new(const BagMessage& raw, const MessageValue& header) {
    return again(raw, header) ? std::numeric_limits<double>::quiet_NaN() : time_of(raw, header);
  }

  double seconds(std::int64_t ns) const { return static_cast<double>(ns - out.origin) * 1e-9; }

  void joint_states(const BagMessage& raw, const MessageValue& value) {
    if (again(raw, field(value, "header"))) return;
    const double time = time_of(raw, field(value, "header"));
    const auto& names = list_of(field(value, "name"));
    const NumberArray positions = numbers_of(field(value, "position"));
    if (positions.size() == 0) return;  // velocities only
    if (names.size() != positions.size())
      throw Damage(std::to_string(names.size()) + " names and " + std::to_string(positions.size()) +
                   " positions");
    for (size_t i = 0; i < names.size(); ++i) {
      const std::pair<std::string, std::string> key{raw.topic->name,
                                                    std::string(text_of(names[i]))};
      const auto [at, is_new] = joints.emplace(key, out.joints.size());
      if (is_new) out.joints.push_back({key.first, key.second, {}});
      if (!std::isfinite(positions[i])) {
        ++not_finite[key];
        continue;
      }
      Series& series = out.joints[at->second].readings;
      series.times.push_back(time);
      series.values.push_back(positions[i]);
    }
  }

  static Pose pose_of(const MessageValue& translation, const MessageValue& rotation) {
    Pose out;
    Eigen::Vector4d q;
    for (int i = 0; i < 3; ++i) out.translation[i] = number_of(field(translation, "xyz"[i]));
    for (int i = 0; i < 4; ++i) q[i] = number_of(field(rotation, "xyzw"[i]));
    if (!out.translation.allFinite() || !(q.norm() > 0.5) || !(q.norm() < 2))
      throw Damage("its quaternion is none");
    out.rotation = rotation_from_quaternion(q);
    return out;
  }
  static const MessageValue& field(const MessageValue& message, char name) {
    return kincal::field(message, std::string_view(&name, 1));
  }
  static const MessageValue& field(const MessageValue& message, std::string_view path) {
    return kincal::field(message, path);
  }

  void pose(const BagMessage& raw, const MessageValue& value, bool transform) {
    const MessageValue& header = field(value, "header");
    const std::string frame(text_of(field(header, "frame_id"))),
        child(transform ? text_of(field(value, "child_frame_id")) : std::string_view());
    const Pose pose =
        transform
            ? pose_of(field(value, "transform.translation"), field(value, "transform.rotation"))
            : pose_of(field(value, "pose.position"), field(value, "pose.orientation"));
    const auto [at, is_new] =
        poses.emplace(std::array<std::string, 3>{raw.topic->name, frame, child}, out.poses.size());
    if (is_new)
      out.poses.push_back({raw.topic->name,
                           without_slash(frame),
                           without_slash(child),
                           raw.topic->name.find("tf_static") != std::string::npos,
                           {},
                           {}});
    out.poses[at->second].times.push_back(time_of(raw, header));
    out.poses[at->second].poses.push_back(pose);
  }

  static std::string without_slash(const std::string& frame) {  // tf of old had /base
    return !frame.empty() && frame[0] == '/' ? frame.substr(1) : frame;
  }

  /// True for images that are parts of a video: none of them is a picture by itself.
  static bool is_video_format(std::string format) {
    std::transform(format.begin(), format.end(), format.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return std::any_of(std::begin(kCodecs), std::end(kCodecs),
                       [&](const char* codec) { return format.find(codec) != std::string::npos; });
  }
  static bool is_video_type(const std::string& type) {
    return type == "foxglove_msgs/CompressedVideo" || type == "foxglove.CompressedVideo" ||
           type == "ffmpeg_image_transport_msgs/FFMPEGPacket" ||
           type == "theora_image_transport/Packet";
  }

  void image(const BagMessage& raw, const MessageValue& value) {
    const MessageValue& header = field(value, "header");
    const bool compressed = raw.topic->type == "sensor_msgs/CompressedImage";
    if (compressed)
      if (const std::string format(text_of(field(value, "format"))); is_video_format(format)) {
        out.videos.emplace(raw.topic->name, raw.topic->type + ", " + format);
        return;
      }
    const auto [at, is_new] = images.emplace(raw.topic->name, out.images.size());
    if (is_new) {
      ImageStream stream{raw.topic->name,
                         raw.topic->type,
                         without_slash(std::string(text_of(field(header, "frame_id")))),
                         "",
                         0,
                         0,
                         {}};
      stream.encoding = std::string(text_of(field(value, compressed ? "format" : "encoding")));
      if (!compressed) {
        stream.width = static_cast<int>(number_of(field(value, "width")));
        stream.height = static_cast<int>(number_of(field(value, "height")));
      }
      out.images.push_back(std::move(stream));
    }
    out.images[at->second].times.push_back(time_of_new(raw, header));
  }

  void scan(const BagMessage& raw, const MessageValue& value) {
    const MessageValue& header = field(value, "header");
    const auto [at, is_new] = scans.emplace(raw.topic->name, out.scans.size());
    if (is_new)
      out.scans.push_back({raw.topic->name,
                           raw.topic->type,
                           without_slash(std::string(text_of(field(header, "frame_id")))),
                           {}});
    out.scans[at->second].times.push_back(time_of_new(raw, header));
  }

  void info(const BagMessage& raw, const MessageValue& value) {
    if (!infos.insert(raw.topic->name).second) return;
    CameraInfoMessage info;
    info.topic = raw.topic->name;
    info.frame = without_slash(std::string(text_of(field(value, "header.frame_id"))));
    info.width = static_cast<int>(number_of(field(value, "width")));
    info.height = static_cast<int>(number_of(field(value, "height")));
    info.model = std::string(text_of(field(value, "distortion_model")));
    const NumberArray d = numbers_of(field(value, "D")), k = numbers_of(field(value, "K")),
                      p = numbers_of(field(value, "P"));
    for (size_t i = 0; i < d.size(); ++i) info.distortion.push_back(d[i]);
    if (k.size() != 9 || p.size() != 12) throw Damage("K must have 9 and P 12 numbers");
    const size_t of_k[] = {0, 4, 2, 5}, of_p[] = {0, 5, 2, 6};
    for (size_t i = 0; i < 4; ++i) info.k[i] = k[of_k[i]], info.p[i] = p[of_p[i]];
    if (p[0] != 0) info.baseline = 0 - p[3] / p[0];
    out.infos.push_back(std::move(info));
  }

  void message(const BagMessage& raw) {
    const std::string& type = raw.topic->type;
    if (!first) out.origin = raw.received;
    first = std::min(first.value_or(raw.received), raw.received);
    last = std::max(last.value_or(raw.received), raw.received);
    if (type == kJointState) return joint_states(raw, messages.read(raw));
    if (is_image_type(type)) return image(raw, messages.read(raw));
    if (is_video_type(type)) out.videos.emplace(raw.topic->name, type);
    if (type == "sensor_msgs/CameraInfo") {
      if (!infos.count(raw.topic->name)) info(raw, messages.read(raw));
      return;
    }
    if (type == "geometry_msgs/PoseStamped") return pose(raw, messages.read(raw), false);
    if (type == "geometry_msgs/TransformStamped") return pose(raw, messages.read(raw), true);
    if (type == "tf2_msgs/TFMessage" || type == "tf/tfMessage") {
      const MessageValue value = messages.read(raw);
      for (const MessageValue& one : list_of(field(value, "transforms"))) pose(raw, one, true);
    } else if (type == "sensor_msgs/LaserScan" || type == "sensor_msgs/PointCloud2") {
      scan(raw, messages.read(raw));
    } else if (type == "std_msgs/String" && ends_with_description(raw.topic->name)) {
      if (descriptions.insert(raw.topic->name).second)
        out.descriptions.emplace_back(raw.topic->name,
                                      std::string(text_of(field(messages.read(raw), "data"))));
    } else if (is_whole_posture(type)) {
      ++out.robot_measurements;
    }
  }

  static bool ends_with_description(const std::string& name) {
    constexpr std::string_view ending = "robot_description";
    return name.size() >= ending.size() &&
           name.compare(name.size() - ending.size(), ending.size(), ending) == 0;
  }
};

/// Puts values in the order of their times; of several at one time the first stays.
template <class Value>
void sort_by_time(std::vector<double>& times, std::vector<Value>& values) {
  const auto not_after = [&](size_t i) { return times[i] <= times[i - 1]; };
  bool sorted = true;
  for (size_t i = 1; i < times.size() && sorted; ++i) sorted = !not_after(i);
  if (sorted) return;
  std::vector<size_t> order(times.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return times[a] < times[b]; });
  std::vector<double> ordered_times;
  std::vector<Value> ordered;
  for (size_t i : order) {
    if (!ordered_times.empty() && times[i] == ordered_times.back()) continue;
    ordered_times.push_back(times[i]);
    ordered.push_back(values[i]);
  }
  times = std::move(ordered_times);
  values = std::move(ordered);
}

/// Says which streams have no stamps, and moves those of other clocks.
void put_on_one_clock(StreamReader& reader) {
  RecordedStreams& out = reader.out;
  std::optional<double> usual;  // s, of the joints, else of the first
  for (const bool of_joints : {true, false})
    for (const auto& [topic, clock] : reader.clocks)
      if (!usual && clock.is_one() &&
          (!of_joints || std::any_of(out.joints.begin(), out.joints.end(),
                                     [&t = topic](const JointStream& j) { return j.topic == t; })))
        usual = median(clock.under_way, 0);
  const auto timeless = [&](const std::string& topic) {
    return std::any_of(out.poses.begin(), out.poses.end(),
                       [&](const PoseStream& s) { return s.topic == topic && s.fixed; });
  };
  std::map<std::string, double> moved;  // by topic, s
  for (const auto& [topic, clock] : reader.clocks) {
    if (clock.without > 0)
      out.notes.push_back(topic + ": " + std::to_string(clock.without) +
                          " messages have no stamp (0): the time at which they were received is "
                          "taken, which is later and less regular");
    if (clock.under_way.empty() || timeless(topic)) continue;
    if (const double rate = clock.rate(); rate > kOtherRate || rate < 1 / kOtherRate) {
      char times[32];
      std::snprintf(times, sizeof times, "%.3g", rate);
      out.notes.push_back(topic + ": its stamps pass " + times +
                          " times as fast as the clock of the recording: are they in another unit "
                          "(milliseconds for seconds)? They do not fit the other streams");
      continue;
    }
    if (!usual || !clock.is_one()) continue;
    const double differs = median(clock.under_way, 0) - *usual;
    if (std::abs(differs) < kUnderWay) continue;
    moved[topic] = differs;
    char away[32];
    std::snprintf(away, sizeof away, "%.1f", std::abs(differs));
    out.notes.push_back(topic + ": its stamps are of another clock, " + away + " s " +
                        (differs < 0 ? "after" : "before") +
                        " those of the joints by the times of reception: they are moved so that "
                        "its messages have the same delay as those of the joints");
  }
  const auto move = [&](const std::string& topic, std::vector<double>& times) {
    const auto by = moved.find(topic);
    if (by != moved.end())
      for (double& t : times) t += by->second;
  };
  for (JointStream& s : out.joints) move(s.topic, s.readings.times);
  for (PoseStream& s : out.poses) move(s.topic, s.times);
  for (ImageStream& s : out.images) {
    move(s.topic, s.times);
    if (const auto by = moved.find(s.topic); by != moved.end()) s.moved = by->second;
  }
  for (ScanStream& s : out.scans) move(s.topic, s.times);
}

/// Says whose stamps go back although messages went on. (Those of /tf are of many publishers, who
/// date them ahead.)
void say_what_was_set_back(StreamReader& reader) {
  const auto of_frames = [&](const std::string& topic) {
    return std::any_of(reader.out.poses.begin(), reader.out.poses.end(),
                       [&](const PoseStream& s) { return s.topic == topic && !s.child.empty(); });
  };
  for (const auto& [topic, clock] : reader.clocks) {
    if (clock.set_back == 0 || of_frames(topic)) continue;
    char text[320];
    std::snprintf(
        text, sizeof text,
        ": its stamps go back by %.3g s, %.1f s after the start%s: the clock of the sender was set "
        "during the recording, so two parts have the same stamps. Record again with synchronised "
        "clocks (chrony) that are not set meanwhile, or give only the part before or after it",
        static_cast<double>(clock.largest) * 1e-9, reader.seconds(clock.when),
        clock.set_back > 1
            ? (" (" + std::to_string(clock.set_back) + " times, this the most)").c_str()
            : "");
    reader.out.notes.push_back(topic + text);
  }
}

/// Says what is there again, and readings that are no numbers.
void say_what_is_left_out(StreamReader& reader) {
  long messages = 0;
  std::string topics;
  for (const auto& [topic, count] : reader.repeated) {
    messages += count;
    topics += (topics.empty() ? "" : ", ") + topic;
  }
  if (messages > 0)
    reader.out.notes.push_back(std::to_string(messages) + " messages of " + topics +
                               " are there again, with the same stamp and content (the same bag "
                               "twice, or bags that overlap): each counts once");
  for (const auto& [which, count] : reader.not_finite)
    reader.out.notes.push_back(which.first + ": " + std::to_string(count) + " readings of joint '" +
                               which.second + "' are not finite: left out");
}

Pose between(const Pose& a, const Pose& b, double share) {
  return a * exp_se3(share * log_se3(inverse(a) * b));
}

}  // namespace

MessageValue MessageReader::read(const BagMessage& message) {
  const auto [at, is_new] = types_.emplace(message.topic, MessageTypes());
  if (is_new) try {
      at->second = read_definition(message.topic->type, message.topic->definition);
    } catch (...) {
      types_.erase(at);
      throw;
    }
  return decode_message(at->second, message.topic->encoding == "cdr" ? Wire::cdr : Wire::ros1,
                        message.data);
}

bool is_image_type(const std::string& type) {
  return type == "sensor_msgs/Image" || type == "sensor_msgs/CompressedImage";
}

void read_again(
    const std::vector<std::string>& bags, const std::map<std::string, int>& topics, bool images,
    const std::function<void(int, size_t, const BagMessage&, const MessageValue&)>& visit) {
  std::map<int, size_t> next;  // by stream
  for (const std::string& bag : bags) {
    MessageReader reader;
    read_bag(bag, [&](const BagMessage& raw) {
      const auto found = topics.find(raw.topic->name);
      if (found == topics.end() || is_image_type(raw.topic->type) != images) return true;
      MessageValue value;
      try {
        value = reader.read(raw);
      } catch (const Damage&) {  // said by the first pass
        return true;
      }
      visit(found->second, next[found->second]++, raw, value);
      return true;
    });
  }
}

RecordedStreams read_streams(const std::vector<std::string>& bags, const Progress& progress) {
  StreamReader reader;
  std::map<std::string, long> unreadable;
  std::map<std::string, std::string> why;
  for (const std::string& bag : bags) {
    const auto visit = [&](const BagMessage& raw) {
      try {
        reader.message(raw);
      } catch (const Damage& damage) {
        ++unreadable[raw.topic->name];
        why.emplace(raw.topic->name, damage.what());
      }
      return true;
    };
    reader.messages = MessageReader();  // topics live as long as their bag is read
    const BagContents contents = read_bag(bag, visit, progress);
    reader.out.losses.insert(reader.out.losses.end(), contents.losses.begin(),
                             contents.losses.end());
    if (contents.more_losses > 0)
      reader.out.losses.push_back(bag + ": and " + std::to_string(contents.more_losses) + " more");
  }
  for (const auto& [topic, count] : unreadable)
    reader.out.losses.push_back(std::to_string(count) + " messages of " + topic +
                                "; the first: " + why[topic]);
  say_what_is_left_out(reader);
  say_what_was_set_back(reader);
  put_on_one_clock(reader);
  for (JointStream& s : reader.out.joints) sort_by_time(s.readings.times, s.readings.values);
  for (PoseStream& s : reader.out.poses) sort_by_time(s.times, s.poses);
  if (reader.first) reader.out.duration = static_cast<double>(*reader.last - *reader.first) * 1e-9;
  return std::move(reader.out);
}

bool pose_at(const PoseStream& stream, double time, double longest_gap, Pose& pose) {
  if (stream.times.empty()) return false;
  if (stream.fixed) {
    pose = stream.poses.back();
    return true;
  }
  const auto next = static_cast<size_t>(
      std::lower_bound(stream.times.begin(), stream.times.end(), time) - stream.times.begin());
  if (next == stream.times.size()) return false;
  if (stream.times[next] == time) {
    pose = stream.poses[next];
    return true;
  }
  if (next == 0 || stream.times[next] - stream.times[next - 1] > longest_gap) return false;
  pose = between(stream.poses[next - 1], stream.poses[next],
                 (time - stream.times[next - 1]) / (stream.times[next] - stream.times[next - 1]));
  return true;
}

bool transform_at(const std::vector<PoseStream>& poses, const std::string& frame,
                  const std::string& child, double time, double longest_gap, Pose& frame_T_child) {
  const auto to_root = [&](std::string from, std::vector<std::string>& frames,
                           std::vector<Pose>& frame_T_from) {
    frames = {from};
    frame_T_from = {Pose()};
    for (bool higher = true; higher && frames.size() < 100;) {
      higher = false;
      for (const PoseStream& s : poses) {
        Pose step;
        if (s.child != from || s.child.empty() || !pose_at(s, time, longest_gap, step)) continue;
        frame_T_from.push_back(step * frame_T_from.back());
        frames.push_back(from = s.frame);
        higher = true;
        break;
      }
    }
  };
  std::vector<std::string> up, down;
  std::vector<Pose> a, b;
  to_root(frame, up, a);
  to_root(child, down, b);
  for (size_t i = 0; i < up.size(); ++i)
    for (size_t j = 0; j < down.size(); ++j)
      if (up[i] == down[j]) {
        frame_T_child = inverse(a[i]) * b[j];
        return true;
      }
  return false;
}

}  // namespace kincal
