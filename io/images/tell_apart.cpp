#include "tell_apart.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "../../models/fitting/closed_form.h"
#include "../../models/fitting/view_poses.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/targets.h"
#include "../../models/rig/words.h"
#include "../document/error.h"
#include "../rig/samples_file.h"
#include "renumber.h"

namespace kincal {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kTimes = 2;      // as far as the way that is taken the next one is at least
constexpr size_t kMostEqual = 6;  // targets: of so many all ways are tried

/// A Lineup is what one picture may show of targets of one print, as the robot has them.
struct Lineup {
  std::vector<size_t> places;  // in the picture's list of wanted targets
  int sensor = -1;
  std::vector<int> targets;
  std::vector<int> turns;  // quarters after which the print is the same picture
  const std::vector<double>* readings = nullptr;
};

template <typename T>
int index_of(const std::vector<T>& all, const std::string& name) {
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const T& one) { return one.name == name; });
  return static_cast<int>(found - all.begin());
}

/// The joint readings of each sample.
std::vector<Sample> postures_of(const RigFile& rig, const std::vector<Json>& samples) {
  std::string text;
  for (const Json& sample : samples)
    text += Json{{"id", sample["id"]},
                 {"joints", sample.value("joints", Json::object())},
                 {"views", Json::array()}}
                .dump() +
            "\n";
  return parse_samples(text, "joint readings", rig.rig);
}

std::vector<Lineup> lineups_of(const RigFile& rig, const std::vector<Json>& samples,
                               const std::vector<Sample>& postures, const ImageTask& task) {
  std::vector<Lineup> out;
  for (std::vector<size_t>& group : by_print(task)) {
    if (group.size() < 2) continue;
    const ImageTask::Wanted& first = task.wanted[group[0]];
    const auto s = static_cast<size_t>(first.sample), v = static_cast<size_t>(first.view);
    Lineup one;
    one.sensor = index_of(rig.rig.sensors, samples[s]["views"][v]["sensor"].get<std::string>());
    one.turns = open_turns(*first.target);
    one.readings = &postures[s].readings;
    for (const size_t i : group)
      one.targets.push_back(index_of(rig.rig.targets, task.wanted[i].target->name));
    one.places = std::move(group);
    out.push_back(std::move(one));
  }
  return out;
}

/// Why the robot does not say where the targets are before the camera; "": it does.
std::string not_told(const Rig& rig, const Lineup& lineup) {
  const Sensor& camera = rig.sensors[lineup.sensor];
  if (!(camera.pose_of < 0 ? camera : rig.sensors[camera.pose_of]).pose_given)
    return "the rig has no pose of '" + camera.name + "'";
  for (const int t : lineup.targets) {
    if (rig.targets[t].link < 0) return "target '" + rig.targets[t].name + "' is free";
    if (!rig.targets[t].pose_given) return "the rig has no pose of '" + rig.targets[t].name + "'";
  }
  if (lineup.targets.size() > kMostEqual)
    return "there are more than " + std::to_string(kMostEqual) + " such targets";
  for (const int t : lineup.targets)
    for (const int j : joints_between(rig, rig.sensors[lineup.sensor].link, rig.targets[t].link))
      if (std::isnan((*lineup.readings)[j]))
        return "joint '" + rig.tree.joints[j].name + "' has no reading";
  return "";
}

/// A BoardSight is the directions in which a camera has the points of a board.
struct BoardSight {
  std::vector<int> ids;
  Matrix3Xd directions;  // unit vectors
  double width = 0;      // rad, about
};

BoardSight sight_of(const Rig& rig, const ParameterTable& table, const Lineup& lineup,
                    const Detection& found) {
  View view;
  view.sensor = lineup.sensor;
  view.target = lineup.targets[0];
  for (const cv::Point2d& p : found.pixels) view.z.insert(view.z.end(), {p.x, p.y});
  std::vector<int> keep;
  BoardSight out;
  out.directions =
      seen_directions(rig, table, table.initial, view, static_cast<int>(found.ids.size()), keep);
  out.directions.colwise().normalize();
  for (const int i : keep) out.ids.push_back(found.ids[static_cast<size_t>(i)]);
  if (keep.empty()) return out;
  const Vector3d middle = out.directions.rowwise().mean();
  out.width = 2 * (out.directions.colwise() - middle).colwise().norm().maxCoeff();
  return out;
}

/// How far a board is from where the robot has a target: squared, mean over its points.
double squared_distance(const Rig& rig, const ParameterTable& table, const Lineup& lineup,
                        int target, const BoardSight& sight) {
  const Configuration robot(rig, table, table.initial, *lineup.readings);
  const Pose camera_T_target =
      inverse(robot.link_T_sensor(lineup.sensor)) *
      robot.a_T_b(rig.sensors[lineup.sensor].link, rig.targets[target].link) *
      get_pose(table.initial, table.all[table.target_pose[target]].start);
  const Matrix3Xd all = target_points(rig.targets[target]);
  const Vector3d middle = all.rowwise().mean();
  double least = 1e9;
  for (const int quarters : lineup.turns) {
    const Matrix3d turn = exp_so3(Vector3d(0, 0, quarters * kPi / 2));
    Matrix3Xd points = select_columns(all, sight.ids);
    points = (turn * (points.colwise() - middle)).colwise() + middle;
    points = (camera_T_target.rotation * points).colwise() + camera_T_target.translation;
    points.colwise().normalize();
    least = std::min(least, (points - sight.directions).colwise().squaredNorm().mean());
  }
  return least;
}

/// A Way gives each board of a picture a target, by places in the lineup.
struct Way {
  std::vector<size_t> target;
  std::vector<std::string> doubt;  // why a board is not told; "": it is
};

/// The way that leaves least of squared distances, [board][target].
Way best_way(const std::vector<std::vector<double>>& squared,
             const std::vector<BoardSight>& sights) {
  const size_t boards = squared.size(), targets = squared[0].size();
  std::vector<size_t> order(targets), best;
  const auto sum = [&](const std::vector<size_t>& way) {
    double out = 0;
    for (size_t k = 0; k < boards; ++k) out += squared[k][way[k]];
    return out;
  };
  std::iota(order.begin(), order.end(), size_t{0});
  best = order;
  do
    if (sum(order) < sum(best)) best = order;
  while (std::next_permutation(order.begin(), order.end()));
  Way out{best, std::vector<std::string>(boards)};
  for (size_t k = 0; k < boards; ++k) {
    double other = 1e9;
    do
      if (order[k] != best[k]) other = std::min(other, sum(order));
    while (std::next_permutation(order.begin(), order.end()));
    const double n = static_cast<double>(boards), own = std::sqrt(squared[k][best[k]]);
    if (own > sights[k].width)
      out.doubt[k] = text("it is %.2g rad from its predicted place, but only %.2g rad wide", own,
                          sights[k].width);
    else if (!(kTimes * kTimes * sum(best) <= other))
      out.doubt[k] = text(
          "the likeliest targets are %.2g rad from their predicted places, the next ones %.2g rad",
          std::sqrt(sum(best) / n), std::sqrt(other / n));
  }
  return out;
}

void tell(const Rig& rig, const ParameterTable& table, const Lineup& lineup, ImageTask& task) {
  std::vector<Detection> boards;
  for (const size_t place : lineup.places) {
    Detection& found = task.wanted[place].found;
    if (found.ids.empty()) continue;
    boards.push_back(std::move(found));
    found = {};
    found.reason = "of its print only another target's board is there";
  }
  if (boards.empty()) return;
  const auto refuse = [&](const std::string& cause) {
    for (const size_t place : lineup.places)
      if (Detection& found = task.wanted[place].found; found.ids.empty())
        found.reason = "there is a board that cannot be identified as this one: " + cause;
  };
  if (const std::string cause = not_told(rig, lineup); !cause.empty()) return refuse(cause);
  std::vector<BoardSight> sights;
  std::vector<std::vector<double>> squared;
  for (const Detection& board : boards) {
    sights.push_back(sight_of(rig, table, lineup, board));
    squared.emplace_back();
    for (const int t : lineup.targets)
      squared.back().push_back(
          sights.back().ids.empty() ? 1e9 : squared_distance(rig, table, lineup, t, sights.back()));
  }
  const Way way = best_way(squared, sights);
  std::string doubt;
  for (size_t k = 0; k < boards.size(); ++k)
    if (way.doubt[k].empty())
      task.wanted[lineup.places[way.target[k]]].found = std::move(boards[k]);
    else
      doubt = way.doubt[k];
  if (!doubt.empty()) refuse(doubt);
}

bool any_equal(const std::vector<ImageTask>& tasks) {
  return std::any_of(tasks.begin(), tasks.end(), [](const ImageTask& task) {
    return by_print(task).size() < task.wanted.size();
  });
}

}  // namespace

std::vector<std::vector<size_t>> by_print(const ImageTask& task) {
  std::vector<std::vector<size_t>> out;
  for (size_t i = 0; i < task.wanted.size(); ++i) {
    const auto group = std::find_if(out.begin(), out.end(), [&](const std::vector<size_t>& one) {
      return same_print(*task.wanted[one[0]].target, *task.wanted[i].target);
    });
    if (group == out.end())
      out.push_back({i});
    else
      group->push_back(i);
  }
  return out;
}

void refuse_alike(const RigFile& rig, const std::vector<Json>& samples,
                  const std::vector<ImageTask>& tasks) {
  const auto refuse = [](const ImageTask& task, const std::string& a, const std::string& b,
                         const std::string& cause) {
    throw InputError(task.shown + ": targets '" + a + "' and '" + b +
                     "' look the same in an image, so the one seen cannot be identified" + cause +
                     ": give each its own markers (dictionary, id, first_id), or write samples "
                     "whose views name the target in each image");
  };
  for (const ImageTask& task : tasks)
    for (const ImageTask::Wanted& a : task.wanted)
      for (const ImageTask::Wanted& b : task.wanted)
        if (a.target->name < b.target->name && look_alike(*a.target, *b.target) &&
            !same_print(*a.target, *b.target))
          refuse(task, a.target->name, b.target->name, "");
  if (!any_equal(tasks)) return;
  const std::vector<Sample> postures = postures_of(rig, samples);
  for (const bool last : {false, true})  // if one picture can be told, the others are left out
    for (const ImageTask& task : tasks)
      for (const Lineup& lineup : lineups_of(rig, samples, postures, task)) {
        const std::string cause = not_told(rig.rig, lineup);
        if (cause.empty()) return;
        if (last)
          refuse(task, task.wanted[lineup.places[0]].target->name,
                 task.wanted[lineup.places[1]].target->name,
                 ", not even by the joint readings (" + cause + ")");
      }
}

void tell_apart(const RigFile& rig, const std::vector<Json>& samples,
                std::vector<ImageTask>& tasks) {
  if (!any_equal(tasks)) return;
  const ParameterTable table(rig.rig);
  const std::vector<Sample> postures = postures_of(rig, samples);
  for (ImageTask& task : tasks)
    for (const Lineup& lineup : lineups_of(rig, samples, postures, task))
      tell(rig.rig, table, lineup, task);
}

}  // namespace kincal
