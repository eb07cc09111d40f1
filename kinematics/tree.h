// A robot as a tree of links and joints, paths between two of its frames, and their derivatives.
//
// Every joint places its child link relative to its parent link:
//     parent_T_child = parent_T_joint * motion(position),
// parent_T_joint (the URDF's origin) constant, motion a rotation about or a translation along a
// unit axis given in the joint's frame. The calibrated position of a joint is  scale * reading +
// offset  (done by the caller); a mimic joint has  position = multiplier * position(master) +
// offset  and no reading of its own. A master that is fixed, floating or planar counts as 0: a
// joint that follows it does not move.
//
// A path a -> b goes up from a to the common ancestor and down to b; the joints above the ancestor
// cancel and are not walked. Going down a joint multiplies by  origin * motion(q), going up by
// motion(-q) * origin^-1. With F = a_T_joint, the joint's frame before its motion, both directions
// give for a_T_b' = exp(twist) a_T_b (a twist of b as seen from a):
//     by the position:              twist = direction * Ad_F [0 | axis]  (revolute),
//                                           direction * Ad_F [axis | 0]  (prismatic)
//     by the origin's increment xi: twist = direction * Ad_F xi          (parent_T_joint exp(xi))
// because exp(xi) and the motion act next to each other in F, and inverting a product flips the
// sign.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "transform.h"

namespace kincal {

/// A LinkMass is the mass (kg) and the centre of mass of a link, from a URDF's inertial.
struct LinkMass {
  double mass = 0;
  Vector3d centre = Vector3d::Zero();
};

enum class JointType { fixed, revolute, continuous, prismatic, floating, planar };

struct Mimic {
  int master = -1;  // index of a joint
  double multiplier = 1, offset = 0;
};

/// A PoseAxis is the role of a joint in an opened floating joint (floating.h): part of the reading,
/// or of its error.
enum class PoseAxis { none, reading, error };

struct Joint {
  std::string name;
  JointType type = JointType::fixed;
  int parent = -1, child = -1;        // link indices
  Pose parent_T_joint;                // the URDF's origin
  Vector3d axis = Vector3d::UnitX();  // unit length, in the joint's frame; meaningless where !moves
  std::optional<Mimic> mimic;
  std::optional<double> stands_at;  // its only position, if it follows a joint without an axis
  double lower = 0, upper = 0;      // limits, rad or m; lower == upper: none given
  PoseAxis axis_of_pose = PoseAxis::none;
  int floating = -1;    // of an axis of a floating joint: that joint
  int first_axis = -1;  // of an opened floating joint: its first axis

  /// True for a joint with a rotation or sliding axis, even if its position is constant.
  bool has_axis() const {
    return type == JointType::revolute || type == JointType::continuous ||
           type == JointType::prismatic;
  }
  /// True if the joint has one degree of freedom, as this module requires.
  bool moves() const { return has_axis() && !stands_at; }
  /// True if the joint keeps its child at a constant pose.
  bool is_rigid() const { return type == JointType::fixed || stands_at; }
  /// True if the joint moves and mimics no other.
  bool drives() const { return moves() && !mimic; }
  /// True if the joint moves and has a reading of its own (so also an offset, a scale and a noise).
  bool has_reading() const { return drives() && axis_of_pose == PoseAxis::none; }
};

/// A Tree is the topology and nominal geometry of a robot. It does not change after finish_tree().
struct Tree {
  std::vector<std::string> links;
  std::vector<Joint> joints;
  std::vector<int> joint_above;  // per link: the joint whose child it is, -1 for the root
  int root = -1;                 // link index

  /// Both return an index by name; -1 if there is none.
  int find_link(const std::string& name) const;
  int find_joint(const std::string& name) const;
};

/// Fills joint_above, root and stands_at and checks the structure. Joints must have valid link
/// indices and unit axes.
/// @throws std::invalid_argument naming the links or joints: no link; several roots; a link with
/// two parents; a loop (also one detached from the root); a mimic loop.
void finish_tree(Tree& tree);

/// A Driver is the joint that a joint follows through all mimics: position(joint) = factor *
/// position(driver) + offset. A joint that mimics no other is its own driver, with 1 and 0. The
/// driver has no reading if it cannot move.
struct Driver {
  int joint;
  double factor, offset;
};
Driver driver(const Tree& tree, int joint);

/// Computes the positions of followers from those of the other joints. `positions` has one entry
/// per joint.
void follow_mimics(const Tree& tree, std::vector<double>& positions);

struct PathStep {
  int joint;
  int direction;  // +1: from parent to child, -1: from child to parent
};
using Path = std::vector<PathStep>;

/// Returns the joints on the path from link `from` to link `to`, without those above the common
/// ancestor.
/// @throws std::invalid_argument if a planar joint, or a floating one that is not opened, lies on
/// the path.
Path find_path(const Tree& tree, int from, int to);

/// Returns the range of positions to use for a joint: its limits; for continuous joints and those
/// without limits +-pi or +-0.5 m; (0, 0) for an error axis of a floating joint.
std::pair<double, double> usual_range(const Joint& joint);

/// Returns the motion of a joint at a position (rad or m). If its position is constant, `position`
/// is ignored; without an axis the motion is the identity.
Pose joint_motion(const Joint& joint, double position);

/// Returns parent_T_child of a joint; if the joint can move, at position 0.
inline Pose pose_at_zero(const Joint& joint) {
  return joint.parent_T_joint * joint_motion(joint, 0);
}

/// Walks one step of a path from a_T_from, the frame before it, to a_T_to. a_T_joint becomes the
/// joint's frame before its motion.
inline void walk(const PathStep& step, const Pose& origin, const Pose& motion, const Pose& a_T_from,
                 Pose& a_T_joint, Pose& a_T_to) {
  if (step.direction > 0) {
    a_T_joint = a_T_from * origin;
    a_T_to = a_T_joint * motion;
  } else {
    a_T_joint = a_T_from * inverse(motion);
    a_T_to = a_T_joint * inverse(origin);
  }
}

/// Returns the twist [v | w], seen from a, of everything behind a joint per unit of its position
/// (see the top of this file).
inline Vector6d position_twist(const Joint& joint, int direction, const Pose& a_T_joint) {
  Vector6d twist;
  const Vector3d axis = direction * (a_T_joint.rotation * joint.axis);
  if (joint.type == JointType::prismatic)
    twist << axis, Vector3d::Zero();
  else
    twist << a_T_joint.translation.cross(axis), axis;
  return twist;
}

/// Returns root_T_link of every link. `origins` (parent_T_joint) and `positions` have one entry per
/// joint. Floating and planar joints are placed at their origin.
std::vector<Pose> link_poses(const Tree& tree, const std::vector<Pose>& origins,
                             const std::vector<double>& positions);

/// Folds joint offsets into origins: origin' = origin * motion(axis, offset). A mimic follower of a
/// joint with offset d gets motion(axis, multiplier * d) in its own origin (through chains of
/// mimics the product of multipliers). `origins` and `offsets` have one entry per joint.
std::vector<Pose> fold_offsets(const Tree& tree, const std::vector<Pose>& origins,
                               const std::vector<double>& offsets);

}  // namespace kincal
