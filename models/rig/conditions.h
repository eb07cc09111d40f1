// The position of a joint from its reading, its model and the conditions of the sample:
//
//     position = model(reading + rate * time_offset) + backlash * approach,
//
// time_offset (s) of the sensor whose view it is: how much later than the readings the sensor
// measured. Everything between the sensor and its target, and between a sensor of a free target and
// the base, is where it was then.
// (models/joints/joint_model.h has the model.) A condition that a sample does not state adds
// nothing. The parameters of these terms are the joint's own numbers behind those of its model, and
// exist where the rig states them (JointSettings). A scanning joint's rays have their own readings
// and no conditions.
#pragma once

#include "rig.h"
#include "samples.h"

namespace kincal {

/// Returns a joint's value of a condition; 0: the sample does not state it.
inline double stated(const std::vector<double>& condition, int joint) {
  return condition.empty() ? 0 : condition[joint];
}

/// Returns the position (rad or m) of a joint with a reading. `own` are its numbers, from the
/// offset on.
inline double position_of(const Rig& rig, int joint, double reading, const double* own,
                          const Conditions& at) {
  const JointSettings& settings = rig.joints[joint];
  double out = settings.model->position(reading, own);
  if (settings.backlash) out += own[settings.model->size()] * stated(at.approach, joint);
  return out;
}

/// Returns d position / d own[k].
inline double by_own_number(const Rig& rig, int joint, int k, double reading, const double* own,
                            const Conditions& at) {
  const JointModel& model = *rig.joints[joint].model;
  return k < model.size() ? model.by_own(k, reading, own) : stated(at.approach, joint);
}

/// Returns whether the position of a joint depends on own[k] in a piece of its model's range.
inline bool depends_on(const JointModel& model, int k, int piece) {
  return k >= model.size() || model.depends(k, piece);
}

}  // namespace kincal
