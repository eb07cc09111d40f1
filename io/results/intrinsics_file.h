// The result of `kincal intrinsics` as files: rig.yaml with the new lenses and poses, the robot as
// it was, intrinsics.json and coverage.svg. The keys are in docs/formats.md.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../../models/intrinsics/intrinsics.h"
#include "../rig/rig_file.h"

namespace kincal {

/// An IntrinsicsSource describes the input of the result.
struct IntrinsicsSource {
  std::string version, command, samples_hash;  // of the program; the command line; SHA-256
};

/// Returns the names and globs in the rig's steps that match nothing with the new lenses.
std::vector<std::string> names_without_parameter(const RigFile& rig_file,
                                                 const IntrinsicsResult& result);

/// Returns the files of the result directory as (name, text).
std::vector<std::pair<std::string, std::string>> intrinsics_files(const RigFile& rig_file,
                                                                  const IntrinsicsResult& result,
                                                                  const IntrinsicsSource& source);

/// True if the rig's lenses were calibrated from these samples: the intrinsics.json that `kincal
/// intrinsics` wrote beside the rig has their hash. False if it cannot be read.
bool lenses_are_from(const std::string& rig_path, const std::string& samples_hash);

/// Widens the priors on lenses and warps, written into the rig by intrinsics_files(), until they
/// have almost no weight. Otherwise the same samples would count twice.
void forget_lenses(Rig& rig);

}  // namespace kincal
