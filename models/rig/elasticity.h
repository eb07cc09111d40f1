// A rig whose joints bend: which joints, what they carry, and the loads that it begins with.
//
// Every joint bends that turns and has a reading of its own, but for those that scan for a sensor.
// Loads have all links that a joint moves; links that are fixed to them are part of them. In the
// balance of weights a joint without a reading in a sample, and one that scans, stands at 0.
//
// Only the products of loads and compliances are found, so one factor of all is free: it stays at
// that of the loads that the rig begins with. Those come from the URDF's inertials where three
// links or more have a mass, else from rods of 1 kg from joint to joint, the last to the
// sensors and targets there.
#pragma once

#include "parameters.h"

namespace kincal {

/// Returns a rig's elasticity with compliances of zero and these loads.
/// @throws std::invalid_argument: a joint that moves stands between the root and the base, so
/// gravity has no direction.
Elasticity nominal_elasticity(const Rig& rig);

/// Returns whether anything bends: some compliance is not 0.
bool bends(const Elasticity& elasticity);

/// Makes the skeleton of an elasticity whose `turned` has changed.
void turn_skeleton(const Tree& tree, Elasticity& elasticity);
/// Returns the elasticity with a rig's values, for joints into whose origins their offsets have
/// been folded (fold_offsets() of kinematics/tree.h): a stator's directions turn back by them.
Elasticity folded_elasticity(const Rig& rig, const ParameterTable& table, const VectorXd& values);

/// Returns whether a rig has an elasticity: a joint that bends, and a base that stands.
bool can_bend(const Rig& rig);

/// Sets compliances and gravity of a posture to a rig's values, and loads to these and those of the
/// payload (an index; -1: none): its mass sits where it is in the link that carries it, and in
/// others at the nominal origin of the next joint that moves, a slide at 0.
void set_elasticity(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                    int payload, BentPosture& at);

/// Returns whether a joint stands at 0 in the balance of weights at these readings.
bool stands_for_balance(const Rig& rig, const std::vector<double>& readings, int joint);

}  // namespace kincal
