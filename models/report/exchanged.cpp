#include "exchanged.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "../automatic/groups.h"
#include "../rig/configuration.h"
#include "../rig/scales.h"
#include "../rig/words.h"
#include "bent_boards.h"

namespace kincal {

namespace {

// rad: rough poses are less far off. It only asks for a search. (Of 280 right recordings none was
// given a mistake.)
constexpr double kTurned = 1;

/// Something with a place in the base frame, as given and as found.
struct Placed {
  std::string name, kind;  // of one kind only may be in each other's place
  Vector3d given, found;
};

/// Pairs of which each was found where the other was given.
Notices in_each_others_place(const std::vector<Placed>& all, NoticeKind kind, Subject::Kind of,
                             const char* what, const char* cure) {
  constexpr double kNear = 0.35, kFar = 0.75, kLeast = 0.01;  // of the distance; m
  Notices out;
  for (size_t a = 0; a < all.size(); ++a)
    for (size_t b = a + 1; b < all.size(); ++b) {
      const Placed &first = all[a], &second = all[b];
      const double distance = (first.given - second.given).norm();
      const auto at_the_other = [&](const Placed& x, const Placed& other) {
        return (x.found - other.given).norm() < kNear * distance &&
               (x.found - x.given).norm() > kFar * distance;
      };
      if (first.kind != second.kind || distance < kLeast || !at_the_other(first, second) ||
          !at_the_other(second, first))
        continue;
      out.push_back(make_notice(kind, subjects(of, {first.name, second.name}),
                                what + quoted(first.name) + " and " + quoted(second.name) +
                                    " are exchanged: each was found where the rig has the other, " +
                                    text("%.3g m", distance) + " away",
                                "", cure));
    }
  return out;
}

Notices exchanged_things(const Solution& solution) {
  const Rig& rig = solution.rig();
  const std::vector<double> readings(rig.tree.joints.size(), 0.0);
  const Configuration given(rig, solution.table(), solution.table().initial, readings);
  const Configuration found(rig, solution.table(), solution.values.shared, readings);
  std::vector<Placed> cameras, targets;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    const int i = static_cast<int>(s);
    if (sensor.type == "camera" && sensor.pose_given)
      cameras.push_back({sensor.name, sensor.type, given.base_T_sensor(i).translation,
                         found.base_T_sensor(i).translation});
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const Target& target = rig.targets[t];
    const int i = static_cast<int>(t);
    if (target.link >= 0 && target.pose_given)
      targets.push_back({target.name, target.type + std::to_string(target.count()),
                         given.base_T_target(i).translation, found.base_T_target(i).translation});
  }
  Notices out =
      in_each_others_place(cameras, NoticeKind::swapped_cameras, Subject::Kind::sensor, "cameras ",
                           "exchange the two names, in the rig or in the views");
  for (Notice& finding : in_each_others_place(targets, NoticeKind::exchanged_targets,
                                              Subject::Kind::target, "targets ",
                                              "exchange the two names, or the ids of their "
                                              "markers, in the rig; or correct their poses"))
    out.push_back(std::move(finding));
  return out;
}

/// Where a pose's x stands in the covariance; nothing: it was not free.
std::optional<Eigen::Index> column_of_x(const Solution& solution, int parameter) {
  for (size_t i = 0; i < solution.columns.size(); ++i)
    if (solution.columns[i].parameter == parameter && solution.columns[i].index == 0)
      return static_cast<Eigen::Index>(i);
  return std::nullopt;
}

double found_baseline(const Solution& solution, size_t camera) {
  const int p = solution.table().index_of(ParameterKind::baseline, static_cast<int>(camera));
  return p < 0 ? 0 : solution.values.shared(solution.table().all[p].start);
}

Notices pairs_apart(const Solution& solution) {
  constexpr double kSigmas = 5;
  const double mistaken = scales(ParameterKind::baseline, "m").mistaken;  // share
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  Notices out;
  for (size_t a = 0; a < rig.sensors.size(); ++a)
    for (size_t b = a + 1; b < rig.sensors.size(); ++b) {
      if (!is_pair(rig, static_cast<int>(a), static_cast<int>(b))) continue;
      const int pose_a = table.sensor_pose[a], pose_b = table.sensor_pose[b];
      const auto i = column_of_x(solution, pose_a), k = column_of_x(solution, pose_b);
      if (!i || !k) continue;
      const MatrixXd& c = solution.covariance;
      const double sigma = std::sqrt(c(*i, *i) + c(*k, *k) - 2 * c(*i, *k));
      const VectorXd& values = solution.values.shared;
      const double apart = (inverse(get_pose(values, table.all[pose_a].start)) *
                            get_pose(values, table.all[pose_b].start))
                               .translation.x(),
                   given = found_baseline(solution, b) - found_baseline(solution, a),
                   seen = given + apart;
      if (!(std::abs(apart) > std::max(mistaken * std::abs(given), kSigmas * sigma)) ||
          seen * given <= 0)
        continue;
      const Sensor &first = rig.sensors[a], &second = rig.sensors[b];
      const std::string right = given > 0 ? second.name : first.name;
      out.push_back(make_notice(NoticeKind::baseline, {Subject::sensor(right)},
                                "cameras " + quoted(first.name) + " and " + quoted(second.name) +
                                    " are one pair at one place in the rig, but were found " +
                                    length_text(std::abs(apart)) +
                                    text(" apart along their baseline: %.5g m in the rig, %.5g m "
                                         "from the data (times %.4g)",
                                         std::abs(given), std::abs(seen), seen / given),
                                "",
                                "measure it, and correct the baseline of camera " + quoted(right) +
                                    ": otherwise depths of the pair are wrong by the same factor"));
    }
  return out;
}

Notices seen_from_behind(const Solution& solution) {
  constexpr int kFewest = 3;
  const Rig& rig = solution.rig();
  std::vector<int> views(rig.targets.size(), 0), behind(rig.targets.size(), 0);
  for (const Sample& sample : solution.samples()) {
    if (!sample.train) continue;
    const std::vector<double> readings = completed(sample.readings);
    const Configuration at(rig, solution.table(), solution.values.shared, readings);
    for (const View& v : sample.views) {
      const Target& target = rig.targets[v.target];
      if (target.type != "marker" || target.link < 0 || rig.sensors[v.sensor].type != "camera")
        continue;
      ++views[v.target];
      const Vector3d eye =
          inverse(at.base_T_target(v.target)) * at.base_T_sensor(v.sensor).translation;
      behind[v.target] += eye.z() < 0;
    }
  }
  Notices out;
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (views[t] >= kFewest && behind[t] == views[t])
      out.push_back(make_notice(
          NoticeKind::mirrored, {Subject::target(rig.targets[t].name)},
          "marker " + quoted(rig.targets[t].name) + " is seen from behind in all " +
              std::to_string(views[t]) +
              " views, which is impossible: its corners are numbered counter-clockwise, or the "
              "images are mirrored",
          "", "list its corners clockwise as seen from the front, starting at the upper left one"));
  return out;
}

}  // namespace

Notices not_as_given(const Solution& solution, const Residuals& residuals) {
  Notices out = exchanged_things(solution);
  if (out.empty()) out = seen_from_behind(solution);
  if (out.empty()) out = pairs_apart(solution);
  if (out.empty() && !solution.prediction)  // (the automatic path tries warps)
    out = bent_boards(solution, residuals);
  return out;
}

bool is_a_given_pose_turned(const Solution& solution) {
  return std::any_of(
      solution.parameters.begin(), solution.parameters.end(), [&](const ParameterEstimate& e) {
        return e.pose && is_given(solution.rig(), solution.table().all[e.parameter]) &&
               std::hypot(e.value[3], e.value[4], e.value[5]) > kTurned;
      });
}

}  // namespace kincal
