#include "hand_eye.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "../../kinematics/floating.h"
#include "../../solver/decompositions.h"
#include "../rig/configuration.h"
#include "../rig/words.h"
#include "frames.h"

namespace kincal {
namespace {

constexpr size_t kFewestPoses = 3;
constexpr double kEnoughTurn = 10 * kPi / 180;

/// The floating joint, if nothing else moves; else -1.
int only_flange(const Tree& tree) {
  int flange = -1;
  for (size_t j = 0; j < tree.joints.size(); ++j) {
    const Joint& joint = tree.joints[j];
    if (joint.first_axis >= 0) {
      if (flange >= 0) return -1;
      flange = static_cast<int>(j);
    } else if (joint.moves() && joint.axis_of_pose == PoseAxis::none) {
      return -1;
    }
  }
  return flange;
}

}  // namespace

Turns turns_of(const std::vector<Matrix3d>& rotations) {
  if (rotations.empty()) return {};
  std::vector<Vector3d> turns;
  Matrix3d spread = Matrix3d::Zero();
  for (const Matrix3d& rotation : rotations) {
    turns.push_back(log_so3(Matrix3d(rotation * rotations[0].transpose())));
    spread += turns.back() * turns.back().transpose();
  }
  const Vector3d axis = symmetric_eigen(spread).vectors.col(2);
  Turns out;
  for (const Vector3d& t : turns) {
    out.most = std::max(out.most, t.norm());
    out.others = std::max(out.others, (t - axis * axis.dot(t)).norm());
  }
  return out;
}

namespace {

/// What turned against what, and how: of the pair that turned best.
struct Turned {
  std::string what, it;  // "the flange ('tool0')", "it"
  Turns turns;
};

Turned turned_flange(const Recording& recording, int flange) {
  const Tree& tree = recording.rig.tree;
  const int last_axis = tree.joints[flange].first_axis + 2 * kPoseAxes - 1;
  std::vector<Matrix3d> rotations;
  for (const int i : recording.training()) {
    const Pose pose = pose_reading(tree, flange, recording.samples[i].readings);
    if (pose.rotation.allFinite()) rotations.push_back(pose.rotation);
  }
  return {"the flange ('" + tree.links[tree.joints[last_axis].child] + "')", "it",
          turns_of(rotations)};
}

/// Of sensors against the mounted targets that they see, in the samples' postures or in the given
/// ones; `what` is empty where a view shows something else.
Turned turned_sensor(const Recording& recording, const std::vector<Readings>& postures = {}) {
  const Rig& rig = recording.rig;
  std::map<std::pair<int, int>, std::vector<Matrix3d>> pairs;
  const std::vector<int> training = recording.training();
  for (const int i : training)
    for (const View& v : recording.samples[i].views) {
      const Sensor& sensor = rig.sensors[v.sensor];
      const int link = rig.targets[v.target].link;
      const MeasurementKind kind = sensor.model->measurement_kind();
      const bool one_pose = kind == MeasurementKind::rays || kind == MeasurementKind::pose;
      if (!one_pose || link < 0) return {};
      std::vector<Matrix3d>& rotations = pairs[{v.sensor, v.target}];
      const auto turn = [&](const Readings& readings) {
        const Configuration robot(rig, recording.table, recording.table.initial, readings);
        rotations.push_back(robot.a_T_b(sensor.link, link).rotation);
      };
      if (postures.empty())
        turn(completed(recording.samples[i].readings));
      else if (rotations.empty())
        for (const Readings& readings : postures) turn(readings);
    }
  Turned out;
  for (const auto& [pair, rotations] : pairs) {
    const Turns turns = turns_of(rotations);
    if (!out.what.empty() && turns.others <= out.turns.others) continue;
    out = {"sensor '" + rig.sensors[pair.first].name + "' against target '" +
               rig.targets[pair.second].name + "'",
           "one of them", turns};
  }
  return out;
}

/// True if sensors and targets can turn against each other about two axes: those of a SCARA, or of
/// a palletizer, whose followers keep the tool level, cannot.
bool can_turn(const Recording& recording) {
  constexpr int kTurned = 12;
  const Turned turned = turned_sensor(recording, random_postures(recording.rig, kTurned, 1));
  return turned.turns.others >= kEnoughTurn;
}

}  // namespace

MotionLack motion_lack(const Recording& recording) {
  const int flange = only_flange(recording.rig.tree);
  const Turned turned = flange < 0 ? turned_sensor(recording) : turned_flange(recording, flange);
  if (turned.what.empty() || (flange < 0 && !can_turn(recording))) return {};
  const std::string turn =
      "turn " + turned.it + " about at least two axes that are not parallel, by 30 degrees or more";
  const std::string otherwise =
      flange < 0
          ? ""
          : "if it cannot turn (a gantry), measure the position of the sensor or the target, write "
            "that pose into the rig, and fix its position (--fix 'sensor/NAME/pose.[xyz]')";
  const size_t poses = count_postures(recording);
  if (poses < kFewestPoses)
    return {text("%zu ", poses) + (flange < 0 ? "posture" : "pose") + (poses == 1 ? "" : "s") +
                " of " + (flange < 0 ? "the robot" : turned.what) + (poses == 1 ? " is" : " are") +
                " too few to determine the mounts on it and the poses around it",
            text("take at least %zu poses, better 15, and ", kFewestPoses) + turn, otherwise};
  const auto [most, others] = turned.turns;
  if (most < kEnoughTurn)
    return {turned.what + " hardly turned (by " + angle_text(most) +
                " at most): translation alone does not determine the mounts on it",
            turn, otherwise};
  if (others < kEnoughTurn)
    return {turned.what + " turned about one axis only (by " + angle_text(most) +
                ", about others by " + angle_text(others) +
                "): positions along this axis are not determined",
            turn, otherwise};
  return {};
}

}  // namespace kincal
