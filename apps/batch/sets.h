// The sample sets of a batch: from a folder, or from a list file.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace kincal {

/// A Set is a rig and its samples, and the name of the folder that gets the result.
struct Set {
  std::string name, rig, samples;
  std::string wrong;  // why it cannot even be tried
};

struct Sets {
  std::vector<Set> all;
  size_t ignored = 0;  // folders that have neither file
};

/// Takes every folder of `directory` with a rig.yaml and a samples.jsonl; one of the two alone is a
/// set that fails. `out` is none. @throws InputError
Sets sets_of_folder(const std::string& directory, const std::string& out);
/// Reads the sets of a list file with lines `RIG SAMPLES [NAME]`, relative to the list's own
/// folder. @throws InputError
Sets sets_of_list(const std::string& path);

/// Returns "1 set", "2 sets".
std::string plural(size_t n, const std::string& what);

}  // namespace kincal
