#include "view_poses.h"

#include <Eigen/LU>
#include <cmath>

#include "../rig/configuration.h"
#include "../rig/targets.h"
#include "../sensors/pose.h"
#include "../sensors/tilting_laser.h"

namespace kincal {

namespace {

/// A Pixel is one that a camera measured.
struct Pixel {
  const Sensor& sensor;
  const double *parameters, *z;
  Matrix3Xd& point;  // scratch, 3 x 1
};

/// Residual of a pixel for a point far away in a direction (where a baseline does not show), and
/// its derivatives by the direction. False where it is undefined.
bool far_residual(const Pixel& pixel, const Vector3d& direction, Eigen::Vector2d& r,
                  Eigen::Matrix<double, 2, 3>& derivative) {
  constexpr double kDistant = 1e6;
  pixel.point = kDistant * direction;
  const int id = 0;
  ViewInput in;
  in.parameters = pixel.parameters;
  in.points = &pixel.point;
  in.ids = &id;
  in.count = 1;
  in.z = pixel.z;
  Eigen::Matrix<double, 2, 6, Eigen::RowMajor> rows;
  rows.setZero();
  Eigen::Ref<RowMatrix> l(rows);
  if (!pixel.sensor.model->evaluate(in, Columns(), r.data(), &l)) return false;
  derivative = rows.leftCols<3>() * kDistant;
  return true;
}

/// The direction (x, y, 1) of a pixel, by Newton's method on the sensor's own projection. False
/// where it does not converge: beyond 88.85 degrees, where x, y reach 50.
bool direction_before(const Pixel& pixel, Vector3d& direction) {
  Eigen::Vector2d p(0, 0), r;
  Eigen::Matrix<double, 2, 3> derivative;
  bool good = false;
  for (int step = 0; step < 100 && !good; ++step) {
    if (!far_residual(pixel, {p.x(), p.y(), 1}, r, derivative)) break;
    const Eigen::Vector2d step_p = Eigen::Matrix2d(derivative.leftCols<2>()).inverse() * r;
    if (!step_p.allFinite()) break;
    p -= step_p;
    if (p.norm() > 50) p *= 50 / p.norm();
    good = step_p.norm() < 1e-9;
  }
  direction << p, 1;
  return good;
}

/// The same on the sphere of directions, from the axis, by steps along great circles: of lenses
/// that see sideways and backwards. A step that leaves what such a lens sees is halved.
bool direction_around(const Pixel& pixel, Vector3d& direction) {
  Eigen::Vector2d r;
  Eigen::Matrix<double, 2, 3> derivative;
  const auto defined = [&](const Vector3d& at) { return far_residual(pixel, at, r, derivative); };
  direction = Vector3d::UnitZ();
  if (!defined(direction)) return false;
  for (int step = 0; step < 100; ++step) {
    Eigen::Matrix<double, 3, 2> across;
    across.col(0) = direction.unitOrthogonal();
    across.col(1) = direction.cross(Vector3d(across.col(0)));
    const Eigen::Vector2d turn = -Eigen::Matrix2d(derivative * across).inverse() * r;
    if (!turn.allFinite()) return false;
    const double angle = turn.norm();
    if (angle < 1e-9) return true;
    const Vector3d from = direction;
    double limited = std::min(angle, kPi / 2);
    const auto go = [&] {
      direction =
          (std::cos(limited) * from + std::sin(limited) / angle * (across * turn)).normalized();
      return defined(direction);
    };
    if (go()) continue;
    if (!defined(Vector3d::UnitX())) return false;  // it sees nothing sideways
    do {
      limited /= 2;
      if (limited < 1e-6) return false;
    } while (!go());
  }
  return false;
}

/// Finds the directions of a view's pixels, as many as `out` has columns; those that are found
/// come first there, and their places in `keep`. `point` is scratch.
void find_directions(const Sensor& sensor, const double* parameters, const View& view,
                     Matrix3Xd& point, Matrix3Xd& out, std::vector<int>& keep) {
  keep.clear();
  for (int i = 0; i < static_cast<int>(out.cols()); ++i) {
    const Pixel pixel = {sensor, parameters, view.z.data() + 2 * i, point};
    Vector3d direction;
    if (!direction_before(pixel, direction) && !direction_around(pixel, direction)) continue;
    out.col(static_cast<Eigen::Index>(keep.size())) = direction;
    keep.push_back(i);
  }
}

/// The parameters of a view's sensor; null if it has none.
const double* own_values(const ParameterTable& table, const VectorXd& values, const View& view) {
  const int block = table.sensor_block[view.sensor];
  return block >= 0 ? values.data() + table.all[block].start : nullptr;
}

}  // namespace

Matrix3Xd seen_directions(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                          const View& view, int count, std::vector<int>& keep) {
  Matrix3Xd xy1(3, count), point(3, 1);
  find_directions(rig.sensors[view.sensor], own_values(table, values, view), view, point, xy1,
                  keep);
  xy1.conservativeResize(3, static_cast<Eigen::Index>(keep.size()));
  return xy1;
}

std::vector<Pose> view_poses(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                             const View& view) {
  return RepeatedViewPoses(rig, table, values, view).find(view);
}

RepeatedViewPoses::RepeatedViewPoses(const Rig& rig, const ParameterTable& table,
                                     const VectorXd& values, const View& view)
    : sensor_(&rig.sensors[view.sensor]),
      own_(own_values(table, values, view)),
      points_(select_columns(target_points(rig, table, values, view.target),
                             view_ids(view, rig.targets[view.target]))),
      point_(3, 1) {
  const Eigen::Index n = points_.cols();
  if (sensor_->model->measurement_kind() == MeasurementKind::rays) directions_.resize(3, n);
  keep_.reserve(static_cast<size_t>(n));
}

const std::vector<Pose>& RepeatedViewPoses::find(const View& view) {
  out_.clear();
  switch (sensor_->model->measurement_kind()) {
    case MeasurementKind::pose:
      out_.push_back(measured_pose(view.z.data(), own_ ? own_[0] : 1));
      return out_;
    case MeasurementKind::chain:
      out_.emplace_back();
      return out_;
    case MeasurementKind::points:
      out_.push_back(
          poses_.fit(points_, Eigen::Map<const Matrix3Xd>(view.z.data(), 3, points_.cols())));
      return out_;
    case MeasurementKind::rays: {
      find_directions(*sensor_, own_, view, point_, directions_, keep_);
      const auto found = static_cast<Eigen::Index>(keep_.size());
      if (found == points_.cols()) return poses_.perspective(points_, directions_);
      return poses_.perspective(select_columns(points_, keep_), directions_.leftCols(found));
    }
    default:
      return out_;
  }
}

std::vector<Pose> proposals_of_all(const Rig& rig, const ParameterTable& table,
                                   const VectorXd& values, const Sample& sample, int target,
                                   const std::vector<char>& used) {
  constexpr size_t kFew = 6;
  std::vector<Vector3d> points, places, rays;
  size_t views = 0;
  const Matrix3Xd all = target_points(rig, table, values, target);
  for (const View& view : sample.views) {
    const Sensor& sensor = rig.sensors[view.sensor];
    if (!used[view.sensor] || view.target != target) continue;
    if (sensor.model->measurement_kind() != MeasurementKind::rays) continue;
    const std::vector<int> ids = view_ids(view, rig.targets[target]);
    if (ids.size() >= kFew) return {};
    ++views;
    std::vector<int> keep;
    const Matrix3Xd xy1 =
        seen_directions(rig, table, values, view, static_cast<int>(ids.size()), keep);
    const Pose base_T_sensor =
        Configuration(rig, table, values, sample.readings, sample.conditions, time_of(rig, view))
            .base_T_link(sensor.link) *
        get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
    for (size_t i = 0; i < keep.size(); ++i) {
      points.push_back(all.col(ids[keep[i]]));
      places.push_back(base_T_sensor.translation);
      rays.push_back(base_T_sensor.rotation * Vector3d(xy1.col(static_cast<Eigen::Index>(i))));
    }
  }
  if (views < 2 || points.empty()) return {};
  return poses_at_rays(columns_of(points), columns_of(places), columns_of(rays));
}

ViewPosesMemory::Told& ViewPosesMemory::of(const Rig& rig, const ParameterTable& table,
                                           const VectorXd& values, const View& view) {
  constexpr size_t kMost = 50'000;  // views; then it begins anew
  const Sensor& sensor = rig.sensors[view.sensor];
  const Matrix3Xd points = select_columns(target_points(rig, table, values, view.target),
                                          view_ids(view, rig.targets[view.target]));
  std::vector<double> numbers = view.z;
  const auto add = [&](const double* first, Eigen::Index count) {
    numbers.insert(numbers.end(), first, first + count);
  };
  add(points.data(), points.size());
  for (size_t b = 0; b < sensor.parameters.size(); ++b) {
    const Parameter& p = table.all[table.sensor_block[view.sensor] + static_cast<int>(b)];
    add(values.data() + p.start, p.size());
  }
  add(sensor.sigma.data(), static_cast<Eigen::Index>(sensor.sigma.size()));
  add(view.sigma.data(), static_cast<Eigen::Index>(view.sigma.size()));
  for (const Matrix3d& covariance : view.covariance) add(covariance.data(), covariance.size());
  if (known_.size() >= kMost) known_.clear();
  return known_[{sensor.model, std::move(numbers)}];
}

Matrix3Xd scanned_points(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                         const Sample& sample, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const Pose link_T_sensor = get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
  const std::vector<double> readings = completed(sample.readings);
  Matrix3Xd out(3, static_cast<Eigen::Index>(view.z.size() / 3));
  for (Eigen::Index i = 0; i < out.cols(); ++i) {
    const double* z = view.z.data() + 3 * i;
    out.col(i) = Configuration(rig, table, values, readings, sample.conditions, time_of(rig, view))
                     .with(sensor.scanning_joint, z[0])
                     .base_T_link(sensor.link) *
                 link_T_sensor * TiltingLaser::measured_point(z);
  }
  return out;
}

std::vector<Pose> proposals(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                            const Sample& sample, const View& view, ViewPosesMemory* memory) {
  const Sensor& sensor = rig.sensors[view.sensor];
  if (sensor.model->measurement_kind() == MeasurementKind::scan) {
    const std::vector<int> ids = view_ids(view, rig.targets[view.target]);
    return {fit_points(select_columns(target_points(rig, table, values, view.target), ids),
                       scanned_points(rig, table, values, sample, view))};
  }
  const Pose base_T_sensor =
      Configuration(rig, table, values, sample.readings, sample.conditions, time_of(rig, view))
          .base_T_link(sensor.link) *
      get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
  std::vector<Pose> out;
  if (memory) {
    std::optional<std::vector<Pose>>& known = memory->of(rig, table, values, view).poses;
    if (!known) known = view_poses(rig, table, values, view);
    out = *known;
  } else {
    out = view_poses(rig, table, values, view);
  }
  for (Pose& p : out) p = base_T_sensor * p;
  return out;
}

}  // namespace kincal
