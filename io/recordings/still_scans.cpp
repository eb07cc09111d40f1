#include "still_scans.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "bytes.h"

namespace kincal {
namespace {

constexpr double kMarginOfTilt = 0.2;  // s, of readings around a sweep

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
      throw Damage("a field of a point has an unknown type");
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

/// RestScans are what one sensor logged in one rest: scans, or the cloud nearest to the middle.
struct RestScans {
  int sensor = -1, rest = -1;
  std::vector<LaserScan> scans;
  Cloud cloud;  // without points: there is none
};

/// @throws Damage
void add_message(const MessageValue& message, bool is_scan, double time, const TimeInterval& rest,
                 RestScans& scans) {
  const double middle = (rest.begin + rest.end) / 2;
  if (is_scan)
    scans.scans.push_back(laser_scan(message, time));
  else if (scans.cloud.points.empty() ||
           std::abs(time - middle) < std::abs(scans.cloud.time - middle))
    scans.cloud = point_cloud(message, time);
}

/// The scans of a rest, with the readings of the joint that turns the laser; without readings: it
/// has none.
Sweep sweep_of(const Recorded& recorded, const TimeInterval& rest, RestScans& scans) {
  Sweep sweep;
  const int joint = recorded.rig.sensors[scans.sensor].scanning_joint;
  if (joint < 0 || scans.scans.empty()) return sweep;
  const Series& tilt = recorded.readings.series(joint);
  for (size_t i = 0; i < tilt.size(); ++i)
    if (tilt.times[i] > rest.begin - kMarginOfTilt && tilt.times[i] < rest.end + kMarginOfTilt)
      sweep.tilt.push_back({tilt.times[i], tilt.values[i]});
  sweep.scans = std::move(scans.scans);
  return sweep;
}

/// Looks for all targets in what a sensor logged in a rest.
void find_targets(const Recorded& recorded, const TimeInterval& rest, const TargetSearch& search,
                  RestScans& scans, ScannedRests& out) {
  const Sweep sweep = sweep_of(recorded, rest, scans);
  std::vector<View>& views = out.views[scans.rest];
  const size_t before = views.size();
  std::string why_not = "no sweep of its joint";
  for (int t = 0; t < static_cast<int>(recorded.rig.targets.size()); ++t) {
    BeamWords words;
    std::vector<View> some;
    if (!sweep.scans.empty() && !sweep.tilt.empty())
      some = search.sweep(scans.sensor, t, sweep, words);
    else if (!scans.cloud.points.empty())
      some = search.cloud(scans.sensor, t, scans.cloud, words);
    views.insert(views.end(), some.begin(), some.end());
    out.doubts.insert(words.doubts.begin(), words.doubts.end());
    if (!words.why_not.empty()) why_not = words.why_not;
  }
  ScannedRests::Success& of = out.sensors[scans.sensor];
  ++of.rests;
  if (views.size() > before)
    ++of.found;
  else
    ++of.not_found[why_not];
}

}  // namespace

ScannedRests look_at_scans(const Recorded& recorded, const Intervals& rests,
                           const TargetSearch& search) {
  const std::vector<int>& streams = recorded.topics.scans;
  ScannedRests out;
  std::map<std::string, int> topics;
  std::vector<RestScans> now;  // of each sensor the rest that is being read
  for (int s = 0; s < static_cast<int>(streams.size()); ++s)
    if (streams[s] >= 0) {
      topics[recorded.streams.scans[streams[s]].topic] = streams[s];
      now.push_back({s, -1, {}, {}});
    }
  const auto finish = [&](RestScans& one) {
    if (one.rest >= 0) find_targets(recorded, rests[one.rest], search, one, out);
    one = {one.sensor, -1, {}, {}};
  };
  read_again(recorded.bags, topics, false,
             [&](int stream, size_t which, const BagMessage& raw, const MessageValue& message) {
               const std::vector<double>& times = recorded.streams.scans[stream].times;
               const int rest = which < times.size() ? interval_at(rests, times[which]) : -1;
               for (RestScans& one : now) {
                 if (streams[one.sensor] != stream || rest < 0) continue;
                 if (rest != one.rest) finish(one);
                 one.rest = rest;
                 try {
                   add_message(message, raw.topic->type == "sensor_msgs/LaserScan", times[which],
                               rests[rest], one);
                 } catch (const Damage&) {  // a cloud without intensities
                 }
               }
             });
  for (const auto& [topic, stream] : topics)
    for (RestScans& one : now)
      if (streams[one.sensor] == stream) finish(one);
  return out;
}

}  // namespace kincal
