// The unified camera (Geyer and Daniilidis, Mei): mirrors and fisheyes beyond half a sphere, by xi
// k1 k2 p1 p2. A point is put on the unit sphere, and that is seen from xi behind its centre:
//     r = |p|,  n = z + xi r,  (u, v) = (x, y) / n,
// bent by k1 k2 p1 p2 as Brown-Conrady's. xi = 0 is a pinhole, 1 a stereographic lens.
//
// Defined where it is one to one: in front of the centre (n > 0) for xi <= 1, else up to where the
// sphere turns away from it, z > -r / xi.
#pragma once

#include <algorithm>

#include "../../kinematics/transform.h"
#include "brown_conrady.h"

namespace kincal {

struct Unified {
  static constexpr int kNumbers = 5;

  static bool image(const double* d, const Vector3d& p, double* ab, double* d_p, double* d_d) {
    const double xi = d[0], r = p.norm(), n = p.z() + xi * r;
    if (!(p.z() + (xi > 1 ? 1 / xi : xi) * r > 1e-9)) return false;
    const double lens[9] = {1, 1, 0, 0, d[1], d[2], d[3], d[4], 0};
    const double u = p.x() / n, v = p.y() / n;
    double by_uv[6], by_lens[2 * 10];
    brown_conrady<5>(lens, u, v, 1.0, ab, d_p ? by_uv : nullptr, d_p ? by_lens : nullptr);
    if (!d_p) return true;
    const Vector3d n_p = Vector3d::UnitZ() + p * (xi / r);  // d n / d p
    for (int k = 0; k < 2; ++k) {
      const double by_u = by_uv[3 * k] / n, by_v = by_uv[3 * k + 1] / n;
      const double by_n = -(by_u * u + by_v * v);
      for (int j = 0; j < 3; ++j) d_p[3 * k + j] = by_n * n_p(j);
      d_p[3 * k] += by_u;
      d_p[3 * k + 1] += by_v;
      d_d[k * kNumbers] = by_n * r;
      std::copy_n(by_lens + 10 * k + 4, 4, d_d + k * kNumbers + 1);
    }
    return true;
  }
};

}  // namespace kincal
