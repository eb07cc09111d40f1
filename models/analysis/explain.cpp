#include "explain.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <set>

#include "../../solver/decompositions.h"
#include "../../solver/observability.h"
#include "../calibration/calibration.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "../rig/configuration.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

constexpr double kCancel = 0.03;  // what is left of the parts, relative: they cancel
constexpr double kListed = 0.02;  // part of a direction, in yardsticks
constexpr double kStrong = 0.99;  // correlation
constexpr double kPriorShare = 0.9;
constexpr int kMostViews = 60;  // that are looked at for a reason

/// The last step's problem without its priors, at the solution, and its geometry written plainly.
struct Scene {
  const Calibration& calibration;
  const CalibrationResult& result;
  const Rig& rig;
  const ParameterTable& table;
  Estimation problem;
  VectorXd state, still;  // still: a private step of nothing

  struct Seen {  // a view
    int sample;
    const View* view;
    Path path;                     // from the sensor's link to the target's
    std::vector<Vector3d> points;  // of the target, a few; of whole poses: a tripod
  };
  std::vector<Seen> seen;

  static EstimationSetup without_priors(EstimationSetup setup) {
    setup.priors.clear();
    return setup;
  }

  Scene(const Calibration& c, const CalibrationResult& r)
      : calibration(c),
        result(r),
        rig(c.rig()),
        table(c.table()),
        problem(c.recording(), c.training(), without_priors(r.setup)) {
    state = problem.pack(r.values);
    problem.renew(state);
    int privates = 0;
    for (const GroupShape& shape : problem.groups()) privates += shape.private_size;
    still = VectorXd::Zero(privates);
    std::vector<std::pair<int, const View*>> all;
    for (int s : c.training())
      for (const View& view : c.samples()[s].views)
        if (std::count(r.setup.sensors.begin(), r.setup.sensors.end(), view.sensor)) all.push_back({s, &view});
    // Some of each pair of sensor and target, spread over the samples.
    std::map<std::pair<int, int>, int> count, at;
    for (const auto& v : all) ++count[{v.second->sensor, v.second->target}];
    const int each = std::max(4, kMostViews / std::max(1, static_cast<int>(count.size())));
    for (const auto& v : all) {
      const std::pair<int, int> key = {v.second->sensor, v.second->target};
      const int i = at[key]++, n = count[key];
      if (static_cast<long>(i) * each / n == static_cast<long>(i + 1) * each / n && n > each) continue;
      add(v.first, v.second);
    }
  }

  void add(int sample, const View* view) {
    Seen s{sample, view, {}, {}};
    const Sensor& sensor = rig.sensors[view->sensor];
    const Target& target = rig.targets[view->target];
    s.path = find_path(rig.tree, sensor.link, target.link >= 0 ? target.link : rig.base);
    if (sensor.model->whole_pose()) {
      s.points = {Vector3d::Zero(), 0.1 * Vector3d::UnitX(), 0.1 * Vector3d::UnitY(), 0.1 * Vector3d::UnitZ()};
    } else {
      std::vector<int> ids = view->ids;
      if (ids.empty())
        for (int i = 0; i < target.count(); ++i) ids.push_back(i);
      const size_t stride = std::max<size_t>(1, ids.size() / 6);
      for (size_t i = 0; i < ids.size(); i += stride) s.points.push_back(point(result.values.shared, view->target, ids[i]));
    }
    seen.push_back(std::move(s));
  }

  Vector3d point(const VectorXd& values, int target, int id) const {
    const Target& t = rig.targets[target];
    if (t.grid) return values(table.all[table.target_square[target]].start) * t.layout.col(id);
    return values.segment<3>(table.all[table.target_points[target]].start + 3 * id);
  }

  /// Joint `moved` stands `by` further than it does in the sample.
  double position(const VectorXd& values, const Seen& s, int joint, int moved, double by) const {
    const Sample& sample = calibration.samples()[s.sample];
    const int own = driver(rig.tree, joint).joint;
    double reading = sample.readings[own];
    const Sensor& sensor = rig.sensors[s.view->sensor];
    if (sensor.scanning_joint == own && !s.view->z.empty()) {  // in the middle of the scan
      reading = 0;
      for (size_t i = 0; i < s.view->z.size(); i += 3) reading += s.view->z[i] * 3 / static_cast<double>(s.view->z.size());
    }
    const auto error = result.values.errors.find({s.sample, own});
    if (error != result.values.errors.end()) reading += error->second;
    if (own == moved) reading += by;
    return Configuration(rig, table, values, sample.readings).with(own, reading).position(joint);
  }

  Pose along(const Path& path, const VectorXd& values, const Seen& s, int moved, double by) const {
    Pose here;
    for (const PathStep& step : path) {
      const Joint& joint = rig.tree.joints[step.joint];
      Pose next = get_pose(values, table.all[table.joint_origin[step.joint]].start);
      if (joint.moves()) next = next * joint_motion(joint, position(values, s, step.joint, moved, by));
      here = here * (step.direction > 0 ? next : inverse(next));
    }
    return here;
  }

  /// sensor_T_target. A free target that a chain holds goes with the hand when a joint is moved (at the result's values).
  Pose sensor_T_target(const VectorXd& values, const Seen& s, int moved = -1, double by = 0) const {
    Pose target = rig.targets[s.view->target].link >= 0 ? get_pose(values, table.all[table.target_pose[s.view->target]].start)
                                                        : result.values.targets.at({s.sample, s.view->target});
    if (moved >= 0 && rig.targets[s.view->target].link < 0)
      for (const View& other : calibration.samples()[s.sample].views)
        if (other.target == s.view->target && rig.sensors[other.sensor].model->sight() == Sight::chain) {
          const Path path = find_path(rig.tree, rig.base, rig.sensors[other.sensor].link);
          const VectorXd& here = result.values.shared;
          target = along(path, here, s, moved, by) * inverse(along(path, here, s, -1, 0)) * target;
          break;
        }
    return inverse(get_pose(values, table.all[table.sensor_pose[s.view->sensor]].start)) * along(s.path, values, s, moved, by) * target;
  }

  /// Values after a step of the shared unknowns.
  VectorXd after(const VectorXd& step) const {
    VectorXd moved;
    problem.retract(state, step, still, moved);
    return moved.head(result.values.shared.size());
  }
};

/// What a step of the unknowns does to one view.
struct Motion {
  Vector6d twist;                // of the target as seen from the sensor
  std::vector<Vector3d> points;  // of its points, as far as the sensor sees it (a camera: across the line of sight)
};

/// Per unit of `step`, by central differences.
std::vector<Motion> motions(const Scene& scene, const VectorXd& step, int moved = -1, double by = 0) {
  const double h = 1e-5 / std::max(1e-12, step.cwiseAbs().maxCoeff());
  const VectorXd up = scene.after(h * step), down = scene.after(-h * step);
  std::vector<Motion> out;
  for (const Scene::Seen& s : scene.seen) {
    const Pose high = scene.sensor_T_target(up, s, moved, by), low = scene.sensor_T_target(down, s, moved, by);
    Motion m;
    m.twist = log_se3(high * inverse(low)) / (2 * h);
    const bool rays = scene.rig.sensors[s.view->sensor].model->sight() == Sight::rays;
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

/// Squared lengths over all views: of the seen points (first) and of the whole motion, felt at 0.2 m around the target (second).
std::pair<double, double> size_of(const Scene& scene, const std::vector<Motion>& a, const std::vector<Motion>* b = nullptr) {
  std::pair<double, double> sum = {0, 0};
  for (size_t v = 0; v < a.size(); ++v) {
    for (size_t i = 0; i < a[v].points.size(); ++i)
      sum.first += (b ? Vector3d(a[v].points[i] + (*b)[v].points[i]) : a[v].points[i]).squaredNorm();
    const Vector6d twist = b ? Vector6d(a[v].twist + (*b)[v].twist) : a[v].twist;
    const Vector3d origin = scene.sensor_T_target(scene.result.values.shared, scene.seen[v]).translation;
    sum.second += (twist.head<3>() + twist.tail<3>().cross(origin)).squaredNorm() + 0.04 * twist.tail<3>().squaredNorm();
  }
  return sum;
}

/// Effects of a direction on the whitened residuals.
struct Effects {
  double together = 0, left = 0;  // squared: of all parts at once; what poses of free targets cannot take up
  std::map<int, double> part;     // squared, by column
  std::vector<char> sensors;      // that notice a part
  double parts() const {
    double sum = 0;
    for (const auto& p : part) sum += p.second;
    return sum;
  }
};

std::vector<Effects> effects_of(Scene& scene, const std::vector<VectorXd>& directions) {
  std::vector<Effects> out(directions.size());
  for (Effects& e : out) e.sensors.assign(scene.rig.sensors.size(), 0);
  MatrixXd rows;
  std::vector<NoiseRows> whose;
  scene.problem.prepare(scene.state);
  for (size_t g = 0; g < scene.problem.groups().size(); ++g) {
    const GroupShape& shape = scene.problem.groups()[g];
    scene.problem.noise_rows(static_cast<int>(g), scene.state, rows, whose);
    const int k = shape.private_size;
    const int poses = k - static_cast<int>(std::count_if(whose.begin(), whose.end(), [](const NoiseRows& w) { return w.joint >= 0; }));
    std::optional<Elimination> own;
    if (poses > 0) own.emplace(rows.leftCols(poses));
    for (size_t d = 0; d < directions.size(); ++d) {
      VectorXd all = VectorXd::Zero(rows.rows());
      for (size_t i = 0; i < shape.columns.size(); ++i) {
        const double c = directions[d](shape.columns[i]);
        if (c == 0) continue;
        const VectorXd column = c * rows.col(k + static_cast<Eigen::Index>(i));
        out[d].part[shape.columns[i]] += column.squaredNorm();
        for (const NoiseRows& w : whose)
          if (w.view && !column.segment(w.first, w.count).isZero(0)) out[d].sensors[w.view->sensor] = 1;
        all += column;
      }
      out[d].together += all.squaredNorm();
      if (own) {
        own->rotate(all);
        out[d].left += all.tail(all.size() - own->rank()).squaredNorm();
      } else {
        out[d].left += all.squaredNorm();
      }
    }
  }
  return out;
}

/// How far the readings of a joint reach over the training samples.
std::pair<double, double> range_of(const Scene& scene, int joint) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (int s : scene.calibration.training()) {
    const double reading = scene.calibration.samples()[s].readings[joint];
    if (!std::isfinite(reading)) continue;
    low = std::min(low, reading);
    high = std::max(high, reading);
  }
  return {low, high};
}

bool slides(const Scene& scene, int joint) { return scene.rig.tree.joints[joint].type == JointType::prismatic; }

std::string spread_text(const Scene& scene, int joint) {
  const auto range = range_of(scene, joint);
  const double span = range.second - range.first;
  const std::string name = scene.rig.tree.joints[joint].name;
  if (!(span > 1e-3)) return name + text(" never moved: its reading is %.4g in all samples", range.first);
  return name + " moved within " + (slides(scene, joint) ? length_text(span) : angle_text(span)) + " only";
}

/// Joints whose motion would break a cancellation of `a` with `b` as the seen points show it, the best first.
std::vector<int> breaking_joints(const Scene& scene, const VectorXd& a, const VectorXd& b, double now) {
  std::set<int> joints;
  for (const Scene::Seen& s : scene.seen)
    for (const PathStep& step : s.path)
      if (scene.rig.tree.joints[step.joint].moves()) {
        const int j = driver(scene.rig.tree, step.joint).joint;
        if (j != scene.rig.sensors[s.view->sensor].scanning_joint) joints.insert(j);
      }
  std::vector<std::pair<double, int>> found;
  for (int j : joints) {
    double worst = 0;
    for (double sign : {-1.0, 1.0}) {
      const double by = sign * (slides(scene, j) ? 0.1 : 0.4);
      const std::vector<Motion> first = motions(scene, a, j, by), second = motions(scene, b, j, by);
      const double parts = size_of(scene, first).first + size_of(scene, second).first;
      if (parts > 0) worst = std::max(worst, std::sqrt(size_of(scene, first, &second).first / parts));
    }
    if (worst > std::max(2 * kCancel, 5 * now)) found.push_back({-worst, j});
  }
  std::sort(found.begin(), found.end());
  std::vector<int> out;
  for (const auto& f : found)
    if (f.first < 0.3 * found[0].first) out.push_back(f.second);
  return out;
}

enum class Kind { turn, shift, screw };

/// Whether motions are turns about an axis or shifts; felt at the target.
Kind kind_of(const Scene& scene, const std::vector<Motion>& motion) {
  double turning = 0, shifting = 0, along = 0;
  for (size_t v = 0; v < motion.size(); ++v) {
    const Vector3d w = motion[v].twist.tail<3>();
    const Vector3d origin = scene.sensor_T_target(scene.result.values.shared, scene.seen[v]).translation;
    const Vector3d shift = motion[v].twist.head<3>() + w.cross(origin);
    turning += 0.04 * w.squaredNorm();
    shifting += shift.squaredNorm();
    if (w.norm() > 0) along += std::pow(shift.dot(w.normalized()), 2);
  }
  if (turning < kCancel * kCancel * shifting) return Kind::shift;
  return along < kCancel * (turning + shifting) ? Kind::turn : Kind::screw;
}

/// Largest distance of what is seen from the axis of a joint, and the smallest one from its origin.
std::pair<double, double> distance_from_axis(const Scene& scene, int joint) {
  double off = 0, far = std::numeric_limits<double>::infinity();
  const VectorXd& values = scene.result.values.shared;
  for (const Scene::Seen& s : scene.seen) {
    Path before;
    bool on_way = false;
    for (const PathStep& step : s.path) {
      before.push_back(step);
      if (step.joint == joint) {
        on_way = true;
        break;
      }
    }
    if (!on_way) continue;
    Pose link_T_joint = scene.along(before, values, s, -1, 0);  // behind the joint (down), or in front of its origin (up)
    if (before.back().direction < 0) link_T_joint = link_T_joint * get_pose(values, scene.table.all[scene.table.joint_origin[joint]].start);
    const Pose link_T_target =
        get_pose(values, scene.table.all[scene.table.sensor_pose[s.view->sensor]].start) * scene.sensor_T_target(values, s);
    for (const Vector3d& p : s.points) {
      const Vector3d q = inverse(link_T_joint) * (link_T_target * p);
      const Vector3d& axis = scene.rig.tree.joints[joint].axis;
      off = std::max(off, (q - axis * axis.dot(q)).norm());
      far = std::min(far, q.norm());
    }
  }
  return {off, far};
}

/// Angle by which targets turn before a sensor: the largest, and the largest about a second axis.
std::pair<double, double> orientations(const Scene& scene, const std::vector<char>& sensors) {
  std::pair<double, double> out = {0, 0};
  for (size_t s = 0; s < sensors.size(); ++s) {
    if (!sensors[s]) continue;
    std::vector<Vector3d> turns;
    std::optional<Pose> first;
    for (const Scene::Seen& v : scene.seen) {
      if (v.view->sensor != static_cast<int>(s)) continue;
      const Pose pose = scene.sensor_T_target(scene.result.values.shared, v);
      if (!first) first = pose;
      turns.push_back(log_so3(Matrix3d(pose.rotation * first->rotation.transpose())));
    }
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    double largest = 0;
    for (const Vector3d& t : turns) {
      spread += t * t.transpose();
      largest = std::max(largest, t.norm());
    }
    Vector3d axis = Vector3d::UnitX();
    for (int i = 0; i < 50; ++i)
      if ((spread * axis).norm() > 0) axis = (spread * (axis + Vector3d(1e-9, 2e-9, 3e-9))).normalized();
    double second = 0;
    for (const Vector3d& t : turns) second = std::max(second, (t - axis * axis.dot(t)).norm());
    out.first = std::max(out.first, largest);
    out.second = std::max(out.second, second);
  }
  return out;
}

/// Finds the reason of one direction.
class Reason {
 public:
  Reason(Scene& scene, const VectorXd& direction, const Effects& effects, WeakDirection& to)
      : scene_(scene), d_(direction), effects_(effects), to_(to) {}

  void find() {
    const double parts = effects_.parts();
    if (!(parts > 0)) return nothing();
    const double together = std::sqrt(effects_.together / parts), left = std::sqrt(effects_.left / parts);
    if (together < kCancel) return cancelling(together);
    if (left < kCancel) return lens() ? trade_off() : free_targets();
    to_.reason = "unknown";
    to_.why = "no single reason was found: " + names() + " change what is measured, but in the postures at hand nearly alike";
    to_.cure = "more and more varied postures, or hold " + first() + " or give it a prior";
  }

 private:
  std::string first() const { return to_.parameters[0].first; }

  /// Components, those of one parameter together: "joint/a/origin (x, ry)".
  std::vector<std::string> grouped(bool with_first) const {
    const ParameterTable& table = scene_.table;
    const std::vector<Component>& columns = scene_.problem.columns();
    std::vector<std::pair<int, std::string>> out;
    for (const auto& named : to_.parameters) {
      for (size_t c = 0; c < columns.size(); ++c) {
        if (scene_.problem.column_name(static_cast<int>(c)) != named.first) continue;
        const Parameter& p = table.all[columns[c].parameter];
        const std::string component = p.components[columns[c].index];
        const auto it = std::find_if(out.begin(), out.end(), [&](const auto& o) { return o.first == columns[c].parameter; });
        if (it == out.end())
          out.push_back({columns[c].parameter, component});
        else
          it->second += ", " + component;
      }
    }
    std::vector<std::string> names;
    for (size_t i = with_first ? 0 : 1; i < out.size(); ++i)
      names.push_back(table.all[out[i].first].name + (out[i].second.empty() ? "" : " (" + out[i].second + ")"));
    return names;
  }
  std::string names() const { return listed(grouped(true)); }

  int parameter_of(size_t column) const { return scene_.problem.columns()[column].parameter; }

  /// The direction's part of the first parameter, or the rest.
  VectorXd part(bool of_first) const {
    const int p = first_parameter();
    VectorXd out = d_;
    for (Eigen::Index c = 0; c < out.size(); ++c)
      if ((parameter_of(static_cast<size_t>(c)) == p) != of_first) out(c) = 0;
    return out;
  }
  int first_parameter() const {
    for (size_t c = 0; c < scene_.problem.columns().size(); ++c)
      if (scene_.problem.column_name(static_cast<int>(c)) == first()) return parameter_of(c);
    return -1;
  }

  void nothing() {
    const std::vector<Motion> motion = motions(scene_, d_);
    if (size_of(scene_, motion).second > 0 && kind_of(scene_, motion) == Kind::turn) {
      to_.reason = "on_axis";
      to_.why = "all that is seen lies on the axis about which " + names() + " turns: one point, or points on a line";
      to_.cure = "hold " + first() + ", or add points beside this axis (three that are not on a line)";
      return;
    }
    to_.reason = "nothing_depends";
    to_.why = "nothing that is measured depends on " + names();
    const auto joint = std::find(scene_.table.joint_scale.begin(), scene_.table.joint_scale.end(), first_parameter());
    if (joint != scene_.table.joint_scale.end()) {
      const int j = static_cast<int>(joint - scene_.table.joint_scale.begin());
      const auto range = range_of(scene_, j);
      if (std::max(std::abs(range.first), std::abs(range.second)) < 1e-9) {
        to_.why += " (" + scene_.rig.tree.joints[j].name + " reads 0 in all samples)";
        to_.joints = {scene_.rig.tree.joints[j].name};
        to_.cure = "record postures that move " + scene_.rig.tree.joints[j].name + ", or hold " + first();
        return;
      }
    }
    to_.cure = "hold " + first() + " (leave it out of `free`), or add a sensor or target that it moves";
  }

  /// The parts cancel in the residuals, without anything private going along.
  void cancelling(double now) {
    const bool one = grouped(true).size() < 2;
    VectorXd a = part(true), b = part(false);
    if (one) {  // components of one parameter among themselves
      a.setZero();
      for (size_t c = 0; c < scene_.problem.columns().size(); ++c)
        if (scene_.problem.column_name(static_cast<int>(c)) == first()) a(static_cast<Eigen::Index>(c)) = d_(static_cast<Eigen::Index>(c));
      b = d_ - a;
    }
    const std::vector<Motion> left = motions(scene_, a), right = motions(scene_, b);
    const auto l = size_of(scene_, left), r = size_of(scene_, right), sum = size_of(scene_, left, &right);
    const double whole = std::sqrt(sum.second / std::max(1e-300, l.second + r.second));
    const double points = std::sqrt(sum.first / std::max(1e-300, l.first + r.first));
    if (points > 3 * kCancel) return trade_off();
    const std::string sides = names();
    const std::vector<int> joints = breaking_joints(scene_, a, b, std::max(points, now));
    if (whole < 3 * kCancel) {
      const Kind kind = kind_of(scene_, left);
      const bool many = grouped(true).size() > 3;
      to_.reason = kind == Kind::shift ? "same_shift" : "same_axis";
      if (many) {
        to_.why = "gauge: moving " + grouped(true)[0] + " is the same as moving " + listed(grouped(false)) + " together the other way";
      } else {
        to_.why = sides + (kind == Kind::shift  ? " shift what is seen along the same direction"
                           : kind == Kind::turn ? " turn what is seen about the same axis"
                                                : " move what is seen in the same way");
      }
    } else {
      to_.reason = "same_points";
      to_.why = sides + " are different motions, but move all that is seen in the same way";
      if (on_axis()) return;
    }
    finish(joints);
  }

  /// What is seen lies on the axis of the joint whose origin is freed: shifting the axis sideways and tilting it are one.
  bool on_axis() {
    for (size_t j = 0; j < scene_.rig.joints.size(); ++j) {
      if (scene_.table.joint_origin[j] != first_parameter() || !scene_.rig.tree.joints[j].moves()) continue;
      const auto distance = distance_from_axis(scene_, static_cast<int>(j));
      if (!(distance.first < 0.03 * distance.second)) return false;
      const std::string name = scene_.rig.tree.joints[j].name;
      to_.reason = "on_axis";
      to_.why = "all that is seen lies on the axis of " + name + " (within " + length_text(distance.first) + ", " + length_text(distance.second) +
                " from its origin): shifting the axis sideways and tilting it (" + names() + ") move it alike";
      to_.cure = "no posture helps: hold " + first() + " or give it a prior, or mount what is seen beside this axis";
      return true;
    }
    return false;
  }

  bool lens() const {
    return std::any_of(to_.parameters.begin(), to_.parameters.end(), [](const auto& p) {
      return p.first.find("/intrinsics") != std::string::npos || p.first.find("/distortion") != std::string::npos;
    });
  }

  /// Different motions and the sensors' own numbers or sizes cancel in what is measured.
  void trade_off() {
    to_.reason = "size";
    bool angles = true;
    for (size_t s = 0; s < effects_.sensors.size(); ++s)
      if (effects_.sensors[s] && scene_.rig.sensors[s].model->sight() != Sight::rays) angles = false;
    const auto turned = orientations(scene_, effects_.sensors);
    if (lens() && turned.second < 10 * M_PI / 180) {
      to_.reason = "one_orientation";
      to_.why = names() + (grouped(true).size() > 1 ? " trade off" : " can hardly be told") +
                ": the lens against where things are; targets turn by no more than " + angle_text(turned.second) +
                (turned.first < 10 * M_PI / 180 ? " before the camera (one orientation)" : " about a second axis before the camera");
      to_.cure = "record views with the target tilted by 20 to 40 degrees about different axes, or hold " + first();
    } else if (lens()) {
      to_.reason = "lens";
      to_.why = names() + (grouped(true).size() > 1 ? " trade off" : " can hardly be told") + ": the lens against where things are";
      to_.cure = "views over the whole image and at different distances, or hold " + first();
    } else if (angles) {
      to_.why =
          names() + " trade off: cameras measure angles, and nothing that is held is a length: all sizes and distances can grow together";
      to_.cure = "hold a length (" + first() + " or the size of a target or a baseline), or add a sensor that measures lengths";
    } else {
      to_.reason = "unknown";
      to_.why = "no reason was found: " + names() + " trade off in all samples, but move things differently";
      to_.cure = "hold " + first() + " or give it a prior";
    }
  }

  void free_targets() {
    std::set<std::string> targets;
    for (const Scene::Seen& s : scene_.seen)
      if (scene_.rig.targets[s.view->target].link < 0) targets.insert(scene_.rig.targets[s.view->target].name);
    const std::string free = listed({targets.begin(), targets.end()});
    to_.reason = "free_targets";
    const bool one = to_.parameters.size() == 1;
    const bool nearly = std::isfinite(to_.sigma);
    to_.why = (nearly ? "nearly a gauge: " : "gauge: ") + names() + (one ? " moves" : " move together") + " what sees or holds the free " +
              (targets.size() == 1 ? "target " : "targets ") + free + (targets.size() == 1 ? ", which goes" : ", which go") +
              " along: " + (nearly ? "hardly anything" : "nothing") + " that is held ties this to the base";
    to_.cure = "hold " + first() + ", or add a sensor that is held or a mounted target to the same samples";
  }

  void finish(const std::vector<int>& joints) {
    if (joints.empty()) {
      to_.why += ", whatever the posture";
      to_.cure = "no posture tells them apart: hold " + first() + (to_.parameters.size() > 1 ? " (or another of them)" : "") +
                 ", or give it a prior";
      return;
    }
    std::vector<std::string> why, names;
    std::vector<int> still;
    for (int j : joints) {
      const auto range = range_of(scene_, j);
      if (!(range.second - range.first > 1e-3)) still.push_back(j);
    }
    const std::vector<int>& said = still.empty() ? joints : still;
    for (int j : said) {
      why.push_back(spread_text(scene_, j));
      names.push_back(scene_.rig.tree.joints[j].name);
    }
    to_.joints = names;
    to_.why += " in all samples: " + listed(why, 2);
    to_.cure = "record postures that move " + listed(names) + (still.empty() ? " further" : "") + ", or hold " + first();
  }

  Scene& scene_;
  const VectorXd& d_;
  const Effects& effects_;
  WeakDirection& to_;
};

}  // namespace

Explanation explain(const Calibration& calibration, const CalibrationResult& result) {
  Explanation out;
  const ParameterTable& table = calibration.table();
  const std::vector<Component> columns = components_of(result.setup.free);
  std::vector<std::string> names;
  for (const Component& c : columns) names.push_back(table.name(c));
  const int n = static_cast<int>(columns.size());
  if (n == 0) return out;

  VectorXd prior = VectorXd::Zero(n), yardstick(n), sigma(n);
  for (int i = 0; i < n; ++i) {
    for (const Prior& p : result.setup.priors)
      if (p.parameter == columns[i].parameter && p.component == columns[i].index) prior(i) = p.sigma;
    const std::string& unit = table.unit(columns[i]);
    yardstick(i) = kincal::yardstick(table, columns[i], result.values.shared);
    if (prior(i) > 0) yardstick(i) = std::min(yardstick(i), prior(i));
    sigma(i) = std::sqrt(std::max(0.0, result.covariance(i, i)));
    if (prior(i) > 0 && sigma(i) > kPriorShare * prior(i)) out.prior_decides.push_back({names[i], unit, prior(i), sigma(i)});
  }
  std::vector<char> lost(n, 0);  // takes part in a null direction
  std::vector<VectorXd> directions;
  const auto index = [&](const std::string& name) { return static_cast<int>(std::find(names.begin(), names.end(), name) - names.begin()); };
  const auto largest = [&](const VectorXd& d) {
    Eigen::Index i;
    d.cwiseQuotient(yardstick).cwiseAbs().maxCoeff(&i);
    return static_cast<int>(i);
  };
  const auto add = [&](VectorXd d, int first, double its_sigma, double with_priors) {
    WeakDirection weak;
    weak.sigma = its_sigma;
    weak.sigma_with_priors = with_priors;
    d /= d(first);
    weak.unit = table.unit(columns[first]);
    std::vector<std::pair<double, int>> order;
    for (int i = 0; i < n; ++i) {
      const double size = std::abs(d(i)) / yardstick(i) * yardstick(first);
      if (size > kListed) order.push_back({i == first ? -1e300 : -size, i});
    }
    std::stable_sort(order.begin(), order.end());
    for (const auto& o : order) weak.parameters.push_back({names[o.second], d(o.second)});
    out.weak.push_back(std::move(weak));
    directions.push_back(std::move(d));
  };

  // Null directions: of the result; and those that only priors hold.
  for (const Direction& direction : result.unobservable) {
    VectorXd d = VectorXd::Zero(n);
    for (const auto& c : direction) d(index(c.first)) = c.second;
    add(d, largest(d), kNan, kNan);
  }
  for (const ParameterEstimate& e : result.parameters)
    for (size_t c = 0; c < e.sigma.size(); ++c) {
      const int i = index(e.components[c].empty() ? e.name : e.name + "." + e.components[c]);
      if (i < n && !std::isfinite(e.sigma[c])) lost[i] = 1;
    }
  MatrixXd covariance = result.covariance;
  if (!result.setup.priors.empty()) {
    Estimation problem(calibration.recording(), calibration.training(), Scene::without_priors(result.setup));
    const VectorXd state = problem.pack(result.values);
    problem.renew(state);
    const Observability data = observe(problem, state);
    covariance = data.covariance;
    for (const auto& direction : data.directions) {
      VectorXd d = VectorXd::Zero(n);
      for (const auto& c : direction) d(c.first) = c.second;
      bool known = false;  // among the result's own
      for (const VectorXd& other : directions)
        known = known || std::abs(d.cwiseQuotient(yardstick).normalized().dot(other.cwiseQuotient(yardstick).normalized())) > 0.999;
      if (known) continue;
      add(d, largest(d), kNan, sigma(largest(d)));
    }
    for (int i = 0; i < n; ++i) lost[i] = lost[i] || data.unobservable[i];
  }

  // Correlations, then weak directions by pivots.
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < i; ++j) {
      if (lost[i] || lost[j] || !(covariance(i, i) > 0) || !(covariance(j, j) > 0)) continue;
      const double c = covariance(i, j) / std::sqrt(covariance(i, i) * covariance(j, j));
      if (std::abs(c) > kStrong) out.correlations.push_back({names[j], names[i], c});
    }
  std::stable_sort(out.correlations.begin(), out.correlations.end(),
                   [](const Correlation& a, const Correlation& b) { return std::abs(a.correlation) > std::abs(b.correlation); });
  const size_t null_directions = directions.size();
  std::vector<int> pivots;
  MatrixXd left = covariance;  // what is left of it with the pivots held
  while (true) {
    int worst = -1;
    double most = 1;
    for (int i = 0; i < n; ++i)
      if (!lost[i] && std::sqrt(std::max(0.0, left(i, i))) / yardstick(i) > most) {
        most = std::sqrt(left(i, i)) / yardstick(i);
        worst = i;
      }
    if (worst < 0) break;
    const VectorXd column = left.col(worst);
    left -= column * column.transpose() / column(worst);
    lost[worst] = 1;
    pivots.push_back(worst);
  }
  if (!pivots.empty()) {
    const int k = static_cast<int>(pivots.size());
    MatrixXd columns_of(n, k), among(k, k);
    for (int a = 0; a < k; ++a) columns_of.col(a) = covariance.col(pivots[a]);
    for (int a = 0; a < k; ++a) among.row(a) = columns_of.row(pivots[a]);
    const MatrixXd regression = divide_by_symmetric(columns_of, among);
    for (int a = 0; a < k; ++a) add(regression.col(a), pivots[a], std::sqrt(covariance(pivots[a], pivots[a])), sigma(pivots[a]));
  }
  if (directions.empty()) return out;

  Scene scene(calibration, result);
  const std::vector<Effects> effects = effects_of(scene, directions);
  // Weak ones with exact readings: does the joints' noise hide them?
  std::optional<MatrixXd> exact;
  if (directions.size() > null_directions && result.setup.noise != NoiseMode::none) {
    EstimationSetup setup = Scene::without_priors(result.setup);
    setup.noise = NoiseMode::none;
    Estimation problem(calibration.recording(), calibration.training(), setup);
    const VectorXd state = problem.pack(result.values);
    problem.renew(state);
    exact = observe(problem, state).covariance;
  }
  for (size_t k = 0; k < directions.size(); ++k) {
    WeakDirection& weak = out.weak[k];
    Reason(scene, directions[k], effects[k], weak).find();
    if (k < null_directions || !exact || (weak.reason != "unknown" && weak.reason != "free_targets")) continue;
    const int i = index(weak.parameters[0].first);
    const double without = std::sqrt(std::max(0.0, (*exact)(i, i)));
    if (!(without < 0.5 * weak.sigma)) continue;
    std::vector<std::string> involved;
    for (const auto& p : weak.parameters) involved.push_back(p.first);
    weak.why = listed(involved) + (involved.size() > 1 ? " move together" : " moves") +
               (weak.reason == "free_targets" ? ", and free targets go along" : "") +
               ": what would tell it is hidden by the noise of the joint readings. With exact readings " + involved[0] +
               " would be known to " +
               (weak.unit == "m"     ? length_text(without)
                : weak.unit == "rad" ? angle_text(without)
                                     : text("%.2g", without));
    weak.cure =
        "more samples and more varied postures, a sensor or mounted target that is held, joint sigmas no larger than they have to be; "
        "or hold " +
        involved[0];
    weak.reason = "joint_noise";
  }
  return out;
}

}  // namespace kincal
