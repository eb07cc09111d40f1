#include "camera_groups.h"

#include <algorithm>
#include <map>
#include <utility>

#include "../fitting/closed_form.h"
#include "../rig/configuration.h"
#include "../rig/geometry.h"
#include "../rig/targets.h"

namespace kincal {
namespace {

constexpr int kFewestPoints = 4;  // of a view: fewer determine no pose

/// Whether a view tells the pose of its board.
bool determines_pose(const Rig& rig, const View& view) {
  const Target& target = rig.targets[view.target];
  const std::vector<int> ids = view_ids(view, target);
  return static_cast<int>(ids.size()) >= kFewestPoints &&
         !on_a_line(select_columns(target_points(target), ids));
}

}  // namespace

Rig without_robot(Rig rig) {
  for (Target& target : rig.targets) {
    target.link = target.mount_joint = -1;
    target.link_T_target = Pose();
    target.pose_given = false;
  }
  for (Sensor& sensor : rig.sensors) {
    sensor.link = rig.base;
    sensor.mount_joint = sensor.pose_of = -1;
  }
  return rig;
}

bool has_lens(const Sensor& sensor) {
  return sensor.type == "camera" && find_block(sensor, ParameterKind::intrinsics);
}

Rig bench(const Rig& rig, const std::vector<int>& cameras) {
  Rig out;
  out.tree.links = {"base"};
  finish_tree(out.tree);
  out.targets = without_robot(rig).targets;
  for (int camera : cameras) {
    out.sensors.push_back(rig.sensors[camera]);
    Sensor& sensor = out.sensors.back();
    sensor.link = 0;
    sensor.mount_joint = -1;
    sensor.link_T_sensor = Pose();
    sensor.pose_given = out.sensors.size() == 1;
  }
  return out;
}

std::vector<Sample> seen_by(const Rig& rig, const std::vector<Sample>& samples,
                            const std::vector<int>& cameras) {
  std::vector<Sample> out;
  for (const Sample& sample : samples) {
    Sample kept;
    kept.id = sample.id;
    for (const View& view : sample.views) {
      const auto camera = std::find(cameras.begin(), cameras.end(), view.sensor);
      if (camera == cameras.end() || !determines_pose(rig, view)) continue;
      kept.views.push_back(view);
      kept.views.back().sensor = static_cast<int>(camera - cameras.begin());
    }
    if (sample.train && !kept.views.empty()) out.push_back(std::move(kept));
  }
  return out;
}

std::vector<const View*> camera_views(const std::vector<Sample>& samples, int sensor) {
  std::vector<const View*> out;
  for (const Sample& sample : samples)
    for (const View& view : sample.views)
      if (view.sensor == sensor) out.push_back(&view);
  return out;
}

std::vector<std::vector<int>> camera_groups(const Rig& rig, const std::vector<Sample>& samples,
                                            const std::vector<int>& cameras) {
  std::vector<int> leader(rig.sensors.size());
  for (size_t s = 0; s < leader.size(); ++s) leader[s] = static_cast<int>(s);
  const auto find = [&](int s) {
    while (leader[s] != s) s = leader[s];
    return s;
  };
  for (const Sample& sample : samples)
    for (const View& a : sample.views)
      for (const View& b : sample.views)
        if (a.target == b.target && sample.train && has_lens(rig.sensors[a.sensor]) &&
            has_lens(rig.sensors[b.sensor]) && determines_pose(rig, a) && determines_pose(rig, b) &&
            body_of(rig.tree, rig.sensors[a.sensor].link) ==
                body_of(rig.tree, rig.sensors[b.sensor].link)) {
          const int x = find(a.sensor), y = find(b.sensor);
          leader[std::max(x, y)] = std::min(x, y);
        }
  std::map<int, std::vector<int>> groups;
  for (int camera : cameras) groups[find(camera)].push_back(camera);
  std::vector<std::vector<int>> out;
  for (auto& group : groups) out.push_back(std::move(group.second));
  return out;
}

}  // namespace kincal
