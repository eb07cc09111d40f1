#include "topics.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../document/names.h"
#include "../urdf/urdf.h"
#include "record_command.h"

namespace kincal {
namespace {

constexpr double kEnough = 20;        // score that tells by itself what a topic is
constexpr double kNearLens = 0.02;    // share of the focal length
constexpr double kSlowReadings = 10;  // Hz
constexpr double kOriginOfJoint = 1e-4, kAxisOfJoint = 1e-4;  // m and rad; rad
constexpr size_t kMostJoints = 3;  // missing ones with a line of their own

std::set<std::string> lower_words(const std::string& name) {
  std::set<std::string> out;
  std::string word;
  for (const char c : name + "/") {
    if (std::isalnum(static_cast<unsigned char>(c))) {
      word += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    } else if (!word.empty()) {
      out.insert(word);
      word.clear();
    }
  }
  return out;
}

/// The share of the words of a name that are in another one; of one without separators between its
/// words (headcam) whether it is in it at all.
double likeness(const std::string& name, const std::string& in) {
  const std::set<std::string> words = lower_words(name), others = lower_words(in);
  double found = 0;
  for (const std::string& word : words) found += others.count(word) ? 1 : 0;
  if (found > 0 || words.empty())
    return found / static_cast<double>(std::max<size_t>(1, words.size()));
  return name.size() > 3 && in.find(name) != std::string::npos ? 1 : 0;
}

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

/// The finder of cameras' topics.
struct CameraTopics {
  const RigFile& rig;
  const RecordedStreams& streams;
  TopicMap& out;
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
      return "which images are its is not clear (" + comma_separated(all) +
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
    const double named = likeness(sensor.name, camera.space);
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
          take(sensor, c, "as the rig says");
        } else {
          out.images[sensor] = i;
          say(sensor, "as the rig says");
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

/// How likely a topic has the true state of joints, and not what they should do.
bool is_command(const std::string& topic) {
  for (const char* word : {"command", "desired", "goal", "target", "reference", "setpoint", "cmd"})
    if (has(topic, word)) return true;
  return false;
}

/// The joints that a sensor or target stands on, or that scan.
std::set<int> joints_that_tell(const Rig& rig) {
  std::set<int> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    for (const int j : needed_readings(rig, static_cast<int>(s), -1)) out.insert(j);
    if (rig.sensors[s].scanning_joint >= 0) out.insert(rig.sensors[s].scanning_joint);
  }
  for (size_t t = 0; t < rig.targets.size(); ++t)
    for (const int j : needed_readings(rig, -1, static_cast<int>(t))) out.insert(j);
  return out;
}

/// Names joints of the rig that no topic has, and topics that are too slow.
void check_joints(const RigFile& rig_file, const RecordedStreams& streams, TopicMap& out) {
  const Rig& rig = rig_file.rig;
  std::vector<std::string> missing, there;
  std::map<std::string, std::vector<std::string>>
      not_taken;                       // by topic: joints that are only there
  std::map<std::string, double> slow;  // by topic: Hz
  for (const JointStream& s : streams.joints) there.push_back(s.joint);
  std::sort(there.begin(), there.end());
  there.erase(std::unique(there.begin(), there.end()), there.end());
  for (const int j : joints_that_tell(rig)) {
    const Joint& joint = rig.tree.joints[static_cast<size_t>(j)];
    if (!joint.has_reading()) continue;
    const int at = out.joints[static_cast<size_t>(j)];
    if (at < 0) {
      const auto has_it = [&](const JointStream& s) { return s.joint == joint.name; };
      const auto s = std::find_if(streams.joints.begin(), streams.joints.end(), has_it);
      if (s != streams.joints.end())
        not_taken[s->topic].push_back(joint.name);
      else
        missing.push_back(joint.name);
      continue;
    }
    const JointStream& s = streams.joints[static_cast<size_t>(at)];
    std::vector<double> steps;
    for (size_t i = 1; i < s.readings.size(); ++i)
      steps.push_back(s.readings.times[i] - s.readings.times[i - 1]);
    const double step = median(steps, 0);
    if (step > 1 / kSlowReadings) slow[s.topic] = 1 / step;
  }
  for (const auto& [topic, rate] : slow) {
    char text[160];
    std::snprintf(text, sizeof text,
                  ": %.2g readings a second are too few to tell when joints rest: record 50 or "
                  "more, or rests may contain motion",
                  rate);
    out.notes.push_back(topic + text);
  }
  for (const auto& [topic, joints] : not_taken)
    out.notes.push_back(
        "what stands on joints " + comma_separated(joints) + " gives no samples: only " + topic +
        " has them, which " +
        (given_joint_topics(rig_file).empty()
             ? "is taken for what they should do, by its name. If it is what they did, write "
               "`topic: " +
                   topic + "` into the rig's joints; else record their joint states"
             : "the rig's joints.topic does not name"));
  if (missing.empty()) return;
  const std::string recorded = "the recording has";
  if (there.empty())
    out.notes.push_back("no topic has joint states: the readings of " + comma_separated(missing) +
                        " are missing, and what stands on these joints gives no samples");
  else if (missing.size() <= kMostJoints)
    for (const std::string& name : missing)
      out.notes.push_back("joint '" + name +
                          "' is on no topic, what stands on it gives no samples" +
                          nearest_or_all(name, there, recorded));
  else
    out.notes.push_back("joints " + comma_separated(missing) +
                        " are on no topic, what stands on them gives no samples; the recording "
                        "has joints " +
                        comma_separated(there));
}

void find_joints(const RigFile& rig, const RecordedStreams& streams, TopicMap& out) {
  const std::vector<std::string> given = given_joint_topics(rig);
  std::set<std::string> all;
  for (const JointStream& s : streams.joints) all.insert(s.topic);
  for (const PoseStream& s : streams.poses) all.insert(s.topic);
  for (const std::string& topic : given)
    if (!all.count(topic))
      throw InputError(rig.path + ": joints.topic: '" + topic + "' is not in the recording" +
                       nearest_or_all(topic, {all.begin(), all.end()}, "readings are on"));
  std::map<std::string, std::vector<std::string>> joints_by_topic, others;
  for (size_t j = 0; j < rig.rig.tree.joints.size(); ++j) {
    const Joint& joint = rig.rig.tree.joints[j];
    if (!joint.has_reading()) continue;
    std::vector<std::string> too;
    for (size_t i = 0; i < streams.joints.size(); ++i) {
      const JointStream& s = streams.joints[i];
      if (s.joint != joint.name) continue;
      if (!given.empty() ? !std::count(given.begin(), given.end(), s.topic) : is_command(s.topic))
        continue;
      int& at = out.joints[j];
      const bool better =
          at < 0 || s.readings.size() > streams.joints[static_cast<size_t>(at)].readings.size();
      if (at >= 0) too.push_back(better ? streams.joints[static_cast<size_t>(at)].topic : s.topic);
      if (better) at = static_cast<int>(i);
    }
    if (out.joints[j] < 0) continue;
    const std::string& topic = streams.joints[static_cast<size_t>(out.joints[j])].topic;
    joints_by_topic[topic].push_back(joint.name);
    for (const std::string& other : too) others[topic].push_back(other);
  }
  for (const auto& [topic, joints] : joints_by_topic) {
    std::string line = "joints: " + topic + " (" + std::to_string(joints.size()) + " of the robot";
    const std::set<std::string> same(others[topic].begin(), others[topic].end());
    for (const std::string& other : same)
      line += "; some are on " + other + " as well, more slowly";
    out.lines.push_back(line + ")");
  }
}

PoseSource frames_source(const RecordedStreams& streams, const std::string& frame,
                         const std::string& child) {
  std::set<std::string> children;
  for (const PoseStream& s : streams.poses) children.insert(s.child);
  PoseSource out;
  if (!children.count(child) || frame.empty() || child.empty()) return out;
  for (const PoseStream& s : streams.poses) {  // at some time of theirs
    Pose ignored;
    if (s.child != child || s.times.empty()) continue;
    const double middle = s.fixed ? 0 : s.times[s.times.size() / 2];
    if (transform_at(streams.poses, frame, child, middle, 1, ignored)) {
      out.frame = frame;
      out.child = child;
      return out;
    }
  }
  return out;
}

void find_floating(const RigFile& rig, const RecordedStreams& streams, TopicMap& out) {
  const Tree& tree = rig.rig.tree;
  const std::vector<std::string> given = given_joint_topics(rig);
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    const Joint& joint = tree.joints[j];
    if (joint.first_axis < 0) continue;
    PoseSource& source = out.floating[j];
    const Tree& written = rig.urdf.tree;  // links of opened joints have names of their own
    const std::string& child = written.links[static_cast<size_t>(written.joints[j].child)];
    std::vector<int> candidates;
    for (size_t i = 0; i < streams.poses.size(); ++i) {
      const PoseStream& s = streams.poses[i];
      const bool a_sensors = std::any_of(
          rig.rig.sensors.begin(), rig.rig.sensors.end(),
          [&](const Sensor& sensor) { return given_topic(rig, sensor.name) == s.topic; });
      if (!a_sensors && !s.fixed && s.topic != "/tf" && s.topic != "tf" &&
          (given.empty() || std::count(given.begin(), given.end(), s.topic)))
        candidates.push_back(static_cast<int>(i));
    }
    std::string why = "as the rig says";
    if (given.empty()) {
      const std::string& parent = written.links[static_cast<size_t>(written.joints[j].parent)];
      source = frames_source(streams, parent, child);
      if (source.known()) {
        out.lines.push_back("joint " + joint.name + ": transforms from " + parent + " to " + child);
        continue;
      }
      why = "guessed: the only poses";
      std::vector<int> named;
      for (const int i : candidates) {
        const PoseStream& s = streams.poses[static_cast<size_t>(i)];
        if (s.child == child || likeness(joint.name, s.topic) > 0 || likeness(child, s.topic) > 0)
          named.push_back(i);
      }
      if (named.size() == 1) candidates = named, why = "guessed by its name";
    }
    if (candidates.size() == 1) {
      source.stream = candidates[0];
      out.lines.push_back("joint " + joint.name + ": " +
                          streams.poses[static_cast<size_t>(candidates[0])].topic + " (" + why +
                          ")");
    } else {
      out.notes.push_back("joint '" + joint.name + "': " +
                          (candidates.empty() ? "no poses of it in the recording"
                                              : "which poses are its is not clear") +
                          ": write `topic: ...` into `joints` of the rig");
    }
  }
}

/// The target that a stream of poses is about.
int target_of(const Rig& rig, const PoseStream& stream) {
  if (rig.targets.size() == 1) return 0;
  int best = -1, equal = 0;
  double most = 0;
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const double score = stream.child == rig.targets[t].name
                             ? 2
                             : likeness(rig.targets[t].name, stream.topic + "/" + stream.child);
    if (score > most)
      most = score, best = static_cast<int>(t), equal = 1;
    else if (score == most && score > 0)
      ++equal;
  }
  return equal == 1 ? best : -1;
}

void find_pose_sensors(const RigFile& rig, const RecordedStreams& streams, TopicMap& out) {
  const std::vector<Sensor>& sensors = rig.rig.sensors;
  for (size_t s = 0; s < sensors.size(); ++s) {
    if (sensors[s].type != "pose") continue;
    const std::string given = given_topic(rig, sensors[s].name);
    std::vector<int> candidates, named;
    for (size_t i = 0; i < streams.poses.size(); ++i) {
      const PoseStream& p = streams.poses[i];
      const bool joints =
          std::any_of(out.floating.begin(), out.floating.end(),
                      [&](const PoseSource& f) { return f.stream == static_cast<int>(i); });
      const bool robots = rig.rig.tree.find_link(p.child) >= 0;
      if (given.empty() ? p.fixed || joints || robots : p.topic != given) continue;
      candidates.push_back(static_cast<int>(i));
      if (likeness(sensors[s].name, p.topic + "/" + p.frame) > 0)
        named.push_back(candidates.back());
    }
    const bool by_name = given.empty() && candidates.size() > 1 && named.size() == 1;
    if (by_name) candidates = named;
    if (candidates.size() != 1) {
      out.notes.push_back("sensor '" + sensors[s].name + "': " +
                          (candidates.empty() ? "no poses of it in the recording"
                                              : "which poses are its is not clear") +
                          ": write `topic: ...` into its entry of the rig");
      continue;
    }
    const PoseStream& p = streams.poses[static_cast<size_t>(candidates[0])];
    const int target = target_of(rig.rig, p);
    if (target < 0) {
      out.notes.push_back("sensor '" + sensors[s].name + "': the poses of " + p.topic +
                          " are of no target of the rig by name: give one the name of its frame");
      continue;
    }
    out.poses[s].stream = candidates[0];
    out.pose_targets[s] = target;
    out.lines.push_back("sensor " + sensors[s].name + ": " + p.topic + " of target " +
                        rig.rig.targets[static_cast<size_t>(target)].name + " (" +
                        (!given.empty() ? "as the rig says"
                         : by_name      ? "guessed by its name"
                                        : "guessed: the only poses") +
                        ")");
  }
}

void find_scans(const RigFile& rig, const RecordedStreams& streams, TopicMap& out) {
  const std::vector<Sensor>& sensors = rig.rig.sensors;
  for (size_t s = 0; s < sensors.size(); ++s) {
    const bool cloud = sensors[s].type == "point";
    if (sensors[s].type != "tilting_laser" && !cloud) continue;
    const std::string type = cloud ? "sensor_msgs/PointCloud2" : "sensor_msgs/LaserScan";
    const std::string given = given_topic(rig, sensors[s].name);
    const std::string& link = rig.rig.tree.links[static_cast<size_t>(sensors[s].link)];
    std::vector<int> candidates, named;
    for (size_t i = 0; i < streams.scans.size(); ++i) {
      const ScanStream& scan = streams.scans[i];
      if (scan.type != type || (!given.empty() && scan.topic != given)) continue;
      candidates.push_back(static_cast<int>(i));
      if (scan.frame == link || likeness(sensors[s].name, scan.topic) > 0.5)
        named.push_back(candidates.back());
    }
    if (candidates.size() > 1) candidates = named;
    if (candidates.size() == 1) {
      out.scans[s] = candidates[0];
      out.lines.push_back("sensor " + sensors[s].name + ": " +
                          streams.scans[static_cast<size_t>(candidates[0])].topic + " (" +
                          (given.empty() ? "guessed" : "as the rig says") + ")");
    } else if (candidates.size() > 1 || !given.empty()) {
      out.notes.push_back("sensor '" + sensors[s].name +
                          "': which scans are its is not clear: write `topic: ...` into its entry "
                          "of the rig");
    }
  }
}

/// How joints of the robot inside the recording differ from the rig's; "": they do not.
std::string joint_differences(const Tree& ours, const Tree& theirs) {
  std::vector<std::string> out;
  std::string farthest;
  int moved = 0;
  double most = 0, by_translation = 0, by_rotation = 0;
  for (const Joint& joint : ours.joints) {
    const int at = theirs.find_joint(joint.name);
    if (at < 0) continue;
    const Joint& other = theirs.joints[static_cast<size_t>(at)];
    if (joint.type != other.type)
      out.push_back("joint '" + joint.name + "' is " + type_name(other.type) + ", the rig's " +
                    type_name(joint.type));
    else if (joint.moves() && !((joint.axis - other.axis).norm() < kAxisOfJoint))
      out.push_back("joint '" + joint.name + "' has another axis");
    const Vector6d off = log_se3(inverse(joint.parent_T_joint) * other.parent_T_joint);
    const double translation = off.head<3>().norm(), rotation = off.tail<3>().norm();
    if (translation < kOriginOfJoint && rotation < kOriginOfJoint) continue;
    ++moved;
    if (translation + rotation <= most) continue;
    most = translation + rotation;
    by_translation = translation, by_rotation = rotation, farthest = joint.name;
  }
  if (moved > 0) {
    char text[100];
    std::snprintf(text, sizeof text, ": %.3g mm, %.3g mrad", 1e3 * by_translation,
                  1e3 * by_rotation);
    out.push_back(std::to_string(moved) + " joints have another origin, '" + farthest + "' most" +
                  text);
  }
  std::string all;
  for (const std::string& one : out) all += (all.empty() ? "" : "; ") + one;
  return all;
}

/// The robot inside the recording has the joints of the rig's, and where they are, if it is the
/// same.
void compare_descriptions(const RigFile& rig, const RecordedStreams& streams, TopicMap& out) {
  for (const auto& [topic, text] : streams.descriptions) {
    Urdf robot;
    try {
      robot = parse_urdf(text, topic);
    } catch (const InputError& error) {
      out.notes.push_back(std::string("the robot inside the recording cannot be read: ") +
                          error.what());
      continue;
    }
    std::vector<std::string> missing;
    for (const Joint& joint : rig.urdf.tree.joints)
      if (joint.moves() && robot.tree.find_joint(joint.name) < 0) missing.push_back(joint.name);
    if (!missing.empty() && !rig.flange_only)
      out.notes.push_back("the robot of the recording (" + topic + ") is another than the rig's (" +
                          rig.urdf.path + "): it has no joint " + comma_separated(missing));
    const std::string other = rig.flange_only ? "" : joint_differences(rig.urdf.tree, robot.tree);
    if (!other.empty())
      out.notes.push_back("the robot of the recording (" + topic + ") differs from the rig's (" +
                          rig.urdf.path + "): " + other);
  }
}

void compare_lenses(const RigFile& rig, const RecordedStreams& streams, TopicMap& out) {
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
    if (out.infos[s] < 0 || out.images[s] < 0) continue;
    const bool rectified = has(streams.images[static_cast<size_t>(out.images[s])].topic, "rect");
    const CameraInfoMessage& info = streams.infos[static_cast<size_t>(out.infos[s])];
    const std::string text = lens_difference(rig.rig.sensors[s], info, rectified);
    if (!text.empty())
      out.notes.push_back("sensor '" + rig.rig.sensors[s].name + "': " + info.topic +
                          " has another lens than the rig: " + text);
  }
}

}  // namespace

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
  const ParameterBlock* block = find_block(camera, ParameterKind::distortion);
  const std::vector<double> ours = block ? block->values : std::vector<double>(),
                            their_distortion = rectified ? std::vector<double>() : info.distortion;
  double most = 0;
  for (size_t i = 0; i < std::max(ours.size(), their_distortion.size()); ++i)
    most = std::max(most, std::abs((i < ours.size() ? ours[i] : 0) -
                                   (i < their_distortion.size() ? their_distortion[i] : 0)));
  if (most > 1e-3) {
    std::snprintf(text, sizeof text, "%sa number of the distortion differs by %.3g",
                  out.empty() ? "" : "; ", most);
    out += text;
  }
  return out;
}

TopicMap find_topics(const RigFile& rig, const RecordedStreams& streams) {
  TopicMap out;
  const size_t sensors = rig.rig.sensors.size(), joints = rig.rig.tree.joints.size();
  out.images.assign(sensors, -1);
  out.infos.assign(sensors, -1);
  out.scans.assign(sensors, -1);
  out.poses.resize(sensors);
  out.pose_targets.assign(sensors, -1);
  out.joints.assign(joints, -1);
  out.floating.resize(joints);
  find_joints(rig, streams, out);
  check_joints(rig, streams, out);
  find_floating(rig, streams, out);
  CameraTopics{rig, streams, out}.find();
  find_pose_sensors(rig, streams, out);
  find_scans(rig, streams, out);
  compare_descriptions(rig, streams, out);
  compare_lenses(rig, streams, out);
  return out;
}

}  // namespace kincal
