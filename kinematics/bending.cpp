#include "bending.h"

#include <algorithm>
#include <cmath>

namespace kincal {

Matrix3d axis_basis(const Vector3d& axis) {
  int least = 0;
  axis.cwiseAbs().minCoeff(&least);
  Matrix3d out;
  out.col(0) = axis;
  out.col(1) = (Vector3d::Unit(least) - axis(least) * axis).normalized();
  out.col(2) = axis.cross(out.col(1));
  return out;
}

Skeleton::Skeleton(const Tree& tree, const std::vector<char>& bends) {
  const size_t n = tree.joints.size();
  above.assign(n, -1);
  index.assign(n, -1);
  carried_by_.assign(n * n, 0);
  std::vector<int> depth(n, 0);
  for (size_t j = 0; j < n; ++j) {
    above[j] = tree.joint_above[tree.joints[j].parent];
    for (int i = static_cast<int>(j); i >= 0; i = tree.joint_above[tree.joints[i].parent]) {
      carried_by_[i * n + j] = 1;
      ++depth[j];
    }
    order.push_back(static_cast<int>(j));
  }
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return depth[a] < depth[b]; });
  for (const int j : order) {
    if (!bends[j]) continue;
    index[j] = size();
    bending.push_back(j);
    basis.push_back(axis_basis(tree.joints[j].axis));
  }
}

void BentPosture::resize(const Skeleton& skeleton) {
  const size_t joints = skeleton.above.size(), bending = skeleton.bending.size();
  for (std::vector<Matrix3d>* by_joint : {&origin, &motion, &frame, &link})
    by_joint->assign(joints, Matrix3d::Identity());
  for (std::vector<Vector3d>* by_joint : {&load, &compliance, &moment})
    by_joint->assign(joints, Vector3d::Zero());
  for (std::vector<Vector3d>* of_bending : {&torque, &delta})
    of_bending->assign(bending, Vector3d::Zero());
  for (std::vector<Matrix3d>* of_bending : {&bend, &left, &yielding})
    of_bending->assign(bending, Matrix3d::Identity());
  const auto n = static_cast<Eigen::Index>(3 * bending);
  for (MatrixXd* square : {&coupling, &response, &loads}) square->setZero(n, n);
}

namespace {

/// exp_so3(), without sines where the rotation is small.
Matrix3d bend_by(const Vector3d& w) {
  const double s = w.squaredNorm();
  if (s > 1e-4) return exp_so3(w);
  const double a = 1 - s / 6 * (1 - s / 20), b = 0.5 - s / 24 * (1 - s / 30);
  Matrix3d out = b * (w * w.transpose());
  out.diagonal().array() += 1 - b * s;
  out(1, 0) += a * w.z(), out(0, 1) -= a * w.z();
  out(0, 2) += a * w.y(), out(2, 0) -= a * w.y();
  out(2, 1) += a * w.x(), out(1, 2) -= a * w.x();
  return out;
}

/// Iterates to the equilibrium.
bool settle(const Skeleton& skeleton, BentPosture& at) {
  constexpr int kIterations = 100;
  for (int i = 0; i < skeleton.size(); ++i) {
    const int j = skeleton.bending[i];
    at.delta[i].setZero();
    Matrix3d basis = skeleton.basis[i];
    if (at.rotor) basis = at.motion[j] * basis;
    at.yielding[i].noalias() = basis * at.compliance[j].asDiagonal() * basis.transpose();
  }
  double before = 0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    for (const int j : skeleton.order) {
      at.frame[j] = skeleton.above[j] < 0 ? at.origin[j]
                                          : Matrix3d(at.link[skeleton.above[j]] * at.origin[j]);
      const int i = skeleton.index[j];
      if (i >= 0) {
        at.bend[i] = bend_by(at.delta[i]);
        const Matrix3d bent = at.frame[j] * at.bend[i];
        at.link[j].noalias() = bent * at.motion[j];
      } else {
        at.link[j].noalias() = at.frame[j] * at.motion[j];
      }
      at.moment[j].noalias() = at.link[j] * at.load[j];
    }
    for (auto j = skeleton.order.rbegin(); j != skeleton.order.rend(); ++j)
      if (skeleton.above[*j] >= 0) at.moment[skeleton.above[*j]] += at.moment[*j];
    double change = 0;
    for (int i = 0; i < skeleton.size(); ++i) {
      const int j = skeleton.bending[i];
      at.torque[i].noalias() = at.frame[j].transpose() * at.moment[j].cross(at.gravity);
      const Vector3d delta = at.yielding[i] * at.torque[i];
      change = std::max(change, (delta - at.delta[i]).squaredNorm());
      at.delta[i] = delta;
    }
    change = std::sqrt(change);
    if (!std::isfinite(change) || change > kPi) return false;
    if (change <= 1e-15) return true;
    // (Close to the end rounding lets it stand.)
    if (iteration > 0 && change >= before) return change < 1e-12;
    before = change;
  }
  return before < 1e-12;
}

}  // namespace

bool bend(const Skeleton& skeleton, BentPosture& at) {
  if (!settle(skeleton, at)) return false;
  for (int i = 0; i < skeleton.size(); ++i) at.left[i] = left_jacobian_so3(at.delta[i]);
  return true;
}

namespace {

/// The motion by a rotation of all that joint k carries, seen from the root; `frame_too`: the
/// joint's own frame turns as well, else what is behind its deflection. `loads` is D E C F'.
ThreeColumns by_turn(const Skeleton& skeleton, const BentPosture& at,
                     const Eigen::Ref<const MatrixXd>& loads, int k, bool frame_too) {
  // (skew(s) skew(g) = g s' - (s.g) 1)
  const Vector3d& g = at.gravity;
  ThreeColumns out = ThreeColumns::Zero(loads.rows(), 3), carrying = out;
  for (int i = 0; i < skeleton.size(); ++i) {
    const int joint = skeleton.bending[i];
    const auto columns = loads.middleCols<3>(3 * i);
    if (joint == k ? frame_too : skeleton.carries(k, joint)) {
      const Vector3d& s = at.moment[joint];
      out.noalias() += (columns * g) * s.transpose();
      out.noalias() -= s.dot(g) * columns;
    } else if (joint == k || skeleton.carries(joint, k)) {
      carrying += columns;
    }
  }
  const Vector3d& s = at.moment[k];
  out.noalias() += (carrying * s) * g.transpose();
  out.noalias() -= s.dot(g) * carrying;
  return out;
}

}  // namespace

void differentiate(const Skeleton& skeleton, BentPosture& at) {
  at.loads.setZero();
  for (int i = 0; i < skeleton.size(); ++i) {
    at.loads.block<3, 3>(3 * i, 3 * i) = at.yielding[i] * at.frame[skeleton.bending[i]].transpose();
  }
  // C A: what deflections do to deflections. (by_turn() has at most 12 rows: three joints a time.)
  for (int first = 0; first < skeleton.size(); first += 4) {
    const int rows = 3 * std::min(4, skeleton.size() - first);
    for (int k = 0; k < skeleton.size(); ++k) {
      const int joint = skeleton.bending[k];
      at.coupling.block(3 * first, 3 * k, rows, 3) =
          -by_turn(skeleton, at, at.loads.middleRows(3 * first, rows), joint, false) *
          (at.frame[joint] * at.left[k]);
    }
  }
  at.coupling.diagonal().array() += 1;
  at.factors.compute(at.coupling);
  at.response = at.factors.inverse();
  at.coupling.noalias() = at.response * at.loads;
  at.loads.swap(at.coupling);
}

void through_equilibrium(const BentPosture& at, const Eigen::Ref<const MatrixXd>& by_delta,
                         BendingColumns& out) {
  out.response.resize(by_delta.rows(), by_delta.cols());
  out.loads.resize(by_delta.rows(), by_delta.cols());
  out.response.noalias() = by_delta * at.response;
  out.loads.noalias() = by_delta * at.loads;
}

ThreeColumns bent_by_origin(const Skeleton& skeleton, const BentPosture& at,
                            const BendingColumns& columns, int k) {
  return by_turn(skeleton, at, columns.loads, k, true) * at.frame[k];
}

OneColumn bent_by_position(const Skeleton& skeleton, const BentPosture& at,
                           const BendingColumns& columns, int k, const Vector3d& axis) {
  const int i = skeleton.index[k];
  const ThreeColumns turned = by_turn(skeleton, at, columns.loads, k, false);
  if (i < 0) return turned * (at.frame[k] * axis);
  OneColumn out = turned * (at.frame[k] * (at.bend[i] * axis));
  if (at.rotor)  // the directions of its compliances turn along
    out.noalias() += columns.response.middleCols<3>(3 * i) *
                     (axis.cross(at.delta[i]) - at.yielding[i] * axis.cross(at.torque[i]));
  return out;
}

ThreeColumns bent_by_load(const Skeleton& skeleton, const BentPosture& at,
                          const BendingColumns& columns, int k) {
  const Matrix3d turned = -skew(at.gravity) * at.link[k];
  ThreeColumns out = ThreeColumns::Zero(columns.loads.rows(), 3);
  for (int i = 0; i < skeleton.size(); ++i)
    if (skeleton.carries(skeleton.bending[i], k))
      out.noalias() += columns.loads.middleCols<3>(3 * i) * turned;
  return out;
}

ThreeColumns bent_by_compliance(const Skeleton& skeleton, const BentPosture& at,
                                const BendingColumns& columns, int k) {
  const int i = skeleton.index[k];
  Matrix3d directions = skeleton.basis[i];
  if (at.rotor) directions = at.motion[k] * directions;
  const Vector3d torque = directions.transpose() * at.torque[i];
  return columns.response.middleCols<3>(3 * i) * (directions * torque.asDiagonal());
}

}  // namespace kincal
