#include "saddle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "finders.h"

namespace kincal {
namespace {

constexpr double kSmooth = 0.9;   // px, sigma of the Gaussian before gradients
constexpr double kMost = 10;      // px: farther away the lens bends the edges
constexpr int kMargin = 4;        // px around the window that filters need
constexpr double kFloor = 0.003;  // px, of a coordinate: what sampling does

/// A Window is the weights around a corner: a cross along the edges, 1 at the corner and 0 where
/// what is plain ends.
struct Window {
  cv::Matx22d units;  // of the print, of a step of one pixel
  std::array<double, 2> reach, strip;

  static double hill(double x) { return std::abs(x) < 1 ? (1 - x * x) * (1 - x * x) : 0; }
  static double slope(double x) { return std::abs(x) < 1 ? -4 * x * (1 - x * x) : 0; }

  /// Returns whether a place is beside the cross, where the weight is 0.
  bool beside(const cv::Vec2d& at) const {
    const double x = std::abs(at[0]), y = std::abs(at[1]);
    return x >= reach[0] || y >= reach[1] || (x >= strip[0] && y >= strip[1]);
  }

  /// Returns the weight of a place beside the corner, in units.
  double operator()(const cv::Vec2d& at) const {
    if (beside(at)) return 0;
    return std::max(hill(at[0] / reach[0]) * hill(at[1] / strip[1]),
                    hill(at[1] / reach[1]) * hill(at[0] / strip[0]));
  }

  /// Returns the same and its derivative.
  double operator()(const cv::Vec2d& at, cv::Vec2d& derivative) const {
    if (beside(at)) return 0;
    const double a = hill(at[0] / reach[0]), b = hill(at[1] / strip[1]), c = hill(at[1] / reach[1]),
                 d = hill(at[0] / strip[0]);
    derivative = a * b > c * d ? cv::Vec2d(slope(at[0] / reach[0]) / reach[0] * b,
                                           slope(at[1] / strip[1]) / strip[1] * a)
                               : cv::Vec2d(slope(at[0] / strip[0]) / strip[0] * c,
                                           slope(at[1] / reach[1]) / reach[1] * d);
    return std::max(a * b, c * d);
  }
};

/// One pixel of the window.
struct Seen {
  int x, y;
  cv::Vec2d g, away;  // the gradient; the way from the corner, px
  double w;
  cv::Vec2d dw;  // derivative of w by the way
};

std::vector<Seen> seen_pixels(const cv::Mat& dx, const cv::Mat& dy, const Window& window,
                              const cv::Point2d& q) {
  std::vector<Seen> out;
  for (int y = kMargin; y < dx.rows - kMargin; ++y)
    for (int x = kMargin; x < dx.cols - kMargin; ++x) {
      const cv::Vec2d away(x - q.x, y - q.y);
      cv::Vec2d dw;
      const double w = window(window.units * away, dw);
      if (w > 0)
        out.push_back(
            {x, y, {dx.at<float>(y, x), dy.at<float>(y, x)}, away, w, window.units.t() * dw});
    }
  return out;
}

/// Gram matrix of the gradients, and how far they would move the corner: a step from q, px.
cv::Vec2d step_from(const cv::Mat& dx, const cv::Mat& dy, const Window& window,
                    const cv::Point2d& q, cv::Matx22d& gram) {
  double xx = 0, xy = 0, yy = 0, x0 = 0, y0 = 0;
  for (int y = kMargin; y < dx.rows - kMargin; ++y) {
    const float *gx = dx.ptr<float>(y), *gy = dy.ptr<float>(y);
    for (int x = kMargin; x < dx.cols - kMargin; ++x) {
      const cv::Vec2d away(x - q.x, y - q.y);
      const double w = window(window.units * away);
      if (w == 0) continue;
      const double r = w * (gx[x] * away[0] + gy[x] * away[1]);
      xx += w * gx[x] * gx[x], xy += w * gx[x] * gy[x], yy += w * gy[x] * gy[x];
      x0 += r * gx[x], y0 += r * gy[x];
    }
  }
  gram = cv::Matx22d(xx, xy, xy, yy);
  return gram.inv() * cv::Vec2d(x0, y0);
}

/// The covariance of the corner for noise of one grey level in every pixel.
cv::Matx22d covariance(const std::vector<Seen>& seen, const cv::Matx22d& gram, cv::Size size) {
  cv::Mat a(size, CV_32FC2, cv::Scalar()), b(size, CV_32FC2, cv::Scalar());
  cv::Matx22d j = gram;
  for (const Seen& one : seen) {
    const double r = one.g.dot(one.away);
    j += r * one.g * one.dw.t();
    a.at<cv::Vec2f>(one.y, one.x) = one.w * (cv::Vec2d(r, 0) + one.away[0] * one.g);
    b.at<cv::Vec2f>(one.y, one.x) = one.w * (cv::Vec2d(0, r) + one.away[1] * one.g);
  }
  cv::Sobel(a, a, CV_32F, 1, 0, 1, -0.5);
  cv::Sobel(b, b, CV_32F, 0, 1, 1, -0.5);
  cv::Mat c = a + b;
  cv::GaussianBlur(c, c, {2 * kMargin - 1, 2 * kMargin - 1}, kSmooth);
  cv::Matx22d cc = cv::Matx22d::zeros();
  for (int y = 0; y < c.rows; ++y)
    for (int x = 0; x < c.cols; ++x) {
      const cv::Vec2d v = c.at<cv::Vec2f>(y, x);
      cc += v * v.t();
    }
  const cv::Matx22d inverse = j.inv();
  return inverse * cc * inverse.t();
}

}  // namespace

bool refine(const cv::Mat& image, Saddle& saddle) {
  const cv::Point2d at = saddle.pixel;
  const double room =
      std::min(std::min(at.x, at.y), std::min(image.cols - 1 - at.x, image.rows - 1 - at.y));
  const double most = std::min(kMost, room - 1);  // nothing is known beyond the rim of the image
  if (most < 3) return false;
  Window window;
  window.units = saddle.sides.inv();
  cv::Vec2d half;
  double thin = 1e9;
  for (int k = 0; k < 2; ++k) {
    const double side = cv::norm(saddle.sides.col(k));
    window.reach[k] = std::min(saddle.reach, most / side);
    window.strip[k] = std::min(saddle.strip, most / side);
    thin = std::min(thin, window.strip[k] * side);
    half += window.reach[k] * cv::Vec2d(std::abs(saddle.sides(0, k)), std::abs(saddle.sides(1, k)));
  }
  const int size = static_cast<int>(std::ceil(std::max(half[0], half[1]))) + 2 + kMargin;
  const cv::Point middle(cvRound(saddle.pixel.x), cvRound(saddle.pixel.y));
  cv::Mat smooth, dx, dy;
  cv::getRectSubPix(image, {2 * size + 1, 2 * size + 1}, cv::Point2f(middle), smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {2 * kMargin - 1, 2 * kMargin - 1}, kSmooth);
  cv::Sobel(smooth, dx, CV_32F, 1, 0, 1, 0.5);
  cv::Sobel(smooth, dy, CV_32F, 0, 1, 1, 0.5);
  const cv::Point2d corner = middle - cv::Point(size, size), start = saddle.pixel - corner;
  cv::Point2d q = start;
  cv::Matx22d gram;
  for (int pass = 0; pass < 30; ++pass) {
    const cv::Vec2d step = step_from(dx, dy, window, q, gram);
    if (!(cv::determinant(gram) > 1e-3 * gram(0, 0) * gram(1, 1))) return false;  // one edge
    q += cv::Point2d(step[0], step[1]);
    if (!(cv::norm(q - start) < std::max(1.5, 0.5 * thin))) return false;
    if (cv::norm(step) < 1e-3) break;
  }
  const cv::Matx22d c = covariance(seen_pixels(dx, dy, window, q), gram, smooth.size());
  saddle.sigma = std::sqrt(0.5 * (c(0, 0) + c(1, 1)));
  saddle.pixel = q + corner;
  return true;
}

Detection refined(const cv::Mat& image, std::vector<Saddle> saddles) {
  Detection out;
  for (const Saddle& one : saddles) out.pixels.push_back(one.pixel);
  judge(image, out);
  out.pixels.clear();
  double squares = 0;
  for (Saddle& one : saddles) {
    const double across = std::abs(cv::determinant(one.sides)) /
                          std::max(cv::norm(one.sides.col(0)), cv::norm(one.sides.col(1)));
    const double blurs = one.strip * across / std::max(1.36, std::hypot(out.blur, kSmooth));
    if (blurs < 1.4 || !refine(image, one)) continue;
    const double beside = 0.12 * std::exp(-1.4 * blurs);  // px: what is next to the strip does
    squares += std::pow(out.noise * one.sigma, 2) + kFloor * kFloor + beside * beside;
    out.ids.push_back(one.id);
    out.pixels.push_back(one.pixel);
  }
  if (!out.ids.empty()) out.sigma = std::sqrt(squares / static_cast<double>(out.ids.size()));
  return out;
}

}  // namespace kincal
