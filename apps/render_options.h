// How pictures come out: options of `kincal simulate --render`, which says them in its help and
// looks at them, and of kincal-render, which takes the pictures.
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

}  // namespace kincal
