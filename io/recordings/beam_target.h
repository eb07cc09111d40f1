// Targets among beams: a board is found in the picture that intensities make, its points are then
// measured in the beams themselves.
//
// The picture is for finding and numbering only. Beams lie as the scanner laid them, coarser one
// way than the other, so it is a weighted mean of the beams around each pixel (a tent as wide as
// their distance), with square pixels, from coarse to fine until the board is in it.
//
// A corner q = (u, v) is fitted to the intensities I of the beams p around it, each where it really
// was: with S the ways of one square along rows and columns there, (a, b) = S^-1 (p - q), and A, B
// the step edges of both, as blurred by the beam's spot (sigma w_u, w_v; W = diag(w_u^2, w_v^2)),
//     I = m + h A(a) B(b),   A(a) = erf(a / (sqrt(2) s_a)),   s_a^2 = g' W g,   g = row of S^-1,
// least squares over q, m, h. The spot is the one that suits all corners together best. The window,
// 0.45 squares to each side, belongs to no other corner, and it is symmetric about this one, so
// that an error of S is none of q. An edge that is bent is: straight lines of a board are curves of
// (u, v), and the fit puts q inside of them (squares of 11 cm at 1 m, at a bearing of 0.4 rad: by
// 0.14 mrad; so near boards seem narrower). With X(u, v) where a
// ray meets the board's plane (below), and J = dX/d(u, v), p - q above is therefore
//     d + J^-1 (X_uu du^2 / 2 + X_uv du dv + X_vv dv^2 / 2),   d = (du, dv) = p - q as scanned,
// which is where p would be if the picture were affine around q. Terms of third order are odd, and
// the symmetric window makes nothing of them. Covariance: (J'J)^-1 (sum j j' r^2 / (1 - l))
// (J'J)^-1 with the residuals r themselves and their leverages l: what the model does not know
// (steps of the intensity, jitter, the spot's true shape) is not the same everywhere, but largest
// on the edges, which alone tell where the corner is. An edge that lies between two beams (d apart,
// as it sees them) that are farther apart than its blur can be anywhere in the gap g = d - 3 s_a,
// and no residual knows it; a share g / d of all edges is there, which is a variance of g^3 / (12
// d). Intensities in steps of q: beams that see the same are rounded alike, and along an edge that
// lies as the scanner does many see the same. The error of rounding what is seen, E, is a sawtooth,
// of waves k with the mean square v_k = q^2 / (2 pi^2 k^2) exp(-(2 pi k s / q)^2) where noise s
// comes first, and two beams share cos(2 pi k (E - E') / q) of it; so the sum j j' r^2 gets, for
// what rounding is of r^2,  sum_k v_k (c c' + d d'),  c, d = sum j cos, sum j sin of 2 pi k E / q.
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

#include <functional>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"
#include "../images/image_target.h"

namespace kincal {

/// A Beam is what was measured in one direction: `u` to the right and `v` down, in rad (v may be in
/// m, of a joint that shifts), as seen from the sensor.
struct Beam {
  double u = 0, v = 0;
  double range = 0;  // m; 0: nothing was measured
  double intensity = 0, time = 0;
};

/// A Ray starts at `origin` and has a unit direction.
struct Ray {
  Vector3d origin, direction;
};

/// Beams are all that a sensor measured of a scene at rest.
struct Beams {
  std::vector<Beam> all;
  double step_u = 0, step_v = 0;               // how far neighbours are apart
  std::function<Ray(double u, double v)> ray;  // in any frame that is at rest
};

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
