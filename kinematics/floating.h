// Floating joints, whose reading is a pose: parent_T_child = origin * reading * exp(d), d = [dx dy
// dz | rx ry rz] the reading's error, one per sample and shared by all its sensors.
//
// A floating joint is opened into twelve joints of one degree of freedom, behind its origin:
//     Tx(x) Ty(y) Tz(z) Rz(yaw) Ry(pitch) Rx(roll)   the reading; exact, with no derivative asked
//     Tx(dx) Ty(dy) Tz(dz) Rx(drx) Ry(dry) Rz(drz)   its error: their readings are 0
// Nothing else has to know of poses then: errors are latent, marginal or drawn as those of any
// joint. The product of the second row differs from exp(d) by products of two errors (1e-8 m at
// 0.1 mm and 0.1 mrad), which no data show. That the first row has poses at which its angles are
// not unique does no harm: any angles that make the rotation will do.
#pragma once

#include <string>
#include <vector>

#include "tree.h"

namespace kincal {

constexpr int kPoseAxes = 6;  // of the reading, and as many of the error behind them

/// Opens all floating joints; axes and the links between them stand behind all others, so that
/// indices stay. Axes are called JOINT.x ... and JOINT.dx ...
void open_floating(Tree& tree);

/// Writes the reading of an opened floating joint to its axes; the errors become 0.
void set_pose_reading(const Tree& tree, int joint, const Pose& pose, std::vector<double>& readings);

/// Returns the pose that the axes of an opened floating joint make, errors included; not finite
/// where readings are absent (NaN).
Pose pose_reading(const Tree& tree, int joint, const std::vector<double>& readings);

/// Returns the name of the joint that has the reading of this one: of an axis of a floating joint
/// that joint's.
const std::string& read_name(const Tree& tree, int joint);

/// True for a link that opening a joint has made: nothing of a robot sits on it.
bool is_between_axes(const Tree& tree, int link);

/// Returns the joints whose readings have the same sigma as this joint's: three errors of a
/// floating joint, in metres or in radians; of others the joint itself.
std::vector<int> same_noise(const Tree& tree, int joint);

}  // namespace kincal
