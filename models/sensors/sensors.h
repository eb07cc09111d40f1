// The built-in sensors. Each has its own header; they are made here by type, so that files can name
// them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "sensor.h"

namespace kincal {

enum class Lens { pinhole, brown_conrady, kannala_brandt, unified, double_sphere };

/// A LensType has the name of a lens in files, and its distortion coefficients.
struct LensType {
  Lens lens;
  const char* name;                  // in rig.yaml
  std::vector<std::string> numbers;  // their names, in order
  std::vector<int> counts;           // permitted numbers of these
  std::vector<double> plain;         // default values; missing ones are 0
};
const std::vector<LensType>& lens_types();
const LensType& lens_type(Lens lens);
/// Returns the lens of a camera with these parameter blocks, identified by the names of its
/// distortion coefficients.
const LensType& lens_type(const std::vector<ParameterBlock>& camera);

/// Makes a camera along +z, x right, y down, px. Its own blocks are "intrinsics" fx fy cx cy,
/// "distortion" (a count that its LensType permits; pinhole: none, the block is absent), "baseline"
/// (m), in this order. @throws std::invalid_argument: a count that the lens does not permit.
std::shared_ptr<const SensorModel> make_camera(Lens lens, int distortion_count);
/// Returns these blocks with component names and units. `distortion` has the number of coefficients
/// that the lens requires.
std::vector<ParameterBlock> camera_parameters(Lens lens, const std::vector<double>& intrinsics,
                                              const std::vector<double>& distortion,
                                              double baseline);
/// Makes a sensor of 3-D points in its own frame, m.
std::shared_ptr<const SensorModel> make_point();
/// Makes the same with a scale and an offset (m) of the range along the ray. Its own blocks are
/// "range_scale" and "range_offset".
std::shared_ptr<const SensorModel> make_ranged_point();
std::vector<ParameterBlock> range_parameters(double scale, double offset);
/// Makes a sensor that measures sensor_T_target as x y z qx qy qz qw.
std::shared_ptr<const SensorModel> make_pose();
/// Makes the same with a scale of the translations. Its own block is "range_scale".
std::shared_ptr<const SensorModel> make_scaled_pose();
std::vector<ParameterBlock> pose_scale(double scale);
/// Makes a chain: its measurement is the joint readings, and the target is at link_T_target. It has
/// no parameter blocks.
std::shared_ptr<const SensorModel> make_chain();
/// Makes a laser with rays (reading of the scanning joint, bearing, range). Its sigmas are of the
/// same three quantities.
std::shared_ptr<const SensorModel> make_tilting_laser();

}  // namespace kincal
