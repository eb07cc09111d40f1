#include "view_poses.h"

#include <Eigen/LU>
#include <cmath>

#include "../rig/configuration.h"
#include "../rig/targets.h"
#include "../sensors/tilting_laser.h"
#include "closed_form.h"

namespace kincal {

namespace {

/// Directions (x, y, 1) of a view's pixels, by Newton's method on the sensor's own projection far
/// away (where a baseline does not show). False for each that does not converge.
std::vector<bool> directions(const Sensor& sensor, const double* parameters, const View& view,
                             int count, Matrix3Xd& xy1) {
  constexpr double kFar = 1e6;
  std::vector<bool> good(count, false);
  Matrix3Xd point(3, 1);
  const int id = 0;
  Columns columns;
  RowMatrix rows(2, 6);
  for (int i = 0; i < count; ++i) {
    Eigen::Vector2d p(0, 0), r;
    for (int step = 0; step < 100 && !good[i]; ++step) {
      point << kFar * p, kFar;
      ViewInput in;
      in.parameters = parameters;
      in.points = &point;
      in.ids = &id;
      in.count = 1;
      in.z = view.z.data() + 2 * i;
      rows.setZero();
      Eigen::Ref<RowMatrix> l(rows);
      if (!sensor.model->evaluate(in, columns, r.data(), &l)) break;
      const Eigen::Vector2d step_p = Eigen::Matrix2d(rows.leftCols<2>() * kFar).inverse() * r;
      if (!step_p.allFinite()) break;
      p -= step_p;
      if (p.norm() > 50) p *= 50 / p.norm();
      good[i] = step_p.norm() < 1e-9;
    }
    xy1.col(i) << p, 1;
  }
  return good;
}

}  // namespace

Matrix3Xd seen_directions(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                          const View& view, int count, std::vector<int>& keep) {
  Matrix3Xd xy1(3, count);
  const int block = table.sensor_block[view.sensor];
  const std::vector<bool> good =
      directions(rig.sensors[view.sensor],
                 block >= 0 ? values.data() + table.all[block].start : nullptr, view, count, xy1);
  keep.clear();
  for (int i = 0; i < count; ++i)
    if (good[i]) keep.push_back(i);
  return select_columns(xy1, keep);
}

std::vector<Pose> view_poses(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                             const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const Target& target = rig.targets[view.target];
  const std::vector<int> ids = view_ids(view, target);
  const Matrix3Xd points = select_columns(target_points(rig, table, values, view.target), ids);
  const Eigen::Index n = points.cols();
  switch (sensor.model->measurement_kind()) {
    case MeasurementKind::pose: {
      Pose z;
      z.translation << view.z[0], view.z[1], view.z[2];
      z.rotation =
          rotation_from_quaternion(Eigen::Vector4d(view.z[3], view.z[4], view.z[5], view.z[6]));
      return {z};
    }
    case MeasurementKind::chain:
      return {Pose()};
    case MeasurementKind::points:
      return {fit_points(points, Eigen::Map<const Matrix3Xd>(view.z.data(), 3, n))};
    case MeasurementKind::rays: {
      std::vector<int> keep;
      const Matrix3Xd xy1 = seen_directions(rig, table, values, view, static_cast<int>(n), keep);
      return perspective_poses(select_columns(points, keep), xy1);
    }
    default:
      return {};
  }
}

Matrix3Xd scanned_points(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                         const Sample& sample, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const Pose link_T_sensor = get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
  Matrix3Xd out(3, static_cast<Eigen::Index>(view.z.size() / 3));
  for (Eigen::Index i = 0; i < out.cols(); ++i) {
    const double* z = view.z.data() + 3 * i;
    out.col(i) = Configuration(rig, table, values, sample.readings)
                     .with(sensor.scanning_joint, z[0])
                     .base_T_link(sensor.link) *
                 link_T_sensor * TiltingLaser::measured_point(z);
  }
  return out;
}

std::vector<Pose> proposals(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                            const Sample& sample, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  if (sensor.model->measurement_kind() == MeasurementKind::scan) {
    const std::vector<int> ids = view_ids(view, rig.targets[view.target]);
    return {fit_points(select_columns(target_points(rig, table, values, view.target), ids),
                       scanned_points(rig, table, values, sample, view))};
  }
  const Pose base_T_sensor =
      Configuration(rig, table, values, sample.readings).base_T_link(sensor.link) *
      get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
  std::vector<Pose> out;
  for (const Pose& p : view_poses(rig, table, values, view)) out.push_back(base_T_sensor * p);
  return out;
}

}  // namespace kincal
