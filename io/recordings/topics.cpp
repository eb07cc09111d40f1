#include "topics.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/words.h"
#include "../document/names.h"
#include "../urdf/urdf.h"
#include "camera_topics.h"
#include "record_command.h"

namespace kincal {
namespace {

constexpr double kSlowReadings = 10;                          // Hz
constexpr double kOriginOfJoint = 1e-4, kAxisOfJoint = 1e-4;  // m and rad; rad
constexpr double kBothRest = 0.5;  // s, in which readings of two topics are compared
constexpr size_t kMostJoints = 3;  // missing ones with a line of their own

/// How likely a topic has the true state of joints, and not what they should do.
bool is_command(const std::string& topic) {
  for (const char* word : {"command", "desired", "goal", "target", "reference", "setpoint", "cmd"})
    if (topic.find(word) != std::string::npos) return true;
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

/// Refuses a recording whose joints are all called like the robot's with something before it, or
/// none of which has the rig's prefix. @throws InputError
void check_prefix(const RigFile& rig_file, const RecordedStreams& streams) {
  const Rig& rig = rig_file.rig;
  const std::string given = given_joint_prefix(rig_file);
  std::set<std::string> there, prefixes;
  for (const JointStream& s : streams.joints) there.insert(s.joint);
  std::vector<std::string> names;
  for (const int j : joints_that_tell(rig))
    if (rig.tree.joints[static_cast<size_t>(j)].has_reading())
      names.push_back(rig.tree.joints[static_cast<size_t>(j)].name);
  const auto has = [&](const std::string& prefix) {
    return [&there, prefix](const std::string& name) { return there.count(prefix + name) > 0; };
  };
  if (names.empty() || there.empty() || std::any_of(names.begin(), names.end(), has(given))) return;
  for (const std::string& joint : there) {
    const size_t before = joint.size() - std::min(joint.size(), names[0].size());
    const std::string prefix = joint.substr(0, before);
    if (joint.substr(before) == names[0] && std::all_of(names.begin(), names.end(), has(prefix)))
      prefixes.insert(prefix);
  }
  if (prefixes.empty() && given.empty()) return;
  std::string lines;
  for (const std::string& prefix : prefixes)
    lines += (lines.empty() ? "" : " or ") +
             (prefix.empty() ? "no `prefix`" : "`prefix: " + prefix + "`");
  throw InputError(rig_file.path + ": joints: no joint of the recording is " +
                   (given.empty() ? "one of the robot's"
                                  : "'" + given + "' and the name of one of the robot's") +
                   (prefixes.empty() ? "; it has " + comma_separated({there.begin(), there.end()})
                                     : ", but all are with something before it: write " + lines +
                                           " into `joints` of the rig"));
}

/// Where two topics have different readings of one joint while it rests; "": nowhere.
std::string contradiction(const JointStream& one, const JointStream& other, bool continuous) {
  const auto still = [](const Series& s) {
    return still_intervals(s, std::max(1e-9, still_tolerance(s)), longest_gap(s.times));
  };
  const double noise = std::max(1e-9, still_tolerance(one.readings)) +
                       std::max(1e-9, still_tolerance(other.readings));
  double most = noise;
  std::string out;
  for (const TimeInterval& rest : intersected(still(one.readings), still(other.readings))) {
    if (rest.length() < kBothRest) continue;
    const TimeInterval middle{rest.begin + rest.length() / 4, rest.end - rest.length() / 4};
    const Average a = average(one.readings, middle), b = average(other.readings, middle);
    if (a.count == 0 || b.count == 0) continue;
    double apart = a.mean - b.mean;
    if (continuous) apart = std::remainder(apart, 2 * kPi);
    if (!(std::abs(apart) > most)) continue;
    most = std::abs(apart);
    out = text(
        "topics '%s' and '%s' contradict each other: joint '%s' is %.6g on the first and "
        "%.6g on the second at %.1f s, at rest, and their noise is %.2g",
        one.topic.c_str(), other.topic.c_str(), one.joint.c_str(), a.mean, b.mean,
        (middle.begin + middle.end) / 2, noise);
  }
  return out;
}

/// Names joints of the rig that no topic has, and topics that are too slow.
void check_joints(const RigFile& rig_file, const RecordedStreams& streams, TopicMap& out) {
  const Rig& rig = rig_file.rig;
  const std::string prefix = given_joint_prefix(rig_file);
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
      const auto has_it = [&](const JointStream& s) { return s.joint == prefix + joint.name; };
      const auto s = std::find_if(streams.joints.begin(), streams.joints.end(), has_it);
      if (s != streams.joints.end())
        not_taken[s->topic].push_back(joint.name);
      else
        missing.push_back(prefix + joint.name);
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
                  ": %.2g readings per second are too few to detect rests of the joints: record 50 "
                  "or more, or rests may contain motion",
                  rate);
    out.notes.push_back(topic + text);
  }
  for (const auto& [topic, joints] : not_taken)
    out.notes.push_back("views that depend on joints " + comma_separated(joints) +
                        " give no samples: only " + topic + " has them, which " +
                        (given_joint_topics(rig_file).empty()
                             ? "contains commands, judging by its name. If they are measured "
                               "positions, write `topic: " +
                                   topic + "` into the rig's joints; else record their joint states"
                             : "the rig's joints.topic does not name"));
  if (missing.empty()) return;
  const std::string recorded = "the recording has";
  if (there.empty())
    out.notes.push_back("no topic has joint states: the readings of " + comma_separated(missing) +
                        " are missing, and views that depend on these joints give no samples");
  else if (missing.size() <= kMostJoints)
    for (const std::string& name : missing)
      out.notes.push_back("joint '" + name +
                          "' is on no topic: views that depend on it give no samples" +
                          nearest_or_all(name, there, recorded));
  else
    out.notes.push_back(
        "joints " + comma_separated(missing) +
        " are on no topic: views that depend on them give no samples; the recording has joints " +
        comma_separated(there));
}

void find_joints(const RigFile& rig, const RecordedStreams& streams, TopicMap& out) {
  const std::vector<std::string> given = given_joint_topics(rig);
  const std::string prefix = given_joint_prefix(rig);
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
    std::vector<int> too;
    for (size_t i = 0; i < streams.joints.size(); ++i) {
      const JointStream& s = streams.joints[i];
      if (s.joint != prefix + joint.name) continue;
      if (!given.empty() ? !std::count(given.begin(), given.end(), s.topic) : is_command(s.topic))
        continue;
      int& at = out.joints[j];
      const bool better =
          at < 0 || s.readings.size() > streams.joints[static_cast<size_t>(at)].readings.size();
      if (at >= 0) too.push_back(better ? at : static_cast<int>(i));
      if (better) at = static_cast<int>(i);
    }
    if (out.joints[j] < 0) continue;
    const JointStream& taken = streams.joints[static_cast<size_t>(out.joints[j])];
    joints_by_topic[taken.topic].push_back(joint.name);
    for (const int i : too) {
      const JointStream& other = streams.joints[static_cast<size_t>(i)];
      const std::string why = contradiction(taken, other, joint.type == JointType::continuous);
      if (!why.empty())
        throw InputError(rig.path + ": joints: " + why + ": write `topic: " + taken.topic +
                         "` or `topic: " + other.topic +
                         "` into `joints` of the rig, whichever has the measured positions");
      others[taken.topic].push_back(other.topic);
    }
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
    std::string why = "as in the rig";
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
        if (s.child == child || name_likeness(joint.name, s.topic) > 0 ||
            name_likeness(child, s.topic) > 0)
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
    const double score =
        stream.child == rig.targets[t].name
            ? 2
            : name_likeness(rig.targets[t].name, stream.topic + "/" + stream.child);
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
      if (name_likeness(sensors[s].name, p.topic + "/" + p.frame) > 0)
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
                          " have no target: give a target of the rig the name of their frame");
      continue;
    }
    out.poses[s].stream = candidates[0];
    out.pose_targets[s] = target;
    out.lines.push_back("sensor " + sensors[s].name + ": " + p.topic + " of target " +
                        rig.rig.targets[static_cast<size_t>(target)].name + " (" +
                        (!given.empty() ? "as in the rig"
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
      if (scan.frame == link || name_likeness(sensors[s].name, scan.topic) > 0.5)
        named.push_back(candidates.back());
    }
    if (candidates.size() > 1) candidates = named;
    if (candidates.size() == 1) {
      out.scans[s] = candidates[0];
      out.lines.push_back("sensor " + sensors[s].name + ": " +
                          streams.scans[static_cast<size_t>(candidates[0])].topic + " (" +
                          (given.empty() ? "guessed" : "as in the rig") + ")");
    } else if (candidates.size() > 1 || !given.empty()) {
      out.notes.push_back(
          "sensor '" + sensors[s].name +
          "': it is not clear which scans are from it: write `topic: ...` into its entry "
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

void append(std::vector<std::string>& to, const std::vector<std::string>& more) {
  to.insert(to.end(), more.begin(), more.end());
}

}  // namespace

TopicMap find_topics(const RigFile& rig, const RecordedStreams& streams) {
  TopicMap out;
  const size_t sensors = rig.rig.sensors.size(), joints = rig.rig.tree.joints.size();
  out.scans.assign(sensors, -1);
  out.poses.resize(sensors);
  out.pose_targets.assign(sensors, -1);
  out.joints.assign(joints, -1);
  out.floating.resize(joints);
  check_prefix(rig, streams);
  find_joints(rig, streams, out);
  check_joints(rig, streams, out);
  find_floating(rig, streams, out);
  const CameraTopics cameras = find_camera_topics(rig, streams);
  out.images = cameras.images;
  out.infos = cameras.infos;
  append(out.lines, cameras.lines);
  append(out.notes, cameras.notes);
  find_pose_sensors(rig, streams, out);
  find_scans(rig, streams, out);
  compare_descriptions(rig, streams, out);
  append(out.notes, other_lenses(rig, streams, cameras));
  return out;
}

}  // namespace kincal
