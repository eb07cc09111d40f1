#include "still_scans.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "bytes.h"

namespace kincal {
namespace {

/// sensor_msgs/PointField's datatypes.
double point_field(std::string_view point, size_t offset, int type, bool swapped) {
  Bytes bytes{point.substr(std::min(offset, point.size()))};
  switch (type) {
    case 1:
      return bytes.number<std::int8_t>(swapped);
    case 2:
      return bytes.number<std::uint8_t>(swapped);
    case 3:
      return bytes.number<std::int16_t>(swapped);
    case 4:
      return bytes.number<std::uint16_t>(swapped);
    case 5:
      return bytes.number<std::int32_t>(swapped);
    case 6:
      return bytes.number<std::uint32_t>(swapped);
    case 7:
      return static_cast<double>(bytes.number<float>(swapped));
    case 8:
      return bytes.number<double>(swapped);
    default:
      throw Damage("a field of a point is of no known type");
  }
}

/// Where a field of a point stands.
struct PlaceOfField {
  size_t offset = 0;
  int type = 0;
};

std::optional<PlaceOfField> place_of(const MessageValue& cloud, std::string_view name) {
  for (const MessageValue& one : list_of(field(cloud, "fields")))
    if (text_of(field(one, "name")) == name)
      return PlaceOfField{static_cast<size_t>(number_of(field(one, "offset"))),
                          static_cast<int>(number_of(field(one, "datatype")))};
  return std::nullopt;
}

std::vector<float> floats(const NumberArray& numbers) {
  std::vector<float> out(numbers.size());
  for (size_t i = 0; i < out.size(); ++i) out[i] = static_cast<float>(numbers[i]);
  return out;
}

/// The rest that a time is in; -1: none.
int rest_of(const Intervals& rests, double time) {
  for (size_t r = 0; r < rests.size(); ++r)
    if (rests[r].contains(time)) return static_cast<int>(r);
  return -1;
}

/// Collects what one sensor logs, and gives it on when the next rest begins.
class ScanCollector {
 public:
  ScanCollector(int sensor, const Intervals& rests, const std::function<void(RestScans&)>& visit)
      : rests_(rests), visit_(visit) {
    now_.sensor = sensor;
  }

  void add(const BagMessage& raw, double time, MessageReader& reader) {
    const int rest = rest_of(rests_, time);
    if (rest < 0) return;
    if (rest != now_.rest) finish();
    now_.rest = rest;
    if (raw.topic->type == "sensor_msgs/LaserScan") {
      now_.scans.push_back(laser_scan(reader.read(raw), time));
      return;
    }
    const TimeInterval& of = rests_[static_cast<size_t>(rest)];
    const double middle = (of.begin + of.end) / 2;
    if (now_.cloud.points.empty() || std::abs(time - middle) < std::abs(now_.cloud.time - middle))
      now_.cloud = point_cloud(reader.read(raw), time);
  }

  void finish() {
    if (now_.rest >= 0) visit_(now_);
    now_.rest = -1;
    now_.scans.clear();
    now_.cloud = Cloud();
  }

 private:
  const Intervals& rests_;
  const std::function<void(RestScans&)>& visit_;
  RestScans now_;
};

}  // namespace

LaserScan laser_scan(const MessageValue& message, double time) {
  LaserScan out;
  out.time = time;
  out.angle_min = number_of(field(message, "angle_min"));
  out.angle_increment = number_of(field(message, "angle_increment"));
  out.time_increment = number_of(field(message, "time_increment"));
  out.ranges = floats(numbers_of(field(message, "ranges")));
  out.intensities = floats(numbers_of(field(message, "intensities")));
  return out;
}

Cloud point_cloud(const MessageValue& message, double time) {
  Cloud out;
  out.time = time;
  const auto x = place_of(message, "x"), y = place_of(message, "y"), z = place_of(message, "z");
  auto intensity = place_of(message, "intensity");
  if (!intensity) intensity = place_of(message, "intensities");
  if (!x || !y || !z || !intensity) throw Damage("points have no x, y, z and intensity");
  const NumberArray data = numbers_of(field(message, "data"));
  const auto step = static_cast<size_t>(number_of(field(message, "point_step"))),
             row = static_cast<size_t>(number_of(field(message, "row_step"))),
             width = static_cast<size_t>(number_of(field(message, "width"))),
             height = static_cast<size_t>(number_of(field(message, "height")));
  const bool swapped = number_of(field(message, "is_bigendian")) != 0;
  if (step == 0 || width > data.bytes.size() / step || height > data.bytes.size() / step)
    throw Damage("a cloud has fewer bytes than points");
  for (size_t r = 0; r < height; ++r)
    for (size_t c = 0; c < width; ++c) {
      Bytes bytes{data.bytes};
      bytes.take(r * row + c * step);
      const std::string_view point = bytes.take(step);
      const auto number = [&](const PlaceOfField& of) {
        return point_field(point, of.offset, of.type, swapped);
      };
      out.points.emplace_back(number(*x), number(*y), number(*z));
      out.intensities.push_back(number(*intensity));
    }
  return out;
}

void visit_scans(const std::vector<std::string>& bags, const RecordedStreams& streams,
                 const std::vector<int>& scans, const Intervals& rests,
                 const std::function<void(RestScans&)>& visit) {
  std::map<std::string, std::pair<size_t, std::vector<ScanCollector>>> by_topic;
  std::map<std::string, size_t> next;  // message of a topic
  for (size_t s = 0; s < scans.size(); ++s)
    if (scans[s] >= 0) {
      auto& [stream, collectors] = by_topic[streams.scans[static_cast<size_t>(scans[s])].topic];
      stream = static_cast<size_t>(scans[s]);
      collectors.emplace_back(static_cast<int>(s), rests, visit);
    }
  if (by_topic.empty()) return;
  for (const std::string& bag : bags) {
    MessageReader reader;
    read_bag(bag, [&](const BagMessage& raw) {
      const auto found = by_topic.find(raw.topic->name);
      if (found == by_topic.end()) return true;
      auto& [stream, collectors] = found->second;
      try {
        reader.read(raw);  // the first pass counted those that can be read
        const size_t which = next[raw.topic->name]++;
        const std::vector<double>& times = streams.scans[stream].times;
        if (which < times.size())
          for (ScanCollector& one : collectors) one.add(raw, times[which], reader);
      } catch (const Damage&) {  // said by the first pass, or a cloud without intensities
      }
      return true;
    });
  }
  for (auto& [topic, of] : by_topic)
    for (ScanCollector& one : of.second) one.finish();
}

}  // namespace kincal
