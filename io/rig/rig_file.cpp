#include "rig_file.h"

#include <algorithm>
#include <functional>
#include <map>
#include <stdexcept>

#include "../../kinematics/floating.h"
#include "../../models/rig/selection.h"
#include "../../models/rig/targets.h"
#include "../../models/sensors/sensors.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/kinds.h"
#include "../document/names.h"
#include "../document/yaml.h"
#include "conditions_entry.h"
#include "elasticity_entry.h"
#include "types.h"

namespace kincal {
namespace {

// Of a board; more is a slip, and would fill the memory.
constexpr int kMostRows = 10'000, kMostPoints = 1'000'000;

// ------------------------------------------------------------------------------------------------
// names
/// Indices of the names that a name or glob means. A name that exists is always only itself.
std::vector<int> matching(const Field& where, const std::string& pattern, const Names& names) {
  const auto exact = std::find(names.begin(), names.end(), pattern);
  if (exact != names.end()) return {static_cast<int>(exact - names.begin())};
  std::vector<int> found;
  for (size_t i = 0; i < names.size(); ++i)
    if (glob_matches(pattern, names[i])) found.push_back(static_cast<int>(i));
  if (found.empty() && pattern != "*")  // all of none: a bench without joints
    where.fail("'" + pattern + "' matches nothing" + nearest_or_all(pattern, names, "there are"));
  return found;
}

/// The joints between two links; a floating or planar one is an error of `field`, which asks for
/// the path.
Path path_between(const Field& field, const Tree& tree, int from, int to) {
  try {
    return find_path(tree, from, to);
  } catch (const std::invalid_argument& e) {
    field.fail(e.what());
  }
}

bool is_null(const Field& field) { return field.node->kind == Node::Kind::null; }

/// Fails unless `field` is a mapping with something in it, and its names are of a usual length.
void check_entries(const Field& field, const std::string& of) {
  if (field.node->kind != Node::Kind::mapping || field.size() == 0)
    field.fail("a mapping of " + of + " is expected, at least one");
  for (const auto& [name, entry] : field.members()) {
    if (name.size() > kLongestName)
      throw InputError(Field{&entry, field.path, ""}.where() + ": " + of + ": " + long_name(name));
    if (!is_utf8(name))
      field.fail("the name '" + name +
                 "' is not UTF-8; convert the file, as by iconv -f latin1 -t utf-8");
  }
}

/// Reads the type of a target or sensor and checks its keys: those of the type beside `required`
/// and `optional` ones of all types.
template <class Keys>
const Keys& read_keys(const Field& field, const std::vector<Keys>& types, Names required,
                      Names optional) {
  if (field.node->kind != Node::Kind::mapping) field.check_keys({"type"});
  const std::string type = field["type"].string();
  const Keys* keys = find_type(types, type);
  if (!keys) {
    Names valid = names_of(types);
    std::sort(valid.begin(), valid.end());
    field["type"].fail("unknown type '" + type + "'" + nearest_names(type, valid) +
                       "; valid: " + comma_separated(valid));
  }
  required.insert(required.end(), keys->required.begin(), keys->required.end());
  optional.insert(optional.end(), keys->optional.begin(), keys->optional.end());
  field.check_keys(required, optional);
  return *keys;
}

// ------------------------------------------------------------------------------------------------
// targets
Eigen::Matrix3Xd matrix_of(const std::vector<double>& xyz) {
  return Eigen::Map<const Eigen::Matrix3Xd>(xyz.data(), 3, static_cast<int>(xyz.size() / 3));
}

/// Reads how a board lays out its points; of a type that is no list of points.
GridLayout read_layout(const Field& field, const std::string& type) {
  using Kind = GridLayout::Kind;
  static const std::map<std::string, Kind> kinds = {{"chessboard", Kind::corners},
                                                    {"charuco", Kind::charuco},
                                                    {"circles", Kind::circles},
                                                    {"apriltag_grid", Kind::tags}};
  GridLayout grid;
  grid.kind = kinds.at(type);
  const int least =
      grid.kind == Kind::charuco ? 2 : 1;  // its squares have inner corners only from 2 on
  grid.rows = field["rows"].integer(least, kMostRows);
  grid.columns = field["columns"].integer(least, kMostRows);
  if (grid.rows > kMostPoints / grid.columns)
    field["columns"].fail("a board of " + std::to_string(grid.rows) + " x " +
                          std::to_string(grid.columns) + "; at most " +
                          std::to_string(kMostPoints) + " in all are expected");
  grid.asymmetric =
      grid.kind == Kind::circles && field.has("asymmetric") && field["asymmetric"].boolean();
  if (grid.kind == Kind::tags) grid.gap = field["spacing"].number_at_least(0);
  return grid;
}

/// joint/NAME: a fixed joint that the link hangs on, with nothing that moves between.
int read_mount_joint(const Field& field, const Tree& tree, int link) {
  const std::string given = field.string();
  Names valid;
  int j = tree.joint_above[link];
  for (; j >= 0 && tree.joints[j].is_rigid(); j = tree.joint_above[tree.joints[j].parent]) {
    if (tree.joints[j].type != JointType::fixed) continue;  // it stands still
    valid.push_back("joint/" + tree.joints[j].name);
    if (valid.back() == given) return j;
  }
  field.fail("'" + given + "' is not a fixed joint that link '" + tree.links[link] +
             "' hangs on; valid: " +
             (valid.empty() ? "none" +
                                  (j < 0 ? ": the link is the robot's root"
                                         : ", for joint '" + tree.joints[j].name +
                                               "' above it is not fixed") +
                                  "; omit the key: the pose is then calibrated"
                            : comma_separated(valid)));
}

void read_mount(const Field& field, const Tree& tree, int base, Target& target) {
  if (field.node->kind == Node::Kind::scalar) {
    if (field.string() != "free")
      field.fail("'free' or {link, pose} is expected, not '" + field.string() + "'");
    return;
  }
  field.check_keys({"link"}, {"pose"});
  target.link = read_link(field["link"], tree);
  path_between(field["link"], tree, base, target.link);
  target.pose_given = field.has("pose");
  if (target.pose_given) target.link_T_target = field["pose"].pose();
}

/// The corners of a marker of size 1, clockwise from the upper left; x right and y up in it.
Eigen::Matrix3Xd marker_corners() {
  Eigen::Matrix3Xd corners(3, 4);
  corners << -1, 1, 1, -1, 1, 1, -1, -1, 0, 0, 0, 0;
  return 0.5 * corners;
}

Target read_target(const std::string& name, const Field& field, const Tree& tree, int base) {
  Target target;
  target.name = name;
  const TargetKeys& keys = read_keys(field, target_types(), {"type", "mount"}, {"mount_joint"});
  target.type = keys.name;
  const bool marker = target.type == "marker";
  const bool plane = target.type == "plane";
  target.grid = target.type != "points" && !plane;
  if (marker) {
    target.layout = marker_corners();
    target.y_up = true;
    field["id"].integer(0, kMostPoints);
    field["dictionary"].string();
  } else if (target.grid) {
    const GridLayout grid = read_layout(field, target.type);
    target.layout = grid_layout(grid);
    target.y_up = grid.kind == GridLayout::Kind::tags;  // as Kalibr counts them
  }
  if (target.grid) {
    target.square = field[keys.size].positive();
    if (field.has("warp")) {
      target.bulge = warp_shapes(target.layout);
      target.warp = Eigen::Map<const Eigen::Vector2d>(field["warp"].vector(2).data());
    }
    if (field.has("print"))
      target.print = Eigen::Map<const Eigen::Vector2d>(field["print"].vector(2).data());
  } else if (plane) {
    target.points = Eigen::Vector3d::Zero();  // it is z = 0: any point of it would do
  } else {
    target.points = matrix_of(field["points"].table(3));
    if (target.count() == 0) field["points"].fail("at least one point is expected");
  }
  if (field.has("origin") && field["origin"].string() != "large")
    field["origin"].fail("'large' is expected: the circle at point 0 is the bigger one");
  if (target.type == "charuco") {  // for the detection in images only
    field["marker"].positive();
    field["dictionary"].string();
  }
  if (target.type == "apriltag_grid") field["family"].string();
  if (field.has("first_id")) field["first_id"].integer(0, kMostPoints);
  read_mount(field["mount"], tree, base, target);
  if (!field.has("mount_joint")) return target;
  if (target.link < 0) field["mount_joint"].fail("a free target is not on a joint");
  target.mount_joint = read_mount_joint(field["mount_joint"], tree, target.link);
  target.pose_given = true;  // absent: the identity
  return target;
}

// ------------------------------------------------------------------------------------------------
// sensors
void read_camera(const Field& field, Sensor& sensor) {
  // The names of ROS's CameraInfo mean the same lenses.
  static const std::map<std::string, Lens> lenses = {{"pinhole", Lens::pinhole},
                                                     {"brown_conrady", Lens::brown_conrady},
                                                     {"plumb_bob", Lens::brown_conrady},
                                                     {"rational_polynomial", Lens::brown_conrady},
                                                     {"kannala_brandt", Lens::kannala_brandt},
                                                     {"equidistant", Lens::kannala_brandt},
                                                     {"fisheye", Lens::kannala_brandt},
                                                     {"unified", Lens::unified},
                                                     {"double_sphere", Lens::double_sphere}};
  const std::string model = field["model"].string();
  const auto lens = lenses.find(model);
  if (lens == lenses.end()) {
    Names names;
    for (const auto& one : lenses) names.push_back(one.first);
    field["model"].fail("unknown model '" + model + "'" + nearest_names(model, names) +
                        "; valid: pinhole (no distortion), brown_conrady (k1 k2 p1 p2 k3 "
                        "[k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]; ROS calls it plumb_bob, with 8 "
                        "numbers rational_polynomial), kannala_brandt (k1 k2 k3 k4; ROS calls it "
                        "equidistant, OpenCV fisheye), unified (xi k1 k2 p1 p2), double_sphere (xi "
                        "alpha)");
  }
  const std::vector<double> intrinsics = field["intrinsics"].vector(4);
  for (size_t i = 0; i < 2; ++i) field["intrinsics"].item(i).positive();
  const bool pinhole = lens->second == Lens::pinhole;
  const LensType& type = lens_type(lens->second);
  std::vector<double> distortion = type.plain;
  distortion.resize(model == "rational_polynomial" ? 8 : type.counts[0], 0.0);
  if (field.has("distortion")) {
    distortion = field["distortion"].vector();
    if (pinhole &&
        std::all_of(distortion.begin(), distortion.end(), [](double k) { return k == 0; }))
      distortion.clear();
  }
  try {
    sensor.model = make_camera(lens->second, static_cast<int>(distortion.size()));
  } catch (const std::invalid_argument& e) {
    field["distortion"].fail(model + ": " +
                             (pinhole ? "no distortion, or all 0, is expected" : e.what()));
  }
  const double baseline = field.has("baseline") ? field["baseline"].number() : 0;
  sensor.parameters = camera_parameters(lens->second, intrinsics, distortion, baseline);
  if (!field.has("image_size")) return;
  const Field size = field["image_size"];
  size.vector(2);
  sensor.image_width = size.item(0).integer(1, 1'000'000);
  sensor.image_height = size.item(1).integer(1, 1'000'000);
}

void read_range(const Field& field, Sensor& sensor) {
  const double scale = field.has("range_scale") ? field["range_scale"].positive() : 1;
  if (sensor.type == "pose") {
    sensor.model = make_scaled_pose();
    sensor.parameters = pose_scale(scale);
    return;
  }
  const double offset = field.has("range_offset") ? field["range_offset"].number() : 0;
  sensor.model = make_ranged_point();
  sensor.parameters = range_parameters(scale, offset);
}

void read_scanning_joint(const Field& field, const Tree& tree, const Path& path, int base,
                         Sensor& sensor) {
  const std::string name = field.string();
  Names scanning;
  for (const Joint& joint : tree.joints)
    if (joint.has_reading()) scanning.push_back(joint.name);
  sensor.scanning_joint = tree.find_joint(name);
  if (sensor.scanning_joint < 0)
    field.fail("unknown joint '" + name + "'" + nearest_or_all(name, scanning, "the robot has"));
  if (!tree.joints[sensor.scanning_joint].has_reading())
    field.fail("joint '" + name + "' has no reading of its own" + nearest_names(name, scanning));
  Names valid;
  for (const PathStep& step : path)
    if (tree.joints[step.joint].has_reading()) valid.push_back(tree.joints[step.joint].name);
  if (std::find(valid.begin(), valid.end(), name) == valid.end())
    field.fail("joint '" + name + "' is not between the base '" + tree.links[base] +
               "' and link '" + tree.links[sensor.link] +
               "'; valid: " + (valid.empty() ? "none" : comma_separated(valid)));
}

Sensor read_sensor(const std::string& name, const Field& field, const Tree& tree, int base) {
  Sensor sensor;
  sensor.name = name;
  const SensorKeys& keys =
      read_keys(field, sensor_types(), {"type", "link"}, {"pose", "mount", "topic", "time_offset"});
  sensor.type = keys.name;
  sensor.model = keys.make();
  sensor.link = read_link(field["link"], tree);
  const Path path = path_between(field["link"], tree, base, sensor.link);
  sensor.pose_given = field.has("pose");
  if (sensor.pose_given) sensor.link_T_sensor = field["pose"].pose();
  if (field.has("mount")) {
    sensor.mount_joint = read_mount_joint(field["mount"], tree, sensor.link);
    sensor.pose_given = true;  // absent: the identity
  }
  const Field sigma = field["sigma"];
  sensor.sigma = read_sigma(is_guess(sigma) ? sigma["guess"] : sigma, sensor);
  if (is_guess(sigma)) sensor.noise_guess = sensor.sigma;
  if (sensor.type == "camera") read_camera(field, sensor);
  if (field.has("range_scale") || field.has("range_offset")) read_range(field, sensor);
  if (sensor.model->scans()) read_scanning_joint(field["joint"], tree, path, base, sensor);
  read_times(field, sensor);
  return sensor;
}

// ------------------------------------------------------------------------------------------------
// steps
Loss read_loss(const Field& field) {
  static const std::map<std::string, LossKind> kinds = {{"huber", LossKind::huber},
                                                        {"soft_l1", LossKind::soft_l1},
                                                        {"cauchy", LossKind::cauchy},
                                                        {"tukey", LossKind::tukey}};
  Names names;
  for (const auto& kind : kinds) names.push_back(kind.first);
  const auto is_kind = [&](const auto& member) { return kinds.count(member.first) > 0; };
  if (field.node->kind != Node::Kind::mapping)
    field.fail("one of {" + comma_separated(names) + "} with its scale in sigmas is expected");
  Names keys = names;
  keys.push_back("scale");
  field.check_keys({}, keys);
  const auto& members = field.node->members;
  if (std::count_if(members.begin(), members.end(), is_kind) != 1)
    field.fail("one of {" + comma_separated(names) + "} with its scale in sigmas is expected");
  const std::string& name = std::find_if(members.begin(), members.end(), is_kind)->first;
  Loss loss{kinds.at(name), field[name].positive()};
  if (field.has("scale")) {
    const std::string unit = field["scale"].string();
    if (unit != "sigma" && unit != "data")
      field["scale"].fail("'sigma' or 'data' is expected, not '" + unit + "'");
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
    if (patterns.empty()) list.fail("the step uses no sensor; omit the key to use all");
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
  if (priors.node->kind != Node::Kind::mapping)
    priors.fail("a mapping of parameter names or globs to sigmas is expected");
  for (const auto& member : priors.node->members)
    step.priors.push_back(read_prior(member.first, priors[member.first]));
  return step;
}

std::vector<Step> read_steps(const Field& field, const Names& sensors) {
  std::vector<Step> steps;
  if (is_null(field)) return steps;
  if (field.node->kind != Node::Kind::sequence) field.fail("a list of steps is expected");
  for (size_t i = 0; i < field.size(); ++i) {
    steps.push_back(read_step(field.item(i), sensors));
    for (size_t k = 0; k < i; ++k)
      if (steps[k].name == steps[i].name)
        field.item(i)["step"].fail("a step '" + steps[i].name + "' is already above");
  }
  return steps;
}

/// Reads which model each joint has, before all else: it says what further keys the joint takes,
/// and may stand in a later entry.
void read_joint_models(const Field& field, const Tree& tree, const JointModels& models,
                       std::vector<JointSettings>& settings) {
  for (const auto& member : field.node->members) {
    const Field entry = field[member.first];
    if (entry.node->kind != Node::Kind::mapping || !entry.has("model")) continue;
    const std::string name = entry["model"].string();
    const std::shared_ptr<const JointModel> model = find_joint_model(models, name);
    if (!model) {
      Names valid;
      for (const auto& one : models) valid.push_back(one->name());
      entry["model"].fail("unknown joint model '" + name + "'" + nearest_names(name, valid) +
                          "; valid: " + comma_separated(valid));
    }
    for (int j : matching(entry, member.first, names_of(tree.joints))) settings[j].model = model;
  }
  for (JointSettings& joint : settings) joint.further = further_values(joint);
}

/// Reads the further numbers of a joint's model. Those of other models are errors.
void read_further(const Field& entry, const std::string& joint, const JointModels& models,
                  JointSettings& settings) {
  const std::vector<JointNumber> numbers = settings.model->extra_parameters();
  auto value = settings.further.begin();
  for (const JointNumber& number : numbers) {
    if (entry.has(number.name) && number.count == 1) *value = entry[number.name].number();
    if (entry.has(number.name) && number.count > 1)
      for (int i = 0; i < number.count; ++i) value[i] = entry[number.name].vector(number.count)[i];
    value += number.count;
  }
  for (const auto& model : models)
    for (const JointNumber& other : model->extra_parameters())
      if (entry.has(other.name) &&
          std::none_of(numbers.begin(), numbers.end(),
                       [&](const JointNumber& number) { return number.name == other.name; }))
        entry[other.name].fail("joint '" + joint + "' has the model " + settings.model->name() +
                               ", which has no '" + other.name + "'");
}

/// Of a floating joint: the noise of its reading, a pose.
void read_floating(const Field& entry, const Tree& tree, int joint,
                   std::vector<JointSettings>& settings) {
  for (const std::string& key : joint_keys({}))
    if (key != "sigma" && entry.has(key))
      entry[key].fail(
          "the reading of a floating joint is a pose; it has a sigma only: {sigma: "
          "{translation: 0.0001, rotation: 0.0002}}");
  if (!entry.has("sigma")) return;
  const bool guess = is_guess(entry["sigma"]);
  const Field sigma = guess ? entry["sigma"]["guess"] : entry["sigma"];
  sigma.check_keys({"translation", "rotation"});
  const int first = tree.joints[joint].first_axis + kPoseAxes;
  for (int k = 0; k < kPoseAxes; ++k) {
    settings[first + k].sigma = sigma[k < 3 ? "translation" : "rotation"].number_at_least(0);
    settings[first + k].noise_guess = guess ? settings[first + k].sigma : 0;
  }
}

/// `joints: {topic: /joint_states, prefix: left_}` says where recordings have readings, and what
/// stands before their names; a joint of that name has a mapping.
bool is_of_recordings(const Field& entry, const std::string& pattern) {
  if ((pattern != "topic" && pattern != "prefix") || entry.node->kind == Node::Kind::mapping)
    return false;
  if (pattern == "topic" && entry.node->kind == Node::Kind::sequence)
    entry.strings();
  else
    entry.string();
  return true;
}

}  // namespace

std::vector<JointSettings> read_joint_settings(const Field& field, const Tree& tree,
                                               const JointModels& models) {
  std::vector<JointSettings> settings(tree.joints.size());
  for (size_t j = 0; j < settings.size(); ++j)
    if (tree.joints[j].axis_of_pose == PoseAxis::error || tree.joints[j].has_reading())
      settings[j].noise_guess = guessed_noise(tree.joints[j]);
  if (is_null(field)) return settings;
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a mapping of joint names or globs is expected");
  const Names names = names_of(tree.joints), keys = joint_keys(models);
  read_joint_models(field, tree, models, settings);
  for (const auto& member : field.node->members) {
    const std::string& pattern = member.first;
    const Field entry = field[pattern];
    if (is_of_recordings(entry, pattern)) continue;
    entry.check_keys({}, keys);
    for (int j : matching(entry, pattern, names)) {
      const Joint& joint = tree.joints[j];
      if (joint.first_axis >= 0) {  // a glob means it where its sigma is that of a pose
        if (joint.name == pattern ||
            (entry.has("sigma") && entry["sigma"].node->find("translation")))
          read_floating(entry, tree, j, settings);
        continue;
      }
      if (!joint.has_reading()) {
        const std::string kind = joint.mimic                      ? "mimic"
                                 : joint.type == JointType::fixed ? "fixed"
                                                                  : "planar";
        if (joint.name == pattern) entry.fail("a " + kind + " joint has no reading of its own");
        continue;
      }
      if (entry.has("sigma")) {
        const Field sigma = entry["sigma"];
        const bool guess = is_guess(sigma);
        settings[j].sigma = guess ? sigma["guess"].positive() : sigma.number_at_least(0);
        settings[j].noise_guess = guess ? settings[j].sigma : 0;
      }
      if (entry.has("offset")) settings[j].offset = entry["offset"].number();
      if (entry.has("scale")) settings[j].scale = entry["scale"].number();
      if (settings[j].scale == 0) entry["scale"].fail("a scale is not 0");
      read_terms(entry, tree, j, settings[j].terms);
      read_further(entry, joint.name, models, settings[j]);
    }
  }
  return settings;
}

/// Sigmas for the automatic path.
std::vector<PriorSetting> read_priors(const Field& field, const Rig& rig) {
  std::vector<PriorSetting> out;
  if (is_null(field)) return out;
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a mapping of parameter names or globs to sigmas is expected");
  const ParameterTable table(rig);
  for (const auto& member : field.node->members) {
    out.push_back(read_prior(member.first, field[member.first]));
    table.find(member.first, out.back().where);
  }
  return out;
}

/// Written by an automatic calibration.
std::vector<NominalValue> read_nominal(const Field& field, const Rig& rig) {
  std::vector<NominalValue> out;
  if (is_null(field)) return out;
  if (field.node->kind != Node::Kind::mapping)
    field.fail("a mapping of parameter names to values is expected");
  const ParameterTable table(rig);
  for (const auto& member : field.node->members) {
    const Field value = field[member.first];
    const auto p = std::find_if(table.all.begin(), table.all.end(),
                                [&](const Parameter& q) { return q.name == member.first; });
    if (p == table.all.end())
      value.fail("there is no parameter '" + member.first + "'" +
                 nearest_names(member.first, table.names()));
    NominalValue nominal;
    nominal.parameter = member.first;
    const int origin = static_cast<int>(p - table.all.begin());
    if (p->kind == ParameterKind::joint_origin &&
        (std::count(table.sensor_mount.begin(), table.sensor_mount.end(), origin) ||
         std::count(table.target_mount.begin(), table.target_mount.end(), origin)))
      value.fail("a mount cannot have a nominal value; remove this entry");
    if (p->kind == ParameterKind::joint_origin) {
      nominal.pose = value.pose();
    } else if (p->pose) {
      value.fail("a mount cannot have a nominal value; remove this entry");
    } else {
      nominal.numbers = value.node->kind == Node::Kind::scalar ? std::vector<double>{value.number()}
                                                               : value.vector();
      if (static_cast<int>(nominal.numbers.size()) != p->size())
        value.fail(std::to_string(p->size()) + " numbers are expected");
      for (size_t c = 0; c < nominal.numbers.size(); ++c)
        if (const char* wrong = improper_value(*p, static_cast<int>(c), nominal.numbers[c]))
          value.fail(wrong);
    }
    out.push_back(std::move(nominal));
  }
  return out;
}

const Node kNoJoints;

namespace {

/// The rig of a text; `read_robot` reads the robot of its key `robot`, `replaced`: another one,
/// into which the joint offsets are folded.
RigFile read_rig_text(std::string text, const std::string& path, const JointModels& models,
                      const std::function<Urdf(const Field&)>& read_robot, bool replaced) {
  RigFile file;
  file.path = path;
  file.joint_models = models;
  file.text = std::move(text);
  refuse_other_kinds(file.text, path, Wanted::rig);
  file.node = parse_yaml(file.text, path);
  const Field all = top(file.node, path);
  all.check_keys({"format", "robot", "sensors", "targets"},
                 {"base", "joints", "estimate", "priors", "nominal", "serial", "time", "elasticity",
                  "payloads"});
  if (all["format"].string() != "kincal/1")
    all["format"].fail("'" + all["format"].string() + "' is not kincal/1");
  if (all.has("serial")) file.serial = all["serial"].string();
  if (all.has("time")) file.time = all["time"].string();
  const Field robot = all["robot"];
  file.flange_only = !replaced && robot.node->kind == Node::Kind::mapping;
  file.urdf = read_robot(robot);
  Rig& rig = file.rig;
  rig.tree = file.urdf.tree;
  rig.masses = file.urdf.masses;
  open_floating(rig.tree);
  if (file.flange_only)  // its origin is nothing that a file could hold: no parameter
    rig.tree.joints[rig.tree.find_joint(kFlangeJoint)].axis_of_pose = PoseAxis::reading;
  rig.base = all.has("base") ? read_link(all["base"], rig.tree) : rig.tree.root;
  rig.joints = read_joint_settings(
      all.has("joints") ? all["joints"] : Field{&kNoJoints, &path, "joints"}, rig.tree, models);
  if (replaced)
    for (JointSettings& joint : rig.joints) joint.offset = 0;
  const Field targets = all["targets"], sensors = all["sensors"];
  check_entries(targets, "targets");
  check_entries(sensors, "sensors");
  for (const auto& entry : targets.node->members)
    rig.targets.push_back(read_target(entry.first, targets[entry.first], rig.tree, rig.base));
  for (const auto& entry : sensors.node->members)
    rig.sensors.push_back(read_sensor(entry.first, sensors[entry.first], rig.tree, rig.base));
  if (all.has("joints")) check_terms_of_scanning(all["joints"], rig);
  if (all.has("payloads")) rig.payloads = read_payloads(all["payloads"], rig.tree);
  if (all.has("elasticity")) rig.elasticity = read_elasticity(all["elasticity"], rig);
  if (all.has("estimate")) rig.steps = read_steps(all["estimate"], names_of(rig.sensors));
  if (rig.steps.empty())  // poses are never exact; with steps a sigma that is not stated is 0
    for (JointSettings& joint : rig.joints)
      if (joint.noise_guess > 0 &&
          rig.tree.joints[&joint - rig.joints.data()].axis_of_pose == PoseAxis::error)
        joint.sigma = joint.noise_guess;
  if (all.has("priors")) rig.priors = read_priors(all["priors"], rig);
  if (all.has("nominal")) rig.nominal = read_nominal(all["nominal"], rig);
  return file;
}

}  // namespace

RigFile read_rig(const std::string& path, const std::string& urdf_path, const JointModels& models) {
  return read_rig_text(
      read_file(path), path, models,
      [&](const Field& robot) {
        return urdf_path.empty() ? read_robot_entry(robot, path) : read_urdf(urdf_path);
      },
      !urdf_path.empty());
}

RigFile parse_rig(std::string text, const std::string& path, const Urdf* robot,
                  const JointModels& models) {
  return read_rig_text(
      std::move(text), path, models,
      [&](const Field& entry) {
        if (!robot || entry.node->kind == Node::Kind::mapping) return read_robot_entry(entry, path);
        if (robot->text.empty()) entry.fail("the text of this URDF is needed, and there is none");
        return *robot;
      },
      false);
}

}  // namespace kincal
