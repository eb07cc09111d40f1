#include "rig_file.h"

#include <fnmatch.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <stdexcept>
#include <unordered_map>

#include "../../models/sensors/sensors.h"
#include "../../models/fitting/starts.h"

namespace kincal {
namespace {

using Names = std::vector<std::string>;

constexpr int kMostRows = 10'000;  // of a board; more is a slip, and would fill the memory
constexpr double kNoReading = std::numeric_limits<double>::quiet_NaN();

// ------------------------------------------------------------------------------------------------ names
/// Indices of the names that a name or glob means. A name that exists is always only itself.
std::vector<int> matching(const Field& where, const std::string& pattern, const Names& names) {
  const auto exact = std::find(names.begin(), names.end(), pattern);
  if (exact != names.end()) return {static_cast<int>(exact - names.begin())};
  std::vector<int> found;
  for (size_t i = 0; i < names.size(); ++i)
    if (fnmatch(pattern.c_str(), names[i].c_str(), FNM_NOESCAPE) == 0) found.push_back(static_cast<int>(i));
  if (found.empty()) where.fail("'" + pattern + "' matches nothing" + nearest_names(pattern, names));
  return found;
}

template <class T>
Names names_of(const std::vector<T>& things) {
  Names names;
  for (const T& thing : things) names.push_back(thing.name);
  return names;
}

std::string joined(const Names& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

/// The type of a target or sensor, one of `types`.
std::string read_type(const Field& field, const Names& types) {
  if (field.node->kind != Node::Kind::mapping) field.check_keys({"type"});
  const std::string type = field["type"].string();
  if (std::find(types.begin(), types.end(), type) == types.end())
    field["type"].fail("unknown type '" + type + "'" + nearest_names(type, types) + "; valid: " + joined(types));
  return type;
}

int read_link(const Field& field, const Tree& tree) {
  const std::string name = field.string();
  const int link = tree.find_link(name);
  if (link < 0) field.fail("unknown link '" + name + "'" + nearest_names(name, tree.links));
  return link;
}

/// The joints between two links; a floating or planar one is the fault of `field`, which asks for the way.
Path path_between(const Field& field, const Tree& tree, int from, int to) {
  try {
    return find_path(tree, from, to);
  } catch (const std::invalid_argument& e) {
    field.fail(e.what());
  }
}

bool is_null(const Field& field) { return field.node->kind == Node::Kind::null; }

/// Fails unless `field` is a mapping with something in it.
void check_entries(const Field& field, const std::string& of) {
  if (field.node->kind != Node::Kind::mapping || field.size() == 0) field.fail("a mapping of " + of + " is expected, at least one");
}

// ------------------------------------------------------------------------------------------------ joints
/// Settings of all joints as the text has them, later entries over earlier ones.
std::vector<JointSettings> read_joints(const Field& field, const Tree& tree) {
  std::vector<JointSettings> settings(tree.joints.size());
  if (is_null(field)) return settings;
  if (field.node->kind != Node::Kind::mapping) field.fail("a mapping of joint names or globs is expected");
  const Names names = names_of(tree.joints);
  for (const auto& member : field.node->members) {
    const std::string& pattern = member.first;
    const Field entry = field[pattern];
    entry.check_keys({}, {"sigma", "offset", "scale"});
    for (int j : matching(entry, pattern, names)) {
      const Joint& joint = tree.joints[j];
      if (!joint.has_reading()) {
        const std::string kind = joint.mimic ? "mimic" : joint.type == JointType::fixed ? "fixed" : "floating or planar";
        if (joint.name == pattern) entry.fail("a " + kind + " joint has no reading of its own");
        continue;
      }
      if (entry.has("sigma")) settings[j].sigma = entry["sigma"].number_at_least(0);
      if (entry.has("offset")) settings[j].offset = entry["offset"].number();
      if (entry.has("scale")) settings[j].scale = entry["scale"].number();
      if (settings[j].scale == 0) entry["scale"].fail("a scale is not 0");
    }
  }
  return settings;
}

// ------------------------------------------------------------------------------------------------ targets
struct TargetKeys {
  Names required, optional;
  const char* size;  // the key of Target::square, "" if it has none
};
const std::map<std::string, TargetKeys>& target_types() {
  static const std::map<std::string, TargetKeys> types = {
      {"chessboard", {{"rows", "columns", "square"}, {}, "square"}},
      {"points", {{"points"}, {}, ""}},
      {"charuco", {{"rows", "columns", "square", "marker", "dictionary"}, {}, "square"}},
      {"circles", {{"rows", "columns", "spacing"}, {"asymmetric"}, "spacing"}},
      {"apriltag_grid", {{"rows", "columns", "tag", "spacing", "family"}, {}, "tag"}}};
  return types;
}

Eigen::Matrix3Xd matrix_of(const std::vector<double>& xyz) {
  return Eigen::Map<const Eigen::Matrix3Xd>(xyz.data(), 3, static_cast<int>(xyz.size() / 3));
}

/// Points of a grid target for a size of 1, in the order of their ids.
Eigen::Matrix3Xd grid_layout(const Field& field, const std::string& type) {
  const int least = type == "charuco" ? 2 : 1;  // its squares have inner corners only from 2 on
  const int rows = field["rows"].integer(least, kMostRows), columns = field["columns"].integer(least, kMostRows);
  const bool asymmetric = type == "circles" && field.has("asymmetric") && field["asymmetric"].boolean();
  std::vector<double> xyz;
  const auto add = [&](double x, double y) { xyz.insert(xyz.end(), {x, y, 0}); };
  const double pitch = type == "apriltag_grid" ? 1 + field["spacing"].number_at_least(0) : 1;
  const int skipped = type == "charuco" ? 1 : 0;
  for (int r = skipped; r < rows; ++r)
    for (int c = skipped; c < columns; ++c) {
      if (type != "apriltag_grid") {
        add(asymmetric ? 2 * c + r % 2 : c, r);
        continue;
      }
      add(c * pitch, r * pitch);
      add(c * pitch + 1, r * pitch);
      add(c * pitch + 1, r * pitch + 1);
      add(c * pitch, r * pitch + 1);
    }
  return matrix_of(xyz);
}

void read_mount(const Field& field, const Tree& tree, int base, Target& target) {
  if (field.node->kind == Node::Kind::scalar) {
    if (field.string() != "free") field.fail("'free' or {link, pose} is expected, not '" + field.string() + "'");
    return;
  }
  field.check_keys({"link"}, {"pose"});
  target.link = read_link(field["link"], tree);
  path_between(field["link"], tree, base, target.link);
  target.pose_given = field.has("pose");
  if (target.pose_given) target.link_T_target = field["pose"].pose();
}

Target read_target(const std::string& name, const Field& field, const Tree& tree, int base) {
  Names types;
  for (const auto& type : target_types()) types.push_back(type.first);
  Target target;
  target.name = name;
  target.type = read_type(field, types);
  const TargetKeys& keys = target_types().at(target.type);
  Names required = {"type", "mount"};
  required.insert(required.end(), keys.required.begin(), keys.required.end());
  field.check_keys(required, keys.optional);
  target.grid = target.type != "points";
  if (target.grid) {
    target.layout = grid_layout(field, target.type);
    target.square = field[keys.size].positive();
  } else {
    target.points = matrix_of(field["points"].table(3));
    if (target.count() == 0) field["points"].fail("at least one point is expected");
  }
  if (target.type == "charuco") {  // for the detection in images only
    field["marker"].positive();
    field["dictionary"].string();
  }
  if (target.type == "apriltag_grid") field["family"].string();
  read_mount(field["mount"], tree, base, target);
  return target;
}

// ------------------------------------------------------------------------------------------------ sensors
/// What files say about a type of sensor.
struct SensorKeys {
  Names required, optional;
  const char* payload;  // key of a view's measured numbers, "" if the joint readings are the measurement
};
const std::map<std::string, SensorKeys>& sensor_types() {
  static const std::map<std::string, SensorKeys> types = {
      {"camera", {{"model", "intrinsics", "sigma"}, {"image_size", "distortion", "baseline"}, "pixels"}},
      {"tilting_laser", {{"joint", "sigma"}, {}, "rays"}},
      {"chain", {{"sigma"}, {}, ""}},
      {"point", {{"sigma"}, {}, "points"}},
      {"pose", {{"sigma"}, {}, "pose"}}};
  return types;
}

/// Sensors of other types, which a program may add to its rig, show points.
std::string payload_of(const Sensor& sensor) {
  const auto found = sensor_types().find(sensor.type);
  return found == sensor_types().end() ? "points" : found->second.payload;
}

Names sigma_names(const std::string& type) {
  if (type == "tilting_laser") return {"joint", "bearing", "range"};
  return type == "pose" || type == "chain" ? Names{"translation", "rotation"} : Names{};
}

/// Standard deviations as the model takes them: camera 2, point 3, laser (joint, bearing, range), poses 3 + 3.
std::vector<double> read_sigma(const Field& field, const std::string& type) {
  const Names names = sigma_names(type);
  if (names.empty()) {
    const bool list = type == "point" && field.node->kind == Node::Kind::sequence;
    if (!list) return std::vector<double>(type == "camera" ? 2 : 3, field.positive());
    const std::vector<double> sigma = field.vector(3);
    for (size_t i = 0; i < 3; ++i) field.item(i).positive();
    return sigma;
  }
  if (field.node->kind != Node::Kind::mapping) field.fail("a " + type + " takes {" + joined(names) + "}, each a number greater than 0");
  field.check_keys(names);
  std::vector<double> sigma;
  for (const std::string& name : names) sigma.insert(sigma.end(), names.size() == 2 ? 3 : 1, field[name].positive());
  return sigma;
}

void read_camera(const Field& field, Sensor& sensor) {
  static const std::map<std::string, Lens> lenses = {
      {"pinhole", Lens::pinhole}, {"brown_conrady", Lens::brown_conrady}, {"kannala_brandt", Lens::kannala_brandt}};
  const std::string model = field["model"].string();
  const auto lens = lenses.find(model);
  if (lens == lenses.end()) {
    Names names;
    for (const auto& one : lenses) names.push_back(one.first);
    field["model"].fail("unknown model '" + model + "'" + nearest_names(model, names) + "; valid: " + joined(names));
  }
  const std::vector<double> intrinsics = field["intrinsics"].vector(4);
  for (size_t i = 0; i < 2; ++i) field["intrinsics"].item(i).positive();
  const bool pinhole = lens->second == Lens::pinhole;
  std::vector<double> distortion(pinhole ? 0 : lens->second == Lens::kannala_brandt ? 4 : 5, 0.0);
  if (field.has("distortion")) {
    distortion = field["distortion"].vector();
    if (pinhole && std::all_of(distortion.begin(), distortion.end(), [](double k) { return k == 0; })) distortion.clear();
  }
  try {
    sensor.model = make_camera(lens->second, static_cast<int>(distortion.size()));
  } catch (const std::invalid_argument& e) {
    field["distortion"].fail(model + ": " + (pinhole ? "no distortion, or all 0, is expected" : e.what()));
  }
  const double baseline = field.has("baseline") ? field["baseline"].number() : 0;
  sensor.parameters = camera_parameters(lens->second, intrinsics, distortion, baseline);
  if (!field.has("image_size")) return;
  const Field size = field["image_size"];
  size.vector(2);
  sensor.image_width = size.item(0).integer(1, 1'000'000);
  sensor.image_height = size.item(1).integer(1, 1'000'000);
}

void read_scanning_joint(const Field& field, const Tree& tree, const Path& path, int base, Sensor& sensor) {
  const std::string name = field.string();
  Names scanning;
  for (const Joint& joint : tree.joints)
    if (joint.has_reading()) scanning.push_back(joint.name);
  sensor.scanning_joint = tree.find_joint(name);
  if (sensor.scanning_joint < 0) field.fail("unknown joint '" + name + "'" + nearest_names(name, scanning));
  if (!tree.joints[sensor.scanning_joint].has_reading())
    field.fail("joint '" + name + "' has no reading of its own" + nearest_names(name, scanning));
  Names valid;
  for (const PathStep& step : path)
    if (tree.joints[step.joint].has_reading()) valid.push_back(tree.joints[step.joint].name);
  if (std::find(valid.begin(), valid.end(), name) == valid.end())
    field.fail("joint '" + name + "' is not between the base '" + tree.links[base] + "' and link '" + tree.links[sensor.link] +
               "'; valid: " + (valid.empty() ? "none" : joined(valid)));
}

Sensor read_sensor(const std::string& name, const Field& field, const Tree& tree, int base) {
  Names types;
  for (const auto& type : sensor_types()) types.push_back(type.first);
  Sensor sensor;
  sensor.name = name;
  sensor.type = read_type(field, types);
  const SensorKeys& keys = sensor_types().at(sensor.type);
  Names required = {"type", "link"}, optional = {"pose"};
  required.insert(required.end(), keys.required.begin(), keys.required.end());
  optional.insert(optional.end(), keys.optional.begin(), keys.optional.end());
  field.check_keys(required, optional);
  sensor.link = read_link(field["link"], tree);
  const Path path = path_between(field["link"], tree, base, sensor.link);
  sensor.pose_given = field.has("pose");
  if (sensor.pose_given) sensor.link_T_sensor = field["pose"].pose();
  sensor.sigma = read_sigma(field["sigma"], sensor.type);
  if (sensor.type == "camera") read_camera(field, sensor);
  if (sensor.type == "point") sensor.model = make_point();
  if (sensor.type == "pose") sensor.model = make_pose();
  if (sensor.type == "chain") sensor.model = make_chain();
  if (sensor.type == "tilting_laser") {
    sensor.model = make_tilting_laser();
    read_scanning_joint(field["joint"], tree, path, base, sensor);
  }
  return sensor;
}

// ------------------------------------------------------------------------------------------------ steps
Loss read_loss(const Field& field) {
  static const std::map<std::string, LossKind> kinds = {
      {"huber", LossKind::huber}, {"soft_l1", LossKind::soft_l1}, {"cauchy", LossKind::cauchy}, {"tukey", LossKind::tukey}};
  Names names;
  for (const auto& kind : kinds) names.push_back(kind.first);
  const auto is_kind = [&](const auto& member) { return kinds.count(member.first) > 0; };
  if (field.node->kind != Node::Kind::mapping) field.fail("one of {" + joined(names) + "} with its scale in sigmas is expected");
  Names keys = names;
  keys.push_back("scale");
  field.check_keys({}, keys);
  const auto& members = field.node->members;
  if (std::count_if(members.begin(), members.end(), is_kind) != 1)
    field.fail("one of {" + joined(names) + "} with its scale in sigmas is expected");
  const std::string& name = std::find_if(members.begin(), members.end(), is_kind)->first;
  Loss loss{kinds.at(name), field[name].positive()};
  if (field.has("scale")) {
    const std::string unit = field["scale"].string();
    if (unit != "sigma" && unit != "data") field["scale"].fail("'sigma' or 'data' is expected, not '" + unit + "'");
    loss.from_data = unit == "data";
  }
  return loss;
}

PriorSetting read_prior(const std::string& pattern, const Field& field) {
  PriorSetting prior;
  prior.pattern = pattern;
  prior.where = field.where();
  prior.split = field.node->kind == Node::Kind::mapping;
  if (prior.split) {
    field.check_keys({"translation", "rotation"});
    prior.translation = field["translation"].positive();
    prior.rotation = field["rotation"].positive();
  } else {
    prior.translation = prior.rotation = field.positive();
  }
  return prior;
}

Step read_step(const Field& field, const Names& sensors) {
  field.check_keys({"step", "free"}, {"sensors", "loss", "priors"});
  Step step;
  step.name = field["step"].string();
  std::vector<char> used(sensors.size(), !field.has("sensors"));
  if (field.has("sensors")) {
    const Field list = field["sensors"];
    const Names patterns = list.strings();
    if (patterns.empty()) list.fail("the step uses no sensor; leave the key away for all");
    for (size_t i = 0; i < patterns.size(); ++i)
      for (int s : matching(list.item(i), patterns[i], sensors)) used[s] = 1;
  }
  for (size_t s = 0; s < used.size(); ++s)
    if (used[s]) step.sensors.push_back(static_cast<int>(s));
  const Field free = field["free"];
  step.free = free.strings();
  if (step.free.empty()) free.fail("the step frees nothing");
  for (size_t i = 0; i < step.free.size(); ++i) step.free_where.push_back(free.item(i).where());
  if (field.has("loss") && !is_null(field["loss"])) step.loss = read_loss(field["loss"]);
  if (!field.has("priors") || is_null(field["priors"])) return step;
  const Field priors = field["priors"];
  if (priors.node->kind != Node::Kind::mapping) priors.fail("a mapping of parameter names or globs to sigmas is expected");
  for (const auto& member : priors.node->members) step.priors.push_back(read_prior(member.first, priors[member.first]));
  return step;
}

std::vector<Step> read_steps(const Field& field, const Names& sensors) {
  std::vector<Step> steps;
  if (is_null(field)) return steps;
  if (field.node->kind != Node::Kind::sequence) field.fail("a list of steps is expected");
  for (size_t i = 0; i < field.size(); ++i) {
    steps.push_back(read_step(field.item(i), sensors));
    for (size_t k = 0; k < i; ++k)
      if (steps[k].name == steps[i].name) field.item(i)["step"].fail("a step '" + steps[i].name + "' stands already above");
  }
  return steps;
}

/// The robot that the rig names, relative to the rig's own file.
std::string robot_path(const Field& field, const std::string& rig_path) {
  const std::filesystem::path path = std::filesystem::path(rig_path).parent_path() / field.string();
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) field.fail("file '" + path.string() + "' does not exist");
  return path.string();
}

// ------------------------------------------------------------------------------------------------ samples
/// What reading a sample needs of a rig, looked up once.
struct Lookup {
  std::unordered_map<std::string, int> joints, sensors, targets;
  std::vector<std::vector<int>> sensor_needs, target_needs;  // joints with a reading on the way to the base
  std::vector<char> spreads;                                 // by target: three points not on a line
};

template <class T>
std::unordered_map<std::string, int> index_of(const std::vector<T>& things) {
  std::unordered_map<std::string, int> index;
  for (size_t i = 0; i < things.size(); ++i) index.emplace(things[i].name, static_cast<int>(i));
  return index;
}

/// Joints whose readings place `link` relative to the base, without `except` (-1: none).
std::vector<int> needed_joints(const Rig& rig, int link, int except) {
  std::vector<int> needed;
  for (const PathStep& step : find_path(rig.tree, rig.base, link)) {
    if (!rig.tree.joints[step.joint].moves()) continue;
    const int joint = driver(rig.tree, step.joint).joint;
    if (joint != except && std::find(needed.begin(), needed.end(), joint) == needed.end()) needed.push_back(joint);
  }
  return needed;
}

Lookup lookup(const Rig& rig) {
  Lookup look{index_of(rig.tree.joints), index_of(rig.sensors), index_of(rig.targets), {}, {}, {}};
  for (const Sensor& sensor : rig.sensors) look.sensor_needs.push_back(needed_joints(rig, sensor.link, sensor.scanning_joint));
  for (const Target& target : rig.targets) {
    look.target_needs.push_back(target.link < 0 ? std::vector<int>() : needed_joints(rig, target.link, -1));
    look.spreads.push_back(!on_a_line(target.grid ? Eigen::Matrix3Xd(target.layout) : target.points));
  }
  return look;
}

template <class T>
int read_name(const Field& field, const std::unordered_map<std::string, int>& index, const std::vector<T>& things,
              const std::string& what) {
  const std::string name = field.string();
  const auto found = index.find(name);
  if (found != index.end()) return found->second;
  const std::string near = nearest_names(name, names_of(things));
  field.fail("unknown " + what + " '" + name + "'" + (near.empty() ? "; the rig has: " + joined(names_of(things)) : near));
}

/// Readings of the robot's joints; other names (a gripper of another description) are checked and left.
std::vector<double> read_readings(const Field& field, const Lookup& look, size_t joints) {
  if (field.node->kind != Node::Kind::mapping) field.fail("a mapping of joint names to readings is expected");
  std::vector<double> readings(joints, kNoReading);
  for (const auto& [name, node] : field.node->members) {
    const double reading = Field{&node, field.path, field.name + "." + name}.number();
    const auto found = look.joints.find(name);
    if (found != look.joints.end()) readings[found->second] = reading;
  }
  return readings;
}

/// Fails if a joint between the view's sensor or target (`what`, `whose`) and the base has no reading; tells of a misspelt one.
void check_readings(const Field& view, const Field& joints, const Rig& rig, const Lookup& look, const std::vector<double>& readings,
                    const std::vector<int>& needed, const char* what, const std::string& whose) {
  for (int j : needed) {
    if (!std::isnan(readings[j])) continue;
    const std::string& name = rig.tree.joints[j].name;
    std::string near;
    for (const auto& member : joints.node->members)
      if (!look.joints.count(member.first) && !nearest_names(name, {member.first}).empty())
        near = "; the sample has '" + member.first + "'";
    view.fail(std::string(what) + " '" + whose + "' needs joint '" + name + "', which the sample lacks" + near);
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
std::vector<int> read_ids(const Field& view, const Field& payload, const Target& target, int count) {
  const int all = target.count();
  if (count == 0) payload.fail("at least one point is expected");
  std::vector<int> ids;
  if (!view.has("ids")) {
    if (count > all) payload.fail(std::to_string(count) + " points, but target '" + target.name + "' has " + std::to_string(all));
    for (int i = 0; i < count; ++i) ids.push_back(i);
    return ids;
  }
  const Field field = view["ids"];
  if (field.node->kind != Node::Kind::sequence) field.fail("a list of the target's point indices is expected");
  if (static_cast<int>(field.size()) != count) field.fail(std::to_string(field.size()) + " ids for " + std::to_string(count) + " points");
  std::vector<char> seen(all, 0);
  for (size_t i = 0; i < field.size(); ++i) {
    const int id = field.integer_item(i, 0, all - 1);
    if (seen[id]) field.item(i).fail("point " + std::to_string(id) + " stands twice");
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
  const bool symmetric = ((m.cwiseAbs() * 1e-6).array() + 1e-9 * m.cwiseAbs().maxCoeff() >= skewness.array()).all();
  if (!symmetric) field.fail("a covariance is symmetric");
  const Matrix3d mean = 0.5 * (m + m.transpose());
  if (Eigen::LLT<Matrix3d>(mean).info() != Eigen::Success) field.fail("a covariance is positive definite");
  return mean;
}

/// One 3 x 3 matrix for all points, or one a point.
std::vector<Matrix3d> read_covariances(const Field& field, int count) {
  const Node& node = *field.node;
  const bool each = node.kind == Node::Kind::sequence && !node.items.empty() &&
                    (node.items[0].columns > 0 || (!node.items[0].items.empty() && node.items[0].items[0].kind == Node::Kind::sequence));
  if (!each) return std::vector<Matrix3d>(count, read_covariance(field));
  if (static_cast<int>(field.size()) != count)
    field.fail("one 3 x 3 matrix, or one for each of the " + std::to_string(count) + " points, is expected; not " +
               std::to_string(field.size()));
  std::vector<Matrix3d> out;
  for (int i = 0; i < count; ++i) out.push_back(read_covariance(field.item(i)));
  return out;
}

/// Fails on measured numbers of another type of sensor, and without those of its own.
void check_payload(const Field& view, const std::string& type, const std::string& own) {
  for (const auto& other : sensor_types()) {
    const std::string key = other.second.payload;
    if (!key.empty() && key != own && view.has(key))
      view[key].fail("a " + type + " view has no '" + key + "'" +
                     (own.empty() ? "; the joint readings are its measurement" : "; it needs '" + own + "'"));
  }
  if (!own.empty() && !view.has(own)) view.fail("a " + type + " view needs '" + own + "'");
}

View read_view(const Field& field, const Field& joints, const Rig& rig, const Lookup& look, const std::vector<double>& readings) {
  static const Names required = {"sensor", "target"},
                     optional = {"ids", "pixels", "rays", "points", "pose", "sigma", "covariance", "image"};
  field.check_keys(required, optional);
  View view;
  view.where = field.where();
  view.sensor = read_name(field["sensor"], look.sensors, rig.sensors, "sensor");
  view.target = read_name(field["target"], look.targets, rig.targets, "target");
  const Sensor& sensor = rig.sensors[view.sensor];
  const Target& target = rig.targets[view.target];
  const std::string payload = payload_of(sensor);
  check_payload(field, sensor.type, payload);
  if (sensor.model->whole_pose()) {
    if (field.has("ids")) field["ids"].fail("a " + sensor.type + " view has no 'ids'");
    if (!payload.empty()) view.z = read_pose_numbers(field[payload]);
  } else {
    const int numbers = sensor.model->numbers();
    view.z = field[payload].table(numbers);
    view.ids = read_ids(field, field[payload], target, static_cast<int>(view.z.size()) / numbers);
  }
  if (sensor.type == "chain" && !look.spreads[view.target])
    field.fail("a chain needs a target with three points not on a line, '" + target.name +
               "' has none; for a single point use a sensor of type point on link '" + rig.tree.links[sensor.link] + "'");
  view.sigma = field.has("sigma") ? read_sigma(field["sigma"], sensor.type) : sensor.sigma;
  if (field.has("covariance")) {
    if (sensor.type != "point") field["covariance"].fail("a " + sensor.type + " view has no 'covariance', only a point view has");
    if (field.has("sigma")) field["covariance"].fail("either sigma or covariance, not both");
    view.covariance = read_covariances(field["covariance"], static_cast<int>(view.ids.size()));
  }
  if (field.has("image")) field["image"].string();
  check_readings(field, joints, rig, look, readings, look.sensor_needs[view.sensor], "sensor", sensor.name);
  check_readings(field, joints, rig, look, readings, look.target_needs[view.target], "target", target.name);
  return view;
}

Sample read_sample(const Field& field, const Rig& rig, const Lookup& look) {
  static const Names required = {"id", "joints", "views"}, optional = {"time", "split"};
  field.check_keys(required, optional);
  Sample sample;
  if (!field["id"].node->quoted) field["id"].fail("a string is expected, e.g. \"posture_7\"");
  sample.id = field["id"].string();
  if (field.has("time")) sample.time = field["time"].number();
  if (field.has("split")) {
    const std::string split = field["split"].string();
    if (split != "train" && split != "test") field["split"].fail("'train' or 'test' is expected, not '" + split + "'");
    sample.train = split == "train";
  }
  const Field joints = field["joints"], views = field["views"];
  sample.readings = read_readings(joints, look, rig.tree.joints.size());
  if (views.node->kind != Node::Kind::sequence) views.fail("a list of views is expected");
  for (size_t i = 0; i < views.size(); ++i) sample.views.push_back(read_view(views.item(i), joints, rig, look, sample.readings));
  return sample;
}

// ------------------------------------------------------------------------------------------------ writing samples
std::string json_string(const std::string& text) {
  std::string out = "\"";
  for (unsigned char c : text) {
    static const char* hex = "0123456789abcdef";
    if (c == '"' || c == '\\')
      out += {'\\', static_cast<char>(c)};
    else if (c < 0x20)
      out += {'\\', 'u', '0', '0', hex[c >> 4], hex[c & 15]};
    else
      out += static_cast<char>(c);
  }
  return out + "\"";
}

std::string json_list(const double* values, int count) {
  std::string out = "[";
  for (int i = 0; i < count; ++i) out += (i ? ", " : "") + shortest(values[i]);
  return out + "]";
}

/// A list of `count` lists of `columns` numbers.
std::string json_table(const double* values, int count, int columns) {
  std::string out = "[";
  for (int i = 0; i < count; ++i) out += (i ? ", " : "") + json_list(values + i * columns, columns);
  return out + "]";
}

/// Inverse of read_sigma.
std::string json_sigma(const std::vector<double>& sigma, const std::string& type) {
  const Names names = sigma_names(type);
  if (names.empty()) {
    const bool same = std::all_of(sigma.begin(), sigma.end(), [&](double s) { return s == sigma[0]; });
    return type == "camera" || same ? shortest(sigma[0]) : json_list(sigma.data(), static_cast<int>(sigma.size()));
  }
  std::string out = "{";
  const size_t stride = sigma.size() / names.size();
  for (size_t i = 0; i < names.size(); ++i) out += (i ? ", " : "") + json_string(names[i]) + ": " + shortest(sigma[i * stride]);
  return out + "}";
}

std::string json_view(const Rig& rig, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  std::string out = "{\"sensor\": " + json_string(sensor.name) + ", \"target\": " + json_string(rig.targets[view.target].name);
  const std::string payload = payload_of(sensor);
  const int count = static_cast<int>(view.ids.size());
  if (!sensor.model->whole_pose()) {
    std::string ids;
    for (int id : view.ids) ids += (ids.empty() ? "" : ", ") + std::to_string(id);
    out += ", \"ids\": [" + ids + "], \"" + payload + "\": " + json_table(view.z.data(), count, sensor.model->numbers());
  } else if (!payload.empty()) {
    const double* z = view.z.data();
    out += ", \"" + payload + "\": {\"xyz\": " + json_list(z, 3) + ", \"quat\": " + json_list(z + 3, 4) + "}";
  }
  if (!view.covariance.empty()) {
    out += ", \"covariance\": [";
    for (int i = 0; i < count; ++i) out += (i ? ", " : "") + json_table(view.covariance[i].data(), 3, 3);  // symmetric
    out += "]";
  } else if (view.sigma != sensor.sigma) {
    out += ", \"sigma\": " + json_sigma(view.sigma, sensor.type);
  }
  return out + "}";
}

std::string json_sample(const Rig& rig, const Sample& sample) {
  std::string out = "{\"id\": " + json_string(sample.id);
  if (sample.time) out += ", \"time\": " + shortest(*sample.time);
  std::string joints, views;
  for (size_t j = 0; j < sample.readings.size(); ++j)
    if (!std::isnan(sample.readings[j]))
      joints += (joints.empty() ? "" : ", ") + json_string(rig.tree.joints[j].name) + ": " + shortest(sample.readings[j]);
  for (const View& view : sample.views) views += (views.empty() ? "" : ", ") + json_view(rig, view);
  const std::string split = sample.train ? "\"train\"" : "\"test\"";
  return out + ", \"joints\": {" + joints + "}, \"views\": [" + views + "], \"split\": " + split + "}\n";
}

// ------------------------------------------------------------------------------------------------ writing a rig
Node text_node(const std::string& text) {
  Node node;
  node.kind = Node::Kind::scalar;
  node.text = text;
  return node;
}
Node number_node(double value) { return text_node(shortest(value)); }
Node list_node(const double* values, int count) {
  Node node;
  node.kind = Node::Kind::sequence;
  for (int i = 0; i < count; ++i) node.items.push_back(number_node(values[i]));
  return node;
}
Node mapping_node() {
  Node node;
  node.kind = Node::Kind::mapping;
  return node;
}

/// The member `key` of a mapping, made null behind the members `after` (at the end if none is there) if it is absent.
Node& member(Node& mapping, const std::string& key, const Names& after = {}) {
  size_t at = mapping.members.size(), behind = 0;
  for (size_t i = 0; i < mapping.members.size(); ++i) {
    if (mapping.members[i].first == key) return mapping.members[i].second;
    if (std::find(after.begin(), after.end(), mapping.members[i].first) != after.end()) behind = i + 1;
  }
  if (behind > 0) at = behind;
  return mapping.members.insert(mapping.members.begin() + static_cast<std::ptrdiff_t>(at), {key, Node()})->second;
}

void erase_member(Node& mapping, const std::string& key) {
  auto& members = mapping.members;
  members.erase(std::remove_if(members.begin(), members.end(), [&](const auto& m) { return m.first == key; }), members.end());
}

/// Numbers that changed into a list or a single number; the others keep their text.
void set_numbers(Node& mapping, const std::string& key, const std::vector<double>& old, const std::vector<double>& now, bool single) {
  if (old == now) return;
  Node& node = member(mapping, key);
  if (single) {
    node = number_node(now[0]);
  } else if (node.items.size() != now.size()) {
    node = list_node(now.data(), static_cast<int>(now.size()));
  } else {
    for (size_t i = 0; i < now.size(); ++i)
      if (old[i] != now[i]) node.items[i] = number_node(now[i]);
  }
}

/// A changed translation or rotation into `pose` of a mapping; the rotation as a quaternion, which reads back exactly enough.
void set_pose(Node& mapping, const Pose& old, const Pose& now) {
  const bool moved = old.translation != now.translation, turned = old.rotation != now.rotation;
  if (!moved && !turned) return;
  Node& pose = member(mapping, "pose", {"link"});
  if (pose.kind != Node::Kind::mapping) pose = mapping_node();
  if (moved) {
    if (!pose.find("xyz")) pose.members.insert(pose.members.begin(), {"xyz", Node()});
    member(pose, "xyz") = list_node(now.translation.data(), 3);
  }
  if (!turned) return;
  const Eigen::Vector4d q = quaternion_from_rotation(now.rotation);
  erase_member(pose, "rpy");
  member(pose, "quat") = list_node(q.data(), 4);
}

bool same(const JointSettings& a, const JointSettings& b) { return a.sigma == b.sigma && a.offset == b.offset && a.scale == b.scale; }

/// What changed of one joint into its own entry.
void set_joint(Node& entry, const JointSettings& given, const JointSettings& now) {
  if (entry.kind != Node::Kind::mapping) entry = mapping_node();
  if (given.sigma != now.sigma) member(entry, "sigma") = number_node(now.sigma);
  if (given.offset != now.offset) member(entry, "offset") = number_node(now.offset);
  if (given.scale != now.scale) member(entry, "scale") = number_node(now.scale);
}

Node joint_node(const JointSettings& settings) {
  Node node = mapping_node();
  member(node, "sigma") = number_node(settings.sigma);
  member(node, "offset") = number_node(settings.offset);
  member(node, "scale") = number_node(settings.scale);
  return node;
}

/// First each joint's own entry is changed or appended. If a later glob still wins over it, it moves to the end.
void set_joints(Node& root, const RigFile& rig, const RigValues& values) {
  const Tree& tree = rig.rig.tree;
  const bool there = root.find("joints") != nullptr;
  Node& joints = member(root, "joints", {"robot", "base"});
  for (const bool move : {false, true}) {
    const std::vector<JointSettings> given = read_joints({&joints, &rig.path, "joints"}, tree);
    for (size_t j = 0; j < tree.joints.size(); ++j) {
      const JointSettings now = {values.joint_sigmas[j], values.joint_offsets[j], values.joint_scales[j]};
      if (!tree.joints[j].has_reading() || same(given[j], now)) continue;
      if (joints.kind != Node::Kind::mapping) joints = mapping_node();
      const std::string& name = tree.joints[j].name;
      if (move) {
        erase_member(joints, name);
        member(joints, name) = joint_node(now);
      } else {
        set_joint(member(joints, name), given[j], now);
      }
    }
  }
  if (!there && joints.kind == Node::Kind::null) erase_member(root, "joints");
}

/// Inverse of read_sigma.
void set_sigma(Node& node, const Sensor& sensor, const std::vector<double>& sigma) {
  if (sigma == sensor.sigma) return;
  const Names names = sigma_names(sensor.type);
  const size_t stride = names.empty() ? 1 : sigma.size() / names.size();
  Node& written = member(node, "sigma");
  if (names.empty() && written.kind != Node::Kind::sequence) written = number_node(sigma[0]);
  if (names.empty() && written.kind == Node::Kind::sequence) written = list_node(sigma.data(), static_cast<int>(sigma.size()));
  for (size_t i = 0; i < names.size(); ++i)
    if (sigma[i * stride] != sensor.sigma[i * stride]) member(written, names[i]) = number_node(sigma[i * stride]);
}

void set_sensor(Node& node, const Sensor& sensor, const Pose& pose, const std::vector<double>& sigma,
                const std::vector<std::vector<double>>& parameters) {
  set_pose(node, sensor.link_T_sensor, pose);
  set_sigma(node, sensor, sigma);
  for (size_t b = 0; b < sensor.parameters.size(); ++b) {
    const ParameterBlock& block = sensor.parameters[b];
    set_numbers(node, block.name, block.values, parameters[b], block.components.size() == 1 && block.components[0].empty());
  }
}

void set_target(Node& node, const Target& target, const Pose& pose, double square, const Eigen::Matrix3Xd& points) {
  if (target.link >= 0) set_pose(member(node, "mount"), target.link_T_target, pose);
  if (target.grid) {
    if (square != target.square) member(node, target_types().at(target.type).size) = number_node(square);
    return;
  }
  Node& rows = member(node, "points");
  for (int i = 0; i < target.count(); ++i)
    for (int k = 0; k < 3; ++k)
      if (points(k, i) != target.points(k, i)) rows.items[i].items[k] = number_node(points(k, i));
}

}  // namespace

// ------------------------------------------------------------------------------------------------ rig
RigFile read_rig(const std::string& path, const std::string& urdf_path) {
  RigFile file;
  file.path = path;
  file.text = read_file(path);
  file.node = parse_yaml(file.text, path);
  const Field all = top(file.node, path);
  all.check_keys({"format", "robot", "sensors", "targets"}, {"base", "joints", "estimate"});
  if (all["format"].string() != "kincal/1") all["format"].fail("'" + all["format"].string() + "' is not kincal/1");
  const std::string robot = urdf_path.empty() ? robot_path(all["robot"], path) : urdf_path;
  all["robot"].string();
  file.urdf = read_urdf(robot);

  Rig& rig = file.rig;
  rig.tree = file.urdf.tree;
  rig.base = all.has("base") ? read_link(all["base"], rig.tree) : rig.tree.root;
  rig.joints.resize(rig.tree.joints.size());
  if (all.has("joints")) rig.joints = read_joints(all["joints"], rig.tree);
  if (!urdf_path.empty())
    for (JointSettings& joint : rig.joints) joint.offset = 0;
  const Field targets = all["targets"], sensors = all["sensors"];
  check_entries(targets, "targets");
  check_entries(sensors, "sensors");
  for (const auto& entry : targets.node->members) rig.targets.push_back(read_target(entry.first, targets[entry.first], rig.tree, rig.base));
  for (const auto& entry : sensors.node->members) rig.sensors.push_back(read_sensor(entry.first, sensors[entry.first], rig.tree, rig.base));
  if (all.has("estimate")) rig.steps = read_steps(all["estimate"], names_of(rig.sensors));
  return file;
}

RigValues values_of(const Rig& rig) {
  RigValues values;
  for (const JointSettings& joint : rig.joints) {
    values.joint_offsets.push_back(joint.offset);
    values.joint_scales.push_back(joint.scale);
    values.joint_sigmas.push_back(joint.sigma);
  }
  for (const Sensor& sensor : rig.sensors) {
    values.sensor_poses.push_back(sensor.link_T_sensor);
    values.sensor_sigmas.push_back(sensor.sigma);
    values.sensor_parameters.emplace_back();
    for (const ParameterBlock& block : sensor.parameters) values.sensor_parameters.back().push_back(block.values);
  }
  for (const Target& target : rig.targets) {
    values.target_poses.push_back(target.link_T_target);
    values.target_squares.push_back(target.square);
    values.target_points.push_back(target.points);
  }
  return values;
}

void set_steps(RigFile& rig, const std::vector<Step>& steps) {
  static const char* const losses[] = {"none", "huber", "soft_l1", "cauchy", "tukey"};
  const auto names_node = [](const Names& names) {
    Node node;
    node.kind = Node::Kind::sequence;
    for (const std::string& name : names) node.items.push_back(text_node(name));
    return node;
  };
  rig.rig.steps = steps;
  Node list;
  list.kind = Node::Kind::sequence;
  for (const Step& step : steps) {
    Node node = mapping_node();
    member(node, "step") = text_node(step.name);
    if (step.sensors.size() < rig.rig.sensors.size()) {
      Names sensors;
      for (int s : step.sensors) sensors.push_back(rig.rig.sensors[s].name);
      member(node, "sensors") = names_node(sensors);
    }
    member(node, "free") = names_node(step.free);
    if (step.loss && step.loss->kind != LossKind::none) {
      Node loss = mapping_node();
      member(loss, losses[static_cast<int>(step.loss->kind)]) = number_node(step.loss->scale);
      member(node, "loss") = loss;
    }
    Node priors = mapping_node();
    for (const PriorSetting& prior : step.priors) {
      Node& sigma = member(priors, prior.pattern);
      if (!prior.split) {
        sigma = number_node(prior.translation);
        continue;
      }
      sigma = mapping_node();
      member(sigma, "translation") = number_node(prior.translation);
      member(sigma, "rotation") = number_node(prior.rotation);
    }
    if (!step.priors.empty()) member(node, "priors") = priors;
    list.items.push_back(node);
  }
  member(rig.node, "estimate") = list;
}

std::string rig_text(const RigFile& rig, const RigValues& values, const std::string& robot) {
  Node root = rig.node;
  member(root, "robot") = text_node(robot);
  set_joints(root, rig, values);
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.rig.sensors[s];
    set_sensor(member(member(root, "sensors"), sensor.name), sensor, values.sensor_poses[s], values.sensor_sigmas[s],
               values.sensor_parameters[s]);
  }
  for (size_t t = 0; t < rig.rig.targets.size(); ++t) {
    const Target& target = rig.rig.targets[t];
    set_target(member(member(root, "targets"), target.name), target, values.target_poses[t], values.target_squares[t],
               values.target_points[t]);
  }
  return to_yaml(root);
}

// ------------------------------------------------------------------------------------------------ samples
std::vector<Sample> read_samples(const std::string& path, const Rig& rig) {
  const Lookup look = lookup(rig);
  std::vector<Sample> samples;
  for_each_json_line(path, [&](const Field& field) {
    samples.push_back(read_sample(field, rig, look));
    return samples.back().id;
  });
  if (samples.empty()) throw InputError(path + ": no samples");
  return samples;
}

std::string samples_text(const Rig& rig, const std::vector<Sample>& samples) {
  std::string text;
  for (const Sample& sample : samples) text += json_sample(rig, sample);
  return text;
}

}  // namespace kincal
