#include "apply.h"

#include <algorithm>
#include <filesystem>
#include <utility>
#include <vector>

#include "../document/files.h"
#include "../document/json.h"
#include "../document/kinds.h"
#include "../document/names.h"
#include "../document/numbers.h"
#include "../urdf/edit.h"
#include "../urdf/edit_mjcf.h"
#include "../urdf/proof.h"
#include "read_calibrated.h"
#include "robot_record.h"

namespace kincal {

namespace fs = std::filesystem;

namespace {

/// How far two poses are apart: the larger of metres and radians.
double apart(const Pose& a, const Pose& b) {
  return std::max((a.translation - b.translation).norm(),
                  log_so3(a.rotation.transpose() * b.rotation).norm());
}

/// A joint that follows one whose zero moves, and that the calibrated robot does not have, would
/// stay where that zero was. @throws InputError
void refuse_followers(const Urdf& urdf, const Field& known, const std::vector<double>& offsets) {
  for (size_t j = 0; j < urdf.tree.joints.size(); ++j) {
    const Joint& joint = urdf.tree.joints[j];
    if (joint.moves() && joint.mimic && !known.has(joint.name) &&
        offsets[driver(urdf.tree, static_cast<int>(j)).joint] != 0)
      throw InputError(urdf.path + ": joint '" + joint.name +
                       "' is not one of the calibrated robot and follows joint '" +
                       urdf.tree.joints[joint.mimic->master].name +
                       "', whose zero the result moves: calibrate with this URDF");
  }
}

constexpr double kSame = 1e-9;  // m and rad: written numbers carry 17 digits

/// A result.json that may be used.
struct ResultToApply {
  std::string path;
  Node node;
  std::string doubt;  // its verdict, where that is not good

  Field all() const { return top(node, path); }
};

ResultToApply open_result(const std::string& result_path, bool force) {
  ResultToApply out;
  out.path = fs::is_directory(result_path) ? (fs::path(result_path) / "result.json").string()
                                           : result_path;
  const std::string text = read_file(out.path);
  refuse_other_kinds(text, out.path, Wanted::result);
  out.node = parse_json(text, out.path);
  const Field all = out.all();
  if (!all.has("robot") || !all["robot"].has("joints"))
    throw InputError(out.path + ": is not a result of `kincal calibrate`: it has no robot.joints");
  out.doubt = verdict_doubt(all);
  if (!force && all["status"].string() != "converged")
    throw InputError(out.path + ": status: " + all["status"].string() +
                     ": this result is not to be trusted" +
                     (out.doubt.empty() ? "" : ": " + out.doubt) + "; --force applies it anyway");
  if (all["robot"].has("urdf") && !all["robot"]["urdf"].boolean())
    throw InputError(out.path +
                     ": is about a robot without URDF: its mounts, ready to be copied, are in "
                     "changes.yaml");
  return out;
}

/// The robot that a URDF can hold: where joints have other errors that of a rigid calibration.
Field robot_of(const Field& all) { return all[all.has("rigid_robot") ? "rigid_robot" : "robot"]; }

/// What there is to say of a result that becomes part of `what`.
std::vector<std::string> notes_of(const ResultToApply& result, const std::string& what) {
  std::vector<std::string> out;
  if (!result.doubt.empty()) out.push_back(result.path + ": " + result.doubt);
  const Field all = result.all();
  if (all.has("rigid_robot"))
    out.push_back("the joints have errors that " + what +
                  " cannot express; this is the best robot without them (result.json: "
                  "rms_uncorrected)");
  if (!robot_of(all).has("joint_models")) return out;
  const Field models = robot_of(all)["joint_models"];
  for (const auto& [joint, model] : models.members()) {
    std::string numbers;
    for (const auto& [name, ignored] : models[joint].members())
      if (const Field value = models[joint][name]; name != "model")
        numbers +=
            ", " + name +
            (value.node->kind == Node::Kind::sequence ? "" : " = " + shortest(value.number()));
    out.push_back("joint '" + joint + "': " + what + " cannot express its joint model (" +
                  models[joint]["model"].string() + numbers + "); this one has its offset only");
  }
  return out;
}

}  // namespace

AppliedResult apply_result(const std::string& result_path, const Urdf& urdf, bool force) {
  const ResultToApply result = open_result(result_path, force);
  const std::string& path = result.path;
  const Field all = result.all();
  const Field joints = robot_of(all)["joints"], reductions = robot_of(all)["reductions"];
  UrdfChanges changes;
  std::vector<Pose> origins;
  std::vector<double> offsets(urdf.tree.joints.size(), 0.0);
  for (const Joint& j : urdf.tree.joints) origins.push_back(j.parent_T_joint);
  const Field mimics = robot_of(all)["mimics"];
  for (const auto& [name, ignored] : mimics.members()) {  // followers must be followers here too
    const int j = urdf.tree.find_joint(name);
    const std::string motion = j < 0 ? "absent" : motion_text(urdf.tree, urdf.tree.joints[j]);
    if (motion != mimics[name].string())
      throw InputError(urdf.path + ": joint '" + name +
                       "' is not that of the calibrated robot: it is " + motion + ", there it is " +
                       mimics[name].string());
  }
  size_t held = 0;
  std::vector<std::string> names;
  for (const Joint& j : urdf.tree.joints) names.push_back(j.name);
  for (const auto& [name, ignored] : joints.members()) {
    const Field entry = joints[name];
    const int j = urdf.tree.find_joint(name);
    if (j < 0)
      throw InputError(urdf.path + ": has no joint '" + name + "', which the result changes" +
                       nearest_names(name, names));
    const std::string motion = motion_text(urdf.tree, urdf.tree.joints[j]);
    if (motion != entry["motion"].string())
      throw InputError(urdf.path + ": joint '" + name +
                       "' is not that of the calibrated robot: it is " + motion + ", there it is " +
                       entry["motion"].string());
    const Pose before = read_exact_pose(entry["old"]), after = read_exact_pose(entry["new"]);
    const double to_old = apart(urdf.tree.joints[j].parent_T_joint, before),
                 to_new = apart(urdf.tree.joints[j].parent_T_joint, after);
    if (to_new <= kSame && to_new < to_old) {
      ++held;
    } else if (to_old > kSame) {
      throw InputError(urdf.path + ": the origin of joint '" + name +
                       "' is not that of the calibrated robot (" + shortest(to_old) +
                       " m or rad away): the changes do not fit this robot");
    }
    changes.origins[j] = after;
    origins[j] = after;
    offsets[j] = entry["offset"].number();
  }
  refuse_followers(urdf, mimics, offsets);
  for (const auto& [name, ignored] : reductions.members()) {
    if (!reductions[name]["written"].boolean()) continue;
    for (const Transmission& t : urdf.transmissions)
      if (t.joint == name) changes.reductions[name] = reductions[name]["new"].number();
  }
  if (held == joints.size() && held > 0)
    throw InputError(urdf.path + ": already has the changes of " + path + " already");
  if (held > 0)
    throw InputError(urdf.path + ": holds " + std::to_string(held) + " of the " +
                     std::to_string(joints.size()) + " changes of " + path + " already");
  AppliedResult out{"", notes_of(result, "a URDF")};
  out.text = edit_urdf(urdf, changes);
  // The written origins hold the offsets: take these out of them again, so that the proof compares
  // file and model as in a calibration.
  std::vector<double> back(offsets.size());
  for (size_t j = 0; j < offsets.size(); ++j) back[j] = -offsets[j];
  try {
    prove_urdf(out.text, urdf, fold_offsets(urdf.tree, origins, back), offsets);
  } catch (const std::runtime_error& error) {
    throw InputError(path + ": robot: its values are inconsistent: " + error.what());
  }
  return out;
}

AppliedResult apply_to_mjcf(const std::string& result_path, const std::string& text,
                            const std::string& path, bool force) {
  const ResultToApply result = open_result(result_path, force);
  const RigFile rig_file = read_calibrated(result.path, true).rig_file;
  const Tree& tree = rig_file.urdf.tree;
  CalibratedTree robot{tree, {}, {}, {}};
  for (const Joint& joint : tree.joints) robot.after.push_back(joint.parent_T_joint);
  robot.before = robot.after;
  const Field joints = robot_of(result.all())["joints"];
  for (const auto& [name, ignored] : joints.members()) {
    const int j = tree.find_joint(name);
    if (j < 0) joints[name].fail("is not a joint of " + rig_file.urdf.path);
    robot.before[j] = read_exact_pose(joints[name]["old"]);
    if (apart(robot.after[j], read_exact_pose(joints[name]["new"])) > kSame)
      joints[name].fail("is not that of " + rig_file.urdf.path +
                        ": this result.json belongs to another robot");
  }
  const Rig& rig = rig_file.rig;
  for (const Sensor& sensor : rig.sensors)
    if (sensor.type == "camera" && sensor.pose_given)
      robot.cameras.push_back(
          {sensor.name, tree.find_link(rig.tree.links[sensor.link]), sensor.link_T_sensor});
  EditedMjcf edited = edit_mjcf(text, path, robot);
  AppliedResult out{std::move(edited.text), notes_of(result, "a MuJoCo model")};
  for (const std::string& note : edited.notes) out.notes.push_back(path + ": " + note);
  return out;
}

}  // namespace kincal
