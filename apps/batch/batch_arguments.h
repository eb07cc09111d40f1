// What `kincal batch` is asked for.
#pragma once

#include <string>

#include "../job.h"
#include "slurm.h"

namespace kincal {

struct BatchArguments {
  std::string sets;  // a folder of sets, or a list file
  std::string out;
  int jobs = 0;  // at once, in each task; 0 in the command only: as many as fit
  bool quiet = false, json = false;
  CalibrateSettings settings;
  SlurmOptions slurm;
};

}  // namespace kincal
