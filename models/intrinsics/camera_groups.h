// Cameras without a robot: the groups that are calibrated together, and their recordings.
#pragma once

#include <vector>

#include "../rig/rig.h"
#include "../rig/samples.h"

namespace kincal {

/// Returns whether a sensor is a camera with intrinsics.
bool has_lens(const Sensor& sensor);

/// Returns the rig with all boards free and all sensors on the base, so that samples need no joint
/// readings.
Rig without_robot(Rig rig);

/// Returns a rig of one link with the given cameras, the first at its origin; all boards are free.
Rig bench(const Rig& rig, const std::vector<int>& cameras);

/// Returns the training samples with those views of the given cameras that determine a pose. Sensor
/// indices are those of bench().
std::vector<Sample> seen_by(const Rig& rig, const std::vector<Sample>& samples,
                            const std::vector<int>& cameras);

/// Returns the views of one sensor; the pointers are valid while the samples exist.
std::vector<const View*> camera_views(const std::vector<Sample>& samples, int sensor);

/// Returns groups of cameras that are calibrated together: on one rigid body, and connected by
/// boards that they see in the same samples.
std::vector<std::vector<int>> camera_groups(const Rig& rig, const std::vector<Sample>& samples,
                                            const std::vector<int>& cameras);

}  // namespace kincal
