#include "check_jacobian.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace kincal {
namespace {

constexpr double kDifference = 1e-6;  // step of a number that is not above 1 in size

double step_of(double number) { return kDifference * std::max(1.0, std::abs(number)); }

double error_of(double derivative, double difference) {
  const double error = std::abs(derivative - difference) / std::max(1.0, std::abs(derivative));
  return std::isnan(error) ? std::numeric_limits<double>::infinity() : error;
}

/// A copy of what a view points to, so that one number of it can be moved.
struct MovedView {
  ViewInput view;
  Scan scan;
  std::vector<double> parameters, joint;
  Eigen::Matrix3Xd points;

  MovedView(const ViewInput& at, int parameter_count) : view(at), points(*at.points) {
    parameters.assign(at.parameters, at.parameters + parameter_count);
    if (!at.scan) return;
    scan = *at.scan;
    joint.assign(scan.own, scan.own + scan.model->size());
  }
  const ViewInput& input() {
    if (!parameters.empty()) view.parameters = parameters.data();
    view.points = &points;
    if (view.scan) view.scan = &scan;
    scan.own = joint.data();
    return view;
  }
};

Pose turned(const Pose& pose, int component, double by) {
  Vector6d xi = Vector6d::Zero();
  xi(component) = by;
  return exp_se3(xi) * pose;
}

/// A column of L: how its number is moved, and by how much.
struct Column {
  std::function<void(MovedView&, double)> move;
  double step = kDifference;
};

}  // namespace

double check_jacobian(const SensorModel& sensor, const ViewInput& view, int parameters) {
  std::vector<Column> all;
  Columns at;
  for (int k = 0; k < 6; ++k)
    all.push_back({[k](MovedView& v, double by) {
      Pose& target = v.view.scan ? v.scan.behind_T_target : v.view.sensor_T_target;
      target = turned(target, k, by);
    }});
  if (view.scan) {
    at.sensor_side = 6, at.joint = 12;
    for (int k = 0; k < 6; ++k)
      all.push_back({[k](MovedView& v, double by) {
        v.scan.sensor_T_before = turned(v.scan.sensor_T_before, k, by);
      }});
    for (int k = 0; k < view.scan->model->size(); ++k)
      all.push_back(
          {[k](MovedView& v, double by) { v.joint[k] += by; }, step_of(view.scan->own[k])});
  }
  if (parameters > 0) at.parameters = static_cast<int>(all.size());
  for (int k = 0; k < parameters; ++k)
    all.push_back(
        {[k](MovedView& v, double by) { v.parameters[k] += by; }, step_of(view.parameters[k])});
  if (!sensor.measures_pose()) {
    at.points = static_cast<int>(all.size());
    for (int k = 0; k < 3 * view.points->cols(); ++k)
      all.push_back({[k](MovedView& v, double by) { v.points.data()[k] += by; }});
  }
  at.total = static_cast<int>(all.size());

  const int rows = sensor.blocks(view.count) * sensor.rows();
  VectorXd r(rows), plus(rows), minus(rows);
  RowMatrix jacobian = RowMatrix::Zero(rows, at.total);
  Eigen::Ref<RowMatrix> to = jacobian;
  if (!sensor.evaluate(view, at, r.data(), &to)) return std::numeric_limits<double>::infinity();
  double worst = 0;
  for (int column = 0; column < at.total; ++column) {
    const double step = all[column].step;
    MovedView more(view, parameters), less(view, parameters);
    all[column].move(more, step);
    all[column].move(less, -step);
    if (!sensor.evaluate(more.input(), Columns(), plus.data(), nullptr) ||
        !sensor.evaluate(less.input(), Columns(), minus.data(), nullptr))
      return std::numeric_limits<double>::infinity();
    for (int row = 0; row < rows; ++row)
      worst =
          std::max(worst, error_of(jacobian(row, column), (plus(row) - minus(row)) / (2 * step)));
  }
  return worst;
}

double check_jacobian(const JointModel& model, double reading, const std::vector<double>& own) {
  const double step = step_of(reading);
  double worst = error_of(
      model.by_reading(reading, own.data()),
      (model.position(reading + step, own.data()) - model.position(reading - step, own.data())) /
          (2 * step));
  for (int k = 0; k < model.size(); ++k) {
    std::vector<double> more = own, less = own;
    const double by = step_of(own[k]);
    more[k] += by;
    less[k] -= by;
    worst = std::max(worst, error_of(model.by_own(k, reading, own.data()),
                                     (model.position(reading, more.data()) -
                                      model.position(reading, less.data())) /
                                         (2 * by)));
  }
  return worst;
}

}  // namespace kincal
