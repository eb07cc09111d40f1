// A calibrated rig in the files of other programs: `kincal export`.
#pragma once

#include <string>
#include <vector>

#include "../results/read_calibrated.h"

namespace kincal {

/// Returns the names of the formats, as in --as.
const std::vector<std::string>& export_formats();

struct ExportedFile {
  std::string text;
  std::vector<std::string> notes;  // parts of the rig that the format cannot express
};

/// ExportOptions select the parts of a calibration to write, like the options of `kincal export`.
struct ExportOptions {
  std::string format;                // one of export_formats()
  std::vector<std::string> sensors;  // none: all that the format can express
  std::string child, known;          // of mounts: the driver's frame (driver_mount())
  std::string pose_format;           // of poses: one of those of `kincal import`
  std::string tip;                   // of dh, modified_dh: the link at the end of the chain
  std::string prefix;                // of ur_kinematics: before the names of the joints
  std::string from;                  // of ur_kinematics, lerobot: the file to change
  std::string motors = "feetech";    // of lerobot; or dynamixel
};

/// Writes a calibration in the format of another program. @throws InputError: the format or a
/// sensor is unknown, the rig lacks data that the format needs, or an option belongs to another
/// format
ExportedFile export_calibrated(const CalibratedFiles& files, const ExportOptions& options);

}  // namespace kincal
