#include "plane_view.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace kincal {
namespace {

using Vector10 = Eigen::Matrix<double, 10, 1>;

/// Nine numbers by rows, the last of them 1: the plane's coordinates count from its points' middle.
cv::Matx33d homography_of(const Vector10& x) {
  return {x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], 1};
}

struct Observed {
  cv::Point2d plane, seen;  // in units, from the middle of each
};

/// Linear least squares of the homography alone.
bool linear_start(const std::vector<Observed>& points, Vector10& x) {
  Eigen::Matrix<double, 8, 8> a = Eigen::Matrix<double, 8, 8>::Zero();
  Eigen::Matrix<double, 8, 1> b = Eigen::Matrix<double, 8, 1>::Zero(), row;
  for (const auto& [p, q] : points)
    for (int k = 0; k < 2; ++k) {
      const double seen = k ? q.y : q.x;
      row.setZero();
      row.segment<3>(3 * k) << p.x, p.y, 1;
      row.tail<2>() << -seen * p.x, -seen * p.y;
      a.noalias() += row * row.transpose();
      b += seen * row;
    }
  const auto factors = a.ldlt();
  if (!(factors.vectorD().minCoeff() > 1e-12 * factors.vectorD().maxCoeff())) return false;
  x.setZero();
  x.head<8>() = factors.solve(b);
  return true;
}

/// One step of Gauss-Newton for the first `n` numbers.
Vector10 gauss_newton_step(const std::vector<Observed>& points, const Vector10& x, int n) {
  Eigen::Matrix<double, 10, 10> a = Eigen::Matrix<double, 10, 10>::Zero();
  Vector10 b = Vector10::Zero();
  Eigen::Matrix<double, 2, 10> j;
  for (const auto& [p, seen] : points) {
    const double w = 1 / (x[6] * p.x + x[7] * p.y + 1);
    const Eigen::Vector2d q((x[0] * p.x + x[1] * p.y + x[2]) * w,
                            (x[3] * p.x + x[4] * p.y + x[5]) * w);
    const double s = q.squaredNorm(), bend = 1 + x[8] * s + x[9] * s * s;
    const Eigen::Matrix2d lens =
        bend * Eigen::Matrix2d::Identity() + (2 * x[8] + 4 * x[9] * s) * q * q.transpose();
    const Eigen::RowVector3d flat(w * p.x, w * p.y, w);
    j.block<2, 3>(0, 0) = lens.col(0) * flat;
    j.block<2, 3>(0, 3) = lens.col(1) * flat;
    j.block<2, 2>(0, 6) = -(lens * q) * flat.head<2>();
    j.col(8) = s * q;
    j.col(9) = s * s * q;
    a.noalias() += j.transpose() * j;
    b += j.transpose() * (Eigen::Vector2d(seen.x, seen.y) - bend * q);
  }
  const double weak = 1e-6 * static_cast<double>(points.size());
  for (int k = 8; k < n; ++k) a(k, k) += weak, b[k] -= weak * x[k];
  Vector10 step = Vector10::Zero();
  step.head(n) = a.topLeftCorner(n, n).ldlt().solve(b.head(n));
  return step;
}

}  // namespace

cv::Point2d PlaneView::operator()(const cv::Point2d& p) const {
  const cv::Vec3d q = h * cv::Vec3d(p.x, p.y, 1);
  const cv::Point2d at(q[0] / q[2], q[1] / q[2]);
  const double s = at.dot(at);
  return middle + radius * (1 + k1 * s + k2 * s * s) * at;
}

PlaneView fit_plane_view(const std::vector<cv::Point2d>& plane,
                         const std::vector<cv::Point2d>& pixels, cv::Size image) {
  PlaneView out;
  if (plane.size() < 4) return out;
  out.middle = cv::Point2d(0.5 * (image.width - 1), 0.5 * (image.height - 1));
  out.radius = cv::norm(out.middle);
  const double count = static_cast<double>(plane.size());
  cv::Point2d origin;
  for (const cv::Point2d& p : plane) origin += p / count;
  double size = 1e-9;
  for (const cv::Point2d& p : plane) size = std::max(size, cv::norm(p - origin));
  std::vector<Observed> points;
  for (size_t i = 0; i < plane.size(); ++i)
    points.push_back({(plane[i] - origin) / size, (pixels[i] - out.middle) / out.radius});
  Vector10 x;
  if (!linear_start(points, x)) return out;
  const int n = plane.size() < 6 ? 8 : plane.size() < 12 ? 9 : 10;
  for (int pass = 0; pass < 8; ++pass) {
    const Vector10 step = gauss_newton_step(points, x, n);
    if (!step.allFinite()) return out;
    x += step;
    if (step.cwiseAbs().maxCoeff() < 1e-7) break;
  }
  const cv::Matx33d centred(1 / size, 0, -origin.x / size, 0, 1 / size, -origin.y / size, 0, 0, 1);
  out.h = homography_of(x) * centred;
  out.k1 = x[8], out.k2 = x[9];
  double squares = 0, worst = 0;
  for (size_t i = 0; i < plane.size(); ++i) {
    const cv::Point2d d = out(plane[i]) - pixels[i];
    squares += d.dot(d);
    worst = std::max(worst, d.dot(d));
  }
  out.rms = std::sqrt(squares / count);
  out.worst = std::sqrt(worst);
  if (!std::isfinite(out.rms)) out.rms = out.worst = 1e9;
  return out;
}

}  // namespace kincal
