#include "parameters.h"

#include <algorithm>
#include <cmath>

#include "numbers.h"
#include "words.h"

namespace kincal {
namespace {

const std::vector<std::string> kPoseComponents = {"x", "y", "z", "rx", "ry", "rz"};
const std::vector<std::string> kPoseUnits = {"m", "m", "m", "rad", "rad", "rad"};

/// What a sensor's own block is, by the name that the sensor gives it.
ParameterKind kind_of_block(const std::string& name) {
  if (name == "intrinsics") return ParameterKind::intrinsics;
  if (name == "distortion") return ParameterKind::distortion;
  if (name == "baseline") return ParameterKind::baseline;
  if (name == "range_scale") return ParameterKind::range_scale;
  if (name == "range_offset") return ParameterKind::range_offset;
  return ParameterKind::own_number;
}

/// Names of a joint number's components.
std::vector<std::string> names_of(const JointNumber& number) {
  std::vector<std::string> out(number.count);
  for (int i = 0; number.count > 1 && i < number.count; ++i) out[i] = std::to_string(i);
  return out;
}

/// Adds the parameters of a joint's model beyond offset and scale. `add` is that of the table.
template <class Add>
void add_further(const JointSettings& settings, size_t joint, const std::string& prefix,
                 const Add& add, std::vector<Parameter>& all) {
  const std::vector<double> further = further_values(settings);
  auto value = further.begin();
  for (const JointNumber& n : settings.model->extra_parameters()) {
    Parameter& p = all[add(ParameterKind::joint_shape, joint, prefix + n.name, names_of(n),
                           std::vector<std::string>(n.count, n.unit), {value, value + n.count})];
    value += n.count;
    p.usual_error = n.usual_error;
    p.yardstick = n.yardstick;
  }
}

/// Adds the parameters of a joint's terms in addition to its model. `add` is that of the table.
template <class Add>
void add_terms(const Rig& rig, size_t joint, const std::string& prefix, const Add& add) {
  const JointTerms& terms = rig.joints[joint].terms;
  const std::string unit = rig.tree.joints[joint].type == JointType::prismatic ? "m" : "rad";
  if (terms.backlash)
    add(ParameterKind::backlash, joint, prefix + "backlash", {""}, {unit}, {*terms.backlash});
  if (terms.temperature)
    add(ParameterKind::temperature, joint, prefix + "temperature", {""}, {unit + "/K"},
        {*terms.temperature});
  std::vector<std::string> parts;
  for (size_t k = 0; k < terms.ripple.size(); ++k)
    parts.push_back(text(k % 2 == 0 ? "cos%.12g" : "sin%.12g",
                         (k % kRipple < 2 ? 1 : 2) * terms.gear_ratios[k / kRipple]));
  if (!terms.ripple.empty())
    add(ParameterKind::ripple, joint, prefix + "ripple", parts,
        std::vector<std::string>(parts.size(), unit), terms.ripple);
  parts.clear();
  for (size_t k = 0; k < terms.coupling.size(); ++k)
    parts.push_back(rig.tree.joints[terms.coupled_to[k]].name);
  if (!terms.coupling.empty())
    add(ParameterKind::coupling, joint, prefix + "coupling", parts,
        std::vector<std::string>(parts.size(), ""), terms.coupling);
}

/// Adds compliances and loads where joints bend. `add` is that of the table.
template <class Add>
void add_elasticity(const Rig& rig, const Add& add, std::vector<int>& compliance,
                    std::vector<int>& load) {
  compliance.assign(rig.tree.joints.size(), -1);
  load = compliance;
  const auto numbers = [](const Vector3d& v) {
    return std::vector<double>(v.data(), v.data() + 3);
  };
  for (size_t j = 0; rig.elasticity && j < load.size(); ++j) {
    const Joint& joint = rig.tree.joints[j];
    if (rig.elasticity->skeleton->index[j] >= 0)
      compliance[j] = add(ParameterKind::compliance, j, "joint/" + joint.name + "/compliance",
                          {"axis", "u", "v"}, {"rad/Nm", "rad/Nm", "rad/Nm"},
                          numbers(rig.elasticity->compliance[j]));
    if (joint.moves())
      load[j] = add(ParameterKind::load, j, "link/" + rig.tree.links[joint.child] + "/load",
                    {"x", "y", "z"}, {"kg m", "kg m", "kg m"}, numbers(rig.elasticity->load[j]));
  }
}

/// Adds the points of a target that is not a grid.
template <class Add>
int add_points(const Target& target, size_t t, const std::string& prefix, const Add& add) {
  std::vector<std::string> components;
  for (int i = 0; i < target.count(); ++i)
    for (const char* c : {".x", ".y", ".z"}) components.push_back(std::to_string(i) + c);
  std::vector<std::string> units(components.size(), "m");
  return add(ParameterKind::points, t, prefix + "points", std::move(components), std::move(units),
             {target.points.data(), target.points.data() + target.points.size()});
}

}  // namespace

std::vector<double> further_values(const JointSettings& joint) {
  std::vector<double> out;
  for (const JointNumber& number : joint.model->extra_parameters())
    out.insert(out.end(), number.count, number.value);
  std::copy_n(joint.further.begin(), std::min(joint.further.size(), out.size()), out.begin());
  return out;
}

JointTerms terms_at(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                    int joint) {
  JointTerms out = rig.joints[joint].terms;
  for (int p = table.joint_offset[joint]; p >= 0 && p < table.joint_origin[joint]; ++p) {
    const double* from = values.data() + table.all[p].start;
    const std::vector<double> all(from, from + table.all[p].size());
    switch (table.all[p].kind) {
      case ParameterKind::backlash:
        out.backlash = all[0];
        break;
      case ParameterKind::temperature:
        out.temperature = all[0];
        break;
      case ParameterKind::ripple:
        out.ripple = all;
        break;
      case ParameterKind::coupling:
        out.coupling = all;
        break;
      default:
        break;
    }
  }
  return out;
}

const ParameterBlock* find_block(const Sensor& sensor, ParameterKind kind) {
  for (const ParameterBlock& block : sensor.parameters)
    if (kind_of_block(block.name) == kind) return &block;
  return nullptr;
}

bool ParameterTable::has(ParameterKind kind) const {
  return std::any_of(all.begin(), all.end(), [&](const Parameter& p) { return p.kind == kind; });
}

int ParameterTable::index_of(ParameterKind kind, int owner) const {
  for (size_t p = 0; p < all.size(); ++p)
    if (all[p].kind == kind && all[p].owner == owner) return static_cast<int>(p);
  return -1;
}

Pose get_pose(const VectorXd& values, int start) {
  return {Eigen::Map<const Matrix3d>(values.data() + start),
          Eigen::Map<const Vector3d>(values.data() + start + 9)};
}

void set_pose(VectorXd& values, int start, const Pose& pose) {
  Eigen::Map<Matrix3d>(values.data() + start) = pose.rotation;
  Eigen::Map<Vector3d>(values.data() + start + 9) = pose.translation;
}

ParameterTable::ParameterTable(const Rig& rig)
    : tree_(rig.tree), has_pose_(rig.tree.links.size(), 0) {
  std::vector<double> values;
  const auto add = [&](ParameterKind kind, size_t owner, const std::string& name,
                       std::vector<std::string> components, std::vector<std::string> units,
                       const std::vector<double>& v) {
    all.push_back({name, std::move(components), std::move(units), false,
                   static_cast<int>(values.size()), kind, static_cast<int>(owner)});
    values.insert(values.end(), v.begin(), v.end());
    return static_cast<int>(all.size()) - 1;
  };
  const auto add_pose = [&](ParameterKind kind, size_t owner, const std::string& name,
                            const Pose& pose) {
    all.push_back({name, kPoseComponents, kPoseUnits, true, static_cast<int>(values.size()), kind,
                   static_cast<int>(owner)});
    values.insert(values.end(), pose.rotation.data(), pose.rotation.data() + 9);
    values.insert(values.end(), pose.translation.data(), pose.translation.data() + 3);
    return static_cast<int>(all.size()) - 1;
  };
  const size_t joints = rig.tree.joints.size();
  joint_offset.assign(joints, -1);
  joint_scale.assign(joints, -1);
  joint_origin.assign(joints, -1);
  for (size_t j = 0; j < joints; ++j) {
    const Joint& joint = rig.tree.joints[j];
    const std::string prefix = "joint/" + joint.name + "/",
                      unit = joint.type == JointType::prismatic ? "m" : "rad";
    if (joint.drives()) {
      const JointSettings& settings = rig.joints[j];
      joint_offset[j] =
          add(ParameterKind::joint_offset, j, prefix + "offset", {""}, {unit}, {settings.offset});
      joint_scale[j] =
          add(ParameterKind::joint_scale, j, prefix + "scale", {""}, {""}, {settings.scale});
      add_further(settings, j, prefix, add, all);
      add_terms(rig, j, prefix, add);
    }
    joint_origin[j] =
        add_pose(ParameterKind::joint_origin, j, prefix + "origin", joint.parent_T_joint);
    if (joint.axis_of_pose != PoseAxis::none)
      for (int p : {joint_offset[j], joint_scale[j], joint_origin[j]})
        if (p >= 0) all[p].name.clear();
  }
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    const std::string prefix = "sensor/" + sensor.name + "/";
    sensor_pose.push_back(
        add_pose(ParameterKind::sensor_pose, s, prefix + "pose", sensor.link_T_sensor));
    if (sensor.pose_of >= 0)
      sensor_pose[s] = all[sensor_pose[s]].replaced_by = sensor_pose[sensor.pose_of];
    sensor_block.push_back(sensor.parameters.empty() ? -1 : static_cast<int>(all.size()));
    for (const ParameterBlock& b : sensor.parameters)
      add(kind_of_block(b.name), s, prefix + b.name, b.components, b.units, b.values);
    time_offset.push_back(sensor.time_offset
                              ? add(ParameterKind::time_offset, s, prefix + "time_offset", {""},
                                    {"s"}, {*sensor.time_offset})
                              : -1);
    line_time.push_back(sensor.line_time ? add(ParameterKind::line_time, s, prefix + "line_time",
                                               {""}, {"s"}, {*sensor.line_time})
                                         : -1);
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const Target& target = rig.targets[t];
    const std::string prefix = "target/" + target.name + "/";
    target_pose.push_back(target.link >= 0 ? add_pose(ParameterKind::target_pose, t,
                                                      prefix + "pose", target.link_T_target)
                                           : -1);
    target_square.push_back(
        target.grid ? add(ParameterKind::square, t, prefix + "square", {""}, {"m"}, {target.square})
                    : -1);
    target_warp.push_back(target.grid && target.bulge.cols() > 0
                              ? add(ParameterKind::warp, t, prefix + "warp", {"x", "y"}, {"m", "m"},
                                    {target.warp.x(), target.warp.y()})
                              : -1);
    target_print.push_back(target.grid && target.print
                               ? add(ParameterKind::print, t, prefix + "print",
                                     {"stretch", "shear"}, {"", ""},
                                     {target.print->x(), target.print->y()})
                               : -1);
    target_points.push_back(target.grid ? -1 : add_points(target, t, prefix, add));
  }
  add_elasticity(rig, add, compliance, load);
  const auto mount = [&](int pose, int joint) {
    if (pose < 0 || joint < 0) return pose;
    return all[pose].replaced_by = joint_origin[joint];
  };
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    sensor_mount.push_back(mount(sensor_pose[s], rig.sensors[s].mount_joint));
  for (size_t t = 0; t < rig.targets.size(); ++t)
    target_mount.push_back(mount(target_pose[t], rig.targets[t].mount_joint));
  for (const Sensor& sensor : rig.sensors) has_pose_[sensor.link] = 1;
  for (const Target& target : rig.targets)
    if (target.link >= 0) has_pose_[target.link] = 1;
  initial = Eigen::Map<VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

Rig centred(Rig rig) {
  const ParameterTable table(rig);
  for (const NominalValue& nominal : rig.nominal)
    for (const Parameter& p : table.all) {
      if (p.name != nominal.parameter) continue;
      switch (p.kind) {
        case ParameterKind::joint_origin:
          rig.tree.joints[p.owner].parent_T_joint = nominal.pose;
          break;
        case ParameterKind::joint_scale:
          rig.joints[p.owner].scale = nominal.numbers[0];
          break;
        case ParameterKind::joint_shape: {
          JointSettings& joint = rig.joints[p.owner];
          joint.further = further_values(joint);
          const int first = table.all[table.joint_offset[p.owner] + 2].start;
          std::copy(nominal.numbers.begin(), nominal.numbers.end(),
                    joint.further.begin() + (p.start - first));
          break;
        }
        case ParameterKind::backlash:
          rig.joints[p.owner].terms.backlash = nominal.numbers[0];
          break;
        case ParameterKind::temperature:
          rig.joints[p.owner].terms.temperature = nominal.numbers[0];
          break;
        case ParameterKind::ripple:
          rig.joints[p.owner].terms.ripple = nominal.numbers;
          break;
        case ParameterKind::coupling:
          rig.joints[p.owner].terms.coupling = nominal.numbers;
          break;
        case ParameterKind::time_offset:
          rig.sensors[p.owner].time_offset = nominal.numbers[0];
          break;
        case ParameterKind::line_time:
          rig.sensors[p.owner].line_time = nominal.numbers[0];
          break;
        case ParameterKind::compliance:
        case ParameterKind::load:
          if (rig.elasticity)
            (p.kind == ParameterKind::load ? rig.elasticity->load
                                           : rig.elasticity->compliance)[p.owner] =
                Eigen::Map<const Vector3d>(nominal.numbers.data());
          break;
        case ParameterKind::square:
          rig.targets[p.owner].square = nominal.numbers[0];
          break;
        case ParameterKind::print:
          rig.targets[p.owner].print = Eigen::Map<const Eigen::Vector2d>(nominal.numbers.data());
          break;
        case ParameterKind::intrinsics:
        case ParameterKind::distortion:
        case ParameterKind::baseline:
        case ParameterKind::range_scale:
        case ParameterKind::range_offset:
          for (ParameterBlock& block : rig.sensors[p.owner].parameters)
            if ("sensor/" + rig.sensors[p.owner].name + "/" + block.name == p.name)
              block.values = nominal.numbers;
          break;
        default:
          break;
      }
    }
  rig.nominal.clear();
  return rig;
}

const char* improper_value(const Parameter& parameter, int component, double value) {
  const std::string& part = parameter.components[component];
  if (!std::isfinite(value)) return "a finite number is expected";
  if (parameter.kind == ParameterKind::joint_scale && value == 0) return "a scale is not 0";
  if (parameter.kind == ParameterKind::range_scale && value <= 0)
    return "a number greater than 0 is expected";
  if ((parameter.kind == ParameterKind::square || part == "fx" || part == "fy") && value <= 0)
    return "a number greater than 0 is expected";
  return nullptr;
}

}  // namespace kincal
