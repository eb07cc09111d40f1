#include "elasticity.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace kincal {
namespace {

constexpr int kMassesThatCount = 3;
constexpr double kRod = 1;  // kg

Matrix3d root_R_base(const Rig& rig) {
  Pose root_T_base;
  for (const PathStep& step : find_path(rig.tree, rig.tree.root, rig.base)) {
    const Joint& joint = rig.tree.joints[step.joint];
    if (!joint.is_rigid())
      throw std::invalid_argument(
          "elasticity: joint '" + joint.name + "' moves the base '" + rig.tree.links[rig.base] +
          "': the direction of gravity changes; choose a base that does not move");
    root_T_base = root_T_base * pose_at_zero(joint);
  }
  return root_T_base.rotation;
}

/// First moments of what joints carry, from the tips inwards.
class Loads {
 public:
  explicit Loads(const Rig& rig)
      : rig_(rig),
        rods_(std::count_if(rig.masses.begin(), rig.masses.end(),
                            [](const LinkMass& m) { return m.mass > 0; }) < kMassesThatCount),
        moment_(rig.tree.joints.size(), Vector3d::Zero()) {
    add(rig.tree.root, Pose(), nullptr);
  }
  std::vector<Vector3d> take() { return std::move(moment_); }

 private:
  /// Adds a link that stands at `at` in the body whose moment that is; the mass with all behind.
  double add(int link, const Pose& at, Vector3d* moment) {
    double mass = 0;
    if (!rods_ && link < static_cast<int>(rig_.masses.size())) {
      mass = rig_.masses[link].mass;
      if (moment) *moment += mass * (at * rig_.masses[link].centre);
    }
    for (size_t j = 0; j < rig_.tree.joints.size(); ++j) {
      const Joint& joint = rig_.tree.joints[j];
      if (joint.parent != link) continue;
      if (joint.is_rigid() || !joint.has_axis()) {
        mass += add(joint.child, at * pose_at_zero(joint), moment);
        continue;
      }
      double behind = add(joint.child, Pose(), &moment_[j]);
      behind += end_rod(joint.child, moment_[j]);
      const Vector3d there = at * joint.parent_T_joint.translation;
      if (moment) *moment += (behind + (rods_ ? kRod / 2 : 0)) * there;
      mass += behind + (rods_ ? kRod : 0);
    }
    return mass;
  }
  /// Of a link behind which nothing moves: the rod to the sensors and targets on it.
  double end_rod(int link, Vector3d& moment) const {
    if (!rods_ || !moment.isZero()) return 0;
    Vector3d sum = Vector3d::Zero();
    int count = 0;
    const auto mounted = [&](int on, const Pose& link_T_thing) {
      Pose at;
      for (int l = on; l != link; l = rig_.tree.joints[rig_.tree.joint_above[l]].parent) {
        const int above = rig_.tree.joint_above[l];
        if (above < 0 || rig_.tree.joints[above].moves()) return;
        at = pose_at_zero(rig_.tree.joints[above]) * at;
      }
      sum += at * link_T_thing.translation;
      ++count;
    };
    for (const Sensor& s : rig_.sensors) mounted(s.link, s.link_T_sensor);
    for (const Target& t : rig_.targets)
      if (t.link >= 0) mounted(t.link, t.link_T_target);
    if (count == 0) return 0;
    moment = kRod / 2 * sum / count;
    return kRod;
  }

  const Rig& rig_;
  bool rods_;
  std::vector<Vector3d> moment_;  // by joint
};

}  // namespace

Elasticity nominal_elasticity(const Rig& rig) {
  Elasticity out;
  out.root_R_base = root_R_base(rig);
  out.compliance.assign(rig.tree.joints.size(), Vector3d::Zero());
  out.turned.assign(rig.tree.joints.size(), 0.0);
  out.load = Loads(rig).take();
  std::vector<char> bends(rig.tree.joints.size(), 0);
  for (size_t j = 0; j < bends.size(); ++j) {
    const Joint& joint = rig.tree.joints[j];
    bends[j] = joint.has_reading() && joint.type != JointType::prismatic &&
               std::none_of(rig.sensors.begin(), rig.sensors.end(), [&](const Sensor& s) {
                 return s.scanning_joint == static_cast<int>(j);
               });
  }
  out.skeleton = std::make_shared<const Skeleton>(rig.tree, bends);
  return out;
}

bool bends(const Elasticity& elasticity) {
  return std::any_of(elasticity.compliance.begin(), elasticity.compliance.end(),
                     [](const Vector3d& c) { return !c.isZero(0); });
}

void turn_skeleton(const Tree& tree, Elasticity& elasticity) {
  std::vector<char> bends;
  for (const int i : elasticity.skeleton->index) bends.push_back(i >= 0);
  Skeleton skeleton(tree, bends);
  for (int i = 0; i < skeleton.size(); ++i) {
    const int j = skeleton.bending[i];
    skeleton.basis[i] =
        rotation_about(tree.joints[j].axis, elasticity.turned[j]) * skeleton.basis[i];
  }
  elasticity.skeleton = std::make_shared<const Skeleton>(std::move(skeleton));
}

Elasticity folded_elasticity(const Rig& rig, const ParameterTable& table, const VectorXd& values) {
  Elasticity out = *rig.elasticity;
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    if (table.load[j] >= 0) out.load[j] = values.segment<3>(table.all[table.load[j]].start);
    if (table.compliance[j] < 0) continue;
    out.compliance[j] = values.segment<3>(table.all[table.compliance[j]].start);
    if (!out.rotor) out.turned[j] -= values(table.all[table.joint_offset[j]].start);
  }
  turn_skeleton(rig.tree, out);
  return out;
}

bool can_bend(const Rig& rig) try {
  const Elasticity found = nominal_elasticity(rig);
  return found.skeleton->size() > 0;
} catch (const std::invalid_argument&) {
  return false;
}

bool stands_for_balance(const Rig& rig, const std::vector<double>& readings, int joint) {
  if (!rig.tree.joints[joint].moves()) return false;
  const int own = driver(rig.tree, joint).joint;
  return std::isnan(readings[own]) ||
         std::any_of(rig.sensors.begin(), rig.sensors.end(),
                     [&](const Sensor& s) { return s.scanning_joint == own; });
}

void set_elasticity(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                    int payload, BentPosture& at) {
  at.rotor = rig.elasticity->rotor;
  at.gravity = rig.elasticity->root_R_base * rig.elasticity->gravity;
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) {
    if (table.compliance[j] >= 0)
      at.compliance[j] = values.segment<3>(table.all[table.compliance[j]].start);
    if (table.load[j] >= 0) at.load[j] = values.segment<3>(table.all[table.load[j]].start);
  }
  if (payload < 0) return;
  const Payload& carried = rig.payloads[payload];
  Vector3d place = carried.centre;  // in the link at hand
  for (int joint = rig.tree.joint_above[carried.link]; joint >= 0;
       joint = rig.tree.joint_above[rig.tree.joints[joint].parent]) {
    const Joint& above = rig.tree.joints[joint];
    if (above.moves()) at.load[joint] += carried.mass * place;
    place = above.moves() ? above.parent_T_joint.translation : pose_at_zero(above) * place;
  }
}

}  // namespace kincal
