// Targets among beams: a board is found in the picture that intensities make, its points are then
// measured in the beams themselves.
//
// The picture (beam_picture.h) is for finding and numbering only: from coarse to fine until the
// board is in it.
//
// A corner is fitted to the intensities of the beams around it (beam_corner.h).
//
// Ranges. Beams on the edge of something are far and near at once, and dark squares have other
// ranges than bright ones (less light: noisier, and often too far by some mm), so only beams that
// see nothing but paper count. A plane through those of the whole board, robustly (RANSAC, then
// least squares within 4 sigmas), says for each beam which range to expect, and which to leave
// out. A corner's range is what the plane has in its direction plus the mean of (range - expected)
// over its own beams, which lie on both sides of it alike. (The plane's own range there would be a
// little better known, but then the 42 ranges of a board would be three numbers: independent
// errors as large as honest would make residuals far too small, and as small as residuals say
// would make the board's distance known too well.) Sigma: scatter about these means / sqrt(n).
//
// A reflector is the heap of neighbouring beams that are brighter than half the brightest. Its
// middle is that of the patch, not of its picture: with r the range of a plane through the beams
// that are wholly on it, a pixel that sees the light I above what is around shows an area ~ r^3, at
// r times its direction, so the middle is in direction  sum I r^4 (u, v) / sum I r^4. Variance:
// what noise does to that, and the lattice of beams: a circle of radius R (in steps) has 2 pi R
// cells on its rim, each half seen with a variance of 1/12, so the middle has one of
// 1 / (12 pi R)  steps^2. Of a sphere it is the surface that is measured.
#pragma once

#include <string>
#include <vector>

#include "../images/image_target.h"
#include "beams.h"

namespace kincal {

/// A BeamPoint is a point of a target.
struct BeamPoint {
  int id = 0;
  double u = 0, v = 0, range = 0, time = 0;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of (u, v)
  double range_sigma = 0;
  double span = 0;  // how long it took to pass the beams that it is made of, s
};

struct BeamTarget {
  std::vector<BeamPoint> points;   // ascending ids; empty: not found
  std::string reason;              // why not
  std::vector<std::string> notes;  // what is doubtful
};

/// Finds a board with corners: a chessboard or a ChArUco board.
BeamTarget find_board(const Beams& beams, const ImageTarget& target);

/// Finds the brightest thing, which has to stand out: a reflector. Its point (id 0) is the middle
/// of its light, at the mean of its ranges.
BeamTarget find_reflector(const Beams& beams);

}  // namespace kincal
