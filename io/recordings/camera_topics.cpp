#include "camera_topics.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <utility>

#include "../../models/rig/parameters.h"
#include "../../models/sensors/sensors.h"
#include "../document/names.h"
#include "record_command.h"

namespace kincal {
namespace {

constexpr double kEnough = 20;      // score that tells by itself what a topic is
constexpr double kNearLens = 0.02;  // share of the focal length

std::string parent_of(const std::string& topic) {
  const size_t at = topic.rfind('/');
  return at == std::string::npos ? "" : topic.substr(0, at);
}

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A camera of the recording: all image topics of one name space.
struct RecordedCameraTopics {
  std::string space;
  std::vector<int> images;  // streams
  int info = -1;
};

bool is_compressed(const ImageStream& image) { return image.type != "sensor_msgs/Image"; }

/// The topic whose pictures an image has, also packed: /a/image_raw of /a/image_raw/compressed.
std::string picture_topic(const ImageStream& image) {
  return is_compressed(image) && has(image.topic, "/compressed") ? parent_of(image.topic)
                                                                 : image.topic;
}

bool usable_image(const ImageStream& image) {
  for (const char* other : {"depth", "disparity", "mask", "theora"})
    if (has(image.topic, other)) return false;
  return !has(image.encoding, "32FC") && !has(image.encoding, "Depth");
}

std::vector<RecordedCameraTopics> cameras_of(const RecordedStreams& streams) {
  std::map<std::string, RecordedCameraTopics> by_space;
  for (size_t i = 0; i < streams.images.size(); ++i) {
    if (!usable_image(streams.images[i])) continue;
    const std::string picture = picture_topic(streams.images[i]), parent = parent_of(picture),
                      space = parent.empty() ? picture : parent;  // /cam0, /cam1 are two
    by_space[space].space = space;
    by_space[space].images.push_back(static_cast<int>(i));
  }
  std::vector<RecordedCameraTopics> out;
  const auto at_root = [](const auto& one) { return parent_of(one.first).empty(); };
  const bool one_at_root = std::count_if(by_space.begin(), by_space.end(), at_root) == 1;
  for (auto& [space, camera] : by_space) {
    for (size_t i = 0; i < streams.infos.size(); ++i) {
      const std::string parent = parent_of(streams.infos[i].topic);
      if (parent == space || (parent.empty() && one_at_root && parent_of(space).empty()))
        camera.info = static_cast<int>(i);
    }
    out.push_back(std::move(camera));
  }
  return out;
}

const double* lens_of(const Sensor& camera) {
  const ParameterBlock* block = find_block(camera, ParameterKind::intrinsics);
  return block ? block->values.data() : nullptr;
}

bool is_plain_lens(const Sensor& camera) {
  const ParameterBlock* block = find_block(camera, ParameterKind::distortion);
  return !block ||
         std::all_of(block->values.begin(), block->values.end(), [](double d) { return d == 0; });
}

bool wants_rectified(const Sensor& camera, const CameraInfoMessage* info) {
  if (!is_plain_lens(camera) || !info) return false;
  return std::any_of(info->distortion.begin(), info->distortion.end(),
                     [](double d) { return d != 0; });
}

/// Which of a camera's topics a sensor takes: pictures as the lens makes them, not packed.
int best_image(const RecordedStreams& streams, const RecordedCameraTopics& of, bool rectified) {
  int best = -1;
  double most = -1;
  for (const int i : of.images) {
    const ImageStream& image = streams.images[static_cast<size_t>(i)];
    const std::string name = picture_topic(image).substr(of.space.size());
    double score = has(name, "rect") == rectified ? 100 : 0;
    score += has(name, "raw") ? 10 : has(name, "mono") ? 8 : has(name, "color") ? 6 : 4;
    score += is_compressed(image) ? 0 : 1;
    if (score > most) most = score, best = i;
  }
  return best;
}

/// The finder of these topics.
struct CameraFinder {
  const RigFile& rig;
  const RecordedStreams& streams;
  CameraTopics& out;
  std::vector<RecordedCameraTopics> cameras = cameras_of(streams);
  std::vector<char> taken = std::vector<char>(cameras.size(), 0);

  const CameraInfoMessage* info(const RecordedCameraTopics& camera) const {
    return camera.info < 0 ? nullptr : &streams.infos[static_cast<size_t>(camera.info)];
  }

  /// Width and height; 0: not known.
  std::pair<int, int> size(const RecordedCameraTopics& camera) const {
    const CameraInfoMessage* about = info(camera);
    const ImageStream& image = streams.images[static_cast<size_t>(camera.images[0])];
    return {image.width > 0 ? image.width
            : about         ? about->width
                            : 0,
            image.height > 0 ? image.height
            : about          ? about->height
                             : 0};
  }

  bool other_size(const Sensor& sensor, const RecordedCameraTopics& camera) const {
    const auto [width, height] = size(camera);
    return sensor.image_width > 0 && width > 0 &&
           (width != sensor.image_width || height != sensor.image_height);
  }

  /// The frame that a camera's images say; where it is no link of the robot, that of camera_info.
  std::string frame_of(const RecordedCameraTopics& camera) const {
    const CameraInfoMessage* about = info(camera);
    const ImageStream& image = streams.images[static_cast<size_t>(camera.images[0])];
    const bool known = rig.rig.tree.find_link(image.frame) >= 0;
    return known || !about || about->frame.empty() ? image.frame : about->frame;
  }

  /// What the images are that a sensor was not given.
  std::string what_is_left(const Sensor& sensor, const std::vector<size_t>& free) const {
    std::vector<std::string> all;
    bool any_fits = false;
    for (const size_t c : free) {
      const auto [width, height] = size(cameras[c]);
      const bool fits = !other_size(sensor, cameras[c]);
      any_fits = any_fits || fits;
      std::string one = picture_topic(streams.images[static_cast<size_t>(cameras[c].images[0])]);
      if (!fits) one += " (" + std::to_string(width) + " x " + std::to_string(height) + ")";
      all.push_back(one);
    }
    if (all.empty()) return "no images of it in the recording";
    if (any_fits)
      return "several topics may have its images (" + comma_separated(all) +
             "): write `topic: ...` into its entry of the rig";
    return "no images of its image_size, " + std::to_string(sensor.image_width) + " x " +
           std::to_string(sensor.image_height) + ", in the recording, but " + comma_separated(all) +
           ": correct image_size and intrinsics in the rig";
  }

  double score(const Sensor& sensor, const RecordedCameraTopics& camera, std::string& why) const {
    if (other_size(sensor, camera)) return -1;
    const CameraInfoMessage* about = info(camera);
    const std::string frame = frame_of(camera);
    double out = 0;
    const auto add = [&](double points, const std::string& reason) {
      out += points;
      if (!reason.empty()) why += (why.empty() ? "" : ", ") + reason;
    };
    const std::string& link = rig.rig.tree.links[static_cast<size_t>(sensor.link)];
    if (!frame.empty() && frame == link) add(100, "its frame '" + frame + "'");
    const double named = name_likeness(sensor.name, camera.space);
    if (named > 0) add(40 * named, "its name");
    const double* lens = lens_of(sensor);
    if (lens && about && about->k[0] > 0 && std::abs(about->k[0] - lens[0]) < kNearLens * lens[0] &&
        std::abs(about->k[2] - lens[2]) < kNearLens * lens[0])
      add(10, "its lens");
    if (about && about->baseline > 0.001) {
      const ParameterBlock* baseline = find_block(sensor, ParameterKind::baseline);
      if (baseline && baseline->values[0] != 0) add(5, "its baseline");
    }
    return out;
  }

  void take(size_t sensor, size_t camera, const std::string& why) {
    const Sensor& s = rig.rig.sensors[sensor];
    taken[camera] = 1;
    const CameraInfoMessage* about = info(cameras[camera]);
    out.images[sensor] = best_image(streams, cameras[camera], wants_rectified(s, about));
    out.infos[sensor] = cameras[camera].info;
    say(sensor, why);
    const ImageStream& image = streams.images[static_cast<size_t>(out.images[sensor])];
    if (about && !about->frame.empty() && !image.frame.empty() && about->frame != image.frame)
      out.notes.push_back("sensor '" + s.name + "': its images (" + image.topic +
                          ") are of frame '" + image.frame + "', " + about->topic +
                          " is of frame '" + about->frame +
                          "': one of them is wrong, perhaps cameras are exchanged");
  }

  void say(size_t sensor, const std::string& why) {
    const ImageStream& image = streams.images[static_cast<size_t>(out.images[sensor])];
    out.lines.push_back("sensor " + rig.rig.sensors[sensor].name + ": " + image.topic + " (" + why +
                        ")");
  }

  void given(size_t sensor, const std::string& topic) {
    for (size_t c = 0; c < cameras.size(); ++c)
      for (const int i : cameras[c].images) {
        const ImageStream& image = streams.images[static_cast<size_t>(i)];
        if (image.topic != topic && picture_topic(image) != topic && cameras[c].space != topic)
          continue;
        taken[c] = 1;
        out.infos[sensor] = cameras[c].info;
        if (cameras[c].space == topic) {
          take(sensor, c, "as in the rig");
        } else {
          out.images[sensor] = i;
          say(sensor, "as in the rig");
        }
        return;
      }
    std::vector<std::string> there;
    for (const ImageStream& image : streams.images) there.push_back(image.topic);
    out.notes.push_back("sensor '" + rig.rig.sensors[sensor].name + "': its topic '" + topic +
                        "' has no images in the recording" +
                        nearest_or_all(topic, there, "images are on"));
  }

  /// Sensor and camera with the best score, if no other pair of either has the same.
  bool take_best(const std::vector<size_t>& open) {
    double most = kEnough;
    size_t sensor = 0, camera = 0;
    std::string reason;
    int equal = 0;
    for (const size_t s : open)
      for (size_t c = 0; c < cameras.size(); ++c) {
        if (taken[c] || out.images[s] >= 0) continue;
        std::string why;
        const double points = score(rig.rig.sensors[s], cameras[c], why);
        if (points < most) continue;
        const bool same = points == most && equal > 0;
        equal = same && (s == sensor || c == camera) ? equal + 1 : same ? equal : 1;
        if (same) continue;
        most = points, sensor = s, camera = c, reason = why;
      }
    if (equal == 0) return false;
    if (equal > 1) return false;
    take(sensor, camera, "guessed by " + reason);
    return true;
  }

  void find() {
    std::vector<size_t> open;
    for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
      if (rig.rig.sensors[s].type != "camera") continue;
      const std::string topic = given_topic(rig, rig.rig.sensors[s].name);
      if (topic.empty())
        open.push_back(s);
      else
        given(s, topic);
    }
    while (take_best(open)) {
    }
    std::vector<size_t> left, free;
    for (const size_t s : open)
      if (out.images[s] < 0) left.push_back(s);
    for (size_t c = 0; c < cameras.size(); ++c)
      if (!taken[c]) free.push_back(c);
    if (left.size() == 1 && free.size() == 1 &&
        !other_size(rig.rig.sensors[left[0]], cameras[free[0]]))
      take(left[0], free[0], "guessed: the only one left");
    for (const size_t s : left)
      if (out.images[s] < 0)
        out.notes.push_back("sensor '" + rig.rig.sensors[s].name +
                            "': " + what_is_left(rig.rig.sensors[s], free));
  }
};

/// How a rig's camera differs from what the recording says of it: "" where it does not.
std::string lens_difference(const Sensor& camera, const CameraInfoMessage& info, bool rectified) {
  std::string out;
  char text[160];
  if (camera.image_width > 0 && info.width > 0 &&
      (camera.image_width != info.width || camera.image_height != info.height)) {
    std::snprintf(text, sizeof text, "%d x %d pixels, the rig's image_size is %d x %d", info.width,
                  info.height, camera.image_width, camera.image_height);
    out = text;
  }
  const double *lens = lens_of(camera), *theirs = rectified ? info.p : info.k;
  if (lens && theirs[0] > 0) {
    double most = 0;
    for (int i = 0; i < 4; ++i) most = std::max(most, std::abs(lens[i] - theirs[i]));
    if (most > 1e-3 * lens[0]) {
      std::snprintf(text, sizeof text,
                    "%sfx fy cx cy are %.6g %.6g %.6g %.6g, the rig's %.6g %.6g %.6g %.6g",
                    out.empty() ? "" : "; ", theirs[0], theirs[1], theirs[2], theirs[3], lens[0],
                    lens[1], lens[2], lens[3]);
      out += text;
    }
  }
  const LensType& lens_of_rig = lens_type(camera.parameters);
  if (!lens_of_rig.plain.empty() && info.model != lens_of_rig.name)
    return out;  // ROS has no such lens: its numbers are of another one
  const ParameterBlock* block = find_block(camera, ParameterKind::distortion);
  const std::vector<double> ours = block ? block->values : std::vector<double>(),
                            their_distortion = rectified ? std::vector<double>() : info.distortion;
  double most = 0;
  for (size_t i = 0; i < std::max(ours.size(), their_distortion.size()); ++i)
    most = std::max(most, std::abs((i < ours.size() ? ours[i] : 0) -
                                   (i < their_distortion.size() ? their_distortion[i] : 0)));
  if (most > 1e-3) {
    std::snprintf(text, sizeof text, "%sa distortion coefficient differs by %.3g",
                  out.empty() ? "" : "; ", most);
    out += text;
  }
  return out;
}

}  // namespace

CameraTopics find_camera_topics(const RigFile& rig, const RecordedStreams& streams) {
  CameraTopics out;
  std::set<std::string> videos;
  out.images.assign(rig.rig.sensors.size(), -1);
  out.infos.assign(rig.rig.sensors.size(), -1);
  CameraFinder{rig, streams, out}.find();
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s)
    if (rig.rig.sensors[s].type == "camera" && out.images[s] < 0)
      for (const auto& [topic, what] : streams.videos)
        videos.insert(topic + " is compressed video (" + what +
                      "), which is not read: most of its frames contain only the changes since the "
                      "previous one. Record raw, PNG or JPEG images; or extract images of the "
                      "video at rests (ffmpeg) and search them with `kincal detect`");
  out.notes.insert(out.notes.end(), videos.begin(), videos.end());
  return out;
}

std::vector<std::string> other_lenses(const RigFile& rig, const RecordedStreams& streams,
                                      const CameraTopics& cameras) {
  std::vector<std::string> out;
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
    if (cameras.infos[s] < 0 || cameras.images[s] < 0) continue;
    const bool rectified =
        has(streams.images[static_cast<size_t>(cameras.images[s])].topic, "rect");
    const CameraInfoMessage& info = streams.infos[static_cast<size_t>(cameras.infos[s])];
    if (!(info.k[0] != 0) && !(info.k[1] != 0)) {
      out.push_back("sensor '" + rig.rig.sensors[s].name + "': " + info.topic +
                    " is of an uncalibrated camera (K is all 0): its lens is taken from the rig");
      continue;
    }
    const std::string text = lens_difference(rig.rig.sensors[s], info, rectified);
    if (!text.empty())
      out.push_back("sensor '" + rig.rig.sensors[s].name + "': " + info.topic +
                    " has another lens than the rig: " + text);
  }
  return out;
}

}  // namespace kincal
