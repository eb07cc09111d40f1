// What the readers of cameras share: numbers of a file into those of a lens.
#pragma once

#include <string>
#include <vector>

#include "../document/document.h"
#include "lens.h"

namespace kincal {

/// Reads distortion of OpenCV's order: 4, 5, 8, 12 or 14 numbers. What is 0 at the end is left away
/// down to eight numbers.
void set_brown_conrady(const Field& field, std::vector<double> d, LensNumbers& lens);

/// Reads k1 k2 k3 k4 of OpenCV's fisheye.
void set_kannala_brandt(const Field& field, const std::vector<double>& d, LensNumbers& lens);

/// Reads the image's width and height; where one is 0 both are unknown.
void read_size(const Field& width, const Field& height, LensNumbers& lens);

/// Returns the one of several cameras of a file that the user wants ("": says nothing of), or the
/// only one.
std::string chosen_camera(const Field& file, const std::vector<std::string>& cameras,
                          const std::string& wanted);

/// Says of a pose that is not taken.
std::string pose_not_taken(const std::string& key);

}  // namespace kincal
