#include "ceres_pr2_like.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "ceres_views.h"

namespace kincal::benchmarks {
namespace {

template <class T>
using Vector3 = Eigen::Matrix<T, 3, 1>;

// ---------------------------------------------------------------- usual: templates, a corner at a
// time

/// sin(a) / a, (1 - cos(a)) / a^2 and (a - sin(a)) / a^3 as functions of a^2, smooth at 0.
template <class T>
void rotation_factors(const T& squared, T& a, T& b, T& c) {
  if (squared < 1e-4) {
    a = 1.0 - squared / 6.0 * (1.0 - squared / 20.0 * (1.0 - squared / 42.0));
    b = 0.5 - squared / 24.0 * (1.0 - squared / 30.0 * (1.0 - squared / 56.0));
    c = 1.0 / 6.0 - squared / 120.0 * (1.0 - squared / 42.0 * (1.0 - squared / 72.0));
    return;
  }
  using std::cos;
  using std::sin;
  using std::sqrt;
  const T angle = sqrt(squared);
  a = sin(angle) / angle;
  b = (1.0 - cos(angle)) / squared;
  c = (1.0 - a) / squared;
}

/// exp(xi) p.
template <class T, class Scalar>
Vector3<T> move(const T* xi, const Vector3<Scalar>& p) {
  const Vector3<T> v(xi[0], xi[1], xi[2]), w(xi[3], xi[4], xi[5]);
  T a, b, c;
  rotation_factors(T(w.squaredNorm()), a, b, c);
  // p + a w x p + b w x (w x p) + v + b w x v + c w x (w x v), the products shared.
  const Vector3<T> wp(w(1) * p(2) - w(2) * p(1), w(2) * p(0) - w(0) * p(2),
                      w(0) * p(1) - w(1) * p(0)),
      wv = w.cross(v);
  const Vector3<T> twice = w.cross(Vector3<T>(b * wp + c * wv));
  Vector3<T> moved;
  for (int k = 0; k < 3; ++k) moved(k) = p(k) + v(k) + a * wp(k) + b * wv(k) + twice(k);
  return moved;
}

/// exp(xi)^-1 p.
template <class T>
Vector3<T> move_back(const T* xi, const Vector3<T>& p) {
  const T back[6] = {-xi[0], -xi[1], -xi[2], -xi[3], -xi[4], -xi[5]};
  return move(back, p);
}

/// Constants stay double: a Jet times a number costs a third of a Jet times a Jet.
template <class T>
Vector3<T> turn(const Matrix3d& r, const Vector3<T>& p) {
  return {r(0, 0) * p(0) + r(0, 1) * p(1) + r(0, 2) * p(2),
          r(1, 0) * p(0) + r(1, 1) * p(1) + r(1, 2) * p(2),
          r(2, 0) * p(0) + r(2, 1) * p(1) + r(2, 2) * p(2)};
}
template <class T>
Vector3<T> apply(const Pose& pose, const Vector3<T>& p) {
  const Vector3<T> q = turn(pose.rotation, p);
  return {q(0) + pose.translation(0), q(1) + pose.translation(1), q(2) + pose.translation(2)};
}

/// Corner i as sensor sees it. offsets_scales(j, offset, scale) tells the numbers of joint j.
template <class T, class Joints>
Vector3<T> seen(const ViewData& view, int i, const T* board, const T* pose,
                const Joints& offset_scale) {
  Vector3<T> p = apply(view.base_T_board, move(board, Vector3d(view.corners->col(i))));
  for (size_t j = 0; j < view.chain->axes.size(); ++j) {
    const Vector3d& axis = view.chain->axes[j];
    const Vector3<T> q = apply(inverse(view.chain->origins[j]), p);
    T offset, scale;
    offset_scale(static_cast<int>(j), offset, scale);
    using std::cos;
    using std::sin;
    const T angle = scale * view.readings[j] + offset, s = -sin(angle), c = cos(angle);
    const Vector3<T> across = turn(skew(axis), q);
    const T along = (1.0 - c) * (axis(0) * q(0) + axis(1) * q(1) + axis(2) * q(2));
    for (int k = 0; k < 3; ++k) p(k) = c * q(k) + s * across(k) + along * axis(k);
  }
  return move_back(pose, apply(inverse(view.chain->link_T_sensor), p));
}

/// Joints: offsets, then scales, of N joints.
template <int N>
struct CameraCorner {
  ViewData view;
  int i;

  template <class T>
  bool operator()(const T* board, const T* joints, const T* pose, const T* numbers, T* r) const {
    const Vector3<T> p = seen<T>(view, i, board, pose, [&](int j, T& offset, T& scale) {
      offset = joints[j];
      scale = joints[N + j];
    });
    if (!(p.z() > 1e-9)) return false;
    const T u = p.x() / p.z(), v = p.y() / p.z(), s = u * u + v * v;
    const T radial = 1.0 + s * (numbers[4] + s * numbers[5]);
    r[0] = (numbers[0] * (u * radial) + numbers[2] - view.z[2 * i]) * view.inverse_sigma;
    r[1] = (numbers[1] * (v * radial) + numbers[3] - view.z[2 * i + 1]) * view.inverse_sigma;
    return true;
  }
};

struct HandCorner {
  ViewData view;
  int i;

  template <class T>
  bool operator()(const T* board, const T* upper, const T* wrist, const T* pose, T* r) const {
    const Vector3<T> p = seen<T>(view, i, board, pose, [&](int j, T& offset, T& scale) {
      offset = j < 5 ? upper[j] : wrist[j - 5];
      scale = j < 5 ? upper[5 + j] : wrist[j - 3];
    });
    for (int k = 0; k < 3; ++k) r[k] = (p(k) - view.z[3 * i + k]) * view.inverse_sigma;
    return true;
  }
};

// ---------------------------------------------------------------- strongest: by hand, a view at a
// time

/// The view's geometry at the parameters: where the board is, and the twists of the board as the
/// sensor sees them.
template <int N>
struct Geometry {
  Pose sensor_T_board;
  Rows_t<6, 6> by_board, by_pose;
  Rows_t<6, N> by_offset;  // by the joints' offsets; by the scales: times the readings

  void compute(const ViewData& view, const double* board, const std::array<double, N>& positions,
               const double* pose, bool derivatives) {
    const Eigen::Map<const Vector6d> xi_board(board), xi_pose(pose);
    Pose base_T_here;
    Vector3d axes[N], centres[N];
    for (int j = 0; j < N; ++j) {
      const Pose& origin = view.chain->origins[j];
      base_T_here.translation += base_T_here.rotation * origin.translation;
      const Vector3d& a = view.chain->axes[j];
      const double s = std::sin(positions[j]), c = std::cos(positions[j]);
      Matrix3d turn = (1 - c) * a * a.transpose();
      turn.diagonal().array() += c;
      turn(0, 1) -= s * a.z(), turn(0, 2) += s * a.y(), turn(1, 0) += s * a.z();
      turn(1, 2) -= s * a.x(), turn(2, 0) -= s * a.y(), turn(2, 1) += s * a.x();
      const Matrix3d before = base_T_here.rotation * origin.rotation;
      axes[j] = before * a;
      centres[j] = base_T_here.translation;
      base_T_here.rotation = before * turn;
    }
    const Pose sensor_T_base =
        inverse(base_T_here * (view.chain->link_T_sensor * exp_se3(xi_pose)));
    sensor_T_board = sensor_T_base * (view.base_T_board * exp_se3(xi_board));
    if (!derivatives) return;
    by_board = seen_through(sensor_T_board, right_jacobian(xi_board));
    by_pose = -right_jacobian(xi_pose);
    for (int j = 0; j < N; ++j) {
      const Vector3d axis = sensor_T_base.rotation * axes[j], centre = sensor_T_base * centres[j];
      by_offset.template block<3, 1>(0, j) =
          axis.cross(centre);  // a joint's motion moves the sensor, so the board goes the other way
      by_offset.template block<3, 1>(3, j) = -axis;
    }
  }
};

/// Positions of N joints from their block: offsets, then scales.
template <int N>
std::array<double, N> positions(const ViewData& view, const double* joints) {
  std::array<double, N> q;
  for (int j = 0; j < N; ++j) q[j] = joints[N + j] * view.readings[j] + joints[j];
  return q;
}
/// The same of an arm's 7 joints, whose wrist has its own block.
std::array<double, 7> positions(const ViewData& view, const double* upper, const double* wrist) {
  std::array<double, 7> q;
  for (int j = 0; j < 7; ++j)
    q[j] = j < 5 ? upper[5 + j] * view.readings[j] + upper[j]
                 : wrist[j - 3] * view.readings[j] + wrist[j - 5];
  return q;
}

/// Rows of a joint block from the columns of its offsets.
template <int Rows, int N>
void joint_columns(const Rows_t<Rows, N>& by_offset, const double* readings, double* out) {
  for (int k = 0; k < Rows; ++k)
    for (int j = 0; j < N; ++j) {
      out[2 * N * k + j] = by_offset(k, j);
      out[2 * N * k + N + j] = by_offset(k, j) * readings[j];
    }
}

/// One corner in a camera: residuals and, if asked for, their derivatives by the board's twist and
/// by fx fy cx cy k1 k2.
struct CornerRows {
  double r[2];
  Rows_t<2, 6> by_twist, by_numbers;

  bool compute(const ViewData& view, const Pose& sensor_T_board, const double* number, int i,
               bool derivatives) {
    const double w = view.inverse_sigma, fx = number[0] * w, fy = number[1] * w, k1 = number[4],
                 k2 = number[5];
    const Vector3d p = sensor_T_board * Vector3d(view.corners->col(i));
    if (!(p.z() > 1e-9)) return false;
    const double inverse_depth = 1 / p.z(), u = p.x() * inverse_depth, v = p.y() * inverse_depth,
                 s = u * u + v * v;
    const double radial = 1 + s * (k1 + s * k2);
    r[0] = fx * u * radial + (number[2] - view.z[2 * i]) * w;
    r[1] = fy * v * radial + (number[3] - view.z[2 * i + 1]) * w;
    if (!derivatives) return true;
    const double slope = 2 * (k1 + 2 * k2 * s), uu = radial + slope * u * u, uv = slope * u * v,
                 vv = radial + slope * v * v;
    Rows_t<2, 6>& l = by_twist;  // [v | w]: a (v + w x p) = [a | p x a]
    l(0, 0) = fx * inverse_depth * uu, l(0, 1) = fx * inverse_depth * uv,
         l(0, 2) = -fx * inverse_depth * (uu * u + uv * v);
    l(1, 0) = fy * inverse_depth * uv, l(1, 1) = fy * inverse_depth * vv,
         l(1, 2) = -fy * inverse_depth * (uv * u + vv * v);
    for (int k = 0; k < 2; ++k) {
      l(k, 3) = p.y() * l(k, 2) - p.z() * l(k, 1);
      l(k, 4) = p.z() * l(k, 0) - p.x() * l(k, 2);
      l(k, 5) = p.x() * l(k, 1) - p.y() * l(k, 0);
    }
    by_numbers << w * u * radial, 0, w, 0, fx * u * s, fx * u * s * s,  //
        0, w * v * radial, 0, w, fy * v * s, fy * v * s * s;
    return true;
  }
};

/// A camera behind N joints: 96 residuals; board 6, joints N offsets and N scales, camera 12 (pose
/// 6, fx fy cx cy k1 k2).
template <int N>
class CameraView final : public ceres::SizedCostFunction<2 * kCorners, 6, 2 * N, 12> {
 public:
  explicit CameraView(const ViewData& view) : view_(view) {}

  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    Geometry<N> g;
    g.compute(view_, x[0], positions<N>(view_, x[1]), x[2], jacobians != nullptr);
    CornerRows corner;
    for (int i = 0; i < kCorners; ++i) {
      if (!corner.compute(view_, g.sensor_T_board, x[2] + 6, i, jacobians != nullptr)) return false;
      r[2 * i] = corner.r[0];
      r[2 * i + 1] = corner.r[1];
      if (!jacobians) continue;
      const Rows_t<2, 6>& l = corner.by_twist;
      if (jacobians[0]) Eigen::Map<Rows_t<2, 6>>(jacobians[0] + 12 * i) = l.lazyProduct(g.by_board);
      if (jacobians[1])
        joint_columns<2, N>(l.lazyProduct(g.by_offset), view_.readings, jacobians[1] + 4 * N * i);
      if (jacobians[2]) {
        Eigen::Map<Rows_t<2, 12>> out(jacobians[2] + 24 * i);
        out.template leftCols<6>() = l.lazyProduct(g.by_pose);
        out.template rightCols<6>() = corner.by_numbers;
      }
    }
    return true;
  }

 private:
  ViewData view_;
};

/// The hand behind 7 joints: 144 residuals; board 6, five joints 10, wrist 4, pose 6.
class HandView final : public ceres::SizedCostFunction<3 * kCorners, 6, 10, 4, 6> {
 public:
  explicit HandView(const ViewData& view) : view_(view) {}

  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    Geometry<7> g;
    g.compute(view_, x[0], positions(view_, x[1], x[2]), x[3], jacobians != nullptr);
    const double w = view_.inverse_sigma;
    for (int i = 0; i < kCorners; ++i) {
      const Vector3d p = g.sensor_T_board * Vector3d(view_.corners->col(i));
      for (int k = 0; k < 3; ++k) r[3 * i + k] = (p(k) - view_.z[3 * i + k]) * w;
      if (!jacobians) continue;
      // d p = v + w x p: each column of a block is its upper half plus its lower half crossed with
      // p.
      const Matrix3d cross = -skew(p);
      if (jacobians[0])
        Eigen::Map<Rows_t<3, 6>>(jacobians[0] + 18 * i) =
            w * (g.by_board.topRows<3>() + cross.lazyProduct(g.by_board.bottomRows<3>()));
      if (jacobians[3])
        Eigen::Map<Rows_t<3, 6>>(jacobians[3] + 18 * i) =
            w * (g.by_pose.topRows<3>() + cross.lazyProduct(g.by_pose.bottomRows<3>()));
      if (!jacobians[1] && !jacobians[2]) continue;
      const Rows_t<3, 7> by_offset =
          w * (g.by_offset.topRows<3>() + cross.lazyProduct(g.by_offset.bottomRows<3>()));
      if (jacobians[1])
        joint_columns<3, 5>(by_offset.leftCols<5>(), view_.readings, jacobians[1] + 30 * i);
      if (jacobians[2])
        joint_columns<3, 2>(by_offset.rightCols<2>(), view_.readings + 5, jacobians[2] + 12 * i);
    }
    return true;
  }

 private:
  ViewData view_;
};

// ---------------------------------------------------------------- compressed: kincal's idea, in
// Ceres

/// The triangle R of a QR of `a`: R'R = a'a. Through the Gram matrix, which is faster; by QR if
/// that is not positive definite.
template <int Rows, int W>
Rows_t<W, W> triangle(const Rows_t<Rows, W>& a) {
  Eigen::Matrix<double, W, W> gram = Eigen::Matrix<double, W, W>::Zero();
  for (int k = 0; k < Rows; k += 4) {
    const double *p = a.data() + k * W, *q = p + W, *r = q + W, *s = r + W;
    for (int j = 0; j < W; ++j)
      for (int i = j; i < W; ++i)
        gram(i, j) += p[j] * p[i] + q[j] * q[i] + r[j] * r[i] + s[j] * s[i];
  }
  const Eigen::LLT<Eigen::Matrix<double, W, W>> cholesky(gram);
  if (cholesky.info() == Eigen::Success) return cholesky.matrixU();
  const Eigen::HouseholderQR<Eigen::Matrix<double, Rows, W>> qr(a);
  return qr.matrixQR().template topRows<W>().template triangularView<Eigen::Upper>();
}

/// CameraView in 13 residuals: with the triangle R of [derivatives by the twist and by the camera's
/// numbers | residuals], the last column of R has the norm of the residuals, and with R in place of
/// the rows all products J'J and J'r are the same.
template <int N>
class CompressedCamera final : public ceres::SizedCostFunction<13, 6, 2 * N, 12> {
 public:
  explicit CompressedCamera(const ViewData& view) : view_(view) {}

  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    Geometry<N> g;
    g.compute(view_, x[0], positions<N>(view_, x[1]), x[2], jacobians != nullptr);
    CornerRows corner;
    double squares = 0;
    Rows_t<2 * kCorners, 13> a;
    for (int i = 0; i < kCorners; ++i) {
      if (!corner.compute(view_, g.sensor_T_board, x[2] + 6, i, jacobians != nullptr)) return false;
      squares += corner.r[0] * corner.r[0] + corner.r[1] * corner.r[1];
      if (!jacobians) continue;
      a.template block<2, 6>(2 * i, 0) = corner.by_twist;
      a.template block<2, 6>(2 * i, 6) = corner.by_numbers;
      a(2 * i, 12) = corner.r[0];
      a(2 * i + 1, 12) = corner.r[1];
    }
    Eigen::Map<Eigen::Matrix<double, 13, 1>> out(r);
    if (!jacobians) {
      out.setZero();
      r[0] = std::sqrt(squares);
      return true;
    }
    const Rows_t<13, 13> t = triangle(a);
    const Rows_t<13, 6> l = t.template leftCols<6>();
    out = t.col(12);
    if (jacobians[0]) Eigen::Map<Rows_t<13, 6>>(jacobians[0] + 0) = l.lazyProduct(g.by_board);
    if (jacobians[1])
      joint_columns<13, N>(l.lazyProduct(g.by_offset), view_.readings, jacobians[1]);
    if (jacobians[2]) {
      Eigen::Map<Rows_t<13, 12>> by_camera(jacobians[2]);
      by_camera.template leftCols<6>() = l.lazyProduct(g.by_pose);
      by_camera.template rightCols<6>() = t.template middleCols<6>(6);
    }
    return true;
  }

 private:
  ViewData view_;
};

/// HandView in 7 residuals, likewise.
class CompressedHand final : public ceres::SizedCostFunction<7, 6, 10, 4, 6> {
 public:
  explicit CompressedHand(const ViewData& view) : view_(view) {}

  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    Geometry<7> g;
    g.compute(view_, x[0], positions(view_, x[1], x[2]), x[3], jacobians != nullptr);
    const double w = view_.inverse_sigma;
    double squares = 0;
    Rows_t<3 * kCorners, 7> a;
    for (int i = 0; i < kCorners; ++i) {
      const Vector3d p = g.sensor_T_board * Vector3d(view_.corners->col(i));
      const Vector3d e = w * (p - Eigen::Map<const Vector3d>(view_.z + 3 * i));
      squares += e.squaredNorm();
      if (jacobians) a.block<3, 7>(3 * i, 0) << w * Matrix3d::Identity(), -w * skew(p), e;
    }
    Eigen::Map<Eigen::Matrix<double, 7, 1>> out(r);
    if (!jacobians) {
      out.setZero();
      r[0] = std::sqrt(squares);
      return true;
    }
    const Rows_t<7, 7> t = triangle(a);
    const Rows_t<7, 6> l = t.leftCols<6>();
    const Rows_t<7, 7> by_offset = l.lazyProduct(g.by_offset);
    out = t.col(6);
    if (jacobians[0]) Eigen::Map<Rows_t<7, 6>>(jacobians[0] + 0) = l.lazyProduct(g.by_board);
    if (jacobians[1]) joint_columns<7, 5>(by_offset.leftCols<5>(), view_.readings, jacobians[1]);
    if (jacobians[2])
      joint_columns<7, 2>(by_offset.rightCols<2>(), view_.readings + 5, jacobians[2]);
    if (jacobians[3]) Eigen::Map<Rows_t<7, 6>>(jacobians[3] + 0) = l.lazyProduct(g.by_pose);
    return true;
  }

 private:
  ViewData view_;
};

// ---------------------------------------------------------------- all

/// Offsets and scales of joints that always come together: offsets, then scales.
struct JointBlock {
  int first, count;
};
constexpr JointBlock kJointBlocks[5] = {
    {0, 2}, {2, 5}, {7, 2}, {9, 5}, {14, 2}};  // head; left arm, wrist; right arm, wrist

}  // namespace

struct CeresPr2Like::Implementation {
  std::vector<Chain> chains;                      // by sensor
  std::vector<std::vector<double>> joint_blocks;  // values
  std::vector<std::vector<double>> sensors;       // pose 6, cameras: numbers 6
  std::vector<std::array<double, 6>> boards;
  std::vector<std::vector<double>> joint_start, sensor_start;
  Eigen::Matrix3Xd corners;
  std::unique_ptr<ceres::Problem> problem;
  PeerForm form;

  void reset() {
    joint_blocks = joint_start;  // same sizes: the storage stays where Ceres knows it
    sensors = sensor_start;
    for (auto& b : boards) b.fill(0);
  }
  /// Every parameter block with its size, in a fixed order.
  std::vector<std::pair<double*, int>> blocks() {
    std::vector<std::pair<double*, int>> all;
    for (auto& b : boards) all.push_back({b.data(), 6});
    for (auto& j : joint_blocks) all.push_back({j.data(), static_cast<int>(j.size())});
    for (auto& s : sensors) {
      if (form != PeerForm::usual || s.size() == 6) {
        all.push_back({s.data(), static_cast<int>(s.size())});
      } else {
        all.push_back({s.data(), 6});
        all.push_back({s.data() + 6, 6});
      }
    }
    return all;
  }
};

CeresPr2Like::~CeresPr2Like() = default;

CeresPr2Like::CeresPr2Like(const RobotProblem& p, PeerForm form)
    : i_(std::make_unique<Implementation>()) {
  Implementation& m = *i_;
  m.form = form;
  const Rig& rig = p.rig;
  const auto value = [&](int parameter) { return p.start.shared(p.table.all[parameter].start); };
  const auto prior_sigma = [&](int parameter, int component) {
    for (const Prior& prior : p.setup.priors)
      if (prior.parameter == parameter && prior.component == component) return prior.sigma;
    throw std::logic_error("no prior of " + p.table.all[parameter].name);
  };
  std::vector<std::vector<double>> joint_sigma, sensor_sigma;
  for (const JointBlock& b : kJointBlocks) {
    std::vector<double> values, sigmas;
    for (const std::vector<int>* parameters : {&p.table.joint_offset, &p.table.joint_scale})
      for (int j = b.first; j < b.first + b.count; ++j) {
        values.push_back(value((*parameters)[j]));
        sigmas.push_back(prior_sigma((*parameters)[j], 0));
      }
    m.joint_start.push_back(values);
    joint_sigma.push_back(sigmas);
  }
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    std::vector<double> values(6, 0.0), sigmas;
    for (int c = 0; c < 6; ++c) sigmas.push_back(prior_sigma(p.table.sensor_pose[s], c));
    if (!sensor.parameters.empty()) {
      const int first = p.table.sensor_block[s];
      for (int c = 0; c < 6; ++c) {  // fx fy cx cy, k1 k2
        const int parameter = c < 4 ? first : first + 1, component = c < 4 ? c : c - 4;
        values.push_back(p.start.shared(p.table.all[parameter].start + component));
        sigmas.push_back(prior_sigma(parameter, component));
      }
    }
    m.sensor_start.push_back(values);
    sensor_sigma.push_back(sigmas);
    Chain chain;
    chain.link_T_sensor = sensor.link_T_sensor;
    for (const PathStep& step : find_path(rig.tree, rig.base, sensor.link)) {
      chain.origins.push_back(rig.tree.joints[step.joint].parent_T_joint);
      chain.axes.push_back(rig.tree.joints[step.joint].axis);
    }
    m.chains.push_back(std::move(chain));
  }
  m.boards.resize(p.samples.size());
  m.reset();
  m.corners = rig.targets[0].square * rig.targets[0].layout;

  m.problem = std::make_unique<ceres::Problem>();
  for (size_t k = 0; k < p.samples.size(); ++k) {
    const Sample& sample = p.samples[k];
    for (const View& v : sample.views) {
      const int s = v.sensor,
                first = find_path(rig.tree, rig.base, rig.sensors[s].link).front().joint;
      const ViewData view{&m.chains[s],
                          &sample.readings[first],
                          p.start.targets.at({static_cast<int>(k), 0}),
                          &m.corners,
                          v.z.data(),
                          1 / v.sigma[0]};
      const size_t block = first == 0 ? 0 : first == 2 ? 1 : 3;
      double *board = m.boards[k].data(), *joints = m.joint_blocks[block].data(),
             *pose = m.sensors[s].data();
      const size_t joint_count = m.chains[s].axes.size();
      if (form == PeerForm::compressed) {
        if (joint_count == 2)
          m.problem->AddResidualBlock(new CompressedCamera<2>(view), nullptr, board, joints, pose);
        else if (joint_count == 5)
          m.problem->AddResidualBlock(new CompressedCamera<5>(view), nullptr, board, joints, pose);
        else
          m.problem->AddResidualBlock(new CompressedHand(view), nullptr, board, joints,
                                      m.joint_blocks[block + 1].data(), pose);
        continue;
      }
      if (form == PeerForm::strongest) {
        if (joint_count == 2)
          m.problem->AddResidualBlock(new CameraView<2>(view), nullptr, board, joints, pose);
        else if (joint_count == 5)
          m.problem->AddResidualBlock(new CameraView<5>(view), nullptr, board, joints, pose);
        else
          m.problem->AddResidualBlock(new HandView(view), nullptr, board, joints,
                                      m.joint_blocks[block + 1].data(), pose);
        continue;
      }
      for (int i = 0; i < kCorners; ++i) {
        if (joint_count == 2)
          m.problem->AddResidualBlock(
              new ceres::AutoDiffCostFunction<CameraCorner<2>, 2, 6, 4, 6, 6>(
                  new CameraCorner<2>{view, i}),
              nullptr, board, joints, pose, pose + 6);
        else if (joint_count == 5)
          m.problem->AddResidualBlock(
              new ceres::AutoDiffCostFunction<CameraCorner<5>, 2, 6, 10, 6, 6>(
                  new CameraCorner<5>{view, i}),
              nullptr, board, joints, pose, pose + 6);
        else
          m.problem->AddResidualBlock(
              new ceres::AutoDiffCostFunction<HandCorner, 3, 6, 10, 4, 6>(new HandCorner{view, i}),
              nullptr, board, joints, m.joint_blocks[block + 1].data(), pose);
      }
    }
  }
  const auto add_prior = [&](double* x, const double* mean, const double* sigma, size_t size) {
    m.problem->AddResidualBlock(new DiagonalPrior({mean, mean + size}, {sigma, sigma + size}),
                                nullptr, x);
  };
  for (size_t b = 0; b < m.joint_blocks.size(); ++b)
    add_prior(m.joint_blocks[b].data(), m.joint_start[b].data(), joint_sigma[b].data(),
              m.joint_blocks[b].size());
  for (size_t s = 0; s < m.sensors.size(); ++s) {
    if (form != PeerForm::usual) {
      add_prior(m.sensors[s].data(), m.sensor_start[s].data(), sensor_sigma[s].data(),
                m.sensors[s].size());
    } else {
      for (size_t at = 0; at < m.sensors[s].size(); at += 6)
        add_prior(m.sensors[s].data() + at, m.sensor_start[s].data() + at,
                  sensor_sigma[s].data() + at, 6);
    }
  }
}

Run CeresPr2Like::solve(int threads) {
  i_->reset();
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.function_tolerance = 1e-6;
  options.gradient_tolerance = 1e-10;
  options.parameter_tolerance = 1e-8;
  options.max_num_iterations = 100;
  options.num_threads = threads;
  options.logging_type = ceres::SILENT;
  if (i_->form != PeerForm::usual)
    options.jacobi_scaling = false;  // same steps here, 7 % less time
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  size_t index = 0;
  for (const auto& block : i_->blocks())
    options.linear_solver_ordering->AddElementToGroup(block.first,
                                                      index++ < i_->boards.size() ? 0 : 1);
  ceres::Solver::Summary summary;
  Run run;
  const double cpu = cpu_seconds(), wall = wall_seconds();
  ceres::Solve(options, i_->problem.get(), &summary);
  run.seconds = cpu_seconds() - cpu;
  run.wall = wall_seconds() - wall;
  run.start_cost = summary.initial_cost;
  run.cost = summary.final_cost;
  run.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps -
                   1;  // the evaluation at the start counts as a step
  run.converged = summary.termination_type == ceres::CONVERGENCE;
  return run;
}

std::vector<double> CeresPr2Like::gradient() {
  i_->reset();
  ceres::Problem::EvaluateOptions options;
  int k = 0;
  for (const auto& block : i_->blocks()) {
    options.parameter_blocks.push_back(block.first);
    for (int i = 0; i < block.second; ++i) block.first[i] += 0.01 * std::sin(1.0 + k++);
  }
  std::vector<double> gradient;
  i_->problem->Evaluate(options, nullptr, nullptr, &gradient, nullptr);
  return gradient;
}

}  // namespace kincal::benchmarks
