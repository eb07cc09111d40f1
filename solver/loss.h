// Robust losses. With s the squared whitened norm of a residual block, c the scale in sigmas and z
// = s / c^2, the (twice) cost is c^2 rho(z); the solver's weight is the slope rho'(z), with which a
// Gauss-Newton step on sqrt(rho') r solves J' rho' r = 0.
#pragma once

#include <cmath>

namespace kincal {

enum class LossKind { none, huber, soft_l1, cauchy, tukey };

struct Loss {
  LossKind kind = LossKind::none;
  double scale = 1;
  bool from_data = false;  // the scale is in units of the residuals' robust standard deviation
                           // instead of sigmas (models/fitting/robust.h)

  /// Returns c^2 rho(s / c^2) and sets `slope` to rho'.
  double operator()(double s, double& slope) const {
    const double c2 = scale * scale, z = s / c2;
    switch (kind) {
      case LossKind::none:
        break;
      case LossKind::huber:
        if (z <= 1) break;
        slope = 1 / std::sqrt(z);
        return c2 * (2 * std::sqrt(z) - 1);
      case LossKind::soft_l1:
        slope = 1 / std::sqrt(1 + z);
        return c2 * 2 * (std::sqrt(1 + z) - 1);
      case LossKind::cauchy:
        slope = 1 / (1 + z);
        return c2 * std::log1p(z);
      case LossKind::tukey: {
        if (z > 1) {
          slope = 0;
          return c2 / 3;
        }
        const double u = 1 - z;
        slope = u * u;
        return c2 * (1 - u * u * u) / 3;
      }
    }
    slope = 1;
    return s;
  }
};

}  // namespace kincal
