#include "rest_samples.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "../../models/fitting/numbering.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/targets.h"
#include "../../models/rig/words.h"
#include "../document/files.h"
#include "raw_image.h"

namespace kincal {
namespace {

constexpr double kRestOfView = 0.5;  // of a rest's frames are still at least

/// Takes out of the rest what poses do not stand still in.
TimeInterval rest_of_poses(const Recorded& recorded, const TimeInterval& rest) {
  TimeInterval left = rest;
  for (const PoseSource& source : recorded.topics.poses) {
    if (source.stream < 0) continue;
    const PoseStream& stream = recorded.streams.poses[source.stream];
    const double gap = longest_gap(stream.times);
    Intervals still{left};
    for (const Series& series : pose_series(stream))
      still =
          intersected(still, still_intervals(series, std::max(1e-9, still_tolerance(series)), gap));
    TimeInterval longest{left.begin, left.begin};
    for (const TimeInterval& one : still)
      if (one.length() > longest.length()) longest = one;
    if (longest.length() > kRestOfView * rest.length()) left = longest;
  }
  return left;
}

/// What of a rest a view leaves: from its first to its last still frame, where others were not.
TimeInterval rest_of_view(const TimeInterval& rest, const std::vector<CornerFrame>& frames,
                          const ViewRest& view) {
  TimeInterval left = rest;
  if (view.still.begin > frames.front().time) left.begin = std::max(left.begin, view.still.begin);
  if (view.still.end < frames.back().time) left.end = std::min(left.end, view.still.end);
  return left;
}

View empty_view(int sensor, int target) {
  View view;
  view.sensor = sensor;
  view.target = target;
  return view;
}

/// A view of a camera in the making.
struct StillView {
  int sensor, target;
  const std::vector<CornerFrame>* frames;
};

/// Adds the averages of a rest's frames.
void add_corners(const Rig& rig, const std::vector<StillView>& still, const TimeInterval& over,
                 std::vector<View>& views) {
  for (const StillView& one : still) {
    const SettledCorners corners = average_corners(*one.frames, over);
    if (corners.ids.empty()) continue;
    View view = empty_view(one.sensor, one.target);
    view.ids = corners.ids;
    for (const double z : corners.pixels) view.z.push_back(std::round(z * 1e4) / 1e4);
    for (const double sigma : rig.sensors[one.sensor].sigma)
      view.sigma.push_back(corners.sigma(sigma));
    views.push_back(std::move(view));
  }
}

void add_poses(const Recorded& recorded, const TimeInterval& over, std::vector<View>& views) {
  const TopicMap& topics = recorded.topics;
  for (size_t s = 0; s < topics.poses.size(); ++s) {
    if (topics.poses[s].stream < 0) continue;
    const AveragePose mean = average_pose(recorded.streams.poses[topics.poses[s].stream], over);
    if (mean.count == 0) continue;
    View view = empty_view(static_cast<int>(s), topics.pose_targets[s]);
    const Eigen::Vector4d q = quaternion_from_rotation(mean.mean.rotation);
    const Vector3d& t = mean.mean.translation;
    view.z = {t.x(), t.y(), t.z(), q[0], q[1], q[2], q[3]};
    const std::vector<double>& sigma = recorded.rig.sensors[s].sigma;
    for (size_t k = 0; k < sigma.size(); ++k)
      view.sigma.push_back(
          Average{0, k < 3 ? mean.translation : mean.rotation, mean.count}.sigma(sigma[k]));
    views.push_back(std::move(view));
  }
}

Sample sample_of_rest(const Recorded& recorded, int rest, const TimeInterval& over) {
  Sample sample;
  sample.id = rest_name(rest);
  sample.time = static_cast<double>(recorded.streams.origin) * 1e-9 + (over.begin + over.end) / 2;
  recorded.readings.average(over, sample);
  return sample;
}

/// Adds a view to a sample, unless a joint that it depends on has no reading there: returns which.
std::string add_view(const Rig& rig, View view, Sample& sample) {
  for (const int j : view_readings(rig, view.sensor, view.target))
    if (std::isnan(sample.readings[j])) return rig.tree.joints[j].name;
  sample.views.push_back(std::move(view));
  return "";
}

/// True if both have the same readings, and nearly the same views.
bool alike(const Rig& rig, double distinct, const Sample& a, const Sample& b) {
  for (const View& view : a.views)
    for (const int j : view_readings(rig, view.sensor, view.target))
      if (std::isnan(a.readings[j]) != std::isnan(b.readings[j]) ||
          std::abs(a.readings[j] - b.readings[j]) > distinct)
        return false;
  if (a.views.size() != b.views.size()) return false;
  for (size_t v = 0; v < a.views.size(); ++v) {
    const View &x = a.views[v], &y = b.views[v];
    if (x.sensor != y.sensor || x.target != y.target || x.ids != y.ids) return false;
    const ParameterBlock* lens = find_block(rig.sensors[x.sensor], ParameterKind::intrinsics);
    const double unit = lens ? lens->values[0] : 1;  // px a rad
    for (size_t k = 0; k < x.z.size(); ++k)
      if (std::abs(x.z[k] - y.z[k]) > distinct * unit) return false;
  }
  return true;
}

/// Writes the image in the middle of each rest of each camera. Returns paths from a folder, by rest
/// and sensor.
std::map<int, std::map<int, std::string>> write_images(const Recorded& recorded,
                                                       const Intervals& rests,
                                                       const std::string& folder,
                                                       const std::filesystem::path& from,
                                                       bool force) {
  namespace fs = std::filesystem;
  fs::create_directories(folder);
  std::map<int, std::map<int, std::string>> written;
  visit_middle_images(
      recorded, rests, [&](int sensor, int rest, const MessageValue& image, bool compressed) {
        std::string content, ending = "pgm";
        if (compressed) {
          content = std::string(numbers_of(field(image, "data")).bytes);
          ending = compressed_format(content);
          if (ending.empty()) return;
        } else {
          content = pgm_file(grey_picture(image));
        }
        const fs::path path = fs::path(folder) / (rest_name(rest) + "_" +
                                                  recorded.rig.sensors[sensor].name + "." + ending);
        write_file(path.string(), content, force);
        written[rest][sensor] = fs::absolute(path).lexically_normal().lexically_relative(from);
      });
  return written;
}

}  // namespace

std::string rest_name(int rest) { return text("rest_%04d", rest + 1); }

RestSamples samples_of_rests(const Recorded& recorded, const Intervals& rests,
                             const std::vector<Sighting>& sightings,
                             const std::map<int, std::vector<View>>& beams, double still_pixels) {
  const Rig& rig = recorded.rig;
  RestSamples out;
  const FramesOfViews all = frames_of_views(sightings);
  std::vector<std::vector<StillView>> still(rests.size());
  Intervals over = rests;
  for (const auto& [which, by_rest] : all) {
    SeenTarget seen{which.first, which.second};
    std::vector<std::vector<CornerFrame>> list;
    for (const auto& [rest, frames] : by_rest) list.push_back(frames);
    seen.scatter = corner_scatter(list);
    seen.rests = static_cast<int>(by_rest.size());
    for (const auto& [rest, frames] : by_rest) {
      const double tolerance = frame_tolerance(still_pixels, seen.scatter, corner_scatter({frames}),
                                               rig.sensors[seen.sensor].sigma[0]);
      seen.allowed = std::max(seen.allowed, tolerance);
      const ViewRest found = view_rest(frames, tolerance);
      seen.least = std::min(seen.least, found.motion);
      if (static_cast<double>(found.frames) <
          std::max(1., kRestOfView * static_cast<double>(frames.size()))) {
        ++seen.moving;
        out.lost[rest] = "the targets move in the images";
        continue;
      }
      over[rest] = rest_of_view(over[rest], frames, found);
      still[rest].push_back({seen.sensor, seen.target, &frames});
    }
    out.seen.push_back(seen);
  }
  for (int rest = 0; rest < static_cast<int>(rests.size()); ++rest) {
    const TimeInterval interval = rest_of_poses(recorded, over[rest]);
    std::string& why = out.lost.emplace(rest, "no target is seen").first->second;
    if (interval.length() <= 0) {
      why = "the views of the sensors are never at rest at the same time";
      continue;
    }
    Sample sample = sample_of_rest(recorded, rest, interval);
    std::vector<View> views;
    add_corners(rig, still[rest], interval, views);
    add_poses(recorded, interval, views);
    if (const auto found = beams.find(rest); found != beams.end())
      views.insert(views.end(), found->second.begin(), found->second.end());
    for (const View& view : views) {
      const std::string joint = add_view(rig, view, sample);
      if (joint.empty()) continue;
      ++out.without_reading[{view.sensor, joint}];
      why = "joint " + quoted(joint) + " has no reading then";
    }
    if (sample.views.empty()) continue;
    out.lost.erase(rest);
    out.samples.push_back(std::move(sample));
    out.rests.push_back(rest);
  }
  return out;
}

RestSamples samples_with_images(const Recorded& recorded, const Intervals& rests,
                                const std::string& folder, const std::string& samples_file,
                                bool force) {
  namespace fs = std::filesystem;
  const Rig& rig = recorded.rig;
  std::map<int, std::map<int, std::string>> written = write_images(
      recorded, rests, folder, fs::absolute(samples_file).lexically_normal().parent_path(), force);
  RestSamples out;
  for (int rest = 0; rest < static_cast<int>(rests.size()); ++rest) {
    const TimeInterval interval = rest_of_poses(recorded, rests[rest]);
    Sample sample = sample_of_rest(recorded, rest, interval);
    std::vector<std::string> images;
    for (const auto& [sensor, path] : written[rest])
      for (size_t t = 0; t < rig.targets.size(); ++t) {
        if (rig.targets[t].type == "points") continue;
        sample.views.push_back(empty_view(sensor, static_cast<int>(t)));
        sample.views.back().sigma = rig.sensors[sensor].sigma;
        images.push_back(path);
      }
    std::vector<View> poses;
    add_poses(recorded, interval, poses);
    for (View& view : poses) add_view(rig, std::move(view), sample);
    if (sample.views.empty()) continue;
    out.samples.push_back(std::move(sample));
    out.images.push_back(std::move(images));
  }
  return out;
}

int turn_boards(const Rig& rig, const std::map<int, std::vector<int>>& open_turns,
                std::vector<Sample>& samples) {
  if (open_turns.empty() || samples.size() < 3) return 0;
  static const int cosines[] = {1, 0, -1, 0};
  int turned = 0;
  for (const ViewTurn& one : agreeing_numbers(rig, samples, open_turns, {})) {
    if (one.quarters == 0) continue;
    const int c = cosines[one.quarters], s = cosines[(one.quarters + 3) % 4];
    Eigen::Matrix2d turn;
    turn << c, -s, s, c;
    View& view = samples[one.sample].views[one.view];
    const Target& target = rig.targets[view.target];
    const std::vector<int> places = relabeling(target, turn);
    if (places.empty()) continue;
    relabel(view, target, places);
    ++turned;
  }
  return turned;
}

size_t leave_out_alike(const Rig& rig, double distinct, std::vector<Sample>& samples) {
  if (!(distinct > 0)) return 0;
  std::vector<Sample> kept;
  for (Sample& sample : samples)
    if (std::none_of(kept.begin(), kept.end(),
                     [&](const Sample& other) { return alike(rig, distinct, sample, other); }))
      kept.push_back(std::move(sample));
  samples.swap(kept);
  return kept.size() - samples.size();
}

}  // namespace kincal
