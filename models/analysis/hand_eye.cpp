#include "hand_eye.h"

#include <algorithm>
#include <vector>

#include "../../kinematics/floating.h"
#include "../../solver/decompositions.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr size_t kFewestFlangePoses = 3;
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

FlangeLack flange_lack(const Recording& recording) {
  const Tree& tree = recording.rig.tree;
  const int flange = only_flange(tree);
  if (flange < 0) return {};
  const int last_axis = tree.joints[flange].first_axis + 2 * kPoseAxes - 1;
  const std::string link = "the flange ('" + tree.links[tree.joints[last_axis].child] + "')";
  const char* turn = "turn it about at least two axes that are not parallel, by 30 degrees or more";
  std::vector<Vector3d> turns;
  Matrix3d first = Matrix3d::Identity(), spread = Matrix3d::Zero();
  for (const int i : recording.training()) {
    const Pose pose = pose_reading(tree, flange, recording.samples[i].readings);
    if (!pose.rotation.allFinite()) continue;
    if (turns.empty()) first = pose.rotation;
    turns.push_back(log_so3(Matrix3d(pose.rotation * first.transpose())));
    spread += turns.back() * turns.back().transpose();
  }
  const size_t poses = count_postures(recording);
  if (poses < kFewestFlangePoses)
    return {text("%zu pose%s of ", poses, poses == 1 ? "" : "s") + link +
                (poses == 1 ? " is" : " are") +
                " too few to tell where things sit on it and around it",
            "take at least 3 poses, better 15, and " + std::string(turn)};
  const Vector3d axis = symmetric_eigen(spread).vectors.col(2);
  double most = 0, others = 0;
  for (const Vector3d& t : turns) {
    most = std::max(most, t.norm());
    others = std::max(others, (t - axis * axis.dot(t)).norm());
  }
  if (most < kEnoughTurn)
    return {link + " hardly turned (by " + angle_text(most) +
                " at most): sliding alone does not tell where things sit on it",
            turn};
  if (others < kEnoughTurn)
    return {link + " turned about one axis only (by " + angle_text(most) + ", about others by " +
                angle_text(others) + "): along this axis things can slide unseen",
            turn};
  return {};
}

}  // namespace kincal
