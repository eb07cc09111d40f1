#include "detect_options.h"

namespace kincal {

void add_detect_options(CLI::App& command, DetectArguments& a) {
  command.add_option("RIG", a.rig, "rig.yaml")->required();
  command
      .add_option("SAMPLES|IMAGES", a.input,
                  "samples.jsonl whose views have an `image` and no `pixels`; or a folder, a "
                  "pattern ('images/*.png') or one image")
      ->required();
  command.add_option("--out", a.out, "file for the samples")->required()->type_name("FILE");
  command
      .add_option(
          "--sensor", a.sensor,
          "images without samples: the camera that took them (default: the rig's only camera)")
      ->type_name("NAME");
  command
      .add_option(
          "--joints", a.joints,
          "images without samples: joint readings, a table with a header (image or time, and "
          "joints) or JSON lines; rows without image and time belong to the images in their order")
      ->type_name("FILE");
  command
      .add_option("--pose-format", a.pose_format,
                  "the readings are a table of flange poses in a format of `kincal import --help`: "
                  "xyzw, rpy, rotvec, abb, kuka, fanuc, zyz, ...")
      ->type_name("FORMAT");
  command.add_option("--unit", a.unit, "unit of that table: m or mm");
  command.add_option("--map", a.map, "a column whose name differs from its joint")
      ->type_name("COLUMN=JOINT");
  command.add_option("--angles", a.angles, "unit of joint readings: rad or deg (default: rad)");
  command
      .add_option("--tolerance", a.tolerance,
                  "largest difference in s between the time in an image's name and the time of its "
                  "readings")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command.add_flag(
      "--sigma", a.sigma,
      "write a `sigma` for each view, computed from the image's noise and edges (chessboards, "
      "ChArUco, Kalibr's grids); where it is absent the rig's sigma applies");
  command.add_option("--draw", a.draw, "folder for images that show the targets found")
      ->type_name("DIR");
  command
      .add_option("--threads", a.threads,
                  "number of threads (the result does not depend on it); 0: all processors")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command.add_flag("--force", a.force, "replace an existing file");
  command.add_flag("--quiet", a.quiet,
                   "no progress, no summary; a line for each image that failed");
  command.footer(
      "Images that cannot be used and targets that are not found are listed and left out. Exit "
      "codes: 0 samples written; 1 bad input, or\n"
      "nothing was found, nothing written; 130 interrupted, nothing written.");
}

}  // namespace kincal
