// The sensors that kincal knows, each with its header; made here by type so that files can name
// them.
#pragma once

#include <memory>

#include "sensor.h"

namespace kincal {

enum class Lens { pinhole, brown_conrady, kannala_brandt };

/// Makes a camera along +z, x right, y down, px. Its own blocks are "intrinsics" fx fy cx cy,
/// "distortion" (brown_conrady: 5 k1 k2 p1 p2 k3 or 8 with k4 k5 k6; kannala_brandt: 4 k1 k2 k3 k4;
/// pinhole: 0, the block absent), "baseline" (m), in this order.
std::shared_ptr<const SensorModel> make_camera(Lens lens, int distortion_count);
/// Returns the blocks above with component names and units; `distortion` has 0, 4, 5 or 8 numbers
/// as the lens asks.
std::vector<ParameterBlock> camera_parameters(Lens lens, const std::vector<double>& intrinsics,
                                              const std::vector<double>& distortion,
                                              double baseline);
/// Makes a sensor of 3-D points in its own frame, m.
std::shared_ptr<const SensorModel> make_point();
/// Makes a sensor of sensor_T_target; its numbers are x y z qx qy qz qw.
std::shared_ptr<const SensorModel> make_pose();
/// Makes a chain: the joint readings are the measurement, the target is at link_T_target. It has no
/// numbers.
std::shared_ptr<const SensorModel> make_chain();
/// Makes a laser of rays (reading of the scanning joint, bearing, range); its sigma has the same
/// three.
std::shared_ptr<const SensorModel> make_tilting_laser();

}  // namespace kincal
