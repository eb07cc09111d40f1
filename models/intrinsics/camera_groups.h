// Cameras without a robot: which of them are calibrated together, and the recordings of these.
#pragma once

#include <vector>

#include "../rig/rig.h"
#include "../rig/samples.h"

namespace kincal {

/// Whether a sensor is a camera with intrinsics.
bool has_lens(const Sensor& sensor);

/// Returns the rig with every board free and every sensor on the base, so that samples need no
/// joint readings.
Rig without_robot(Rig rig);

/// Returns one link that the given cameras stand on, the first at its origin; every board is free.
Rig bench(const Rig& rig, const std::vector<int>& cameras);

/// Returns the training samples with the views of the given cameras that tell a pose; sensors are
/// those of bench().
std::vector<Sample> seen_by(const Rig& rig, const std::vector<Sample>& samples,
                            const std::vector<int>& cameras);

/// Returns the views of one sensor; they live as long as the samples.
std::vector<const View*> camera_views(const std::vector<Sample>& samples, int sensor);

/// Returns cameras that are calibrated together: on one rigid body, and tied by boards that they
/// see in the same samples.
std::vector<std::vector<int>> camera_groups(const Rig& rig, const std::vector<Sample>& samples,
                                            const std::vector<int>& cameras);

}  // namespace kincal
