// A batch on a cluster: one array of Slurm's, whose tasks run this same command each on its share
// of the sets and write the same result directories as on one machine. Whatever ends early, the
// same command again finds by the result directories what is done and submits what is not.
#pragma once

#include <optional>
#include <string>

#include "batch_arguments.h"
#include "work.h"

namespace kincal {

/// Returns whether a job of this command is in the folder, to be gone on with. One that is over and
/// is not is forgotten. @throws InputError where one that is not of this command may still write
bool goes_on_slurm(const Output& output, const BatchArguments& a, const std::string& options);

/// Has the sets of `work` calibrated, and waits for that unless --detach. Returns nothing if all
/// are done, else the exit code with which to end now. @throws InputError where no job can be
/// submitted
std::optional<int> calibrate_on_slurm(Work& work, const BatchArguments& a,
                                      const std::string& options, BatchProgress& progress);

/// Returns the token of the job if this process is one of its tasks, else null.
const char* task_token();
/// Calibrates a task's share. Returns 0: all were tried; 130: interrupted. @throws InputError
int run_task(const BatchArguments& a, const std::string& token);

}  // namespace kincal
