#include "detect_options.h"

namespace kincal {

void add_detect_options(CLI::App& command, DetectArguments& a) {
  command.add_option("RIG", a.rig, "rig.yaml")->required();
  command
      .add_option("SAMPLES|IMAGES", a.input,
                  "samples.jsonl whose views have an `image` and no `pixels`; or a folder, a "
                  "pattern ('images/*.png') or one image")
      ->required();
  command.add_option("--out", a.out, "the samples to write")->required()->type_name("FILE");
  command
      .add_option("--sensor", a.sensor,
                  "of images without samples: the camera that took them (default: the rig's only "
                  "one)")
      ->type_name("NAME");
  command
      .add_option("--joints", a.joints,
                  "of images without samples: joint readings, a table with a header (image or "
                  "time, and joints) or JSON lines; rows without either go with the images in "
                  "their order")
      ->type_name("FILE");
  command
      .add_option("--pose-format", a.pose_format,
                  "the readings are a table of the flange's poses, as `kincal import --help` has "
                  "the formats: xyzw, rpy, rotvec, abb, kuka, fanuc, zyz, ...")
      ->type_name("FORMAT");
  command.add_option("--unit", a.unit, "m or mm, of such a table");
  command.add_option("--map", a.map, "a column that is called differently than its joint")
      ->type_name("COLUMN=JOINT");
  command.add_option("--angles", a.angles, "rad or deg, of joint readings (default: rad)");
  command
      .add_option("--tolerance", a.tolerance,
                  "s, between the time that an image's name is and that of its readings")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command.add_flag("--sigma", a.sigma,
                   "write each view's own `sigma`: that of a corner's pixels, by the picture's "
                   "noise and edges (chessboards, ChArUco, Kalibr's grids); the rig's counts "
                   "where there is none");
  command.add_option("--draw", a.draw, "a folder for pictures of what was found")->type_name("DIR");
  command
      .add_option("--threads", a.threads,
                  "the result is the same for any number; 0: all processors")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command.add_flag("--force", a.force, "replace an existing file");
  command.add_flag("--quiet", a.quiet, "no progress, and only a line for each image that failed");
  command.footer(
      "Images that cannot be used and targets that are not found are named and left out. Exit "
      "codes: 0 samples written; 1 bad input, or\n"
      "nothing was found, nothing written; 130 interrupted, nothing written.");
}

}  // namespace kincal
