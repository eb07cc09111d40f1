#include "simulated_bag.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../document/error.h"
#include "../document/files.h"
#include "../images/parallel.h"
#include "../images/studio.h"
#include "../rig/samples_file.h"
#include "../rig/simulation_file.h"
#include "bag_writer.h"
#include "written_messages.h"

namespace kincal {
namespace {

constexpr size_t kAtOnce = 16;     // frames that are in memory
constexpr double kInstant = 1e-9;  // s; ends are met in spite of rounding

/// What makes streams of random numbers differ: kind of draw by what it is for.
enum BagStream : std::uint64_t { kReadings = 1, kExposures = 2, kNoise = 3 };

/// A Frame is one picture of a camera.
struct Frame {
  double time;       // s, when it was taken
  int camera;        // which of all
  int stop;          // that the robot rests in then; -1: it moves
  std::uint64_t at;  // which of all frames
};

/// A RecordedCamera is a camera and its streams.
struct RecordedCamera {
  int sensor;
  int images, infos;  // topics
  CameraNumbers numbers;
};

std::vector<Stop> stops_of(const std::vector<Sample>& samples, const Rig& rig,
                           const std::map<std::string, Posture>& postures,
                           const std::string& path) {
  std::vector<Stop> stops;
  for (const Sample& sample : samples) {
    const auto posture = postures.find(sample.id);
    if (posture == postures.end())
      throw InputError(path + ": the truth has no sample '" + sample.id + "'");
    Stop stop{posture->second, sample.readings, {}};
    for (const View& view : sample.views)
      if (rig.sensors[view.sensor].model->measurement_kind() == MeasurementKind::chain &&
          rig.targets[view.target].link < 0)
        stop.holders.emplace(view.target, view.sensor);
    stops.push_back(std::move(stop));
  }
  return stops;
}

CameraNumbers camera_numbers(const RigFile& rig, const ParameterTable& table, int sensor) {
  const Sensor& camera = rig.rig.sensors[sensor];
  CameraNumbers out;
  out.width = static_cast<std::uint32_t>(camera.image_width);
  out.height = static_cast<std::uint32_t>(camera.image_height);
  const Field sensors = Field{&rig.node, &rig.path, ""}["sensors"];
  const std::string model = sensors[camera.name]["model"].string();
  const int first = table.sensor_block[sensor];
  for (size_t b = 0; b < camera.parameters.size(); ++b) {
    const Parameter& block = table.all[first + static_cast<int>(b)];
    const double* numbers = table.initial.data() + block.start;
    if (block.kind == ParameterKind::intrinsics) std::copy_n(numbers, 4, out.intrinsics);
    if (block.kind == ParameterKind::distortion)
      out.distortion.assign(numbers, numbers + block.size());
    if (block.kind == ParameterKind::baseline) out.baseline = *numbers;
  }
  const bool wide = model == "kannala_brandt" || model == "equidistant" || model == "fisheye";
  out.model = wide                         ? "equidistant"
              : out.distortion.size() == 8 ? "rational_polynomial"
                                           : "plumb_bob";
  if (out.distortion.empty()) out.distortion.assign(5, 0);
  return out;
}

std::vector<Frame> frames_of(const Journey& journey, size_t cameras, double rate) {
  std::vector<Frame> frames;
  for (size_t c = 0; c < cameras; ++c) {
    const double phase = (static_cast<double>(c) + 0.5) / static_cast<double>(cameras);
    for (int n = 0; (n + phase) / rate <= journey.duration() + kInstant; ++n) {
      const double time = (n + phase) / rate;
      frames.push_back({time, static_cast<int>(c), journey.resting(time), 0});
    }
  }
  std::stable_sort(frames.begin(), frames.end(),
                   [](const Frame& a, const Frame& b) { return a.time < b.time; });
  for (size_t i = 0; i < frames.size(); ++i) frames[i].at = i;
  return frames;
}

/// A Photographer takes the pictures, frame after frame. While the robot rests a camera sees the
/// same, and only the noise differs.
class Photographer {
 public:
  Photographer(const Studio& studio, const Journey& journey,
               const std::vector<RecordedCamera>& cameras, const BagOptions& options)
      : studio_(studio), journey_(journey), cameras_(cameras), options_(options) {}

  std::vector<cv::Mat> take(const std::vector<Frame>& frames) {
    std::map<Key, cv::Mat> light;
    std::vector<std::pair<Key, const Frame*>> wanted;
    for (const Frame& f : frames) {
      const auto known = light_.find(key(f));
      const bool is_new =
          light.emplace(key(f), known == light_.end() ? cv::Mat() : known->second).second;
      if (is_new && known == light_.end()) wanted.emplace_back(key(f), &f);
    }
    std::vector<cv::Mat> exposed(wanted.size()), pictures(frames.size());
    in_parallel(
        wanted.size(), options_.threads,
        [&](size_t i) {
          const Frame& f = *wanted[i].second;
          const int sensor = cameras_[f.camera].sensor;
          Draws draws(~options_.seed, kExposures + 4 * f.at);
          exposed[i] =
              expose(studio_.rays.at(sensor), sheets_before(studio_, sensor, journey_.at(f.time)),
                     options_.look, draws);
        },
        nullptr);
    for (size_t i = 0; i < wanted.size(); ++i) light[wanted[i].first] = exposed[i];
    in_parallel(
        frames.size(), options_.threads,
        [&](size_t i) {
          Draws draws(~options_.seed, kNoise + 4 * frames[i].at);
          pictures[i] = develop(light.at(key(frames[i])), options_.look.noise, draws);
        },
        nullptr);
    light_ = std::move(light);
    return pictures;
  }

 private:
  using Key = std::tuple<int, int, std::uint64_t>;  // camera, stop, else frame
  static Key key(const Frame& f) { return {f.camera, f.stop, f.stop < 0 ? f.at : 0}; }

  const Studio& studio_;
  const Journey& journey_;
  const std::vector<RecordedCamera>& cameras_;
  const BagOptions& options_;
  std::map<Key, cv::Mat> light_;  // of the frames before
};

std::int64_t stamp(double time) {
  return kRecordingStart + static_cast<std::int64_t>(std::llround(time * 1e9));
}

/// Writes all messages, readings and images in the order of their stamps.
RecordedBag record(const RigFile& rig, const Studio& studio, const Journey& journey,
                   std::vector<RecordedCamera>& cameras, BagWriter& bag,
                   const BagOptions& options) {
  RecordedBag out;
  out.duration = journey.duration();
  const int description = bag.add_topic("/robot_description", "std_msgs/String"),
            joints = bag.add_topic("/joint_states", "sensor_msgs/JointState");
  for (RecordedCamera& c : cameras) {
    const std::string name = "/" + rig.rig.sensors[c.sensor].name;
    c.images = bag.add_topic(name + "/image_raw", "sensor_msgs/Image");
    c.infos = bag.add_topic(name + "/camera_info", "sensor_msgs/CameraInfo");
  }
  std::vector<std::string> names;
  for (const Joint& joint : rig.rig.tree.joints) names.push_back(joint.name);
  bag.write(description, stamp(0), text_message(bag.wire(), rig.urdf.text));
  Draws draws(~options.seed, kReadings);
  const auto readings_until = [&](double time) {
    for (; out.readings / options.joint_rate <= time; ++out.readings) {
      const double t = out.readings / options.joint_rate;
      bag.write(joints, stamp(t),
                joint_state_message(bag.wire(), stamp(t), names, journey.logged(t, draws)));
    }
  };
  Photographer photographer(studio, journey, cameras, options);
  const std::vector<Frame> frames = frames_of(journey, cameras.size(), options.frame_rate);
  for (size_t first = 0; first < frames.size(); first += kAtOnce) {
    const std::vector<Frame> block(
        frames.begin() + static_cast<std::ptrdiff_t>(first),
        frames.begin() + static_cast<std::ptrdiff_t>(std::min(frames.size(), first + kAtOnce)));
    const std::vector<cv::Mat> pictures = photographer.take(block);
    for (size_t i = 0; i < block.size(); ++i, ++out.images) {
      const RecordedCamera& c = cameras[block[i].camera];
      const double time = block[i].time + options.camera_delay;
      readings_until(std::min(time, out.duration + kInstant));
      const std::string& frame = rig.rig.tree.links[rig.rig.sensors[c.sensor].link];
      const GreyPicture picture{
          c.numbers.width,
          c.numbers.height,
          {reinterpret_cast<const char*>(pictures[i].data), pictures[i].total()}};
      bag.write(c.images, stamp(time), image_message(bag.wire(), stamp(time), frame, picture));
      bag.write(c.infos, stamp(time),
                camera_info_message(bag.wire(), stamp(time), frame, c.numbers));
    }
    if (options.progress)
      options.progress(static_cast<double>(first) / static_cast<double>(frames.size()));
  }
  readings_until(out.duration + kInstant);
  bag.finish();
  return out;
}

}  // namespace

RecordedBag render_bag(const RigFile& rig, const std::string& samples, const std::string& truth,
                       const std::string& path, const BagOptions& options) {
  for (const Joint& joint : rig.rig.tree.joints)
    if (joint.first_axis >= 0)
      throw InputError("--bag: joint '" + joint.name +
                       "' is floating: a pose is no reading of a joint_states message");
  const std::vector<Stop> stops = stops_of(parse_samples(read_file(samples), samples, rig.rig),
                                           rig.rig, read_true_postures(truth, rig.rig), truth);
  Studio studio = make_studio(rig, truth);
  std::vector<RecordedCamera> cameras;
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.rig.sensors[s];
    const int index = static_cast<int>(s);
    if (sensor.type != "camera") continue;
    if (sensor.image_width < 1)
      throw InputError("--bag: camera '" + sensor.name + "' has no image_size in the rig");
    prepare_camera(studio, index);
    cameras.push_back({index, -1, -1, camera_numbers(rig, studio.table, index)});
  }
  const Journey journey(rig.rig, studio.table, studio.truth, stops, options.journey);
  const bool mcap = path.size() > 5 && path.compare(path.size() - 5, 5, ".mcap") == 0;
  RecordedBag out;
  out.written = write_file_in_pieces(
      path,
      [&](const auto& put) {
        BagWriter bag(mcap ? Wire::cdr : Wire::ros1, put);
        out = record(rig, studio, journey, cameras, bag, options);
      },
      options.force, options.go_on);
  return out;
}

}  // namespace kincal
