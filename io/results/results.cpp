#include "results.h"

#include <algorithm>
#include <cctype>
#include <memory>

#include "../../models/analysis/frames.h"
#include "../../models/rig/elasticity.h"
#include "../document/files.h"
#include "../document/numbers.h"
#include "../document/quoting.h"
#include "../document/yaml.h"
#include "../rig/rig_text.h"
#include "../urdf/edit.h"
#include "../urdf/proof.h"
#include "csv.h"
#include "result_json.h"
#include "robot_record.h"
#include "scene_json.h"

namespace kincal {
namespace {

RigValues rig_values(const Solution& solution, bool write_reduction,
                     const std::vector<Reduction>& reductions) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  const VectorXd& values = solution.values.shared;
  RigValues out = values_of(rig);
  if (rig.elasticity) out.elasticity = folded_elasticity(rig, table, values);
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    out.joint_offsets[j] = 0;
    if (!rig.tree.joints[j].has_reading()) continue;
    out.joint_scales[j] = values(table.all[table.joint_scale[j]].start);
    if (write_reduction &&
        std::any_of(reductions.begin(), reductions.end(),
                    [&](const Reduction& r) { return r.joint == rig.tree.joints[j].name; }))
      out.joint_scales[j] = 1;
    for (size_t k = 0; k < out.joint_further[j].size(); ++k)
      out.joint_further[j][k] =
          values(table.all[table.joint_offset[j]].start + 2 + static_cast<int>(k));
    out.joint_terms[j] = terms_at(rig, table, values, static_cast<int>(j));
  }
  const std::vector<int> unknown = unseen_poses(solution).open;
  const auto known_pose = [&](int parameter) -> std::optional<Pose> {
    if (std::count(unknown.begin(), unknown.end(), parameter)) return std::nullopt;
    return get_pose(values, table.all[parameter].start);
  };
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    out.sensor_poses[s] = known_pose(table.sensor_pose[s]);
    if (table.time_offset[s] >= 0)
      out.sensor_time_offsets[s] = values(table.all[table.time_offset[s]].start);
    if (table.line_time[s] >= 0)
      out.sensor_line_times[s] = values(table.all[table.line_time[s]].start);
    for (size_t b = 0; b < rig.sensors[s].parameters.size(); ++b) {
      const Parameter& p = table.all[table.sensor_block[s] + static_cast<int>(b)];
      out.sensor_parameters[s][b].assign(values.data() + p.start,
                                         values.data() + p.start + p.size());
    }
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    if (rig.targets[t].link >= 0) out.target_poses[t] = known_pose(table.target_pose[t]);
    if (rig.targets[t].grid) {
      out.target_squares[t] = values(table.all[table.target_square[t]].start);
      if (table.target_warp[t] >= 0)
        out.target_warps[t] = values.segment<2>(table.all[table.target_warp[t]].start);
      if (table.target_print[t] >= 0)
        out.target_prints[t] = values.segment<2>(table.all[table.target_print[t]].start);
    } else {
      const Parameter& p = table.all[table.target_points[t]];
      out.target_points[t] =
          Eigen::Map<const Eigen::Matrix3Xd>(values.data() + p.start, 3, p.size() / 3);
    }
  }
  return out;
}

/// Returns a text as the key of a mapping.
std::string key_of(const std::string& text) {
  Node name;
  name.kind = Node::Kind::scalar;
  name.text = text;
  name.quoted = true;
  std::string key = to_yaml(name);
  while (!key.empty() && std::isspace(static_cast<unsigned char>(key.back()))) key.pop_back();
  return key;
}

/// What joint models add to scale and offset, which no URDF can express.
struct BentJoint {
  std::string joint, model;
  std::vector<std::pair<std::string, std::vector<double>>> numbers;  // the scale first
};

std::vector<BentJoint> bent_joints(const Solution& solution) {
  std::vector<BentJoint> out;
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    if (table.joint_offset[j] < 0 || rig.joints[j].model->size() == 2) continue;
    out.push_back({rig.tree.joints[j].name, rig.joints[j].model->name(), {}});
    for (int k = table.joint_scale[j]; k < table.joint_origin[j]; ++k) {
      const Parameter& p = table.all[k];
      const double* values = solution.values.shared.data() + p.start;
      out.back().numbers.push_back(
          {p.name.substr(p.name.rfind('/') + 1), {values, values + p.size()}});
    }
  }
  return out;
}

std::string list_of(const std::string& text) {  // "1 2 3" -> "[1, 2, 3]"
  std::string out = "[";
  bool gap = false;
  for (char c : text) {
    const bool blank = std::isspace(static_cast<unsigned char>(c));
    if (!blank) {
      if (gap && out.size() > 1) out += ", ";
      out += c;
    }
    gap = blank;
  }
  return out + "]";
}

std::string list_of(const std::vector<double>& values) {
  std::string out;
  for (const double value : values) out += (out.empty() ? "[" : ", ") + shortest(value);
  return out + "]";
}

/// Returns what the URDF takes up of a solution; `out` gets the reductions and what it cannot hold.
UrdfChanges urdf_changes(const RigFile& rig_file, const Solution& solution, const RobotModel& model,
                         const ResultOptions& options, ResultFiles& out) {
  const Rig& rig = solution.rig();
  const std::vector<Pose> folded = fold_offsets(rig.tree, model.origins, model.offsets);
  UrdfChanges changes;
  for (size_t j = 0; j < folded.size(); ++j)
    if (!equal(folded[j], rig_file.rig.tree.joints[j].parent_T_joint))
      changes.origins[static_cast<int>(j)] = folded[j];
  for (const ParameterEstimate& e : solution.parameters) {
    const Parameter& p = solution.table().all[e.parameter];
    if (p.kind == ParameterKind::joint_scale &&
        rig.joints[p.owner].model->size() == 2) {  // else a gear's reading is not proportional
      const std::string& joint = rig.tree.joints[p.owner].name;
      for (const Transmission& t : rig_file.urdf.transmissions)
        if (t.joint == joint)
          out.reductions.push_back(
              {joint, t.name, e.value[0], t.reduction, t.reduction / e.value[0]});
    }
    if (p.kind != ParameterKind::joint_offset && p.kind != ParameterKind::joint_origin)
      out.not_in_urdf.push_back(e.name);
  }
  if (options.write_reduction)
    for (const Reduction& r : out.reductions) {
      changes.reductions[r.joint] = r.after;
      out.not_in_urdf.erase(std::remove(out.not_in_urdf.begin(), out.not_in_urdf.end(),
                                        "joint/" + r.joint + "/scale"),
                            out.not_in_urdf.end());
    }
  return changes;
}

/// Returns the text of changes.yaml: old and new origins, reductions, joint models.
std::string changes_text(const RigFile& rig_file, const UrdfChanges& changes,
                         const std::vector<Reduction>& reductions,
                         const std::vector<BentJoint>& bent) {
  std::string out =
      "# Old and new origins of the joints that the calibration changed (joint offsets folded "
      "in).\n";
  if (changes.origins.empty())
    out += "joints: {}\n";
  else
    out += "joints:\n";
  for (const auto& c : changes.origins) {
    const Joint& joint = rig_file.rig.tree.joints[c.first];  // as read, not as nominal
    const OriginText& old = rig_file.urdf.origins.at(c.first);
    const Vector3d rpy = rpy_from_rotation(c.second.rotation);
    const bool moved = c.second.translation != joint.parent_T_joint.translation,
               turned = c.second.rotation != joint.parent_T_joint.rotation;
    const std::string xyz = moved ? shortest(c.second.translation) : old.xyz,
                      angles = turned ? shortest(rpy) : old.rpy;
    out += "  " + key_of(joint.name) + ":\n    old: {xyz: " + list_of(old.xyz) +
           ", rpy: " + list_of(old.rpy) + "}\n    new: {xyz: " + list_of(xyz) +
           ", rpy: " + list_of(angles) + "}\n";
  }
  if (!reductions.empty()) {
    out += "transmissions:  # mechanicalReduction: new = old / scale\n";
    for (const Reduction& r : reductions)
      out += "  " + key_of(r.joint) + ": {scale: " + shortest(r.scale) +
             ", old: " + shortest(r.before) + ", new: " + shortest(r.after) + "}\n";
  }
  if (!bent.empty()) out += "joint_models:  # robot.urdf has their offsets only\n";
  for (const BentJoint& b : bent) {
    out += "  " + key_of(b.joint) + ": {model: " + yaml_text(b.model);
    for (const auto& [name, values] : b.numbers)
      out += ", " + name + ": " + (values.size() > 1 ? list_of(values) : shortest(values[0]));
    out += "}\n";
  }
  return out;
}

/// Returns what changes.yaml has of mounts: lines to be copied as they are, where YAML allows it.
std::string mounts_text(const std::vector<MountText>& mounts) {
  std::string out;
  const auto add = [&](const char* key, const std::string& text) {
    out += "    " + std::string(key) + ": ";
    if (!std::all_of(text.begin(), text.end(),
                     [](char c) { return c == '\n' || (c >= ' ' && c <= '~'); })) {
      out += quoted_text(text, Quoting::yaml) + "\n";
      return;
    }
    out += "|-\n      ";
    for (const char c : text) out += c == '\n' ? "\n      " : std::string(1, c);
    out += "\n";
  };
  if (!mounts.empty())
    out += "mounts:  # estimated poses that no joint of robot.urdf has, for other programs\n";
  for (const MountText& mount : mounts) {
    out += "  " + key_of(mount.name) + ":\n";
    add("urdf", mount.urdf);
    add("ros2", mount.ros2);
  }
  return out;
}

/// Returns result.json's `robot`: what the URDF's file now holds, to be taken out of it again.
Json robot_json(const Rig& rig, const RobotModel& model, const UrdfChanges& changes,
                const ResultOptions& options, const std::vector<Reduction>& reductions,
                const std::vector<BentJoint>& bent) {
  Json joints = Json::object();
  for (const auto& c : changes.origins) {
    const Joint& joint = rig.tree.joints[c.first];
    joints[joint.name] = {{"offset", model.offsets[c.first]},
                          {"motion", motion_text(rig.tree, joint)},
                          {"old", exact_pose(joint.parent_T_joint)},
                          {"new", exact_pose(c.second)}};
  }
  Json robot = {
      {"joints", std::move(joints)}, {"mimics", Json::object()}, {"reductions", Json::object()}};
  for (const Joint& joint : rig.tree.joints)
    if (joint.moves() && joint.mimic) robot["mimics"][joint.name] = motion_text(rig.tree, joint);
  for (const Reduction& r : reductions)
    robot["reductions"][r.joint] = {{"scale", r.scale},
                                    {"old", r.before},
                                    {"new", r.after},
                                    {"written", options.write_reduction}};
  for (const BentJoint& b : bent) {
    Json& one = robot["joint_models"][b.joint] = {{"model", b.model}};
    for (const auto& [name, values] : b.numbers)
      one[name] = values.size() > 1 ? Json(values) : Json(values[0]);
  }
  return robot;
}

}  // namespace

namespace {

/// Makes the URDF of a solution and the rig that goes with it (what is folded into the robot is not
/// in it), which names it `robot`; `model` is of the solution. Returns what the URDF takes up.
UrdfChanges make_robot(const RigFile& rig_file, const Solution& solution, const RobotModel& model,
                       const ResultOptions& options, const char* robot, ResultFiles& out) {
  UrdfChanges changes = urdf_changes(rig_file, solution, model, options, out);
  if (!rig_file.flange_only) {
    out.robot_urdf = edit_urdf(rig_file.urdf, changes);
    prove_urdf(out.robot_urdf, rig_file.urdf, model.origins, model.offsets);
  }
  out.rig_yaml =
      rig_text(rig_file, rig_values(solution, options.write_reduction, out.reductions), robot);
  return changes;
}

}  // namespace

ResultFiles make_results(const RigFile& rig_file, const Report& report,
                         const ResultOptions& options) {
  const Solution& solution = report.solution;
  const Solution& rigid = report.rigid ? *report.rigid : solution;
  const RobotModel model = robot_model(rigid);
  ResultFiles out;
  RigFile alone = rig_file;
  if (report.rigid) set_nominal(alone, nominal_values(rigid));
  const UrdfChanges changes = make_robot(alone, rigid, model, options, "robot.urdf", out);
  const auto robot = [&](const Solution& of, const RobotModel& its, const UrdfChanges& changed) {
    Json one = robot_json(rig_file.rig, its, changed, options, out.reductions, bent_joints(of));
    if (rig_file.flange_only) one["urdf"] = false;
    return one;
  };
  Json robots = {{"robot", robot(rigid, model, changes)}};
  if (report.rigid) {
    ResultFiles whole;
    const RobotModel unbent = robot_model(solution);
    const UrdfChanges changed =
        make_robot(rig_file, solution, unbent, options, "robot_unbent.urdf", whole);
    robots = {{"robot", robot(solution, unbent, changed)},
              {"rigid_robot", std::move(robots["robot"])}};
    out.rig_rigid = std::move(out.rig_yaml);
    out.rig_yaml = std::move(whole.rig_yaml);
    out.unbent_urdf = std::move(whole.robot_urdf);
    out.not_in_urdf = std::move(whole.not_in_urdf);
  }

  // Whoever opens a file of a bad result should see it there too. (The URDF stays the input but for
  // its numbers.)
  const std::string mark = solution.status == Status::converged
                               ? ""
                               : "# kincal: status " + status_name(solution.status) +
                                     ", see result.json: do not rely on these values.\n";
  out.rig_yaml = mark + out.rig_yaml;

  out.mounts = mount_texts(rigid);
  out.changes_yaml = mark + changes_text(rig_file, changes, out.reductions, bent_joints(rigid)) +
                     mounts_text(out.mounts);

  out.rig_hash = sha256(rig_file.text);
  out.samples_hash = options.samples_hash;
  out.urdf_hash = sha256(rig_file.urdf.text);
  Json json = {{"verdict", verdict_json(report.verdict)},
               {"kincal", options.version},
               {"input",
                {{"command", options.command},
                 {"date", options.date},
                 {"rig", out.rig_hash},
                 {"samples", out.samples_hash},
                 {"urdf", out.urdf_hash}}}};
  if (!rig_file.serial.empty()) json["serial"] = rig_file.serial;
  if (!rig_file.time.empty()) json["time"] = rig_file.time;
  Json result = result_json(report);
  for (auto& [key, value] : result.get_ref<Json::object_t&>()) json[key] = std::move(value);
  for (auto& [key, value] : robots.get_ref<Json::object_t&>()) json[key] = std::move(value);
  json["scene"] = scene_json(report, rig_file.urdf);
  if (options.residuals && !report.loop_views.empty())
    json["loops_csv"] = {{"every", loops_every(report)}};
  out.result_json = json_text(json);
  out.told = [all = std::make_shared<const Json>(std::move(json))] {
    Node told;
    told.kind = Node::Kind::mapping;
    for (const auto& [key, value] : all->get_ref<const Json::object_t&>())
      if (key != "samples" && key != "scene") told.members.emplace_back(key, node_of(value));
    return told;
  };

  out.covariance_csv = covariance_csv(solution);
  out.information_csv = information_csv(report);
  out.samples_csv = samples_csv(solution);
  if (options.residuals) {
    out.residuals_csv = residuals_csv(report);
    if (!report.loop_views.empty()) out.loops_csv = loops_csv(report);
  }
  return out;
}

const std::vector<std::pair<const char*, std::string ResultFiles::*>>& result_file_names() {
  static const std::vector<std::pair<const char*, std::string ResultFiles::*>> names = {
      {"robot.urdf", &ResultFiles::robot_urdf},
      {"rig.yaml", &ResultFiles::rig_yaml},
      {"result.json", &ResultFiles::result_json},
      {"changes.yaml", &ResultFiles::changes_yaml},
      {"covariance.csv", &ResultFiles::covariance_csv},
      {"information.csv", &ResultFiles::information_csv},
      {"samples.csv", &ResultFiles::samples_csv},
      {"residuals.csv", &ResultFiles::residuals_csv},
      {"loops.csv", &ResultFiles::loops_csv},
      {"report.html", &ResultFiles::report_html},
      {"robot_unbent.urdf", &ResultFiles::unbent_urdf},
      {"rig_rigid.yaml", &ResultFiles::rig_rigid},
      {"batch.json", &ResultFiles::batch_json}};
  return names;
}

bool write_results(const std::string& directory, const ResultFiles& files, bool force,
                   bool (*go_on)(), const std::string& scratch) {
  std::vector<std::pair<std::string, std::string>> present;
  for (const auto& [name, text] : result_file_names())
    if (!(files.*text).empty()) present.emplace_back(name, files.*text);
  return write_directory(directory, present, force, go_on, scratch);
}

}  // namespace kincal
