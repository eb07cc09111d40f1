// Camera lenses. The camera looks along +z, x right, y down; (0, 0) is the centre of the top-left pixel.
//
// Own numbers, block after block:  fx fy cx cy | distortion | baseline.
// With X = x - baseline (a rectified right camera of a stereo pair sits `baseline` to the right):
//   pinhole, brown_conrady (as OpenCV):  u = X/z, v = y/z, s = u^2 + v^2,
//       radial = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3),
//       a = u radial + 2 p1 u v + p2 (s + 2 u^2),   b = v radial + p1 (s + 2 v^2) + 2 p2 u v;
//     undefined for z <= 1e-9 (behind the camera).
//   kannala_brandt (as OpenCV's fisheye):  rho = hypot(X, y), t = atan2(rho, z),
//       (a, b) = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) (X, y) / rho;  defined all around but at the point opposite to +z.
//   pixel = (fx a + cx, fy b + cy).
#pragma once

#include <cmath>

#include "sensor.h"

namespace kincal {

/// Brown-Conrady with N distortion numbers: 0 (pinhole), 5 (k1 k2 p1 p2 k3) or 8 (k4 k5 k6 besides).
template <int N>
struct BrownConrady {
  static constexpr int kRows = 2, kNumbers = 2;
  int parameter_count() const { return 5 + N; }

  bool residual(const double* parameters, const Vector3d& p, const double* z, double* r, double* d_p, double* d_own) const {
    const double fx = parameters[0], fy = parameters[1], depth = p.z();
    if (!(depth > 1e-9)) return false;
    const double* d = parameters + 4;
    const double u = (p.x() - parameters[4 + N]) / depth, v = p.y() / depth;
    double a = u, b = v;
    double a_u = 1, a_v = 0, b_v = 1;  // d(a, b) / d(u, v); symmetric: b_u = a_v
    double radial = 1, denominator = 1;
    const double s = u * u + v * v;
    if constexpr (N > 0) {
      const double k1 = d[0], k2 = d[1], p1 = d[2], p2 = d[3], k3 = d[4];
      const double k4 = N == 8 ? d[5] : 0, k5 = N == 8 ? d[6] : 0, k6 = N == 8 ? d[7] : 0;
      denominator = 1 + s * (k4 + s * (k5 + s * k6));
      radial = (1 + s * (k1 + s * (k2 + s * k3))) / denominator;
      const double d_radial = ((k1 + s * (2 * k2 + 3 * k3 * s)) - radial * (k4 + s * (2 * k5 + 3 * k6 * s))) / denominator;
      a = u * radial + 2 * p1 * u * v + p2 * (s + 2 * u * u);
      b = v * radial + p1 * (s + 2 * v * v) + 2 * p2 * u * v;
      a_u = radial + 2 * u * u * d_radial + 2 * p1 * v + 6 * p2 * u;
      a_v = 2 * u * v * d_radial + 2 * p1 * u + 2 * p2 * v;
      b_v = radial + 2 * v * v * d_radial + 6 * p1 * v + 2 * p2 * u;
    }
    r[0] = fx * a + parameters[2] - z[0];
    r[1] = fy * b + parameters[3] - z[1];
    if (!d_p) return true;
    const double ix = fx / depth, iy = fy / depth;
    d_p[0] = ix * a_u, d_p[1] = ix * a_v, d_p[2] = -ix * (a_u * u + a_v * v);
    d_p[3] = iy * a_v, d_p[4] = iy * b_v, d_p[5] = -iy * (a_v * u + b_v * v);
    double *x = d_own, *y = d_own + parameter_count();
    x[0] = a, x[1] = 0, x[2] = 1, x[3] = 0;
    y[0] = 0, y[1] = b, y[2] = 0, y[3] = 1;
    if constexpr (N > 0) {
      const double s1 = s / denominator, s2 = s * s1, s3 = s * s2;
      x[4] = fx * u * s1, x[5] = fx * u * s2, x[6] = fx * 2 * u * v, x[7] = fx * (s + 2 * u * u), x[8] = fx * u * s3;
      y[4] = fy * v * s1, y[5] = fy * v * s2, y[6] = fy * (s + 2 * v * v), y[7] = fy * 2 * u * v, y[8] = fy * v * s3;
      if constexpr (N == 8) {
        x[9] = -x[4] * radial, x[10] = -x[5] * radial, x[11] = -x[8] * radial;
        y[9] = -y[4] * radial, y[10] = -y[5] * radial, y[11] = -y[8] * radial;
      }
    }
    x[4 + N] = -d_p[0];
    y[4 + N] = -d_p[3];
    return true;
  }
};

/// Kannala-Brandt's fisheye with k1 k2 k3 k4.
struct KannalaBrandt {
  static constexpr int kRows = 2, kNumbers = 2;
  int parameter_count() const { return 9; }

  bool residual(const double* parameters, const Vector3d& p, const double* z, double* r, double* d_p, double* d_own) const {
    const double fx = parameters[0], fy = parameters[1];
    const double* k = parameters + 4;
    const double x = p.x() - parameters[8], y = p.y(), depth = p.z();
    const double rho = std::hypot(x, y), squared = rho * rho + depth * depth;
    if (!(squared > 1e-18) || (rho < 1e-12 && depth < 0)) return false;
    const double t = std::atan2(rho, depth), t2 = t * t;
    const double poly = 1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])));
    const double slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])));
    const bool axis = rho < 1e-9 * depth;  // there t / rho = 1 / z to rounding
    const double s = axis ? 1 / depth : t * poly / rho;
    r[0] = fx * s * x + parameters[2] - z[0];
    r[1] = fy * s * y + parameters[3] - z[1];
    if (!d_p) return true;
    const double s_rho_over_rho = axis ? 0 : (slope * depth / squared - s) / (rho * rho);  // (d s / d rho) / rho
    const double s_z = -slope / squared;
    d_p[0] = fx * (s + x * x * s_rho_over_rho), d_p[1] = fx * x * y * s_rho_over_rho, d_p[2] = fx * x * s_z;
    d_p[3] = fy * x * y * s_rho_over_rho, d_p[4] = fy * (s + y * y * s_rho_over_rho), d_p[5] = fy * y * s_z;
    double *dx = d_own, *dy = d_own + 9;
    dx[0] = s * x, dx[1] = 0, dx[2] = 1, dx[3] = 0;
    dy[0] = 0, dy[1] = s * y, dy[2] = 0, dy[3] = 1;
    double power = axis ? 0 : t / rho;
    for (int i = 0; i < 4; ++i) {
      power *= t2;
      dx[4 + i] = fx * power * x;
      dy[4 + i] = fy * power * y;
    }
    dx[8] = -d_p[0];
    dy[8] = -d_p[3];
    return true;
  }
};

}  // namespace kincal
