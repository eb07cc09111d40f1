#include "moving_groups.h"

#include <algorithm>
#include <set>

#include "../rig/selection.h"

namespace kincal {
namespace {

class MovingGroups {
 public:
  MovingGroups(const Rig& rig, const ParameterTable& table, const std::vector<Component>& estimated)
      : rig_(rig), table_(table), estimated_(estimated) {}

  std::vector<std::pair<std::string, std::vector<Component>>> make() {
    for (size_t s = 0; s < rig_.sensors.size(); ++s) {
      if (alone_below_origin(static_cast<int>(s)))
        used_.insert(table_.sensor_mount[s]);  // the origin is its mount
      else
        add_parameter(table_.sensor_mount[s]);
      add_own(static_cast<int>(s));
      add_joints(rig_.sensors[s].link);
      add_carrier(rig_.sensors[s].link, table_.sensor_mount[s]);
    }
    for (size_t t = 0; t < rig_.targets.size(); ++t) {
      if (rig_.targets[t].link < 0) continue;
      add_parameter(table_.target_mount[t]);
      add_joints(rig_.targets[t].link);
      add_carrier(rig_.targets[t].link, table_.target_mount[t]);
    }
    for (const int j : joints_) add_parameter(table_.joint_offset[j]);
    return std::move(groups_);
  }

 private:
  bool estimated(int parameter) const {
    return std::any_of(estimated_.begin(), estimated_.end(),
                       [&](const Component& c) { return c.parameter == parameter; });
  }
  /// Returns the joint with an estimated origin that carries a link, with nothing that moves
  /// between; -1: none.
  int carrier(int link) const {
    for (int j = rig_.tree.joint_above[link]; j >= 0;
         j = rig_.tree.joint_above[rig_.tree.joints[j].parent]) {
      if (estimated(table_.joint_origin[j])) return j;
      if (!rig_.tree.joints[j].is_rigid()) break;
    }
    return -1;
  }
  bool alone_below_origin(int sensor) const {
    const int joint = carrier(rig_.sensors[sensor].link);
    if (joint < 0 || estimated(table_.sensor_mount[sensor])) return false;
    return std::count_if(rig_.sensors.begin(), rig_.sensors.end(),
                         [&](const Sensor& other) { return carrier(other.link) == joint; }) == 1;
  }
  /// An estimated origin that stands for the mount of what is on a link. (Other origins are lengths
  /// of the robot, which do not change from one sample to the next.)
  void add_carrier(int link, int mount) {
    const int joint = carrier(link);
    if (joint >= 0 && !estimated(mount)) add_parameter(table_.joint_origin[joint]);
  }
  void add_joints(int link) {
    for (const PathStep& step : find_path(rig_.tree, rig_.base, link)) {
      const int reading = driver(rig_.tree, step.joint).joint;
      if (table_.joint_offset[reading] >= 0 && !table_.all[table_.joint_offset[reading]].hidden())
        joints_.insert(reading);
    }
  }
  void add_parameter(int p) {
    if (p < 0 || table_.all[p].hidden() || !used_.insert(p).second) return;
    groups_.push_back({table_.all[p].name, components_of({whole(table_, p)})});
  }
  /// A lens is one group; every other block of a sensor's own numbers is one by itself.
  void add_own(int s) {
    std::vector<Component> lens;
    for (size_t b = 0; b < rig_.sensors[s].parameters.size(); ++b) {
      const int p = table_.sensor_block[s] + static_cast<int>(b);
      const ParameterKind kind = table_.all[p].kind;
      if (kind != ParameterKind::intrinsics && kind != ParameterKind::distortion) {
        add_parameter(p);
        continue;
      }
      for (const Component& c : components_of({whole(table_, p)})) lens.push_back(c);
      used_.insert(p);
    }
    if (!lens.empty())
      groups_.push_back({"sensor/" + rig_.sensors[s].name + "/intrinsics", std::move(lens)});
  }

  const Rig& rig_;
  const ParameterTable& table_;
  const std::vector<Component>& estimated_;
  std::set<int> joints_, used_;
  std::vector<std::pair<std::string, std::vector<Component>>> groups_;
};

}  // namespace

std::vector<std::pair<std::string, std::vector<Component>>> moving_groups(
    const Rig& rig, const ParameterTable& table, const std::vector<Component>& estimated) {
  return MovingGroups(rig, table, estimated).make();
}

Followed followed(const Rig& rig, const ParameterTable& table,
                  const std::vector<Component>& estimated) {
  Followed out;
  out.groups = moving_groups(rig, table, estimated);
  const auto free = [&](const Component& c) {
    const Parameter& p = table.all[c.parameter];
    merge(out.free, {p.pose ? whole(table, c.parameter) : Freed{c.parameter, {c.index}}});
  };
  for (const Component& c : estimated) free(c);
  for (const auto& group : out.groups)
    for (const Component& c : group.second) free(c);
  out.columns = components_of(out.free);
  return out;
}

}  // namespace kincal
