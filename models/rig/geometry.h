// The independent geometric numbers of kinematic chains: which components of joint origins a
// calibration can distinguish.
//
// A chain from one link to another with n_r revolute and n_p prismatic joints has 4 n_r + 2 n_p + 6
// independent constants (Everett, Driels, Mooring 1987): four place the axis of a revolute joint,
// two turn that of a prismatic one, six place the end. The origins of n joints have 6 n components.
// What is too much is found numerically, so that parallel, crossing and oblique axes, rotated
// origins and any path through the tree need no cases: with twists t(q) of base_T_tip by every
// component (kinematics/tree.h) in some postures q, one under the other as a column, a component is
// kept if what projection on all columns before it leaves of its column is more than 0.5 % of it
// (modified Gram-Schmidt). Rotations and translations are weighed by the chain's reach. The order:
//   1. The six numbers of the poses at both ends, where a sensor or mounted target stands on the
//   end's link or on one fixed to it.
//      They are not joint origins and not in the result: sensor/NAME/pose and target/NAME/pose have
//      them.
//   2. Joint by joint from base to tip x y z rx ry rz, without what the joint's own motion commutes
//   with: the translation and rotation
//      along its axis (of an oblique axis: the component with the largest share), every translation
//      of a prismatic joint. These move everything beyond the joint in the same way as the
//      neighbour's origin, and come back there.
//   3. Those along axes, which are needed only where no pose stands at an end.
//   4. Origins of fixed joints, which are needed only to place an end without a pose.
// Several chains at once give the numbers that are independent in all of them together.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../kinematics/tree.h"
#include "random_stream.h"

namespace kincal {

struct Chain {
  int base = -1, tip = -1;  // links
};

/// These are components (0 to 5: x y z rx ry rz) of a joint's origin.
struct OriginComponents {
  int joint = -1;
  std::vector<int> components;  // ascending
};

/// Returns the component (0 to 2) of a vector that lies along an axis, of an oblique one that with
/// the largest share (of equal ones the last).
int component_along(const Vector3d& axis);

/// Returns the link that carries `link` by fixed joints only, closest to the root: the same for all
/// links of a rigid body.
int body_of(const Tree& tree, int link);

/// Draws the readings of joints that drive within their usual ranges; leaves the others.
void draw_readings(const Tree& tree, RandomStream& draws, std::vector<double>& readings);

/// Returns the independent components at the tree's own geometry, found in 40 postures within the
/// limits (none: +- pi, +- 0.5 m) with a fixed seed. The joints stand in the order of the chains.
/// `has_pose`, by link, says that a sensor or mounted target stands on it.
/// @throws std::invalid_argument if a floating or planar joint lies on a path.
std::vector<OriginComponents> independent_geometry(const Tree& tree,
                                                   const std::vector<Chain>& chains,
                                                   const std::vector<char>& has_pose);

}  // namespace kincal
