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

struct Sum {
  double squared = 0;  // infinite: a point behind the camera
  long points = 0;
};

void add(const Rig& rig, const ParameterTable& table, const VectorXd& values, const Carried& from,
         const Carried& to, Sum& sum) {
  const View& view = *to.view;
  const SensorModel& model = *rig.sensors[view.sensor].model;
  std::vector<std::pair<Eigen::Index, size_t>> both;  // places of a point in `from` and in `to`
  for (size_t k = 0; k < to.ids.size(); ++k) {
    const auto found = std::find(from.ids.begin(), from.ids.end(), to.ids[k]);
    if (found != from.ids.end()) both.push_back({found - from.ids.begin(), k});
  }
  if (both.empty() || from.points.cols() == 0) return;
  if (model.measures_pose()) {
    const Matrix3Xd points = target_points(rig, table, values, view.target);
    Matrix3Xd a(3, static_cast<Eigen::Index>(both.size())), b = a;
    for (size_t i = 0; i < both.size(); ++i) {
      a.col(static_cast<Eigen::Index>(i)) = points.col(to.ids[both[i].second]);
      b.col(static_cast<Eigen::Index>(i)) = from.points.col(both[i].first);
    }
    if (on_a_line(a)) return;
    const Pose hub_T_measured = to.hub_T_sensor[0] * *pose_from_view(rig, table, values, view);
    sum.squared += (inverse(hub_T_measured) * fit_points(a, b)).translation.squaredNorm();
    ++sum.points;
    return;
  }
  // Point by point, as a target of one point at the origin.
  const Matrix3Xd origin = Matrix3Xd::Zero(3, 1);
  const int id = 0, block = table.sensor_block[view.sensor], numbers = model.numbers();
  for (const auto& pair : both) {
    const Vector3d point = from.points.col(pair.first);
    VectorXd r(model.rows());
    if (model.scans()) {
      r = inverse(to.hub_T_sensor[pair.second]) * point -
          TiltingLaser::measured_point(view.z.data() + 3 * pair.second);
    } else {
      ViewInput in;
      in.sensor_T_target.translation = inverse(to.hub_T_sensor[0]) * point;
      in.parameters = block >= 0 ? values.data() + table.all[block].start : nullptr;
      in.points = &origin;
      in.ids = &id;
      in.count = 1;
      in.z = view.z.data() + numbers * static_cast<int>(pair.second);
      if (!model.evaluate(in, Columns(), r.data(), nullptr))
        r.setConstant(std::numeric_limits<double>::infinity());
    }
    sum.squared += r.squaredNorm();
    ++sum.points;
  }
}

}  // namespace

std::vector<Loop> loops(const Solution& solution) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  const size_t n = rig.sensors.size();
  std::vector<Sum> sums(4 * n * n);  // by from, to, held out, after
  for (const Sample& sample : solution.samples())
    for (const bool after : {false, true}) {
      const VectorXd& values = after ? solution.values.shared : solution.initial;
      std::vector<Carried> carried;
      for (const View& a : sample.views)
        if (std::any_of(sample.views.begin(), sample.views.end(), [&](const View& b) {
              return a.target == b.target && a.sensor != b.sensor;
            }))
          carried.push_back(carry(rig, table, values, sample, a));
      for (const Carried& from : carried)
        for (const Carried& to : carried)
          if (from.view->target == to.view->target && from.view->sensor != to.view->sensor)
            add(rig, table, values, from, to,
                sums[4 * (from.view->sensor * n + to.view->sensor) + 2 * !sample.train + after]);
    }
  std::vector<Loop> out;
  for (size_t from = 0; from < n; ++from)
    for (size_t to = 0; to < n; ++to) {
      const Sum* s = sums.data() + 4 * (from * n + to);
      if (s[1].points + s[3].points == 0) continue;
      Loop loop{
          rig.sensors[from].name, rig.sensors[to].name, rig.sensors[to].model->unit(), {}, {}};
      const auto rms = [](const Sum& sum) {
        const double mean = sum.squared / static_cast<double>(sum.points);
        return std::isfinite(mean) ? std::sqrt(mean) : std::numeric_limits<double>::quiet_NaN();
      };
      loop.train = {s[1].points, rms(s[0]), rms(s[1])};
      loop.test = {s[3].points, rms(s[2]), rms(s[3])};
      out.push_back(loop);
    }
  return out;
}

}  // namespace kincal
