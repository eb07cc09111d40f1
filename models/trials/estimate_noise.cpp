#include "estimate_noise.h"

#include <algorithm>
#include <cmath>

namespace kincal {

std::optional<NoiseEstimate> estimate_noise(const Calibration& given, const CalibrationOptions& options) {
  constexpr int kRounds = 20, kFull = 5;
  constexpr double kAtRest = 0.01, kLargest = 3;
  if (options.noise != NoiseMode::latent && options.noise != NoiseMode::none)
    throw std::invalid_argument(
        "the noise can be estimated in the noise modes latent and none only: the others mix that of sensors and joints");
  Rig rig = given.rig();
  std::vector<Sample> samples = given.samples();
  CalibrationOptions quick = options;
  for (int round = 1;; ++round) {
    Calibration calibration(rig, samples);
    if (options.progress)
      quick.progress = [&](const std::string& step, int iteration, double chi2, double damping) {
        return options.progress("noise, round " + std::to_string(round) + ": " + step, iteration, chi2, damping);
      };
    std::optional<CalibrationResult> result = calibration.run(quick);
    if (!result) return std::nullopt;
    double moved = 0;
    std::vector<NoiseLevel> steps = result->noise_levels;
    for (NoiseLevel& level : steps) {
      if (!std::isfinite(level.seen)) continue;
      const double change = std::log(level.seen / level.assumed);
      moved = std::max(moved, std::abs(change));
      level.seen = level.assumed * std::exp(std::clamp(round > kFull ? change / 2 : change, -std::log(kLargest), std::log(kLargest)));
    }
    const bool rests = moved < kAtRest;
    if (rests || round == kRounds || result->status == Status::not_converged) {
      if (round > 1) {  // from the rig's own start, as anybody will calibrate with these sigmas
        result = calibration.run(options);
        if (!result) return std::nullopt;
      }
      for (NoiseLevel& level : result->noise_levels) {
        // A part's sigmas all had the same factors.
        const double now = level.joint >= 0 ? rig.joints[level.joint].sigma : rig.sensors[level.sensor].sigma[level.first];
        const double first =
            level.joint >= 0 ? given.rig().joints[level.joint].sigma : given.rig().sensors[level.sensor].sigma[level.first];
        level.assumed *= first / now;
        level.used = level.assumed * now / first;
      }
      result->noise_rounds = round;
      result->noise_rests = rests;
      const auto warn = [&](std::string text) { result->warnings.push_back({"noise", std::move(text)}); };
      if (!rests)
        warn("the noise was estimated in " + std::to_string(round) +
             " rounds and still moves: what the model lacks is taken for noise, now of this and now of that");
      for (const NoiseLevel& level : result->noise_levels)
        if (level.own_views > 0 && level.used != level.assumed && level.first == 0)
          warn(level.of + ": " + std::to_string(level.own_views) + (level.own_views == 1 ? " view has" : " views have") +
               " sigmas of their own in the samples file; they were taken times those of the sensor, the file keeps its numbers");
      return NoiseEstimate{std::move(calibration), std::move(*result)};
    }
    scale_noise(rig, samples, steps);
    quick.start = result->values.shared;
  }
}

}  // namespace kincal
