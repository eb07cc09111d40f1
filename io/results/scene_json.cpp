#include "scene_json.h"

#include <algorithm>
#include <map>

#include "../../kinematics/floating.h"
#include "../../models/rig/selection.h"
#include "../../models/rig/targets.h"
#include "../document/numbers.h"
#include "../urdf/boxes.h"

namespace kincal {
namespace {

constexpr Eigen::Index kDrawnPoints = 500;  // of a target: enough to see what it is

Json seven(const Pose& p) {
  const std::array<double, 7> n = pose_numbers(p);
  return numbers(std::vector<double>(n.begin(), n.end()));
}

/// The links from the root outwards.
std::vector<int> links_in_order(const Tree& tree) {
  std::vector<int> out = {tree.root};
  for (size_t i = 0; i < out.size(); ++i)
    for (const Joint& joint : tree.joints)
      if (joint.parent == out[i]) out.push_back(joint.child);
  return out;
}

/// The origins with the joints' offsets in them, so that position = scale * reading.
std::vector<Pose> origins_at(const Solution& solution, const VectorXd& values) {
  const Tree& tree = solution.rig().tree;
  const ParameterTable& table = solution.table();
  std::vector<Pose> origins(tree.joints.size());
  std::vector<double> offsets(tree.joints.size(), 0);
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    origins[j] = get_pose(values, table.all[table.joint_origin[j]].start);
    if (table.joint_offset[j] >= 0) offsets[j] = values(table.all[table.joint_offset[j]].start);
  }
  return fold_offsets(tree, origins, offsets);
}

/// Adds what is known of a joint.
void add_joint(const Solution& solution, int j, Json& out) {
  const Rig& rig = solution.rig();
  const Joint& joint = rig.tree.joints[j];
  out["joint"] = joint.name;
  out["type"] = type_name(joint.type);
  if (!joint.has_axis()) return;
  out["axis"] = vector3(joint.axis);
  if (joint.lower != joint.upper) out["limits"] = numbers({joint.lower, joint.upper});
  if (joint.mimic)
    out["mimic"] = {{"joint", rig.tree.joints[joint.mimic->master].name},
                    {"multiplier", number(joint.mimic->multiplier)},
                    {"offset", number(joint.mimic->offset)}};
  const int scale = joint.has_reading() ? solution.table().joint_scale[j] : -1;
  if (scale >= 0) {
    const int start = solution.table().all[scale].start;
    const double before = solution.initial(start), after = solution.values.shared(start);
    if (before != 1 || after != 1) out["scale"] = numbers({before, after});
  }
}

/// Adds what a sensor and a mounted target have: their poses on a link, and how well they are
/// known. `open`: poses that the rig does not give.
void add_mount(const Report& report, const std::vector<int>& open, int link_index, int parameter,
               Json& out) {
  const Solution& solution = report.solution;
  const bool given = std::count(open.begin(), open.end(), parameter) == 0;
  const int start = solution.table().all[parameter].start;
  out["link"] = link_index;
  out["before"] = given ? seven(get_pose(solution.initial, start)) : Json(nullptr);
  out["after"] = seven(get_pose(solution.values.shared, start));
  const auto c = report.position_covariances.find(parameter);
  if (c != report.position_covariances.end()) {
    const Matrix3d& m = c->second;
    out["covariance"] = numbers({m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)});
  }
}

}  // namespace

Json scene_json(const Report& report, const Urdf& urdf) {
  const Solution& solution = report.solution;
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  const VectorXd& estimated = solution.values.shared;
  const std::vector<int> order = links_in_order(rig.tree), open = open_poses(rig, table);
  std::vector<int> place(rig.tree.links.size(), -1);  // of a link, in the list
  for (size_t i = 0; i < order.size(); ++i) place[order[i]] = static_cast<int>(i);

  const std::vector<Pose> before = origins_at(solution, solution.initial),
                          after = origins_at(solution, estimated);
  const LinkBoxes boxes = link_boxes(urdf);
  std::map<std::string, size_t> written;  // index of a link in the URDF, where none is opened
  for (size_t i = 0; i < urdf.tree.links.size(); ++i) written[urdf.tree.links[i]] = i;
  Json links = Json::array(), sensors = Json::array(), targets = Json::array();
  for (const int l : order) {
    const int j = rig.tree.joint_above[l];
    Json one = {{"name", rig.tree.links[l]},
                {"parent", j < 0 ? -1 : place[rig.tree.joints[j].parent]}};
    if (is_between_axes(rig.tree, l)) one["between_axes"] = true;
    if (j >= 0) {
      add_joint(solution, j, one);
      one["before"] = seven(before[j]);
      one["after"] = seven(after[j]);
    }
    if (const auto at = written.find(rig.tree.links[l]); at != written.end())
      for (const LinkBox& box : boxes.of[at->second])
        one["boxes"].push_back({{"pose", seven(box.link_T_box)}, {"size", vector3(box.size)}});
    links.push_back(std::move(one));
  }
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    Json one = {{"name", sensor.name}, {"type", sensor.type}};
    add_mount(report, open, place[sensor.link], table.sensor_pose[s], one);
    if (sensor.image_width > 0)
      one["image_size"] = Json::array({sensor.image_width, sensor.image_height});
    const auto own = [&](ParameterKind kind, const char* name) {
      const int p = table.index_of(kind, static_cast<int>(s));
      if (p < 0) return;
      const double* v = estimated.data() + table.all[p].start;
      one[name] = numbers(std::vector<double>(v, v + table.all[p].size()));
    };
    own(ParameterKind::intrinsics, "intrinsics");
    own(ParameterKind::baseline, "baseline");
    sensors.push_back(std::move(one));
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const Target& target = rig.targets[t];
    Json one = {{"name", target.name}, {"type", target.type}};
    if (target.link >= 0)
      add_mount(report, open, place[target.link], table.target_pose[t], one);
    else
      one["link"] = -1;
    const Matrix3Xd points = target_points(rig, table, estimated, static_cast<int>(t));
    one["points"] = Json::array();
    for (Eigen::Index i = 0; i < std::min<Eigen::Index>(points.cols(), kDrawnPoints); ++i)
      one["points"].push_back(vector3(points.col(i)));
    targets.push_back(std::move(one));
  }
  Json out = {{"robot", urdf.robot},
              {"base", place[rig.base]},
              {"links", std::move(links)},
              {"sensors", std::move(sensors)},
              {"targets", std::move(targets)}};
  if (boxes.left_out > 0) out["meshes_left_out"] = boxes.left_out;
  return out;
}

}  // namespace kincal
