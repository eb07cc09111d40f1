#include "local_file.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "../document/files.h"
#include "../document/json.h"
#include "../document/names.h"
#include "../document/yaml.h"
#include "json_values.h"

namespace kincal {
namespace {

int find_joint(const Tree& tree, const std::string& name, const std::string& where) {
  const int joint = tree.find_joint(name);
  std::vector<std::string> names;
  for (const Joint& j : tree.joints)
    if (j.has_reading()) names.push_back(j.name);
  if (joint < 0)
    throw InputError(where + ": unknown joint '" + name + "'" + nearest_names(name, names));
  if (!tree.joints[joint].has_reading())
    throw InputError(where + ": joint '" + name + "' " +
                     (tree.joints[joint].mimic ? "follows another one" : "does not move"));
  return joint;
}

LocalPosture posture_of_list(const std::string& text, const Rig& rig) {
  const std::string where = "--near";
  LocalPosture out;
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find(',', begin), text.size());
    const std::string part = text.substr(begin, end - begin);
    const size_t equals = part.find('=');
    if (equals == std::string::npos || equals == 0)
      throw InputError(where + ": joint=value,joint=value is expected, not '" + part + "'");
    const Node value = scalar_node(part.substr(equals + 1));
    const int joint = find_joint(rig.tree, part.substr(0, equals), where);
    if (!out.emplace(joint, Field{&value, &where, part.substr(0, equals)}.number()).second)
      throw InputError(where + ": joint '" + part.substr(0, equals) + "' occurs twice");
    begin = end + 1;
  }
  return out;
}

LocalPosture posture_of_file(const std::string& path, const Rig& rig) {
  const Node node = parse_yaml(read_file(path), path);
  const Field field = top(node, path);
  if (node.kind != Node::Kind::mapping || node.members.empty())
    field.fail("a mapping of joints to positions is expected");
  LocalPosture out;
  for (const auto& [name, value] : node.members) {
    const Field position{&value, &path, name};
    out[find_joint(rig.tree, name, position.where())] = position.number();
  }
  return out;
}

Json rms(const SplitStatistics& s, bool measures_pose) {
  Json out = {
      {"points", s.points}, {"before", number(s.rms_before)}, {"after", number(s.rms_as_read)}};
  if (measures_pose) {
    out["rotation_before"] = number(s.rotation_before);
    out["rotation_after"] = number(s.rotation_as_read);
  }
  return out;
}

Json json_of(const Rig& rig, const LocalPosture& posture, const LocalCalibration& local,
             const LocalSource& source) {
  Json out = {{"format", "kincal-local/1"},
              {"kincal", source.version},
              {"input",
               {{"command", source.command},
                {"rig", source.rig_hash},
                {"samples", source.samples_hash},
                {"urdf", source.urdf_hash}}},
              {"near", source.near},
              {"posture", Json::object()},
              {"gain", local.gain}};
  for (const auto& [joint, at] : posture) out["posture"][rig.tree.joints[joint].name] = number(at);
  out["radius"] = local.gain ? number(local.radius) : Json(nullptr);
  out["radius_ends"] = local.gain ? Json(local.ends) : Json(nullptr);
  out["judged_within"] = number(local.radius);
  out["samples"] = local.samples;
  out["nearest"] = number(local.distances.front());
  out["bandwidth"] = number(local.bandwidth);
  out["prior"] = number(local.prior);
  out["noise"] = number(local.noise);
  out["chi2"] = {{"before", number(local.chi2_before)},
                 {"after", number(local.chi2)},
                 {"gain_sigma", number(local.gain_sigma)}};
  out["significance"] = number(local.significance);
  out["not_converged"] = local.not_converged;
  out["offsets"] = Json::object();
  for (const LocalOffset& o : local.offsets) {
    const Joint& joint = rig.tree.joints[o.joint];
    Json one = {{"offset", number(o.offset)},
                {"unit", joint.type == JointType::prismatic ? "m" : "rad"}};
    if (!std::isfinite(o.offset))
      one["unknown"] = "no sample within the bandwidth depends on this joint";
    if (local.gain) {
      one["sigma"] = number(o.sigma);
      one["variation"] = number(o.variation);
      one["determined"] = o.determined;
    }
    out["offsets"][joint.name] = one;
  }
  out["sensors"] = Json::object();
  for (const SensorResult& s : local.sensors) {
    out["sensors"][s.name] = {{"unit", s.unit}, {"left_out", rms(s.train, s.measures_pose)}};
    if (s.test.points > 0) out["sensors"][s.name]["held_out"] = rms(s.test, s.measures_pose);
  }
  return out;
}

/// Words as YAML has them.
void unquote(Node& node) {
  for (auto& [key, value] : node.members) {
    if (key == "format" || key == "unit") value.quoted = false;
    unquote(value);
  }
}

}  // namespace

LocalPosture read_local_posture(const std::string& text, const Rig& rig,
                                const std::vector<Sample>& samples) {
  std::vector<std::string> ids;
  for (const Sample& s : samples) {
    if (s.id == text) {
      LocalPosture posture = posture_of(rig, s);
      if (posture.empty())
        throw InputError("--near: no view of sample '" + text + "' depends on a joint");
      return posture;
    }
    ids.push_back(s.id);
  }
  std::error_code ignored;
  if (std::filesystem::is_regular_file(text, ignored)) return posture_of_file(text, rig);
  if (text.find('=') != std::string::npos) return posture_of_list(text, rig);
  throw InputError("--near: '" + text + "' is not the id of a sample, a file or joint=value,..." +
                   nearest_names(text, ids));
}

std::string local_json(const Rig& rig, const LocalPosture& posture, const LocalCalibration& local,
                       const LocalSource& source) {
  return json_text(json_of(rig, posture, local, source));
}

std::string local_yaml(const Rig& rig, const LocalPosture& posture, const LocalCalibration& local,
                       const LocalSource& source) {
  const std::string comment =
      local.gain
          ? "# Joint offsets around one posture: position = scale * reading + the rig's offset + "
            "this.\n"
            "# Use only around this posture (`radius`: largest difference of a joint, rad or m).\n"
            "# Do not fold into the URDF, which is for the whole workspace.\n"
          : "# No local offsets: the global calibration is as good here (`gain: false`). "
            "Offsets are 0.\n"
            "# Of this posture only; do not fold into the URDF.\n";
  Node node = parse_json(json_text(json_of(rig, posture, local, source)), "local.yaml");
  unquote(node);
  return comment + to_yaml(node);
}

}  // namespace kincal
