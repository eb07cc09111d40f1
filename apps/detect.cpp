// The program kincal-detect, which `kincal detect` becomes: from images to samples.
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <thread>

#include "../io/document/error.h"
#include "../io/document/files.h"
#include "../io/images/fill.h"
#include "detect_options.h"
#include "image_main.h"
#include "progress_line.h"
#include "signals.h"

namespace {

using namespace kincal;

bool holds_samples(const std::string& path) {
  const std::string ending = std::filesystem::path(path).extension().string();
  return ending == ".jsonl" || ending == ".json" || ending == ".ndjson";
}

void say(const DetectArguments& a, const Filled& filled) {
  for (const std::string& line : filled.lines)
    if (!a.quiet || line.find(": NOT FOUND") != std::string::npos ||
        line.find(": UNUSABLE") != std::string::npos)
      std::cout << line << "\n";
  for (const std::string& line : filled.lost) std::cout << "left out: " << line << "\n";
  for (const std::string& note : filled.notes) std::cout << note << "\n";
  if (a.quiet) return;
  std::cout << filled.found << " of " << filled.views << " views found";
  if (filled.unusable > 0) std::cout << ", " << filled.unusable << " images not usable";
  std::cout << "; " << filled.samples << " samples\n";
}

int detect_all(const DetectArguments& a) {
  std::string folder = a.rig;
  if (std::filesystem::is_directory(folder))
    folder = (std::filesystem::path(folder) / "rig.yaml").string();
  const RigFile rig = read_rig(folder);
  check_output_file(a.out, a.force);
  FillOptions options;
  options.out = a.out;
  options.sensor = a.sensor;
  options.joints = a.joints;
  options.draw = a.draw;
  options.sigma = a.sigma;
  options.pose_format = a.pose_format;
  options.unit = a.unit;
  options.words = {joint_names(a.map), angles_in_degrees(a.angles)};
  options.tolerance = a.tolerance;
  options.threads = a.threads > 0
                        ? a.threads
                        : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  ProgressLine line(a.quiet);
  options.progress = line.progress().in("searching the images");
  if (holds_samples(a.input) && (!a.sensor.empty() || !a.joints.empty()))
    throw InputError("--sensor and --joints are only for images without samples; " + a.input +
                     " contains both");
  const Filled filled = holds_samples(a.input) ? fill_samples(rig, a.input, options)
                                               : fill_images(rig, image_files(a.input), options);
  line.clear();
  say(a, filled);
  if (filled.samples == 0) throw InputError("nothing was found, nothing was written");
  begin_writing();
  if (!not_interrupted()) return say_interrupted();
  write_file(a.out, filled.text, a.force);
  return kConverged;
}

}  // namespace

int main(int argc, char** argv) try {
  CLI::App app("kincal-detect finds boards and markers in images and writes samples.",
               "kincal detect");
  DetectArguments a;
  add_detect_options(app, a);
  return run_image_program(app, argc, argv, [&a] { return detect_all(a); });
} catch (const std::exception& error) {  // before the work began; what that throws is said there
  std::fprintf(stderr, "kincal: error: %s\n", error.what());
  return kincal::kBadInput;
}
