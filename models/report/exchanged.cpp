#include "exchanged.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "../automatic/groups.h"
#include "../rig/configuration.h"
#include "../rig/words.h"
#include "bent_boards.h"

namespace kincal {

std::vector<Finding> exchanged_cameras(const Solution& solution) {
  constexpr double kNear = 0.25, kFar = 0.75, kLeast = 0.01;  // of the distance; m
  const Rig& rig = solution.rig();
  const std::vector<double> readings(rig.tree.joints.size(), 0.0);
  const Configuration given(rig, solution.table(), solution.table().initial, readings);
  const Configuration found(rig, solution.table(), solution.values.shared, readings);
  std::vector<Finding> out;
  for (size_t a = 0; a < rig.sensors.size(); ++a)
    for (size_t b = a + 1; b < rig.sensors.size(); ++b) {
      const Sensor &first = rig.sensors[a], &second = rig.sensors[b];
      if (first.type != "camera" || second.type != "camera" || !first.pose_given ||
          !second.pose_given)
        continue;
      const auto at = [](const Configuration& robot, size_t sensor) {
        return robot.base_T_sensor(static_cast<int>(sensor)).translation;
      };
      const Vector3d given_a = at(given, a), given_b = at(given, b), found_a = at(found, a),
                     found_b = at(found, b);
      const double distance = (given_a - given_b).norm();
      const auto near = [&](const Vector3d& x, const Vector3d& other, const Vector3d& own) {
        return (x - other).norm() < kNear * distance && (x - own).norm() > kFar * distance;
      };
      if (distance < kLeast || !near(found_a, given_b, given_a) || !near(found_b, given_a, given_b))
        continue;
      out.push_back({"swapped-cameras",
                     "Cameras " + quoted(first.name) + " and " + quoted(second.name) +
                         " are exchanged: each was found where the rig has the other, " +
                         text("%.3g m", distance) +
                         " away. Exchange the two names, in the rig or in the views.",
                     {first.name, second.name},
                     {},
                     {}});
    }
  return out;
}

namespace {

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

}  // namespace

std::vector<Finding> pairs_apart(const Solution& solution) {
  constexpr double kMeasured = 0.03, kSigmas = 5;  // share of the baseline
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  solution.refresh();
  std::vector<Finding> out;
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
      if (!(std::abs(apart) > std::max(kMeasured * std::abs(given), kSigmas * sigma)) ||
          seen * given <= 0)
        continue;
      const Sensor &first = rig.sensors[a], &second = rig.sensors[b];
      const std::string right = given > 0 ? second.name : first.name;
      out.push_back(
          {"baseline",
           "Cameras " + quoted(first.name) + " and " + quoted(second.name) +
               " are one pair at one place in the rig, but were found " +
               length_text(std::abs(apart)) +
               text(" apart along their baseline: the rig says %.5g m, the data say %.5g m (times "
                    "%.4g). ",
                    std::abs(given), std::abs(seen), seen / given) +
               "Measure it, and correct the baseline of camera " + quoted(right) +
               ": else depths of the pair are wrong by as much.",
           {right},
           {},
           {}});
    }
  return out;
}

std::vector<Finding> not_as_given(const Solution& solution, const Residuals& residuals) {
  std::vector<Finding> out = exchanged_cameras(solution);
  if (out.empty()) out = pairs_apart(solution);
  if (out.empty()) out = bent_boards(solution, residuals);
  return out;
}

}  // namespace kincal
