// An image file as the detectors take it: 8 bits, one channel, pixels as stored.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "../../models/rig/rig.h"
#include "compression.h"

namespace kincal {

struct LoadedImage {
  cv::Mat grey;                    // empty: not usable
  std::string error;               // why not
  cv::Size other_size;             // of an image that has not the size it should have
  Compression compression;         // what JPEG did to it
  std::vector<std::string> notes;  // what is unusual about it, and what was done
};

/// Reads an image. `width`, `height`: what it should have, 0: anything. Never throws for what is in
/// the file.
LoadedImage load_image(const std::string& path, int width, int height);

/// Reads an image from the bytes of a file, likewise.
LoadedImage decode_image(std::string_view bytes, int width, int height);

/// Takes an image of one channel as it is, if it fits.
LoadedImage fitting_image(const cv::Mat& image, int width, int height);

/// Returns what to do where all images of a camera have another size than the rig says.
std::string cure_of_size(const Sensor& camera, const cv::Size& size);

}  // namespace kincal
