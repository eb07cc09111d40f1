#include "results.h"

#include <sys/types.h>

#include <nettle/sha2.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "result_json.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// The rotation as its matrix, so that it comes back to the last bit.
Json exact_pose(const Pose& p) {
  Json rows = Json::array();
  for (int i = 0; i < 3; ++i) rows.push_back(vector3(p.rotation.row(i)));
  return {{"xyz", vector3(p.translation)}, {"rotation", rows}};
}

Pose read_exact_pose(const Field& field) {
  field.check_keys({"xyz", "rotation"});
  const std::vector<double> xyz = field["xyz"].vector(3), rows = field["rotation"].table(3);
  if (rows.size() != 9) field["rotation"].fail("3 x 3 numbers are expected");
  return {Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data()), Eigen::Map<const Vector3d>(xyz.data())};
}

/// Origins and offsets of the estimated model, by joint index.
struct RobotModel {
  std::vector<Pose> origins;
  std::vector<double> offsets;
};

/// What else than its origin makes a joint what it is: type, axis and mimic, as one text to compare.
std::string motion_text(const Tree& tree, const Joint& joint) {
  static const char* const types[] = {"fixed", "revolute", "continuous", "prismatic", "floating", "planar"};
  std::string out = types[static_cast<int>(joint.type)];
  if (joint.moves()) out += " " + shortest(joint.axis.x()) + " " + shortest(joint.axis.y()) + " " + shortest(joint.axis.z());
  if (joint.mimic)
    out += " mimics " + tree.joints[joint.mimic->master].name + " times " + shortest(joint.mimic->multiplier) + " plus " +
           shortest(joint.mimic->offset);
  return out;
}

RobotModel robot_model(const Calibration& calibration, const VectorXd& values) {
  const ParameterTable& table = calibration.table();
  RobotModel out;
  for (size_t j = 0; j < calibration.rig().tree.joints.size(); ++j) {
    const Joint& joint = calibration.rig().tree.joints[j];
    const Parameter& origin = table.all[table.joint_origin[j]];
    const Pose now = get_pose(values, origin.start), before = get_pose(table.initial, origin.start);
    const bool same = now.rotation == before.rotation && now.translation == before.translation;
    out.origins.push_back(same ? joint.parent_T_joint : now);
    out.offsets.push_back(joint.has_reading() ? values(table.all[table.joint_offset[j]].start) : 0);
  }
  return out;
}

bool equal(const Pose& a, const Pose& b) { return a.rotation == b.rotation && a.translation == b.translation; }

RigValues rig_values(const Calibration& calibration, const VectorXd& values, bool write_reduction,
                     const std::vector<Reduction>& reductions) {
  const Rig& rig = calibration.rig();
  const ParameterTable& table = calibration.table();
  RigValues out = values_of(rig);
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    out.joint_offsets[j] = 0;
    if (!rig.tree.joints[j].has_reading()) continue;
    out.joint_scales[j] = values(table.all[table.joint_scale[j]].start);
    if (write_reduction &&
        std::any_of(reductions.begin(), reductions.end(), [&](const Reduction& r) { return r.joint == rig.tree.joints[j].name; }))
      out.joint_scales[j] = 1;
  }
  const auto changed_pose = [&](int parameter, const Pose& rigs) {
    const int start = table.all[parameter].start;
    const Pose now = get_pose(values, start);
    return equal(now, rigs) ? rigs : now;
  };
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    out.sensor_poses[s] = changed_pose(table.sensor_pose[s], rig.sensors[s].link_T_sensor);
    for (size_t b = 0; b < rig.sensors[s].parameters.size(); ++b) {
      const Parameter& p = table.all[table.sensor_block[s] + static_cast<int>(b)];
      out.sensor_parameters[s][b].assign(values.data() + p.start, values.data() + p.start + p.size());
    }
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    if (rig.targets[t].link >= 0) out.target_poses[t] = changed_pose(table.target_pose[t], rig.targets[t].link_T_target);
    if (rig.targets[t].grid) {
      out.target_squares[t] = values(table.all[table.target_square[t]].start);
    } else {
      const Parameter& p = table.all[table.target_points[t]];
      out.target_points[t] = Eigen::Map<const Eigen::Matrix3Xd>(values.data() + p.start, 3, p.size() / 3);
    }
  }
  return out;
}

std::string residuals_csv(const Calibration& calibration, const CalibrationResult& result) {
  std::string out = "sample,split,sensor,target,id,unit,x,y,z,rx,ry,rz,before_x,before_y,before_z,whitened\n";
  std::map<const View*, const ViewResiduals*> before;
  for (const ViewResiduals& r : result.residuals_before) before[r.view] = &r;
  const Rig& rig = calibration.rig();
  for (const ViewResiduals& r : result.residuals) {
    const Sensor& sensor = rig.sensors[r.view->sensor];
    const int rows = sensor.model->rows();
    const Eigen::Index blocks = r.raw.size() / rows, white = r.whitened.size() / blocks;
    const auto found = before.find(r.view);
    const Sample& sample = calibration.samples()[r.sample];
    const std::string head = csv_field(sample.id) + (sample.train ? ",train," : ",test,") + csv_field(sensor.name) + "," +
                             csv_field(rig.targets[r.view->target].name) + ",";
    for (Eigen::Index b = 0; b < blocks; ++b) {
      out += head;
      if (!sensor.model->whole_pose()) out += std::to_string(r.view->ids.empty() ? static_cast<int>(b) : r.view->ids[b]);
      out += std::string(",") + sensor.model->unit();
      for (int i = 0; i < 6; ++i) out += "," + (i < rows ? shortest(r.raw(b * rows + i)) : std::string());
      for (int i = 0; i < 3; ++i)
        out += "," + (i < rows && found != before.end() && std::isfinite(found->second->raw(b * rows + i))
                          ? shortest(found->second->raw(b * rows + i))
                          : std::string());
      out += "," + shortest(r.whitened.segment(b * white, white).norm()) + "\n";
    }
  }
  return out;
}

std::string covariance_csv(const CalibrationResult& result) {
  std::string out;
  for (size_t i = 0; i < result.covariance_names.size(); ++i) out += (i ? "," : "") + csv_field(result.covariance_names[i]);
  out += "\n";
  for (Eigen::Index i = 0; i < result.covariance.rows(); ++i) {
    for (Eigen::Index j = 0; j < result.covariance.cols(); ++j) out += (j ? "," : "") + shortest(result.covariance(i, j));
    out += "\n";
  }
  return out;
}

std::string three(const Vector3d& v) { return shortest(v.x()) + " " + shortest(v.y()) + " " + shortest(v.z()); }

std::string list_of(std::string text) {  // "1 2 3" -> "[1, 2, 3]"
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

/// Without slashes at the end, which would make a name its own parent.
std::string plain_name(const std::string& directory) {
  std::string name = fs::path(directory).lexically_normal().string();
  while (name.size() > 1 && name.back() == '/') name.pop_back();
  return name;
}

void write_whole(const fs::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file.write(text.data(), static_cast<std::streamsize>(text.size()));
  file.close();
  if (!file) throw InputError(path.string() + ": cannot be written: " + std::strerror(errno));
}

}  // namespace

std::string status_name(Status status) {
  switch (status) {
    case Status::converged:
      return "converged";
    case Status::unobservable:
      return "unobservable";
    default:
      return "not_converged";
  }
}

std::string csv_field(const std::string& s) {
  if (s.find_first_of(",\"\n\r") == std::string::npos) return s;
  std::string out = "\"";
  for (char c : s) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

std::string sha256(const std::string& text) {
  sha256_ctx context;
  uint8_t digest[SHA256_DIGEST_SIZE];
  sha256_init(&context);
  sha256_update(&context, text.size(), reinterpret_cast<const uint8_t*>(text.data()));
  sha256_digest(&context, sizeof digest, digest);
  std::string hex;
  for (const uint8_t byte : digest) hex += {"0123456789abcdef"[byte >> 4], "0123456789abcdef"[byte & 15]};
  return hex;
}

ResultFiles make_results(const RigFile& rig_file, const Calibration& calibration, const CalibrationResult& result,
                         const ResultOptions& options) {
  const Rig& rig = calibration.rig();
  const VectorXd& values = result.values.shared;
  const RobotModel model = robot_model(calibration, values);
  const std::vector<Pose> folded = fold_offsets(rig.tree, model.origins, model.offsets);
  ResultFiles out;

  // The robot.
  UrdfChanges changes;
  for (size_t j = 0; j < folded.size(); ++j)
    if (!equal(folded[j], rig.tree.joints[j].parent_T_joint)) changes.origins[static_cast<int>(j)] = folded[j];
  for (const ParameterEstimate& e : result.parameters) {
    const size_t slash = e.name.rfind('/');
    const std::string kind = e.name.substr(slash + 1), owner = e.name.substr(0, e.name.find('/'));
    if (owner == "joint" && kind == "scale") {
      const std::string joint = e.name.substr(6, slash - 6);
      for (const Transmission& t : rig_file.urdf.transmissions)
        if (t.joint == joint) out.reductions.push_back({joint, t.name, e.value[0], t.reduction, t.reduction / e.value[0]});
    }
    if (owner != "joint" || kind == "scale") out.not_in_urdf.push_back(e.name);
  }
  if (options.write_reduction)
    for (const Reduction& r : out.reductions) {
      changes.reductions[r.joint] = r.after;
      out.not_in_urdf.erase(std::remove(out.not_in_urdf.begin(), out.not_in_urdf.end(), "joint/" + r.joint + "/scale"),
                            out.not_in_urdf.end());
    }
  out.robot_urdf = edit_urdf(rig_file.urdf, changes);
  prove_urdf(out.robot_urdf, rig_file.urdf, model.origins, model.offsets);

  // The rig: what is folded into the robot is not in it.
  out.rig_yaml = rig_text(rig_file, rig_values(calibration, values, options.write_reduction, out.reductions), "robot.urdf");

  // Whoever opens a file of a bad result should see it there too. (The URDF stays the input but for its numbers.)
  const std::string mark = result.status == Status::converged
                               ? ""
                               : "# kincal: status " + status_name(result.status) + ", see result.json: do not rely on these numbers.\n";
  out.rig_yaml = mark + out.rig_yaml;

  // Old and new origins.
  Json robot = Json::object();
  out.changes_yaml = mark + "# Old and new origins of the joints that the calibration changed (joint offsets folded in).\n";
  if (changes.origins.empty())
    out.changes_yaml += "joints: {}\n";
  else
    out.changes_yaml += "joints:\n";
  for (const auto& c : changes.origins) {
    const Joint& joint = rig.tree.joints[c.first];
    const OriginText& old = origin_text(rig_file.urdf, c.first);
    const Vector3d rpy = rpy_from_rotation(c.second.rotation);
    const bool moved = c.second.translation != joint.parent_T_joint.translation,
               turned = c.second.rotation != joint.parent_T_joint.rotation;
    const std::string xyz = moved ? three(c.second.translation) : old.xyz, angles = turned ? three(rpy) : old.rpy;
    Node name;
    name.kind = Node::Kind::scalar;
    name.text = joint.name;
    name.quoted = true;
    std::string key = to_yaml(name);
    while (!key.empty() && std::isspace(static_cast<unsigned char>(key.back()))) key.pop_back();
    out.changes_yaml += "  " + key + ":\n    old: {xyz: " + list_of(old.xyz) + ", rpy: " + list_of(old.rpy) +
                        "}\n    new: {xyz: " + list_of(xyz) + ", rpy: " + list_of(angles) + "}\n";
    robot[joint.name] = {{"offset", model.offsets[c.first]},
                         {"motion", motion_text(rig.tree, joint)},
                         {"old", exact_pose(joint.parent_T_joint)},
                         {"new", exact_pose(c.second)}};
  }
  if (!out.reductions.empty()) {
    out.changes_yaml += "transmissions:  # mechanicalReduction, old / scale\n";
    for (const Reduction& r : out.reductions)
      out.changes_yaml +=
          "  " + r.joint + ": {scale: " + shortest(r.scale) + ", old: " + shortest(r.before) + ", new: " + shortest(r.after) + "}\n";
  }

  out.rig_hash = sha256(rig_file.text);
  out.samples_hash = sha256(read_file(options.samples_path));
  out.urdf_hash = sha256(rig_file.urdf.text);
  Json json = {{"kincal", options.version},
               {"input", {{"command", options.command}, {"rig", out.rig_hash}, {"samples", out.samples_hash}, {"urdf", out.urdf_hash}}}};
  json.update(result_json(calibration, result));
  json["robot"] = {{"joints", robot}, {"mimics", Json::object()}, {"reductions", Json::object()}};
  for (const Joint& joint : rig.tree.joints)
    if (joint.moves() && joint.mimic) json["robot"]["mimics"][joint.name] = motion_text(rig.tree, joint);
  for (const Reduction& r : out.reductions)
    json["robot"]["reductions"][r.joint] = {{"scale", r.scale}, {"old", r.before}, {"new", r.after}, {"written", options.write_reduction}};
  out.result_json = json.dump(1) + "\n";

  out.covariance_csv = covariance_csv(result);
  if (options.residuals) out.residuals_csv = residuals_csv(calibration, result);
  return out;
}

void check_output(const std::string& directory, bool force) {
  static const std::vector<std::string> ours = {"robot.urdf",    "rig.yaml",   "result.json", "changes.yaml",  "covariance.csv",
                                                "residuals.csv", "batch.json", "report.html", "samples.jsonl", "truth.json"};
  std::error_code error;
  const fs::path path(plain_name(directory));
  if (!fs::exists(path, error)) {
    const fs::path parent = fs::absolute(path, error).lexically_normal().parent_path();
    if (!parent.empty() && !fs::is_directory(parent, error))
      throw InputError(directory + ": the folder " + parent.string() + " does not exist");
    return;
  }
  if (!force) throw InputError(directory + ": exists already; --force replaces a result, another --out keeps it");
  if (!fs::is_directory(path, error)) throw InputError(directory + ": is not a directory");
  for (const fs::directory_entry& entry : fs::directory_iterator(path, error))
    if (std::find(ours.begin(), ours.end(), entry.path().filename().string()) == ours.end())
      throw InputError(directory + ": --force would delete " + entry.path().filename().string() +
                       ", which is no file of kincal's: move it away or choose another --out");
}

bool write_results(const std::string& directory, const ResultFiles& files, bool force, bool (*go_on)(), const std::string& scratch) {
  const std::vector<std::pair<std::string, const std::string*>> all = {
      {"robot.urdf", &files.robot_urdf},         {"rig.yaml", &files.rig_yaml},
      {"result.json", &files.result_json},       {"changes.yaml", &files.changes_yaml},
      {"covariance.csv", &files.covariance_csv}, {"residuals.csv", &files.residuals_csv},
      {"batch.json", &files.batch_json}};
  std::vector<std::pair<std::string, std::string>> present;
  for (const auto& f : all)
    if ((f.first != "residuals.csv" && f.first != "batch.json") || !f.second->empty()) present.push_back({f.first, *f.second});
  return write_directory(directory, present, force, go_on, scratch);
}

bool write_directory(const std::string& directory, const std::vector<std::pair<std::string, std::string>>& files, bool force,
                     bool (*go_on)(), const std::string& scratch) {
  const std::string name = plain_name(directory), pid = std::to_string(getpid());
  const std::string beside = scratch.empty() ? name : (fs::path(scratch) / fs::path(name).filename()).string();
  const fs::path target(name), work(beside + ".writing-" + pid), old(beside + ".replaced-" + pid);
  std::error_code error, ignored;
  try {
    check_output(name, force);
    fs::remove_all(work, ignored);
    if (!fs::create_directory(work, error)) throw InputError(work.string() + ": cannot be made: " + error.message());
    for (const auto& f : files) write_whole(work / f.first, f.second);
    if (go_on && !go_on()) {
      fs::remove_all(work, ignored);
      return false;
    }
    const bool replace = fs::exists(target, ignored);
    if (replace) {
      fs::rename(target, old, error);
      if (error) throw InputError(name + ": cannot be replaced: " + error.message());
    }
    fs::rename(work, target, error);
    if (error) {
      if (replace) fs::rename(old, target, ignored);
      throw InputError(name + ": cannot be written: " + error.message());
    }
    fs::remove_all(old, ignored);
  } catch (...) {
    fs::remove_all(work, ignored);
    throw;
  }
  return true;
}

void write_file(const std::string& path, const std::string& text) {
  const fs::path work(path + ".writing-" + std::to_string(getpid()));
  std::error_code error, ignored;
  try {
    write_whole(work, text);
  } catch (...) {
    fs::remove(work, ignored);
    throw;
  }
  fs::rename(work, path, error);
  if (error) {
    fs::remove(work, ignored);
    throw InputError(path + ": cannot be written: " + error.message());
  }
}

std::string apply_result(const std::string& result_path, const Urdf& urdf, bool force) {
  constexpr double kSame = 1e-9;  // m and rad: written numbers carry 17 digits
  const std::string path = fs::is_directory(result_path) ? (fs::path(result_path) / "result.json").string() : result_path;
  const std::string text = read_file(path);
  const Node node = parse_json(text, path);
  const Field all = top(node, path);
  if (!all.has("robot") || !all["robot"].has("joints"))
    throw InputError(path + ": is no result of `kincal calibrate`: it has no robot.joints");
  if (!force && all["status"].string() != "converged")
    throw InputError(path + ": status: " + all["status"].string() + ": this result is not to be trusted; --force applies it all the same");
  const Field joints = all["robot"]["joints"], reductions = all["robot"]["reductions"];
  const auto apart = [](const Pose& a, const Pose& b) {
    return std::max((a.translation - b.translation).norm(), log_so3(a.rotation.transpose() * b.rotation).norm());
  };
  UrdfChanges changes;
  std::vector<Pose> origins;
  std::vector<double> offsets(urdf.tree.joints.size(), 0.0);
  for (const Joint& j : urdf.tree.joints) origins.push_back(j.parent_T_joint);
  for (size_t i = 0; i < all["robot"]["mimics"].size(); ++i) {  // followers of a changed joint must be followers here too
    const std::string& name = all["robot"]["mimics"].node->members[i].first;
    const int j = urdf.tree.find_joint(name);
    const std::string motion = j < 0 ? "absent" : motion_text(urdf.tree, urdf.tree.joints[j]);
    if (motion != all["robot"]["mimics"][name].string())
      throw InputError(urdf.path + ": joint '" + name + "' is not that of the calibrated robot: it is " + motion + ", there it is " +
                       all["robot"]["mimics"][name].string());
  }
  size_t held = 0;
  std::vector<std::string> names;
  for (const Joint& j : urdf.tree.joints) names.push_back(j.name);
  for (size_t i = 0; i < joints.size(); ++i) {
    const std::string& name = joints.node->members[i].first;
    const Field entry = joints[name];
    const int j = urdf.tree.find_joint(name);
    if (j < 0) throw InputError(urdf.path + ": has no joint '" + name + "', which the result changes" + nearest_names(name, names));
    const std::string motion = motion_text(urdf.tree, urdf.tree.joints[j]);
    if (motion != entry["motion"].string())
      throw InputError(urdf.path + ": joint '" + name + "' is not that of the calibrated robot: it is " + motion + ", there it is " +
                       entry["motion"].string());
    const Pose before = read_exact_pose(entry["old"]), after = read_exact_pose(entry["new"]);
    const double to_old = apart(urdf.tree.joints[j].parent_T_joint, before), to_new = apart(urdf.tree.joints[j].parent_T_joint, after);
    if (to_new <= kSame && to_new < to_old) {
      ++held;
    } else if (to_old > kSame) {
      throw InputError(urdf.path + ": the origin of joint '" + name + "' is not that of the calibrated robot (" + shortest(to_old) +
                       " m or rad away): the changes do not fit this robot");
    }
    changes.origins[j] = after;
    origins[j] = after;
    offsets[j] = entry["offset"].number();
  }
  for (size_t i = 0; i < reductions.size(); ++i) {
    const std::string& name = reductions.node->members[i].first;
    if (!reductions[name]["written"].boolean()) continue;
    for (const Transmission& t : urdf.transmissions)
      if (t.joint == name) changes.reductions[name] = reductions[name]["new"].number();
  }
  if (held == joints.size() && held > 0) throw InputError(urdf.path + ": holds the changes of " + path + " already");
  if (held > 0)
    throw InputError(urdf.path + ": holds " + std::to_string(held) + " of the " + std::to_string(joints.size()) + " changes of " + path +
                     " already");
  const std::string out = edit_urdf(urdf, changes);
  // The written origins hold the offsets: take these out of them again, so that the proof compares file and model as in a calibration.
  std::vector<double> back(offsets.size());
  for (size_t j = 0; j < offsets.size(); ++j) back[j] = -offsets[j];
  prove_urdf(out, urdf, fold_offsets(urdf.tree, origins, back), offsets);
  return out;
}

}  // namespace kincal
