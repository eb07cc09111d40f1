// What a calibration of a camera is worth, over its image: where there were corners, and how well
// it is known where a point appears.
//
// Projection. The numbers of a lens are known together, not one by one: a longer focal length goes
// with boards further away, a shifted principal point with a turned camera. What a user has of them
// is where a point appears that stands still in the world of the boards. So the camera may move to
// where the boards say it is (as mrcal does): with errors d of the freed numbers of the lens, the
// pose of board k in the camera's frame errs by
//     pi_k = e_k - G_k d,   G_k = H_k^-1 B_k,   e_k ~ N(0, H_k^-1),
// H_k = sum P'P, B_k = sum P'J over the board's points, both over sigma^2, P the derivatives of a
// pixel by a motion of the board and J by the lens; e_k is independent of d, for d comes from what
// the poses leave of the residuals. The rigid motion xi of all boards that comes nearest to these
// errors, point by point, is their weighted mean,
//     xi = N^-1 sum N_k pi_k,   N_k = sum D'D over its points,   D = [I | -[p]x],   N = sum N_k.
// A point that moves along with the boards then appears off by  J d + P xi = A d + P N^-1 sum N_k
// e_k,  A = J - P N^-1 sum N_k G_k, with the covariance
//     A C A' + P E P',   C = cov(d) = (sum J'J / sigma^2 - sum B_k' G_k)^-1,
//     E = N^-1 (sum N_k H_k^-1 N_k) N^-1.
// It depends on the distance: it is least where the boards were. All is made of the camera's own
// views: what other cameras tell of its boards is left out, so for these it is an upper bound.
#pragma once

#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// A Grid has numbers over the image, cell by cell: `rows` x `columns`, row by row from the top
/// left.
struct Grid {
  int columns = 0, rows = 0;
  std::vector<double> values;
};

/// Coverage counts the corners in each cell of the image. `width` and `height` are in px.
Grid coverage(const Solution& solution, int sensor, const Eigen::Vector2d& image);

/// LensEquations are what one sample by itself says of the camera's freed numbers, the poses of its
/// boards eliminated: normal * d = pull for a step d from the solution.
struct LensEquations {
  int sample = -1;
  MatrixXd normal;
  VectorXd pull;
};

/// Returns those of each sample in that a camera sees boards, whose lens the solution's last step
/// freed, and whose boards are free.
std::vector<LensEquations> lens_equations(const Solution& solution, int sensor);

/// A ProjectionError says how far off a point appears at a pixel.
class ProjectionError {
 public:
  /// `sensor` is a camera whose lens the solution's last step freed; its boards are free.
  ProjectionError(const Solution& solution, int sensor);
  /// Returns the covariance in px^2 of where a point appears that stands at `distance`, in m, in
  /// the direction of a pixel; infinity is a distance. NaN where the lens does not see there, or is
  /// not determined.
  Eigen::Matrix2d covariance(const Eigen::Vector2d& pixel, double distance) const;
  /// Returns the sigma in px in the worst direction, at the middle of each cell.
  Grid grid(const Eigen::Vector2d& image, double distance) const;

  double distance() const { return distance_; }  // the middle one of the boards, m
  double tilt() const { return tilt_; }          // the largest angle of two boards' normals, rad

 private:
  const Solution* solution_;
  int sensor_;
  std::vector<int> freed_;  // of the sensor's own numbers
  bool determined_ = false;
  MatrixXd lens_;    // C
  MatrixXd motion_;  // N^-1 sum N_k G_k
  MatrixXd noise_;   // E
  double distance_ = 0, tilt_ = 0;
};

}  // namespace kincal
