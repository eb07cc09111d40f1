#include "saddle.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "finders.h"
#include "markers.h"

namespace kincal {
namespace {

constexpr double kSmooth = 0.9;    // px, sigma of the Gaussian before gradients
constexpr double kWhole = 1.1;     // px, sigma of that, of a pixel and of differences
constexpr double kMost = 10;       // px: farther away the lens bends the edges
constexpr int kMargin = 4;         // px around the window that filters need
constexpr double kFloor = 0.0035;  // px, of a coordinate: what sampling does
constexpr double kThinnest = 1.4;  // blurs that the strip beside an edge has at least
constexpr double kShortest = 2.2;  // blurs that a square of a chessboard is plain at least
constexpr size_t kSigmas = 20;     // corners of a view whose sigma is worked out, or a few less

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

  /// Returns the weight of a place beside the corner, in units, and its derivative.
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

/// Weights of a Gaussian of kSmooth, and of its derivative (of differences of neighbours).
struct Filters {
  std::array<float, 2 * kMargin + 1> smooth{}, slope{};
  Filters() {
    double sum = 0;
    const auto bell = [](int i) { return std::exp(-0.5 * i * i / (kSmooth * kSmooth)); };
    for (int i = 1 - kMargin; i < kMargin; ++i) sum += bell(i);
    const auto weight = [&](int i) { return std::abs(i) < kMargin ? bell(i) / sum : 0; };
    for (int i = -kMargin; i <= kMargin; ++i) {
      smooth[i + kMargin] = static_cast<float>(weight(i));
      slope[i + kMargin] = static_cast<float>(0.5 * (weight(i - 1) - weight(i + 1)));
    }
  }
};

const Filters& filters() {
  static const Filters known;
  return known;
}

/// A Patch is a few square pixels of numbers: patch(x, y).
using Patch = Eigen::ArrayXXf;
using Line = Eigen::ArrayXf;

/// Filtered along x, then along y; the rim of kMargin is cut off.
Patch filtered(const Patch& in, const std::array<float, 2 * kMargin + 1>& along,
               const std::array<float, 2 * kMargin + 1>& across) {
  const Eigen::Index width = in.rows() - 2 * kMargin, height = in.cols() - 2 * kMargin;
  Patch lines = Patch::Zero(width, in.cols()), out = Patch::Zero(width, height);
  for (int k = 0; k <= 2 * kMargin; ++k)
    lines += along[static_cast<size_t>(k)] * in.middleRows(k, width);
  for (int k = 0; k <= 2 * kMargin; ++k)
    out += across[static_cast<size_t>(k)] * lines.middleCols(k, height);
  return out;
}

/// The gradients around a corner.
struct Slopes {
  Patch dx, dy;
};

/// Gradients of a square of pixels, `half` to every side of the middle; beyond the rim of the image
/// its pixels are repeated.
Slopes slopes_around(const cv::Mat& image, const cv::Point& middle, int half) {
  const int reach = half + kMargin;
  Patch grey(2 * reach + 1, 2 * reach + 1);
  for (int y = 0; y < grey.cols(); ++y) {
    const uchar* from = image.ptr(std::clamp(middle.y + y - reach, 0, image.rows - 1));
    for (int x = 0; x < grey.rows(); ++x)
      grey(x, y) = from[std::clamp(middle.x + x - reach, 0, image.cols - 1)];
  }
  const Filters& f = filters();
  return {filtered(grey, f.slope, f.smooth), filtered(grey, f.smooth, f.slope)};
}

/// Gram matrix of the gradients, and how far they would move the corner: a step from q, px.
cv::Vec2d step_from(const Slopes& slopes, const Window& window, const cv::Point2d& q,
                    cv::Matx22d& gram) {
  const Eigen::Index width = slopes.dx.rows();
  const Line right =
      Line::LinSpaced(width, 0, static_cast<float>(width - 1)) - static_cast<float>(q.x);
  const cv::Matx22f units = window.units;
  const cv::Vec2f reach(1 / window.reach[0], 1 / window.reach[1]),
      strip(1 / window.strip[0], 1 / window.strip[1]);
  const auto hill = [](const auto& x) { return (1 - x.square()).max(0).square(); };
  Line a(width), b(width), weights(width), r(width);
  double xx = 0, xy = 0, yy = 0, x0 = 0, y0 = 0;
  for (Eigen::Index y = 0; y < slopes.dx.cols(); ++y) {
    const auto gx = slopes.dx.col(y), gy = slopes.dy.col(y);
    const float down = static_cast<float>(static_cast<double>(y) - q.y);
    a = units(0, 0) * right + units(0, 1) * down;
    b = units(1, 0) * right + units(1, 1) * down;
    weights =
        (hill(reach[0] * a) * hill(strip[1] * b)).max(hill(reach[1] * b) * hill(strip[0] * a));
    r = gx * right + gy * down;
    xx += (weights * gx * gx).sum(), xy += (weights * gx * gy).sum();
    yy += (weights * gy * gy).sum();
    x0 += (weights * r * gx).sum(), y0 += (weights * r * gy).sum();
  }
  gram = cv::Matx22d(xx, xy, xy, yy);
  return gram.inv() * cv::Vec2d(x0, y0);
}

/// The products of two or one patches, weighed by the noise of the pixels. `origin`: where in the
/// image they begin.
std::array<double, 3> noise_products(const Patch& a, const Patch& b, const cv::Point& origin,
                                     const PixelNoise& noise) {
  const double white = noise.sigma * noise.sigma;
  if (!noise.compression.any())
    return {white * (a * a).sum(), white * (a * b).sum(), white * (b * b).sum()};
  std::array<double, 3> out{};
  const auto block = [](const Patch& from, int left, int top) {
    Block pixels = Block::zeros();
    for (int y = std::max(0, -top); y < 8 && top + y < from.cols(); ++y)
      for (int x = std::max(0, -left); x < 8 && left + x < from.rows(); ++x)
        pixels(x, y) = static_cast<double>(from(left + x, top + y));
    return cosine_transform(pixels);
  };
  const auto before = [](int at) { return -(at % 8 + 8) % 8; };
  for (int top = before(origin.y); top < a.cols(); top += 8)
    for (int left = before(origin.x); left < a.rows(); left += 8) {
      const Block one = block(a, left, top), other = block(b, left, top);
      for (int u = 0; u < 8; ++u)
        for (int v = 0; v < 8; ++v) {
          const double step =
              noise.compression.steps[static_cast<size_t>(v) * 8 + static_cast<size_t>(u)];
          const double variance = white + step * step / 12;
          out[0] += variance * one(u, v) * one(u, v);
          out[1] += variance * one(u, v) * other(u, v);
          out[2] += variance * other(u, v) * other(u, v);
        }
    }
  return out;
}

/// The covariance of the corner. `first`: the pixel of the image at which the slopes begin.
cv::Matx22d covariance(const Slopes& slopes, const Window& window, const cv::Point2d& q,
                       const cv::Matx22d& gram, const cv::Point& first, const PixelNoise& noise) {
  const Patch nothing = Patch::Zero(slopes.dx.rows() + 4 * kMargin, slopes.dx.cols() + 4 * kMargin);
  std::array<Patch, 2> a = {nothing, nothing}, b = a;  // of F's two rows
  cv::Matx22d j = gram;
  for (int y = 0; y < slopes.dx.cols(); ++y)
    for (int x = 0; x < slopes.dx.rows(); ++x) {
      const cv::Vec2d g(slopes.dx(x, y), slopes.dy(x, y)), away(x - q.x, y - q.y);
      cv::Vec2d dw;
      const double w = window(window.units * away, dw);
      if (w == 0) continue;
      const double r = g.dot(away);
      j += r * g * (window.units.t() * dw).t();
      for (const int k : {0, 1}) {
        const cv::Vec2d of_slopes =
            w * (away * g[k] + (k == 0 ? cv::Vec2d(r, 0) : cv::Vec2d(0, r)));
        a[static_cast<size_t>(k)](x + 2 * kMargin, y + 2 * kMargin) =
            static_cast<float>(of_slopes[0]);
        b[static_cast<size_t>(k)](x + 2 * kMargin, y + 2 * kMargin) =
            static_cast<float>(of_slopes[1]);
      }
    }
  const Filters& f = filters();
  const auto of_pixels = [&](size_t k) -> Patch {
    return filtered(a[k], f.slope, f.smooth) + filtered(b[k], f.smooth, f.slope);
  };
  const Patch c0 = of_pixels(0), c1 = of_pixels(1);
  const auto products = noise_products(c0, c1, first - cv::Point(kMargin, kMargin), noise);
  const cv::Matx22d cc(products[0], products[1], products[1], products[2]);
  const cv::Matx22d inverse = j.inv();
  return inverse * cc * inverse.t();
}

/// Whether four fields meet at a corner, dark and bright in turn: at the rim of a print one or
/// three are dark.
bool fields_meet(const cv::Mat& image, const Saddle& corner) {
  constexpr double kInside = 0.7, kLeast = 0.2;  // of the strip; of what is between the fields
  const double s = kInside * corner.strip;
  const auto field = [&](double x, double y) {
    return brightness(image, corner.pixel + cv::Point2d(corner.sides * cv::Vec2d(x, y)));
  };
  const std::array<double, 2> one = {field(s, s), field(-s, -s)},
                              two = {field(s, -s), field(-s, s)};
  const auto [low, high] = std::minmax({one[0], one[1], two[0], two[1]});
  const bool dark = one[0] + one[1] < two[0] + two[1];
  const auto &below = dark ? one : two, &above = dark ? two : one;
  return std::min(above[0], above[1]) - std::max(below[0], below[1]) > kLeast * (high - low);
}

}  // namespace

bool refine(const cv::Mat& image, Saddle& saddle, const PixelNoise* noise) {
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
  const int size = static_cast<int>(std::ceil(std::max(half[0], half[1]))) + 2;
  const cv::Point middle(cvRound(at.x), cvRound(at.y)), corner = middle - cv::Point(size, size);
  const Slopes slopes = slopes_around(image, middle, size);
  const cv::Point2d start = at - cv::Point2d(corner);
  cv::Point2d q = start;
  cv::Matx22d gram;
  for (int pass = 0; pass < 30; ++pass) {
    const cv::Vec2d step = step_from(slopes, window, q, gram);
    if (!(cv::determinant(gram) > 1e-3 * gram(0, 0) * gram(1, 1))) return false;  // one edge
    q += cv::Point2d(step[0], step[1]);
    if (!(cv::norm(q - start) < std::max(1.5, 0.5 * thin))) return false;
    if (cv::norm(step) < 1e-3) break;
  }
  if (noise) {
    const cv::Matx22d c = covariance(slopes, window, q, gram, corner, *noise);
    saddle.sigma = std::sqrt(0.5 * (c(0, 0) + c(1, 1)));
  }
  saddle.pixel = q + cv::Point2d(corner);
  return true;
}

Detection refined(const cv::Mat& image, const Compression& compression,
                  std::vector<Saddle> saddles) {
  Detection out;
  for (const Saddle& one : saddles) out.pixels.push_back(one.pixel);
  judge(image, out);
  if (compression.any()) {
    std::vector<cv::Point2f> corners(out.pixels.begin(), out.pixels.end());
    const double before =
        noise_before(image, cv::boundingRect(corners) & cv::Rect({}, image.size()), compression);
    if (before >= 0) out.noise = before;
  }
  const PixelNoise pixel_noise{out.noise, compression};
  out.pixels.clear();
  const size_t stride = 1 + saddles.size() / kSigmas;
  double floor = 0, noise = 0;  // squared sigmas
  int count = 0;                // of noise
  for (Saddle& one : saddles) {
    const double across = std::abs(cv::determinant(one.sides)) /
                          std::max(cv::norm(one.sides.col(0)), cv::norm(one.sides.col(1)));
    const double blurs = one.strip * across / std::max(1.36, std::hypot(out.blur, kSmooth));
    const bool with_sigma = out.ids.size() % stride == 0;
    if (blurs < (one.squares ? kShortest : kThinnest) ||
        !refine(image, one, with_sigma ? &pixel_noise : nullptr))
      continue;
    if (!one.squares && !fields_meet(image, one)) {
      out.no_corners.push_back(one.id);
      continue;
    }
    // px: what the edges of the next squares do, or markers next to the strip
    const double width = std::max(1.36, std::hypot(out.blur, kWhole));
    const double beside = one.squares
                              ? 0.4 * std::exp(-1.6 * blurs)
                              : 0.082 * width * std::exp(-1.54 * one.strip * across / width);
    floor += kFloor * kFloor + beside * beside;
    if (with_sigma) noise += one.sigma * one.sigma, ++count;
    out.ids.push_back(one.id);
    out.pixels.push_back(one.pixel);
  }
  if (out.ids.empty()) return out;
  floor /= static_cast<double>(out.ids.size());
  out.floor = std::sqrt(floor);
  if (count > 0) out.sigma = std::sqrt(noise / count + floor);
  return out;
}

}  // namespace kincal
