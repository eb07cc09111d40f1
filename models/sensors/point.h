// Sensor of 3-D points in its own frame: laser tracker, depth camera, 3-D lidar. Residual:
// predicted - measured point, m.
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

}  // namespace kincal
