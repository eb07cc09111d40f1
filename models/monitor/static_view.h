// Does a camera stand still? It watches points that do not move, of a board or the
// background. Their true positions are not needed.
//
// Model. Point i is seen at  z_i = m_i + B_i a + e_i, e_i ~ N(0, s_i^2) in both directions. Its
// place m_i and noise s_i come from the samples themselves: the first ones, of which nothing is
// said, by medians; then each sample that fits. a are the eight numbers of a small homography, 0
// until the camera moves; B_i are their derivatives at the place. What may have moved (the groups
// of drift_watch.h) is the camera, or one point alone.
//
// A point that is off by more than by chance in kOutlier of all samples is left out of a sample the
// first time, if fewer than half of its points are; the second time in a row it counts. So a
// picture that is shifted as a whole is told at once, and a point that is found wrongly is not.
//
// Not in the model: a camera that shakes, so that its points move together from picture to picture,
// and points at very different distances, which a homography does not move alike: each then also
// has moved alone.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "drift_watch.h"

namespace kincal {

struct StaticViewOptions {
  double samples_between_alarms = 10000;  // the mean, while nothing moves
  int learning = 10;                      // samples that the places are learnt from
};

/// A ViewMoved is a change that may have happened, in pixels.
struct ViewMoved {
  int point = -1;  // -1: the camera
  double probability = 0;
  long since = 0;                            // sample
  Eigen::Vector2d shift{0, 0}, sigma{0, 0};  // of the point, or at the middle of all
  double largest = 0;                        // shift of a point, of all
};

struct ViewInnovation {
  bool learning = false;      // nothing is said of it
  double chi2 = 0, dof = 0;   // of all points
  double probability = 1;     // of the point that fits worst, among so many
  std::vector<int> left_out;  // points
  double largest = 0;         // distance of a point from where it was, px
  double log_odds = 0;        // log R of the drift watch
  bool alarm = false;         // something has moved; StaticView::moved() says what
};

class StaticView {
 public:
  /// `points`: how many there are; not every sample needs all.
  /// @throws std::invalid_argument: no point, fewer than 3 samples to learn from, a rate below 1
  explicit StaticView(int points, const StaticViewOptions& options = {});
  ~StaticView();
  StaticView(StaticView&&) noexcept;
  StaticView& operator=(StaticView&&) noexcept;

  /// Takes the points of a picture: their indices and places (2 x n, px). Nothing changes where it
  /// throws. Time grows with the cube of the number of points: 48 take 1 ms.
  /// @throws std::invalid_argument: no such point, one twice, sizes that differ, not finite
  ViewInnovation add(const std::vector<int>& points, const Eigen::Matrix2Xd& pixels);
  /// Returns what may have moved, the likeliest first.
  std::vector<ViewMoved> moved() const;
  /// Learns where everything is from the next samples, beginning with the last one.
  void restart();

  /// Returns the noise of each point, px; 0: it is not watched, because most of the samples that
  /// were learnt from do not have it.
  std::vector<double> noise() const;
  long samples() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace kincal
