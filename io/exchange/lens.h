// A camera's lens as plain numbers: what rig.yaml has of it, and what the files of other programs
// are read into and written from.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../models/rig/rig.h"
#include "rig_entry.h"

namespace kincal {

struct LensNumbers {
  std::string name;                // of the camera; "" where a file has none
  std::string model = "pinhole";   // as in rig.yaml: pinhole, brown_conrady, ...
  std::vector<double> intrinsics;  // fx fy cx cy
  std::vector<double> distortion;  // as in rig.yaml
  std::optional<double> baseline;  // m; none: unknown
  int width = 0, height = 0;       // px; 0: unknown
};

/// Returns a number with a point: readers of YAML 1.1 (PyYAML, OpenCV) take 1 for an integer and
/// 1e-05 for a text.
std::string real_text(double value);

/// Returns what a rig's camera has.
LensNumbers lens_of(const Sensor& camera);

/// Returns the keys of rig.yaml that say the same; what is unknown has none.
RigKeys lens_keys(const LensNumbers& lens);

/// Returns the sensors of these names; without names all cameras of the rig.
/// @throws InputError: an unknown name, a sensor that is no camera, no camera at all
std::vector<const Sensor*> cameras_of(const Rig& rig, const std::vector<std::string>& names);

}  // namespace kincal
