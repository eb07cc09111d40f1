// The program kincal-render, which `kincal simulate --render` becomes: pictures of a simulation.
#include <cstdio>
#include <exception>
#include <iostream>
#include <thread>

#include "../io/document/error.h"
#include "../io/images/render_samples.h"
#include "../io/recordings/simulated_bag.h"
#include "image_main.h"
#include "progress_line.h"
#include "render_options.h"
#include "signals.h"

namespace {

using namespace kincal;

struct Arguments {
  std::string rig, samples, truth, bag;
  std::uint64_t seed = 1;
  bool force = false, quiet = false;
  RenderArguments look;
  JourneyArguments journey;
};

int threads_of(const Arguments& a) {
  return a.look.threads > 0 ? a.look.threads
                            : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

int record_bag(const Arguments& a) {
  BagOptions options;
  options.journey = {a.journey.rest, a.journey.move, a.journey.scatter};
  options.joint_rate = a.journey.joint_rate;
  options.frame_rate = a.journey.frame_rate;
  options.camera_delay = a.journey.camera_delay;
  options.sweep = {a.journey.sweeps, a.journey.scan_rate};
  options.look = {a.look.blur, a.look.noise, a.look.vignetting, a.look.background};
  options.seed = a.seed;
  options.force = a.force;
  options.threads = threads_of(a);
  ProgressLine line(a.quiet);
  options.progress = line.progress().in("recording");
  options.go_on = not_interrupted;
  const RigFile rig = read_rig(a.rig);
  begin_writing();
  const RecordedBag bag = render_bag(rig, a.samples, a.truth, a.bag, options);
  line.clear();
  if (!bag.written) return say_interrupted();
  const std::string scans = bag.scans > 0 ? std::to_string(bag.scans) + " scans, " : "";
  if (!a.quiet)
    std::printf("%s%d images and %d readings of the joints in %.1f s\nWritten to %s\n",
                scans.c_str(), bag.images, bag.readings, bag.duration, a.bag.c_str());
  return kConverged;
}

int render_all(const Arguments& a) {
  const RigFile rig = read_rig(a.rig);
  RenderOptions options;
  options.look = {a.look.blur, a.look.noise, a.look.vignetting, a.look.background};
  options.seed = a.seed;
  options.force = a.force;
  options.threads = threads_of(a);
  ProgressLine line(a.quiet);
  options.progress = line.progress().in("rendering images");
  const int count = render_samples(rig, a.samples, a.truth, options);
  line.clear();
  if (!a.quiet) std::cout << count << " pictures\n";
  return kConverged;
}

}  // namespace

int main(int argc, char** argv) try {
  CLI::App app("kincal-render renders the images of a simulation (kincal simulate --render).",
               "kincal-render");
  Arguments a;
  app.add_option("RIG", a.rig, "rig.yaml")->required();
  app.add_option("SAMPLES", a.samples, "samples.jsonl whose views have an `image`")->required();
  app.add_option("TRUTH", a.truth, "truth.json of the simulation")->required();
  app.add_option("--seed", a.seed, "the same seed gives the same images");
  app.add_option("--bag", a.bag, "write a bag instead of image files");
  add_render_options(app, a.look);
  add_journey_options(app, a.journey);
  app.add_flag("--force", a.force, "replace existing images");
  app.add_flag("--quiet", a.quiet, "no progress, no summary");
  return run_image_program(app, argc, argv,
                           [&a] { return a.bag.empty() ? render_all(a) : record_bag(a); });
} catch (const std::exception& error) {  // before the work began; what that throws is said there
  std::fprintf(stderr, "kincal: error: %s\n", error.what());
  return kincal::kBadInput;
}
