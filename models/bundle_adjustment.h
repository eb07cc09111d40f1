// Bundle adjustment in the large (Agarwal et al., ECCV 2010): free points seen by free cameras, through the same solver.
#pragma once

#include <memory>
#include <vector>

#include "../solver/problem.h"

namespace kincal {

/// Camera c: 9 numbers (rotation vector, translation, f, k1, k2); p_camera = R p + t, the camera looks along -z:
/// q = -p_camera.xy / p_camera.z, pixel = f (1 + k1 |q|^2 + k2 |q|^4) q. Cost = 1/2 sum |predicted - observed|^2.
struct BundleAdjustmentData {
  std::vector<double> cameras;             // 9 each
  std::vector<double> points;              // 3 each
  std::vector<int> camera_of, point_of;    // by observation
  std::vector<double> pixels;              // 2 each
};

}  // namespace kincal
