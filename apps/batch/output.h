// A batch's output folder, and which results in it still hold.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "../../io/results/summary_file.h"
#include "sets.h"

namespace kincal {

/// An Output is OUT with a folder .batch, which marks it as a batch's and has what is being
/// written. It is locked as long as this process or one of its children lives.
struct Output {
  std::filesystem::path folder, scratch;

  std::filesystem::path result(const std::string& name) const { return folder / name; }
  std::filesystem::path error(const std::string& name) const { return scratch / (name + ".error"); }
  /// Removes what is being written, but not the folder of a Slurm job (shares.h).
  void clean() const;
  /// Does so, and puts results back that a batch which was killed had moved away. Nobody else may
  /// be writing here.
  void tidy() const;
};

/// Makes the folder, or takes up that of a batch, and locks it. @throws InputError
Output open_output(const std::string& out);
/// Makes a scratch folder of a task's own for the results in `out`, and locks it. @throws
/// InputError
Output open_scratch(const std::string& out, const std::filesystem::path& scratch);

/// Returns a set's summary if its result is there and of these inputs and options; else `why` says
/// why not ("": never calibrated).
std::optional<SetSummary> find_done(const Set& set, const Output& output,
                                    const std::string& options, std::string& why);

/// Returns the names of results that are of none of these sets, sorted: of sets that are gone.
std::vector<std::string> results_without_set(const std::vector<Set>& sets, const Output& output);

/// Returns the summary of a set that failed with this exit code and message.
SetSummary failed(const Set& set, int code, const std::string& error);

}  // namespace kincal
