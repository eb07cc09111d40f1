#include "exchanged.h"

#include "../rig/configuration.h"
#include "../rig/words.h"

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

}  // namespace kincal
