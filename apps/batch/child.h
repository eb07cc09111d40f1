// One set of a batch, calibrated in a process of its own.
#pragma once

#include <csignal>
#include <string>

#include "../job.h"
#include "output.h"

namespace kincal {

/// Returns the options that make a difference to results, as a command line.
std::string options_text(const CalibrateSettings& settings);

/// Starts a child that calibrates a set into its result directory; returns its process id, -1 if
/// there cannot be one more.
pid_t start_set(const Set& set, const Output& output, const CalibrateSettings& settings,
                const sigset_t& signals_before);

/// Returns the summary of a set that failed with this exit code and message.
SetSummary failed(const Set& set, int code, const std::string& error);

/// Returns the summary of a child that ended with `status` (of waitpid).
SetSummary summary_of(const Set& set, const Output& output, int status);

}  // namespace kincal
