#include "random_postures.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <stdexcept>

#include "../rig/configuration.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr int kTrials = 1000, kReaches = 20;  // a sample

/// Does the posture move the target relative to the sensor? A scanning joint is no part of the
/// posture.
bool moves_between(const Rig& rig, int sensor, int target) {
  const Sensor& s = rig.sensors[sensor];
  const int link = rig.targets[target].link >= 0 ? rig.targets[target].link : rig.base;
  return !joints_between(rig, s.link, link, s.scanning_joint).empty();
}

std::vector<PostureGroup> groups_of(const Rig& rig, const std::vector<SensorTarget>& pairs) {
  std::vector<PostureGroup> groups;
  PostureGroup mounted{-1, -1, {}};
  for (int t = 0; t < static_cast<int>(rig.targets.size()); ++t) {
    std::vector<int> holders;
    std::vector<SensorTarget> observers;
    for (const SensorTarget& p : pairs) {
      if (p.second != t) continue;
      if (is_chain(rig.sensors[p.first]))
        holders.push_back(p.first);
      else
        observers.push_back(p);
    }
    if (rig.targets[t].link >= 0) {
      mounted.observers.insert(mounted.observers.end(), observers.begin(), observers.end());
      continue;
    }
    if (observers.empty()) continue;
    if (holders.empty()) holders.push_back(-1);
    for (int h : holders) groups.push_back({t, h, observers});
  }
  if (!mounted.observers.empty()) groups.push_back(mounted);
  return groups;
}

}  // namespace

RandomPostures::RandomPostures(const Rig& rig, const World& world,
                               const std::vector<SensorTarget>& pairs, std::uint64_t seed,
                               int samples)
    : rig_(rig),
      world_(world),
      pairs_(pairs),
      seed_(seed),
      samples_(samples),
      groups_(groups_of(rig, pairs)),
      draws_(seed, kPostureStream) {
  if (groups_.empty())
    throw std::invalid_argument(
        "no sensor of this rig sees a target; a chain only holds one, and needs another sensor "
        "that sees it");
  std::set<int> joints;
  for (const SensorTarget& p : pairs)
    for (int j : needed_readings(rig, p.first, p.second)) joints.insert(j);
  joints_.assign(joints.begin(), joints.end());
  for (const SensorTarget& p : pairs)
    if (rig.targets[p.second].link >= 0 && moves_between(rig, p.first, p.second)) moving_.insert(p);
}

Draft RandomPostures::next(int k) {
  const PostureGroup& group = groups_[k % groups_.size()];
  const SensorTarget goal = group.observers[(k / groups_.size()) % group.observers.size()];
  const std::pair<int, SensorTarget> effort{group.holder, goal};
  const auto reached = [&]() -> std::optional<Draft> {
    for (int i = 0; i < kReaches; ++i)
      if (std::optional<Draft> draft = reach(k, group, goal)) return draft;
    return std::nullopt;
  };
  if (reached_.count(goal))
    if (std::optional<Draft> draft = reached()) return *draft;
  for (int i = 0; i < kTrials && !failed_goals_.count(effort); ++i)
    if (std::optional<Draft> draft = attempt(k, group, &goal)) return *draft;
  failed_goals_.insert(effort);
  long relaxed = 0;
  while (relaxed_ < static_cast<long>(kTrials) * samples_) {
    ++relaxed_;
    if (std::optional<Draft> draft = attempt(k, group, nullptr)) return *draft;
    if (++relaxed % kTrials == 0 && group.target < 0) {
      if (std::optional<Draft> draft = reached()) {
        reached_.insert(goal);
        return *draft;
      }
    }
  }
  give_up(group);
}

Posture RandomPostures::random_posture(int k) {
  Posture posture;
  posture.id = std::to_string(k);
  posture.id =
      "sample_" + std::string(posture.id.size() < 4 ? 4 - posture.id.size() : 0, '0') + posture.id;
  posture.readings.assign(rig_.tree.joints.size(), kNan);
  for (int j : joints_) {
    const auto [low, high] = usual_range(rig_.tree.joints[j]);
    posture.readings[j] = draws_.uniform(low, high);
  }
  posture.conditions = draw_conditions(rig_, seed_, k);
  return posture;
}

/// A sample if a random posture shows enough, and the goal if there is one.
std::optional<Draft> RandomPostures::attempt(int k, const PostureGroup& group,
                                             const SensorTarget* goal) {
  ++trials_;
  Posture posture = random_posture(k);
  if (group.holder < 0 && group.target >= 0) {
    Sample robot;
    robot.readings = posture.readings;
    robot.conditions = posture.conditions;
    const int before =
        goal ? goal->first : group.observers[draws_.index(group.observers.size())].first;
    posture.targets[group.target] = world_.place(robot, before, group.target, draws_);
  }
  return carry_out(posture, group, goal,
                   RandomStream(seed_, kFirstSampleStream + static_cast<std::uint64_t>(k)));
}

/// A sample if joints can be moved so that the goal is seen, from a random posture on.
std::optional<Draft> RandomPostures::reach(int k, const PostureGroup& group,
                                           const SensorTarget& goal) {
  constexpr int kSteps = 40;
  constexpr double kDifference = 1e-6, kDamping = 1e-3;  // rad or m; of m and rad alike
  ++trials_;
  Posture posture = random_posture(k);
  const std::vector<int> moving =
      joints_between(rig_, rig_.sensors[goal.first].link, rig_.targets[goal.second].link,
                     rig_.sensors[goal.first].scanning_joint);
  Sample robot;
  robot.readings = posture.readings;
  robot.conditions = posture.conditions;
  const Pose wanted = world_.sensor_T_target(robot, goal.first,
                                             world_.place(robot, goal.first, goal.second, draws_));
  const auto off = [&] {
    return log_se3(inverse(world_.sensor_T_target(robot, goal.first, goal.second)) * wanted);
  };
  const auto count = static_cast<Eigen::Index>(moving.size());
  for (int step = 0; step < kSteps; ++step) {
    const Vector6d e = off();
    if (!e.allFinite() || e.norm() < 1e-3) break;
    Eigen::Matrix<double, 6, Eigen::Dynamic> j(6, count);
    for (Eigen::Index c = 0; c < count; ++c) {
      double& reading = robot.readings[moving[static_cast<size_t>(c)]];
      const double at = reading;
      reading = at + kDifference;
      j.col(c) = (off() - e) / kDifference;
      reading = at;
    }
    const Matrix6d damped = j * j.transpose() + kDamping * Matrix6d::Identity();
    const VectorXd change = -j.transpose() * damped.ldlt().solve(e);
    for (Eigen::Index c = 0; c < count; ++c) {
      const int joint = moving[static_cast<size_t>(c)];
      const auto [low, high] = usual_range(rig_.tree.joints[joint]);
      robot.readings[joint] =
          std::clamp(robot.readings[joint] + std::clamp(change(c), -0.5, 0.5), low, high);
    }
  }
  posture.readings = robot.readings;
  return carry_out(posture, group, &goal,
                   RandomStream(seed_, kFirstSampleStream + static_cast<std::uint64_t>(k)));
}

/// A sample if the posture shows enough, and the goal if there is one.
std::optional<Draft> RandomPostures::carry_out(const Posture& posture, const PostureGroup& group,
                                               const SensorTarget* goal,
                                               const RandomStream& noise) {
  std::vector<SensorTarget> views;
  if (group.holder >= 0) views.push_back({group.holder, group.target});
  if (goal) {  // the cheap question first
    std::vector<SensorTarget> first = views;
    first.push_back(*goal);
    if (world_.carry_out(posture, first, false, noise).sample.views.size() < first.size())
      return std::nullopt;
  }
  for (const SensorTarget& p : pairs_)
    if (!is_chain(rig_.sensors[p.first]) &&
        (p.second == group.target || rig_.targets[p.second].link >= 0))
      views.push_back(p);
  Draft draft = world_.carry_out(posture, views, false, noise);
  size_t free = 0;
  bool mounted = false;
  for (const View& v : draft.sample.views) {
    if (!is_chain(rig_.sensors[v.sensor])) seen_.insert({v.sensor, v.target});
    free += v.target == group.target;
    mounted = mounted || moving_.empty() || moving_.count({v.sensor, v.target});
  }
  const size_t needed = std::min<size_t>(2, group.observers.size() + (group.holder >= 0));
  if (group.target >= 0 ? free < needed : !mounted || draft.sample.views.empty())
    return std::nullopt;
  return draft;
}

void RandomPostures::give_up(const PostureGroup& group) const {
  std::string text = "no random posture shows enough within " + std::to_string(trials_) + " trials";
  if (group.target >= 0) {
    text += ": free target " + quoted(rig_.targets[group.target].name);
    text += group.holder >= 0 ? ", held by " + quoted(rig_.sensors[group.holder].name) + "," : "";
    text += group.holder >= 0 || group.observers.size() == 1
                ? " must be seen whole by a sensor"
                : " must be seen whole by two sensors at once";
  }
  std::string never;
  for (const SensorTarget& p : group.observers)
    if (!seen_.count(p))
      never += (never.empty() ? "" : ", ") + quoted(rig_.targets[p.second].name) + " by " +
               quoted(rig_.sensors[p.first].name);
  throw std::runtime_error(text + (never.empty() ? "" : "; never seen: " + never) +
                           "; give postures that show it");
}

}  // namespace kincal
