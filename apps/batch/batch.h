// `kincal batch`: many sample sets, each calibrated in a process of its own into a result directory
// of its own.
#pragma once

#include "batch_arguments.h"

namespace kincal {

/// Calibrates every set that has no result yet. It returns the exit code: 0 all converged (or a job
/// of Slurm's is at it, with --detach), 1 some did not, 130 interrupted. @throws InputError where
/// nothing can be started
int batch(const BatchArguments& a);

}  // namespace kincal
