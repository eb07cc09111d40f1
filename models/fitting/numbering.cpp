#include "numbering.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <tuple>

#include "../rig/configuration.h"
#include "../rig/targets.h"
#include "closed_form.h"
#include "view_poses.h"

namespace kincal {
namespace {

constexpr double kFar = 0.35;      // rad: beyond this two angles do not agree, however far
constexpr double kMargin = 0.1;    // rad a pair, by which the second best must be worse
constexpr size_t kPartners = 100;  // that a view is compared with

/// A NumberedView is a view of a group, all of one camera and one board on one link.
struct NumberedView {
  int sample, view;
  bool fixed;
  Pose camera_T_board, link_T_link;  // B and C of the head of the header
  int turn = 0;                      // place in the group's turns
  bool decided = true;
};

struct NumberedGroup {
  std::vector<NumberedView> views;
  std::vector<int> quarters;    // that look alike, of 4
  std::vector<Pose> turns;      // what undoes each: B T
  const Pose* board = nullptr;  // Z as the rig gives it; null: it does not
  std::optional<Pose> found;    // Z
};

double angle_of(const Pose& t) { return log_so3(t.rotation).norm(); }

int turned_by(const NumberedGroup& group, int turn, int more) {
  const int n = static_cast<int>(group.turns.size());
  return ((turn + more) % n + n) % n;
}

/// Turns of the board about its middle, evenly spaced: the first is none.
std::vector<Pose> turns_of(const Target& target, const std::vector<int>& quarters) {
  Vector3d middle = target_points(target).rowwise().mean();
  std::vector<Pose> out;
  for (const int q : quarters) {
    Pose turn;
    turn.rotation = exp_so3(Vector3d(0, 0, -q * kPi / 2));
    turn.translation = middle - turn.rotation * middle;
    out.push_back(turn);
  }
  return out;
}

/// How badly views i and j agree if i is turned by `d` more than j.
double disagreement(const NumberedGroup& group, size_t i, size_t j, int d) {
  const NumberedView &a = group.views[i], &b = group.views[j];
  const double moved = angle_of(inverse(b.link_T_link) * a.link_T_link);
  const double seen =
      angle_of(inverse(b.camera_T_board) * a.camera_T_board * group.turns[turned_by(group, d, 0)]);
  return std::min(kFar, std::abs(moved - seen));
}

/// Disagreements of each view with some others, for all turns: [view][partner][d].
struct Disagreements {
  std::vector<std::vector<size_t>> partners;
  std::vector<std::vector<std::vector<double>>> cost;
};

Disagreements disagreements(const NumberedGroup& group) {
  Disagreements out;
  const size_t n = group.views.size(), stride = std::max<size_t>(1, n / kPartners);
  for (size_t i = 0; i < n; ++i) {
    out.partners.emplace_back();
    out.cost.emplace_back();
    for (size_t k = 1; k < n; k += stride) {
      const size_t j = (i + k) % n;
      out.partners.back().push_back(j);
      std::vector<double> one;
      for (size_t d = 0; d < group.turns.size(); ++d)
        one.push_back(disagreement(group, i, j, static_cast<int>(d)));
      out.cost.back().push_back(one);
    }
  }
  return out;
}

/// The mean disagreement of view i with its partners, for each turn of it.
std::vector<double> costs_of(const NumberedGroup& group, const Disagreements& all, size_t i) {
  std::vector<double> out(group.turns.size(), 0);
  for (size_t k = 0; k < all.partners[i].size(); ++k)
    for (size_t t = 0; t < out.size(); ++t) {
      const int d = turned_by(group, static_cast<int>(t), -group.views[all.partners[i][k]].turn);
      out[t] +=
          all.cost[i][k][static_cast<size_t>(d)] / static_cast<double>(all.partners[i].size());
    }
  return out;
}

int least_of(const std::vector<double>& costs) {
  return static_cast<int>(std::min_element(costs.begin(), costs.end()) - costs.begin());
}

/// All views as they agree with one of them, then one after the other with all; returns the sum of
/// what is left.
double agree_from(NumberedGroup& group, const Disagreements& all, size_t start) {
  const int first = group.views[start].fixed ? 0 : group.views[start].turn;
  for (size_t i = 0; i < group.views.size(); ++i) {
    NumberedView& view = group.views[i];
    std::vector<double> costs;
    for (size_t t = 0; t < group.turns.size(); ++t)
      costs.push_back(disagreement(group, i, start, static_cast<int>(t) - first));
    view.turn = view.fixed ? 0 : i == start ? first : least_of(costs);
  }
  double sum = 0;
  bool changed = true;
  for (int round = 0; changed && round < 20; ++round) {
    changed = false;
    sum = 0;
    for (size_t i = 0; i < group.views.size(); ++i) {
      NumberedView& view = group.views[i];
      const std::vector<double> costs = costs_of(group, all, i);
      const int best = view.fixed ? 0 : least_of(costs);
      changed = changed || best != view.turn;
      view.turn = best;
      sum += costs[static_cast<size_t>(best)];
      view.decided = true;
      for (size_t t = 0; t < costs.size(); ++t)
        if (static_cast<int>(t) != best && costs[t] < costs[static_cast<size_t>(best)] + kMargin)
          view.decided = view.fixed;
    }
  }
  return sum;
}

/// Finds X and Z, and gives each view the numbers that leave the least. Views that angles alone did
/// not decide may be by now.
void place_group(NumberedGroup& group) {
  for (int round = 0; round < 3; ++round) {
    std::vector<Pose> a, b;
    for (const NumberedView& view : group.views) {
      a.push_back(view.link_T_link);
      b.push_back(view.camera_T_board * group.turns[static_cast<size_t>(view.turn)]);
    }
    Pose x, y;
    if (!robust_robot_world_hand_eye(a, b, x, y)) return;
    group.found = x;
    bool changed = false;
    for (size_t i = 0; i < group.views.size(); ++i) {
      NumberedView& view = group.views[i];
      std::vector<double> left;
      for (const Pose& turn : group.turns)
        left.push_back(angle_of(inverse(y * view.camera_T_board * turn) * (a[i] * x)));
      const int best = view.fixed ? 0 : least_of(left);
      if (left[static_cast<size_t>(best)] > kFar) continue;  // a view that fits in no way
      changed = changed || best != view.turn;
      view.turn = best;
      view.decided = true;
    }
    if (!changed) return;
  }
}

/// The turn of all views alike.
void turn_all(NumberedGroup& group, int more) {
  for (NumberedView& view : group.views) view.turn = turned_by(group, view.turn, more);
  if (group.found) *group.found = *group.found * group.turns[static_cast<size_t>(more)];
}

/// What shows only in the board's pose: as the rig or another camera has it, else as most pictures
/// are numbered.
void settle_all(NumberedGroup& group, const std::optional<Pose>& board) {
  for (const NumberedView& view : group.views)
    if (view.fixed) return;
  std::vector<double> cost(group.turns.size(), 0);
  for (size_t t = 0; t < cost.size(); ++t) {
    if (group.found && board)
      cost[t] = angle_of(inverse(*board) * *group.found * group.turns[t]);
    else
      for (const NumberedView& view : group.views)
        cost[t] += turned_by(group, view.turn, static_cast<int>(t)) != 0;
  }
  turn_all(group, least_of(cost));
}

/// The camera's views of mounted and held boards, by camera, board and the board's link.
std::map<std::tuple<int, int, int>, NumberedGroup> groups_of_views(
    const Rig& rig, const ParameterTable& table, const std::vector<Sample>& samples,
    const std::map<int, std::vector<int>>& open, const std::set<std::pair<int, int>>& fixed) {
  std::map<std::tuple<int, int, int>, NumberedGroup> groups;
  for (size_t s = 0; s < samples.size(); ++s) {
    std::map<int, int> holders;
    for (const View& view : samples[s].views)
      if (rig.sensors[view.sensor].model->measurement_kind() == MeasurementKind::chain)
        holders[view.target] = view.sensor;
    for (size_t v = 0; v < samples[s].views.size(); ++v) {
      const View& view = samples[s].views[v];
      const Sensor& sensor = rig.sensors[view.sensor];
      const Target& target = rig.targets[view.target];
      const auto turns = open.find(view.target);
      const auto holder = holders.find(view.target);
      if (turns == open.end() || sensor.model->measurement_kind() != MeasurementKind::rays ||
          (target.link < 0 && holder == holders.end()))
        continue;
      const Sensor* hand = target.link < 0 ? &rig.sensors[holder->second] : nullptr;
      const int link = hand ? hand->link : target.link;
      const std::vector<int> ids = view_ids(view, target);
      std::vector<int> keep;
      const Matrix3Xd xy1 =
          seen_directions(rig, table, table.initial, view, static_cast<int>(ids.size()), keep);
      NumberedView one{static_cast<int>(s), static_cast<int>(v),
                       fixed.count({static_cast<int>(s), static_cast<int>(v)}) > 0, Pose(), Pose()};
      const Matrix3Xd points = select_columns(select_columns(target_points(target), ids), keep);
      if (!pose_from_directions(points, xy1, one.camera_T_board)) continue;
      one.link_T_link =
          Configuration(rig, table, table.initial, samples[s].readings).a_T_b(sensor.link, link);
      NumberedGroup& group = groups[{view.target, link, view.sensor}];
      group.quarters = turns->second;
      group.turns = turns_of(target, turns->second);
      if (hand ? hand->pose_given : target.pose_given)
        group.board = hand ? &hand->link_T_sensor : &target.link_T_target;
      group.views.push_back(one);
    }
  }
  return groups;
}

}  // namespace

std::vector<ViewTurn> agreeing_numbers(const Rig& rig, const std::vector<Sample>& samples,
                                       const std::map<int, std::vector<int>>& open,
                                       const std::vector<std::pair<int, int>>& fixed) {
  const ParameterTable table(rig);
  std::vector<ViewTurn> out;
  std::map<std::pair<int, int>, Pose> boards;  // by target and link, as the first camera has them
  for (auto& [key, group] :
       groups_of_views(rig, table, samples, open, {fixed.begin(), fixed.end()})) {
    if (group.views.size() < 3) continue;
    const Disagreements all = disagreements(group);
    NumberedGroup best;
    double least = 1e300;
    const size_t stride = std::max<size_t>(1, group.views.size() / 20);
    for (size_t start = 0; start < group.views.size(); start += stride) {
      NumberedGroup trial = group;
      const double sum = agree_from(trial, all, start);
      if (sum < least - 1e-9) least = sum, best = trial;
    }
    place_group(best);
    const std::pair<int, int> place{std::get<0>(key), std::get<1>(key)};
    std::optional<Pose> board;
    if (best.board) board = *best.board;
    if (!board && boards.count(place)) board = boards[place];
    settle_all(best, board);
    if (best.found) boards.emplace(place, *best.found);
    for (const NumberedView& view : best.views)
      out.push_back(
          {view.sample, view.view, best.quarters[static_cast<size_t>(view.turn)], view.decided});
  }
  return out;
}

}  // namespace kincal
