// Sensor of points of a surface, in its own frame, m: a tip that touches a plate, a depth camera or
// lidar that sees the floor. Its target is a plane, z = 0 of its frame, of which nothing but its
// distance is measured. With n the plane's normal and p its origin, both in the sensor's frame, the
// residual of a measured point z is
//     n (p - z),  by a twist (v, w) of the target: n v + (z x n) w:
// one number, in m, however many points a view has. Three numbers of the plane's pose count (z, rx,
// ry of its frame); x, y and rz move it in itself. A view of few points tells no pose: the plane's
// is given (MeasurementKind::none).
#pragma once

#include <memory>

#include "sensor.h"

namespace kincal {

class SurfaceSensor final : public SensorModel {
 public:
  int rows() const override { return 1; }
  int measurement_size() const override { return 3; }

  bool evaluate(const ViewInput& view, const Columns& c, double* r,
                Eigen::Ref<RowMatrix>* L) const override {
    const Pose& at = view.sensor_T_target;
    const Vector3d n = at.rotation.col(2);
    for (int i = 0; i < view.count; ++i) {
      const Vector3d p = at * Vector3d(view.points->col(view.ids[i]));
      const Eigen::Map<const Vector3d> z(view.z + 3 * i);
      r[i] = n.dot(p - z);
      if (!L) continue;
      L->block<1, 3>(i, c.pose) = n.transpose();
      L->block<1, 3>(i, c.pose + 3) = z.cross(n).transpose();
      if (c.points >= 0) (*L)(i, c.points + 3 * view.ids[i] + 2) = 1;
    }
    return true;
  }
};

inline std::shared_ptr<const SensorModel> make_surface() {
  return std::make_shared<SurfaceSensor>();
}
/// Returns whether a sensor measures points of surfaces, whose only targets are planes.
inline bool sees_surfaces(const SensorModel& model) {
  return dynamic_cast<const SurfaceSensor*>(&model) != nullptr;
}

}  // namespace kincal
