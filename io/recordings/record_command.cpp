#include "record_command.h"

#include <algorithm>

namespace kincal {
namespace {

/// The camera_info beside an image topic.
std::string info_of(std::string image) {
  const std::string packed = "/compressed";
  if (image.size() > packed.size() &&
      image.compare(image.size() - packed.size(), packed.size(), packed) == 0)
    image.resize(image.size() - packed.size());
  const size_t slash = image.rfind('/');
  return (slash == std::string::npos ? "" : image.substr(0, slash)) + "/camera_info";
}

struct TopicsToRecord {
  std::vector<std::string> all;
  std::vector<std::string> notes;

  void add(const std::string& topic) {
    if (std::find(all.begin(), all.end(), topic) == all.end()) all.push_back(topic);
  }
  void assume(const std::string& what, const std::string& topic, const std::string& where) {
    notes.push_back(what + " is taken to be " + topic + ": write `topic: ...` into " + where +
                    " if it is another");
    add(topic);
  }
};

void add_joints(const RigFile& rig, TopicsToRecord& topics) {
  const std::vector<std::string> given = given_joint_topics(rig);
  for (const std::string& topic : given) topics.add(topic);
  bool readings = false, poses = false;
  for (const Joint& joint : rig.rig.tree.joints) {
    readings = readings || joint.has_reading();
    poses = poses || joint.first_axis >= 0;
  }
  if (given.empty() && readings)
    topics.assume("the topic of the joints", "/joint_states", "`joints` of the rig");
  if (given.empty() && poses) topics.add("/tf");
  if (poses) topics.add("/tf_static");
}

}  // namespace

std::string given_topic(const RigFile& rig, const std::string& sensor) {
  const Node* entry = rig.node.find("sensors")->find(sensor);
  const Node* topic = entry ? entry->find("topic") : nullptr;
  return topic ? topic->text : "";
}

std::vector<std::string> given_joint_topics(const RigFile& rig) {
  const Node* joints = rig.node.find("joints");
  const Node* topic = joints ? joints->find("topic") : nullptr;
  if (!topic || topic->kind == Node::Kind::mapping) return {};
  const Field field{topic, &rig.path, "joints.topic"};
  return topic->kind == Node::Kind::sequence ? field.strings()
                                             : std::vector<std::string>{field.string()};
}

std::string given_joint_prefix(const RigFile& rig) {
  const Node* joints = rig.node.find("joints");
  const Node* prefix = joints ? joints->find("prefix") : nullptr;
  return prefix && prefix->kind != Node::Kind::mapping ? prefix->text : "";
}

RecordCommand record_command(const RigFile& rig) {
  TopicsToRecord topics;
  add_joints(rig, topics);
  for (const Sensor& sensor : rig.rig.sensors) {
    const std::string given = given_topic(rig, sensor.name), own = "/" + sensor.name;
    const std::string where = "sensors." + sensor.name;
    if (sensor.type == "camera") {
      if (given.empty())
        topics.assume("the topic of camera '" + sensor.name + "'", own + "/image_raw", where);
      else
        topics.add(given);
      topics.add(info_of(given.empty() ? own + "/image_raw" : given));
    } else if (sensor.type == "tilting_laser" || sensor.type == "pose" || sensor.type == "point") {
      const std::string usual = sensor.type == "tilting_laser" ? own + "/scan" : own + "/pose";
      if (given.empty())
        topics.assume("the topic of '" + sensor.name + "'", usual, where);
      else
        topics.add(given);
    }
  }
  if (!rig.flange_only) topics.add("/robot_description");
  RecordCommand out;
  out.notes = topics.notes;
  std::string list;
  for (const std::string& topic : topics.all) list += " " + topic;
  out.ros1 = "rosbag record --lz4 -O calibration.bag" + list;
  out.ros2 = "ros2 bag record -s mcap -o calibration" + list;
  return out;
}

}  // namespace kincal
