#include "fixed_point.h"

#include <Eigen/QR>
#include <algorithm>

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd FixedPoint::next(const VectorXd& x, const VectorXd& g) {
  constexpr double kDependent = 1e-8;
  const VectorXd f = g - x;
  if (last_f_.size() > 0) {
    f_.push_back(f - last_f_);
    g_.push_back(g - last_g_);
    if (f.norm() > last_f_.norm()) {
      f_.clear();
      g_.clear();
    }
    if (f_.size() > memory_) {
      f_.erase(f_.begin());
      g_.erase(g_.begin());
    }
  }
  last_f_ = f;
  last_g_ = g;
  VectorXd step = f;
  if (!f_.empty() && x.size() > 0) {
    const auto count = static_cast<Eigen::Index>(f_.size());
    MatrixXd differences(x.size(), count);
    for (Eigen::Index i = 0; i < count; ++i) differences.col(i) = f_[i];
    Eigen::ColPivHouseholderQR<MatrixXd> qr(differences);
    qr.setThreshold(kDependent);
    const VectorXd weights = qr.solve(f);
    for (Eigen::Index i = 0; i < count; ++i) step -= weights(i) * g_[i];
  }
  return x + step.cwiseMax(-largest_step_).cwiseMin(largest_step_);
}

}  // namespace kincal
