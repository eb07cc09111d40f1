// Floating joints, whose reading is a pose: parent_T_child = origin * reading * exp(d), d = [dx dy
// dz | rx ry rz] the reading's error, one per sample and shared by all its sensors.
//
// A floating joint is opened into twelve joints of one degree of freedom, behind its origin:
//     Tx(x) Ty(y) Tz(z) Rz(yaw) Ry(pitch) Rx(roll)   the reading: exact, without derivatives
//     Tx(dx) Ty(dy) Tz(dz) Rx(drx) Ry(dry) Rz(drz)   its error: their readings are 0
// No other code needs to handle poses: errors are latent, marginal or drawn as those of any
// joint. The product of the second row differs from exp(d) by products of two errors (1e-8 m at
// 0.1 mm and 0.1 mrad), which is negligible. The first row's angles are not unique at some poses,
// which does no harm: any angles that give the rotation serve.
#pragma once

#include <string>
#include <vector>

#include "tree.h"

namespace kincal {

constexpr int kPoseAxes = 6;  // of the reading, and as many of the error behind them

/// Opens all floating joints. Their axes and the links between these are appended, so that existing
/// indices remain. Axes are named JOINT.x ... and JOINT.dx ...
void open_floating(Tree& tree);

/// Writes the reading of an opened floating joint to its axes and sets the errors to 0.
void set_pose_reading(const Tree& tree, int joint, const Pose& pose, std::vector<double>& readings);

/// Returns the pose given by the axes of an opened floating joint, errors included. It is not
/// finite where readings are absent (NaN).
Pose pose_reading(const Tree& tree, int joint, const std::vector<double>& readings);

/// Returns the name of the joint that has this joint's reading: the floating joint of an axis, else
/// the joint itself.
const std::string& read_name(const Tree& tree, int joint);

/// True for a link made by opening a joint; no part of the robot is on it.
bool is_between_axes(const Tree& tree, int link);

/// Returns the joints whose readings have the same sigma as this joint's: for an error axis of a
/// floating joint its three errors in metres or in radians, else the joint itself.
std::vector<int> same_noise(const Tree& tree, int joint);

}  // namespace kincal
