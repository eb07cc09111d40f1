#include "render_options.h"

#include "../io/document/numbers.h"

namespace kincal {

std::vector<CLI::Option*> add_render_options(CLI::App& command, RenderArguments& a) {
  return {
      command.add_option("--blur", a.blur, "images: sigma of the blur of the lens, px")
          ->check(CLI::Range(0., 100.))
          ->capture_default_str(),
      command
          .add_option("--image-noise", a.noise, "images: sigma of the noise, grey levels of 255")
          ->check(CLI::Range(0., 255.))
          ->capture_default_str(),
      command
          .add_option("--vignetting", a.vignetting,
                      "images: relative darkening of the image corners, 0 to 1")
          ->check(CLI::Range(0., 1.))
          ->capture_default_str(),
      command
          .add_option("--background", a.background,
                      "images: background behind the targets: grey, gradient, texture")
          ->check(CLI::IsMember({"grey", "gradient", "texture"}))
          ->capture_default_str(),
      command
          .add_option("--threads", a.threads,
                      "threads for rendering (images do not depend on it); 0: all processors")
          ->check(CLI::Range(0, 1024))
          ->capture_default_str()};
}

std::vector<std::string> words_of(const RenderArguments& a) {
  return {"--blur",       shortest(a.blur),         "--image-noise", shortest(a.noise),
          "--vignetting", shortest(a.vignetting),   "--background",  a.background,
          "--threads",    std::to_string(a.threads)};
}

std::vector<CLI::Option*> add_journey_options(CLI::App& command, JourneyArguments& a) {
  const auto add = [&](const char* name, double& number, double low, double high,
                       const char* what) {
    return command.add_option(name, number, what)
        ->check(CLI::Range(low, high))
        ->capture_default_str();
  };
  return {add("--rest", a.rest, 0.1, 3600, "with --bag: duration of a rest, s"),
          add("--move", a.move, 0.1, 3600, "with --bag: duration of a move, s"),
          add("--scatter", a.scatter, 0, 1000,
              "with --bag: scatter of single readings of a joint, in units of its sigma, in "
              "addition to the error that is constant during a rest"),
          add("--joint-rate", a.joint_rate, 1, 10000, "with --bag: rate of joint readings, Hz"),
          add("--frame-rate", a.frame_rate, 0.1, 1000, "with --bag: image rate of each camera, Hz"),
          add("--camera-delay", a.camera_delay, -1, 1,
              "with --bag: delay of image time stamps relative to readings, s"),
          add("--sweeps", a.sweeps, 0, 3600,
              "with --bag: duration of one sweep (up or down) of tilting lasers in every rest, s; "
              "0: no sweeps"),
          add("--scan-rate", a.scan_rate, 1, 1000, "with --sweeps: scan rate of each laser, Hz")};
}

std::vector<std::string> words_of(const JourneyArguments& a, const std::string& bag) {
  return {"--bag",          bag,
          "--rest",         shortest(a.rest),
          "--move",         shortest(a.move),
          "--scatter",      shortest(a.scatter),
          "--joint-rate",   shortest(a.joint_rate),
          "--frame-rate",   shortest(a.frame_rate),
          "--camera-delay", shortest(a.camera_delay),
          "--sweeps",       shortest(a.sweeps),
          "--scan-rate",    shortest(a.scan_rate)};
}

std::string ends_as_a_bag(const std::string& path) {
  for (const std::string end : {".bag", ".mcap"})
    if (path.size() > end.size() && path.compare(path.size() - end.size(), end.size(), end) == 0)
      return "";
  return "NAME.bag (ROS 1) or NAME.mcap (ROS 2) is expected, not '" + path + "'";
}

}  // namespace kincal
