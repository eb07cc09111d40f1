// The sensors that kincal knows, each with its header; made here by type so that files can name
// them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "sensor.h"

namespace kincal {

enum class Lens { pinhole, brown_conrady, kannala_brandt, unified, double_sphere };

/// A LensType says what files call a lens, and its distortion.
struct LensType {
  Lens lens;
  const char* name;                  // as rig.yaml has it
  std::vector<std::string> numbers;  // their names, in order
  std::vector<int> counts;           // how many of them a camera may have
  std::vector<double> plain;         // where nothing is known of them; as many zeros more as it has
};
const std::vector<LensType>& lens_types();
const LensType& lens_type(Lens lens);
/// Returns the lens of a camera with these blocks of own numbers, by the names of its distortion.
const LensType& lens_type(const std::vector<ParameterBlock>& camera);

/// Makes a camera along +z, x right, y down, px. Its own blocks are "intrinsics" fx fy cx cy,
/// "distortion" (as many numbers as its LensType allows; pinhole: none, the block absent),
/// "baseline" (m), in this order. @throws std::invalid_argument: so many numbers it does not have.
std::shared_ptr<const SensorModel> make_camera(Lens lens, int distortion_count);
/// Returns the blocks above with component names and units; `distortion` has as many numbers as the
/// lens asks.
std::vector<ParameterBlock> camera_parameters(Lens lens, const std::vector<double>& intrinsics,
                                              const std::vector<double>& distortion,
                                              double baseline);
/// Makes a sensor of 3-D points in its own frame, m.
std::shared_ptr<const SensorModel> make_point();
/// Makes the same with scale and offset (m) of the range along the ray. Its own blocks are
/// "range_scale" and "range_offset".
std::shared_ptr<const SensorModel> make_ranged_point();
std::vector<ParameterBlock> range_parameters(double scale, double offset);
/// Makes a sensor of sensor_T_target; its numbers are x y z qx qy qz qw.
std::shared_ptr<const SensorModel> make_pose();
/// Makes a chain: the joint readings are the measurement, the target is at link_T_target. It has no
/// numbers.
std::shared_ptr<const SensorModel> make_chain();
/// Makes a laser of rays (reading of the scanning joint, bearing, range); its sigma has the same
/// three.
std::shared_ptr<const SensorModel> make_tilting_laser();

}  // namespace kincal
