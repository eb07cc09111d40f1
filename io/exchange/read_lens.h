// The numbers of a camera's lens from the files that other programs write: ROS's camera_info,
// OpenCV's YAML and XML, Kalibr's camchain.
#pragma once

#include <string>
#include <vector>

#include "lens.h"

namespace kincal {

/// What a user says about a file with several meanings.
struct LensChoice {
  std::string camera;      // one of several: cam0 (Kalibr), 1 or 2 (M1, M2 of a stereo pair)
  bool rectified = false;  // the images are rectified: P in place of K and D
  bool fisheye = false;    // four numbers of distortion are those of OpenCV's fisheye
};

/// Reads the numbers of one camera. `notes` gets a sentence for what is in the file and not taken.
/// @throws InputError with file, line and field, and what kincal has in place of a lens that it
/// does not know
LensNumbers read_lens(const std::string& path, const LensChoice& choice,
                      std::vector<std::string>& notes);

}  // namespace kincal
