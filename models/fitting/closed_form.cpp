#include "closed_form.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../rig/numbers.h"
#include "../rig/random_stream.h"
#include "../rig/targets.h"
#include "rotation_minima.h"

namespace kincal {

namespace {

Matrix3d nearest_rotation(const Matrix3d& m, RepeatedSvd& svd) {
  svd.compute(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix3d u = svd.u(), v = svd.v();
  const double sign = (u * v.transpose()).determinant() < 0 ? -1 : 1;
  return u * Vector3d(1, 1, sign).asDiagonal() * v.transpose();
}

Matrix3d nearest_rotation(const Matrix3d& m) {
  RepeatedSvd svd;
  return nearest_rotation(m, svd);
}

/// How far points spread along their principal axes, the largest first.
struct Spread3d {
  Vector3d lengths = Vector3d::Zero();
  Matrix3d axes;  // columns, right-handed

  bool flat() const { return lengths(2) <= 1e-6 * lengths(0); }
  /// Noise decides on which side of its plane such a target is seen: there are two minima.
  bool nearly_flat() const { return !flat() && lengths(2) < 0.1 * lengths(1); }
};

Spread3d spread_of(const Matrix3Xd& centred, RepeatedSvd& svd) {
  svd.compute(centred, Eigen::ComputeFullU);
  Spread3d out;
  out.lengths.head(svd.values().size()) = svd.values();
  out.axes = svd.u();
  if (out.axes.determinant() < 0) out.axes.col(2) *= -1;
  return out;
}
Spread3d spread_of(const Matrix3Xd& centred) {
  RepeatedSvd svd;
  return spread_of(centred, svd);
}

/// Those of poses_at_rays() from one place that have all points before it.
std::vector<Pose> poses_in_front(const Matrix3Xd& p, const Matrix3Xd& d) {
  std::vector<Pose> out;
  for (const Pose& pose : poses_at_rays(p, Matrix3Xd::Zero(3, p.cols()), d)) {
    bool in_front = true;
    for (Eigen::Index i = 0; i < p.cols() && in_front; ++i)
      in_front = d.col(i).dot(pose * Vector3d(p.col(i))) > 0;
    if (in_front) out.push_back(pose);
  }
  return out;
}

/// The largest singular value's vectors, and how much larger than the next it is.
struct Dominant {
  Eigen::Matrix<double, 9, 1> u, v;
  double gap = 0;
};

Dominant dominant(const Eigen::Matrix<double, 9, 9>& t) {
  const SingularValues svd = singular_values(t, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.u.col(0), svd.v.col(0), svd.values(0) - svd.values(1)};
}

/// The same to half the digits, in a tenth of the time.
Dominant roughly_dominant(const Eigen::Matrix<double, 9, 9>& t) {
  const SymmetricEigen squares = symmetric_eigen(t.transpose() * t);
  const double first = std::sqrt(std::max(0.0, squares.values(8))),
               second = std::sqrt(std::max(0.0, squares.values(7)));
  const Eigen::Matrix<double, 9, 1> v = squares.vectors.col(8);
  return {(t * v).normalized(), v, first - second};
}

/// X and Y of A_i X = Y B_i. False if the rotations do not determine them.
bool robot_world_hand_eye(const std::vector<Pose>& a, const std::vector<Pose>& b, Pose& x, Pose& y,
                          Dominant (*decompose)(const Eigen::Matrix<double, 9, 9>&) = dominant) {
  const Eigen::Index n = static_cast<Eigen::Index>(a.size());
  if (n < 3) return false;
  Eigen::Matrix<double, 9, 9> t =
      Eigen::Matrix<double, 9, 9>::Zero();  // vec(R_Y) = (R_B (x) R_A) vec(R_X)
  for (Eigen::Index i = 0; i < n; ++i)
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c)
        t.block<3, 3>(3 * r, 3 * c) += b[i].rotation(r, c) * a[i].rotation;
  const Dominant found = decompose(t);
  if (found.gap < 1e-4 * static_cast<double>(n)) return false;
  Matrix3d rx = Eigen::Map<const Matrix3d>(found.v.data()),
           ry = Eigen::Map<const Matrix3d>(found.u.data());
  if (rx.determinant() < 0) rx = -rx;
  if (ry.determinant() < 0) ry = -ry;
  x.rotation = nearest_rotation(rx);
  y.rotation = nearest_rotation(ry);
  Eigen::MatrixXd m(3 * n, 6);
  VectorXd right(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {  // R_A t_X - t_Y = R_Y t_B - t_A
    m.block<3, 3>(3 * i, 0) = a[i].rotation;
    m.block<3, 3>(3 * i, 3) = -Matrix3d::Identity();
    right.segment<3>(3 * i) = y.rotation * b[i].translation - a[i].translation;
  }
  const VectorXd solution = shortest_least_squares(m, right);
  x.translation = solution.head<3>();
  y.translation = solution.tail<3>();
  return true;
}

}  // namespace

std::vector<Pose> poses_at_rays(const Matrix3Xd& p, const Matrix3Xd& o, const Matrix3Xd& d) {
  const Vector3d mean = p.rowwise().mean();
  MatrixXd s = MatrixXd::Zero(13, 13), row(3, 13);
  for (Eigen::Index i = 0; i < p.cols(); ++i) {
    const Vector3d direction = d.col(i).normalized();
    const Matrix3d across = Matrix3d::Identity() - direction * direction.transpose();
    set_rotation_columns(across, p.col(i) - mean, row.leftCols<9>());
    row.middleCols<3>(9) = across;
    row.col(12) = -across * o.col(i);
    s += row.transpose() * row;
  }
  std::vector<Pose> out;
  for (const RotationMinimum& minimum : rotation_minima(s))
    out.push_back({minimum.rotation, minimum.others - minimum.rotation * mean});
  return out;
}

Matrix3Xd columns_of(const std::vector<Vector3d>& points) {
  Matrix3Xd out(3, static_cast<Eigen::Index>(points.size()));
  for (size_t i = 0; i < points.size(); ++i) out.col(static_cast<Eigen::Index>(i)) = points[i];
  return out;
}

Matrix3Xd select_columns(const Matrix3Xd& points, const std::vector<int>& ids) {
  Matrix3Xd out(3, static_cast<Eigen::Index>(ids.size()));
  for (size_t i = 0; i < ids.size(); ++i)
    out.col(static_cast<Eigen::Index>(i)) = points.col(ids[i]);
  return out;
}

struct RepeatedPoses::Parts {
  RepeatedSvd spread, rotation;
  Matrix3Xd centred,
      q;  // points about their mean, as they are and along their axes over their size
  Matrix3Xd other;
  MatrixXd a, whole;
  Eigen::RowVectorXd depths;
  std::vector<Pose> out;
};
RepeatedPoses::RepeatedPoses() : parts_(new Parts) {}
RepeatedPoses::RepeatedPoses(RepeatedPoses&&) noexcept = default;
RepeatedPoses::~RepeatedPoses() = default;

Pose fit_points(const Matrix3Xd& a, const Matrix3Xd& b) { return RepeatedPoses().fit(a, b); }

Pose RepeatedPoses::fit(const Matrix3Xd& a, const Eigen::Ref<const Matrix3Xd>& b) {
  Pose out;
  if (a.cols() == 0) return out;
  const Vector3d ca = a.rowwise().mean(), cb = b.rowwise().mean();
  if (a.cols() >= 2) {
    Matrix3Xd &da = parts_->centred, &db = parts_->other;
    da = a.colwise() - ca;
    db = b.colwise() - cb;
    if (a.cols() >= 3)
      out.rotation = nearest_rotation(db * da.transpose(), parts_->rotation);
    else if (da.col(0).norm() > 0 && db.col(0).norm() > 0)
      out.rotation = rotation_between(da.col(0), db.col(0));
  }
  out.translation = cb - out.rotation * ca;
  return out;
}

std::vector<Pose> perspective_poses(const Matrix3Xd& c, const Matrix3Xd& xy1) {
  return RepeatedPoses().perspective(c, xy1);
}

const std::vector<Pose>& RepeatedPoses::perspective(const Matrix3Xd& c, const Matrix3Xd& xy1) {
  const Eigen::Index n = c.cols();
  std::vector<Pose>& out = parts_->out;
  out.clear();
  if (n == 0) return out;
  const Vector3d mean = c.rowwise().mean(), sight = xy1.rowwise().mean();
  Matrix3Xd& centred = parts_->centred;
  centred = c.colwise() - mean;
  const Spread3d spread = spread_of(centred, parts_->spread);
  const double size = std::max(centred.colwise().norm().maxCoeff(), 1e-6);
  const bool sideways = (xy1.row(2).array() != 1).any();
  // (Of few points other poses than the nearest to a linear solution may be the right one.)
  const bool on_line = spread.lengths(1) <= 1e-6 * spread.lengths(0),
             by_distances =
                 spread.nearly_flat() || (n >= 4 && sideways) || (n >= 3 && n < 6 && !on_line);
  if (by_distances)
    out = poses_in_front(c, xy1);
  else if (n >= 6 && !on_line)
    add_linear(xy1, {mean, spread.axes, size, spread.flat()});
  const auto is_in_front = [&](const Pose& p) {
    parts_->depths.noalias() = p.rotation.row(2) * c;
    return (parts_->depths.array() + p.translation.z()).minCoeff() > 0;
  };
  const bool in_front =
      (by_distances && !out.empty()) || std::any_of(out.begin(), out.end(), is_in_front);
  if (!in_front)  // too few points, or all but degenerate ones
    for (double sign : {1.0, -1.0}) {
      Pose pose;
      pose.rotation.diagonal() << 1, sign, sign;
      pose.translation = std::max(1.0, 4 * size) * sight - pose.rotation * mean;
      out.push_back(pose);
    }
  return out;
}

/// Adds the poses by DLT, of the points in `centred`.
void RepeatedPoses::add_linear(const Matrix3Xd& xy1, const Placed& points) {
  const Eigen::Index n = xy1.cols();
  const Vector3d sight = xy1.rowwise().mean();
  const bool flat = points.flat;
  Matrix3Xd& q = parts_->q;
  q.noalias() = points.axes.transpose() * parts_->centred;
  q /= points.size;
  const double scale =
      std::max((xy1.colwise() - sight).norm() / std::sqrt(static_cast<double>(n)), 1e-12);
  const int k = flat ? 3 : 4;  // columns of the projective matrix: x, y, (z,) 1
  // Rows (h, 0, -u h) and (0, h, -v h) of its entries, as A'A.
  MatrixXd& a = parts_->a;
  a.setZero(3 * k, 3 * k);
  for (Eigen::Index i = 0; i < n; ++i) {
    Eigen::Vector4d h;
    h << q.col(i).head<2>(), flat ? 1 : q(2, i), 1;
    const Eigen::Matrix4d hh = h * h.transpose();
    const Vector3d s = (xy1.col(i) - sight) / scale;
    const auto corner = hh.topLeftCorner(k, k);
    a.topLeftCorner(k, k) += corner;
    a.topRightCorner(k, k) -= s.x() * corner;
    a.block(k, 2 * k, k, k) -= s.y() * corner;
    a.bottomRightCorner(k, k) += s.head<2>().squaredNorm() * corner;
  }
  a.block(k, k, k, k) = a.topLeftCorner(k, k);
  MatrixXd& whole = parts_->whole;
  whole.resize(3 * k, 3 * k);
  for (int i = 0; i < 3 * k; ++i)
    for (int j = i; j < 3 * k; ++j) whole(i, j) = whole(j, i) = a(i, j);
  const UpTo12 least = least_eigenvector(whole);
  using Projective = Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor, 3, 4>;
  Projective m = Eigen::Map<const Projective>(least.data(), 3, k);
  for (int c = 0; c < k; ++c)
    m.col(c).head<2>() = scale * m.col(c).head<2>() + sight.head<2>() * m(2, c);
  const double norm = (m.col(0).norm() + m.col(1).norm()) / 2;
  m *= (m(2, k - 1) > 0 ? 1 : -1) / norm;
  Matrix3d r;
  r.leftCols<2>() = m.leftCols<2>();
  if (flat)
    r.col(2) = Vector3d(m.col(0)).cross(Vector3d(m.col(1)));
  else
    r.col(2) = m.col(2);
  r = nearest_rotation(r, parts_->rotation);
  const Vector3d t = m.col(k - 1) * points.size, line = t.normalized();
  const auto add = [&](const Matrix3d& rotation) {
    Pose pose;
    pose.rotation = rotation * points.axes.transpose();
    pose.translation = t - pose.rotation * points.mean;
    parts_->out.push_back(pose);
  };
  add(r);
  // A plane's mirror image across the line of sight looks almost the same from afar.
  if (flat)
    add((2 * line * line.transpose() - Matrix3d::Identity()) * r *
        Vector3d(-1, -1, 1).asDiagonal());
}

bool pose_from_directions(const Matrix3Xd& points, const Matrix3Xd& xy1, Pose& camera_T_frame) {
  if (points.cols() < 4 || on_a_line(points)) return false;
  double least = kInfinity;
  for (const Pose& pose : perspective_poses(points, xy1)) {
    double sum = 0;
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      sum += ((pose * Vector3d(points.col(i))).normalized() - xy1.col(i).normalized()).norm();
    if (sum < least) least = sum, camera_T_frame = pose;
  }
  return std::isfinite(least);
}

bool pose_from_rays(const Matrix3Xd& p, const Matrix3Xd& o, const Matrix3Xd& d,
                    Pose& frame_T_target) {
  const Eigen::Index n = p.cols();
  if (n < 4 || on_a_line(p)) return false;
  const Vector3d mean = p.rowwise().mean();
  const Spread3d spread = spread_of(p.colwise() - mean);
  if (spread.nearly_flat()) {
    frame_T_target = poses_at_rays(p, o, d)[0];
    return true;
  }
  const Matrix3d& axes = spread.axes;
  const Matrix3Xd q = axes.transpose() * (p.colwise() - mean);
  const int k = spread.flat() ? 2 : 3;
  Eigen::MatrixXd a(3 * n, 3 * k + 3);
  VectorXd right(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Matrix3d cross = skew(d.col(i));
    for (int c = 0; c < k; ++c) a.block<3, 3>(3 * i, 3 * c) = q(c, i) * cross;
    a.block<3, 3>(3 * i, 3 * k) = cross;
    right.segment<3>(3 * i) = cross * o.col(i);
  }
  VectorXd x;
  if (!least_squares(a, right, 1e-6, x)) return false;
  Matrix3d r;
  r.col(0) = x.segment<3>(0);
  r.col(1) = x.segment<3>(3);
  if (k == 3)
    r.col(2) = x.segment<3>(6);
  else
    r.col(2) = r.col(0).cross(r.col(1)) / std::max(r.col(0).norm(), 1e-12);
  r = nearest_rotation(r);
  for (Eigen::Index i = 0; i < n; ++i)
    right.segment<3>(3 * i) = d.col(i).cross(Vector3d(o.col(i) - r * q.col(i)));
  const Vector3d t = least_squares(MatrixXd(a.rightCols<3>()), right);
  frame_T_target.rotation = r * axes.transpose();
  frame_T_target.translation = t - frame_T_target.rotation * mean;
  return true;
}

Pose robust_mean(const std::vector<Pose>& poses, double length) {
  const auto distance = [&](const Pose& a, const Pose& b) {
    return log_so3(a.rotation.transpose() * b.rotation).norm() +
           (a.translation - b.translation).norm() / length;
  };
  size_t best = 0;
  double least = kInfinity;
  const size_t stride =
      std::max<size_t>(1, poses.size() / 200);  // enough candidates for many samples
  for (size_t i = 0; i < poses.size(); i += stride) {
    double sum = 0;
    for (const Pose& p : poses) sum += distance(poses[i], p);
    if (sum < least) least = sum, best = i;
  }
  std::vector<double> away;
  for (const Pose& p : poses) away.push_back(distance(poses[best], p));
  const double limit = 3 * median(away) + 1e-9;
  Matrix3d rotation = Matrix3d::Zero();
  Vector3d translation = Vector3d::Zero();
  int count = 0;
  for (size_t i = 0; i < poses.size(); ++i)
    if (away[i] <= limit)
      rotation += poses[i].rotation, translation += poses[i].translation, ++count;
  return {nearest_rotation(rotation), translation / count};
}

bool robust_robot_world_hand_eye(const std::vector<Pose>& a, const std::vector<Pose>& b, Pose& x,
                                 Pose& y) {
  if (!robot_world_hand_eye(a, b, x, y)) return false;
  const size_t n = a.size();
  std::vector<double> away(n);
  const auto middle = [&](const Pose& x_of, const Pose& y_of) {
    for (size_t i = 0; i < n; ++i) {
      const Pose difference = inverse(y_of * b[i]) * (a[i] * x_of);
      away[i] = log_so3(difference.rotation).norm() + difference.translation.norm();
    }
    return median(away);
  };
  double least = middle(x, y) / 3;
  bool better = false;
  RandomStream draws(1);
  for (int trial = 0; trial < 200 && n > 6; ++trial) {
    const size_t i = draws.bits() % n, j = draws.bits() % n, k = draws.bits() % n;
    Pose trial_x, trial_y;
    if (i == j || j == k || k == i ||
        !robot_world_hand_eye({a[i], a[j], a[k]}, {b[i], b[j], b[k]}, trial_x, trial_y,
                              roughly_dominant))
      continue;
    const double one = middle(trial_x, trial_y);
    if (one < least) least = one, x = trial_x, y = trial_y, better = true;
  }
  for (int round = 0; better && round < 5; ++round) {
    const double limit = 5 * middle(x, y) + 1e-9;
    std::vector<Pose> kept_a, kept_b;
    for (size_t i = 0; i < n; ++i)
      if (away[i] <= limit) kept_a.push_back(a[i]), kept_b.push_back(b[i]);
    if (!robot_world_hand_eye(kept_a, kept_b, x, y)) break;
  }
  return true;
}

std::optional<SinglePointPose> pose_from_single_points(const std::vector<SinglePoint>& readings,
                                                       int points) {
  constexpr double kChance = 25;  // of a chi2: five sigmas
  const Eigen::Index n = static_cast<Eigen::Index>(readings.size()), k = 3 + 3 * points;
  Matrix3Xd measured(3, n);
  for (Eigen::Index i = 0; i < n; ++i) measured.col(i) = readings[i].measured;
  if (3 * n < 6 + 3 * points || on_a_line(measured)) return std::nullopt;
  const Vector3d mean = measured.rowwise().mean();
  MatrixXd s = MatrixXd::Zero(10 + k, 10 + k), row(3, 10 + k);
  for (const SinglePoint& one : readings) {  // R (p - mean) + t - R_A y - t_A, t of the mean
    row.setZero();
    set_rotation_columns(Matrix3d::Identity(), one.measured - mean, row.leftCols<9>());
    row.middleCols<3>(9).setIdentity();
    for (int corner = 0; corner < 4; ++corner)
      if (one.shares(corner) != 0)
        row.middleCols<3>(12 + 3 * (one.point + corner)) = -one.shares(corner) * one.a.rotation;
    row.col(9 + k) = -one.a.translation;
    s += row.transpose() * row;
  }
  const std::vector<RotationMinimum> minima = rotation_minima(s);
  const RotationMinimum& best = minima[0];
  if (best.directions < 2) return std::nullopt;
  SinglePointPose out;
  out.x = {best.rotation, best.others.head<3>() - best.rotation * mean};
  out.y = Eigen::Map<const Matrix3Xd>(best.others.data() + 3, 3, points);
  const double size = (measured.colwise() - mean).norm(),
               excess = static_cast<double>(3 * n - 6 - 3 * points);
  const double chance =
      excess > 0 ? kChance * (best.cost / excess + 1e-18 * size * size) : kInfinity;
  if (best.directions == 3 && minima.size() > 1 && minima[1].cost <= best.cost + chance) {
    out.ambiguous = true;
    out.turned = log_so3(best.rotation.transpose() * minima[1].rotation).norm();
  }
  return out;
}

std::optional<SinglePointPose> robot_world_hand_eye_by_points(const std::vector<Pose>& a,
                                                              const std::vector<Pose>& b, Pose& y) {
  std::vector<Vector3d> origins;
  for (const Pose& one : b) origins.push_back(inverse(one).translation);
  const Matrix3Xd seen = columns_of(origins);
  const Vector3d mean = seen.rowwise().mean();
  const double moved = (seen.colwise() - mean).norm() / std::sqrt(static_cast<double>(b.size())),
               size = moved > 0 ? moved : mean.norm();
  Matrix3Xd corner(3, 4);  // of Y's body: its origin and steps along its axes, as far as it moved
  corner << Vector3d::Zero(), (size > 0 ? size : 1) * Matrix3d::Identity();
  std::vector<SinglePoint> readings;
  for (size_t i = 0; i < a.size(); ++i) {  // X B^-1 q = A^-1 Y q
    const Pose x_T_y = inverse(b[i]), y_T_x = inverse(a[i]);
    for (int k = 0; k < 4; ++k) readings.push_back({x_T_y * Vector3d(corner.col(k)), y_T_x, k});
  }
  std::optional<SinglePointPose> out = pose_from_single_points(readings, 4);
  if (out) y = fit_points(corner, out->y);
  return out;
}

std::optional<SinglePointPose> two_poses_by_points(const std::vector<PointOfTwo>& points, Pose& y) {
  constexpr double kFlat = 0.01;  // of the largest spread: what Y sees lies in a plane
  std::vector<Vector3d> seen;
  for (const PointOfTwo& one : points) seen.push_back(one.in_y);
  if (seen.size() < 8) return std::nullopt;
  const Matrix3Xd in_y = columns_of(seen);
  const Vector3d mean = in_y.rowwise().mean();
  const Vector3d spread = singular_values(in_y.colwise() - mean).values;
  if (spread(2) < kFlat * spread(0)) return std::nullopt;
  const double size = spread(0) / std::sqrt(static_cast<double>(points.size()));
  Matrix3Xd corner(3, 4);
  corner << Vector3d::Zero(), size * Matrix3d::Identity();
  corner.colwise() += mean;
  std::vector<SinglePoint> readings;
  for (const PointOfTwo& one : points) {
    const Vector3d along = (one.in_y - mean) / size;
    readings.push_back({one.in_x, one.a, 0, {1 - along.sum(), along.x(), along.y(), along.z()}});
  }
  std::optional<SinglePointPose> out = pose_from_single_points(readings, 4);
  if (out) y = fit_points(corner, out->y);
  return out;
}

}  // namespace kincal
