#include "pose_mistakes.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "../../kinematics/floating.h"
#include "../rig/words.h"
#include "reading_mistakes.h"

namespace kincal {
namespace {

/// No flange is further from its base than this (m); nor do poses stay nearer than the other.
constexpr double kFarFromBase = 5, kNearBase = 0.05;

using Change = std::function<Pose(const Pose&)>;

/// Replaces the readings of a floating joint; samples whose right reading is not known are left
/// out.
void change_poses(const Rig& rig, std::vector<Sample>& samples, int joint, const Change& change) {
  const int first = rig.tree.joints[joint].first_axis;
  const auto lost = [&](Sample& s) {
    if (!std::isfinite(s.readings[first])) return false;
    set_pose_reading(rig.tree, joint, change(pose_reading(rig.tree, joint, s.readings)),
                     s.readings);
    return !std::isfinite(s.readings[first]);
  };
  samples.erase(std::remove_if(samples.begin(), samples.end(), lost), samples.end());
}

/// Of w x y z, read as x y z w.
Pose scalar_first(Pose pose) {
  const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  pose.rotation = rotation_from_quaternion({q(1), q(2), q(3), q(0)});
  return pose;
}

/// Of x y z w, read as w x y z.
Pose scalar_last(Pose pose) {
  const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  pose.rotation = rotation_from_quaternion({q(3), q(0), q(1), q(2)});
  return pose;
}

/// Of a rotation vector, read as roll, pitch and yaw, or as A, B, C. Two such triples make the same
/// rotation, and a rotation vector is no longer than pi; where both could be one, which is not
/// known (NaN).
template <bool a_b_c>
Pose rotation_vector(Pose pose) {
  const auto wrapped = [](double angle) { return std::remainder(angle, 2 * kPi); };
  const Vector3d rpy = rpy_from_rotation(pose.rotation),
                 other(wrapped(rpy(0) + kPi), wrapped(kPi - rpy(1)), wrapped(rpy(2) + kPi)),
                 vector = rpy.norm() < other.norm() ? rpy : other;
  pose.rotation = exp_so3(a_b_c ? Vector3d(vector.reverse()) : vector);
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

/// Of roll, pitch and yaw, read as a rotation vector: with a turn more about its axis it may be
/// another triple; where both could be one, which is not known (NaN).
Pose roll_pitch_yaw(Pose pose) {
  const Vector3d v = log_so3(pose.rotation);
  const Vector3d longer = v * (1 - 2 * kPi / std::max(v.norm(), 1e-9));
  const auto is_triple = [](const Vector3d& rpy) {
    return std::abs(rpy(0)) <= kPi && std::abs(rpy(1)) <= kPi / 2 && std::abs(rpy(2)) <= kPi;
  };
  if (is_triple(v) == is_triple(longer)) pose.translation.setConstant(std::nan(""));
  const Vector3d rpy = is_triple(v) ? v : longer;
  pose.rotation = rotation_from_rpy(rpy);
  return pose;
}

/// Of turns about z, then the new y, then the new x, read as roll, pitch and yaw.
Pose a_b_c(Pose pose) {
  const Vector3d rpy = rpy_from_rotation(pose.rotation);
  pose.rotation = rotation_from_rpy({rpy(2), rpy(1), rpy(0)});
  return pose;
}

/// Of a frame whose y axis points the other way, positions and rotations alike.
Pose left_handed(Pose pose) {
  const Vector3d mirror(1, -1, 1);
  pose.translation = mirror.cwiseProduct(pose.translation);
  pose.rotation = mirror.asDiagonal() * pose.rotation * mirror.asDiagonal();
  return pose;
}

template <int axis>
Pose other_sign(Pose pose) {
  pose.translation(axis) *= -1;
  return pose;
}

template <int a, int b>
Pose exchanged_axes(Pose pose) {
  std::swap(pose.translation(a), pose.translation(b));
  return pose;
}

/// Radians that were read as degrees make all turns as small (rad, but for rounding).
constexpr double kTurnOfDegrees = 0.06, kPerDegree = 180 / kPi;

/// Of numbers in radians (and, where `metres` is 1000, in metres), read as roll, pitch and yaw in
/// degrees (and millimetres).
Pose radians(Pose pose, bool a_b_c, bool vector, double metres) {
  Vector3d numbers = kPerDegree * rpy_from_rotation(pose.rotation);
  if (a_b_c) numbers.reverseInPlace();
  pose.rotation = vector ? exp_so3(numbers) : rotation_from_rpy(numbers);
  pose.translation *= metres;
  return pose;
}

struct Mistake {
  NoticeKind kind;
  const char *mistake, *cure;
  Change undo;
  bool leaves_out = false;
};

const Mistake kMistakes[] = {
    {NoticeKind::inverted_pose, "are given the wrong way round, as that of the base in the flange",
     "invert them: a reading is parent_T_child, it maps coordinates of the flange to the base's "
     "(or "
     "sensor and target sit on each other's links in the rig: the data are the same)",
     [](const Pose& pose) { return inverse(pose); }},
    {NoticeKind::quaternion, "have their quaternions with w first", "write \"quat\": [x, y, z, w]",
     scalar_first},
    {NoticeKind::quaternion, "have quaternions with w last that were read with w first",
     "write \"quat\": [x, y, z, w], in this order (--pose-format xyzw)", scalar_last},
    {NoticeKind::inverted_pose,
     "are given the wrong way round, as that of the base in the flange, and have their quaternions "
     "with w first",
     "write \"quat\": [x, y, z, w], and invert the poses: a reading is parent_T_child, it maps "
     "coordinates of the flange to the base's",
     [](const Pose& pose) { return inverse(scalar_first(pose)); }},
    {NoticeKind::convention,
     "have rotation vectors (axis times angle) where roll, pitch and yaw are meant",
     "convert them: \"quat\" = [axis * sin(angle / 2), cos(angle / 2)]", rotation_vector<false>,
     true},
    {NoticeKind::convention,
     "have rotation vectors (axis times angle, as of Universal Robots) where A, B, C of a KUKA are "
     "read",
     "read them as rotation vectors (--pose-format rotvec)", rotation_vector<true>, true},
    {NoticeKind::convention,
     "have angles about x, y and z in the other order: about the axes as they move",
     "convert them: \"rpy\" is Rz(yaw) Ry(pitch) Rx(roll)", about_moved_axes},
    {NoticeKind::convention,
     "have angles in the order z, y, x (A, B, C of a KUKA) where roll comes first",
     "write \"rpy\": [C, B, A]", a_b_c},
    {NoticeKind::convention,
     "have roll, pitch and yaw where a rotation vector (axis times angle) was meant",
     "convert them: \"rpy\": [roll, pitch, yaw], or the quaternion of Rz(yaw) Ry(pitch) Rx(roll)",
     roll_pitch_yaw, true},
    {NoticeKind::convention,
     "have their rotations the wrong way round (w of the quaternion, or the angles, with the other "
     "sign; or a transposed matrix), but not their positions",
     "change the sign of w: a rotation turns vectors of the flange into the base's",
     [](Pose pose) {
       pose.rotation.transposeInPlace();
       return pose;
     }},
    {NoticeKind::convention,
     "are those of a left-handed frame (one axis points the other way, or two are exchanged), or "
     "all pictures are mirrored: the data are the same",
     "take pictures as the camera gives them; or mirror the poses: where y has the other sign, y, "
     "roll and yaw change theirs",
     left_handed},
    {NoticeKind::convention, "have x of their positions with the wrong sign", "change it",
     other_sign<0>},
    {NoticeKind::convention, "have y of their positions with the wrong sign", "change it",
     other_sign<1>},
    {NoticeKind::convention, "have z of their positions with the wrong sign", "change it",
     other_sign<2>},
    {NoticeKind::convention, "have x and y of their positions exchanged",
     "write \"xyz\": [x, y, z]", exchanged_axes<0, 1>},
    {NoticeKind::convention, "have y and z of their positions exchanged",
     "write \"xyz\": [x, y, z]", exchanged_axes<1, 2>},
    {NoticeKind::convention, "have x and z of their positions exchanged",
     "write \"xyz\": [x, y, z]", exchanged_axes<0, 2>}};

/// Poses whose turns are all as small as those of radians that were read as degrees; those of a
/// KUKA are read in millimetres too.
void add_radians(const Rig& rig, const std::vector<Sample>& samples, int joint, double furthest,
                 const std::function<void(const Mistake&)>& add) {
  for (const Sample& s : samples)
    if (const Pose pose = pose_reading(rig.tree, joint, s.readings);
        pose.rotation.allFinite() &&
        rpy_from_rotation(pose.rotation).cwiseAbs().maxCoeff() > kTurnOfDegrees)
      return;
  const double metres = furthest < kNearBase / 10 ? 1000 : 1;
  const std::string lengths = metres > 1 ? ", and metres as millimetres" : "";
  for (const bool a_b_c : {false, true}) {
    const std::string vectors =
                          "have rotation vectors (axis times angle, as of Universal Robots, rad) "
                          "that were read as " +
                          std::string(a_b_c ? "A, B, C of a KUKA" : "roll, pitch and yaw") +
                          " in degrees" + lengths,
                      angles = std::string("have ") +
                               (a_b_c ? "roll, pitch and yaw in radians that were read as A, B, C "
                                        "of a KUKA in degrees"
                                      : "angles in radians that were read as degrees") +
                               lengths;
    add({NoticeKind::convention, vectors.c_str(),
         "read them as rotation vectors in radians (--pose-format rotvec)",
         [=](const Pose& pose) { return radians(pose, a_b_c, true, metres); }});
    add({NoticeKind::convention, angles.c_str(), "read them as radians (--pose-format rpy)",
         [=](const Pose& pose) { return radians(pose, a_b_c, false, metres); }});
  }
}

/// Measured poses of a sensor: quaternions with w first, read with w last, and the reverse.
/// (Those the wrong way round are data of a sensor in its target's place: eye-in-hand.)
const Mistake kViewMistakes[] = {
    {NoticeKind::quaternion, "have their quaternions with w first",
     "write \"quat\": [x, y, z, w] into its views", scalar_first},
    {NoticeKind::quaternion, "have quaternions with w last that were read with w first",
     "write \"quat\": [x, y, z, w] into its views, in this order", scalar_last},
    {NoticeKind::convention,
     "have their rotations the wrong way round (w of the quaternion with the other sign, or a "
     "transposed matrix), but not their positions",
     "change the sign of w: a rotation turns vectors of the target into the sensor's",
     [](Pose pose) {
       pose.rotation.transposeInPlace();
       return pose;
     }},
    {NoticeKind::mirrored,
     "are those of a left-handed frame (one axis points the other way, as in Unity or Unreal)",
     "mirror them: where y has the other sign, so have y of the position and x and z of the "
     "quaternion",
     left_handed},
    {NoticeKind::convention,
     "have angles about x, y and z in the other order: about the axes as they move",
     "convert them: \"rpy\" is Rz(yaw) Ry(pitch) Rx(roll)", about_moved_axes},
    {NoticeKind::convention, "have angles in the order z, y, x where roll comes first",
     "write \"rpy\": [roll, pitch, yaw]", a_b_c},
    {NoticeKind::convention,
     "have y and z of their positions exchanged, but not of their rotations",
     "write \"xyz\": [x, y, z]", exchanged_axes<1, 2>},
    {NoticeKind::convention, "have y up in their positions, but not in their rotations",
     "write \"xyz\": [x, -z, y], as the rotations are", [](Pose pose) {
       pose.translation = Vector3d(pose.translation(0), -pose.translation(2), pose.translation(1));
       return pose;
     }}};

void change_views(std::vector<Sample>& samples, int sensor, const Change& change) {
  for (Sample& s : samples)
    for (View& v : s.views) {
      if (v.sensor != sensor) continue;
      const Pose pose = change(
          {rotation_from_quaternion({v.z[3], v.z[4], v.z[5], v.z[6]}), {v.z[0], v.z[1], v.z[2]}});
      const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
      v.z = {pose.translation(0), pose.translation(1), pose.translation(2), q(0), q(1), q(2), q(3)};
    }
}

}  // namespace

void add_pose_views(const Rig& rig, const ObservationIndex& observations,
                    std::vector<Hypothesis>& out) {
  for (const int s : observations.sensors) {
    if (rig.sensors[s].model->measurement_kind() != MeasurementKind::pose) continue;
    for (const Mistake& mistake : kViewMistakes) {
      Hypothesis h;
      h.kind = mistake.kind;
      h.where = {Subject::sensor(rig.sensors[s].name)};
      h.mistake =
          "the poses that sensor " + quoted(rig.sensors[s].name) + " measures " + mistake.mistake;
      h.cure = mistake.cure;
      h.new_poses = true;
      h.undo = [s, undo = mistake.undo](Rig&, std::vector<Sample>& all) {
        change_views(all, s, undo);
      };
      out.push_back(std::move(h));
    }
  }
}

void add_pose_readings(const Rig& rig, const std::vector<Sample>& samples,
                       const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (const int j : observations.floating) {
    const std::string& name = rig.tree.joints[j].name;
    const auto add = [&](const Mistake& mistake) {
      Hypothesis h;
      h.kind = mistake.kind;
      h.where = {Subject::joint(name)};
      h.mistake = "the poses of joint " + quoted(name) + " " + mistake.mistake;
      h.cure = mistake.cure;
      h.new_poses = true;
      h.leaves_out = mistake.leaves_out;
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
    add_radians(rig, samples, j, furthest, add);
    if (furthest < kFarFromBase) continue;
    for (const LengthUnit& unit : other_length_units()) {
      const double metres = unit.metres;
      if (metres * furthest < kNearBase || metres * furthest > kFarFromBase) continue;
      const std::string mistake = std::string("are in ") + unit.name,
                        cure = std::string("write metres: ") + unit.cure + " what \"xyz\" says";
      add({NoticeKind::units, mistake.c_str(), cure.c_str(), [metres](Pose pose) {
             pose.translation *= metres;
             return pose;
           }});
    }
  }
}

}  // namespace kincal
