#include "configuration.h"

#include <algorithm>
#include <cmath>

#include "elasticity.h"
#include "numbers.h"

namespace kincal {

void Configuration::bend_joints() {
  auto bent = std::make_shared<BentPosture>();
  const Skeleton& skeleton = *rig_->elasticity->skeleton;
  bent->resize(skeleton);
  set_elasticity(*rig_, *table_, *values_, conditions_->payload, *bent);
  for (size_t j = 0; j < rig_->tree.joints.size(); ++j) {
    const int joint = static_cast<int>(j);
    bent->origin[j] = origin(joint).rotation;
    const double q = stands_for_balance(*rig_, *readings_, joint) ? 0 : position(joint);
    bent->motion[j] = joint_motion(rig_->tree.joints[j], q).rotation;
  }
  if (!bend(skeleton, *bent))
    for (Matrix3d& b : bent->bend) b.setConstant(kNan);
  bent_ = std::move(bent);
}

Matrix3d Configuration::bend_of(int joint) const {
  const int i = bent_ ? rig_->elasticity->skeleton->index[joint] : -1;
  return i < 0 ? Matrix3d(Matrix3d::Identity()) : bent_->bend[i];
}

double Configuration::position(int joint) const {
  const Joint& asked = rig_->tree.joints[joint];
  if (!asked.moves()) return asked.stands_at.value_or(0);
  const Driver d = driver(rig_->tree, joint);
  return d.factor * position_of(
                        *rig_, d.joint, [this](int j) { return reading(j); }, own_numbers(d.joint),
                        conditions(d.joint)) +
         d.offset;
}

Pose Configuration::a_T_b(int a, int b) const {
  Pose a_T_from;
  for (const PathStep& step : find_path(rig_->tree, a, b)) {
    Pose a_T_joint, a_T_to;
    walk(step, origin(step.joint), motion(step.joint), a_T_from, a_T_joint, a_T_to);
    a_T_from = a_T_to;
  }
  return a_T_from;
}

MeasuringTime time_of(const Rig& rig, const View& view) {
  MeasuringTime out{view.sensor};
  if (!rig.sensors[view.sensor].line_time || view.z.empty()) return out;
  for (size_t i = 1; i < view.z.size(); i += 2) out.row += view.z[i];
  out.row /= static_cast<double>(view.z.size()) / 2;
  return out;
}

std::vector<int> joints_between(const Rig& rig, int a, int b, int except) {
  std::vector<int> out;
  for (const PathStep& step : find_path(rig.tree, a, b)) {
    if (!rig.tree.joints[step.joint].moves()) continue;
    for_each_reading(rig, driver(rig.tree, step.joint).joint, [&](int joint) {
      if (joint != except && std::find(out.begin(), out.end(), joint) == out.end())
        out.push_back(joint);
    });
  }
  return out;
}

std::vector<int> joints_between(const Rig& rig, const View& view) {
  const Target& target = rig.targets[view.target];
  return joints_between(rig, rig.sensors[view.sensor].link,
                        target.link < 0 ? rig.base : target.link);
}

std::vector<int> needed_readings(const Rig& rig, int sensor, int target) {
  std::vector<int> needed;
  if (sensor >= 0)
    needed =
        joints_between(rig, rig.base, rig.sensors[sensor].link, rig.sensors[sensor].scanning_joint);
  if (target >= 0 && rig.targets[target].link >= 0)
    for (int joint : joints_between(rig, rig.base, rig.targets[target].link))
      if (std::find(needed.begin(), needed.end(), joint) == needed.end()) needed.push_back(joint);
  return needed;
}

std::vector<int> view_readings(const Rig& rig, int sensor, int target) {
  const int link = rig.targets[target].link, scanning = rig.sensors[sensor].scanning_joint;
  if (link < 0) return needed_readings(rig, sensor, target);
  const std::vector<int> all = joints_between(rig, rig.sensors[sensor].link, link);
  if (scanning >= 0 && std::find(all.begin(), all.end(), scanning) == all.end())
    return needed_readings(rig, sensor, target);
  return joints_between(rig, rig.sensors[sensor].link, link, scanning);
}

std::vector<double> completed(std::vector<double> readings) {
  for (double& reading : readings)
    if (std::isnan(reading)) reading = 0;
  return readings;
}

bool has_readings(const Rig& rig, int link, const std::vector<double>& readings) {
  for (int joint : joints_between(rig, rig.base, link))
    if (!std::isfinite(readings[joint])) return false;
  return true;
}

}  // namespace kincal
