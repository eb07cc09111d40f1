#include "render_options.h"

#include "../io/document/numbers.h"

namespace kincal {

std::vector<CLI::Option*> add_render_options(CLI::App& command, RenderArguments& a) {
  return {command.add_option("--blur", a.blur, "of pictures: sigma of the lens's blur, px")
              ->check(CLI::Range(0., 100.))
              ->capture_default_str(),
          command.add_option("--image-noise", a.noise, "of pictures: sigma, grey levels of 255")
              ->check(CLI::Range(0., 255.))
              ->capture_default_str(),
          command
              .add_option("--vignetting", a.vignetting,
                          "of pictures: how much darker their corners are, 0 to 1")
              ->check(CLI::Range(0., 1.))
              ->capture_default_str(),
          command
              .add_option("--background", a.background,
                          "of pictures: what is behind the targets: grey, gradient, texture")
              ->check(CLI::IsMember({"grey", "gradient", "texture"}))
              ->capture_default_str(),
          command
              .add_option("--threads", a.threads,
                          "for pictures; they are the same for any number; 0: all processors")
              ->check(CLI::Range(0, 1024))
              ->capture_default_str()};
}

std::vector<std::string> words_of(const RenderArguments& a) {
  return {"--blur",       shortest(a.blur),         "--image-noise", shortest(a.noise),
          "--vignetting", shortest(a.vignetting),   "--background",  a.background,
          "--threads",    std::to_string(a.threads)};
}

}  // namespace kincal
