// Brown-Conrady with a thin prism: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, as OpenCV orders them. To
// the image (a, b) of the lens of eight numbers comes
//     (s1 s + s2 s^2, s3 s + s4 s^2),   s = u^2 + v^2:
// a lens element that stands turned. Undefined for z <= 1e-9 (behind the camera).
#pragma once

#include <algorithm>

#include "../../kinematics/transform.h"
#include "brown_conrady.h"

namespace kincal {

struct ThinPrism {
  static constexpr int kNumbers = 12;

  static bool image(const double* d, const Vector3d& p, double* ab, double* d_p, double* d_d) {
    if (!(p.z() > 1e-9)) return false;
    double lens[12] = {1, 1, 0, 0}, by_lens[2 * 13];
    std::copy_n(d, 8, lens + 4);
    brown_conrady<8>(lens, p.x(), p.y(), p.z(), ab, d_p, d_p ? by_lens : nullptr);
    const double u = p.x() / p.z(), v = p.y() / p.z(), s = u * u + v * v;
    const double* prism = d + 8;
    for (int k = 0; k < 2; ++k) ab[k] += s * (prism[2 * k] + s * prism[2 * k + 1]);
    if (!d_p) return true;
    const double s_p[3] = {2 * u / p.z(), 2 * v / p.z(), -2 * s / p.z()};  // d s / d p
    std::fill(d_d, d_d + 2 * kNumbers, 0.0);
    for (int k = 0; k < 2; ++k) {
      const double slope = prism[2 * k] + 2 * s * prism[2 * k + 1];
      for (int j = 0; j < 3; ++j) d_p[3 * k + j] += slope * s_p[j];
      double* row = d_d + k * kNumbers;
      std::copy_n(by_lens + 13 * k + 4, 8, row);
      row[8 + 2 * k] = s;
      row[9 + 2 * k] = s * s;
    }
    return true;
  }
};

}  // namespace kincal
