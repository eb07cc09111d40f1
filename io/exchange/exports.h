// A calibrated rig in the files of other programs: `kincal export`.
#pragma once

#include <string>
#include <vector>

#include "../rig/rig_file.h"

namespace kincal {

/// The formats, as --as names them.
const std::vector<std::string>& export_formats();

struct ExportedFile {
  std::string text;
  std::vector<std::string> notes;  // what of the rig it does not hold
};

/// Writes the sensors of these names (none: all that the format can hold) in a format.
/// @throws InputError: an unknown format or sensor; a rig that lacks what the format needs
ExportedFile export_rig(const Rig& rig, const std::string& format,
                        const std::vector<std::string>& sensors);

}  // namespace kincal
