#include "estimate_noise.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "../analysis/linearisation.h"
#include "../rig/numbers.h"

namespace kincal {

std::optional<NoiseEstimate> estimate_noise(const std::shared_ptr<const Recording>& given,
                                            const CalibrationOptions& options,
                                            bool (*which)(const Rig&, const NoiseLevel&)) try {
  constexpr int kRounds = 20, kFull = 5;
  constexpr double kAtRest = 0.01, kLargest = 3;
  if (options.noise != NoiseMode::latent && options.noise != NoiseMode::none)
    throw std::invalid_argument(
        "the noise can be estimated in the noise modes latent and none only: the others mix that "
        "of sensors and joints");
  std::shared_ptr<const Recording> recording = given;
  CalibrationOptions quick = options;
  StepVariations from_last;
  for (int round = 1;; ++round) {
    quick.progress = options.progress.in("noise, round " + std::to_string(round));
    NoiseEstimate out;
    out.rounds = round;
    out.solution = uncancelled(calibrate(recording, quick, from_last));
    if (out.solution.status == Status::undefined_start) return out;
    out.levels = noise_levels(linearise(out.solution));
    double moved = 0;
    std::vector<NoiseLevel> steps = out.levels;
    for (NoiseLevel& level : steps) {
      if (which && !which(recording->rig, level)) level.seen = kNan;
      if (!std::isfinite(level.seen)) continue;
      const double change = std::log(level.seen / level.assumed);
      moved = std::max(moved, std::abs(change));
      level.seen = level.assumed * std::exp(std::clamp(round > kFull ? change / 2 : change,
                                                       -std::log(kLargest), std::log(kLargest)));
    }
    out.converged = moved < kAtRest;
    if (!out.converged && round < kRounds && out.solution.status != Status::not_converged) {
      recording = make_recording(scale_noise(*recording, steps));
      from_last.start = out.solution.values.shared;
      continue;
    }
    if (round > 1) {  // from the rig's own start, as anybody will calibrate with these sigmas
      out.solution = uncancelled(calibrate(recording, options));
      if (out.solution.status == Status::undefined_start) return out;
      out.levels = noise_levels(linearise(out.solution));
    }
    for (NoiseLevel& level : out.levels) {
      // A part's sigmas all had the same factors.
      const Rig& rig = recording->rig;
      const double now = level.joint >= 0 ? rig.joints[level.joint].sigma
                                          : rig.sensors[level.sensor].sigma[level.first];
      const double first = level.joint >= 0 ? given->rig.joints[level.joint].sigma
                                            : given->rig.sensors[level.sensor].sigma[level.first];
      level.assumed *= first / now;
      level.used = level.assumed * now / first;
    }
    return out;
  }
} catch (const Cancelled&) {
  return std::nullopt;
}

}  // namespace kincal
