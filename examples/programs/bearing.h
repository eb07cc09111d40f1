// A direction finder. Looks along +z, x right, y down.
//   azimuth = gain atan2(x, z),   elevation = atan2(y, hypot(x, z)),   rad
#pragma once

#include <kincal/extend.h>
#include <cmath>

struct Bearing {
  static constexpr int kRows = 2, kMeasurementSize = 2;
  int parameter_count() const { return 1; }  // gain

  bool residual(const double* parameters, const kincal::Vector3d& p, const double* z, double* r,
                double* d_r_d_point, double* d_r_d_parameters) const {
    const double gain = parameters[0], rho2 = p.x() * p.x() + p.z() * p.z(), rho = std::sqrt(rho2);
    if (!(p.z() > 1e-9)) return false;  // behind the sensor: undefined
    const double azimuth = std::atan2(p.x(), p.z()), elevation = std::atan2(p.y(), rho);
    r[0] = gain * azimuth - z[0];  // predicted - measured
    r[1] = elevation - z[1];
    if (!d_r_d_point) return true;
    const double s = p.squaredNorm();
    d_r_d_point[0] = gain * p.z() / rho2, d_r_d_point[1] = 0, d_r_d_point[2] = -gain * p.x() / rho2;
    d_r_d_point[3] = -p.y() * p.x() / (rho * s), d_r_d_point[4] = rho / s,
    d_r_d_point[5] = -p.y() * p.z() / (rho * s);
    d_r_d_parameters[0] = azimuth;
    d_r_d_parameters[1] = 0;
    return true;
  }
};
