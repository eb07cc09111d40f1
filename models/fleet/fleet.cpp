#include "fleet.h"

#include <algorithm>
#include <map>

namespace kincal {

FleetFindings study_fleet(const std::vector<FleetNumber>& numbers,
                          const std::vector<FleetResult>& results, const FleetOptions& options) {
  FleetFindings out;
  VectorXd scale(static_cast<Eigen::Index>(numbers.size()));
  for (size_t c = 0; c < numbers.size(); ++c)
    scale(static_cast<Eigen::Index>(c)) = numbers[c].scale;
  std::map<std::string, std::vector<int>> of;
  for (size_t i = 0; i < results.size(); ++i) of[results[i].serial].push_back(static_cast<int>(i));
  std::vector<Evidence> latest;
  for (auto& [serial, own] : of) {
    std::stable_sort(own.begin(), own.end(),
                     [&](int a, int b) { return results[a].time < results[b].time; });
    latest.push_back(results[own.back()].evidence);
    FleetRobot robot;
    robot.serial = serial;
    robot.results = own;
    if (own.size() > 1) {
      std::vector<Evidence> evidence;
      std::vector<double> times;
      for (const int i : own) {
        evidence.push_back(without_numbers(results[i].over_time, options.anew));
        times.push_back(results[i].time);
      }
      robot.drift = find_drift(evidence, times, scale, options.level);
      robot.p = robot.drift->p;
    }
    out.robots.push_back(std::move(robot));
  }
  out.family = judge_family(latest, scale);
  for (size_t i = 0; i < out.robots.size(); ++i) {
    FleetRobot& robot = out.robots[i];
    if (out.family.judged) {
      robot.member = out.family.members[i];
      robot.out_of_family = robot.member->p < options.level;
      robot.p = std::min(robot.p, robot.member->p);
    }
    out.out_of_family += robot.out_of_family;
    out.drifting += robot.drifts();
  }
  std::stable_sort(out.robots.begin(), out.robots.end(),
                   [](const FleetRobot& a, const FleetRobot& b) { return a.p < b.p; });
  return out;
}

}  // namespace kincal
