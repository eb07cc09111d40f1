// The position of a joint from its reading, its model, readings of others and the conditions of the
// sample:
//
//     position = model(q) + backlash * approach + temperature * (T - T0)
//              + sum_N (c1 cos(N q) + c2 sin(N q) + c3 cos(2 N q) + c4 sin(2 N q))
//              + sum_o coupling_o * q_o,    q = reading + rate * (time_offset + row * line_time),
//
// time_offset (s) of the sensor whose view it is: how much later than the readings the sensor
// measured. Everything between the sensor and its target, and between a sensor of a free target and
// the base, is where it was then. A camera with a rolling shutter sees each point at the time of
// its row, line_time (s) after the row before: time_offset is that of row 0, and `row` the measured
// v of the point. T is the sample's temperature, T0 = 20 degrees, N a gear ratio of
// the joint (the ripple of its gear), q_o the reading of a joint that it is coupled to
// (models/joints/joint_model.h has the model). A condition that a sample does not state adds
// nothing. The parameters of these terms are the joint's own numbers behind those of its model, in
// this order, and exist where the rig sets them (JointTerms). A scanning joint's rays have their
// own readings and no conditions; it has neither ripple nor coupling.
#pragma once

#include <cmath>

#include "rig.h"
#include "samples.h"

namespace kincal {

/// Returns a joint's value of a condition; 0: the sample does not state it.
inline double stated(const std::vector<double>& condition, int joint) {
  return condition.empty() ? 0 : condition[joint];
}

/// Returns how much warmer than kReferenceTemperature it is, K; 0: it is not stated.
inline double warmer(const Conditions& at) {
  return at.temperature ? *at.temperature - kReferenceTemperature : 0;
}

/// Returns value `part` (of kRipple) of the ripple with a gear ratio at a reading (rad), per unit.
inline double ripple_at(double ratio, int part, double reading) {
  const double angle = (part < 2 ? 1 : 2) * ratio * reading;
  return part % 2 == 0 ? std::cos(angle) : std::sin(angle);
}

/// Returns which of a joint's own numbers is the first of its ripple.
inline int first_of_ripple(const JointSettings& settings) {
  return settings.model->size() + (settings.terms.backlash ? 1 : 0) +
         (settings.terms.temperature ? 1 : 0);
}

/// Returns which of a joint's own numbers is the first of its coupling.
inline int first_of_coupling(const JointSettings& settings) {
  return first_of_ripple(settings) + static_cast<int>(settings.terms.ripple.size());
}

/// Returns d position / d own[k]. `own` are the joint's numbers, from the offset on; `reading_of`
/// returns the reading (rad or m) of any joint.
template <class ReadingOf>
double by_own_number(const Rig& rig, int joint, int k, const ReadingOf& reading_of,
                     const double* own, const Conditions& at) {
  const JointSettings& settings = rig.joints[joint];
  const JointModel& model = *settings.model;
  if (k < model.size()) return model.by_own(k, reading_of(joint), own);
  const int ripple = first_of_ripple(settings), coupling = first_of_coupling(settings);
  if (k >= coupling) return reading_of(settings.terms.coupled_to[k - coupling]);
  if (k >= ripple)
    return ripple_at(settings.terms.gear_ratios[(k - ripple) / kRipple], (k - ripple) % kRipple,
                     reading_of(joint));
  return settings.terms.backlash && k == model.size() ? stated(at.approach, joint) : warmer(at);
}

/// Returns the position (rad or m) of a joint.
template <class ReadingOf>
double position_of(const Rig& rig, int joint, const ReadingOf& reading_of, const double* own,
                   const Conditions& at) {
  const JointSettings& settings = rig.joints[joint];
  double out = settings.model->position(reading_of(joint), own);
  const int end = first_of_coupling(settings) + static_cast<int>(settings.terms.coupling.size());
  for (int k = settings.model->size(); k < end; ++k)
    out += own[k] * by_own_number(rig, joint, k, reading_of, own, at);
  return out;
}

/// Returns d position / d reading of joint `by`: the joint itself, or one that it is coupled to.
inline double by_reading_of(const Rig& rig, int joint, int by, double reading, const double* own) {
  const JointSettings& settings = rig.joints[joint];
  const JointTerms& terms = settings.terms;
  double out = by == joint ? settings.model->by_reading(reading, own) : 0;
  const double* ripple = own + first_of_ripple(settings);
  for (size_t k = 0; by == joint && k < terms.ripple.size(); k += 2) {
    const double ratio = (k % kRipple == 0 ? 1 : 2) * terms.gear_ratios[k / kRipple];
    out +=
        ratio * (ripple[k + 1] * std::cos(ratio * reading) - ripple[k] * std::sin(ratio * reading));
  }
  const double* coupling = own + first_of_coupling(settings);
  for (size_t k = 0; k < terms.coupling.size(); ++k)
    if (terms.coupled_to[k] == by) out += coupling[k];
  return out;
}

/// Calls use(by) with each joint on whose reading the position of a joint depends: itself, then
/// those that it is coupled to.
template <class Use>
void for_each_reading(const Rig& rig, int joint, const Use& use) {
  use(joint);
  if (!rig.joints[joint].terms.coupling.empty())
    for (const int other : rig.joints[joint].terms.coupled_to) use(other);
}

/// Returns whether the position of a joint depends on own[k] in a piece of its model's range.
inline bool depends_on(const JointModel& model, int k, int piece) {
  return k >= model.size() || model.depends(k, piece);
}

}  // namespace kincal
