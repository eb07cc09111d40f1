#include "loops.h"

#include <algorithm>
#include <cmath>

#include "../fitting/starts.h"
#include "../sensors/tilting_laser.h"

namespace kincal {
namespace {

/// A view at given values: where it sees its target, and from where it looks. In the hub: the frame
/// of the link that carries the target, or the base's for a free one. (A scanning joint may stand
/// on either side of it.)
struct Carried {
  const View* view;
  std::vector<int> ids;  // points of the target that it has, and those in the hub; none: it does
                         // not determine them
  Matrix3Xd points;
  std::vector<Pose> hub_T_sensor;  // one; of a scan one a ray
};

Carried carry(const Rig& rig, const ParameterTable& table, const VectorXd& values,
              const Sample& sample, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const MeasurementKind kind = sensor.model->measurement_kind();
  const Pose link_T_sensor = get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
  const int hub = rig.targets[view.target].link >= 0 ? rig.targets[view.target].link : rig.base;
  const std::vector<double> readings = completed(sample.readings);  // what is absent cancels
  const auto hub_T_sensor = [&](int joint, double reading) {
    const Configuration robot = Configuration(rig, table, values, readings).with(joint, reading);
    return inverse(robot.base_T_link(hub)) * robot.base_T_link(sensor.link) * link_T_sensor;
  };
  Carried out{&view, view_ids(view, rig.targets[view.target]), {}, {}};
  const Eigen::Index n = static_cast<Eigen::Index>(out.ids.size());
  out.points.resize(3, n);
  if (kind == MeasurementKind::scan) {
    for (Eigen::Index i = 0; i < n; ++i) {
      const double* z = view.z.data() + 3 * i;
      out.hub_T_sensor.push_back(hub_T_sensor(sensor.scanning_joint, z[0]));
      out.points.col(i) = out.hub_T_sensor.back() * TiltingLaser::measured_point(z);
    }
    return out;
  }
  out.hub_T_sensor = {hub_T_sensor(-1, 0)};
  if (kind == MeasurementKind::points) {
    for (Eigen::Index i = 0; i < n; ++i)
      out.points.col(i) =
          out.hub_T_sensor[0] * Vector3d(Eigen::Map<const Vector3d>(view.z.data() + 3 * i));
    return out;
  }
  if (const std::optional<Pose> sensor_T_target = pose_from_view(rig, table, values, view)) {
    const Pose hub_T_target = out.hub_T_sensor[0] * *sensor_T_target;
    const Matrix3Xd points = target_points(rig, table, values, view.target);
    for (Eigen::Index i = 0; i < n; ++i)
      out.points.col(i) = hub_T_target * Vector3d(points.col(out.ids[static_cast<size_t>(i)]));
  } else {
    out.points.resize(3, 0);
  }
  return out;
}

/// The points that both views have, by their places in `from` and in `to`.
std::vector<std::pair<Eigen::Index, size_t>> common_points(const Carried& from, const Carried& to) {
  std::vector<std::pair<Eigen::Index, size_t>> both;
  for (size_t k = 0; k < to.ids.size(); ++k) {
    const auto found = std::find(from.ids.begin(), from.ids.end(), to.ids[k]);
    if (found != from.ids.end()) both.push_back({found - from.ids.begin(), k});
  }
  return both;
}

/// The translation of E, of the points that both have; none where they are on a line.
MatrixXd pose_residual(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                       const Carried& from, const Carried& to) {
  const auto both = common_points(from, to);
  const Matrix3Xd points = target_points(rig, table, values, to.view->target);
  Matrix3Xd a(3, static_cast<Eigen::Index>(both.size())), b = a;
  for (size_t i = 0; i < both.size(); ++i) {
    a.col(static_cast<Eigen::Index>(i)) = points.col(to.ids[both[i].second]);
    b.col(static_cast<Eigen::Index>(i)) = from.points.col(both[i].first);
  }
  if (on_a_line(a)) return {};
  const Pose hub_T_measured = to.hub_T_sensor[0] * *pose_from_view(rig, table, values, *to.view);
  return (inverse(hub_T_measured) * fit_points(a, b)).translation;
}

/// The residuals of `from` in `to`, a column a common point; none where nothing is carried.
MatrixXd loop_residuals(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                        const Carried& from, const Carried& to) {
  const View& view = *to.view;
  const SensorModel& model = *rig.sensors[view.sensor].model;
  if (from.points.cols() == 0) return {};
  if (model.measures_pose()) return pose_residual(rig, table, values, from, to);
  // Point by point, as a target of one point at the origin.
  const Matrix3Xd origin = Matrix3Xd::Zero(3, 1);
  const int id = 0, block = table.sensor_block[view.sensor], numbers = model.measurement_size();
  const auto both = common_points(from, to);
  MatrixXd out(model.rows(), static_cast<Eigen::Index>(both.size()));
  for (size_t i = 0; i < both.size(); ++i) {
    const Vector3d point = from.points.col(both[i].first);
    const size_t k = both[i].second;
    auto r = out.col(static_cast<Eigen::Index>(i));
    if (model.scans()) {
      r = inverse(to.hub_T_sensor[k]) * point - TiltingLaser::measured_point(view.z.data() + 3 * k);
      continue;
    }
    ViewInput in;
    in.sensor_T_target.translation = inverse(to.hub_T_sensor[0]) * point;
    in.parameters = block >= 0 ? values.data() + table.all[block].start : nullptr;
    in.points = &origin;
    in.ids = &id;
    in.count = 1;
    in.z = view.z.data() + static_cast<size_t>(numbers) * k;
    if (!model.evaluate(in, Columns(), r.data(), nullptr))
      r.setConstant(std::numeric_limits<double>::infinity());
  }
  return out;
}

/// The views of a sample that another sensor's meet, carried.
std::vector<Carried> carried_views(const Rig& rig, const ParameterTable& table,
                                   const VectorXd& values, const Sample& sample) {
  std::vector<Carried> out;
  for (const View& a : sample.views)
    if (std::any_of(sample.views.begin(), sample.views.end(),
                    [&](const View& b) { return a.target == b.target && a.sensor != b.sensor; }))
      out.push_back(carry(rig, table, values, sample, a));
  return out;
}

struct Sum {
  double squared = 0;  // infinite: a point behind the camera
  long points = 0;

  void add(const MatrixXd& residuals) {
    for (Eigen::Index i = 0; i < residuals.cols(); ++i) {
      const double r = residuals.col(i).squaredNorm();
      if (std::isnan(r)) continue;
      squared += r;
      ++points;
    }
  }
  double rms() const {
    const double mean = squared / static_cast<double>(points);
    return std::isfinite(mean) ? std::sqrt(mean) : std::numeric_limits<double>::quiet_NaN();
  }
};

}  // namespace

std::vector<LoopView> loop_views(const Solution& solution) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  const VectorXd &initial = solution.initial, &estimated = solution.values.shared;
  std::vector<LoopView> out;
  for (size_t s = 0; s < solution.samples().size(); ++s) {
    const Sample& sample = solution.samples()[s];
    const std::vector<Carried> before = carried_views(rig, table, initial, sample),
                               after = carried_views(rig, table, estimated, sample);
    for (size_t i = 0; i < after.size(); ++i)
      for (size_t j = 0; j < after.size(); ++j) {
        const View &from = *after[i].view, &to = *after[j].view;
        if (from.target != to.target || from.sensor == to.sensor) continue;
        LoopView one{static_cast<int>(s),
                     &from,
                     &to,
                     {},
                     loop_residuals(rig, table, initial, before[i], before[j]),
                     loop_residuals(rig, table, estimated, after[i], after[j])};
        if (one.before.cols() + one.after.cols() == 0) continue;
        const auto none = [](const MatrixXd& other) {
          return MatrixXd::Constant(other.rows(), other.cols(),
                                    std::numeric_limits<double>::quiet_NaN());
        };
        if (one.before.cols() == 0) one.before = none(one.after);
        if (one.after.cols() == 0) one.after = none(one.before);
        if (!rig.sensors[to.sensor].model->measures_pose())
          for (const auto& both : common_points(after[i], after[j]))
            one.ids.push_back(after[j].ids[both.second]);
        out.push_back(std::move(one));
      }
  }
  return out;
}

std::vector<Loop> loops(const Solution& solution, const std::vector<LoopView>& views) {
  const Rig& rig = solution.rig();
  const size_t n = rig.sensors.size();
  struct Sums {
    Sum before, after;
  };
  std::vector<Sums> sums(2 * n * n);  // by from, to, held out
  for (const LoopView& v : views) {
    Sums& sum = sums[2 * (v.from->sensor * n + v.to->sensor) + !solution.samples()[v.sample].train];
    sum.before.add(v.before);
    sum.after.add(v.after);
  }
  std::vector<Loop> out;
  for (size_t from = 0; from < n; ++from)
    for (size_t to = 0; to < n; ++to) {
      const Sums *train = sums.data() + 2 * (from * n + to), *test = train + 1;
      if (train->after.points + test->after.points == 0) continue;
      out.push_back({rig.sensors[from].name,
                     rig.sensors[to].name,
                     rig.sensors[to].model->unit(),
                     {train->after.points, train->before.rms(), train->after.rms()},
                     {test->after.points, test->before.rms(), test->after.rms()}});
    }
  return out;
}

}  // namespace kincal
