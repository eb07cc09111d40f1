#include "observation_index.h"

#include <algorithm>

namespace kincal {

Hypothesis mirrored_points(const std::string& clause, int axis, const std::string& owner,
                           const std::string& place) {
  return {NoticeKind::mirrored,
          {},
          clause + ": its axes are left-handed, or one has the wrong sign",
          std::string("change the sign of ") + "xyz"[axis] + " (or of another one, and turn the " +
              owner + "'s pose accordingly) in " + place};
}

Undo of_views(int sensor, std::function<void(const Rig&, View&)> change) {
  return [sensor, change = std::move(change)](Rig& rig, std::vector<Sample>& samples) {
    for (Sample& sample : samples)
      for (View& v : sample.views)
        if (sensor < 0 || v.sensor == sensor) change(rig, v);
  };
}

Undo of_numbers(int sensor, size_t first, size_t stride, std::function<double(double)> change) {
  return of_views(sensor, [=, change = std::move(change)](const Rig&, View& v) {
    for (size_t i = first; i < v.z.size(); i += stride) v.z[i] = change(v.z[i]);
  });
}

Subjects all_sensors(const Rig& rig, const std::set<int>& sensors) {
  Subjects out;
  for (const int s : sensors) out.push_back(Subject::sensor(rig.sensors[s].name));
  return out;
}

int immobile_body(const Tree& tree, int link) {
  while (tree.joint_above[link] >= 0 && !tree.joints[tree.joint_above[link]].moves())
    link = tree.joints[tree.joint_above[link]].parent;
  return link;
}

ObservationIndex make_observation_index(const Rig& rig, const std::vector<Sample>& samples) {
  ObservationIndex out;
  std::map<std::pair<int, int>, std::vector<int>> joints;
  for (size_t i = 0; i < samples.size(); ++i)
    for (const View& v : samples[i].views) {
      const std::pair<int, int> pair(v.sensor, v.target);
      if (out.pairs.insert(pair).second) joints[pair] = joints_between(rig, v);
      out.sensors.insert(v.sensor);
      out.targets.insert(v.target);
      const auto add = [&](int joint, double reading) {
        const auto range = out.ranges.insert({joint, {reading, reading}}).first;
        range->second = {std::min(range->second.first, reading),
                         std::max(range->second.second, reading)};
      };
      for (int joint : joints[pair]) {
        out.samples[joint].insert(static_cast<int>(i));
        if (rig.tree.joints[joint].floating >= 0) {
          out.floating.insert(rig.tree.joints[joint].floating);
          continue;
        }
        if (rig.sensors[v.sensor].scanning_joint != joint)
          add(joint, samples[i].readings[joint]);
        else
          for (size_t k = 0; k + 2 < v.z.size(); k += 3) add(joint, v.z[k]);
      }
    }
  return out;
}

}  // namespace kincal
