// What a picture shows of a target, and what was found of it. Pixels are as everywhere: (0, 0) is
// the centre of the top-left pixel.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "../rig/rig_file.h"

namespace kincal {

/// An ImageTarget is what a picture shows of a target: the print, not the points alone.
struct ImageTarget {
  enum class Kind { chessboard, circles, charuco, tags, marker };
  Kind kind = Kind::chessboard;
  std::string name;
  int rows = 0, columns = 0;        // as in the rig: inner corners, circles, squares or tags
  bool asymmetric = false;          // circles
  bool large_origin = false;        // circles: the one at point 0 is bigger
  double marker = 0;                // charuco: edge of a marker in squares
  int layout = -1;                  // charuco: 1, markers in squares whose row + column is odd; 0,
                                    // even; -1: as the picture has it
  double gap = 0;                   // tags: gap in tags
  int dictionary = -1;              // OpenCV's number
  int marker_id = 0;                // marker; charuco, tags: of the first one
  std::vector<cv::Point2d> points;  // of the plane, in spacings
};

/// Returns what the rig says of a target; `points` are its points in spacings of the grid.
/// @throws InputError where its type cannot be found in images, or a dictionary is unknown.
ImageTarget read_image_target(const std::string& name, const Field& field,
                              std::vector<cv::Point2d> points);

/// Returns the same of a target of a rig. @throws InputError
ImageTarget image_target(const RigFile& rig, const Target& target);

/// Whether two targets look the same in a picture, or have markers in common, so that one would be
/// taken for the other.
bool look_alike(const ImageTarget& a, const ImageTarget& b);

/// Whether two targets have one print, of a kind of which several are found in a picture.
bool same_print(const ImageTarget& a, const ImageTarget& b);

/// Returns what a rig calls a dictionary by OpenCV's number, from 0 on: DICT_4X4_50, tag36h11; "":
/// there are no more.
std::string dictionary_name(int dictionary);

/// A Detection is what was found of a target in one image.
struct Detection {
  std::vector<int> ids;  // ascending; empty: not found
  std::vector<cv::Point2d> pixels;
  std::string reason;  // why nothing was found
  double blur = 0;  // px: sigma of the Gaussian that makes a step edge as wide as the sharpest here
  double contrast = 0;  // between dark and bright of the print, 1: the whole range
  double noise = 0;     // grey levels, sigma from pixel to pixel where nothing else changes
  double sigma = 0;     // px: of a coordinate, predicted from noise and edges; 0: not known
  double floor = 0;     // px: what of it is not noise, so that averaging pictures leaves it
  double rms = 0;       // px: of the best homography with a radial distortion
  std::array<int, 2> layouts{};  // charuco: markers that agree with each layout
  std::vector<int> no_corners;   // charuco, tags: where a corner should be and fields do not meet
};

}  // namespace kincal
