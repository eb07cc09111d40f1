// The program kincal-render, which `kincal simulate --render` becomes: pictures of a simulation.
#include <cstdio>
#include <exception>
#include <iostream>
#include <thread>

#include "../io/document/error.h"
#include "../io/images/render_samples.h"
#include "image_main.h"
#include "progress.h"
#include "render_options.h"
#include "signals.h"

namespace {

using namespace kincal;

struct Arguments {
  std::string rig, samples, truth;
  std::uint64_t seed = 1;
  bool force = false, quiet = false;
  RenderArguments look;
};

int render_all(const Arguments& a) {
  const RigFile rig = read_rig(a.rig);
  RenderOptions options;
  options.look = {a.look.blur, a.look.noise, a.look.vignetting, a.look.background};
  options.seed = a.seed;
  options.force = a.force;
  options.threads = a.look.threads > 0
                        ? a.look.threads
                        : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  Progress progress(a.quiet);
  options.progress = [&](double share) { progress.stage("taking pictures", share); };
  const int count = render_samples(rig, a.samples, a.truth, options);
  progress.clear();
  std::cout << count << " pictures\n";
  return kConverged;
}

}  // namespace

int main(int argc, char** argv) try {
  CLI::App app("kincal-render takes the pictures of a simulation (kincal simulate --render).",
               "kincal-render");
  Arguments a;
  app.add_option("RIG", a.rig, "rig.yaml")->required();
  app.add_option("SAMPLES", a.samples, "samples.jsonl whose views have an `image`")->required();
  app.add_option("TRUTH", a.truth, "truth.json of the simulation")->required();
  app.add_option("--seed", a.seed, "the same seed makes the same pictures");
  add_render_options(app, a.look);
  app.add_flag("--force", a.force, "replace existing pictures");
  app.add_flag("--quiet", a.quiet, "no progress");
  return run_image_program(app, argc, argv, [&a] { return render_all(a); });
} catch (const std::exception& error) {  // before the work began; what that throws is said there
  std::fprintf(stderr, "kincal: error: %s\n", error.what());
  return kincal::kBadInput;
}
