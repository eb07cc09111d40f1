// Sensor of 3-D points in its own frame: laser tracker, depth camera, 3-D lidar. Residual:
// predicted - measured point, m.
//
// Depth cameras and lidars measure the range along a ray wrongly: with d = |p| the point appears at
//     (scale + offset / d) p.
// A RangedPoint has these two numbers of its own. In the sensor's own origin there is no ray: it is
// undefined there unless the offset is 0, where the offset's derivative is 0.
#pragma once

#include "sensor.h"

namespace kincal {

struct PointSensor {
  static constexpr int kRows = 3, kMeasurementSize = 3;
  int parameter_count() const { return 0; }

  bool residual(const double*, const Vector3d& p, const double* z, double* r, double* d_p,
                double*) const {
    for (int i = 0; i < 3; ++i) r[i] = p(i) - z[i];
    if (d_p)
      for (int i = 0; i < 9; ++i) d_p[i] = i % 4 == 0;
    return true;
  }
};

/// This is the same with scale and offset (m) of the range.
struct RangedPoint {
  static constexpr int kRows = 3, kMeasurementSize = 3;
  int parameter_count() const { return 2; }

  bool residual(const double* parameters, const Vector3d& p, const double* z, double* r,
                double* d_p, double* d_own) const {
    const double scale = parameters[0], offset = parameters[1], range = p.norm();
    const bool ray = range > 1e-9;
    if (!ray && offset != 0) return false;
    const Vector3d along = ray ? Vector3d(p / range) : Vector3d(0, 0, 0);
    const double longer = ray ? offset / range : 0;
    for (int i = 0; i < 3; ++i) {
      r[i] = (scale + longer) * p(i) - z[i];
      if (!d_p) continue;
      for (int j = 0; j < 3; ++j)
        d_p[3 * i + j] = (i == j ? scale + longer : 0) - longer * along(i) * along(j);
      d_own[2 * i] = p(i);
      d_own[2 * i + 1] = along(i);
    }
    return true;
  }
};

}  // namespace kincal
