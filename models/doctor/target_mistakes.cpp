#include "target_mistakes.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
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

using Eigen::Matrix2d;

Matrix2d matrix(double a, double b, double c, double d) {
  return (Matrix2d() << a, b, c, d).finished();
}

/// The rows and columns of a regular grid of single points or of tags of four; 0: it is none.
struct GridShape {
  int block = 1, rows = 0, columns = 0;
  bool asymmetric = false;  // every other row is shifted by half a pitch
};

GridShape shape_of(const Target& target) {
  const Eigen::Matrix3Xd& old = target.layout;
  GridShape out;
  out.block = points_of_mark(target);
  const int n = static_cast<int>(old.cols()) / out.block;
  int columns = 1;
  while (columns < n && std::abs(old(1, columns * out.block) - old(1, 0)) < 1e-9) ++columns;
  const int rows = columns ? n / columns : 0;
  if (rows < 2 || columns < 2 || rows * columns != n) return out;
  out.rows = rows, out.columns = columns;
  out.asymmetric = std::abs(old(0, columns * out.block) - old(0, 0)) > 1e-9;
  return out;
}

/// The layout with as many marks, whose mark i stands in the row and column that `place` says.
template <typename Place>
Eigen::Matrix3Xd laid_out(const Target& target, const GridShape& shape, const Place& place) {
  const Eigen::Matrix3Xd& old = target.layout;
  const double pitch = old(1, shape.columns * shape.block) - old(1, 0);
  Eigen::Matrix3Xd out = old;
  for (int i = 0; i < shape.rows * shape.columns; ++i) {
    const std::pair<int, int> at = place(i);
    const int r = at.first, c = at.second;
    const Vector3d corner =
        old.col(0) + Vector3d(shape.asymmetric ? 2 * c + r % 2 : pitch * c, pitch * r, 0);
    for (int k = 0; k < shape.block; ++k)
      out.col(i * shape.block + k) = corner + Vector3d(old.col(k) - old.col(0));
  }
  return out;
}

/// Another numbering of a regular grid's points.
struct OtherLayout {
  Eigen::Matrix3Xd layout;
  std::string numbering;
  bool exchanged;  // as if rows and columns were, from the corner of point 0
};

/// Layouts with the same points numbered row by row of the other shape, and column by column from
/// each corner.
std::vector<OtherLayout> exchanged_layouts(const Target& target) {
  const GridShape shape = shape_of(target);
  std::vector<OtherLayout> out;
  const int rows = shape.rows, columns = shape.columns;
  if (rows == 0) return out;
  if (rows != columns)
    out.push_back(
        {laid_out(target, shape, [&](int i) { return std::make_pair(i / rows, i % rows); }),
         "in rows of another length", true});
  for (const int corner : {0, 1, 2, 3}) {
    if (shape.asymmetric || (corner != 0 && shape.block > 1)) break;
    out.push_back({laid_out(target, shape,
                            [&](int i) {
                              const int r = i % rows, c = i / rows;
                              return std::make_pair(corner & 1 ? rows - 1 - r : r,
                                                    corner & 2 ? columns - 1 - c : c);
                            }),
                   corner == 0 ? "column by column" : "column by column, from another corner",
                   corner == 0});
  }
  return out;
}

Undo laid_out_anew(int target, Eigen::Matrix3Xd layout) {
  return [target, layout = std::move(layout)](Rig& r) { set_layout(r.targets[target], layout); };
}

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

/// The number of points of the board that the views show, as far as their ids tell: the largest
/// and one. `complete`: all views show as many.
int points_seen(const std::vector<Sample>& samples, int target, bool& complete) {
  int most = 0;
  size_t fewest = std::numeric_limits<size_t>::max();
  for (const Sample& sample : samples)
    for (const View& v : sample.views)
      if (v.target == target && !v.ids.empty()) {
        most = std::max(most, *std::max_element(v.ids.begin(), v.ids.end()) + 1);
        fewest = std::min(fewest, v.ids.size());
      }
  complete = fewest == static_cast<size_t>(most);
  return most;
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

void add_boards(const Rig& rig, const ObservationIndex& observations,
                std::vector<Hypothesis>& out) {
  struct Relabeling {
    NoticeKind kind;
    Matrix2d m;
    std::string numbering, cure;
  };
  const std::string renumber =
      "number the points of these views from the corner where the rig has point 0: row by row, x "
      "along the row";
  const std::vector<Relabeling> relabelings = {
      {NoticeKind::numbering, matrix(-1, 0, 0, -1), "from the opposite corner (half a turn)",
       renumber},
      {NoticeKind::numbering, matrix(0, -1, 1, 0), "from a neighbouring corner (a quarter turn)",
       renumber},
      {NoticeKind::numbering, matrix(0, 1, -1, 0),
       "from the other neighbouring corner (a quarter turn)", renumber},
      {NoticeKind::mirrored, matrix(-1, 0, 0, 1), "mirrored: each row backwards",
       "reverse the order of the points within each row of these views"},
      {NoticeKind::mirrored, matrix(1, 0, 0, -1), "mirrored: the last row first",
       "reverse the order of the rows of points in these views"}};
  const auto add = [&](const Relabeling& r, const Subjects& where, const std::string& clause,
                       const std::map<int, std::vector<int>>& places, int sensor) {
    out.push_back({r.kind, where, clause + " " + r.numbering, r.cure,
                   of_views(sensor, [places](const Rig& changed, View& v) {
                     if (places.count(v.target) &&
                         !changed.sensors[v.sensor].model->measures_pose())
                       relabel(v, changed.targets[v.target], places.at(v.target));
                   })});
    out.back().only_of_misfits = std::all_of(places.begin(), places.end(), [&](const auto& p) {
      return numbered_by_markers(rig.targets[p.first]);
    });
  };
  std::map<int, std::set<int>> seen, observers;  // grids by sensor, and the other way round
  for (const auto& pair : observations.pairs)
    if (rig.targets[pair.second].grid && !rig.sensors[pair.first].model->measures_pose())
      seen[pair.first].insert(pair.second), observers[pair.second].insert(pair.first);
  for (const auto& t : observers) {
    const Target& target = rig.targets[t.first];
    for (OtherLayout& other : exchanged_layouts(target)) {
      const std::string name = "target " + quoted(target.name);
      out.push_back(
          {other.exchanged ? NoticeKind::rows_columns : NoticeKind::numbering,
           {Subject::target(target.name)},
           (other.exchanged
                ? "rows and columns of " + name + " are exchanged: its points are numbered "
                : "the points of " + name + " are numbered ") +
               other.numbering,
           other.exchanged ? "exchange targets." + target.name +
                                 ".rows and .columns in the rig, or number the points row by row"
                           : renumber,
           laid_out_anew(t.first, std::move(other.layout))});
    }
    for (const Relabeling& r : relabelings) {
      const std::vector<int> places = relabeling(target, r.m);
      if (!places.empty())
        add(r, {Subject::target(target.name)},
            "the points of target " + quoted(target.name) + " are numbered", {{t.first, places}},
            -1);
    }
  }
  for (const auto& s : seen)
    for (const Relabeling& r : relabelings) {
      std::map<int, std::vector<int>> places;
      for (int t : s.second)
        if (std::vector<int> found = relabeling(rig.targets[t], r.m); !found.empty())
          places[t] = std::move(found);
      const bool same = places.size() == 1 && observers[places.begin()->first].size() ==
                                                  1;  // as all views of that target
      if (places.empty() || same) continue;
      Subjects where = {Subject::sensor(rig.sensors[s.first].name)};
      for (const auto& p : places) where.push_back(Subject::target(rig.targets[p.first].name));
      add(r, where,
          "sensor " + quoted(rig.sensors[s.first].name) + " numbers the points of its targets",
          places, s.first);
      if (places.size() > 1 &&
          &r == &relabelings
                     .front())  // one of them only: what detectors do with boards of even symmetry
        for (const auto& p : places)
          add(r,
              {Subject::sensor(rig.sensors[s.first].name),
               Subject::target(rig.targets[p.first].name)},
              "sensor " + quoted(rig.sensors[s.first].name) + " numbers the points of target " +
                  quoted(rig.targets[p.first].name),
              {p}, s.first);
    }
}

void add_widths(const Rig& rig, const std::vector<Sample>& samples,
                const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  for (int t : observations.targets) {
    const Target& target = rig.targets[t];
    if (!target.grid) continue;
    const GridShape shape = shape_of(target);
    bool complete = false;
    const int seen = points_seen(samples, t, complete) / shape.block;
    for (int width : {shape.columns - 1, shape.columns + 1}) {
      if (shape.rows == 0 || width < 2 || width == shape.rows || (complete && seen % width != 0))
        continue;
      const bool squares =
          complete && width == shape.columns - 1 && seen == (shape.rows - 1) * (shape.columns - 1);
      out.push_back({NoticeKind::board_columns,
                     {Subject::target(target.name)},
                     "the points of target " + quoted(target.name) + " are numbered in rows of " +
                         std::to_string(width) + ", but the rig's board has " +
                         std::to_string(shape.columns) + " in a row" +
                         (squares ? ": the rig counts squares in place of inner corners" : ""),
                     "count rows and columns again (inner corners, not squares; of a charuco board "
                     "squares): targets." +
                         target.name + ".columns is one" +
                         (width > shape.columns ? " too small" : " too large") +
                         (complete ? text(", and the points seen make %d rows", seen / width) : ""),
                     laid_out_anew(t, laid_out(target, shape, [&](int i) {
                                     return std::make_pair(i / width, i % width);
                                   }))});
    }
  }
}

void add_counts_from_one(const Rig& rig, const std::vector<Sample>& samples,
                         const ObservationIndex& observations, std::vector<Hypothesis>& out) {
  std::map<int, std::map<int, Eigen::Matrix3Xd>> all;  // by the shift of the ids, and target
  for (int t : observations.targets) {
    const Target& target = rig.targets[t];
    const GridShape shape = shape_of(target);
    if (!target.grid || shape.rows == 0 || shape.block > 1) continue;
    std::vector<char> seen(target.count(), 0);
    for (const Sample& sample : samples)
      for (const View& v : sample.views)
        if (v.target == t)
          for (int id : v.ids) seen[id] = 1;
    for (const int by : {1, -1}) {
      if (seen[by > 0 ? 0 : target.count() - 1] || !std::count(seen.begin(), seen.end(), 1))
        continue;
      all[by][t] = laid_out(target, shape, [&](int i) {
        const int own = i - by + shape.columns;  // (not negative)
        return std::make_pair(own / shape.columns - 1, own % shape.columns);
      });
    }
  }
  const auto add = [&](int by, const std::map<int, Eigen::Matrix3Xd>& layouts) {
    Subjects where;
    for (const auto& [t, layout] : layouts) where.push_back(Subject::target(rig.targets[t].name));
    out.push_back({NoticeKind::numbering, where,
                   "the ids of the points of " +
                       (where.size() > 1 ? "targets " + joined(names_of(where))
                                         : "target " + quoted(where[0].name)) +
                       " are one too " + (by > 0 ? "large" : "small"),
                   by > 0 ? "subtract 1 from these ids: they count from 0"
                          : "add 1 to these ids: the first point is 0",
                   [layouts](Rig& r) {
                     for (const auto& [t, layout] : layouts) set_layout(r.targets[t], layout);
                   }});
  };
  for (const auto& [by, layouts] : all) {
    for (const auto& one : layouts) add(by, {one});
    if (layouts.size() > 1) add(by, layouts);  // of one detector
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
