#include "pose_mistakes.h"

#include <algorithm>
#include <cmath>

#include "../../kinematics/floating.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kFarFromBase = 20;  // m: no flange is further from its base than that

/// Replaces the readings of a floating joint; samples whose right reading is not known are left
/// out.
void change_poses(const Rig& rig, std::vector<Sample>& samples, int joint, Pose (*change)(Pose)) {
  const int first = rig.tree.joints[joint].first_axis;
  const auto lost = [&](Sample& s) {
    if (!std::isfinite(s.readings[first])) return false;
    set_pose_reading(rig.tree, joint, change(pose_reading(rig.tree, joint, s.readings)),
                     s.readings);
    return !std::isfinite(s.readings[first]);
  };
  samples.erase(std::remove_if(samples.begin(), samples.end(), lost), samples.end());
}

Pose in_metres(Pose pose) {
  pose.translation /= 1000;
  return pose;
}

/// Of w x y z, read as x y z w.
Pose scalar_first(Pose pose) {
  const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  pose.rotation = rotation_from_quaternion({q(1), q(2), q(3), q(0)});
  return pose;
}

/// Of a rotation vector, read as roll, pitch and yaw. Two such triples make the same rotation, and
/// a rotation vector is no longer than pi; where both could be one, which is not known (NaN).
Pose rotation_vector(Pose pose) {
  const auto wrapped = [](double angle) { return std::remainder(angle, 2 * kPi); };
  const Vector3d rpy = rpy_from_rotation(pose.rotation),
                 other(wrapped(rpy(0) + kPi), wrapped(kPi - rpy(1)), wrapped(rpy(2) + kPi));
  pose.rotation = exp_so3(rpy.norm() < other.norm() ? rpy : other);
  if (std::max(rpy.norm(), other.norm()) < kPi) pose.translation.setConstant(std::nan(""));
  return pose;
}

/// Of turns about x, then the new y, then the new z, read as roll, pitch and yaw.
Pose about_moved_axes(Pose pose) {
  const Vector3d rpy = rpy_from_rotation(pose.rotation);
  pose.rotation = rotation_about(Vector3d::UnitX(), rpy(0)) *
                  rotation_about(Vector3d::UnitY(), rpy(1)) *
                  rotation_about(Vector3d::UnitZ(), rpy(2));
  return pose;
}

struct Mistake {
  const char *id, *mistake, *cure;
  Pose (*undo)(Pose);
};

const Mistake kMistakes[] = {
    {"inverted-pose", "are given the wrong way round, as that of the base in the flange",
     "Invert them: a reading is parent_T_child, it maps coordinates of the flange to the base's. "
     "(Or "
     "sensor and target sit on each other's links in the rig: the data are the same.)",
     [](Pose pose) { return inverse(pose); }},
    {"quaternion", "have their quaternions with w first", "Write \"quat\": [x, y, z, w].",
     scalar_first},
    {"convention", "have rotation vectors (axis times angle) where roll, pitch and yaw are meant",
     "Convert them: \"quat\" = [axis * sin(angle / 2), cos(angle / 2)].", rotation_vector},
    {"convention", "have angles about x, y and z in the other order: about the axes as they move",
     "Convert them: \"rpy\" is Rz(yaw) Ry(pitch) Rx(roll).", about_moved_axes}};

}  // namespace

void add_pose_readings(const Rig& rig, const std::vector<Sample>& samples, const Survey& survey,
                       std::vector<Hypothesis>& out) {
  for (const int j : survey.floating) {
    const std::string& name = rig.tree.joints[j].name;
    const auto add = [&](const Mistake& mistake) {
      Hypothesis h;
      h.id = mistake.id;
      h.where = {name};
      h.mistake = "the poses of joint " + quoted(name) + " " + mistake.mistake;
      h.cure = mistake.cure;
      h.new_poses = true;
      h.leaves_out = mistake.undo == rotation_vector;
      h.undo = [j, undo = mistake.undo](Rig& r, std::vector<Sample>& s) {
        change_poses(r, s, j, undo);
      };
      out.push_back(std::move(h));
    };
    for (const Mistake& mistake : kMistakes) add(mistake);
    double furthest = 0;
    for (const Sample& s : samples)
      if (const Vector3d at = pose_reading(rig.tree, j, s.readings).translation; at.allFinite())
        furthest = std::max(furthest, at.norm());
    if (furthest > kFarFromBase)
      add({"units", "are in millimetres", "Divide their xyz by 1000: metres are meant.",
           in_metres});
  }
}

}  // namespace kincal
