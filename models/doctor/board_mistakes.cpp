#include "board_mistakes.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>

#include "../rig/targets.h"
#include "../rig/words.h"

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
                   corner == 0 && rows != columns});
  }
  return out;
}

Undo laid_out_anew(int target, Eigen::Matrix3Xd layout) {
  return [target, layout = std::move(layout)](Rig& r) { set_layout(r.targets[target], layout); };
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

constexpr const char* kRenumber =
    "number the points of these views from the corner where the rig has point 0: row by row, x "
    "along the row";

/// Another numbering of a board, which a turn or reflection of it undoes.
struct Relabeling {
  NoticeKind kind;
  Matrix2d m;
  std::string numbering, cure;
};
const std::vector<Relabeling>& relabelings() {
  static const std::vector<Relabeling> all = {
      {NoticeKind::numbering, matrix(-1, 0, 0, -1), "from the opposite corner (half a turn)",
       kRenumber},
      {NoticeKind::numbering, matrix(0, -1, 1, 0), "from a neighbouring corner (a quarter turn)",
       kRenumber},
      {NoticeKind::numbering, matrix(0, 1, -1, 0),
       "from the other neighbouring corner (a quarter turn)", kRenumber},
      {NoticeKind::mirrored, matrix(-1, 0, 0, 1), "mirrored: each row backwards",
       "reverse the order of the points within each row of these views"},
      {NoticeKind::mirrored, matrix(1, 0, 0, -1), "mirrored: the last row first",
       "reverse the order of the rows of points in these views"}};
  return all;
}

/// The mistake that a sensor (-1: any) numbers points of targets so; `places` by target.
Hypothesis relabeled(const Rig& rig, const Relabeling& r, Subjects where, const std::string& clause,
                     const std::map<int, std::vector<int>>& places, int sensor) {
  Hypothesis out{r.kind, std::move(where), clause + " " + r.numbering, r.cure,
                 of_views(sensor, [places](const Rig& changed, View& v) {
                   if (places.count(v.target) && !changed.sensors[v.sensor].model->measures_pose())
                     relabel(v, changed.targets[v.target], places.at(v.target));
                 })};
  out.only_of_misfits = std::all_of(places.begin(), places.end(), [&](const auto& p) {
    return numbered_by_markers(rig.targets[p.first]);
  });
  return out;
}

/// "begin with the lower left one and go counter-clockwise": the corners of a tag that is turned or
/// reflected so.
std::string corner_words(const Target& target, const Matrix2d& order) {
  const Eigen::Matrix2Xd corners = target.layout.leftCols(4).topRows<2>();
  const Eigen::Vector2d centre = corners.rowwise().mean(),
                        first = order * (corners.col(0) - centre),
                        second = order * (corners.col(1) - centre);
  const bool clockwise = first.x() * second.y() < first.y() * second.x();
  return std::string("begin with the ") + (first.y() > 0 ? "upper " : "lower ") +
         (first.x() > 0 ? "right" : "left") + " one and go " +
         (clockwise ? "clockwise" : "counter-clockwise");
}

/// Corners of all tags in the order of another detector, on boards that may be numbered otherwise
/// as well.
void add_corner_orders(const Rig& rig, const std::set<int>& targets, std::vector<Hypothesis>& out) {
  const Matrix2d same = Matrix2d::Identity();
  std::vector<Relabeling> boards = relabelings();
  boards.insert(boards.begin(), {NoticeKind::numbering, same, "", ""});
  std::set<std::map<int, std::vector<int>>> known;
  for (const Relabeling& board : boards)
    for (const Matrix2d& order :
         {same, matrix(0, -1, 1, 0), matrix(-1, 0, 0, -1), matrix(0, 1, -1, 0), matrix(-1, 0, 0, 1),
          matrix(1, 0, 0, -1), matrix(0, 1, 1, 0), matrix(0, -1, -1, 0)}) {
      std::map<int, std::vector<int>> places;
      Subjects where;
      for (const int t : targets) {
        const Target& target = rig.targets[t];
        std::vector<int> found = relabeling(target, board.m, order);
        if (points_of_mark(target) != 4 || found.empty()) continue;
        places[t] = std::move(found);
        where.push_back(Subject::target(target.name));
      }
      if (places.empty() || order == board.m || !known.insert(places).second) continue;
      const Target& first = rig.targets[places.begin()->first];
      const bool alone = board.numbering.empty();
      const auto as_well =
          std::find_if(relabelings().begin(), relabelings().end(), [&](const Relabeling& r) {
            return alone && r.m == order.transpose() && !relabeling(first, r.m, same).empty();
          });
      const std::string of = where.size() > 1 ? " of targets " + joined(names_of(where))
                                              : " of target " + quoted(first.name);
      out.push_back(relabeled(
          rig,
          {NoticeKind::numbering, board.m,
           corner_words(first, order) + (as_well == relabelings().end()
                                             ? ""
                                             : " (or only the tags are numbered " +
                                                   as_well->numbering + ": the data are the same)"),
           "list the corners of each tag as the rig does: they " + corner_words(first, same) +
               (alone ? "" : ". And " + board.cure)},
          where,
          alone ? "the corners of each tag" + of
                : "the tags" + of + " are numbered " + board.numbering + ", and their corners",
          places, -1));
    }
}

}  // namespace

void add_boards(const Rig& rig, const ObservationIndex& observations,
                std::vector<Hypothesis>& out) {
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
                           : kRenumber,
           laid_out_anew(t.first, std::move(other.layout))});
    }
    for (const Relabeling& r : relabelings())
      if (const std::vector<int> places = relabeling(target, r.m); !places.empty())
        out.push_back(relabeled(rig, r, {Subject::target(target.name)},
                                "the points of target " + quoted(target.name) + " are numbered",
                                {{t.first, places}}, -1));
  }
  std::set<int> grids;
  for (const auto& t : observers) grids.insert(t.first);
  add_corner_orders(rig, grids, out);
  for (const auto& s : seen)
    for (const Relabeling& r : relabelings()) {
      std::map<int, std::vector<int>> places;
      for (int t : s.second)
        if (std::vector<int> found = relabeling(rig.targets[t], r.m); !found.empty())
          places[t] = std::move(found);
      const bool same = places.size() == 1 && observers[places.begin()->first].size() ==
                                                  1;  // as all views of that target
      if (places.empty() || same) continue;
      Subjects where = {Subject::sensor(rig.sensors[s.first].name)};
      for (const auto& p : places) where.push_back(Subject::target(rig.targets[p.first].name));
      const std::string sensor = "sensor " + quoted(rig.sensors[s.first].name);
      out.push_back(
          relabeled(rig, r, where, sensor + " numbers the points of its targets", places, s.first));
      // One of them only: what detectors do with boards of even symmetry.
      if (places.size() > 1 && &r == &relabelings().front())
        for (const auto& p : places) {
          const Target& target = rig.targets[p.first];
          out.push_back(relabeled(rig, r, {where[0], Subject::target(target.name)},
                                  sensor + " numbers the points of target " + quoted(target.name),
                                  {p}, s.first));
        }
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

}  // namespace kincal
