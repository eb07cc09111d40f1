// The options of `kincal detect`: of the program kincal, which says them in its help and looks at
// them, and of kincal-detect, which does the work.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace kincal {

struct DetectArguments {
  std::string rig, input, out, sensor, joints, draw, pose_format, unit, angles;
  std::vector<std::string> map;
  double tolerance = 0.05;
  int threads = 0;  // 0: as many as there are processors
  bool sigma = false, force = false, quiet = false;
};

void add_detect_options(CLI::App& command, DetectArguments& a);

}  // namespace kincal
