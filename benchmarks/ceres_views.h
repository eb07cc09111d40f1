// What the problems in Ceres share: a view's data, derivatives of rigid motions, priors. Poses are
// 6-vectors xi with T = T0 exp(xi), so no manifold is needed and the priors are linear.
#pragma once

#include <ceres/ceres.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "../kinematics/transform.h"

namespace kincal::benchmarks {

template <int Rows, int Columns>
using Rows_t = Eigen::Matrix<double, Rows, Columns, Eigen::RowMajor>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;

constexpr int kCorners = 48;  // of a board

/// From the base to a sensor: what does not change.
struct Chain {
  std::vector<Pose> origins;  // parent_T_joint
  std::vector<Vector3d> axes;
  Pose link_T_sensor;  // as designed
};

/// One view: what is constant, and what was measured.
struct ViewData {
  const Chain* chain;
  const double* readings;           // of the chain's joints
  Pose base_T_board;                // at the start
  const Eigen::Matrix3Xd* corners;  // in the board's frame
  const double* z;
  double inverse_sigma;
};

/// J_r of SE(3) in closed form: exp(xi + d) = exp(xi) exp(J_r d).
inline Matrix6d right_jacobian(const Vector6d& xi) {
  const Vector3d w = -xi.tail<3>();  // J_r(xi) = J_l(-xi)
  const double s = w.squaredNorm();
  double b, c, d,
      e;  // (1 - cos a)/a^2, (a - sin a)/a^3, (1 - a^2/2 - cos a)/a^4, (a - sin a - a^3/6)/a^5
  if (s < 1e-2) {
    b = 0.5 - s / 24 * (1 - s / 30 * (1 - s / 56 * (1 - s / 90)));
    c = 1.0 / 6 - s / 120 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110)));
    d = -1.0 / 24 + s / 720 * (1 - s / 56 * (1 - s / 90));
    e = -1.0 / 120 + s / 5040 * (1 - s / 72 * (1 - s / 110));
  } else {
    const double a = std::sqrt(s);
    b = (1 - std::cos(a)) / s;
    c = (a - std::sin(a)) / (s * a);
    d = (0.5 - b) / s * -1;
    e = (c - 1.0 / 6) / s;
  }
  const Matrix3d p = skew(-xi.head<3>()), f = skew(w), pf = p * f, fp = f * p, fpf = f * pf;
  Matrix6d m;
  m.topLeftCorner<3, 3>() = m.bottomRightCorner<3, 3>() =
      Matrix3d::Identity() + b * f + c * (f * f);
  m.topRightCorner<3, 3>() = 0.5 * p + c * (fp + pf + fpf) - d * (f * fp + pf * f - 3 * fpf) -
                             0.5 * (d - 3 * e) * (fpf * f + f * fpf);
  m.bottomLeftCorner<3, 3>().setZero();
  return m;
}

/// Ad_T M for the 6 x 6 matrix of a pose's own derivatives.
inline Rows_t<6, 6> seen_through(const Pose& t, const Matrix6d& m) {
  Rows_t<6, 6> out;
  const Matrix36d w = t.rotation * m.bottomRows<3>();
  out.bottomRows<3>() = w;
  out.topRows<3>() = t.rotation * m.topRows<3>() + skew(t.translation) * w;
  return out;
}

/// (x - mean) / sigma, number by number.
class DiagonalPrior final : public ceres::CostFunction {
 public:
  DiagonalPrior(std::vector<double> mean, std::vector<double> sigma)
      : mean_(std::move(mean)), sigma_(std::move(sigma)) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(mean_.size()));
    set_num_residuals(static_cast<int>(mean_.size()));
  }
  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    const size_t n = mean_.size();
    for (size_t i = 0; i < n; ++i) r[i] = (x[0][i] - mean_[i]) / sigma_[i];
    if (jacobians && jacobians[0]) {
      std::fill(jacobians[0], jacobians[0] + n * n, 0.0);
      for (size_t i = 0; i < n; ++i) jacobians[0][i * n + i] = 1 / sigma_[i];
    }
    return true;
  }

 private:
  std::vector<double> mean_, sigma_;
};

}  // namespace kincal::benchmarks
