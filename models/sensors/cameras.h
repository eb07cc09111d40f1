// Camera lenses. The camera looks along +z, x right, y down; (0, 0) is the centre of the top-left
// pixel.
//
// Own numbers, block after block:  fx fy cx cy | distortion | baseline.
// With X = x - baseline (a rectified right camera of a stereo pair sits `baseline` to the right):
//   pinhole, brown_conrady (as OpenCV):  u = X/z, v = y/z, s = u^2 + v^2,
//       radial = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3),
//       a = u radial + 2 p1 u v + p2 (s + 2 u^2),   b = v radial + p1 (s + 2 v^2) + 2 p2 u v;
//     undefined for z <= 1e-9 (behind the camera).
//   kannala_brandt (as OpenCV's fisheye):  rho = hypot(X, y), t = atan2(rho, z),
//       (a, b) = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) (X, y) / rho;
//       defined all around but at the point opposite to +z.
//   brown_conrady of 12 and 14 numbers, unified, double_sphere: each a header of its own.
//   pixel = (fx a + cx, fy b + cy).
#pragma once

#include <cmath>

#include "brown_conrady.h"
#include "sensor.h"

namespace kincal {

/// This is Brown-Conrady with N distortion numbers: 0 (pinhole), 5 (k1 k2 p1 p2 k3) or 8 (k4 k5 k6
/// besides).
template <int N>
struct BrownConrady {
  static constexpr int kRows = 2, kMeasurementSize = 2;
  int parameter_count() const { return 5 + N; }

  bool residual(const double* parameters, const Vector3d& p, const double* z, double* r,
                double* d_p, double* d_own) const {
    if (!(p.z() > 1e-9)) return false;
    double pixel[2];
    brown_conrady<N>(parameters, p.x() - parameters[4 + N], p.y(), p.z(), pixel, d_p, d_own);
    r[0] = pixel[0] - z[0];
    r[1] = pixel[1] - z[1];
    return true;
  }
};

/// This is Kannala-Brandt's fisheye with k1 k2 k3 k4.
struct KannalaBrandt {
  static constexpr int kRows = 2, kMeasurementSize = 2;
  int parameter_count() const { return 9; }

  bool residual(const double* parameters, const Vector3d& p, const double* z, double* r,
                double* d_p, double* d_own) const {
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
    const double s_rho_over_rho =
        axis ? 0 : (slope * depth / squared - s) / (rho * rho);  // (d s / d rho) / rho
    const double s_z = -slope / squared;
    d_p[0] = fx * (s + x * x * s_rho_over_rho), d_p[1] = fx * x * y * s_rho_over_rho,
    d_p[2] = fx * x * s_z;
    d_p[3] = fy * x * y * s_rho_over_rho, d_p[4] = fy * (s + y * y * s_rho_over_rho),
    d_p[5] = fy * y * s_z;
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

/// This is a camera of a lens that stands in a header of its own: `image` computes (a, b), and its
/// derivatives by the point (2 x 3) and by the kNumbers of the distortion, row-major, both or none;
/// false where it is undefined.
template <class L>
struct LensCamera {
  static constexpr int kRows = 2, kMeasurementSize = 2, kOwn = 5 + L::kNumbers;
  int parameter_count() const { return kOwn; }

  bool residual(const double* parameters, const Vector3d& p, const double* z, double* r,
                double* d_p, double* d_own) const {
    double ab[2], by_distortion[2 * L::kNumbers];
    const Vector3d shifted(p.x() - parameters[kOwn - 1], p.y(), p.z());
    if (!L::image(parameters + 4, shifted, ab, d_p, by_distortion)) return false;
    for (int k = 0; k < 2; ++k) {
      const double f = parameters[k];
      r[k] = f * ab[k] + parameters[2 + k] - z[k];
      if (!d_p) continue;
      for (int j = 0; j < 3; ++j) d_p[3 * k + j] *= f;
      double* row = d_own + k * kOwn;
      for (int j = 0; j < 2; ++j) row[j] = j == k ? ab[k] : 0, row[2 + j] = j == k;
      for (int j = 0; j < L::kNumbers; ++j) row[4 + j] = f * by_distortion[k * L::kNumbers + j];
      row[kOwn - 1] = -d_p[3 * k];
    }
    return true;
  }
};

}  // namespace kincal
