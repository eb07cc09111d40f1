// Sensors that measure poses: `pose` (motion capture: measures sensor_T_target = Z) and `chain`
// (the joint readings are the measurement: the target is at link_T_target, which is the sensor's
// own frame here, so Z = 1).
//
// A measured pose may have a scale, range_scale: marker poses are in units of the stated size of
// the marker. Z is then compared with T whose translation is multiplied by the scale s; in
// coordinates of that, a twist [v | w] of T is [s v | w].
//
// Residual: the six numbers [translation of E | Log of the rotation of E], E = Z^-1 T, T the
// predicted sensor_T_target. With T' = exp(xi) T:  E' = exp(Ad_Z^-1 xi) E, so with [v | w] =
// Ad_Z^-1 xi
//     d translation = v + w x t_E,     d Log = J_l(Log)^-1 w.
// In noise mode `point` a chain has the paper's residual at each target point p:  r = E p - p
// (equations (10)-(14)), with the grip's noise e, link_T_target exp(e), as own covariance G D G', G
// = [1 | -[p]x].
#pragma once

#include "sensor.h"

namespace kincal {

/// Returns the pose sensor_T_target that a measurement z = x y z qx qy qz qw states, where the
/// sensor multiplies translations by `scale`.
inline Pose measured_pose(const double* z, double scale) {
  return {rotation_from_quaternion(Eigen::Vector4d(z[3], z[4], z[5], z[6])),
          Vector3d(z[0], z[1], z[2]) / scale};
}

class PoseSensor final : public SensorModel {
 public:
  /// @param scaled it has one parameter, the scale of translations
  PoseSensor(bool measures, bool scaled) : measures_(measures), scaled_(scaled) {}
  int rows() const override { return 6; }
  int measurement_size() const override { return measures_ ? 7 : 0; }
  bool measures_pose() const override { return true; }
  MeasurementKind measurement_kind() const override {
    return measures_ ? MeasurementKind::pose : MeasurementKind::chain;
  }
  std::vector<NoisePart> noise_parts() const override {
    return {{"translation", "m", 0, 3}, {"rotation", "rad", 3, 3}};
  }
  const SensorModel* point_form() const override;

  bool evaluate(const ViewInput& view, const Columns& c, double* r,
                Eigen::Ref<RowMatrix>* L) const override {
    const double scale = scaled_ ? view.parameters[0] : 1;
    Pose seen = view.sensor_T_target;
    seen.translation *= scale;
    const Pose inverse_z = measures_ ? inverse(measured_pose(view.z, 1)) : Pose(),
               e = inverse_z * seen;
    const Vector3d phi = log_so3(e.rotation);
    Eigen::Map<Vector6d>(r) << e.translation, phi;
    if (!L) return true;
    Matrix6d d;
    d << Matrix3d::Identity(), -skew(e.translation), Matrix3d::Zero(),
        inverse_left_jacobian_so3(phi);
    L->block<6, 6>(0, c.pose) = d * adjoint(inverse_z);
    L->block<6, 3>(0, c.pose) *= scale;
    if (scaled_ && c.parameters >= 0)
      L->col(c.parameters) << inverse_z.rotation * view.sensor_T_target.translation,
          Vector3d::Zero();
    return true;
  }

 private:
  bool measures_, scaled_;
};

/// This is a chain in noise mode `point`: E p - p at every target point.
class ChainPoints final : public SensorModel {
 public:
  int rows() const override { return 3; }
  int measurement_size() const override { return 0; }
  int sigmas() const override { return 6; }
  bool has_own_noise() const override { return true; }

  bool evaluate(const ViewInput& view, const Columns& c, double* r,
                Eigen::Ref<RowMatrix>* L) const override {
    const Matrix3d& rotation = view.sensor_T_target.rotation;
    for (int i = 0; i < view.count; ++i) {
      const Vector3d p = view.points->col(view.ids[i]), moved = view.sensor_T_target * p;
      Eigen::Map<Vector3d>(r + 3 * i) = moved - p;
      if (!L) continue;
      L->block<3, 3>(3 * i, c.pose).setIdentity();
      L->block<3, 3>(3 * i, c.pose + 3) = -skew(moved);
      const Matrix3d shape = rotation - Matrix3d::Identity();
      if (c.square >= 0 && view.layout)
        L->block<3, 1>(3 * i, c.square) = shape * view.layout->col(view.ids[i]);
      if (c.warp >= 0 && view.bulge)
        L->block<3, 2>(3 * i, c.warp) = shape.col(2) * view.bulge->col(view.ids[i]).transpose();
      if (c.print >= 0 && view.plain)
        L->block<3, 2>(3 * i, c.print) =
            shape.leftCols<2>() * d_print(view.plain->col(view.ids[i]).head<2>());
      if (c.points >= 0) L->block<3, 3>(3 * i, c.points + 3 * view.ids[i]) = shape;
    }
    return true;
  }

  void own_noise(const ViewInput& view, int i, Eigen::MatrixXd& b) const override {
    b.resize(3, 6);
    b << Matrix3d::Identity(), -skew(view.points->col(view.ids[i]));
  }
};

inline const SensorModel* PoseSensor::point_form() const {
  static const ChainPoints points;
  return measures_ ? nullptr : &points;
}

}  // namespace kincal
