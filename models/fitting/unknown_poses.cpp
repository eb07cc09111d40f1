#include "unknown_poses.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>

#include "../rig/configuration.h"
#include "../rig/targets.h"
#include "../sensors/tilting_laser.h"
#include "closed_form.h"
#include "free_targets.h"
#include "view_poses.h"

namespace kincal {
namespace {

using TargetPoses = std::map<std::pair<int, int>, Pose>;  // base_T_target by (sample, target)

/// A view relates the sensor's pose and the target's in a sample. `sensor_T_target` is what it
/// gives by itself: of a camera's two mirror solutions their own residuals decide.
struct Relation {
  int sample;
  const View* view;
  std::optional<Pose> sensor_T_target;
};

/// Proposals for one unknown pose by relations in which everything else is known.
struct PoseEvidence {
  std::vector<Pose> poses;         // the pose itself
  std::vector<Vector3d> from, to;  // the unknown pose takes `from` to `to`
  std::vector<Vector3d> ray_points, ray_origins,
      ray_directions;  // where single views have no pose: points, and rays that they lie on
};

/// A pose, and the number of points that support it; a pose counts as four.
struct Proposal {
  size_t weight = 0;
  Pose pose;
};

/// Free targets of a sample as sensors with known poses see them. It stays until more of them are
/// known.
struct SeenTargets {
  std::vector<int> sensors;
  std::map<std::pair<int, int>, Pose> poses;  // as Values::targets
};

/// Relations A X = Y B of two unknown poses.
struct PairOfUnknowns {
  std::vector<Pose> a, b;
};
using Pairs = std::map<std::pair<int, int>, PairOfUnknowns>;  // by the parameters of X and Y

/// Poses of sensors and targets, and the views that relate them: which are known, and what these
/// propose for the others.
class PoseGraph {
 public:
  PoseGraph(const Recording& recording, const std::vector<int>& samples,
            const std::vector<int>& unknown, Values& values, const TargetStarts& how);

  const std::vector<int>& open() const { return open_; }
  bool settle_one();
  bool settle_two(std::vector<AmbiguousStart>& ambiguous);
  bool settle_by_points(std::vector<AmbiguousStart>& ambiguous);
  bool settle_by_shared_points(std::vector<AmbiguousStart>& ambiguous);
  bool settle_on_line();
  void settle(int parameter, const Pose& pose);
  Pose pose_of(int parameter) const {
    return get_pose(values_.shared, table_.all[parameter].start);
  }

 private:
  Configuration robot(int sample) const {
    return Configuration(rig_, table_, values_.shared, readings_[sample],
                         recording_.samples[sample].conditions);
  }
  bool known_sensor(const View& v) const { return known_[table_.sensor_pose[v.sensor]]; }
  TargetPoses known_targets();
  PoseEvidence evidence_for(int parameter, const TargetPoses& targets) const;
  void add_for_sensor(const Relation& relation, const Pose& base_T_target,
                      PoseEvidence& evidence) const;
  void add_for_target(const Relation& relation, PoseEvidence& evidence) const;
  void add_rays(const View& view, const Pose& frame_T_points, const Pose& frame_T_sensor,
                PoseEvidence& evidence) const;
  Matrix3Xd seen_points(const View& view) const {
    return select_columns(target_points(rig_, table_, values_.shared, view.target),
                          view_ids(view, rig_.targets[view.target]));
  }
  Proposal proposal(int parameter, PoseEvidence evidence) const;
  Pairs pairs_of_unknowns() const;

  const Recording& recording_;
  const Rig& rig_;
  const ParameterTable& table_;
  const std::vector<int>& samples_;
  std::vector<std::vector<double>> readings_;  // by sample; where absent anything: it cancels
  Values& values_;
  TargetStarts how_;
  std::vector<char> known_;  // by parameter
  std::vector<int> open_;    // parameters that are not known, in the order in which they were given
  std::vector<Relation> relations_;  // of what was not known at first
  std::map<int, SeenTargets> seen_;  // by sample
};

PoseGraph::PoseGraph(const Recording& recording, const std::vector<int>& samples,
                     const std::vector<int>& unknown, Values& values, const TargetStarts& how)
    : recording_(recording),
      rig_(recording.rig),
      table_(recording.table),
      samples_(samples),
      values_(values),
      how_(how),
      known_(recording.table.all.size(), 1),
      open_(unknown) {
  for (int p : unknown) known_[p] = 0;
  for (const Sample& sample : recording.samples) readings_.push_back(completed(sample.readings));
  for (int index : samples)
    for (const View& v : recording.samples[index].views)
      if (!known_sensor(v) ||
          (rig_.targets[v.target].link >= 0 && !known_[table_.target_pose[v.target]]))
        relations_.push_back(
            {index, &v, pose_from_view(rig_, table_, values.shared, v, how.memory)});
}

/// base_T_target where sensors with known poses see a free target that another one sees as well, or
/// where a mounted one's pose is known.
TargetPoses PoseGraph::known_targets() {
  TargetPoses out;
  for (int index : samples_) {
    std::vector<int> known;
    bool asked = false;
    for (const View& v : recording_.samples[index].views) {
      const bool free = rig_.targets[v.target].link < 0;
      if (free && known_sensor(v)) known.push_back(v.sensor);
      if (free && !known_sensor(v)) asked = true;
      if (!free && known_[table_.target_pose[v.target]])
        out[{index, v.target}] = robot(index).base_T_target(v.target);
    }
    if (!asked || known.empty()) continue;
    SeenTargets& seen = seen_[index];
    if (seen.sensors != known) {
      seen.sensors = known;
      Values with;
      with.shared = values_.shared;
      try {
        start_targets(recording_, {index}, known, {LossKind::soft_l1, 3}, with, how_);
      } catch (const std::runtime_error&) {  // it stays unknown
      }
      seen.poses = std::move(with.targets);
    }
    out.insert(seen.poses.begin(), seen.poses.end());
  }
  return out;
}

void PoseGraph::add_rays(const View& view, const Pose& frame_T_points, const Pose& frame_T_sensor,
                         PoseEvidence& evidence) const {
  const Matrix3Xd points = seen_points(view);
  std::vector<int> keep;
  const Matrix3Xd xy1 =
      seen_directions(rig_, table_, values_.shared, view, static_cast<int>(points.cols()), keep);
  for (size_t i = 0; i < keep.size(); ++i) {
    evidence.ray_points.push_back(frame_T_points * Vector3d(points.col(keep[i])));
    evidence.ray_origins.push_back(frame_T_sensor.translation);
    evidence.ray_directions.push_back(frame_T_sensor.rotation *
                                      xy1.col(static_cast<Eigen::Index>(i)));
  }
}

/// Of a sensor's pose, where its target's is known.
void PoseGraph::add_for_sensor(const Relation& relation, const Pose& base_T_target,
                               PoseEvidence& evidence) const {
  const View& v = *relation.view;
  const Sensor& sensor = rig_.sensors[v.sensor];
  const MeasurementKind kind = sensor.model->measurement_kind();
  const Configuration posture = robot(relation.sample);
  if (kind == MeasurementKind::rays && !relation.sensor_T_target)
    add_rays(v, inverse(posture.base_T_link(sensor.link)) * base_T_target, Pose(), evidence);
  if (relation.sensor_T_target)
    evidence.poses.push_back(inverse(posture.base_T_link(sensor.link)) * base_T_target *
                             inverse(*relation.sensor_T_target));
  const bool scan = kind == MeasurementKind::scan;
  if (!scan && kind != MeasurementKind::points) return;
  const Matrix3Xd points = seen_points(v);
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const double* z = v.z.data() + 3 * i;
    const Pose base_T_link =
        (scan ? posture.with(sensor.scanning_joint, z[0]) : posture).base_T_link(sensor.link);
    evidence.from.push_back(scan ? TiltingLaser::measured_point(z) : Vector3d(z[0], z[1], z[2]));
    evidence.to.push_back(inverse(base_T_link) * (base_T_target * Vector3d(points.col(i))));
  }
}

/// Of a mounted target's pose, where its sensor's is known.
void PoseGraph::add_for_target(const Relation& relation, PoseEvidence& evidence) const {
  const View& v = *relation.view;
  const Sensor& sensor = rig_.sensors[v.sensor];
  const MeasurementKind kind = sensor.model->measurement_kind();
  const Configuration posture = robot(relation.sample);
  const Pose base_T_link = posture.base_T_link(rig_.targets[v.target].link);
  if (kind == MeasurementKind::rays && !relation.sensor_T_target)
    add_rays(
        v, Pose(),
        inverse(base_T_link) * posture.base_T_link(sensor.link) * posture.link_T_sensor(v.sensor),
        evidence);
  if (kind == MeasurementKind::scan || kind == MeasurementKind::points) {
    const Matrix3Xd points = seen_points(v);
    Matrix3Xd in_base;
    if (kind == MeasurementKind::scan) {
      in_base =
          scanned_points(rig_, table_, values_.shared, recording_.samples[relation.sample], v);
    } else {
      const Pose base_T_sensor = posture.base_T_sensor(v.sensor);
      in_base.resize(3, points.cols());
      for (Eigen::Index i = 0; i < points.cols(); ++i)
        in_base.col(i) = base_T_sensor * Vector3d(Eigen::Map<const Vector3d>(v.z.data() + 3 * i));
    }
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      evidence.from.push_back(points.col(i));
      evidence.to.push_back(inverse(base_T_link) * Vector3d(in_base.col(i)));
    }
  } else if (relation.sensor_T_target) {
    evidence.poses.push_back(inverse(base_T_link) * posture.base_T_link(sensor.link) *
                             posture.link_T_sensor(v.sensor) * *relation.sensor_T_target);
  }
}

PoseEvidence PoseGraph::evidence_for(int parameter, const TargetPoses& targets) const {
  PoseEvidence out;
  for (const Relation& relation : relations_) {
    const View& v = *relation.view;
    if (table_.sensor_pose[v.sensor] == parameter) {
      const auto target = targets.find({relation.sample, v.target});
      if (target != targets.end()) add_for_sensor(relation, target->second, out);
    }
    if (table_.target_pose[v.target] == parameter && known_sensor(v)) add_for_target(relation, out);
  }
  return out;
}

/// The mean of poses, or the fit of point correspondences, whichever has more points.
Proposal PoseGraph::proposal(int parameter, PoseEvidence evidence) const {
  std::vector<Pose>& poses = evidence.poses;
  if (poses.empty() && evidence.from.empty() && !evidence.ray_points.empty()) {
    const Matrix3Xd points = columns_of(evidence.ray_points),
                    directions = columns_of(evidence.ray_directions);
    Pose found;
    if (table_.all[parameter].kind == ParameterKind::sensor_pose) {
      if (pose_from_directions(points, directions, found)) poses.push_back(inverse(found));
    } else if (pose_from_rays(points, columns_of(evidence.ray_origins), directions, found)) {
      poses.push_back(found);
    }
  }
  const Matrix3Xd a = columns_of(evidence.from), b = columns_of(evidence.to);
  const size_t by_points = !evidence.from.empty() && !on_a_line(a) ? evidence.from.size() : 0;
  Proposal out;
  out.weight = std::max(poses.size() * 4, by_points);
  if (out.weight > 0)
    out.pose = poses.size() * 4 >= by_points ? robust_mean(poses, 1.0) : fit_points(a, b);
  return out;
}

void PoseGraph::settle(int parameter, const Pose& pose) {
  set_pose(values_.shared, table_.all[parameter].start, pose);
  known_[parameter] = 1;
  open_.erase(std::find(open_.begin(), open_.end(), parameter));
}

/// Settles the pose with the most support of those that are the only unknown of a relation. Returns
/// false if there is none.
bool PoseGraph::settle_one() {
  const TargetPoses targets = known_targets();
  int best = -1;
  Proposal largest;
  for (int parameter : open_) {
    const Proposal found = proposal(parameter, evidence_for(parameter, targets));
    if (found.weight <= largest.weight) continue;
    largest = found;
    best = parameter;
  }
  if (best < 0) return false;
  settle(best, largest.pose);
  return true;
}

/// Relations L_a X_a P = L_b X_b Q of two unknown poses, that is A X = Y B with A = L_b^-1 L_a, X =
/// X_a, Y = X_b, B = Q P^-1.
Pairs PoseGraph::pairs_of_unknowns() const {
  Pairs pairs;
  const auto base_T_link = [&](const Relation& r) {
    return robot(r.sample).base_T_link(rig_.sensors[r.view->sensor].link);
  };
  for (size_t i = 0; i < relations_.size(); ++i) {
    const Relation& first = relations_[i];
    if (!first.sensor_T_target || known_sensor(*first.view)) continue;
    const int x = table_.sensor_pose[first.view->sensor], target = first.view->target;
    const Pose la = base_T_link(first);
    if (rig_.targets[target].link >= 0) {
      const int y = table_.target_pose[target];
      if (known_[y]) continue;
      PairOfUnknowns& pair = pairs[{x, y}];
      pair.a.push_back(inverse(robot(first.sample).base_T_link(rig_.targets[target].link)) * la);
      pair.b.push_back(inverse(*first.sensor_T_target));
      continue;
    }
    for (size_t k = i + 1; k < relations_.size() && relations_[k].sample == first.sample; ++k) {
      const Relation& second = relations_[k];
      if (!second.sensor_T_target || second.view->target != target || known_sensor(*second.view))
        continue;
      const int y = table_.sensor_pose[second.view->sensor];
      if (x == y) continue;
      PairOfUnknowns& pair = pairs[{x, y}];
      pair.a.push_back(inverse(base_T_link(second)) * la);
      pair.b.push_back(*second.sensor_T_target * inverse(*first.sensor_T_target));
    }
  }
  return pairs;
}

/// Settles the two poses that most relations tie to each other, by the rotations of the relations,
/// or where these do not determine them by their translations too. Returns false if no two are
/// determined.
bool PoseGraph::settle_two(std::vector<AmbiguousStart>& ambiguous) {
  std::pair<int, int> chosen(-1, -1);
  Pose x, y;
  size_t most = 0;
  const Pairs pairs = pairs_of_unknowns();
  for (const auto& [parameters, pair] : pairs) {
    Pose trial_x, trial_y;
    if (pair.a.size() <= most || !robust_robot_world_hand_eye(pair.a, pair.b, trial_x, trial_y))
      continue;
    most = pair.a.size();
    chosen = parameters;
    x = trial_x;
    y = trial_y;
  }
  std::optional<SinglePointPose> by_points;
  for (const auto& [parameters, pair] : pairs) {
    if ((most > 0 && !by_points) || pair.a.size() <= most) continue;
    Pose trial_y;
    std::optional<SinglePointPose> trial = robot_world_hand_eye_by_points(pair.a, pair.b, trial_y);
    if (!trial) continue;
    most = pair.a.size();
    chosen = parameters;
    x = trial->x;
    y = trial_y;
    by_points = std::move(trial);
  }
  if (chosen.first < 0) return false;
  settle(chosen.first, x);
  settle(chosen.second, y);
  if (by_points && by_points->ambiguous)
    ambiguous.push_back(
        {table_.all[chosen.first].name, table_.all[chosen.second].name, by_points->turned});
  return true;
}

/// Settles a sensor and a mounted target of which single views show too few points for a pose:
/// those with the most points. Returns false if no two are determined.
bool PoseGraph::settle_by_points(std::vector<AmbiguousStart>& ambiguous) {
  std::map<std::pair<int, int>, std::vector<SinglePoint>> pairs;  // by sensor and target
  for (const Relation& relation : relations_) {
    const View& v = *relation.view;
    const Sensor& sensor = rig_.sensors[v.sensor];
    const MeasurementKind kind = sensor.model->measurement_kind();
    const bool scan = kind == MeasurementKind::scan;
    if ((!scan && kind != MeasurementKind::points) || known_sensor(v) ||
        rig_.targets[v.target].link < 0 || known_[table_.target_pose[v.target]])
      continue;
    const Configuration posture = robot(relation.sample);
    const Pose base_T_target_link = posture.base_T_link(rig_.targets[v.target].link);
    const std::vector<int> ids = view_ids(v, rig_.targets[v.target]);
    for (size_t i = 0; i < ids.size(); ++i) {
      const double* z = v.z.data() + 3 * i;
      const Pose base_T_link =
          (scan ? posture.with(sensor.scanning_joint, z[0]) : posture).base_T_link(sensor.link);
      pairs[{v.sensor, v.target}].push_back(
          {scan ? TiltingLaser::measured_point(z) : Vector3d(z[0], z[1], z[2]),
           inverse(base_T_link) * base_T_target_link, ids[i]});
    }
  }
  std::pair<int, int> chosen(-1, -1);
  SinglePointPose found;
  Matrix3Xd points;  // those that were seen, in the target's frame
  size_t most = 0;
  for (auto& [pair, readings] : pairs) {
    std::vector<int> ids;
    for (const SinglePoint& one : readings) ids.push_back(one.point);
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    for (SinglePoint& one : readings)
      one.point =
          static_cast<int>(std::lower_bound(ids.begin(), ids.end(), one.point) - ids.begin());
    if (readings.size() <= most) continue;
    std::optional<SinglePointPose> solution =
        pose_from_single_points(readings, static_cast<int>(ids.size()));
    if (!solution) continue;
    most = readings.size();
    chosen = pair;
    found = std::move(*solution);
    points = select_columns(target_points(rig_, table_, values_.shared, pair.second), ids);
  }
  if (chosen.first < 0) return false;
  const int sensor = table_.sensor_pose[chosen.first], target = table_.target_pose[chosen.second];
  settle(sensor, found.x);
  settle(target, fit_points(points, found.y));
  if (found.ambiguous)
    ambiguous.push_back({table_.all[sensor].name, table_.all[target].name, found.turned});
  return true;
}

/// Settles a scanner and another sensor of which views have poses, by the points of free targets
/// that both see: those with the most points. Returns false if no two are determined.
bool PoseGraph::settle_by_shared_points(std::vector<AmbiguousStart>& ambiguous) {
  std::map<std::pair<int, int>, std::vector<PointOfTwo>> pairs;  // by scanner and other sensor
  const auto before = [](const Relation& a, const Relation& b) { return a.sample < b.sample; };
  for (const Relation& first : relations_) {
    const View& scanned = *first.view;
    const Sensor& scanner = rig_.sensors[scanned.sensor];
    if (scanner.model->measurement_kind() != MeasurementKind::scan || known_sensor(scanned) ||
        rig_.targets[scanned.target].link >= 0)
      continue;
    const Configuration posture = robot(first.sample);
    const std::vector<int> ids = view_ids(scanned, rig_.targets[scanned.target]);
    const Matrix3Xd points =
        select_columns(target_points(rig_, table_, values_.shared, scanned.target), ids);
    const auto [begin, end] = std::equal_range(relations_.begin(), relations_.end(), first, before);
    for (auto second = begin; second != end; ++second) {
      if (second->view->target != scanned.target || !second->sensor_T_target ||
          known_sensor(*second->view))
        continue;
      for (Eigen::Index i = 0; i < points.cols(); ++i) {
        const double* z = scanned.z.data() + 3 * i;
        const Configuration at_ray = posture.with(scanner.scanning_joint, z[0]);
        pairs[{scanned.sensor, second->view->sensor}].push_back(
            {TiltingLaser::measured_point(z), *second->sensor_T_target * Vector3d(points.col(i)),
             inverse(at_ray.base_T_link(scanner.link)) *
                 at_ray.base_T_link(rig_.sensors[second->view->sensor].link)});
      }
    }
  }
  std::pair<int, int> chosen(-1, -1);
  SinglePointPose found;
  Pose other;
  size_t most = 0;
  for (const auto& [pair, points] : pairs) {
    if (points.size() <= most) continue;
    Pose y;
    std::optional<SinglePointPose> solution = two_poses_by_points(points, y);
    if (!solution) continue;
    most = points.size();
    chosen = {table_.sensor_pose[pair.first], table_.sensor_pose[pair.second]};
    found = std::move(*solution);
    other = y;
  }
  if (chosen.first < 0) return false;
  settle(chosen.first, found.x);
  settle(chosen.second, other);
  if (found.ambiguous)
    ambiguous.push_back(
        {table_.all[chosen.first].name, table_.all[chosen.second].name, found.turned});
  return true;
}

/// Settles a mounted target of which no more than points on a line are known (one reflector): where
/// they are, and turned by nothing that they do not ask for. Returns false if there is none.
bool PoseGraph::settle_on_line() {
  const TargetPoses targets = known_targets();
  for (const int parameter : open_) {
    if (table_.all[parameter].kind != ParameterKind::target_pose) continue;
    const PoseEvidence evidence = evidence_for(parameter, targets);
    if (evidence.from.empty()) continue;
    const Matrix3Xd from = columns_of(evidence.from), to = columns_of(evidence.to);
    const Vector3d centre = from.rowwise().mean();
    Pose pose = get_pose(values_.shared, table_.all[parameter].start);
    if ((from.colwise() - centre).norm() > 0)
      pose = fit_points(from, to);
    else
      pose.translation = to.rowwise().mean() - pose.rotation * centre;
    settle(parameter, pose);
    return true;
  }
  return false;
}

}  // namespace

std::vector<int> samples_to_start(const Recording& recording, const std::vector<int>& samples) {
  const size_t n = samples.size();
  if (n <= kEnoughViews) return samples;
  size_t stride = static_cast<size_t>(0.618 * static_cast<double>(n));  // golden: spread evenly
  while (std::gcd(stride, n) != 1) ++stride;
  std::map<std::pair<int, int>, int> taken;  // views by sensor and target
  std::vector<int> out;
  for (size_t k = 0; k < n; ++k) {
    const int index = samples[k * stride % n];
    const std::vector<View>& views = recording.samples[index].views;
    if (std::none_of(views.begin(), views.end(), [&](const View& v) {
          return taken[{v.sensor, v.target}] < kEnoughViews;
        }))
      continue;
    for (const View& v : views) ++taken[{v.sensor, v.target}];
    out.push_back(index);
  }
  std::sort(out.begin(), out.end());
  return out;
}

UnknownStarts start_unknown_poses(const Recording& recording, const std::vector<int>& samples,
                                  const std::vector<int>& unknown, Values& values,
                                  const TargetStarts& how) {
  const std::vector<int> enough = samples_to_start(recording, samples);
  PoseGraph graph(recording, enough, unknown, values, how);
  UnknownStarts out;
  while (!graph.open().empty()) {
    if (graph.settle_one() || graph.settle_two(out.ambiguous) ||
        graph.settle_by_points(out.ambiguous) || graph.settle_by_shared_points(out.ambiguous) ||
        graph.settle_on_line())
      continue;
    const int first =
        graph.open()
            .front();  // nothing ties it to anything: the identity, and the others from there
    out.lost.push_back(recording.table.all[first].name);
    graph.settle(first, graph.pose_of(first));
  }
  return out;
}

namespace {

/// Whether a link stands behind a joint with nothing between that moves.
bool hangs_on(const Tree& tree, int link, int joint) {
  for (int l = link; l != tree.joints[joint].child; l = tree.joints[tree.joint_above[l]].parent)
    if (tree.joint_above[l] < 0 || !tree.joints[tree.joint_above[l]].is_rigid()) return false;
  return true;
}

}  // namespace

std::optional<OriginProxy> find_origin_proxy(const Recording& recording, int origin,
                                             const std::vector<char>& taken) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const int joint = table.all[origin].owner;
  if (rig.tree.joints[joint].type != JointType::fixed) return std::nullopt;
  const std::vector<double> readings(rig.tree.joints.size(), 0.0);
  const Configuration robot(rig, table, table.initial, readings);
  std::optional<OriginProxy> out;
  std::vector<int> bodies;
  const auto consider = [&](int link, int body) {
    if (link < 0 || taken[body] || !hangs_on(rig.tree, link, joint)) return;
    bodies.push_back(body);
    if (!out ||
        (table.all[body].replaced_by == origin && table.all[out->body].replaced_by != origin))
      out = OriginProxy{origin, body, robot.a_T_b(rig.tree.joints[joint].child, link), {}};
  };
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    consider(rig.sensors[s].link, table.sensor_pose[s]);
  for (size_t t = 0; t < rig.targets.size(); ++t)
    consider(rig.targets[t].link, table.target_pose[t]);
  for (const int body : bodies)
    if (body != out->body &&
        (table.all[body].replaced_by < 0 || table.all[body].replaced_by == origin))
      out->others.push_back(body);
  return out;
}

void move_origin(const ParameterTable& table, const OriginProxy& proxy, const VectorXd& initial,
                 VectorXd& shared) {
  // origin child_T_link found = new_origin child_T_link pose
  const int at = table.all[proxy.origin].start, body = table.all[proxy.body].start;
  const Pose pose = get_pose(initial, body), found = get_pose(shared, body);
  set_pose(shared, at,
           get_pose(initial, at) * proxy.child_T_link * found * inverse(pose) *
               inverse(proxy.child_T_link));
  set_pose(shared, body, pose);
  for (const int other : proxy.others)
    set_pose(shared, table.all[other].start, get_pose(initial, table.all[other].start));
}

}  // namespace kincal
