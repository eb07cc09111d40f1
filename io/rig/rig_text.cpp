#include "rig_text.h"

#include <algorithm>
#include <typeinfo>

#include "../../kinematics/floating.h"
#include "../../models/rig/parameters.h"
#include "../document/error.h"
#include "../document/numbers.h"
#include "../document/yaml.h"
#include "elasticity_entry.h"
#include "types.h"

namespace kincal {
namespace {

// ------------------------------------------------------------------------------------------------
// nodes
Node number_node(double value) { return scalar_node(shortest(value)); }
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

/// The member `key` of a mapping, made null behind the members `after` (at the end if none is
/// there) if it is absent.
Node& member(Node& mapping, const std::string& key, const Names& after = {}) {
  size_t at = mapping.members.size(), behind = 0;
  for (size_t i = 0; i < mapping.members.size(); ++i) {
    if (mapping.members[i].first == key) return mapping.members[i].second;
    if (std::find(after.begin(), after.end(), mapping.members[i].first) != after.end())
      behind = i + 1;
  }
  if (behind > 0) at = behind;
  return mapping.members
      .insert(mapping.members.begin() + static_cast<std::ptrdiff_t>(at), {key, Node()})
      ->second;
}

void erase_member(Node& mapping, const std::string& key) {
  auto& members = mapping.members;
  members.erase(
      std::remove_if(members.begin(), members.end(), [&](const auto& m) { return m.first == key; }),
      members.end());
}

/// Numbers that changed into a list or a single number; the others keep their text.
void set_numbers(Node& mapping, const std::string& key, const std::vector<double>& old,
                 const std::vector<double>& now, bool single) {
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

// ------------------------------------------------------------------------------------------------
// parts of a rig
/// The pose that a sensor's or target's entry gives; none: it gives none.
template <class Thing>
std::optional<Pose> given_pose(const Thing& thing, const Pose& pose) {
  return thing.pose_given ? std::optional<Pose>(pose) : std::nullopt;
}

/// A changed or new translation and a changed rotation go into `pose` of a mapping; the rotation as
/// a quaternion, which reads back exactly enough.
void set_pose(Node& mapping, const std::optional<Pose>& old, const std::optional<Pose>& known) {
  if (!known) return;
  const Pose& now = *known;
  const bool moved = !old || old->translation != now.translation,
             turned = old.value_or(Pose()).rotation != now.rotation;
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

bool same(const JointSettings& a, const JointSettings& b) {
  return a.sigma == b.sigma && a.offset == b.offset && a.scale == b.scale && a.model == b.model &&
         a.further == b.further && a.terms == b.terms;
}

/// The terms of a joint, with those given that `now` does not set: they are zero.
JointTerms with_given(const JointTerms& given, JointTerms now) {
  if (!now.backlash) now.backlash = given.backlash;
  if (!now.temperature) now.temperature = given.temperature;
  if (now.ripple.empty()) now.ripple = given.ripple;
  if (!now.coupling.empty()) return now;
  now.coupled_to = given.coupled_to;
  now.coupling = given.coupling;
  return now;
}

/// The terms that differ from those given.
void set_terms(Node& entry, const Tree& tree, const JointTerms& given, const JointTerms& now) {
  const auto list = [](const std::vector<double>& values) {
    return list_node(values.data(), static_cast<int>(values.size()));
  };
  if (now.backlash && given.backlash != now.backlash)
    member(entry, "backlash") = number_node(*now.backlash);
  if (now.temperature && given.temperature != now.temperature)
    member(entry, "temperature") = number_node(*now.temperature);
  if (given.gear_ratios != now.gear_ratios) member(entry, "gear_ratio") = list(now.gear_ratios);
  if (!now.ripple.empty() && given.ripple != now.ripple) member(entry, "ripple") = list(now.ripple);
  if (now.coupling.empty() ||
      (given.coupling == now.coupling && given.coupled_to == now.coupled_to))
    return;
  Node& coupling = member(entry, "coupling");
  coupling = mapping_node();
  for (size_t k = 0; k < now.coupling.size(); ++k)
    member(coupling, tree.joints[now.coupled_to[k]].name) = number_node(now.coupling[k]);
}

/// Another model, and those of its numbers that changed.
void set_model(Node& entry, const JointSettings& given, const JointSettings& now) {
  const bool other = given.model != now.model;
  if (other) member(entry, "model") = text_node(now.model->name());
  size_t k = 0;
  for (const JointNumber& number : now.model->extra_parameters()) {
    const double* values = now.further.data() + k;
    if (other || !std::equal(values, values + number.count, given.further.data() + k))
      member(entry, number.name) =
          number.count == 1 ? number_node(*values) : list_node(values, number.count);
    k += number.count;
  }
}

/// What changed of one joint into its own entry.
void set_joint(Node& entry, const Tree& tree, const JointSettings& given,
               const JointSettings& now) {
  if (entry.kind != Node::Kind::mapping) entry = mapping_node();
  if (given.sigma != now.sigma) member(entry, "sigma") = number_node(now.sigma);
  if (given.offset != now.offset) member(entry, "offset") = number_node(now.offset);
  if (given.scale != now.scale) member(entry, "scale") = number_node(now.scale);
  set_terms(entry, tree, given.terms, now.terms);
  set_model(entry, given, now);
}

/// All that a joint has, so that it wins behind all globs. `named`: with the name of its model.
Node joint_node(const Tree& tree, const JointSettings& settings, bool named) {
  Node node = mapping_node();
  member(node, "sigma") = number_node(settings.sigma);
  member(node, "offset") = number_node(settings.offset);
  member(node, "scale") = number_node(settings.scale);
  const JointSettings plain;
  set_terms(node, tree, plain.terms, settings.terms);
  if (named) member(node, "model") = text_node(settings.model->name());
  if (named || settings.model != plain.model) set_model(node, plain, settings);
  return node;
}

/// The noise of a floating joint's pose; `axis` is one of its errors.
void set_floating_sigma(Node& joints, const Tree& tree, int axis, double sigma) {
  if (joints.kind != Node::Kind::mapping) joints = mapping_node();
  Node& entry = member(joints, read_name(tree, axis));
  if (entry.kind != Node::Kind::mapping) entry = mapping_node();
  Node& node = member(entry, "sigma");
  if (node.kind != Node::Kind::mapping || node.find("guess")) {
    node = mapping_node();
    for (const char* part : {"translation", "rotation"}) member(node, part) = number_node(0);
  }
  member(node, tree.joints[axis].type == JointType::prismatic ? "translation" : "rotation") =
      number_node(sigma);
}

/// First each joint's own entry is changed or appended. If a later glob still wins over it, it
/// moves to the end; so it does at once with another model, for its numbers are wrong keys where a
/// glob takes the model back.
void set_joints(Node& root, const RigFile& rig, const RigValues& values) {
  const Tree& tree = rig.rig.tree;
  const bool had_joints = root.find("joints") != nullptr;
  Node& joints = member(root, "joints", {"robot", "base"});
  for (const bool move : {false, true}) {
    const std::vector<JointSettings> given =
        read_joint_settings({&joints, &rig.path, "joints"}, tree, rig.joint_models);
    for (size_t j = 0; j < tree.joints.size(); ++j) {
      const double sigma = values.joint_sigmas[j];
      const bool as_guessed = sigma > 0 && sigma == given[j].noise_guess;
      const JointSettings now = {as_guessed ? given[j].sigma : sigma,
                                 values.joint_offsets[j],
                                 values.joint_scales[j],
                                 values.joint_models[j],
                                 values.joint_further[j],
                                 0,
                                 with_given(given[j].terms, values.joint_terms[j])};
      const std::string& name = tree.joints[j].name;
      if (tree.joints[j].axis_of_pose == PoseAxis::error && given[j].sigma != now.sigma)
        set_floating_sigma(joints, tree, static_cast<int>(j), now.sigma);
      if (!tree.joints[j].has_reading() || same(given[j], now)) continue;
      if (joints.kind != Node::Kind::mapping) joints = mapping_node();
      const bool other = given[j].model != now.model;
      if (other && find_joint_model(rig.joint_models, now.model->name()) != now.model)
        throw InputError(
            rig.path + ": joints." + name +
            ": has a joint model that a rig cannot name: its parameters cannot be written");
      if (move || other) {
        const Node* own = joints.find(name);
        const bool named = other || (own && own->find("model"));
        erase_member(joints, name);
        member(joints, name) = joint_node(tree, now, named);
      } else {
        set_joint(member(joints, name), tree, given[j], now);
      }
    }
  }
  if (!had_joints && joints.kind == Node::Kind::null) erase_member(root, "joints");
}

/// Inverse of read_sigma.
void set_sigma(Node& node, const Sensor& sensor, const std::vector<double>& sigma) {
  if (sigma == sensor.sigma) return;
  const Names names = sigma_names(sensor);
  const size_t stride = names.empty() ? 1 : sigma.size() / names.size();
  Node& written = member(node, "sigma");
  if (written.find("guess")) written = names.empty() ? number_node(sigma[0]) : mapping_node();
  if (names.empty() && written.kind != Node::Kind::sequence) written = number_node(sigma[0]);
  if (names.empty() && written.kind == Node::Kind::sequence)
    written = list_node(sigma.data(), static_cast<int>(sigma.size()));
  for (size_t i = 0; i < names.size(); ++i)
    if (!written.find(names[i]) || sigma[i * stride] != sensor.sigma[i * stride])
      member(written, names[i]) = number_node(sigma[i * stride]);
}

void set_sensor(Node& node, const Sensor& sensor, const std::optional<Pose>& pose,
                const std::vector<double>& sigma,
                const std::vector<std::vector<double>>& parameters) {
  set_pose(node, given_pose(sensor, sensor.link_T_sensor), pose);
  set_sigma(node, sensor, sigma);
  for (size_t b = 0; b < sensor.parameters.size(); ++b) {
    const ParameterBlock& block = sensor.parameters[b];
    set_numbers(node, block.name, block.values, parameters[b],
                block.components.size() == 1 && block.components[0].empty());
  }
}

void set_target(Node& node, const Target& target, const std::optional<Pose>& pose, double square,
                const Eigen::Matrix3Xd& points) {
  if (target.link >= 0)
    set_pose(member(node, "mount"), given_pose(target, target.link_T_target), pose);
  if (target.grid) {
    if (square != target.square)
      member(node, find_type(target_types(), target.type)->size) = number_node(square);
    return;
  }
  for (int i = 0; i < target.count(); ++i)
    for (int k = 0; k < 3; ++k)
      if (points(k, i) != target.points(k, i))
        member(node, "points").items[i].items[k] = number_node(points(k, i));
}

}  // namespace

RigValues values_of(const Rig& rig) {
  RigValues values;
  for (const JointSettings& joint : rig.joints) {
    values.joint_offsets.push_back(joint.offset);
    values.joint_scales.push_back(joint.scale);
    values.joint_sigmas.push_back(joint.sigma);
    values.joint_models.push_back(joint.model);
    values.joint_further.push_back(further_values(joint));
    values.joint_terms.push_back(joint.terms);
  }
  for (const Sensor& sensor : rig.sensors) {
    values.sensor_poses.push_back(given_pose(sensor, sensor.link_T_sensor));
    values.sensor_sigmas.push_back(sensor.sigma);
    values.sensor_time_offsets.push_back(sensor.time_offset);
    values.sensor_line_times.push_back(sensor.line_time);
    values.sensor_parameters.emplace_back();
    for (const ParameterBlock& block : sensor.parameters)
      values.sensor_parameters.back().push_back(block.values);
  }
  for (const Target& target : rig.targets) {
    values.target_poses.push_back(given_pose(target, target.link_T_target));
    values.target_squares.push_back(target.square);
    values.target_warps.push_back(target.warp);
    values.target_prints.push_back(target.print);
    values.target_points.push_back(target.points);
  }
  return values;
}

void set_nominal(RigFile& rig, const std::vector<NominalValue>& values) {
  rig.rig.nominal = values;
  Node nominal = mapping_node();
  for (const NominalValue& value : values) {
    Node& node = member(nominal, value.parameter);
    if (!value.numbers.empty()) {
      node = list_node(value.numbers.data(), static_cast<int>(value.numbers.size()));
      continue;
    }
    node = mapping_node();
    const Eigen::Vector4d q = quaternion_from_rotation(value.pose.rotation);
    member(node, "xyz") = list_node(value.pose.translation.data(), 3);
    member(node, "quat") = list_node(q.data(), 4);
  }
  member(rig.node, "nominal") = nominal;
}

void add_priors(RigFile& rig, const std::vector<PriorSetting>& priors) {
  for (const PriorSetting& prior : priors) {
    Node& all = member(rig.node, "priors");
    if (all.kind != Node::Kind::mapping) all = mapping_node();
    erase_member(all, prior.pattern);
    member(all, prior.pattern) = number_node(prior.translation);
    rig.rig.priors.push_back(prior);
  }
}

void set_lens(RigFile& rig, int camera, const std::string& model, const Sensor& found) {
  Sensor& sensor = rig.rig.sensors[camera];
  Node& node = member(member(rig.node, "sensors"), sensor.name);
  const SensorModel &before = *sensor.model, &now = *found.model;
  if (typeid(before) != typeid(now)) {  // else the rig's own word for it stays
    member(node, "model") = text_node(model);
    erase_member(node, "distortion");
  }
  for (const ParameterBlock& block : found.parameters) {
    if (block.name == "baseline") continue;
    member(node, block.name, {"model", "image_size", "intrinsics"}) =
        list_node(block.values.data(), static_cast<int>(block.values.size()));
  }
  sensor.model = found.model;
  sensor.parameters = found.parameters;
}

std::string rig_text(const RigFile& rig, const RigValues& values, const std::string& robot) {
  Node root = rig.node;
  if (!rig.flange_only) member(root, "robot") = text_node(robot);
  set_joints(root, rig, values);
  for (size_t s = 0; s < rig.rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.rig.sensors[s];
    Node& node = member(member(root, "sensors"), sensor.name);
    set_sensor(node, sensor, values.sensor_poses[s], values.sensor_sigmas[s],
               values.sensor_parameters[s]);
    const auto set = [&](const char* key, std::optional<double> given, std::optional<double> now) {
      if (now && !(node.find(key) && given == now)) member(node, key) = number_node(*now);
    };
    set("time_offset", sensor.time_offset, values.sensor_time_offsets[s]);
    set("line_time", sensor.line_time, values.sensor_line_times[s]);
  }
  for (size_t t = 0; t < rig.rig.targets.size(); ++t) {
    const Target& target = rig.rig.targets[t];
    Node& node = member(member(root, "targets"), target.name);
    set_target(node, target, values.target_poses[t], values.target_squares[t],
               values.target_points[t]);
    if (target.warp != values.target_warps[t])
      member(node, "warp") = list_node(values.target_warps[t].data(), 2);
    if (values.target_prints[t] && target.print != values.target_prints[t])
      member(node, "print") = list_node(values.target_prints[t]->data(), 2);
  }
  if (values.elasticity)
    member(root, "elasticity", {"joints"}) = elasticity_node(*values.elasticity, rig.rig.tree);
  return to_yaml(root);
}

}  // namespace kincal
