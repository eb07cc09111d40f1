#include "static_view.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "../../solver/decompositions.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"

namespace kincal {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Vector2d;

constexpr double kLeastNoise = 0.01;  // px: rounding of detectors, where all pictures are the same
constexpr double kUsualShift = 20;    // px: a camera that is hit; the drift watch also tries 1/100
constexpr int kHomography = 8;
// Of normal numbers: their sigma over the median of their absolute values, and how many of them
// tell as much of it as one in a sum of squares.
constexpr double kNormal = 1.4826, kEfficiency = 0.37;

/// A SeenPoint is a point of a picture.
struct SeenPoint {
  int point;
  Vector2d off, expected;  // from its place; variances of that before the picture
  bool outlier;
};

}  // namespace

struct StaticView::Parts {
  /// A Picture is what one sample shows.
  struct Picture {
    std::vector<int> points;
    Matrix2Xd pixels;
  };

  int points;
  StaticViewOptions options;
  long samples = 0;
  std::vector<Picture> learning;
  std::optional<DriftWatch> test;  // absent: still learning
  // By point, once learnt:
  Matrix2Xd places;         // px, as learnt; the watch's columns are what they differ by
  std::vector<int> column;  // the first of two; -1: not watched
  std::vector<double> squares, residuals;        // of the noise
  std::vector<std::optional<Vector2d>> was_off;  // by how much, in the sample before
  Vector2d middle;                               // of all places, px
  double size = 1;                               // half the diagonal of all places, px
  double spread = kLeastNoise;                   // noise of all points, px
  Picture last;

  double variance(int point) const {
    return std::max(kLeastNoise * kLeastNoise, (kNoiseKnown * spread * spread + squares[point]) /
                                                   (kNoiseKnown + residuals[point]));
  }
  /// Derivatives of a pixel by the homography, in px at the edge of all places.
  Eigen::Matrix<double, 2, kHomography> homography(int point) const {
    const double x = (places(0, point) - middle.x()) / size,
                 y = (places(1, point) - middle.y()) / size;
    Eigen::Matrix<double, 2, kHomography> out;
    out << 1, 0, x, y, 0, 0, x * x, x * y,  //
        0, 1, 0, 0, x, y, x * y, y * y;
    return out;
  }
  /// Whether two places of a point are further apart than its noise explains; `times`: so many of
  /// them are noisy.
  bool differ(int point, const Vector2d& a, const Vector2d& b, int times) const {
    return f_tail((a - b).squaredNorm() / (2 * times * variance(point)), 2,
                  kNoiseKnown + residuals[point]) < kOutlier;
  }
  void learn();
  void follow_camera(std::vector<SeenPoint>& seen) const;
};

/// Takes for outliers only what a motion of the camera does not explain either: a homography,
/// fitted to the points nearest to it, from the middle shift on.
void StaticView::Parts::follow_camera(std::vector<SeenPoint>& seen) const {
  constexpr int kRounds = 5;
  VectorXd camera = VectorXd::Zero(kHomography);
  for (int k = 0; k < 2; ++k) {
    std::vector<double> off;
    for (const SeenPoint& s : seen) off.push_back(s.off(k));
    camera(k) = median(off);
  }
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> distance;
    for (const SeenPoint& s : seen)
      distance.push_back((s.off - homography(s.point) * camera).norm());
    // Normal noise in two directions has its median at 1.18 sigmas; beyond 3 it is another point.
    const double nearest = std::max(3 * spread, 3 / 1.18 * median(distance));
    MatrixXd a = MatrixXd::Zero(kHomography, kHomography);
    a.diagonal().setConstant(spread * spread / (kUsualShift * kUsualShift));
    VectorXd b = VectorXd::Zero(kHomography);
    for (size_t i = 0; i < seen.size(); ++i) {
      if (distance[i] > nearest) continue;
      const auto of = homography(seen[i].point);
      a += of.transpose() * of;
      b += of.transpose() * seen[i].off;
    }
    camera = solve_symmetric(a, b);
  }
  for (SeenPoint& s : seen) s.outlier = differ(s.point, s.off, homography(s.point) * camera, 2);
}

/// Places and noise of the first samples, by medians.
void StaticView::Parts::learn() {
  std::vector<std::vector<double>> seen[2];
  for (auto& axis : seen) axis.resize(static_cast<size_t>(points));
  for (const Picture& picture : learning)
    for (size_t i = 0; i < picture.points.size(); ++i)
      for (int k = 0; k < 2; ++k)
        seen[k][picture.points[i]].push_back(picture.pixels(k, static_cast<Index>(i)));
  places.setZero(2, points);
  column.assign(static_cast<size_t>(points), -1);
  squares.assign(static_cast<size_t>(points), 0);
  residuals.assign(static_cast<size_t>(points), 0);
  was_off.assign(static_cast<size_t>(points), std::nullopt);
  std::vector<double> off;
  std::vector<int> watched;
  std::vector<std::vector<double>> own_off(static_cast<size_t>(points));
  for (int p = 0; p < points; ++p) {
    const size_t count = seen[0][p].size();
    if (2 * count <= learning.size() || count < 3) continue;
    watched.push_back(p);
    const double small = std::sqrt(static_cast<double>(count) / (static_cast<double>(count) - 1));
    for (int k = 0; k < 2; ++k) {
      places(k, p) = median(seen[k][p]);
      for (const double z : seen[k][p]) own_off[p].push_back(small * std::abs(z - places(k, p)));
    }
    off.insert(off.end(), own_off[p].begin(), own_off[p].end());
  }
  if (watched.empty()) {
    learning.erase(learning.begin());
    return;
  }
  spread = std::max(kLeastNoise, kNormal * median(off));
  for (const int p : watched) {
    const double own = kNormal * median(own_off[p]);
    residuals[p] = kEfficiency * (static_cast<double>(own_off[p].size()) - 2);
    squares[p] = residuals[p] * own * own;
  }
  const Matrix2Xd all = places(Eigen::all, watched);
  middle = all.rowwise().mean();
  size = std::max(1.0, 0.5 * (all.rowwise().maxCoeff() - all.rowwise().minCoeff()).norm());
  const auto n = static_cast<Index>(kHomography + 2 * watched.size());
  MatrixXd covariance = MatrixXd::Zero(n, n);
  std::vector<DriftGroup> groups = {{"camera", {}, VectorXd::Constant(kHomography, kUsualShift)}};
  for (int c = 0; c < kHomography; ++c) groups[0].columns.push_back(c);
  int next = kHomography;
  for (const int p : watched) {
    column[p] = next;
    // The variance of a median is pi / 2 times that of a mean.
    covariance(next, next) = covariance(next + 1, next + 1) =
        1.5708 * variance(p) / static_cast<double>(seen[0][p].size());
    groups.push_back({"point", {next, next + 1}, VectorXd::Constant(2, kUsualShift)});
    next += 2;
  }
  test.emplace(std::move(covariance), std::move(groups), options.samples_between_alarms,
               static_cast<int>(2 * watched.size()));
  learning.clear();
}

StaticView::StaticView(int points, const StaticViewOptions& options)
    : parts_(std::make_unique<Parts>()) {
  if (points < 1) throw std::invalid_argument("points: at least 1 is expected");
  if (options.learning < 3)
    throw std::invalid_argument("learning: at least 3 samples are expected");
  if (!(options.samples_between_alarms >= 1))
    throw std::invalid_argument("samples_between_alarms: at least 1 is expected");
  parts_->points = points;
  parts_->options = options;
}
StaticView::~StaticView() = default;
StaticView::StaticView(StaticView&&) noexcept = default;
StaticView& StaticView::operator=(StaticView&&) noexcept = default;

ViewInnovation StaticView::add(const std::vector<int>& points, const Matrix2Xd& pixels) {
  Parts& p = *parts_;
  if (pixels.cols() != static_cast<Index>(points.size()))
    throw std::invalid_argument("pixels: one for every point is expected");
  if (!pixels.allFinite()) throw std::invalid_argument("pixels: a number is not finite");
  std::vector<char> has(static_cast<size_t>(p.points), 0);
  for (const int point : points) {
    if (point < 0 || point >= p.points)
      throw std::invalid_argument("points: there is no such point");
    if (has[point]++) throw std::invalid_argument("points: one is there twice");
  }
  const long number = p.samples++;
  p.last = {points, pixels};
  ViewInnovation out;
  if (!p.test) {
    out.learning = true;
    if (!points.empty()) p.learning.push_back(p.last);
    if (static_cast<int>(p.learning.size()) >= p.options.learning) p.learn();
    return out;
  }
  out.log_odds = p.test->log_statistic();
  out.alarm = p.test->alarm();

  // Each point by itself.
  std::vector<SeenPoint> seen;
  int off_count = 0;
  double least = 1;
  for (size_t i = 0; i < points.size(); ++i) {
    const int point = points[i];
    if (p.column[point] < 0) continue;
    const Vector2d off = pixels.col(static_cast<Index>(i)) - p.places.col(point);
    const Vector2d estimate = p.test->mean().segment<2>(p.column[point]);
    const int x = p.column[point], y = x + 1;
    const Vector2d known(p.test->covariance(x, x), p.test->covariance(y, y));
    const Vector2d expected = known.array() + p.variance(point);
    const double chi2 = (off - estimate).cwiseAbs2().cwiseQuotient(expected).sum();
    const double probability = f_tail(chi2 / 2, 2, kNoiseKnown + p.residuals[point]);
    least = std::min(least, probability);
    out.chi2 += chi2;
    out.dof += 2;
    out.largest = std::max(out.largest, off.norm());
    seen.push_back({point, off, expected, probability < kOutlier});
    off_count += seen.back().outlier;
  }
  if (seen.empty()) return out;
  out.probability = std::min(1.0, static_cast<double>(seen.size()) * least);
  const bool few = 2 * off_count < static_cast<int>(seen.size());
  if (!few) p.follow_camera(seen);
  std::vector<std::optional<Vector2d>> is_off(static_cast<size_t>(p.points));
  std::vector<SeenPoint> counts;
  for (const SeenPoint& s : seen) {
    if (s.outlier) is_off[s.point] = s.off;
    const auto& before = p.was_off[s.point];
    const bool stays = before && !p.differ(s.point, s.off, *before, 2);
    if (s.outlier && !stays)
      out.left_out.push_back(s.point);
    else
      counts.push_back(s);
  }
  p.was_off = std::move(is_off);
  const bool fits = few && std::none_of(counts.begin(), counts.end(),
                                        [](const SeenPoint& s) { return s.outlier; });
  if (fits)
    for (const SeenPoint& s : counts) {
      // Where the noise has the variance it is taken for, the innovation's square is 1 / h times
      // that; the sum is an unbiased estimate of it from h^2 residuals.
      const Vector2d innovation = s.off - p.test->mean().segment<2>(p.column[s.point]);
      const double variance = p.variance(s.point);
      for (int k = 0; k < 2; ++k) {
        const double h = variance / s.expected(k);
        p.squares[s.point] += variance * (h * h - h) + h * h * innovation(k) * innovation(k);
        p.residuals[s.point] += h * h;
      }
    }
  const auto rows = static_cast<Index>(2 * counts.size()), n = p.test->mean().size();
  MatrixXd j = MatrixXd::Zero(rows, n);
  VectorXd y(rows);
  for (size_t i = 0; i < counts.size(); ++i) {
    const SeenPoint& s = counts[i];
    const double sigma = std::sqrt(p.variance(s.point));
    const auto row = static_cast<Index>(2 * i);
    j.block<2, kHomography>(row, 0) = p.homography(s.point) / sigma;
    j(row, p.column[s.point]) = j(row + 1, p.column[s.point] + 1) = 1 / sigma;
    y.segment<2>(row) = s.off / sigma;
  }
  p.test->look(j, y);
  p.test->take(fits, number);
  out.log_odds = p.test->log_statistic();
  out.alarm = p.test->alarm();
  return out;
}

std::vector<ViewMoved> StaticView::moved() const {
  const Parts& p = *parts_;
  std::vector<ViewMoved> out;
  if (!p.test) return out;
  for (const Moved& moved : p.test->moved()) {
    ViewMoved one;
    one.probability = moved.probability;
    one.since = moved.since;
    one.shift = moved.change.head<2>();
    one.sigma = moved.sigma.head<2>();
    const std::vector<int>& columns = p.test->groups()[moved.group].columns;
    if (moved.group == 0) {
      for (int point = 0; point < p.points; ++point)
        if (p.column[point] >= 0)
          one.largest = std::max(one.largest, (p.homography(point) * moved.change).norm());
    } else {
      one.point = static_cast<int>(std::find(p.column.begin(), p.column.end(), columns[0]) -
                                   p.column.begin());
      one.largest = one.shift.norm();
    }
    out.push_back(one);
  }
  return out;
}

void StaticView::restart() {
  parts_->test.reset();
  parts_->learning.clear();
  if (!parts_->last.points.empty()) parts_->learning.push_back(parts_->last);
}

std::vector<double> StaticView::noise() const {
  const Parts& p = *parts_;
  std::vector<double> out(static_cast<size_t>(p.points), 0);
  if (p.test)
    for (int point = 0; point < p.points; ++point)
      if (p.column[point] >= 0) out[point] = std::sqrt(p.variance(point));
  return out;
}

long StaticView::samples() const { return parts_->samples; }

}  // namespace kincal
