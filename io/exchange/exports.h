// A calibrated rig in the files of other programs: `kincal export`.
#pragma once

#include <string>
#include <vector>

#include "../results/read_calibrated.h"

namespace kincal {

/// The formats, as --as names them.
const std::vector<std::string>& export_formats();

struct ExportedFile {
  std::string text;
  std::vector<std::string> notes;  // what of the rig it does not hold
};

/// ExportOptions select the parts of a calibration to write, as the options of `kincal export`.
struct ExportOptions {
  std::string format;                // one of export_formats()
  std::vector<std::string> sensors;  // none: all that the format can hold
  std::string child, known;          // of mounts: the driver's frame (driver_mount())
  std::string pose_format;           // of poses: one of those of `kincal import`
  std::string tip;                   // of dh, modified_dh: the link at the end of the chain
  std::string prefix;                // of ur_kinematics: before the names of the joints
  std::string from;                  // of ur_kinematics, lerobot: the file that gets the numbers
  std::string motors = "feetech";    // of lerobot; or dynamixel
};

/// Writes a calibration in the format of another program. @throws InputError: an unknown format or
/// sensor; a rig without data that the format needs; options of other formats
ExportedFile export_calibrated(const CalibratedFiles& files, const ExportOptions& options);

}  // namespace kincal
