#include "guessed_noise.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "../rig/configuration.h"
#include "../rig/numbers.h"

namespace kincal {
namespace {

constexpr double kMostMisstated = 10;  // times a stated sigma: more is a mistake
// A level is at rest where a step of its logarithm is less than one of these.
constexpr double kNoiseAtRest = 0.005;
// Of its standard deviation: adds 0.5 % to its error. (Of 280 right recordings none was called
// wrong with it, and none was given a term.)
constexpr double kNoiseShareAtRest = 0.1;
constexpr double kLeastOfGuess = 1e-4;  // of a guess: less is the rounding of data without noise

}  // namespace

std::shared_ptr<const Recording> with_guessed_noise(const Recording& recording, NoiseMode mode) {
  Rig rig = recording.rig;
  std::set<std::pair<int, int>> seen;  // sensor, target
  for (const Sample& sample : recording.samples)
    for (const View& v : sample.views) seen.insert({v.sensor, v.target});
  for (const auto& [s, t] : seen) {
    const Sensor& sensor = rig.sensors[s];
    const int to = rig.targets[t].link >= 0 ? rig.targets[t].link : rig.base;
    for (const int j : joints_between(rig, sensor.link, to, sensor.scanning_joint)) {
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

FixedPoint noise_steps() {
  constexpr int kMemory =
      3;  // slow directions at once: levels of joints that hide behind each other
  const double largest = std::log(5.0);  // times, in a round
  return FixedPoint(kMemory, largest);
}

double move_noise(const DataProblem& data, const WidthProblem& problem, const VectorXd& factor,
                  FixedPoint& steps, NoisyRecording& noisy) {
  const Rig& rig = noisy.recording->rig;
  if (!noisy.doubted.factor && !noisy.doubted.stated &&
      std::all_of(rig.joints.begin(), rig.joints.end(),
                  [](const JointSettings& j) { return j.noise_guess == 0; }) &&
      std::all_of(rig.sensors.begin(), rig.sensors.end(),
                  [](const Sensor& s) { return s.noise_guess.empty(); }))
    return 0;
  const Posterior known = posterior(problem, factor, true);
  if (!known.defined) return 0;
  std::vector<NoiseLevel> levels =
      noise_levels(*data.problem, rig, data.state, known.covariance, noisy.doubted);
  const auto count = static_cast<Eigen::Index>(levels.size());
  // Logarithms, last that of the factor.
  VectorXd now = VectorXd::Zero(count + 1), seen = now,
           at_rest = VectorXd::Constant(count + 1, kNoiseAtRest);
  for (Eigen::Index i = 0; i < count; ++i) {
    if (!std::isfinite(levels[i].seen)) continue;
    at_rest(i) = std::max(kNoiseAtRest, kNoiseShareAtRest * levels[i].uncertainty);
    const double moved = std::log(levels[i].seen / levels[i].assumed),
                 most = std::log(kMostMisstated);
    if (levels[i].guess > 0) {
      now(i) = std::log(levels[i].assumed);
      seen(i) = std::max(now(i) + moved, std::log(kLeastOfGuess * levels[i].guess));
    } else if (noisy.doubted.stated) {
      now(i) =
          std::log(first_sigma(rig, levels[i]) / first_sigma(*noisy.doubted.stated, levels[i]));
      seen(i) = std::clamp(now(i) + moved, -most, most);
    } else if (noisy.doubted.factor) {
      now(count) = std::log(*noisy.doubted.factor);
      seen(count) = std::clamp(now(count) + moved, -most, 0.0);
    }
  }
  const VectorXd moved = (seen - now).cwiseAbs();
  if (moved.isZero(0)) return 0;
  const VectorXd next = steps.next(now, seen);
  const double times = std::exp(next(count) - now(count));
  if (noisy.doubted.factor) *noisy.doubted.factor *= times;
  for (Eigen::Index i = 0; i < count; ++i) {
    NoiseLevel& level = levels[i];
    const double by = level.guess > 0 || noisy.doubted.stated ? std::exp(next(i) - now(i)) : times;
    level.seen = by == 1 ? kNan : level.assumed * by;
  }
  noisy.recording = make_recording(scale_noise(*noisy.recording, levels));
  return moved.cwiseQuotient(at_rest).maxCoeff();
}

std::shared_ptr<const Recording> with_seen_noise(const DataProblem& data,
                                                 const WidthProblem& problem,
                                                 const VectorXd& factor,
                                                 std::shared_ptr<const Recording> recording) {
  const Posterior known = posterior(problem, factor, true);
  if (!known.defined) return recording;
  std::vector<NoiseLevel> levels =
      noise_levels(*data.problem, recording->rig, data.state, known.covariance);
  // Levels that few data determine make one step from the stated sigma. (With all levels, those
  // that others hide behind would rise as well.)
  const std::vector<NoiseLevel> doubted =
      noise_levels(*data.problem, recording->rig, data.state, known.covariance,
                   DoubtedNoise{{}, &recording->rig});
  bool larger = false;
  for (size_t i = 0; i < levels.size(); ++i) {
    NoiseLevel& level = levels[i];
    if (!std::isfinite(level.seen))
      level.seen = std::min(doubted[i].seen, kMostMisstated * level.assumed);
    if (level.guess > 0 || !(level.seen > level.assumed)) level.seen = kNan;
    larger = larger || level.seen > level.assumed;
  }
  return larger ? make_recording(scale_noise(*recording, levels)) : recording;
}

}  // namespace kincal
