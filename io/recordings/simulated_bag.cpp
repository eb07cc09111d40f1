#include "simulated_bag.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../../models/sensors/sensors.h"
#include "../document/error.h"
#include "../document/files.h"
#include "../images/parallel.h"
#include "../images/studio.h"
#include "../rig/samples_file.h"
#include "../rig/simulation_file.h"
#include "../rig/types.h"
#include "bag_writer.h"
#include "written_messages.h"

namespace kincal {
namespace {

constexpr size_t kAtOnce = 16;     // frames that are in memory
constexpr double kInstant = 1e-9;  // s; ends are met in spite of rounding

/// What makes streams of random numbers differ: kind of draw by what it is for.
enum BagStream : std::uint64_t {
  kReadings = 1,
  kExposures = 2,
  kNoise = 3,
  kScans = 4,
  kTilts = 5
};

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

CameraNumbers camera_numbers(const Rig& rig, const ParameterTable& table, int sensor) {
  const Sensor& camera = rig.sensors[sensor];
  CameraNumbers out;
  out.width = static_cast<std::uint32_t>(camera.image_width);
  out.height = static_cast<std::uint32_t>(camera.image_height);
  const int first = table.sensor_block[sensor];
  for (size_t b = 0; b < camera.parameters.size(); ++b) {
    const Parameter& block = table.all[first + static_cast<int>(b)];
    const double* numbers = table.initial.data() + block.start;
    if (block.kind == ParameterKind::intrinsics) std::copy_n(numbers, 4, out.intrinsics);
    if (block.kind == ParameterKind::distortion)
      out.distortion.assign(numbers, numbers + block.size());
    if (block.kind == ParameterKind::baseline) out.baseline = *numbers;
  }
  out.model = ros_lens(lens_type(camera.parameters).name, out.distortion.size());
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
    in_parallel(wanted.size(), options_.threads,
                [&](size_t i) {
                  const Frame& f = *wanted[i].second;
                  const int sensor = cameras_[f.camera].sensor;
                  RandomStream draws(~options_.seed, kExposures + 4 * f.at);
                  exposed[i] = expose(studio_.rays.at(sensor),
                                      sheets_before(studio_, sensor, journey_.at(f.time)),
                                      options_.look, draws);
                },
                {});
    for (size_t i = 0; i < wanted.size(); ++i) light[wanted[i].first] = exposed[i];
    in_parallel(frames.size(), options_.threads,
                [&](size_t i) {
                  RandomStream draws(~options_.seed, kNoise + 4 * frames[i].at);
                  pictures[i] = develop(light.at(key(frames[i])), options_.look.noise, draws);
                },
                {});
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

/// A Logger writes readings and scans in the order of their stamps, as time goes on.
class Logger {
 public:
  Logger(const RigFile& rig, const Journey& journey, const std::vector<SimulatedLaser>& lasers,
         BagWriter& bag, const BagOptions& options)
      : rig_(rig),
        journey_(journey),
        lasers_(lasers),
        bag_(bag),
        options_(options),
        reading_draws_(~options.seed, kReadings),
        tilt_draws_(~options.seed, kTilts) {
    const int description = bag.add_topic("/robot_description", "std_msgs/String");
    joints_ = bag.add_topic("/joint_states", "sensor_msgs/JointState");
    bag.write(description, stamp(0), text_message(bag.wire(), rig.urdf.text));
    for (const Joint& joint : rig.rig.tree.joints) names_.push_back(joint.name);
    for (const SimulatedLaser& laser : lasers)
      topics_.push_back(bag.add_topic("/" + sensor(laser).name + "/scan", "sensor_msgs/LaserScan"));
  }

  /// Writes what is stamped up to a time, s.
  void until(double time, RecordedBag& out) {
    std::vector<double> starts;
    const auto from = static_cast<std::uint64_t>(scans_);
    for (; !lasers_.empty() && scans_ / options_.sweep.scan_rate <= time; ++scans_)
      starts.push_back(scans_ / options_.sweep.scan_rate);
    std::vector<LaserScan> scans(starts.size() * lasers_.size());
    in_parallel(scans.size(), options_.threads,
                [&](size_t i) {
                  const std::uint64_t number = from * lasers_.size() + i;
                  scans[i] = lasers_[i % lasers_.size()].scan(
                      journey_, starts[i / lasers_.size()],
                      RandomStream(~options_.seed, kScans + 4 * number));
                },
                {});
    for (size_t i = 0; i < scans.size(); ++i) {
      readings_until(scans[i].time, out);
      const size_t k = i % lasers_.size();
      const std::string& frame = rig_.rig.tree.links[static_cast<size_t>(sensor(lasers_[k]).link)];
      const std::int64_t at = stamp(scans[i].time);
      bag_.write(topics_[k], at, laser_scan_message(bag_.wire(), at, frame, scans[i]));
      ++out.scans;
    }
    readings_until(time, out);
  }

 private:
  const Sensor& sensor(const SimulatedLaser& laser) const {
    return rig_.rig.sensors[static_cast<size_t>(laser.sensor())];
  }

  void readings_until(double time, RecordedBag& out) {
    for (; out.readings / options_.joint_rate <= time; ++out.readings) {
      const double t = out.readings / options_.joint_rate;
      std::vector<double> logged = journey_.logged(t, reading_draws_);
      for (const SimulatedLaser& laser : lasers_)
        logged[static_cast<size_t>(laser.joint())] = laser.reading(t) + options_.journey.scatter *
                                                                            sensor(laser).sigma[0] *
                                                                            tilt_draws_.normal();
      bag_.write(joints_, stamp(t), joint_state_message(bag_.wire(), stamp(t), names_, logged));
    }
  }

  const RigFile& rig_;
  const Journey& journey_;
  const std::vector<SimulatedLaser>& lasers_;
  BagWriter& bag_;
  const BagOptions& options_;
  RandomStream reading_draws_, tilt_draws_;
  std::vector<std::string> names_;
  std::vector<int> topics_;      // by laser
  int joints_ = -1, scans_ = 0;  // the topic; scans that each laser has taken
};

/// Writes all messages, readings, scans and images in the order of their stamps.
RecordedBag record(const Studio& studio, const Journey& journey,
                   std::vector<RecordedCamera>& cameras, Logger& logger, BagWriter& bag,
                   const BagOptions& options) {
  RecordedBag out;
  out.duration = journey.duration();
  for (RecordedCamera& c : cameras) {
    const std::string name = "/" + studio.rig.sensors[c.sensor].name;
    c.images = bag.add_topic(name + "/image_raw", "sensor_msgs/Image");
    c.infos = bag.add_topic(name + "/camera_info", "sensor_msgs/CameraInfo");
  }
  Photographer photographer(studio, journey, cameras, options);
  const std::vector<Frame> frames = frames_of(journey, cameras.size(), options.frame_rate);
  const auto progress = [&](double time) {
    options.progress.share(std::min(1., time / out.duration));
  };
  for (size_t first = 0; first < frames.size(); first += kAtOnce) {
    const std::vector<Frame> block(
        frames.begin() + static_cast<std::ptrdiff_t>(first),
        frames.begin() + static_cast<std::ptrdiff_t>(std::min(frames.size(), first + kAtOnce)));
    const std::vector<cv::Mat> pictures = photographer.take(block);
    for (size_t i = 0; i < block.size(); ++i, ++out.images) {
      const RecordedCamera& c = cameras[block[i].camera];
      const double time = block[i].time + options.camera_delay;
      logger.until(std::min(time, out.duration + kInstant), out);
      const std::string& frame = studio.rig.tree.links[studio.rig.sensors[c.sensor].link];
      const GreyPicture picture{
          c.numbers.width,
          c.numbers.height,
          {reinterpret_cast<const char*>(pictures[i].data), pictures[i].total()}};
      bag.write(c.images, stamp(time), image_message(bag.wire(), stamp(time), frame, picture));
      bag.write(c.infos, stamp(time),
                camera_info_message(bag.wire(), stamp(time), frame, c.numbers));
    }
    progress(block.back().time);
  }
  for (double time = frames.empty() ? 0 : frames.back().time; time < out.duration; time += 1) {
    logger.until(time, out);
    progress(time);
  }
  logger.until(out.duration + kInstant, out);
  bag.finish();
  return out;
}

}  // namespace

RecordedBag render_bag(const RigFile& rig, const std::string& samples, const std::string& truth,
                       const std::string& path, const BagOptions& options) {
  for (const Joint& joint : rig.rig.tree.joints)
    if (joint.first_axis >= 0)
      throw InputError("--bag: joint '" + joint.name +
                       "' is floating: a joint_states message cannot hold a pose");
  const std::vector<Sample> logged = parse_samples(read_file(samples), samples, rig.rig);
  const std::vector<Stop> stops =
      stops_of(logged, rig.rig, read_true_postures(truth, rig.rig), truth);
  JourneyOptions way = options.journey;
  if (options.sweep.seconds > 0)
    way.rest = std::max(way.rest, 2 * (options.sweep.seconds + kQuiet));
  std::vector<SimulatedLaser> lasers;
  Studio studio = make_studio(rig, truth);
  std::vector<RecordedCamera> cameras;
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.rig.sensors[s];
    const int index = static_cast<int>(s);
    if (sensor.scanning_joint >= 0 && options.sweep.seconds > 0)
      lasers.emplace_back(studio, index, logged, stops, options.sweep, way);
    if (sensor.type != "camera") continue;
    if (sensor.image_width < 1)
      throw InputError("--bag: camera '" + sensor.name + "' has no image_size in the rig");
    prepare_camera(studio, index);
    cameras.push_back({index, -1, -1, camera_numbers(rig.rig, studio.table, index)});
  }
  if (options.sweep.seconds > 0 && lasers.empty())
    throw InputError("--sweeps: the rig has no tilting laser");
  const Journey journey(rig.rig, studio.table, studio.truth, stops, way);
  const bool mcap = path.size() > 5 && path.compare(path.size() - 5, 5, ".mcap") == 0;
  RecordedBag out;
  out.written = write_file_in_pieces(
      path,
      [&](const auto& put) {
        BagWriter bag(mcap ? Wire::cdr : Wire::ros1, put);
        Logger logger(rig, journey, lasers, bag, options);
        out = record(studio, journey, cameras, logger, bag, options);
      },
      options.force, options.go_on);
  return out;
}

}  // namespace kincal
