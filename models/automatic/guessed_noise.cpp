#include "guessed_noise.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "../analysis/noise_levels.h"
#include "../rig/numbers.h"

namespace kincal {

std::shared_ptr<const Recording> with_guessed_noise(const Recording& recording, NoiseMode mode) {
  Rig rig = recording.rig;
  std::set<std::pair<int, int>> seen;  // sensor, target
  for (const Sample& sample : recording.samples)
    for (const View& v : sample.views) seen.insert({v.sensor, v.target});
  for (const auto& [s, t] : seen) {
    const Sensor& sensor = rig.sensors[s];
    const int to = rig.targets[t].link >= 0 ? rig.targets[t].link : rig.base;
    for (const PathStep& step : find_path(rig.tree, sensor.link, to)) {
      if (!rig.tree.joints[step.joint].moves() || step.joint == sensor.scanning_joint) continue;
      const int j = driver(rig.tree, step.joint).joint;
      JointSettings& joint = rig.joints[j];
      if (mode != NoiseMode::latent || joint.sigma != 0 || !rig.tree.joints[j].drives() ||
          rig.tree.joints[j].axis_of_pose == PoseAxis::reading)  // (its errors are joints)
        continue;
      if (joint.noise_guess == 0) joint.noise_guess = guessed_noise(rig.tree.joints[j]);
      joint.sigma = joint.noise_guess;
    }
  }
  return make_recording(recording.with_rig(std::move(rig)));
}

double move_noise(Estimation& data, const VectorXd& state, const WidthProblem& problem,
                  const VectorXd& factor, std::shared_ptr<const Recording>& recording) {
  constexpr double kLargest = 5;  // times, in a round
  const std::vector<JointSettings>& joints = recording->rig.joints;
  const std::vector<Sensor>& sensors = recording->rig.sensors;
  if (std::all_of(joints.begin(), joints.end(),
                  [](const JointSettings& j) { return j.noise_guess == 0; }) &&
      std::all_of(sensors.begin(), sensors.end(),
                  [](const Sensor& s) { return s.noise_guess.empty(); }))
    return 0;
  const Posterior known = posterior(problem, factor, true);
  if (!known.defined) return 0;
  std::vector<NoiseLevel> levels = noise_levels(data, recording->rig, state, known.covariance);
  double moved = 0;
  for (NoiseLevel& level : levels) {
    if (level.guess == 0) {
      level.seen = kNan;
      continue;
    }
    const double change =
        std::clamp(std::log(level.seen / level.assumed), -std::log(kLargest), std::log(kLargest));
    moved = std::max(moved, std::abs(change));
    level.seen = level.assumed * std::exp(change);
  }
  if (moved > 0) recording = make_recording(scale_noise(*recording, levels));
  return moved;
}

}  // namespace kincal
