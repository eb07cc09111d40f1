// `kincal batch`: many sample sets, each calibrated in a process of its own into a result directory
// of its own.
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

/// Calibrates every set that has no result yet. It returns the exit code: 0 all converged (or a job
/// of Slurm's is at it, with --detach), 1 some did not, 130 interrupted. @throws InputError where
/// nothing can be started
int batch(const BatchArguments& a);

}  // namespace kincal
