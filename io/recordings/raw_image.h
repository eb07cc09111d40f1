// Images as messages have them, made grey: what detectors and files need of them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "message.h"

namespace kincal {

/// A picture of 8 bits and one channel, row by row.
struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;
};

/// Makes a sensor_msgs/Image grey: mono8, mono16, bgr8, rgb8, bgra8, rgba8 (also of 16 bits), the
/// four Bayer patterns (8 and 16 bits; a pixel is the mean of what its neighbourhood shows of each
/// colour), yuv422 and yuv422_yuy2; OpenCV's names (8UC1, ...) as well. Of more than 8 bits the
/// picture's own range is mapped to 8, as in files. @throws Damage: another encoding, or fewer
/// bytes than pixels
Picture grey_picture(const MessageValue& image);

/// Returns the file format of a sensor_msgs/CompressedImage by its first bytes: "jpg", "png"; "":
/// none of them (depth images, theora).
std::string compressed_format(std::string_view bytes);

/// Returns the bytes of a PGM file.
std::string pgm_file(const Picture& picture);

}  // namespace kincal
