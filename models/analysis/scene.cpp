#include "scene.h"

#include <algorithm>
#include <map>

#include "../rig/configuration.h"
#include "../rig/targets.h"

namespace kincal {
namespace {

constexpr int kMostViews = 60;  // that are looked at for a reason

}  // namespace

Scene::Scene(const Recording& recording, const EstimationSetup& setup, const Values& values)
    : recording_(recording), values_(values), at_(recording, setup, values) {
  int privates = 0;
  for (const GroupShape& shape : at_.problem.groups()) privates += shape.private_size;
  zero_private_step_ = VectorXd::Zero(privates);
  std::vector<std::pair<int, const View*>> all;
  for (int s : recording.training())
    for (const View& view : recording.samples[s].views)
      if (std::count(setup.sensors.begin(), setup.sensors.end(), view.sensor))
        all.push_back({s, &view});
  // Some of each pair of sensor and target, spread over the samples.
  std::map<std::pair<int, int>, int> count, at;
  for (const auto& v : all) ++count[{v.second->sensor, v.second->target}];
  const int each = std::max(4, kMostViews / std::max(1, static_cast<int>(count.size())));
  for (const auto& v : all) {
    const std::pair<int, int> key = {v.second->sensor, v.second->target};
    const int i = at[key]++, n = count[key];
    if (static_cast<long>(i) * each / n == static_cast<long>(i + 1) * each / n && n > each)
      continue;
    add(v.first, v.second);
  }
}

void Scene::add(int sample, const View* view) {
  Seen s{sample, view, {}, {}};
  const Sensor& sensor = rig().sensors[view->sensor];
  const Target& target = rig().targets[view->target];
  s.path = find_path(rig().tree, sensor.link, target.link >= 0 ? target.link : rig().base);
  if (sensor.model->measures_pose()) {
    s.points = {Vector3d::Zero(), 0.1 * Vector3d::UnitX(), 0.1 * Vector3d::UnitY(),
                0.1 * Vector3d::UnitZ()};
  } else {
    const std::vector<int> ids = view_ids(*view, target);
    const size_t stride = std::max<size_t>(1, ids.size() / 6);
    for (size_t i = 0; i < ids.size(); i += stride)
      s.points.push_back(point(solution(), view->target, ids[i]));
  }
  seen_.push_back(std::move(s));
}

Vector3d Scene::point(const VectorXd& values, int target, int id) const {
  const Target& t = rig().targets[target];
  if (t.grid) {
    Vector3d p = values(table().all[table().target_square[target]].start) * t.layout.col(id);
    if (const int print = table().target_print[target]; print >= 0)
      p.head<2>() = print_map(values.segment<2>(table().all[print].start)) * p.head<2>().eval();
    if (table().target_warp[target] >= 0)
      p.z() +=
          values.segment<2>(table().all[table().target_warp[target]].start).dot(t.bulge.col(id));
    return p;
  }
  return values.segment<3>(table().all[table().target_points[target]].start + 3 * id);
}

/// The readings of a sample with the joints' errors, those of a scan in its middle. Joint `moved`
/// stands `by` further.
std::vector<double> Scene::readings(const Seen& s, int moved, double by) const {
  std::vector<double> out = recording_.samples[s.sample].readings;
  const Sensor& sensor = rig().sensors[s.view->sensor];
  if (sensor.scanning_joint >= 0 && !s.view->z.empty()) {
    double sum = 0;
    for (size_t i = 0; i < s.view->z.size(); i += 3) sum += s.view->z[i];
    out[sensor.scanning_joint] = 3 * sum / static_cast<double>(s.view->z.size());
  }
  for (auto error = values_.errors.lower_bound({s.sample, 0});
       error != values_.errors.end() && error->first.first == s.sample; ++error)
    out[error->first.second] += error->second;
  if (moved >= 0) out[moved] += by;
  return out;
}

Pose Scene::along(const Path& path, const VectorXd& values, const Seen& s, int moved,
                  double by) const {
  const std::vector<double> readings = this->readings(s, moved, by);
  const Configuration robot(rig(), table(), values, readings,
                            recording_.samples[s.sample].conditions, time_of(rig(), *s.view));
  Pose begin_T_end;
  for (const PathStep& step : path) {
    const Pose next = robot.origin(step.joint) * robot.motion(step.joint);
    begin_T_end = begin_T_end * (step.direction > 0 ? next : inverse(next));
  }
  return begin_T_end;
}

Pose Scene::sensor_T_target(const VectorXd& values, const Seen& s, int moved, double by) const {
  const bool mounted = rig().targets[s.view->target].link >= 0;
  Pose target = mounted ? get_pose(values, table().all[table().target_pose[s.view->target]].start)
                        : values_.targets.at({s.sample, s.view->target});
  if (moved >= 0 && !mounted)
    for (const View& other : recording_.samples[s.sample].views)
      if (other.target == s.view->target &&
          rig().sensors[other.sensor].model->measurement_kind() == MeasurementKind::chain) {
        const Path path = find_path(rig().tree, rig().base, rig().sensors[other.sensor].link);
        target = along(path, solution(), s, moved, by) *
                 inverse(along(path, solution(), s, -1, 0)) * target;
        break;
      }
  return inverse(get_pose(values, table().all[table().sensor_pose[s.view->sensor]].start)) *
         along(s.path, values, s, moved, by) * target;
}

VectorXd Scene::after(const VectorXd& step) const {
  VectorXd moved;
  at_.problem.retract(at_.state, step, zero_private_step_, moved);
  return moved.head(solution().size());
}

std::vector<ViewMotion> motions(const Scene& scene, const VectorXd& step, int moved, double by) {
  const double h = 1e-5 / std::max(1e-12, step.cwiseAbs().maxCoeff());
  const VectorXd up = scene.after(h * step), down = scene.after(-h * step);
  std::vector<ViewMotion> out;
  for (const Scene::Seen& s : scene.seen()) {
    const Pose high = scene.sensor_T_target(up, s, moved, by),
               low = scene.sensor_T_target(down, s, moved, by);
    ViewMotion m;
    m.twist = log_se3(high * inverse(low)) / (2 * h);
    const bool rays =
        scene.rig().sensors[s.view->sensor].model->measurement_kind() == MeasurementKind::rays;
    for (const Vector3d& p : s.points) {
      Vector3d d = (high * p - low * p) / (2 * h);
      const Vector3d ray = (low * p).normalized();
      if (rays) d -= ray * ray.dot(d);
      m.points.push_back(d);
    }
    out.push_back(std::move(m));
  }
  return out;
}

double squared_points(const std::vector<ViewMotion>& a, const std::vector<ViewMotion>* b) {
  double sum = 0;
  for (size_t v = 0; v < a.size(); ++v)
    for (size_t i = 0; i < a[v].points.size(); ++i)
      sum += (b ? Vector3d(a[v].points[i] + (*b)[v].points[i]) : a[v].points[i]).squaredNorm();
  return sum;
}

double squared_wholes(const Scene& scene, const std::vector<ViewMotion>& a,
                      const std::vector<ViewMotion>* b) {
  double sum = 0;
  for (size_t v = 0; v < a.size(); ++v) {
    const Vector6d twist = b ? Vector6d(a[v].twist + (*b)[v].twist) : a[v].twist;
    const Vector3d origin = scene.sensor_T_target(scene.solution(), scene.seen()[v]).translation;
    sum += (twist.head<3>() + twist.tail<3>().cross(origin)).squaredNorm() +
           0.04 * twist.tail<3>().squaredNorm();
  }
  return sum;
}

}  // namespace kincal
