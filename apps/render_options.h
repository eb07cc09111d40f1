// How pictures and recordings come out: options of `kincal simulate --render` and `--bag`, which
// says them in its help and looks at them, and of kincal-render, which takes the pictures.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace kincal {

struct RenderArguments {
  double blur = 0.6, noise = 2, vignetting = 0.2;
  std::string background = "texture";
  int threads = 0;  // 0: as many as there are processors
};

/// Adds the options, and returns them.
std::vector<CLI::Option*> add_render_options(CLI::App& command, RenderArguments& a);

/// Returns the options as they would be given.
std::vector<std::string> words_of(const RenderArguments& a);

/// How a robot moves that is recorded, and how often it logs.
struct JourneyArguments {
  double rest = 1.5, move = 1, scatter = 0.3, joint_rate = 100, frame_rate = 10, camera_delay = 0,
         sweeps = 0, scan_rate = 40;
};

std::vector<CLI::Option*> add_journey_options(CLI::App& command, JourneyArguments& a);
/// Returns the options, and `--bag` with a file, as they would be given.
std::vector<std::string> words_of(const JourneyArguments& a, const std::string& bag);

/// Empty for NAME.bag and NAME.mcap, else what is wrong with the name.
std::string ends_as_a_bag(const std::string& path);

}  // namespace kincal
