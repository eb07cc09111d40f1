#include "saddle.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "../../models/rig/numbers.h"
#include "finders.h"
#include "markers.h"

namespace kincal {
namespace {

constexpr double kSmooth = 0.9;  // px, sigma of the Gaussian before gradients
constexpr double kWhole = 1.1;   // px, sigma of that, of a pixel and of differences
constexpr double kMost = 10;     // px: farther away the lens bends the edges
constexpr double kNarrow = 3;    // px, of the window to every side: less tells no corner
constexpr int kMargin = 4;       // px around the window that filters need
// px, of a coordinate: what sampling does (rendered boards with noise of 0.3 and 1 grey level)
constexpr double kFloor = 0.0023;
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

/// Gradients of a square of pixels, `half` to every side of the middle, as they were if the light
/// were the same there; beyond the rim of the image its pixels are repeated.
Slopes slopes_around(const cv::Mat& image, const cv::Point& middle, int half,
                     const cv::Vec2d& light) {
  const int reach = half + kMargin;
  Patch grey(2 * reach + 1, 2 * reach + 1);
  for (int y = 0; y < grey.cols(); ++y) {
    const uchar* from = image.ptr(std::clamp(middle.y + y - reach, 0, image.rows - 1));
    for (int x = 0; x < grey.rows(); ++x)
      grey(x, y) = from[std::clamp(middle.x + x - reach, 0, image.cols - 1)] *
                   static_cast<float>(1 - light[0] * (x - reach) - light[1] * (y - reach));
  }
  const Filters& f = filters();
  return {filtered(grey, f.slope, f.smooth), filtered(grey, f.smooth, f.slope)};
}

/// What the gradients say of a corner at q: their Gram matrix, how far they would move it (px), and
/// how far from it their edges run (px, rms).
struct Pull {
  cv::Matx22d gram;
  cv::Vec2d step;
  double miss = 0;
};

Pull pull_at(const Slopes& slopes, const Window& window, const cv::Point2d& q) {
  const Eigen::Index width = slopes.dx.rows();
  const Line right =
      Line::LinSpaced(width, 0, static_cast<float>(width - 1)) - static_cast<float>(q.x);
  const cv::Matx22f units = window.units;
  const cv::Vec2f reach(1 / window.reach[0], 1 / window.reach[1]),
      strip(1 / window.strip[0], 1 / window.strip[1]);
  const auto hill = [](const auto& x) { return (1 - x.square()).max(0).square(); };
  Line a(width), b(width), weights(width), r(width);
  double xx = 0, xy = 0, yy = 0, x0 = 0, y0 = 0, rr = 0;
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
    rr += (weights * r * r).sum();
  }
  const cv::Matx22d gram(xx, xy, xy, yy);
  return {gram, gram.inv() * cv::Vec2d(x0, y0), std::sqrt(rr / (xx + yy))};
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

/// How far around a place the image goes, px: nothing is known beyond its rim.
double inside(const cv::Mat& image, const cv::Point2d& at) {
  return std::min(std::min(at.x, at.y), std::min(image.cols - 1 - at.x, image.rows - 1 - at.y)) - 1;
}

/// Whether four fields meet at a corner, dark and bright in turn: at the rim of a print one or
/// three are dark.
bool fields_meet(const cv::Mat& image, const Saddle& corner) {
  constexpr double kInside = 0.7, kApart = 0.2;  // of the strip; of what is between the fields
  const double s = kInside * corner.strip;
  const auto field = [&](double x, double y) {
    return brightness(image, corner.pixel + cv::Point2d(corner.sides * cv::Vec2d(x, y)));
  };
  const std::array<double, 2> one = {field(s, s), field(-s, -s)},
                              two = {field(s, -s), field(-s, s)};
  const auto [low, high] = std::minmax({one[0], one[1], two[0], two[1]});
  const bool dark = one[0] + one[1] < two[0] + two[1];
  const auto &below = dark ? one : two, &above = dark ? two : one;
  return std::min(above[0], above[1]) - std::max(below[0], below[1]) > kApart * (high - low);
}

/// A Level is how bright a field of the print is, and where.
struct Level {
  cv::Point2d at;
  double grey = 0;
};

/// The levels of the two bright fields at a corner, without the dark that blur brings into them
/// from beside: along the edges, as far as the fields are plain. `look`: contrast and blur.
void add_levels(const cv::Mat& image, const Saddle& one, const Detection& look,
                std::vector<Level>& out) {
  constexpr double kMostDark = 0.06;                          // of what is between dark and bright
  const double beside = one.squares ? 0.3 : one.strip / 1.8;  // units: the middle of the strip
  const double sigma = std::sqrt(look.blur * look.blur + 0.25);  // px: of edges, between pixels
  const double area = std::abs(cv::determinant(one.sides));
  std::array<Level, 4> fields{};  // the first and the last are of one kind
  for (size_t i = 0; i < 4; ++i) {
    const double x = i < 2 ? -1 : 1, y = i % 2 == 0 ? -1 : 1;
    for (const double along : {0.16, 0.23, 0.3, 0.37, 0.44})
      for (const int edge : {0, 1}) {
        const double away = beside * area / cv::norm(one.sides.col(edge));  // px
        const double dark = one.squares ? 0 : std::erfc(away / sigma * std::sqrt(0.5));
        const cv::Vec2d place =
            edge == 0 ? cv::Vec2d(x * along, y * beside) : cv::Vec2d(x * beside, y * along);
        const cv::Point2d at = one.pixel + cv::Point2d(one.sides * place);
        if (dark > kMostDark ||
            !(at.x >= 0 && at.y >= 0 && at.x < image.cols - 1 && at.y < image.rows - 1))
          return;
        fields[i].grey += 0.1 * (brightness(image, at) + 255 * look.contrast * dark);
        fields[i].at += 0.1 * at;
      }
  }
  const bool first = fields[0].grey + fields[3].grey > fields[1].grey + fields[2].grey;
  out.push_back(fields[first ? 0 : 1]);
  out.push_back(fields[first ? 3 : 2]);
}

/// Says how the light changes at the corners: a polynomial of the levels, if it explains them.
void add_light(const cv::Mat& image, const Detection& look, std::vector<Saddle>& saddles) {
  constexpr int kFewest = 12, kEnough = 36;  // levels, for a plane; for a polynomial of degree 2
  constexpr double kLeft = 0.33;             // of what differs, at most
  std::vector<Level> levels;
  for (const Saddle& one : saddles) add_levels(image, one, look, levels);
  const int n = static_cast<int>(levels.size()), terms = n < kEnough ? 3 : 6;
  if (n < kFewest) return;
  const cv::Point2d middle = 0.5 * cv::Point2d(image.cols, image.rows);
  const auto seen_from = [&](const cv::Point2d& at) { return (at - middle) / middle.x; };
  cv::Mat a(n, terms, CV_64F), b(n, 1, CV_64F), c;
  for (int i = 0; i < n; ++i) {
    const Level& level = levels[static_cast<size_t>(i)];
    const cv::Point2d at = seen_from(level.at);
    const std::array<double, 6> row = {1, at.x, at.y, at.x * at.x, at.x * at.y, at.y * at.y};
    for (int k = 0; k < terms; ++k) a.at<double>(i, k) = row[static_cast<size_t>(k)];
    b.at<double>(i) = std::log(std::max(1., level.grey));
  }
  if (!cv::solve(a, b, c, cv::DECOMP_SVD)) return;
  if (cv::norm(a * c - b) > kLeft * cv::norm(b - cv::mean(b)[0])) return;
  c.resize(6, cv::Scalar(0));
  const double* k = c.ptr<double>();
  for (Saddle& one : saddles) {
    const cv::Point2d at = seen_from(one.pixel);
    one.light = cv::Vec2d((k[1] + 2 * k[3] * at.x + k[4] * at.y) / middle.x,
                          (k[2] + k[4] * at.x + 2 * k[5] * at.y) / middle.x);
  }
}

/// Leaves out corners beside which something lies before the print: edges miss them that miss the
/// others less. Where one is hidden without doubt, those that are less so go with it.
void leave_out_hidden(const std::vector<double>& misses, Detection& found) {
  constexpr double kMore = 1.12, kSurely = 4, kLikely = 2.5;  // of the usual; spreads beyond it
  const double usual = median(misses, 0);
  std::vector<double> away;
  for (const double miss : misses) away.push_back(std::abs(miss - usual));
  const double spread = 1.48 * median(away, 0);
  const auto beyond = [&](double miss, double spreads) {
    return miss > std::max(kMore * usual, usual + spreads * spread);
  };
  if (std::none_of(misses.begin(), misses.end(), [&](double m) { return beyond(m, kSurely); }))
    return;
  size_t kept = 0;
  for (size_t i = 0; i < misses.size(); ++i) {
    if (beyond(misses[i], kLikely)) continue;
    found.ids[kept] = found.ids[i];
    found.pixels[kept++] = found.pixels[i];
  }
  found.ids.resize(kept);
  found.pixels.resize(kept);
}

}  // namespace

bool refine(const cv::Mat& image, Saddle& saddle, const PixelNoise* noise) {
  const cv::Point2d at = saddle.pixel;
  const double most = std::min(kMost, inside(image, at));
  if (most < kNarrow) return false;
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
  const Slopes slopes = slopes_around(image, middle, size, saddle.light);
  const cv::Point2d start = at - cv::Point2d(corner);
  cv::Point2d q = start;
  Pull pull;
  for (int pass = 0; pass < 30; ++pass) {
    pull = pull_at(slopes, window, q);
    const cv::Matx22d& gram = pull.gram;
    if (!(cv::determinant(gram) > 1e-3 * gram(0, 0) * gram(1, 1))) return false;  // one edge
    q += cv::Point2d(pull.step[0], pull.step[1]);
    if (!(cv::norm(q - start) < std::max(1.5, 0.5 * thin))) return false;
    if (cv::norm(pull.step) < 1e-3) break;
  }
  if (inside(image, q + cv::Point2d(corner)) < kNarrow) return false;  // it was guessed farther in
  if (noise) {
    const cv::Matx22d c = covariance(slopes, window, q, pull.gram, corner, *noise);
    saddle.sigma = std::sqrt(0.5 * (c(0, 0) + c(1, 1)));
  }
  saddle.pixel = q + cv::Point2d(corner);
  saddle.miss = pull.miss;
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
  add_light(image, out, saddles);
  const size_t stride = 1 + saddles.size() / kSigmas;
  double floor = 0, noise = 0;  // squared sigmas
  int count = 0;                // of noise
  std::vector<double> misses;   // of the corners that are kept
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
    misses.push_back(one.miss);
  }
  leave_out_hidden(misses, out);
  if (out.ids.empty()) return out;
  floor /= static_cast<double>(out.ids.size());
  out.floor = std::sqrt(floor);
  if (count > 0 && out.noise > 0) out.sigma = std::sqrt(noise / count + floor);
  return out;
}

}  // namespace kincal
