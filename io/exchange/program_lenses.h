// Cameras from files of VINS, Basalt, mrcal and Kalibr, and from lists of rs-enumerate-devices.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../document/document.h"
#include "lens.h"

namespace kincal {

/// Reads such a file, of several cameras the one that is wanted; nullopt: it is none of these.
std::optional<LensNumbers> read_program_lens(const Field& file, const std::string& wanted,
                                             std::vector<std::string>& notes);

}  // namespace kincal
