// Pictures of a simulation: what the cameras of its samples see, from the truth that it was made
// with.
#pragma once

#include <cstdint>
#include <string>

#include "../../solver/progress.h"
#include "../rig/rig_file.h"
#include "render.h"

namespace kincal {

struct RenderOptions {
  Look look;
  std::uint64_t seed = 1;
  int threads = 1;     // the pictures are the same for any number
  bool force = false;  // replace files
  Progress progress;
};

/// Writes the picture (PNG) of every `image` in a samples file, relative to that file, as the truth
/// file (simulation_file.h) says the robot stood. All mounted targets are seen, and the free ones
/// that the truth has in the sample; never their points alone. Returns how many. @throws InputError
int render_samples(const RigFile& rig, const std::string& samples, const std::string& truth,
                   const RenderOptions& options);

}  // namespace kincal
