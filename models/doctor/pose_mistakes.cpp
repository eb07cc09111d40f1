#include "pose_mistakes.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "../../kinematics/angles.h"
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

/// Of angles that were written in one convention and read in another. Two triples give the rotation
/// that was read; the written one is that which programs write. Where both could be, it is the one
/// that `either` says; -1: it is not known (NaN).
Pose written_as(const AngleConvention& written, const AngleConvention& read, int either,
                Pose pose) {
  const std::array<Vector3d, 2> numbers = read.numbers(pose.rotation);
  const Matrix3d first = written.rotation(numbers[0]), second = written.rotation(numbers[1]);
  const bool usual[2] = {written.usual(numbers[0]), written.usual(numbers[1])};
  const bool both = usual[0] && usual[1];
  bool take_second = usual[0] == usual[1] ? numbers[1].norm() < numbers[0].norm() : usual[1];
  if (both && either >= 0) take_second = either == 1;
  pose.rotation = take_second ? second : first;
  if (both && either < 0) pose.translation.setConstant(std::nan(""));
  return pose;
}

Pose turned_round(Pose pose) {
  pose.rotation.transposeInPlace();
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

/// Of numbers in radians (and, where `metres` is 1000, in metres), read as degrees (and
/// millimetres).
Pose written_in_radians(const AngleConvention& written, const AngleConvention& read, double metres,
                        Pose pose) {
  pose.rotation = written.rotation(kPerDegree * read.numbers(pose.rotation)[0]);
  pose.translation *= metres;
  return pose;
}

struct Mistake {
  NoticeKind kind;
  std::string mistake, cure;
  Change undo;
  bool leaves_out = false;
};

const Mistake kMistakes[] = {
    {NoticeKind::inverted_pose, "are given the wrong way round, as that of the base in the flange",
     "invert them: a reading is parent_T_child, it maps coordinates of the flange to the base's "
     "(or sensor and target sit on each other's links in the rig: the data are the same)",
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
     "have their rotations the wrong way round (w of the quaternion, or the angles, with the other "
     "sign; or a transposed matrix), but not their positions",
     "change the sign of w: a rotation turns vectors of the flange into the base's", turned_round},
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

std::vector<const AngleConvention*> all_conventions() {
  std::vector<const AngleConvention*> out;
  for (int i = 0; i < kAngleConventions; ++i)
    out.push_back(&angle_convention(static_cast<Angles>(i)));
  return out;
}

/// Every convention of three numbers, read as another one. Of turns about z, y, z and those about
/// three axes both triples are usual in every pose: then all poses are taken on the same side.
void add_conventions(const std::function<void(const Mistake&)>& add) {
  const AngleConvention &rpy = angle_convention(Angles::roll_pitch_yaw),
                        &a_b_c = angle_convention(Angles::a_b_c),
                        &z_y_z = angle_convention(Angles::z_y_z),
                        &vector = angle_convention(Angles::rotation_vector);
  for (const AngleConvention* written : all_conventions())
    for (const AngleConvention* read : all_conventions()) {
      if (read == written || (read == &a_b_c && written == &rpy)) continue;  // the same reversed
      const bool reversed = read == &rpy && written == &a_b_c;
      Mistake mistake{NoticeKind::convention,
                      std::string("have ") + written->name + " that were read as " + read->name +
                          (reversed ? ", or the reverse" : ""),
                      std::string("read them as they are meant (--pose-format ") +
                          written->formats +
                          (reversed ? std::string("; or ") + read->formats : "") +
                          "), or convert them: \"rpy\" is Rz(yaw) Ry(pitch) Rx(roll)",
                      {}};
      const bool vectors = written == &vector || read == &vector,
                 sides = !vectors && (written == &z_y_z) != (read == &z_y_z);
      mistake.leaves_out = vectors;
      const int from = vectors ? -1 : 0, to = vectors ? 0 : sides ? 2 : 1;
      for (int either = from; either < to; ++either) {  // of others both make the same rotation
        mistake.undo = [=](const Pose& pose) { return written_as(*written, *read, either, pose); };
        add(mistake);
      }
    }
}

/// Poses whose turns are all as small as those of radians that were read as degrees; where lengths
/// are as small, metres were read as millimetres, too.
void add_radians(const Rig& rig, const std::vector<Sample>& samples, int joint, double furthest,
                 const std::function<void(const Mistake&)>& add) {
  for (const Sample& s : samples)
    if (const Pose pose = pose_reading(rig.tree, joint, s.readings);
        pose.rotation.allFinite() &&
        rpy_from_rotation(pose.rotation).cwiseAbs().maxCoeff() > kTurnOfDegrees)
      return;
  const double metres = furthest < kNearBase / 10 ? 1000 : 1;
  const std::string lengths = metres > 1 ? ", and metres as millimetres" : "";
  for (const AngleConvention* written : all_conventions())
    for (const AngleConvention* read : all_conventions())
      add({NoticeKind::convention,
           std::string("have ") + written->name + ", in radians, that were read as " +
               (read == written ? "" : std::string(read->name) + ", in ") + "degrees" + lengths,
           std::string("read them as they are meant (--pose-format ") + written->formats + ")",
           [=](const Pose& pose) { return written_in_radians(*written, *read, metres, pose); }});
}

/// Measured poses of a sensor: quaternions with w first, read with w last, and the reverse.
/// (Those the wrong way round are data of a sensor in its target's place: eye-in-hand. Beside
/// measured poses of the robot, the noise tells which of the two are: kInvertedView.)
const Mistake kViewMistakes[] = {
    {NoticeKind::quaternion, "have their quaternions with w first",
     "write \"quat\": [x, y, z, w] into its views", scalar_first},
    {NoticeKind::quaternion, "have quaternions with w last that were read with w first",
     "write \"quat\": [x, y, z, w] into its views, in this order", scalar_last},
    {NoticeKind::convention,
     "have their rotations the wrong way round (w of the quaternion with the other sign, or a "
     "transposed matrix), but not their positions",
     "change the sign of w: a rotation turns vectors of the target into the sensor's",
     turned_round},
    {NoticeKind::mirrored,
     "are those of a left-handed frame (one axis points the other way, as in Unity or Unreal)",
     "mirror them: where y has the other sign, so have y of the position and x and z of the "
     "quaternion",
     left_handed},
    {NoticeKind::convention,
     "have y and z of their positions exchanged, but not of their rotations",
     "write \"xyz\": [x, y, z]", exchanged_axes<1, 2>},
    {NoticeKind::convention, "have y up in their positions, but not in their rotations",
     "write \"xyz\": [x, -z, y], so that positions and rotations have the same axes",
     [](Pose pose) {
       pose.translation = Vector3d(pose.translation(0), -pose.translation(2), pose.translation(1));
       return pose;
     }}};

const Mistake kInvertedView = {
    NoticeKind::inverted_pose,
    "are given the wrong way round, as those of the sensor in the target",
    "invert them: sensor_T_target maps coordinates of the target to the "
    "sensor's",
    [](const Pose& pose) { return inverse(pose); }};

Undo of_poses(int sensor, const Change& change) {
  return of_views(sensor, [change](const Rig&, View& v) {
    const Pose pose = change(
        {rotation_from_quaternion({v.z[3], v.z[4], v.z[5], v.z[6]}), {v.z[0], v.z[1], v.z[2]}});
    const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
    v.z = {pose.translation(0), pose.translation(1), pose.translation(2), q(0), q(1), q(2), q(3)};
  });
}

}  // namespace

void add_pose_views(const Rig& rig, const ObservationIndex& observations,
                    std::vector<Hypothesis>& out) {
  for (const int s : observations.sensors) {
    if (rig.sensors[s].model->measurement_kind() != MeasurementKind::pose) continue;
    const auto add = [&](const Mistake& mistake) {
      out.push_back(
          {mistake.kind,
           {Subject::sensor(rig.sensors[s].name)},
           "the poses that sensor " + quoted(rig.sensors[s].name) + " measures " + mistake.mistake,
           mistake.cure,
           of_poses(s, mistake.undo)});
      out.back().new_poses = true;
    };
    for (const Mistake& mistake : kViewMistakes) add(mistake);
    if (!observations.floating.empty()) add(kInvertedView);
    add_conventions(add);
  }
}

void add_pose_readings(const Rig& rig, const std::vector<Sample>& samples,
                       const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (const int j : observations.floating) {
    const std::string& name = rig.tree.joints[j].name;
    const auto add = [&](const Mistake& mistake) {
      out.push_back({mistake.kind,
                     {Subject::joint(name)},
                     "the poses of joint " + quoted(name) + " " + mistake.mistake,
                     mistake.cure,
                     [j, undo = mistake.undo](Rig& r, std::vector<Sample>& s) {
                       change_poses(r, s, j, undo);
                     }});
      out.back().new_poses = true;
      out.back().leaves_out = mistake.leaves_out;
    };
    for (const Mistake& mistake : kMistakes) add(mistake);
    add_conventions(add);
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
      add({NoticeKind::units, mistake, cure, [metres](Pose pose) {
             pose.translation *= metres;
             return pose;
           }});
    }
  }
}

}  // namespace kincal
