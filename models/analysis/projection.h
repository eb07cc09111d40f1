// Quality of a camera's calibration over its image: the density of corners, and the predicted error
// of a point's position.
//
// Projection. The parameters of a lens are correlated: a longer focal length with boards further
// away, a shifted principal point with a turned camera. Relevant for use is the image position of a
// point that is fixed relative to the boards. So the camera may move to where the boards place it
// (as mrcal does): with errors d of the estimated lens parameters, the pose of board k in the
// camera's frame has the error
//     pi_k = e_k - G_k d,   G_k = H_k^-1 B_k,   e_k ~ N(0, H_k^-1),
// H_k = sum P'P, B_k = sum P'J over the board's points, both over sigma^2, P the derivatives of a
// pixel by a motion of the board and J by the lens; e_k is independent of d, because d comes from
// the residuals after the poses are eliminated. The rigid motion xi of all boards that is closest
// to these errors, point by point, is their weighted mean,
//     xi = N^-1 sum N_k pi_k,   N_k = sum D'D over its points,   D = [I | -[p]x],   N = sum N_k.
// A point that moves with the boards then has the image error  J d + P xi = A d + P N^-1 sum N_k
// e_k,  A = J - P N^-1 sum N_k G_k, with the covariance
//     A C A' + P E P',   C = cov(d) = (sum J'J / sigma^2 - sum B_k' G_k)^-1,
//     E = N^-1 (sum N_k H_k^-1 N_k) N^-1.
// It depends on the distance: it is smallest at the boards' distance. It uses the camera's own
// views only; if other cameras see its boards too, it is an upper bound.
#pragma once

#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// A Grid has values over the image, cell by cell: `rows` x `columns`, row by row from the top
/// left.
struct Grid {
  int columns = 0, rows = 0;
  std::vector<double> values;
};

/// Returns the number of corners in each cell of the image. `image` is (width, height) in px.
Grid coverage(const Solution& solution, int sensor, const Eigen::Vector2d& image);

/// LensEquations are the information of one sample alone about the camera's estimated parameters,
/// with the poses of its boards eliminated: normal * d = pull for a step d from the solution.
struct LensEquations {
  int sample = -1;
  MatrixXd normal;
  VectorXd pull;
};

/// Returns the equations of each sample in which the camera sees boards. The solution's last step
/// must have estimated its lens, and its boards must be free.
std::vector<LensEquations> lens_equations(const Solution& solution, int sensor);

/// A ProjectionError is the predicted error of a point's position in the image.
class ProjectionError {
 public:
  /// `sensor` is a camera whose lens the solution's last step estimated; its boards are free.
  ProjectionError(const Solution& solution, int sensor);
  /// Returns the covariance in px^2 of the image position of a point in the direction of a pixel,
  /// at `distance` in m (infinity is permitted). NaN if the lens does not see there, or is not
  /// determined.
  Eigen::Matrix2d covariance(const Eigen::Vector2d& pixel, double distance) const;
  /// Returns the sigma in px in the worst direction, at the centre of each cell.
  Grid grid(const Eigen::Vector2d& image, double distance) const;

  double distance() const { return distance_; }  // median distance of the boards, m
  double tilt() const { return tilt_; }          // largest angle between two boards' normals, rad

 private:
  const Solution* solution_;
  int sensor_;
  std::vector<int> freed_;  // indices into the sensor's own parameters
  bool determined_ = false;
  MatrixXd lens_;    // C
  MatrixXd motion_;  // N^-1 sum N_k G_k
  MatrixXd noise_;   // E
  double distance_ = 0, tilt_ = 0;
};

}  // namespace kincal
