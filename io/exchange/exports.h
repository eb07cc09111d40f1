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

/// ExportOptions say what of a calibration is written, as the options of `kincal export`.
struct ExportOptions {
  std::string format;                // one of export_formats()
  std::vector<std::string> sensors;  // none: all that the format can hold
  std::string child, known;          // of mounts: the driver's frame (driver_mount())
};

/// Writes a rig in the format of another program.
/// @throws InputError: an unknown format or sensor; a rig that lacks what the format needs
ExportedFile export_rig(const Rig& rig, const ExportOptions& options);

}  // namespace kincal
