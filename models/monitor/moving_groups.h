// What of a robot moves together when it is hit or repaired: the mount of a sensor or target, the
// offset of a joint, a camera's intrinsics with its distortion, a baseline, a range's scale or
// offset.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../rig/parameters.h"

namespace kincal {

/// Returns the groups by name. Joints count that can show in samples; an estimated origin of a
/// joint counts as a mount if it carries a sensor or target whose own mount is not estimated.
std::vector<std::pair<std::string, std::vector<Component>>> moving_groups(
    const Rig& rig, const ParameterTable& table, const std::vector<Component>& estimated);

/// Followed are the unknowns of a monitor: all that was estimated or may move, poses as a whole.
struct Followed {
  std::vector<std::pair<std::string, std::vector<Component>>> groups;  // moving_groups()
  std::vector<Freed> free;
  std::vector<Component> columns;  // of `free`, in its order
};
Followed followed(const Rig& rig, const ParameterTable& table,
                  const std::vector<Component>& estimated);

}  // namespace kincal
