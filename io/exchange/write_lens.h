// The numbers of a camera's lens as files of other programs: ROS's camera_info, OpenCV's YAML,
// Kalibr's camchain.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"
#include "lens.h"

namespace kincal {

/// Writes the YAML of camera_calibration_parsers (ROS 1 and 2). R is the identity and P has K, with
/// the baseline in Tx. @throws InputError without an image size
std::string camera_info_text(const LensNumbers& lens);

/// Writes OpenCV's YAML, with the names of its calibration program. `notes` gets what such a file
/// cannot hold.
std::string opencv_text(const LensNumbers& lens, std::vector<std::string>& notes);

/// Writes Kalibr's camchain. `before[i]` is the pose of camera i - 1 in camera i, where that is
/// known. @throws InputError where a lens is none of Kalibr's, and without an image size
std::string kalibr_text(const std::vector<LensNumbers>& lenses,
                        const std::vector<std::optional<Pose>>& before);

}  // namespace kincal
