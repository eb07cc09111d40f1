#include "rotation_minima.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"

namespace kincal {
namespace {

using Matrix10d = Eigen::Matrix<double, 10, 10>;
using Vector10d = Eigen::Matrix<double, 10, 1>;

constexpr double kSameRotation = 0.02;  // rad
constexpr double kFlat = 1e-9;          // of the largest curvature

/// The 24 rotations that bring a cube onto itself.
std::vector<Matrix3d> rotations_of_a_cube() {
  std::vector<Matrix3d> out;
  int order[3] = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Matrix3d r = Matrix3d::Zero();
      for (int c = 0; c < 3; ++c) r(order[c], c) = (signs >> c) & 1 ? -1 : 1;
      if (r.determinant() > 0) out.push_back(r);
    }
  } while (std::next_permutation(order, order + 3));
  return out;
}

Vector10d entries(const Matrix3d& r) {
  Vector10d out;
  out << r.col(0), r.col(1), r.col(2), 1;
  return out;
}

/// Goes to the minimum near `r`; returns in how many directions it curves there.
int descend(const Matrix10d& q, Matrix3d& r) {
  int curved = 0;
  double cost = entries(r).dot(q * entries(r));
  double damping = 1e-3;
  for (int iteration = 0; iteration < 100; ++iteration) {
    const Vector10d gradient = q * entries(r);
    Eigen::Matrix<double, 10, 3> j = Eigen::Matrix<double, 10, 3>::Zero();
    for (int c = 0; c < 3; ++c) j.block<3, 3>(3 * c, 0) = -r * skew(Vector3d::Unit(c));
    Matrix3d g;
    for (int c = 0; c < 3; ++c) g.col(c) = r.transpose() * gradient.segment<3>(3 * c);
    const Matrix3d h =
        j.transpose() * q * j + (g + g.transpose()) / 2 - g.trace() * Matrix3d::Identity();
    const SymmetricEigen curvature = symmetric_eigen(h);
    const double largest = curvature.values.cwiseAbs().maxCoeff();
    curved = static_cast<int>((curvature.values.array() > kFlat * largest).count());
    if (!(largest > 0)) break;
    const double shift = std::max(0.0, -curvature.values(0)) + damping * largest;
    const Vector3d down = curvature.vectors.transpose() * (j.transpose() * gradient);
    const Vector3d step =
        -curvature.vectors * (down.array() / (curvature.values.array() + shift)).matrix();
    const Matrix3d tried = r * exp_so3(step);
    const double lower = entries(tried).dot(q * entries(tried));
    if (lower < cost) {
      r = tried;
      cost = lower;
      damping = std::max(damping / 10, 1e-12);
    } else {
      damping *= 10;
    }
    if (step.norm() < 1e-12 || damping > 1e6) break;
  }
  return curved;
}

}  // namespace

std::vector<RotationMinimum> rotation_minima(const MatrixXd& s) {
  const Eigen::Index k = s.rows() - 10;
  Matrix10d q;
  q.topLeftCorner<9, 9>() = s.topLeftCorner<9, 9>();
  q.col(9).head<9>() = s.col(9 + k).head<9>();
  q.row(9) = q.col(9).transpose();
  q(9, 9) = s(9 + k, 9 + k);
  MatrixXd others(k, 10);  // u = others a
  if (k > 0) {
    MatrixXd s_ua(k, 10);
    s_ua << s.block(9, 0, k, 9), s.block(9, 9 + k, k, 1);
    const SymmetricEigen eigen = symmetric_eigen(s.block(9, 9, k, k));
    VectorXd inverse = VectorXd::Zero(k);
    for (Eigen::Index i = 0; i < k; ++i)
      if (eigen.values(i) > 1e-12 * eigen.values(k - 1)) inverse(i) = 1 / eigen.values(i);
    others = -eigen.vectors * inverse.asDiagonal() * (eigen.vectors.transpose() * s_ua);
    q += s_ua.transpose() * others;
    q = (q + q.transpose()).eval() / 2;
  }
  std::vector<RotationMinimum> found;
  for (Matrix3d r : rotations_of_a_cube()) {
    RotationMinimum minimum;
    minimum.directions = descend(q, r);
    minimum.rotation = r;
    minimum.cost = std::max(0.0, entries(r).dot(q * entries(r)));
    minimum.others = others * entries(r);
    found.push_back(std::move(minimum));
  }
  std::stable_sort(
      found.begin(), found.end(),
      [](const RotationMinimum& a, const RotationMinimum& b) { return a.cost < b.cost; });
  std::vector<RotationMinimum> out;
  for (RotationMinimum& minimum : found)
    if (std::none_of(out.begin(), out.end(), [&](const RotationMinimum& o) {
          return log_so3(o.rotation.transpose() * minimum.rotation).norm() < kSameRotation;
        }))
      out.push_back(std::move(minimum));
  return out;
}

}  // namespace kincal
