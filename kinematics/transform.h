// Rigid motions: the one place that states tangent order and side.
//
// Conventions
//   a_T_b maps coordinates in b to coordinates in a:  p_a = a_T_b p_b = R p_b + t.
//   A tangent vector (twist) is xi = [v | w] = [dx dy dz | rx ry rz], translation first.
//   An increment of a pose parameter acts on the right, in the frame itself:  T(xi) = T0 exp(xi).
//   The motion of a frame seen from outside acts on the left:  T' = exp(xi) T; a point p of that
//   frame, in outer coordinates, then moves by  v + w x p.  The two are related by the adjoint:
//       T exp(xi) = exp(Ad_T xi) T.
// Nothing here allocates or throws.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace kincal {

// The names of Eigen that models, io and apps use without its namespace. The solver, which includes
// no kinematics, declares its own in problem.h.
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr double kPi = 3.14159265358979323846;  // M_PI is POSIX, not C++

/// A Pose is a rigid motion a_T_b: rotation (3 x 3, orthonormal) and translation (m).
struct Pose {
  Matrix3d rotation = Matrix3d::Identity();
  Vector3d translation = Vector3d::Zero();
};

inline Pose operator*(const Pose& a, const Pose& b) {
  return {a.rotation * b.rotation, a.rotation * b.translation + a.translation};
}
inline Vector3d operator*(const Pose& a, const Vector3d& p) {
  return a.rotation * p + a.translation;
}
inline Pose inverse(const Pose& a) {
  return {a.rotation.transpose(), -(a.rotation.transpose() * a.translation)};
}

/// Returns the matrix [v]x with [v]x u = v x u.
Matrix3d skew(const Vector3d& v);

/// Returns the rotation by |w| radians about w (Rodrigues), exact to rounding for every length, 0
/// included.
Matrix3d exp_so3(const Vector3d& w);
/// Returns exp_so3(angle * axis) for a unit axis, at lower cost.
Matrix3d rotation_about(const Vector3d& axis, double angle);
/// Returns the smallest rotation that turns a to the direction of b; both may have any length but
/// 0. If they are opposite, it is half a turn about an axis perpendicular to a.
Matrix3d rotation_between(const Vector3d& a, const Vector3d& b);
/// Inverts exp_so3 with |w| <= pi. It uses the quaternion and is accurate near 0 and near pi.
Vector3d log_so3(const Matrix3d& r);
/// Returns J_l with exp(w + d) = exp(J_l d) exp(w) to first order.
Matrix3d left_jacobian_so3(const Vector3d& w);
/// Returns the inverse of left_jacobian_so3 for |w| < 2 pi.
Matrix3d inverse_left_jacobian_so3(const Vector3d& w);

/// Returns the exponential of SE(3): rotation exp(w), translation J_l(w) v.
Pose exp_se3(const Vector6d& xi);
/// Inverts exp_se3; the rotation angle is at most pi.
Vector6d log_se3(const Pose& t);
/// Returns J_r with exp(xi + d) = exp(xi) exp(J_r d) to first order, by a series in the small
/// adjoint that converges for every xi.
Matrix6d right_jacobian_se3(const Vector6d& xi);

/// Returns Ad_T, which maps a twist xi of frame b, given in b, to the same twist seen from a: T
/// exp(xi) T^-1 = exp(Ad_T xi).
Matrix6d adjoint(const Pose& a_T_b);

/// Returns the rotation of URDF's fixed-axis roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll).
Matrix3d rotation_from_rpy(const Vector3d& rpy);
/// Inverts rotation_from_rpy. Yaw is computed first and roll from the rest, so the angles reproduce
/// the rotation to rounding also at and near pitch = +-90 degrees, where two separate arctangents
/// lose up to 1e-7 rad.
Vector3d rpy_from_rotation(const Matrix3d& r);

/// Returns (x, y, z, w) with w >= 0. It starts from the largest component and is accurate for every
/// rotation.
Eigen::Vector4d quaternion_from_rotation(const Matrix3d& r);
/// Returns the rotation of a quaternion (x, y, z, w) of any positive length.
Matrix3d rotation_from_quaternion(const Eigen::Vector4d& xyzw);

}  // namespace kincal
