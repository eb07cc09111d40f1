// Tilting laser: a planar scanner on a joint that moves while it scans, so every ray has its own
// reading of that joint.
//
// Numbers of a ray: joint reading t, bearing b, range d. The measured point in the sensor's frame,
// at the ray's own tilt, is m = d (cos b, sin b, 0); residual = predicted - m, m. With q the
// joint's position at the reading t (models/joints) and s the sign with which the path from sensor
// to target walks the joint (see Scan):
//     p_behind = behind_T_target p,   p_joint = motion(s q) p_behind,
//     p_sensor = sensor_T_before p_joint.
// Derivatives of p_sensor, R = rotation of sensor_T_before, M = rotation of motion(s q), axis a:
//     twist [v | w] behind the joint:        R M (v + w x p_behind)
//     twist on the sensor's side:            v + w x p_sensor
//     q: rotation  s R (a x p_joint),  translation  s R a;
//     the joint's own numbers: times d q / d number.
// Own noise: derivative of the measured point, taken as fixed in the world, by (joint, bearing,
// range) times their sigmas. An error of the joint moves the sensor, so m as seen from the far side
// turns by the joint's motion; back in the sensor's frame that is
// -(d p_sensor / d q) at p_sensor = m, times d q / d t. A ray along the joint's axis would have no
// noise across the scanning plane; but it is along the axis only up to the bearing's noise, so the
// derivative across the plane is at least what it would be one sigma of the bearing beside it.
#pragma once

#include <cmath>

#include "sensor.h"

namespace kincal {

class TiltingLaser final : public SensorModel {
 public:
  int rows() const override { return 3; }
  int measurement_size() const override { return 3; }
  bool scans() const override { return true; }
  MeasurementKind measurement_kind() const override { return MeasurementKind::scan; }
  bool has_own_noise() const override { return true; }
  bool noise_sees_target() const override { return false; }
  ViewKernel kernel() const override { return view_kernels().tilting_laser; }
  void compared(const double* z, int n, int stride, double* to) const override {
    for (int i = 0; i < n; ++i) {
      const Vector3d m = measured_point(z + 3 * i);
      for (int k = 0; k < 3; ++k) to[k * stride + i] = m(k);
    }
  }
  std::vector<NoisePart> noise_parts() const override {
    return {{"joint", "rad", 0, 1}, {"bearing", "rad", 1, 1}, {"range", "m", 2, 1}};
  }

  static Vector3d measured_point(const double* z) {
    return {z[2] * std::cos(z[1]), z[2] * std::sin(z[1]), 0};
  }

  bool evaluate(const ViewInput& view, const Columns& c, double* r,
                Eigen::Ref<RowMatrix>* L) const override {
    const Scan& scan = *view.scan;
    const Matrix3d& side = scan.sensor_T_before.rotation;
    for (int i = 0; i < view.count; ++i) {
      const double* z = view.z + 3 * i;
      const double q = scan.direction * scan.position(z[0]);
      const Vector3d behind = scan.behind_T_target * Vector3d(view.points->col(view.ids[i]));
      const Matrix3d turn = scan.prismatic ? Matrix3d::Identity() : rotation_about(scan.axis, q);
      const Vector3d at_joint =
          scan.prismatic ? Vector3d(behind + q * scan.axis) : Vector3d(turn * behind);
      const Vector3d p = scan.sensor_T_before * at_joint;
      Eigen::Map<Vector3d>(r + 3 * i) = p - measured_point(z);
      if (!L) continue;
      const Matrix3d through = side * turn;
      L->block<3, 3>(3 * i, c.pose) = through;
      L->block<3, 3>(3 * i, c.pose + 3) = -through * skew(behind);
      if (c.sensor_side >= 0) {
        L->block<3, 3>(3 * i, c.sensor_side).setIdentity();
        L->block<3, 3>(3 * i, c.sensor_side + 3) = -skew(p);
      }
      if (c.joint >= 0) {
        const Vector3d by_q =
            scan.direction *
            (side * (scan.prismatic ? scan.axis : Vector3d(scan.axis.cross(at_joint))));
        for (int k = 0; k < scan.model->size(); ++k)
          L->block<3, 1>(3 * i, c.joint + k) = scan.model->by_own(k, z[0], scan.own) * by_q;
      }
      if (c.shape()) {
        static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
        point_rows(view, c, i, PointDerivatives(identity, 3, 3),
                   through * scan.behind_T_target.rotation, *L);
      }
    }
    return true;
  }

  void own_noise(const ViewInput& view, int i, Eigen::MatrixXd& b) const override {
    const Scan& scan = *view.scan;
    const double* z = view.z + 3 * i;
    const double c = std::cos(z[1]), s = std::sin(z[1]);
    const Vector3d m(z[2] * c, z[2] * s, 0), at_joint = scan.sensor_T_before.rotation.transpose() *
                                                        (m - scan.sensor_T_before.translation);
    const Vector3d by_q =
        -scan.direction * (scan.sensor_T_before.rotation *
                           (scan.prismatic ? scan.axis : Vector3d(scan.axis.cross(at_joint))));
    b.resize(3, 3);
    b.col(0) = scan.model->by_reading(z[0], scan.own) * by_q;
    b.col(1) << -m.y(), m.x(), 0;
    b.col(2) << c, s, 0;
    const double least = view.sigma ? view.sigma[1] * (scan.prismatic ? 1 : z[2]) : 0;
    if (std::abs(b(2, 0)) < least) b(2, 0) = std::copysign(least, b(2, 0));
  }
};

}  // namespace kincal
