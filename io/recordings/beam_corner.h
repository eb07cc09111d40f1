// A corner of a board, fitted to the beams around it.
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
#pragma once

#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "beams.h"

namespace kincal {

constexpr double kReach = 0.45;  // squares: half of a corner's window

/// A BeamCorner is one of a board and the beams around it.
struct BeamCorner {
  int id = 0;
  Eigen::Vector2d at;     // u, v
  Eigen::Matrix2d sides;  // ways of one square along rows and columns, as columns
  Eigen::Matrix<double, 2, 3> bend =
      Eigen::Matrix<double, 2, 3>::Zero();  // of straight lines: times (du^2, du dv, dv^2)
  double strip = kReach;                    // squares beside an edge that are plain
  double mean = 0, half = 0;                // m and h
  Eigen::Vector2d spot;                     // w_u, w_v
  std::vector<const Beam*> beams;           // in the window
  double squares = 0;                       // sum of squared residuals
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of `at`

  /// Returns where a beam is, seen from the corner, in a picture in which straight lines are
  /// straight.
  Eigen::Vector2d away(const Beam& beam) const {
    const Eigen::Vector2d d = beam.place() - at;
    return d + bend * Vector3d(d(0) * d(0), d(0) * d(1), d(1) * d(1));
  }
};

/// A BeamEdge is a step edge through the corner, blurred.
struct BeamEdge {
  Eigen::Vector2d gradient;  // of a or b, per rad
  double sigma;              // of its blur, in squares

  BeamEdge(const BeamCorner& c, int k) {
    gradient = c.sides.inverse().row(k).transpose();
    sigma = gradient.cwiseProduct(c.spot).norm();
  }
  double place(const Eigen::Vector2d& away) const { return gradient.dot(away); }
  double step(double a) const { return std::erf(a / (std::sqrt(2.) * sigma)); }
  double slope(double a) const {
    return std::sqrt(2 / kPi) / sigma * std::exp(-0.5 * a * a / (sigma * sigma));
  }
};

/// A BeamGrain is how coarse intensities are.
struct BeamGrain {
  double step = 0, noise = 0;  // of levels; before they were rounded

  /// Returns how large a wave of the error of rounding is, squared, mean: of a sawtooth, as far as
  /// noise does not smear it.
  double wave(int k) const {
    const double smear = 2 * kPi * k * noise / step;
    return step > 0 ? std::pow(step / (kPi * k), 2) / 2 * std::exp(-smear * smear) : 0;
  }
  double waves() const { return wave(1) + wave(2) + wave(3); }
};

/// Takes those of the beams that lie in the corner's window.
void take_beams(const std::vector<const Beam*>& near, BeamCorner& corner);

/// Fits a corner to the beams around it. Returns false where there is none.
bool fit_corner(const std::vector<const Beam*>& near, BeamCorner& corner);

/// Returns the grain of beams whose residuals have the mean square `squares`.
BeamGrain grain_of(const std::vector<const Beam*>& beams, double squares);

/// Returns the covariance of a corner that is fitted.
Eigen::Matrix2d covariance_of(const BeamCorner& c, const BeamGrain& grain);

}  // namespace kincal
