#include "hand_eye.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "../../kinematics/floating.h"
#include "../../solver/decompositions.h"
#include "../rig/configuration.h"
#include "../rig/words.h"

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

/// How far something turned from where it was first: at most, and about other axes than the one
/// that it turned about most; rad.
struct Turns {
  double most = 0, others = 0;
};

Turns turns_of(const std::vector<Matrix3d>& rotations) {
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

/// Of sensors against mounted targets; `what` is empty where that is not all that is seen, and of a
/// robot that cannot turn about two axes.
Turned turned_sensor(const Recording& recording) {
  const Rig& rig = recording.rig;
  const bool can_turn =
      std::any_of(rig.tree.joints.begin(), rig.tree.joints.end(),
                  [](const Joint& j) { return j.moves() && j.type != JointType::prismatic; });
  if (!can_turn) return {};
  std::set<int> links;
  for (const Sensor& sensor : rig.sensors) links.insert(sensor.link);
  for (const Target& target : rig.targets)
    if (target.link >= 0) links.insert(target.link);
  if (only_turn_of(recording, links)) return {};
  std::map<std::pair<int, int>, std::vector<Matrix3d>> pairs;
  for (const int i : recording.training()) {
    const Sample& sample = recording.samples[i];
    const std::vector<double> readings = completed(sample.readings);
    const Configuration robot(rig, recording.table, recording.table.initial, readings);
    for (const View& v : sample.views) {
      const Sensor& sensor = rig.sensors[v.sensor];
      const MeasurementKind kind = sensor.model->measurement_kind();
      const bool one_pose = kind == MeasurementKind::rays || kind == MeasurementKind::pose;
      if (!one_pose || rig.targets[v.target].link < 0) return {};
      pairs[{v.sensor, v.target}].push_back(
          robot.a_T_b(sensor.link, rig.targets[v.target].link).rotation);
    }
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

}  // namespace

Matrix3d turned_at_zero(const Tree& tree, int link) {
  Matrix3d out = Matrix3d::Identity();
  for (int j = tree.joint_above[link]; j >= 0; j = tree.joint_above[tree.joints[j].parent])
    out = pose_at_zero(tree.joints[j]).rotation * out;
  return out;
}

std::optional<Vector3d> only_turn_of(const Recording& recording, const std::set<int>& links) {
  constexpr int kPostures = 8;
  constexpr double kParallel = 0.999, kTurned = 0.2;  // cosine; rad, for an axis to be told
  constexpr double kGolden = 0.6180339887498949;      // multiples of it spread evenly over 0 .. 1
  const Tree& tree = recording.rig.tree;
  std::vector<double> readings(tree.joints.size(), 0);
  std::map<int, Matrix3d> first;
  std::optional<Vector3d> out;
  for (int k = 0, draw = 0; k < kPostures; ++k) {
    for (size_t j = 0; j < tree.joints.size(); ++j) {
      const Joint& joint = tree.joints[j];
      if (joint.type == JointType::floating || joint.type == JointType::planar ||
          joint.axis_of_pose != PoseAxis::none)
        return {};
      if (!joint.has_reading()) continue;
      const bool limits = joint.lower < joint.upper;
      const double share = std::fmod(kGolden * ++draw, 1.0), lower = limits ? joint.lower : -1,
                   upper = limits ? joint.upper : 1;
      readings[j] = lower + share * (upper - lower);
    }
    const Configuration robot(recording.rig, recording.table, recording.table.initial, readings);
    for (const int link : links) {
      const Matrix3d now = robot.a_T_b(tree.root, link).rotation;
      const Eigen::AngleAxisd turn(now * first.insert({link, now}).first->second.transpose());
      if (turn.angle() < kTurned) continue;
      if (out && std::abs(out->dot(turn.axis())) < kParallel) return {};
      if (!out) out = turn.axis();
    }
  }
  return out;
}

MotionLack motion_lack(const Recording& recording) {
  const int flange = only_flange(recording.rig.tree);
  const Turned turned = flange < 0 ? turned_sensor(recording) : turned_flange(recording, flange);
  if (turned.what.empty()) return {};
  const std::string turn =
      "turn " + turned.it + " about at least two axes that are not parallel, by 30 degrees or more";
  const size_t poses = count_postures(recording);
  if (poses < kFewestPoses)
    return {text("%zu ", poses) + (flange < 0 ? "posture" : "pose") + (poses == 1 ? "" : "s") +
                " of " + (flange < 0 ? "the robot" : turned.what) + (poses == 1 ? " is" : " are") +
                " too few to tell where things sit on it and around it",
            text("take at least %zu poses, better 15, and ", kFewestPoses) + turn};
  const auto [most, others] = turned.turns;
  if (most < kEnoughTurn)
    return {turned.what + " hardly turned (by " + angle_text(most) +
                " at most): sliding alone does not tell where things sit on it",
            turn};
  if (others < kEnoughTurn)
    return {turned.what + " turned about one axis only (by " + angle_text(most) +
                ", about others by " + angle_text(others) +
                "): along this axis things can slide unseen",
            turn};
  return {};
}

}  // namespace kincal
