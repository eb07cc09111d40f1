#include "compensation_texts.h"

#include <algorithm>
#include <cctype>
#include <set>
#include <stdexcept>

#include "../../kinematics/bending.h"
#include "../../models/joints/curve_joint.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/elasticity.h"
#include "../../models/rig/numbers.h"
#include "../../models/rig/words.h"
#include "../results/json_values.h"
#include "compensation_code.h"

namespace kincal {
namespace {

std::set<int> joints_above(const Tree& tree, int link) {
  std::set<int> out;
  for (int j = tree.joint_above[link]; j >= 0; j = tree.joint_above[tree.joints[j].parent])
    out.insert(j);
  return out;
}

/// The joints that a pose of the tip depends on: those above it and the base, and what these carry
/// where they bend.
std::set<int> needed_joints(const RobotTip& of) {
  const Tree& tree = of.robot.rig->tree;
  std::set<int> out = joints_above(tree, of.tip.link);
  const std::set<int> base = joints_above(tree, of.from.link);
  out.insert(base.begin(), base.end());
  if (!of.robot.rig->elasticity) return out;
  const std::set<int> path = out;
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    const std::set<int> above = joints_above(tree, tree.joints[j].child);
    if (std::any_of(above.begin(), above.end(), [&](int i) { return path.count(i) > 0; }))
      out.insert(above.begin(), above.end());
  }
  return out;
}

FlatJoint flat_joint(const RobotTip& of, int j, const std::vector<int>& readings) {
  const Rig& rig = *of.robot.rig;
  const ParameterTable& table = *of.robot.table;
  const VectorXd& values = of.robot.values;
  const Joint& joint = rig.tree.joints[j];
  FlatJoint out;
  out.name = joint.name;
  out.origin = get_pose(values, table.all[table.joint_origin[j]].start);
  if (joint.is_rigid()) {
    out.origin = out.origin * joint_motion(joint, 0);
    return out;
  }
  if (!joint.moves() || joint.axis_of_pose != PoseAxis::none)
    throw std::invalid_argument("joint '" + joint.name +
                                "' has no single axis: only joints that turn or slide can be "
                                "written");
  out.type = joint.type == JointType::prismatic ? 2 : 1;
  out.axis = joint.axis;
  const Driver d = driver(rig.tree, j);
  out.factor = d.factor;
  out.shift = d.offset;
  out.reading =
      static_cast<int>(std::find(readings.begin(), readings.end(), d.joint) - readings.begin());
  const double* own = values.data() + table.all[table.joint_offset[d.joint]].start;
  const JointModel& model = *rig.joints[d.joint].model;
  out.offset = own[0];
  out.scale = own[1];
  const JointTerms terms = terms_at(rig, table, values, d.joint);
  out.temperature = terms.temperature.value_or(0);
  for (size_t k = 0; k < terms.ripple.size(); ++k) {
    if (k % kRipple == 0) out.ripple.push_back(terms.gear_ratios[k / kRipple]);
    out.ripple.push_back(terms.ripple[k]);
  }
  for (size_t k = 0; k < terms.coupling.size(); ++k)
    out.coupled_to.push_back(static_cast<int>(
        std::find(readings.begin(), readings.end(), terms.coupled_to[k]) - readings.begin()));
  out.coupling = terms.coupling;
  if (model.name() == "curve")
    out.curve.assign(own + 2, own + 2 + CurveJoint::kValues);
  else if (model.size() != 2)
    throw std::invalid_argument("joint '" + rig.tree.joints[d.joint].name + "' has the model '" +
                                model.name() + "': only linear ones and curves can be written");
  return out;
}

FlatRobot flat_robot(const RobotTip& of, const std::set<int>& joints,
                     const std::vector<int>& readings) {
  const Rig& rig = *of.robot.rig;
  const Tree& tree = rig.tree;
  std::vector<char> bends(tree.joints.size(), 0);
  BentPosture bent;
  const Skeleton* skeleton = rig.elasticity ? rig.elasticity->skeleton.get() : nullptr;
  FlatRobot out;
  if (skeleton) {
    bent.resize(*skeleton);
    set_elasticity(rig, *of.robot.table, of.robot.values, of.conditions.payload, bent);
    out.gravity = bent.gravity;
    out.rotor = bent.rotor;
  }
  std::vector<int> place(tree.joints.size(), -1);
  for (const int j : Skeleton(tree, bends).order) {
    if (!joints.count(j)) continue;
    place[j] = static_cast<int>(out.joints.size());
    FlatJoint one = flat_joint(of, j, readings);
    const int above = tree.joint_above[tree.joints[j].parent];
    one.above = above < 0 ? -1 : place[above];
    if (const int i = skeleton ? skeleton->index[j] : -1; i >= 0) {
      one.bends = true;
      one.basis = skeleton->basis[i];
      one.compliance = bent.compliance[j];
    }
    if (skeleton) one.load = bent.load[j];
    out.joints.push_back(std::move(one));
  }
  const auto below = [&](int link) {
    const int j = tree.joint_above[link];
    return j < 0 ? -1 : place[j];
  };
  const auto pose_of = [&](const Frame& frame) {
    return frame.pose < 0 ? Pose()
                          : get_pose(of.robot.values, of.robot.table->all[frame.pose].start);
  };
  out.base = below(of.from.link);
  out.tip = below(of.tip.link);
  out.base_frame = pose_of(of.from);
  out.tip_frame = pose_of(of.tip);
  return out;
}

Json matrix_json(const Matrix3d& m) {
  Json out = Json::array();
  for (int i = 0; i < 3; ++i) out.push_back(vector3(m.row(i).transpose()));
  return out;
}

Json flat_pose_json(const Pose& p) {
  return {{"xyz", vector3(p.translation)}, {"rotation", matrix_json(p.rotation)}};
}

Json flat_json(const FlatRobot& robot) {
  Json joints = Json::array();
  for (const FlatJoint& j : robot.joints) {
    Json one = {{"name", j.name},
                {"above", j.above},
                {"type", j.type == 0   ? "fixed"
                         : j.type == 1 ? "revolute"
                                       : "prismatic"},
                {"origin", flat_pose_json(j.origin)}};
    if (j.type > 0) {
      one["axis"] = vector3(j.axis);
      one["reading"] = j.reading;
      one["scale"] = j.scale;
      one["offset"] = j.offset;
      one["factor"] = j.factor;
      one["shift"] = j.shift;
    }
    if (!j.curve.empty()) one["curve"] = j.curve;
    if (j.temperature != 0) one["temperature"] = j.temperature;
    if (!j.ripple.empty()) one["ripple"] = j.ripple;
    if (!j.coupling.empty()) {
      one["coupled_to"] = j.coupled_to;
      one["coupling"] = j.coupling;
    }
    if (j.bends) {
      one["compliance"] = vector3(j.compliance);
      one["basis"] = matrix_json(j.basis);
    }
    if (!j.load.isZero(0)) one["load"] = vector3(j.load);
    joints.push_back(std::move(one));
  }
  return {{"gravity", vector3(robot.gravity)},
          {"frame", robot.rotor ? "rotor" : "stator"},
          {"base", robot.base},
          {"tip", robot.tip},
          {"base_frame", flat_pose_json(robot.base_frame)},
          {"tip_frame", flat_pose_json(robot.tip_frame)},
          {"joints", std::move(joints)}};
}

std::string c_numbers(std::initializer_list<double> values) {
  std::string out;
  for (const double v : values) out += (out.empty() ? "" : ", ") + text("%.17g", v);
  return "{" + out + "}";
}
std::string c_vector(const Vector3d& v) { return c_numbers({v.x(), v.y(), v.z()}); }
std::string c_matrix(const Matrix3d& m) {
  return c_numbers(
      {m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)});
}
std::string c_pose(const Pose& p) {
  return "{" + c_matrix(p.rotation) + ", " + c_vector(p.translation) + "}";
}

/// An array in C, behind those before it; returns its name, or 0 if it is empty.
template <typename T>
std::string c_array(const std::string& type, const std::string& name, const std::vector<T>& values,
                    std::string& arrays) {
  if (values.empty()) return "0";
  arrays += "static const " + type + " " + name + "[" + std::to_string(values.size()) + "] = {";
  for (size_t k = 0; k < values.size(); ++k)
    arrays += (k ? ", " : "") + text("%.17g", static_cast<double>(values[k]));
  arrays += "};\n";
  return name;
}

/// Data of a robot in C: its arrays, its joints, itself.
std::string c_robot(const FlatRobot& robot, const std::string& name) {
  std::string arrays, joints;
  for (size_t i = 0; i < robot.joints.size(); ++i) {
    const FlatJoint& j = robot.joints[i];
    const auto array = [&](const char* type, const char* of, const auto& values) {
      return c_array(type, "kincal_" + name + "_" + of + "_" + std::to_string(i), values, arrays);
    };
    const std::string curve = array("double", "curve", j.curve),
                      ripple = array("double", "ripple", j.ripple),
                      coupled_to = array("int", "coupled_to", j.coupled_to),
                      coupling = array("double", "coupling", j.coupling);
    joints += "  {" + std::to_string(j.above) + ", " + std::to_string(j.type) + ", " +
              std::to_string(j.reading) + ", " + (j.bends ? "1" : "0") + ", " + c_pose(j.origin) +
              ", " + c_vector(j.axis) +
              text(", %.17g, %.17g, %.17g, %.17g, ", j.scale, j.offset, j.factor, j.shift) + curve +
              text(", %.17g, ", j.temperature) + std::to_string(j.ripple.size() / (1 + kRipple)) +
              ", " + std::to_string(j.coupling.size()) + ", " + ripple + ", " + coupled_to + ", " +
              coupling + ", " + c_matrix(j.basis) + ", " + c_vector(j.compliance) + ", " +
              c_vector(j.load) + "},\n";
  }
  return arrays + "static const struct kincal_joint kincal_" + name + "_joints[] = {\n" + joints +
         "};\nstatic const struct kincal_robot kincal_" + name + " = {" +
         std::to_string(robot.joints.size()) + ", " + std::to_string(robot.base) + ", " +
         std::to_string(robot.tip) + ", " + (robot.rotor ? "1" : "0") + ", " +
         c_vector(robot.gravity) + ", " + c_pose(robot.base_frame) + ", " +
         c_pose(robot.tip_frame) + ", kincal_" + name + "_joints};\n";
}

/// A name as it may stand in a C comment or string.
std::string c_name(const std::string& name) {
  std::string out;
  for (const char c : name)
    out += std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '/' ? c : '_';
  return out;
}

}  // namespace

Compensation make_compensation(const RobotTip& real, const RobotTip& planned) {
  const Tree& tree = real.robot.rig->tree;
  std::set<int> joints = needed_joints(real), drivers;
  for (const int j : joints)
    if (tree.joints[j].moves())
      for_each_reading(*real.robot.rig, driver(tree, j).joint, [&](int by) { drivers.insert(by); });
  const std::vector<int> readings(drivers.begin(), drivers.end());
  Compensation out;
  out.base = real.from.name;
  out.tip = real.tip.name;
  for (const int j : readings) out.readings.push_back(tree.joints[j].name);
  out.real = flat_robot(real, joints, readings);
  out.planned = flat_robot(planned, joints, readings);
  return out;
}

std::string compensation_json(const Compensation& c) {
  return json_text({{"format", "kincal-compensation/1"},
                    {"base", c.base},
                    {"tip", c.tip},
                    {"readings", c.readings},
                    {"real", flat_json(c.real)},
                    {"planned", flat_json(c.planned)}});
}

std::string compensation_header(const Compensation& c) {
  std::string names;
  for (const std::string& name : c.readings)
    names += (names.empty() ? "\"" : ", \"") + c_name(name) + "\"";
  return "/* Made by kincal. Poses of " + c_name(c.tip) + " in " + c_name(c.base) +
         ". Readings, in this order: rad or m. C99, needs libm. */\n" + kCompensationHead +
         "#define KINCAL_READINGS " + std::to_string(c.readings.size()) +
         "\n#define KINCAL_JOINTS " + std::to_string(c.real.joints.size()) +
         "\nstatic const char* const kincal_readings[KINCAL_READINGS] = {" + names + "};\n" +
         kCompensationTypes + c_robot(c.real, "real") + c_robot(c.planned, "planned") +
         kCompensationCode;
}

std::string compensation_module(const Compensation& c) {
  std::string data = compensation_json(c);
  while (!data.empty() && data.back() == '\n') data.pop_back();
  return std::string(kCompensationModuleHead) + "DATA = json.loads(r'''\n" + data + "\n''')\n" +
         kCompensationModule;
}

}  // namespace kincal
