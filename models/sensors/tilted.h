// Brown-Conrady with a thin prism and a tilted sensor: the 12 numbers of thin_prism.h, tau_x tau_y
// (rad), as OpenCV orders them. The chip stands turned behind the lens (Scheimpflug): the image
// (a, b) of the lens of 12 numbers is seen on a plane turned by tau_x about x, then tau_y about y,
//     q = R (a, b, 1)',  R = R_y(tau_y) R_x(tau_x),
//     (a, b) -> (R_33 q_1 / q_3 - R_13, R_33 q_2 / q_3 - R_23),
// which leaves (0, 0) where it is. Undefined for z <= 1e-9 and, behind the turned plane, q_3 <=
// 1e-9.
#pragma once

#include <cmath>

#include "thin_prism.h"

namespace kincal {

struct TiltedSensor {
  static constexpr int kNumbers = 14;

  static bool image(const double* d, const Vector3d& p, double* ab, double* d_p, double* d_d) {
    constexpr int kLens = ThinPrism::kNumbers;
    double by_lens[2 * kLens];
    if (!ThinPrism::image(d, p, ab, d_p, by_lens)) return false;
    const double c1 = std::cos(d[12]), s1 = std::sin(d[12]), c2 = std::cos(d[13]),
                 s2 = std::sin(d[13]);
    Matrix3d turn, by_tau[2];
    turn << c2, s1 * s2, -c1 * s2, 0, c1, s1, s2, -s1 * c2, c1 * c2;
    by_tau[0] << 0, c1 * s2, s1 * s2, 0, -s1, c1, 0, -c1 * c2, -s1 * c2;
    by_tau[1] << -s2, s1 * c2, -c1 * c2, 0, 0, 0, c2, s1 * s2, -c1 * s2;
    const Vector3d flat(ab[0], ab[1], 1), q = turn * flat;
    if (!(q.z() > 1e-9)) return false;
    const double far = turn(2, 2), inverse = 1 / q.z();
    for (int k = 0; k < 2; ++k) ab[k] = far * q(k) * inverse - turn(k, 2);
    if (!d_p) return true;
    const Vector3d by_tau_flat[2] = {by_tau[0] * flat, by_tau[1] * flat};
    double by_ab[4];  // derivatives of the turned image by the flat one
    for (int k = 0; k < 2; ++k) {
      const double share = q(k) * inverse;
      const auto moved = [&](const Vector3d& q_by) {
        return far * inverse * (q_by(k) - share * q_by.z());
      };
      for (int j = 0; j < 2; ++j) by_ab[2 * k + j] = moved(turn.col(j));
      double* row = d_d + k * kNumbers;
      for (int t = 0; t < 2; ++t)
        row[kLens + t] = moved(by_tau_flat[t]) + by_tau[t](2, 2) * share - by_tau[t](k, 2);
    }
    const auto chain = [&](const double* by, int columns, double* to, int apart) {
      for (int j = 0; j < columns; ++j) {
        const double a = by[j], b = by[columns + j];
        for (int k = 0; k < 2; ++k) to[k * apart + j] = by_ab[2 * k] * a + by_ab[2 * k + 1] * b;
      }
    };
    chain(by_lens, kLens, d_d, kNumbers);
    chain(d_p, 3, d_p, 3);
    return true;
  }
};

}  // namespace kincal
