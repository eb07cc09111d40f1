#include "held_targets.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../../models/fitting/view_poses.h"
#include "../../models/rig/configuration.h"
#include "../../models/rig/selection.h"

namespace kincal {
namespace {

constexpr double kNearPosition = 0.25, kNearAngle = 30 * kPi / 180;  // m, rad
constexpr size_t kLeastAgreeing = 3;

bool agree(const Pose& a, const Pose& b, double* distance = nullptr) {
  const Vector6d off = log_se3(inverse(a) * b);
  const double position = off.head<3>().norm() / kNearPosition,
               angle = off.tail<3>().norm() / kNearAngle;
  if (distance) *distance = std::hypot(position, angle);
  return position < 1 && angle < 1;
}

bool is_chain(const Sensor& sensor) {
  return sensor.model->measurement_kind() == MeasurementKind::chain;
}

/// Whether nobody says where a sensor is.
bool is_open(const Rig& rig, const ParameterTable& table, int sensor) {
  const std::vector<int> open = open_poses(rig, table);
  return std::count(open.begin(), open.end(), table.sensor_pose[sensor]) > 0;
}

/// A target in a sample as a hand has it: all poses that the cameras propose.
struct InHand {
  size_t sample;
  std::vector<Pose> hand_T_target;
};

/// How well the samples agree on a pose: those that do, each with its distance.
std::map<size_t, double> agreeing(const std::vector<InHand>& all, const Pose& pose) {
  std::map<size_t, double> out;
  for (const InHand& one : all)
    for (const Pose& candidate : one.hand_T_target) {
      double distance = 0;
      if (!agree(pose, candidate, &distance)) continue;
      const auto [at, is_new] = out.emplace(one.sample, distance);
      if (!is_new) at->second = std::min(at->second, distance);
    }
  return out;
}

std::vector<InHand> in_hand(const Rig& rig, const ParameterTable& table,
                            const std::vector<Sample>& samples, int hand, int target) {
  std::vector<InHand> out;
  for (size_t i = 0; i < samples.size(); ++i) {
    const Sample& sample = samples[i];
    if (!has_readings(rig, rig.sensors[hand].link, sample.readings)) continue;
    const std::vector<double> readings = completed(sample.readings);
    const Pose base_T_link =
        Configuration(rig, table, table.initial, readings).base_T_link(rig.sensors[hand].link);
    InHand one{i, {}};
    for (const View& view : sample.views) {
      const Sensor& sensor = rig.sensors[view.sensor];
      if (view.target != target || is_open(rig, table, view.sensor) || is_chain(sensor) ||
          !has_readings(rig, sensor.link, sample.readings))
        continue;
      for (const Pose& base_T_target : proposals(rig, table, table.initial, sample, view))
        one.hand_T_target.push_back(inverse(base_T_link) * base_T_target);
    }
    if (!one.hand_T_target.empty()) out.push_back(std::move(one));
  }
  return out;
}

/// Samples in which a hand holds a target, with how near it is.
std::map<size_t, double> held_by(const Rig& rig, const ParameterTable& table,
                                 const std::vector<Sample>& samples, int hand, int target) {
  const std::vector<InHand> all = in_hand(rig, table, samples, hand, target);
  const Sensor& chain = rig.sensors[hand];
  if (!is_open(rig, table, hand)) return agreeing(all, chain.link_T_sensor);
  std::map<size_t, double> best;
  for (const InHand& one : all)
    for (const Pose& pose : one.hand_T_target) {
      std::map<size_t, double> some = agreeing(all, pose);
      if (some.size() > best.size()) best = std::move(some);
    }
  return best.size() < kLeastAgreeing ? std::map<size_t, double>() : best;
}

}  // namespace

std::vector<std::string> add_holding_chains(const Rig& rig, std::vector<Sample>& samples) {
  const ParameterTable table(rig);
  std::vector<int> hands;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    if (is_chain(rig.sensors[s])) hands.push_back(static_cast<int>(s));
  std::vector<std::string> said;
  if (hands.empty()) return said;
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const Target& target = rig.targets[t];
    if (target.link >= 0) continue;
    std::map<size_t, std::pair<double, int>> holder;  // by sample
    for (const int hand : hands)
      for (const auto& [sample, distance] :
           held_by(rig, table, samples, hand, static_cast<int>(t))) {
        const auto [at, is_new] = holder.emplace(sample, std::pair{distance, hand});
        if (!is_new && distance < at->second.first) at->second = {distance, hand};
      }
    std::map<int, int> counts;
    for (const auto& [sample, best] : holder) {
      View view;
      view.sensor = best.second;
      view.target = static_cast<int>(t);
      view.sigma = rig.sensors[best.second].sigma;
      samples[sample].views.push_back(view);
      ++counts[best.second];
    }
    for (const auto& [hand, count] : counts)
      said.push_back("target " + target.name + ": in the hand of " + rig.sensors[hand].name +
                     " in " + std::to_string(count) + " samples");
  }
  return said;
}

}  // namespace kincal
