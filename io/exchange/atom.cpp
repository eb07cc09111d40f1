#include "atom.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include "../document/document.h"
#include "../document/files.h"
#include "../document/names.h"
#include "../results/json_values.h"
#include "foreign.h"
#include "number_lists.h"

namespace kincal {
namespace {

/// Poses of frames by the names of their parents: child, parent_T_child.
struct Frames {
  std::map<std::string, std::pair<std::string, Pose>> parent_of;
};

Frames frames_of(const Field& transforms) {
  Frames out;
  for (const auto& [key, node] : transforms.members()) {
    const Field one = transforms[key];
    const std::vector<double> t = one["trans"].vector(3), q = one["quat"].vector(4);
    const Eigen::Vector4d xyzw(q[0], q[1], q[2], q[3]);
    if (!(std::abs(xyzw.norm() - 1) < 1e-2))
      one["quat"].fail("a quaternion of length 1 is expected, not of " +
                       std::to_string(xyzw.norm()));
    out.parent_of[one["child"].string()] = {
        one["parent"].string(), {rotation_from_quaternion(xyzw), Vector3d(t[0], t[1], t[2])}};
  }
  return out;
}

/// Returns base_T_frame; empty where the frame does not hang on the base.
std::optional<Pose> pose_in(const Frames& frames, const std::string& base, std::string frame) {
  Pose out;
  for (size_t steps = 0; frame != base; ++steps) {
    const auto above = frames.parent_of.find(frame);
    if (above == frames.parent_of.end() || steps > frames.parent_of.size()) return std::nullopt;
    out = above->second.second * out;
    frame = above->second.first;
  }
  return out;
}

template <class Thing>
const Thing* named(const std::vector<Thing>& all, const std::string& name) {
  for (const Thing& one : all)
    if (one.name == name) return &one;
  return nullptr;
}

Json joints_of(const Field& collection, const Rig& rig) {
  Json out = Json::object();
  for (const Joint& joint : rig.tree.joints) {
    if (joint.type == JointType::floating && joint.name == "flange") {
      const std::string &base = rig.tree.links[joint.parent], &tip = rig.tree.links[joint.child];
      const Field transforms = collection["transforms"];
      const std::optional<Pose> at = pose_in(frames_of(transforms), base, tip);
      if (!at)
        transforms.fail("no transforms lead from '" + base + "' to '" + tip +
                        "', the rig's base and flange");
      out[joint.name] = pose(*at);
    } else if (joint.has_reading() && collection.has("joints") &&
               collection["joints"].has(joint.name)) {
      const Field reading = collection["joints"][joint.name];
      out[joint.name] =
          (reading.node->kind == Node::Kind::mapping ? reading["position"] : reading).number();
    }
  }
  return out;
}

/// What one camera saw of one pattern; null: nothing, or the label is not of a camera.
Json view_of(const Field& label, const std::string& sensor, const std::string& target) {
  if (!label.has("detected") || !label["detected"].boolean() || !label.has("idxs")) return {};
  const Field corners = label["idxs"];
  Json ids = Json::array(), pixels = Json::array();
  for (size_t i = 0; i < corners.size(); ++i) {
    const Field corner = corners.item(i);
    if (corner.node->kind != Node::Kind::mapping) return {};
    ids.push_back(corner["id"].integer(0, 1000000));
    pixels.push_back({corner["x"].number(), corner["y"].number()});
  }
  if (ids.empty()) return {};
  return {{"sensor", sensor}, {"target", target}, {"ids", ids}, {"pixels", pixels}};
}

std::string quoted_list(const std::set<std::string>& names) {
  return comma_separated({names.begin(), names.end()});
}

}  // namespace

bool is_atom(const std::string& path) {
  if (!has_number_lists(read_file(path), path)) return false;
  const Node node = read_any_tree(path);
  return node.find("collections") && node.find("calibration_config");
}

std::string atom_lines(const std::string& path, const Rig& rig, std::vector<std::string>& notes) {
  const Node node = read_any_tree(path);
  const Field collections = top(node, path)["collections"];
  std::set<std::string> unknown_sensors, unknown_targets, no_cameras;
  std::string out;
  size_t views = 0;
  for (const auto& [id, collection_node] : collections.members()) {
    const Field collection = collections[id];
    Json line = {{"id", id}, {"joints", joints_of(collection, rig)}, {"views", Json::array()}};
    const Field labels = collection["labels"];
    for (const auto& [pattern, pattern_node] : labels.members())
      for (const auto& [sensor, label_node] : labels[pattern].members()) {
        if (!named(rig.sensors, sensor)) unknown_sensors.insert(sensor);
        if (!named(rig.targets, pattern)) unknown_targets.insert(pattern);
        if (!named(rig.sensors, sensor) || !named(rig.targets, pattern)) continue;
        if (named(rig.sensors, sensor)->type != "camera") {
          no_cameras.insert(sensor);
          continue;
        }
        if (Json view = view_of(labels[pattern][sensor], sensor, pattern); !view.is_null())
          line["views"].push_back(std::move(view));
      }
    views += line["views"].size();
    if (!line["views"].empty()) out += line.dump() + "\n";
  }
  if (!unknown_sensors.empty())
    notes.push_back("the rig has no sensors of these names, their labels are left out: " +
                    quoted_list(unknown_sensors));
  if (!unknown_targets.empty())
    notes.push_back("the rig has no targets of these names, their labels are left out: " +
                    quoted_list(unknown_targets));
  if (!no_cameras.empty())
    notes.push_back("the labels of these sensors are not pixels and are left out: " +
                    quoted_list(no_cameras));
  if (views == 0)
    throw InputError(path + ": no label matches a camera and a target of the rig; the data set " +
                     "has the sensors " + quoted_list(unknown_sensors) + " and the patterns " +
                     quoted_list(unknown_targets) + ": use the same names in the rig");
  return out;
}

}  // namespace kincal
