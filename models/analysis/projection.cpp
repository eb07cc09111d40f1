#include "projection.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../fitting/view_poses.h"
#include "../rig/configuration.h"
#include "../rig/numbers.h"
#include "../rig/targets.h"

namespace kincal {
namespace {

constexpr int kCellColumns = 8, kCellRows = 6;
constexpr double kVeryFar = 1e6;  // m: as good as infinity

/// What a camera sees of some points, with derivatives by a motion of theirs (6 columns) and by the
/// camera's own numbers.
struct SeenPoints {
  std::vector<Vector3d> points;  // in the camera's frame
  RowMatrix rows;
  VectorXd off;  // where they appear minus where they were seen
  bool good = false;
};

SeenPoints see(const Solution& solution, int sensor, const Matrix3Xd& points,
               const Pose& camera_T_points, const std::vector<int>& ids, const double* z) {
  const ParameterTable& table = solution.table();
  const int own =
      solution.rig().sensors[sensor].parameters.empty() ? 0 : table.sensor_block[sensor];
  int count = 0;
  for (const ParameterBlock& block : solution.rig().sensors[sensor].parameters)
    count += static_cast<int>(block.values.size());
  ViewInput in;
  in.sensor_T_target = camera_T_points;
  in.parameters = solution.values.shared.data() + table.all[own].start;
  in.points = &points;
  in.ids = ids.data();
  in.count = static_cast<int>(ids.size());
  in.z = z;
  Columns columns;
  columns.parameters = 6;
  columns.total = 6 + count;
  SeenPoints out;
  out.rows = RowMatrix::Zero(2 * in.count, columns.total);
  out.off.resize(2 * in.count);
  Eigen::Ref<RowMatrix> l(out.rows);
  out.good = solution.rig().sensors[sensor].model->evaluate(in, columns, out.off.data(), &l);
  for (int id : ids) out.points.push_back(camera_T_points * Vector3d(points.col(id)));
  return out;
}

Pose camera_T_board(const Solution& solution, int sample, const View& view) {
  const Configuration at(solution.rig(), solution.table(), solution.values.shared,
                         solution.samples()[sample].readings, solution.samples()[sample].conditions,
                         time_of(solution.rig(), view));
  return inverse(at.base_T_sensor(view.sensor)) * solution.values.targets.at({sample, view.target});
}

/// What a view's camera sees of its board, over the sigmas of its pixels.
SeenPoints see(const Solution& solution, const View& view, const Pose& camera_T_board) {
  const Matrix3Xd points =
      target_points(solution.rig(), solution.table(), solution.values.shared, view.target);
  SeenPoints out = see(solution, view.sensor, points, camera_T_board,
                       view_ids(view, solution.rig().targets[view.target]), view.z.data());
  for (Eigen::Index k = 0; k < out.off.size(); ++k) {
    out.rows.row(k) /= view.sigma[k % 2];
    out.off(k) /= view.sigma[k % 2];
  }
  return out;
}

/// How a point moves with a twist [v | w] of its body: [I | -[p]x].
Eigen::Matrix<double, 3, 6> moved_by(const Vector3d& p) {
  Eigen::Matrix<double, 3, 6> d = Eigen::Matrix<double, 3, 6>::Identity();
  d.rightCols<3>() = -skew(p);
  return d;
}

/// Places of the freed numbers of a sensor in its row of own numbers.
std::vector<int> freed_numbers(const Solution& solution, int sensor) {
  const ParameterTable& table = solution.table();
  std::vector<int> out;
  const int first = table.all[table.sensor_block[sensor]].start;
  const auto blocks = static_cast<int>(solution.rig().sensors[sensor].parameters.size());
  for (int b = 0; b < blocks; ++b)
    if (const Freed* freed = find_freed(solution.setup.free, table.sensor_block[sensor] + b))
      for (int c : freed->components) out.push_back(table.all[freed->parameter].start - first + c);
  return out;
}

MatrixXd columns_at(const RowMatrix& rows, const std::vector<int>& places, int offset) {
  MatrixXd out(rows.rows(), static_cast<Eigen::Index>(places.size()));
  for (size_t i = 0; i < places.size(); ++i)
    out.col(static_cast<Eigen::Index>(i)) = rows.col(offset + places[i]);
  return out;
}

/// What a view says of the lens: derivatives by the board's pose and by the freed numbers, and how
/// the pose follows these.
struct ViewOfLens {
  int sample;
  Pose pose;
  SeenPoints seen;
  MatrixXd p, j, h, g;  // P, J, H^-1 and G of the header
};

std::vector<ViewOfLens> views_of_lens(const Solution& solution, int sensor,
                                      const std::vector<int>& freed) {
  std::vector<ViewOfLens> out;
  for (int i : solution.training())
    for (const View& view : solution.samples()[i].views) {
      if (view.sensor != sensor) continue;
      const Pose pose = camera_T_board(solution, i, view);
      ViewOfLens one{i, pose, see(solution, view, pose), {}, {}, {}, {}};
      if (!one.seen.good) continue;
      one.p = one.seen.rows.leftCols<6>();
      one.j = columns_at(one.seen.rows, freed, 6);
      one.h = inverse_of_symmetric(one.p.transpose() * one.p);
      one.g = one.h * (one.p.transpose() * one.j);
      out.push_back(std::move(one));
    }
  return out;
}

}  // namespace

Grid coverage(const Solution& solution, int sensor, const Eigen::Vector2d& image) {
  Grid out{kCellColumns, kCellRows, std::vector<double>(kCellColumns * kCellRows, 0.0)};
  for (int i : solution.training())
    for (const View& view : solution.samples()[i].views) {
      if (view.sensor != sensor) continue;
      for (size_t k = 0; k + 1 < view.z.size(); k += 2) {
        // Pixel centres have whole numbers: the image begins half a pixel before the first.
        const auto column =
            static_cast<int>(std::floor((view.z[k] + 0.5) / image.x() * out.columns));
        const auto row = static_cast<int>(std::floor((view.z[k + 1] + 0.5) / image.y() * out.rows));
        ++out.values[std::clamp(row, 0, out.rows - 1) * out.columns +
                     std::clamp(column, 0, out.columns - 1)];
      }
    }
  return out;
}

std::vector<LensEquations> lens_equations(const Solution& solution, int sensor) {
  std::vector<LensEquations> out;
  for (const auto& [i, pose, seen, p, j, h, g] :
       views_of_lens(solution, sensor, freed_numbers(solution, sensor))) {
    if (out.empty() || out.back().sample != i)
      out.push_back({i, MatrixXd::Zero(g.cols(), g.cols()), VectorXd::Zero(g.cols())});
    out.back().normal += j.transpose() * j - j.transpose() * p * g;
    out.back().pull += g.transpose() * (p.transpose() * seen.off) - j.transpose() * seen.off;
  }
  return out;
}

ProjectionError::ProjectionError(const Solution& solution, int sensor)
    : solution_(&solution), sensor_(sensor), freed_(freed_numbers(solution, sensor)) {
  const auto n = static_cast<Eigen::Index>(freed_.size());
  MatrixXd information = MatrixXd::Zero(n, n), sum_ng = MatrixXd::Zero(6, n);
  Matrix6d sum_n = Matrix6d::Zero(), sum_nhn = Matrix6d::Zero();
  std::vector<double> distances;
  std::vector<Vector3d> normals;
  for (const auto& [i, pose, seen, p, j, h, g] : views_of_lens(solution, sensor, freed_)) {
    Matrix6d weight = Matrix6d::Zero();
    Vector3d centre = Vector3d::Zero();
    for (const Vector3d& point : seen.points) {
      const Eigen::Matrix<double, 3, 6> d = moved_by(point);
      weight += d.transpose() * d;
      centre += point / static_cast<double>(seen.points.size());
    }
    information += j.transpose() * j - j.transpose() * p * g;
    sum_n += weight;
    sum_ng += weight * g;
    sum_nhn += weight * h * weight;
    distances.push_back(centre.norm());
    normals.push_back(pose.rotation.col(2));
  }
  distance_ = median(distances, 0);
  for (const Vector3d& a : normals)
    for (const Vector3d& b : normals)
      tilt_ = std::max(tilt_, std::acos(std::min(1.0, std::abs(a.dot(b)))));
  const VectorXd scale = information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  determined_ = n > 0 && !distances.empty() && symmetric_eigen(scaled).values.minCoeff() > 1e-12;
  if (!determined_) return;
  lens_ = scale.asDiagonal() * inverse_of_symmetric(scaled) * scale.asDiagonal();
  const MatrixXd inverse_n = inverse_of_symmetric(sum_n);
  motion_ = inverse_n * sum_ng;
  noise_ = inverse_n * sum_nhn * inverse_n;
}

Eigen::Matrix2d ProjectionError::covariance(const Eigen::Vector2d& pixel, double distance) const {
  const Eigen::Matrix2d none = Eigen::Matrix2d::Constant(kNan);
  if (!determined_) return none;
  View view;
  view.sensor = sensor_;
  view.z = {pixel.x(), pixel.y()};
  std::vector<int> keep;
  const Matrix3Xd direction = seen_directions(solution_->rig(), solution_->table(),
                                              solution_->values.shared, view, 1, keep);
  if (keep.empty()) return none;
  const Matrix3Xd point = std::min(distance, kVeryFar) * direction.col(0).normalized();
  const double anywhere[2] = {0, 0};
  const SeenPoints seen = see(*solution_, sensor_, point, Pose(), {0}, anywhere);
  if (!seen.good) return none;
  const MatrixXd p = seen.rows.leftCols<6>(), a = columns_at(seen.rows, freed_, 6) - p * motion_;
  return a * lens_ * a.transpose() + p * noise_ * p.transpose();
}

Grid ProjectionError::grid(const Eigen::Vector2d& image, double distance) const {
  Grid out{kCellColumns, kCellRows, {}};
  for (int row = 0; row < out.rows; ++row)
    for (int column = 0; column < out.columns; ++column) {
      const Eigen::Matrix2d c = covariance({(column + 0.5) * image.x() / out.columns - 0.5,
                                            (row + 0.5) * image.y() / out.rows - 0.5},
                                           distance);
      const double mean = c.trace() / 2, half = (c(0, 0) - c(1, 1)) / 2;
      out.values.push_back(std::sqrt(mean + std::hypot(half, c(0, 1))));
    }
  return out;
}

}  // namespace kincal
