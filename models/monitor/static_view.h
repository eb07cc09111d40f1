// Checks whether a camera has moved, by fixed points of a board or the
// background. Their true positions are not needed.
//
// Model. Point i is seen at  z_i = m_i + B_i a + e_i, e_i ~ N(0, s_i^2) in both directions. Its
// place m_i and noise s_i come from the samples: from medians of the first ones, which are not
// judged, then from each sample that fits. a are the eight parameters of a small homography, 0
// until the camera moves; B_i are their derivatives at the place. The groups of drift_watch.h are
// the camera, and each point alone.
//
// A point whose deviation occurs by chance in less than kOutlier of all samples is left out of the
// sample the first time, if fewer than half of its points deviate; the second time in a row it
// counts. So a shift of the whole picture is reported at once, and a wrongly detected point is not.
//
// Not modelled: a camera that shakes, so that its points move together from picture to picture, and
// points at very different distances, whose motion is no homography: each then also appears to have
// moved alone.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "drift_watch.h"

namespace kincal {

struct StaticViewOptions {
  double samples_between_alarms = 10000;  // mean, while nothing moves
  int learning = 10;                      // number of samples from which places are learned
};

/// A ViewMoved is a possible change, in pixels.
struct ViewMoved {
  int point = -1;  // -1: the camera
  double probability = 0;
  long since = 0;                            // sample
  Eigen::Vector2d shift{0, 0}, sigma{0, 0};  // of the point, or at the middle of all
  double largest = 0;                        // shift of a point, of all
};

struct ViewInnovation {
  bool learning = false;      // it is not judged
  double chi2 = 0, dof = 0;   // of all points
  double probability = 1;     // of the worst-fitting point, given the number of points
  std::vector<int> left_out;  // points
  double largest = 0;         // distance of a point from where it was, px
  double log_odds = 0;        // log R of the drift watch
  bool alarm = false;         // something has moved: StaticView::moved()
};

class StaticView {
 public:
  /// `points` is the number of points; a sample may have fewer.
  /// @throws std::invalid_argument: no point, fewer than 3 samples to learn from, a rate below 1
  explicit StaticView(int points, const StaticViewOptions& options = {});
  ~StaticView();
  StaticView(StaticView&&) noexcept;
  StaticView& operator=(StaticView&&) noexcept;

  /// Adds a picture's points: their indices and positions (2 x n, px). If it throws, nothing
  /// changes. Time grows with the cube of the number of points: 48 take 1 ms.
  /// @throws std::invalid_argument: no such point, a point twice, sizes that differ, values that
  /// are not finite
  ViewInnovation add(const std::vector<int>& points, const Eigen::Matrix2Xd& pixels);
  /// Returns the possible changes, most likely first.
  std::vector<ViewMoved> moved() const;
  /// Learns the places again from the next samples, beginning with the last one.
  void restart();

  /// Returns the noise of each point, px; 0: it is not watched, because most of the learning
  /// samples lack it.
  std::vector<double> noise() const;
  long samples() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace kincal
