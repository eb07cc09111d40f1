#include "samples_file.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "../../kinematics/floating.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/recording.h"
#include "../../models/rig/targets.h"
#include "../../models/rig/words.h"
#include "../../models/sensors/surface.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/kinds.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "conditions_entry.h"
#include "types.h"

namespace kincal {
namespace {

// ------------------------------------------------------------------------------------------------
// reading
/// What reading a sample needs of a rig, looked up once.
struct Lookup {
  const Rig& rig;
  std::unordered_map<std::string, int> joints, sensors, targets;
  std::vector<std::vector<int>> needs;    // by sensor and target: joints of which a view needs the
                                          // reading
  std::vector<char> spreads;              // by target: three points not on a line
  std::vector<SharedList<double>> sigma;  // by sensor: the rig's
  mutable std::vector<SharedList<int>> ids;  // by sensor and target: those of the last view
};

template <class T>
std::unordered_map<std::string, int> index_of(const std::vector<T>& things) {
  std::unordered_map<std::string, int> index;
  for (size_t i = 0; i < things.size(); ++i) index.emplace(things[i].name, static_cast<int>(i));
  return index;
}

Lookup lookup(const Rig& rig) {
  Lookup look{
      rig, index_of(rig.tree.joints), index_of(rig.sensors), index_of(rig.targets), {}, {}, {}, {}};
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    for (size_t t = 0; t < rig.targets.size(); ++t)
      look.needs.push_back(view_readings(rig, static_cast<int>(s), static_cast<int>(t)));
  for (const Sensor& sensor : rig.sensors) look.sigma.emplace_back(sensor.sigma);
  look.ids.resize(look.needs.size());
  for (const Joint& joint : rig.tree.joints)
    if (joint.floating >= 0) look.joints.erase(joint.name);  // nobody writes them
  for (const Target& target : rig.targets)
    look.spreads.push_back(
        !on_a_line(target.grid ? Eigen::Matrix3Xd(target.layout) : target.points));
  return look;
}

template <class T>
int read_name(const Field& field, const std::unordered_map<std::string, int>& index,
              const std::vector<T>& things, const std::string& what) {
  const std::string name = field.string();
  const auto found = index.find(name);
  if (found != index.end()) return found->second;
  field.fail("unknown " + what + " '" + name + "'" +
             nearest_or_all(name, names_of(things), "the rig has"));
}

/// Readings of the robot's joints; other names (a gripper of another description) are checked and
/// left.
std::vector<double> read_readings(const Field& field, const Lookup& look, size_t joints) {
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a mapping of joint names to readings is expected");
  std::vector<double> readings(joints, kNan);
  for (const auto& [name, node] : field.node->members) {
    const Field reading{&node, field.path, field.name + "." + name};
    const auto found = look.joints.find(name);
    const int joint = found == look.joints.end() ? -1 : found->second;
    if (joint >= 0 && look.rig.tree.joints[joint].first_axis >= 0)
      set_pose_reading(look.rig.tree, joint, read_pose_reading(reading), readings);
    else if (const double number = reading.number(); joint >= 0)
      readings[joint] = number;
  }
  return readings;
}

/// The joints of a sample: as the file has them, and their readings by the tree's index.
struct SampleJoints {
  const Field& field;
  const std::vector<double>& readings;
};

/// Fails if a joint that the view needs has no reading; names a misspelt one.
void check_readings(const Field& field, const SampleJoints& joints, const Lookup& look,
                    const View& view) {
  const Rig& rig = look.rig;
  for (int j : look.needs[view.sensor * rig.targets.size() + view.target]) {
    if (!std::isnan(joints.readings[j])) continue;
    const std::vector<int> of_sensor = needed_readings(rig, view.sensor, -1);
    const bool sensors = std::find(of_sensor.begin(), of_sensor.end(), j) != of_sensor.end();
    const std::string& name = read_name(rig.tree, j);
    Names others, near;  // in the sample, of no joint of the robot
    for (const auto& member : joints.field.node->members)
      if (!look.joints.count(member.first)) {
        others.push_back(member.first);
        if (!nearest_names(name, {member.first}).empty()) near.push_back(member.first);
      }
    if (near.size() != 1) near = others;
    field.fail((sensors ? "sensor '" + rig.sensors[view.sensor].name
                        : "target '" + rig.targets[view.target].name) +
               "' needs joint '" + name + "', which the sample lacks" +
               (near.empty()
                    ? ""
                    : "; the sample has " + joined(near, 6) + ", but names are those of the URDF"));
  }
}

/// x y z qx qy qz qw; a quaternion of the file keeps its digits.
std::vector<double> read_pose_numbers(const Field& field) {
  const Pose pose = field.pose();
  Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  if (field.has("quat")) {
    q = Eigen::Map<const Eigen::Vector4d>(field["quat"].vector(4).data());
    if (std::abs(q.norm() - 1) > 1e-15) q.normalize();
  }
  const Vector3d& t = pose.translation;
  return {t.x(), t.y(), t.z(), q[0], q[1], q[2], q[3]};
}

/// Which of the target's points a view shows: its ids, or the first `count`.
std::vector<int> read_ids(const Field& view, const Field& payload, const Target& target,
                          int count) {
  const int all = target.count();
  if (count == 0) payload.fail("at least one point is expected");
  if (target.type == "plane") return std::vector<int>(count, 0);  // which of its points is unknown
  std::vector<int> ids;
  ids.reserve(static_cast<size_t>(count));
  if (!view.has("ids")) {
    if (count > all)
      payload.fail(std::to_string(count) + " points, but target '" + target.name + "' has " +
                   std::to_string(all));
    for (int i = 0; i < count; ++i) ids.push_back(i);
    return ids;
  }
  const Field field = view["ids"];
  if (field.node->kind != Node::Kind::sequence)
    field.fail("a list of the target's point indices is expected");
  if (static_cast<int>(field.size()) != count)
    field.fail(std::to_string(field.size()) + " ids for " + std::to_string(count) + " points");
  std::vector<char> seen(all, 0);
  for (size_t i = 0; i < field.size(); ++i) {
    const int id = field.integer_item(i, 0, all - 1);
    if (seen[id]) field.item(i).fail("point " + std::to_string(id) + " occurs twice");
    seen[id] = 1;
    ids.push_back(id);
  }
  return ids;
}

Matrix3d read_covariance(const Field& field) {
  const std::vector<double> numbers = field.table(3);
  if (numbers.size() != 9) field.fail("3 rows of 3 numbers are expected");
  const Matrix3d m = Eigen::Map<const Matrix3d>(numbers.data());
  const Matrix3d skewness = (m - m.transpose()).cwiseAbs();
  const bool symmetric =
      ((m.cwiseAbs() * 1e-6).array() + 1e-9 * m.cwiseAbs().maxCoeff() >= skewness.array()).all();
  if (!symmetric) field.fail("a covariance is symmetric");
  const Matrix3d mean = 0.5 * (m + m.transpose());
  if (Eigen::LLT<Matrix3d>(mean).info() != Eigen::Success)
    field.fail("a covariance is positive definite");
  return mean;
}

/// One 3 x 3 matrix for all points, or one a point.
std::vector<Matrix3d> read_covariances(const Field& field, int count) {
  const Node& node = *field.node;
  const bool each =
      node.kind == Node::Kind::sequence && !node.items.empty() &&
      (node.items[0].columns > 0 ||
       (!node.items[0].items.empty() && node.items[0].items[0].kind == Node::Kind::sequence));
  if (!each) return std::vector<Matrix3d>(count, read_covariance(field));
  if (static_cast<int>(field.size()) != count)
    field.fail("one 3 x 3 matrix, or one for each of the " + std::to_string(count) +
               " points, is expected; not " + std::to_string(field.size()));
  std::vector<Matrix3d> out;
  for (int i = 0; i < count; ++i) out.push_back(read_covariance(field.item(i)));
  return out;
}

/// Fails on measured numbers of another type of sensor, and without those of its own.
void check_payload(const Field& view, const std::string& type, const std::string& own) {
  for (const SensorKeys& other : sensor_types()) {
    const std::string key = other.payload;
    if (!key.empty() && key != own && view.has(key))
      view[key].fail(
          "a " + type + " view has no '" + key + "'" +
          (own.empty() ? "; the joint readings are its measurement" : "; it needs '" + own + "'"));
  }
  if (!own.empty() && !view.has(own))
    view.fail("a " + type + " view needs '" + own + "'" +
              (view.has("image") ? "; `kincal detect` finds them in its image" : ""));
}

/// The keys that a view may have beside sensor and target.
Names view_keys() {
  Names keys = {"ids"};
  for (const SensorKeys& type : sensor_types())
    if (*type.payload) keys.push_back(type.payload);
  keys.insert(keys.end(), {"sigma", "covariance", "image"});
  return keys;
}

View read_view(const Field& field, const SampleJoints& joints, const Lookup& look) {
  const Rig& rig = look.rig;
  static const Names required = {"sensor", "target"}, optional = view_keys();
  field.check_keys(required, optional);
  View view;
  view.sensor = read_name(field["sensor"], look.sensors, rig.sensors, "sensor");
  view.target = read_name(field["target"], look.targets, rig.targets, "target");
  const Sensor& sensor = rig.sensors[view.sensor];
  const Target& target = rig.targets[view.target];
  if (sees_surfaces(*sensor.model) != (target.type == "plane"))
    field.fail("only sensors of type surface see planes; '" + sensor.name + "' is a " +
               sensor.type + ", '" + target.name + "' a " + target.type);
  const std::string payload = payload_of(sensor);
  check_payload(field, sensor.type, payload);
  if (sensor.model->measures_pose()) {
    if (field.has("ids")) field["ids"].fail("a " + sensor.type + " view has no 'ids'");
    if (!payload.empty()) view.z = read_pose_numbers(field[payload]);
  } else {
    const int numbers = sensor.model->measurement_size();
    view.z = numbers == 1 ? field[payload].vector() : field[payload].table(numbers);
    std::vector<int> ids =
        read_ids(field, field[payload], target, static_cast<int>(view.z.size()) / numbers);
    SharedList<int>& before = look.ids[view.sensor * rig.targets.size() + view.target];
    if (before != ids) before = std::move(ids);
    view.ids = before;
  }
  if (sensor.model->measurement_kind() == MeasurementKind::chain && !look.spreads[view.target])
    field.fail("a chain needs a target with three points not on a line, '" + target.name +
               "' has none; for a single point use a sensor of type point on link '" +
               rig.tree.links[sensor.link] + "'");
  view.sigma = field.has("sigma") ? SharedList<double>(read_sigma(field["sigma"], sensor))
                                  : look.sigma[view.sensor];
  if (field.has("covariance")) {
    if (sensor.type != "point")
      field["covariance"].fail("a " + sensor.type +
                               " view has no 'covariance', only a point view has");
    if (field.has("sigma")) field["covariance"].fail("either sigma or covariance, not both");
    view.covariance = read_covariances(field["covariance"], static_cast<int>(view.ids.size()));
  }
  if (field.has("image")) field["image"].string();
  check_readings(field, joints, look, view);
  return view;
}

/// Reads sigmas of readings, in place of the rig's, as ratios to those.
std::vector<double> read_joint_noise(const Field& field, const Field& readings,
                                     const Lookup& look) {
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a mapping of joint names to sigmas is expected");
  const Rig& rig = look.rig;
  std::vector<double> noise(rig.tree.joints.size(), 1);
  const auto set = [&](const Field& sigma, int joint) {
    const double number = sigma.number_at_least(0);
    if (!(number > 0)) sigma.fail("a sigma above 0 is expected");
    if (!(rig.joints[joint].sigma > 0))
      sigma.fail("the rig takes the readings of joint '" + read_name(rig.tree, joint) +
                 "' as exact: state its sigma there (joints: {" + read_name(rig.tree, joint) +
                 ": {sigma: ...}})");
    noise[joint] = number / rig.joints[joint].sigma;
  };
  for (const auto& [name, node] : field.node->members) {
    const Field sigma{&node, field.path, field.name + "." + name};
    const auto found = look.joints.find(name);
    if (found == look.joints.end() && readings.has(name)) continue;  // as its reading is
    if (found == look.joints.end())
      sigma.fail("unknown joint '" + name + "'" +
                 nearest_or_all(name, names_of(rig.tree.joints), "the robot has"));
    const int first = rig.tree.joints[found->second].first_axis;
    if (first < 0) {
      set(sigma, found->second);
      continue;
    }
    sigma.check_keys({"translation", "rotation"});
    for (int k = 0; k < kPoseAxes; ++k)
      set(sigma[k < 3 ? "translation" : "rotation"], first + kPoseAxes + k);
  }
  return noise;
}

/// The keys that a sample may have beside those that it needs.
Names sample_keys() {
  Names keys = {"time", "split", "joint_sigma"};
  keys.insert(keys.end(), condition_keys().begin(), condition_keys().end());
  return keys;
}

Sample read_sample(const Field& field, const Lookup& look) {
  static const Names required = {"id", "joints", "views"}, optional = sample_keys();
  field.check_keys(required, optional);
  Sample sample;
  if (!field["id"].node->quoted) field["id"].fail("a string is expected, e.g. \"posture_7\"");
  sample.id = field["id"].string();
  if (field.has("time")) sample.time = field["time"].number();
  if (field.has("split")) {
    const std::string split = field["split"].string();
    if (split != "train" && split != "test")
      field["split"].fail("'train' or 'test' is expected, not '" + split + "'");
    sample.train = split == "train";
  }
  const Field joints = field["joints"], views = field["views"];
  sample.readings = read_readings(joints, look, look.rig.tree.joints.size());
  if (field.has("joint_sigma")) sample.noise = read_joint_noise(field["joint_sigma"], joints, look);
  sample.conditions = read_conditions(field, look.rig);
  if (views.node->kind != Node::Kind::sequence) views.fail("a list of views is expected");
  sample.views.reserve(views.size());
  for (size_t i = 0; i < views.size(); ++i)
    sample.views.push_back(read_view(views.item(i), {joints, sample.readings}, look));
  return sample;
}

// ------------------------------------------------------------------------------------------------
// writing
/// A list of `count` lists of `columns` numbers.
std::string json_table(const double* values, int count, int columns) {
  std::string out = "[";
  for (int i = 0; i < count; ++i) out += (i ? ", " : "") + list_text(values + i * columns, columns);
  return out + "]";
}

/// Inverse of read_sigma.
std::string json_sigma(const std::vector<double>& sigma, const Sensor& sensor) {
  const Names names = sigma_names(sensor);
  if (names.empty()) {
    const bool same =
        std::all_of(sigma.begin(), sigma.end(), [&](double s) { return s == sigma[0]; });
    return !sigma_by_axis(sensor) || same ? shortest(sigma[0])
                                          : list_text(sigma.data(), static_cast<int>(sigma.size()));
  }
  std::string out = "{";
  const size_t stride = sigma.size() / names.size();
  for (size_t i = 0; i < names.size(); ++i)
    out += (i ? ", " : "") + json_string(names[i]) + ": " + shortest(sigma[i * stride]);
  return out + "}";
}

std::string json_view(const Rig& rig, const View& view, const std::string& image) {
  const Sensor& sensor = rig.sensors[view.sensor];
  std::string out = "{\"sensor\": " + json_string(sensor.name) +
                    ", \"target\": " + json_string(rig.targets[view.target].name);
  const std::string payload = payload_of(sensor);
  const int count = static_cast<int>(view.ids.size());
  if (!sensor.model->measures_pose()) {
    std::string ids;
    for (int id : view.ids) ids += (ids.empty() ? "" : ", ") + std::to_string(id);
    const int numbers = sensor.model->measurement_size();
    if (count > 0 || image.empty())
      out += ", \"ids\": [" + ids + "], \"" + payload + "\": " +
             (numbers == 1 ? list_text(view.z.data(), count)
                           : json_table(view.z.data(), count, numbers));
  } else if (!payload.empty()) {
    const double* z = view.z.data();
    out += ", \"" + payload + "\": {\"xyz\": " + list_text(z, 3) +
           ", \"quat\": " + list_text(z + 3, 4) + "}";
  }
  if (!view.covariance.empty()) {
    out += ", \"covariance\": [";
    for (int i = 0; i < count; ++i)
      out += (i ? ", " : "") + json_table(view.covariance[i].data(), 3, 3);  // symmetric
    out += "]";
  } else if (view.sigma != sensor.sigma) {
    out += ", \"sigma\": " + json_sigma(view.sigma, sensor);
  }
  if (!image.empty()) out += ", \"image\": " + json_string(image);
  return out + "}";
}

/// Inverse of read_joint_noise: those that are not the rig's.
std::string json_joint_sigma(const Rig& rig, const Sample& sample) {
  std::string out;
  for (size_t j = 0; j < sample.noise.size(); ++j) {
    const Joint& joint = rig.tree.joints[j];
    if (joint.floating >= 0) continue;  // written with the joint that it is an axis of
    const int error = joint.first_axis >= 0 ? joint.first_axis + kPoseAxes : static_cast<int>(j);
    const auto sigma = [&](int k) { return shortest(joint_sigma(rig, sample, error + k)); };
    if (joint.first_axis < 0 ? sample.noise[error] == 1
                             : sample.noise[error] == 1 && sample.noise[error + 3] == 1)
      continue;
    out += (out.empty() ? "" : ", ") + json_string(joint.name) + ": " +
           (joint.first_axis < 0
                ? sigma(0)
                : "{\"translation\": " + sigma(0) + ", \"rotation\": " + sigma(3) + "}");
  }
  return out.empty() ? out : ", \"joint_sigma\": {" + out + "}";
}

std::string json_sample(const Rig& rig, const Sample& sample,
                        const std::vector<std::string>& images) {
  std::string out = "{\"id\": " + json_string(sample.id);
  if (sample.time) out += ", \"time\": " + shortest(*sample.time);
  std::string views;
  for (size_t v = 0; v < sample.views.size(); ++v)
    views += (v ? ", " : "") +
             json_view(rig, sample.views[v], v < images.size() ? images[v] : std::string());
  const std::string split = sample.train ? "\"train\"" : "\"test\"";
  return out + ", \"joints\": " + readings_text(rig.tree, sample.readings) +
         json_joint_sigma(rig, sample) + conditions_text(rig, sample.conditions) +
         ", \"views\": [" + views + "], \"split\": " + split + "}\n";
}

}  // namespace

Pose read_pose_reading(const Field& field) {
  if (field.node->kind != Node::Kind::mapping || !field.has("xyz") ||
      !(field.has("quat") || field.has("rpy")))
    field.fail(
        "the reading of a floating joint is a pose, {\"xyz\": [x, y, z], \"quat\": [x, y, z, "
        "w]} (or \"rpy\")");
  return field.pose();
}

std::string readings_text(const Tree& tree, const std::vector<double>& readings) {
  std::string out;
  for (size_t j = 0; j < readings.size(); ++j) {
    const Joint& joint = tree.joints[j];
    const bool pose = joint.first_axis >= 0;
    if (joint.floating >= 0 || std::isnan(readings[pose ? joint.first_axis : j])) continue;
    out += (out.empty() ? "" : ", ") + json_string(joint.name) + ": ";
    if (!pose) {
      out += shortest(readings[j]);
      continue;
    }
    const Pose reading = pose_reading(tree, static_cast<int>(j), readings);
    const Eigen::Vector4d q = quaternion_from_rotation(reading.rotation);
    out += "{\"xyz\": " + list_text(reading.translation.data(), 3) +
           ", \"quat\": " + list_text(q.data(), 4) + "}";
  }
  return "{" + out + "}";
}

std::vector<Sample> parse_samples(const std::string& text, const std::string& path, const Rig& rig,
                                  const Progress& progress) {
  refuse_other_kinds(text, path, Wanted::samples);
  const Lookup look = lookup(rig);
  std::vector<Sample> samples;
  const auto read = [&](const Field& field) {
    samples.push_back(read_sample(field, look));
    return samples.back().id;
  };
  for_each_json_line(text, path, read, progress);
  if (samples.empty()) throw InputError(path + ": no samples");
  return samples;
}

std::vector<Sample> read_samples(const std::string& path, const Rig& rig) {
  return parse_samples(read_file(path), path, rig);
}

std::string samples_text(const Rig& rig, const std::vector<Sample>& samples,
                         const std::vector<std::vector<std::string>>& images) {
  std::string text;
  const std::vector<std::string> none;
  for (size_t i = 0; i < samples.size(); ++i)
    text += json_sample(rig, samples[i], i < images.size() ? images[i] : none);
  return text;
}

}  // namespace kincal
