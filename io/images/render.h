// Pictures of prints as a camera takes them: rays through the pixels, with the lens undone, hit the
// sheets; a pixel is the mean of many rays. No corner is warped and no image is resampled.
//
// The directions of the corners of all pixels are found once for a camera, by Newton's method on
// its own projection; within a pixel they are interpolated (the error, the lens's curvature over an
// eighth of a square pixel, is far below a thousandth of a pixel). A pixel has four parts, blur
// (the lens, a Gaussian) is done to them and then pixels are made of them, as light is blurred
// before a sensor counts it: blurred pixels of sharp light would lead finders astray by a hundredth
// of a pixel. The rays of a part are a lattice (Fibonacci) of which no two share a row or a
// column, moved at random for each part: an edge along the pixels would else be off by a half step
// of the lattice. They are 8, and 233 where those of a pixel and its corners do not all see the
// same: fewer would be noise, just where the edges are (89 moved corners by 0.003 px, 233 by
// 0.001). Then darker corners and noise.
#pragma once

#include <string>
#include <vector>

#include "../../models/rig/parameters.h"
#include "../../models/rig/random_stream.h"
#include "print.h"

namespace kincal {

/// A CameraRays is where the corners of a camera's pixels look: rows and columns one more than the
/// image's.
struct CameraRays {
  int width = 0, height = 0;
  std::vector<Vector3d> directions;  // row by row, of the points (-0.5, -0.5), (0.5, -0.5), ...;
                                     // NaN: nothing is seen there
  Vector3d eye = Vector3d::Zero();  // in the camera's frame (of a rectified right camera beside it)
};

/// Returns the rays of a camera at given values of its own numbers. It must have an image size.
CameraRays camera_rays(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                       int sensor);

/// A Sheet is a print somewhere before a camera.
struct Sheet {
  const Print* print = nullptr;
  Pose camera_T_print;
  double unit = 1;    // m, of the print's coordinates
  bool y_up = false;  // seen from its front y points up, else down
};

/// A Look is how pictures come out.
struct Look {
  double blur = 0.6;                   // px, sigma
  double noise = 2;                    // grey levels, sigma
  double vignetting = 0.2;             // how much darker the corners of the image are, 0 to 1
  std::string background = "texture";  // or `grey`, `gradient`
};

/// Exposes a picture: grey levels without noise, rows x columns (CV_64F). The nearest sheet is
/// seen, the back of one is grey. What is random comes from `draws`.
cv::Mat expose(const CameraRays& rays, const std::vector<Sheet>& sheets, const Look& look,
               RandomStream& draws);
/// Adds noise (grey levels, sigma) to an exposed picture and makes it 8 bits grey.
cv::Mat develop(const cv::Mat& light, double noise, RandomStream& draws);
/// Takes a picture, 8 bits grey: both.
cv::Mat take_picture(const CameraRays& rays, const std::vector<Sheet>& sheets, const Look& look,
                     RandomStream draws);

}  // namespace kincal
