#include "turned_poses.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "../rig/words.h"

namespace kincal {
namespace {

/// A found pose is near a turn if it differs by less than this (rad, m).
constexpr double kNearTurn = 0.3, kNearPlace = 0.25;

/// Sensors of one link, or one target, whose poses are held.
struct HeldPoses {
  std::vector<int> sensors;
  int target = -1;
  int link = -1;
};

/// The 24 turns of a cube: all rotations with entries -1, 0 and 1.
const std::vector<Matrix3d>& cube_turns() {
  static const std::vector<Matrix3d> all = [] {
    std::vector<Matrix3d> out;
    int axes[3] = {0, 1, 2};
    do
      for (int signs = 0; signs < 8; ++signs) {
        Matrix3d m = Matrix3d::Zero();
        for (int c = 0; c < 3; ++c) m(axes[c], c) = signs >> c & 1 ? -1 : 1;
        if (m.determinant() > 0) out.push_back(m);
      }
    while (std::next_permutation(axes, axes + 3));
    return out;
  }();
  return all;
}

/// The turn that a motion is near, without moving far; nothing: none, or none is needed.
std::optional<Matrix3d> near_turn(const Pose& motion) {
  if (motion.translation.norm() > kNearPlace) return std::nullopt;
  for (const Matrix3d& turn : cube_turns())
    if (log_so3(turn.transpose() * motion.rotation).norm() < kNearTurn && turn.trace() < 2)
      return turn;
  return std::nullopt;
}

/// "by 90 degrees about its z axis": what puts the given pose right, in its own axes.
std::string turn_words(const Matrix3d& turn) {
  Matrix3d optical;  // link_R_optical: z forward, x right, y down; of a link with x forward, z up
  optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  if (turn.isApprox(optical))
    return "from x forward, z up (a link's frame) to z forward, y down (an optical frame): rpy "
           "-pi/2 0 -pi/2 more";
  if (turn.isApprox(optical.transpose()))
    return "from z forward, y down (an optical frame) to x forward, z up (a link's frame): rpy "
           "-pi/2 0 -pi/2 less";
  const Vector3d turned = log_so3(turn);
  const double angle = turned.norm();
  const Vector3d axis = turned / angle;
  for (int i = 0; i < 3; ++i)
    if (std::abs(axis(i)) > 0.99)
      return text("by %.0f degrees about its %c axis",
                  (axis(i) > 0 || angle > 3 ? 1 : -1) * angle * 180 / kPi, "xyz"[i]);
  const double most = axis.cwiseAbs().maxCoeff();
  return text("by %.0f degrees about its axis (%.0f, %.0f, %.0f)", angle * 180 / kPi,
              axis(0) / most, axis(1) / most, axis(2) / most);
}

/// Poses of which no number is free, under no mount that is wholly free.
std::vector<HeldPoses> held_poses(const Recording& recording, const TrialContext& context) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const FreedNames freed = freed_names(table, context.all);
  const auto mount_is_free = [&](int link) {
    for (int j = rig.tree.joint_above[link]; j >= 0 && !rig.tree.joints[j].moves();
         j = rig.tree.joint_above[rig.tree.joints[j].parent])
      if (table.joint_origin[j] >= 0 && freed.whole[table.joint_origin[j]]) return true;
    return false;
  };
  std::map<int, HeldPoses> by_link;
  std::set<int> seen;
  for (const Sample& sample : recording.samples)
    for (const View& v : sample.views) seen.insert(v.target);
  for (int s : context.all.sensors) {
    const int link = rig.sensors[s].link;
    if (freed.parameter[table.sensor_pose[s]] || mount_is_free(link)) continue;
    by_link[link].sensors.push_back(s);
    by_link[link].link = link;
  }
  std::vector<HeldPoses> out;
  for (const auto& one : by_link) out.push_back(one.second);
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const int link = rig.targets[t].link;
    if (link < 0 || !seen.count(static_cast<int>(t)) || freed.parameter[table.target_pose[t]] ||
        mount_is_free(link))
      continue;
    out.push_back({{}, static_cast<int>(t), link});
  }
  return out;
}

/// Where the data put what is held (the first sensor of a link, or the target).
std::optional<Pose> find_pose(const Recording& recording, const TrialContext& context,
                              const HeldPoses& held) {
  Rig rig = recording.rig;
  FitSpec spec = context.all;
  for (int s : held.sensors) {
    rig.sensors[s].pose_given = false;
    spec.free.push_back("sensor/" + rig.sensors[s].name + "/pose");
  }
  if (held.target >= 0) {
    rig.targets[held.target].pose_given = false;
    spec.free.push_back("target/" + rig.targets[held.target].name + "/pose");
  }
  const ParameterTable& table = recording.table;
  const int parameter =
      held.target >= 0 ? table.target_pose[held.target] : table.sensor_pose[held.sensors[0]];
  const Recording some(std::move(rig), some_samples(recording, spec.free.size()));
  try {
    const TrialFit fit = best_fit(some, context, spec, {30, 1e-3});
    if (!fit.complete() || fit.values.shared.size() != table.initial.size()) return std::nullopt;
    return get_pose(fit.values.shared, table.all[parameter].start);
  } catch (const std::exception&) {  // closed form cannot tell it, or a path cannot be walked
    return std::nullopt;
  }
}

Hypothesis turned(const std::string& what, Subject where, const Matrix3d& turn,
                  std::function<Pose&(Rig&)> pose) {
  return {NoticeKind::turned_pose,
          {std::move(where)},
          what + " is turned",
          "turn it " + turn_words(turn),
          [turn, pose = std::move(pose)](Rig& r) { pose(r).rotation = pose(r).rotation * turn; }};
}

/// What would put the found pose right: a turn of what is held about its own axes, or of a fixed
/// joint above it.
void add_turns(const Rig& rig, const HeldPoses& held, const Pose& found,
               std::vector<Hypothesis>& out) {
  const bool target = held.target >= 0;
  const Pose given =
      target ? rig.targets[held.target].link_T_target : rig.sensors[held.sensors[0]].link_T_sensor;
  const bool stated =
      target ? rig.targets[held.target].pose_given : rig.sensors[held.sensors[0]].pose_given;
  const std::string name =
      target ? rig.targets[held.target].name : rig.sensors[held.sensors[0]].name;
  Pose lower;  // from the joint's child to the link
  for (int j = rig.tree.joint_above[held.link]; j >= 0 && !rig.tree.joints[j].moves();
       j = rig.tree.joint_above[rig.tree.joints[j].parent]) {
    const Joint& joint = rig.tree.joints[j];
    if (auto turn = near_turn(lower * found * inverse(given) * inverse(lower)))
      out.push_back(turned("the origin of fixed joint " + quoted(joint.name) + " in the URDF",
                           Subject::joint(joint.name), *turn,
                           [j](Rig& r) -> Pose& { return r.tree.joints[j].parent_T_joint; }));
    lower = pose_at_zero(joint) * lower;
  }
  const std::optional<Matrix3d> turn = near_turn(inverse(given) * found);
  if (!turn || (!stated && !out.empty())) return;
  out.push_back(turned("the pose of " + std::string(target ? "target " : "sensor ") + quoted(name) +
                           (target ? " on its mount" : " on its link"),
                       target ? Subject::target(name) : Subject::sensor(name), *turn,
                       [held](Rig& r) -> Pose& {
                         return held.target >= 0 ? r.targets[held.target].link_T_target
                                                 : r.sensors[held.sensors[0]].link_T_sensor;
                       }));
  if (of_w_x_y_z(given.rotation).isApprox(given.rotation * *turn, 1e-3))
    out.back().cure += ". A quaternion written w x y z does this: quat is [x, y, z, w]";
}

}  // namespace

bool is_cube_turn(const Matrix3d& rotation) {
  return std::any_of(cube_turns().begin(), cube_turns().end(),
                     [&](const Matrix3d& turn) { return (turn - rotation).norm() < 1e-3; });
}

Matrix3d of_w_x_y_z(const Matrix3d& given) {
  const Eigen::Quaterniond q(given);
  return Eigen::Quaterniond(q.x(), q.y(), q.z(), q.w()).toRotationMatrix();  // (it takes w first)
}

std::vector<Hypothesis> turned_poses(const Recording& recording, const TrialContext& context) {
  std::vector<Hypothesis> out;
  for (const HeldPoses& held : held_poses(recording, context))
    if (const std::optional<Pose> found = find_pose(recording, context, held))
      add_turns(recording.rig, held, *found, out);
  return out;
}

}  // namespace kincal
