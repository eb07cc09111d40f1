#include "angles.h"

#include <algorithm>
#include <cmath>

namespace kincal {
namespace {

double wrapped(double angle) { return std::remainder(angle, 2 * kPi); }
bool within(double angle, double most) { return std::abs(angle) <= most; }

Matrix3d about_x(double angle) { return rotation_about(Vector3d::UnitX(), angle); }
Matrix3d about_y(double angle) { return rotation_about(Vector3d::UnitY(), angle); }
Matrix3d about_z(double angle) { return rotation_about(Vector3d::UnitZ(), angle); }

/// The other triple of three turns about different axes.
Vector3d other_triple(const Vector3d& n) {
  return {wrapped(n(0) + kPi), wrapped(kPi - n(1)), wrapped(n(2) + kPi)};
}

std::array<Vector3d, 2> roll_pitch_yaw(const Matrix3d& r) {
  const Vector3d n = rpy_from_rotation(r);
  return {n, other_triple(n)};
}

Matrix3d rotation_from_a_b_c(const Vector3d& n) { return rotation_from_rpy(n.reverse()); }
std::array<Vector3d, 2> a_b_c(const Matrix3d& r) {
  const Vector3d n = rpy_from_rotation(r).reverse();
  return {n, other_triple(n)};
}

Matrix3d rotation_from_moving_x_y_z(const Vector3d& n) {
  return about_x(n(0)) * about_y(n(1)) * about_z(n(2));
}
/// The transpose of Rx Ry Rz is Rz(-c) Ry(-b) Rx(-a).
std::array<Vector3d, 2> moving_x_y_z(const Matrix3d& r) {
  const Vector3d n = -rpy_from_rotation(r.transpose());
  return {n, other_triple(n)};
}

Matrix3d rotation_from_z_y_z(const Vector3d& n) {
  return about_z(n(0)) * about_y(n(1)) * about_z(n(2));
}
/// The first angle is taken first and the others from what remains, so that the three reproduce
/// the rotation at and near b = 0 and half a turn, too.
std::array<Vector3d, 2> z_y_z(const Matrix3d& r) {
  const double a = r(0, 2) == 0 && r(1, 2) == 0 ? 0 : std::atan2(r(1, 2), r(0, 2));
  const Matrix3d rest = about_z(-a) * r;
  const double b = std::atan2(rest(0, 2), rest(2, 2)), c = std::atan2(rest(1, 0), rest(1, 1));
  return {Vector3d(a, b, c), Vector3d(wrapped(a + kPi), -b, wrapped(c + kPi))};
}

std::array<Vector3d, 2> rotation_vector(const Matrix3d& r) {
  const Vector3d n = log_so3(r);
  return {n, n * (1 - 2 * kPi / std::max(n.norm(), 1e-9))};
}

bool usual_middle_quarter(const Vector3d& n) {
  return within(n(0), kPi) && within(n(1), kPi / 2) && within(n(2), kPi);
}
bool usual_z_y_z(const Vector3d& n) {
  return within(n(0), kPi) && n(1) >= 0 && n(1) <= kPi && within(n(2), kPi);
}
bool usual_vector(const Vector3d& n) { return n.norm() <= kPi; }

const AngleConvention kConventions[kAngleConventions] = {
    {"roll, pitch and yaw", "rpy, rpy_deg, fanuc, yaskawa", rotation_from_rpy, roll_pitch_yaw,
     usual_middle_quarter},
    {"A, B, C (turns about z, the new y, the new x: KUKA)", "kuka", rotation_from_a_b_c, a_b_c,
     usual_middle_quarter},
    {"turns about x, the new y, the new z (Staeubli)", "staubli", rotation_from_moving_x_y_z,
     moving_x_y_z, usual_middle_quarter},
    {"turns about z, the new y, the new z (Doosan, Kawasaki, Comau)", "zyz", rotation_from_z_y_z,
     z_y_z, usual_z_y_z},
    {"rotation vectors (axis times angle: Universal Robots)", "rotvec, rotvec_deg", exp_so3,
     rotation_vector, usual_vector}};

}  // namespace

const AngleConvention& angle_convention(Angles which) {
  return kConventions[static_cast<int>(which)];
}

}  // namespace kincal
