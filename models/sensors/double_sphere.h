// The double sphere camera (Usenko, Demmel and Cremers 2018), for fisheyes, by xi alpha. A point is
// put on a unit sphere, that on another one xi ahead, and that is seen from alpha / (1 - alpha)
// behind:
//     r = |p|,  k = z + xi r,  t = sqrt(x^2 + y^2 + k^2),  n = alpha t + (1 - alpha) k,
//     (a, b) = (x, y) / n.
// Without xi it is the unified camera with alpha / (1 - alpha), without both a pinhole.
//
// Defined where it is one to one: k > -w t with w = alpha / (1 - alpha) up to alpha = 1/2 (n > 0)
// and its inverse beyond (where the second sphere turns away from who sees it); for xi > 1 the
// first one turns away from the second's centre as well, at z = -r / xi. (The limit of Usenko et
// al. is some degrees narrower.)
#pragma once

#include <cmath>

#include "../../kinematics/transform.h"

namespace kincal {

struct DoubleSphere {
  static constexpr int kNumbers = 2;

  static bool image(const double* d, const Vector3d& p, double* ab, double* d_p, double* d_d) {
    const double xi = d[0], alpha = d[1], r = p.norm(), k = p.z() + xi * r;
    const double t = std::sqrt(p.x() * p.x() + p.y() * p.y() + k * k);
    const double w = alpha > 0.5 ? (1 - alpha) / alpha : alpha / (1 - alpha);
    if (!(k + w * t > 1e-9) || (xi > 1 && !(xi * p.z() + r > 0))) return false;
    const double n = alpha * t + (1 - alpha) * k;
    for (int j = 0; j < 2; ++j) ab[j] = p(j) / n;
    if (!d_p) return true;
    const Vector3d k_p = Vector3d::UnitZ() + p * (xi / r);  // d k / d p
    const double n_k = alpha * k / t + 1 - alpha;           // d n / d k where x and y stay
    Vector3d n_p = n_k * k_p;
    n_p.head<2>() += alpha / t * p.head<2>();
    for (int j = 0; j < 2; ++j) {
      for (int i = 0; i < 3; ++i) d_p[3 * j + i] = ((i == j) - ab[j] * n_p(i)) / n;
      d_d[2 * j] = -ab[j] * n_k * r / n;
      d_d[2 * j + 1] = -ab[j] * (t - k) / n;
    }
    return true;
  }
};

}  // namespace kincal
