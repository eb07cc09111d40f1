#include "read_calibrated.h"

#include <cmath>
#include <filesystem>
#include <utility>

#include "../../models/rig/numbers.h"
#include "../../models/rig/words.h"
#include "../document/files.h"
#include "../document/json.h"
#include "../document/kinds.h"
#include "csv.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;
constexpr double kSameOrigin = 1e-9;  // m: written numbers carry 17 digits

/// A FileText is what stands in a file, and its path for messages.
struct FileText {
  std::string path, text;
};

/// A list of numbers and nulls.
std::vector<double> numbers_or_null(const Field& field) {
  std::vector<double> out;
  if (!field.node->numbers.empty()) return field.node->numbers;
  if (field.node->kind != Node::Kind::sequence) field.fail("a list of numbers is expected");
  for (size_t i = 0; i < field.size(); ++i) {
    const Field item = field.item(i);
    out.push_back(item.node->kind == Node::Kind::null ? kNan : item.number());
  }
  return out;
}

/// The component of a name; without a parameter: there is none.
Component find_component(const ParameterTable& table, const std::string& name) {
  for (size_t p = 0; p < table.all.size(); ++p)
    for (int c = 0; c < table.all[p].size(); ++c)
      if (table.all[p].component_name(c) == name) return {static_cast<int>(p), c};
  return {};
}

/// Offsets and reductions that a result put into its robot, taken out again.
void unfold(const Field& robot, CalibratedFiles& out) {
  const Tree& tree = out.rig_file.rig.tree;
  std::vector<double> offsets(tree.joints.size(), 0.0), back(tree.joints.size(), 0.0);
  std::vector<Pose> origins;
  for (const Joint& j : tree.joints) origins.push_back(j.parent_T_joint);
  const Field joints = robot["joints"];
  const auto refuse = [&](const Field& joint) {
    joint.fail("is not that of " + out.rig_file.urdf.path +
               ": this result.json belongs to another robot");
  };
  for (const auto& [name, ignored] : joints.members()) {
    const int j = tree.find_joint(name);
    const std::vector<double> xyz = joints[name]["new"]["xyz"].vector(3);
    if (j < 0 ||
        (origins[j].translation - Eigen::Map<const Vector3d>(xyz.data())).norm() > kSameOrigin)
      refuse(joints[name]);
    offsets[j] = joints[name]["offset"].number();
    back[j] = -offsets[j];
  }
  origins = fold_offsets(tree, origins, back);
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    set_pose(out.values, out.table.all[out.table.joint_origin[j]].start, origins[j]);
    if (out.table.joint_offset[j] >= 0)
      out.values(out.table.all[out.table.joint_offset[j]].start) += offsets[j];
  }
  const Field reductions = robot["reductions"];
  for (const auto& [name, ignored] : reductions.members()) {
    const int j = tree.find_joint(name), scale = j < 0 ? -1 : out.table.joint_scale[j];
    if (scale < 0) refuse(reductions[name]);  // no such joint, or one without a gear
    if (reductions[name]["written"].boolean())
      out.values(out.table.all[scale].start) = reductions[name]["scale"].number();
  }
}

/// Unknowns of the last step from covariance.csv and result.json: what predictions count, numbers
/// that the automatic path held among them. Every component without a variance there is an
/// undetermined direction of its own: how they cancel in a frame is not in the files.
Unknowns read_unknowns(const FileText& file, const Field& result, const ParameterTable& table) {
  const std::string& path = file.path;
  std::vector<std::vector<std::string>> rows;
  for_each_csv_row(file.text, [&](const std::vector<std::string>& row) { rows.push_back(row); });
  if (rows.empty() || rows.size() != rows[0].size() + 1)
    throw InputError(path + ": as many rows as columns and a header are expected");
  Unknowns out;
  const Eigen::Index n = static_cast<Eigen::Index>(rows[0].size());
  out.covariance.setZero(n, n);
  std::vector<int> unknown;
  std::map<int, int> components;
  for (Eigen::Index c = 0; c < n; ++c) {
    const Component found = find_component(table, rows[0][c]);
    if (found.parameter < 0)
      throw InputError(path + ":1: '" + rows[0][c] + "' is not a parameter of the rig beside it");
    out.columns.push_back(found);
    ++components[found.parameter];
    if (rows[c + 1].size() != rows[0].size())
      throw InputError(path + ":" + std::to_string(c + 2) +
                       ": a number for every name is expected");
    if (rows[c + 1][c].empty()) unknown.push_back(static_cast<int>(c));
    for (Eigen::Index d = 0; d < n; ++d)
      if (!rows[c + 1][d].empty())
        out.covariance(c, d) = csv_number(rows[c + 1][d], path + ":" + std::to_string(c + 2));
  }
  for (const auto& p : components)
    // What the automatic path held wholly is no parameter of the result: its increment is 0.
    if (table.all[p.first].pose && p.second < 6 &&
        result["parameters"].has(table.all[p.first].name)) {
      const Field value = result["parameters"][table.all[p.first].name]["value"];
      const std::vector<double> xi = numbers_or_null(value);
      if (xi.size() != 6) value.fail("the 6 numbers of a pose are expected");
      out.charts[p.first] = right_jacobian_se3(Eigen::Map<const Vector6d>(xi.data()));
    }
  out.undetermined.setZero(n, static_cast<Eigen::Index>(unknown.size()));
  for (size_t k = 0; k < unknown.size(); ++k)
    out.undetermined(unknown[k], static_cast<Eigen::Index>(k)) = 1;
  return out;
}

/// Takes what a calibration changed of a parameter out of `nominal`.
void unchange(const Field& estimate, const Parameter& p, VectorXd& nominal) {
  const std::vector<double> initial = numbers_or_null(estimate["initial"]),
                            value = numbers_or_null(estimate["value"]);
  if (initial.size() != p.components.size() || value.size() != p.components.size())
    estimate["value"].fail("initial and value have one number per component");
  if (!p.pose) {
    std::copy(initial.begin(), initial.end(), nominal.data() + p.start);
    return;
  }
  const bool had_one = !estimate.has("nominal") || estimate["nominal"].boolean();
  const Pose now = get_pose(nominal, p.start);
  set_pose(nominal, p.start,
           had_one ? now * inverse(exp_se3(Eigen::Map<const Vector6d>(value.data()))) : Pose());
}

/// What an intrinsics.json beside the rig says of its lenses.
void read_intrinsics(const std::string& path, CalibratedFiles& out) {
  const Node node = parse_json(read_file(path), path);
  const Field all = top(node, path);
  if (!all.has("status") || !all.has("warnings")) return;
  out.lens_status = all["status"].string();
  const Field warnings = all["warnings"];
  for (size_t i = 0; i < warnings.size(); ++i)
    out.doubts.push_back(warnings.item(i)["text"].string());
}

/// What a result.json, and a covariance.csv beside it if there is one, say of a rig. `alone`: of
/// the best robot without bending, of which neither sigmas nor covariance are known.
void add_result(const FileText& result, const FileText* covariance, bool alone,
                CalibratedFiles& out) {
  refuse_other_kinds(result.text, result.path, Wanted::result);
  const Node node = parse_json(result.text, result.path);
  const Field all = top(node, result.path);
  if (!all.has("robot") || !all.has("parameters") || !all.has("status"))
    throw InputError(
        result.path +
        ": is not a result of `kincal calibrate`: it has no robot, parameters and status");
  unfold(all[alone ? "rigid_robot" : "robot"], out);
  out.nominal = out.values;
  out.status = all["status"].string();
  if (std::string doubt = verdict_doubt(all); !doubt.empty()) out.doubts.push_back(doubt);
  if (alone) return;
  const Field parameters = all["parameters"];
  for (const auto& [name, estimate] : parameters.members()) {
    const int p = find_parameter(out.table, name);
    if (p < 0)
      throw InputError(parameters[name].where() + ": is not a parameter of " + out.rig_file.path);
    std::vector<double> sigma = numbers_or_null(parameters[name]["sigma"]);
    if (static_cast<int>(sigma.size()) != out.table.all[p].size())
      parameters[name]["sigma"].fail("one number per component is expected");
    out.sigma[name] = std::move(sigma);
    unchange(parameters[name], out.table.all[p], out.nominal);
  }
  if (covariance) out.unknowns = read_unknowns(*covariance, all, out.table);
}

}  // namespace

CalibratedState state_of(const CalibratedFiles& files) {
  if (!files.unknowns)
    throw InputError(
        files.path +
        ": has no covariance (covariance.csv beside result.json): the result directory "
        "of a calibration is expected");
  CalibratedState out{files.rig_file.rig, files.values, {}, {}, {}, {}};
  out.columns = files.unknowns->columns;
  out.covariance = files.unknowns->covariance;
  out.charts = files.unknowns->charts;
  out.undetermined = files.unknowns->undetermined;
  return out;
}

TrainingReadings training_readings(const std::string& samples_csv, const std::string& path,
                                   const Tree& tree) {
  TrainingReadings out;
  std::vector<int> joints;  // by column; -1: no reading
  const std::string where = path + ": samples.csv";
  for_each_csv_row(samples_csv, [&](const std::vector<std::string>& row) {
    if (joints.empty()) {
      const std::string key = "reading/";
      for (const std::string& name : row)
        joints.push_back(name.rfind(key, 0) == 0 ? tree.find_joint(name.substr(key.size())) : -1);
      return;
    }
    if (row.size() != joints.size() || row[1] != "train") return;
    Readings readings(tree.joints.size(), kNan);
    for (size_t c = 0; c < row.size(); ++c)
      if (joints[c] >= 0 && !row[c].empty()) readings[joints[c]] = csv_number(row[c], where);
    out.ids.push_back(row[0]);
    out.readings.push_back(std::move(readings));
  });
  return out;
}

std::string verdict_doubt(const Field& result) {
  if (!result.has("verdict")) return "";
  const Field verdict = result["verdict"];
  const std::string use = verdict["use"].string();
  if (use == "good") return "";
  std::string size;
  if (result["chi2"].node->kind == Node::Kind::scalar && result["dof"].number() > 0)
    size = text(" (chi2/dof %.3g)", result["chi2"].number() / result["dof"].number());
  return "its verdict is '" + use + "'" + size + ": " + verdict["text"].string();
}

int find_parameter(const ParameterTable& table, const std::string& name) {
  for (size_t p = 0; p < table.all.size(); ++p)
    if (table.all[p].name == name) return static_cast<int>(p);
  return -1;
}

CalibratedFiles read_calibrated(const std::string& given, bool rigid) {
  constexpr char kRigid[] = "rig_rigid.yaml";
  const fs::path path(given);
  std::error_code ignored;
  const bool folder = fs::is_directory(path, ignored);
  const bool json = !folder && path.extension() == ".json";
  const fs::path in = folder ? path : path.parent_path();
  rigid = rigid && fs::exists(in / kRigid, ignored);
  const fs::path rig = rigid ? in / kRigid : folder || json ? in / "rig.yaml" : path;
  const fs::path result = json ? path : rig.parent_path() / "result.json";
  if (!fs::exists(rig, ignored))
    throw InputError(
        given + ": a result directory, its result.json, or a rig.yaml is expected: there is no " +
        rig.string());
  RigFile rig_file = read_rig(rig.string());
  ParameterTable table(rig_file.rig);
  const VectorXd values = table.initial;
  CalibratedFiles out{given, std::move(rig_file), std::move(table), values};
  const fs::path lenses = rig.parent_path() / "intrinsics.json";
  if (!json && !fs::exists(result, ignored)) {
    if (fs::exists(lenses, ignored)) read_intrinsics(lenses.string(), out);
    return out;
  }

  const FileText text{result.string(), read_file(result.string())};
  const bool alone = rig.filename() == kRigid;
  const fs::path covariance = rig.parent_path() / "covariance.csv";
  if (alone || !fs::exists(covariance, ignored))
    add_result(text, nullptr, alone, out);
  else {
    const FileText rows{covariance.string(), read_file(covariance.string())};
    add_result(text, &rows, alone, out);
  }
  return out;
}

CalibratedFiles parse_calibrated(const ResultFiles& files, const std::string& folder) {
  const auto path = [&](const char* name) { return (fs::path(folder) / name).string(); };
  if (files.rig_yaml.empty() || files.result_json.empty())
    throw InputError(path(files.rig_yaml.empty() ? "rig.yaml" : "result.json") +
                     ": is missing: rig.yaml, result.json and the URDF of a result are expected");
  const bool bends = !files.unbent_urdf.empty();
  const std::string& text = bends ? files.unbent_urdf : files.robot_urdf;
  const Urdf robot =
      text.empty() ? Urdf() : parse_urdf(text, path(bends ? "robot_unbent.urdf" : "robot.urdf"));
  RigFile rig_file = parse_rig(files.rig_yaml, path("rig.yaml"), &robot);
  ParameterTable table(rig_file.rig);
  const VectorXd values = table.initial;
  CalibratedFiles out{path(""), std::move(rig_file), std::move(table), values};
  const FileText rows{path("covariance.csv"), files.covariance_csv};
  add_result({path("result.json"), files.result_json}, rows.text.empty() ? nullptr : &rows, false,
             out);
  return out;
}

}  // namespace kincal
