#include "transform.h"

#include <cmath>

namespace kincal {

Matrix3d skew(const Vector3d& v) {
  Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Matrix3d exp_so3(const Vector3d& w) {
  const double angle = w.norm();
  const Matrix3d k = skew(w);
  double a, b;  // R = 1 + a [w]x + b [w]x^2
  if (angle < 1e-5) {
    a = 1 - angle * angle / 6;
    b = 0.5 - angle * angle / 24;
  } else {
    const double half = std::sin(angle / 2) / angle;
    a = std::sin(angle) / angle;
    b = 2 * half * half;
  }
  return Matrix3d::Identity() + a * k + b * (k * k);
}

Matrix3d rotation_about(const Vector3d& axis, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  const Vector3d sine = s * axis, versine = (1 - c) * axis;
  Matrix3d r = versine * axis.transpose();
  r.diagonal().array() += c;
  r(1, 0) += sine.z(), r(0, 1) -= sine.z();
  r(0, 2) += sine.y(), r(2, 0) -= sine.y();
  r(2, 1) += sine.x(), r(1, 2) -= sine.x();
  return r;
}

Eigen::Vector4d quaternion_from_rotation(const Matrix3d& r) {
  const Eigen::Vector4d t(1 + r(0, 0) - r(1, 1) - r(2, 2), 1 - r(0, 0) + r(1, 1) - r(2, 2),
                          1 - r(0, 0) - r(1, 1) + r(2, 2), 1 + r(0, 0) + r(1, 1) + r(2, 2));
  Eigen::Index largest;
  t.maxCoeff(&largest);
  Eigen::Vector4d q;
  switch (largest) {
    case 0:
      q << t(0), r(0, 1) + r(1, 0), r(0, 2) + r(2, 0), r(2, 1) - r(1, 2);
      break;
    case 1:
      q << r(0, 1) + r(1, 0), t(1), r(1, 2) + r(2, 1), r(0, 2) - r(2, 0);
      break;
    case 2:
      q << r(0, 2) + r(2, 0), r(1, 2) + r(2, 1), t(2), r(1, 0) - r(0, 1);
      break;
    default:
      q << r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1), t(3);
  }
  q.normalize();
  return q(3) < 0 ? Eigen::Vector4d(-q) : q;
}

Matrix3d rotation_from_quaternion(const Eigen::Vector4d& xyzw) {
  const Eigen::Vector4d q = xyzw.normalized();
  const Matrix3d k = skew(q.head<3>());
  return Matrix3d::Identity() + 2 * q(3) * k + 2 * (k * k);
}

// The quaternion of half the angle, which loses digits where 1 + cosine is small: there by the
// angle itself. (Eigen's FromTwoVectors takes a singular value decomposition there, whose
// compilation costs seconds in every source that uses it.)
Matrix3d rotation_between(const Vector3d& a, const Vector3d& b) {
  const Vector3d from = a.normalized(), to = b.normalized();
  const double cosine = to.dot(from);
  if (cosine < -1 + 1e-4) {
    const Vector3d across = from.cross(to);
    const double sine = across.norm();
    // Rounding tilts a short product: the axis must stand on `from`, where it lies matters little.
    const Vector3d axis = sine > 1e-14 ? Vector3d(across - from * from.dot(across)).normalized()
                                       : from.unitOrthogonal();
    return rotation_about(axis, std::atan2(sine, cosine));
  }
  const Vector3d axis = from.cross(to);
  const double s = std::sqrt((1 + cosine) * 2), inverse = 1 / s;
  Eigen::Quaterniond out;
  out.vec() = axis * inverse;
  out.w() = s * 0.5;
  return out.toRotationMatrix();
}

Vector3d log_so3(const Matrix3d& r) {
  const Eigen::Vector4d q = quaternion_from_rotation(r);
  const double n = q.head<3>().norm();
  const double factor = n < 1e-12 ? 2 : 2 * std::atan2(n, q(3)) / n;
  return factor * q.head<3>();
}

Matrix3d left_jacobian_so3(const Vector3d& w) {
  const double angle = w.norm();
  const Matrix3d k = skew(w);
  double b, c;
  if (angle < 1e-3) {
    const double s = angle * angle;
    b = 0.5 - s / 24;
    c = 1.0 / 6 - s / 120;
  } else {
    const double half = std::sin(angle / 2) / angle;
    b = 2 * half * half;
    c = (angle - std::sin(angle)) / (angle * angle * angle);
  }
  return Matrix3d::Identity() + b * k + c * (k * k);
}

Matrix3d inverse_left_jacobian_so3(const Vector3d& w) {
  const double angle = w.norm();
  const Matrix3d k = skew(w);
  double c;  // J_l^-1 = 1 - [w]x / 2 + c [w]x^2
  if (angle < 1e-3) {
    c = 1.0 / 12 + angle * angle / 720;
  } else {
    const double half = angle / 2;
    c = (1 - half * std::cos(half) / std::sin(half)) / (angle * angle);
  }
  return Matrix3d::Identity() - 0.5 * k + c * (k * k);
}

Pose exp_se3(const Vector6d& xi) {
  return {exp_so3(xi.tail<3>()), left_jacobian_so3(xi.tail<3>()) * xi.head<3>()};
}

Vector6d log_se3(const Pose& t) {
  Vector6d xi;
  xi.tail<3>() = log_so3(t.rotation);
  xi.head<3>() = inverse_left_jacobian_so3(xi.tail<3>()) * t.translation;
  return xi;
}

Matrix6d right_jacobian_se3(const Vector6d& xi) {
  Matrix6d ad = Matrix6d::Zero();  // ad_xi, with exp(ad_xi) = Ad_exp(xi)
  ad.topLeftCorner<3, 3>() = ad.bottomRightCorner<3, 3>() = skew(xi.tail<3>());
  ad.topRightCorner<3, 3>() = skew(xi.head<3>());
  Matrix6d sum = Matrix6d::Identity(), term = Matrix6d::Identity();
  for (int n = 1; n < 80 && term.cwiseAbs().maxCoeff() > 1e-18; ++n) {  // sum of (-ad)^n / (n + 1)!
    term = -(term * ad).eval() / (n + 1);
    sum += term;
  }
  return sum;
}

Matrix6d adjoint(const Pose& a_T_b) {
  Matrix6d m;
  m.topLeftCorner<3, 3>() = m.bottomRightCorner<3, 3>() = a_T_b.rotation;
  m.topRightCorner<3, 3>() = skew(a_T_b.translation) * a_T_b.rotation;
  m.bottomLeftCorner<3, 3>().setZero();
  return m;
}

Matrix3d rotation_from_rpy(const Vector3d& rpy) {
  const double cr = std::cos(rpy(0)), sr = std::sin(rpy(0)), cp = std::cos(rpy(1)),
               sp = std::sin(rpy(1)), cy = std::cos(rpy(2)), sy = std::sin(rpy(2));
  Matrix3d r;
  r << cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,  //
      sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,   //
      -sp, cp * sr, cp * cr;
  return r;
}

Vector3d rpy_from_rotation(const Matrix3d& r) {
  const double yaw = std::atan2(r(1, 0), r(0, 0));
  const double c = std::cos(yaw), s = std::sin(yaw);
  // Rz(-yaw) R = Ry(pitch) Rx(roll): its first row starts with cos(pitch), its second is (0,
  // cos(roll), -sin(roll)).
  const double cos_pitch = c * r(0, 0) + s * r(1, 0);
  const double cos_roll = c * r(1, 1) - s * r(0, 1), minus_sin_roll = c * r(1, 2) - s * r(0, 2);
  return {std::atan2(-minus_sin_roll, cos_roll), std::atan2(-r(2, 0), cos_pitch), yaw};
}

}  // namespace kincal
