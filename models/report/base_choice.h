// What nothing can tell of the base frame.
//
// Things that stand at the base (a camera in the room, a tracker, a board on the table) with a pose
// to be estimated move with the first joint: its zero and origin, and where the base frame is, are
// the same numbers. No posture tells them apart, and no measurement depends on the choice; a prior,
// or the width of a group, makes it, and is all that the poses at the base are known to. That is
// harmless, unlike the same sigma of anything else.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>

#include "report.h"

namespace kincal {

struct BaseChoice {
  std::string joint;                  // the first one
  std::string number;                 // of it: the name of the one that matters most
  bool is_zero = true;                // that is its offset; else a number of its origin
  std::map<Component, double> sigma;  // of poses at the base, were this joint's numbers known
};

/// Returns it for a report that is otherwise complete; nothing where the first joints are
/// determined or held, or nothing at the base is estimated.
std::optional<BaseChoice> base_choice(const Report& report);

/// Returns the sigma of a component by which to judge how well it is known: what it would be
/// without the base's choice. (One above 0.3 m or 30 degrees stays as it is: that is no choice.)
double sigma_to_judge(const std::optional<BaseChoice>& choice, const ParameterEstimate& e,
                      size_t c);

}  // namespace kincal
