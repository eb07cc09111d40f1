#include "target_mistakes.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "../../solver/decompositions.h"
#include "../rig/geometry.h"
#include "../rig/numbers.h"
#include "../rig/targets.h"
#include "../rig/words.h"
#include "two_parts.h"

namespace kincal {
namespace {

const char* const kMoved = " (moved)";

/// Makes what some views of a target show a target of its own, whose name ends so; its index.
int stand_elsewhere(Rig& rig, std::vector<Sample>& samples, int target, const std::string& name,
                    const std::function<bool(const Sample&, const View&)>& shows_it) {
  const int other = static_cast<int>(rig.targets.size());
  Target copy = rig.targets[target];
  copy.name += name;
  copy.mount_joint = -1;
  copy.pose_given = false;
  rig.targets.push_back(std::move(copy));
  for (Sample& sample : samples)
    for (View& v : sample.views)
      if (v.target == target && shows_it(sample, v)) v.target = other;
  return other;
}

}  // namespace

void add_squares(const Rig& rig, const ParameterTable& table, const ObservationIndex& observations,
                 const FreedNames& freed, std::vector<Hypothesis>& out) {
  std::vector<std::vector<int>> groups;
  for (int t : observations.targets) {
    const Target& target = rig.targets[t];
    const int own = target.grid ? table.target_square[t] : table.target_points[t];
    const bool seen =
        std::any_of(observations.pairs.begin(), observations.pairs.end(), [&](const auto& pair) {
          return pair.second == t && !rig.sensors[pair.first].model->measures_pose();
        });
    if (own >= 0 && !freed.parameter[own] && target.count() >= 2 && seen) groups.push_back({t});
  }
  if (groups.size() > 1) {  // all in the same wrong unit; many placements of one block: only so
    std::vector<int> all;
    for (const auto& g : groups) all.push_back(g[0]);
    if (groups.size() > 3) groups.clear();
    groups.push_back(all);
  }
  for (const std::vector<int>& group : groups)
    for (double factor : {1.0, 0.001, 1000.0, 0.01, 100.0}) {
      Hypothesis h;
      h.kind = NoticeKind::square;
      for (int t : group) h.where.push_back(Subject::target(rig.targets[t].name));
      h.squares = group;
      h.undo = [group, factor](Rig& r) {
        for (int t : group) {
          Target& wrong = r.targets[t];
          if (!wrong.grid) wrong.layout = wrong.points, wrong.grid = true, wrong.square = 1;
          wrong.square *= factor;
        }
      };
      out.push_back(h);
    }
}

// ------------------------------------------------------------------------------------------------
// the order of points
namespace {

constexpr int kMostPoints = 24;    // of more, orders take too long
constexpr size_t kMostOrders = 4;  // that suit: of symmetric targets several
constexpr double kNearDistance = 0.03, kNearestDistance = 0.004;  // share of the target's size, m

/// Mean distances between the points that a sensor measures; NaN: never in one view.
Eigen::MatrixXd measured_distances(const std::vector<Sample>& samples, int sensor, int target,
                                   int count) {
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(count, count), number = sum;
  for (const Sample& sample : samples)
    for (const View& v : sample.views) {
      if (v.sensor != sensor || v.target != target) continue;
      for (size_t i = 0; i < v.ids.size(); ++i)
        for (size_t k = 0; k < i; ++k) {
          const double d =
              (Eigen::Map<const Vector3d>(&v.z[3 * i]) - Eigen::Map<const Vector3d>(&v.z[3 * k]))
                  .norm();
          sum(v.ids[i], v.ids[k]) += d, sum(v.ids[k], v.ids[i]) += d;
          number(v.ids[i], v.ids[k]) += 1, number(v.ids[k], v.ids[i]) += 1;
        }
    }
  return sum.cwiseQuotient(number);
}

/// Orders of points in which distances are as measured, point after point.
struct OrderSearch {
  const Eigen::MatrixXd &measured, &given;
  double tolerance;
  std::vector<int> order;  // point of the rig, by point as measured
  std::vector<std::vector<int>> found;

  void go_on() {
    const int i = static_cast<int>(order.size());
    if (i == given.rows()) found.push_back(order);
    for (int p = 0; p < given.rows() && i < given.rows() && found.size() < kMostOrders; ++p) {
      bool suits = !std::count(order.begin(), order.end(), p);
      for (int k = 0; k < i && suits; ++k)  // (not a number: not known)
        suits = !(std::abs(measured(i, k) - given(p, order[k])) > tolerance);
      if (!suits) continue;
      order.push_back(p);
      go_on();
      order.pop_back();
    }
  }
};

std::vector<std::vector<int>> suitable_orders(const Target& target,
                                              const Eigen::MatrixXd& measured) {
  const Eigen::Index n = target.points.cols();
  Eigen::MatrixXd given(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < n; ++k)
      given(i, k) = (target.points.col(i) - target.points.col(k)).norm();
  const double tolerance = std::max(kNearestDistance, kNearDistance * given.maxCoeff());
  OrderSearch search{measured, given, tolerance, {}, {}};
  if (((measured - given).array().abs() > tolerance).any()) search.go_on();
  return search.found;
}

}  // namespace

void add_point_orders(const Rig& rig, const std::vector<Sample>& samples,
                      const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (const auto& pair : observations.pairs) {
    const Sensor& sensor = rig.sensors[pair.first];
    const Target& target = rig.targets[pair.second];
    const int count = target.count();
    const MeasurementKind kind = sensor.model->measurement_kind();
    if (target.grid || count < 3 || count > kMostPoints || sensor.model->scans()) continue;
    std::vector<std::vector<int>> orders;
    if (kind == MeasurementKind::points) {
      orders = suitable_orders(target, measured_distances(samples, pair.first, pair.second, count));
    } else if (kind == MeasurementKind::rays) {
      orders.emplace_back();
      for (int i = 0; i < count; ++i) orders[0].push_back(count - 1 - i);
    }
    for (const std::vector<int>& order : orders) {
      std::string list;
      for (int p : order) list += (list.empty() ? "" : ", ") + std::to_string(p);
      out.push_back(
          {NoticeKind::numbering,
           {Subject::target(target.name), Subject::sensor(sensor.name)},
           "sensor " + quoted(sensor.name) + " sees the points of target " + quoted(target.name) +
               " in another order than the rig lists them: its first, second, ... are the rig's "
               "points " +
               list + " (counted from 0)",
           "list targets." + target.name +
               ".points in the order in which they are measured, or write these indices as ids "
               "into the views",
           of_views(pair.first, [t = pair.second, order](const Rig& r, View& v) {
             if (v.target == t) relabel(v, r.targets[t], order);
           })});
    }
  }
}

void add_mirrored_points(const Rig& rig, const ObservationIndex& observations,
                         std::vector<Hypothesis>& out) {
  for (int t : observations.targets) {
    const Target& target = rig.targets[t];
    if (target.grid || target.count() < 4) continue;
    const Eigen::Matrix3Xd centred =
        target.points.colwise() - Vector3d(target.points.rowwise().mean());
    const Vector3d extents = symmetric_eigen(centred * centred.transpose()).values;
    if (extents(0) < 1e-6 * extents(2)) continue;
    for (int axis : {0, 1, 2}) {
      Hypothesis h = mirrored_points(
          "the points of target " + quoted(target.name) + " are mirrored in the rig", axis,
          "target", "targets." + target.name + ".points");
      h.where = {Subject::target(target.name)};
      h.undo = [t, axis](Rig& r) { r.targets[t].points.row(axis) *= -1; };
      out.push_back(h);
    }
  }
}

void add_apart(const Rig& rig, const std::vector<Sample>& samples, std::vector<Hypothesis>& out) {
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    if (rig.targets[t].link >= 0) continue;
    std::map<int, std::set<int>> bodies;  // by body: sensors that see it together
    for (const Sample& sample : samples) {
      std::map<int, std::set<int>> here;
      for (const View& v : sample.views)
        if (v.target == static_cast<int>(t))
          here[body_of(rig.tree, rig.sensors[v.sensor].link)].insert(v.sensor);
      for (auto& [body, together] : here)
        if (together.size() > 1) bodies[body].merge(together);
    }
    std::set<int> sensors;
    for (auto& [body, together] : bodies) {
      if (together.size() == 2) together.erase(together.begin());  // either would do
      sensors.merge(together);
    }
    for (const int s : sensors) {
      const std::string sensor = quoted(rig.sensors[s].name), target = quoted(rig.targets[t].name);
      out.push_back(
          {NoticeKind::views_apart,
           {Subject::sensor(rig.sensors[s].name), Subject::target(rig.targets[t].name)},
           "the views of sensor " + sensor + " show target " + target +
               " in a different place than the other views from the same body in the same samples",
           "a sample must be one moment: check whether this sensor's views are in another order, "
           "or late; if it sees another object, give that object its own entry in targets",
           [s, t = static_cast<int>(t)](Rig& r, std::vector<Sample>& changed) {
             stand_elsewhere(r, changed, t, " (seen by " + r.sensors[s].name + ")",
                             [s](const Sample&, const View& v) { return v.sensor == s; });
           }});
      out.back().many = true;
    }
  }
}

// ------------------------------------------------------------------------------------------------
// a target that was moved
namespace {

constexpr int kFewestBefore = 3;  // samples on either side
constexpr double kPause = 4;      // times the usual time between samples

/// The same of a target that was moved. `from`: ids of the samples after that.
int stand_elsewhere(Rig& rig, std::vector<Sample>& samples, int target,
                    const std::set<std::string>& from) {
  return stand_elsewhere(rig, samples, target, kMoved,
                         [&](const Sample& s, const View&) { return from.count(s.id) > 0; });
}

/// Where a target stands elsewhere, if it was moved once.
struct MovedTarget {
  int target = -1;
  std::set<std::string> from;                        // ids of the samples after it
  std::string first;                                 // of them
  double cost = kInfinity, distance = 0, angle = 0;  // m, rad
};

/// The numbers of the target that the steps free, of its copy; the pose first.
std::vector<std::string> free_of_copy(const TrialContext& context, const std::string& name) {
  const std::string old = "target/" + name + "/", copy = "target/" + name + kMoved + "/";
  std::vector<std::string> out = {copy + "pose"};
  for (const std::string& free : context.all.free)
    if (free.rfind(old, 0) == 0 && free.rfind(old + "pose", 0) != 0)
      out.push_back(copy + free.substr(old.size()));
  return out;
}

MovedTarget move_from(const Recording& recording, const TrialContext& context, int target,
                      const std::vector<int>& seen, size_t k) {
  MovedTarget out;
  out.target = target;
  for (size_t i = k; i < seen.size(); ++i) out.from.insert(recording.samples[seen[i]].id);
  out.first = recording.samples[seen[k]].id;
  Rig rig = recording.rig;
  std::vector<Sample> samples = recording.samples;
  const int other = stand_elsewhere(rig, samples, target, out.from);
  const Recording moved(std::move(rig), std::move(samples));
  FitSpec spec = context.all;
  for (std::string& name : free_of_copy(context, recording.rig.targets[target].name))
    spec.free.push_back(std::move(name));
  const TrialFit fit = best_fit(moved, context, spec, {15, 1e-3});
  out.cost = fit.score();
  if (!std::isfinite(out.cost)) return out;
  const auto pose = [&](int t) {
    return get_pose(fit.values.shared, moved.table.all[moved.table.target_pose[t]].start);
  };
  const Pose change = inverse(pose(target)) * pose(other);
  out.distance = change.translation.norm();
  out.angle = log_so3(change.rotation).norm();
  return out;
}

/// The sample from which on the fit is best; where the pause between samples is longest, too.
MovedTarget find_move(const Recording& recording, const TrialContext& context, int target) {
  const std::vector<Sample>& samples = recording.samples;
  std::vector<int> seen;
  for (const int i : logged_order(samples))
    if (std::any_of(samples[i].views.begin(), samples[i].views.end(),
                    [&](const View& v) { return v.target == target; }))
      seen.push_back(i);
  const int n = static_cast<int>(seen.size());
  double longest = 0;
  int pause = 0;
  std::vector<double> pauses;
  for (int k = 1; k < n; ++k) {
    const auto &before = samples[seen[k - 1]].time, &after = samples[seen[k]].time;
    if (!before || !after) continue;
    pauses.push_back(*after - *before);
    if (pauses.back() > longest) longest = pauses.back(), pause = k;
  }
  MovedTarget best;
  best_cut(n, kFewestBefore, longest > kPause * median(pauses, kInfinity) ? pause : 0, [&](int k) {
    MovedTarget moved = move_from(recording, context, target, seen, static_cast<size_t>(k));
    const double cost = moved.cost;
    if (cost < best.cost) best = std::move(moved);
    return cost;
  });
  return best;
}

}  // namespace

std::optional<Hypothesis> moved_target(const Recording& recording, const TrialContext& context) {
  MovedTarget best;
  for (const int t : make_observation_index(recording.rig, recording.samples).targets)
    if (recording.rig.targets[t].link >= 0) {
      MovedTarget moved = find_move(recording, context, t);
      if (moved.cost < best.cost) best = std::move(moved);
    }
  if (best.target < 0) return std::nullopt;
  const std::string& name = recording.rig.targets[best.target].name;
  Hypothesis h{
      NoticeKind::moved_target,
      {Subject::target(name), Subject::sample(best.first)},
      "target " + quoted(name) + " moved at sample " + quoted(best.first) + ": by " +
          text("%.3g mm", 1e3 * best.distance) + text(" and %.3g mrad", 1e3 * best.angle),
      "calibrate the samples before and after the move separately; or give it a second entry in "
      "targets, with the same geometry and link and without pose, and name that one in the views "
      "from there on",
      [target = best.target, from = best.from](Rig& r, std::vector<Sample>& changed) {
        stand_elsewhere(r, changed, target, from);
      }};
  h.free = free_of_copy(context, name);
  return h;
}

std::string wrong_size(const Target& target, double factor) {
  return target.grid
             ? "the size of target " + quoted(target.name) + " is wrong: " +
                   text("%.6g m in the rig, %.6g m from the data (times %.5g)", target.square,
                        target.square * factor, factor)
             : "the points of target " + quoted(target.name) + " have the wrong unit or scale: " +
                   text("from the data %.5g times as large", factor);
}

}  // namespace kincal
