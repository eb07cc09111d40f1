// Grids of circles: found by OpenCV, the middles of their images corrected to the circles' centres.
//
// The centre of a circle does not project into the middle of its image when it is seen obliquely
// (then that is an ellipse), nor through a lens that bends straight lines: with a radial number k1
// and the circle's radius rho in normalised coordinates the middle is 3 k1 rho^2 x off at x. So a
// homography with a lens is fitted to all middles (plane_view.h), the rim of each circle goes
// through it, and what lies between the middle of that and the image of the centre is taken off.
// The radius comes from the area of the blobs.
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "../../models/rig/numbers.h"
#include "finders.h"
#include "plane_view.h"

namespace kincal {
namespace {

struct Blob {
  cv::Point2d middle;
  double area = 0;  // px^2
};

/// How bright it is around a blob, which changes over the image (light, vignetting): at its middle,
/// and by how much for one pixel.
struct Surround {
  double at_middle = 0;
  cv::Point2d slope;
};

/// Fitted to pixels (from the middle) and their brightness, but for those more than `tolerance`
/// from the usual one.
Surround fit_surround(const std::vector<cv::Point>& away, const std::vector<double>& bright,
                      double usual, double tolerance) {
  cv::Matx33d a = cv::Matx33d::zeros();
  cv::Vec3d b;
  for (size_t i = 0; i < away.size(); ++i) {
    if (std::abs(bright[i] - usual) > tolerance) continue;
    const cv::Vec3d row(1, away[i].x, away[i].y);
    a += row * row.t();
    b += bright[i] * row;
  }
  const cv::Vec3d x = a.solve(b, cv::DECOMP_SVD);
  return {x[0], {x[1], x[2]}};
}

/// The weighted middle and the area of the dark (or bright) blob at `p`. `field` is what a circle
/// through the nearest of its neighbours looks like: its axes, as columns, px; seen obliquely it is
/// far longer than wide. Weights are how much of a pixel is the blob's, between its own brightness
/// and that around it.
Blob measure_blob(const cv::Mat& image, cv::Point2d p, const cv::Matx22d& field) {
  constexpr double kBox = 0.6, kRim = 0.57;  // of the way to the neighbours
  Blob out{p, 0};
  const cv::Point2d reach(kBox * cv::norm(field.row(0)), kBox * cv::norm(field.row(1)));
  const cv::Rect box =
      cv::Rect(cv::Point(p - reach), cv::Point(p + reach)) & cv::Rect(0, 0, image.cols, image.rows);
  const cv::Point middle(cvRound(p.x), cvRound(p.y));
  if (!box.contains(middle)) return out;
  std::vector<cv::Point> rim;
  std::vector<double> bright;
  for (int i = 0; i < 64; ++i) {
    const cv::Vec2d away =
        kRim * (field * cv::Vec2d(std::cos(i * CV_PI / 32), std::sin(i * CV_PI / 32)));
    const cv::Point at(p + cv::Point2d(away[0], away[1]));
    if (!box.contains(at)) continue;
    rim.push_back(at - middle);
    bright.push_back(image.at<uchar>(at));
  }
  if (rim.size() < 16) return out;
  const double inside = image.at<uchar>(middle), usual = median(bright),
               contrast = std::abs(usual - inside);
  if (contrast < 10) return out;
  const Surround around = fit_surround(rim, bright, usual, 0.25 * contrast);
  // As if it were equally bright all around. Only what hangs together with the middle, and the
  // slope around it.
  cv::Mat half(box.size(), CV_32F), labels;
  for (int y = 0; y < half.rows; ++y)
    for (int x = 0; x < half.cols; ++x) {
      const cv::Point at = cv::Point(x, y) + box.tl();
      const double here = around.at_middle + around.slope.dot(cv::Point2d(at - middle)),
                   share = here > 0.2 * around.at_middle ? around.at_middle / here : 5;
      half.at<float>(y, x) = static_cast<float>((image.at<uchar>(at) * share - around.at_middle) /
                                                (inside - around.at_middle));
    }
  const cv::Mat own = half > 0.5;
  cv::connectedComponents(own, labels, 4);
  const int label = labels.at<int>(middle - box.tl());
  if (label == 0) return out;
  cv::Mat mask = labels == label;
  cv::dilate(mask, mask, cv::getStructuringElement(cv::MORPH_ELLIPSE, {9, 9}));
  mask.setTo(0, (labels != label) & own);
  cv::Point2d sum;
  for (int y = 0; y < half.rows; ++y)
    for (int x = 0; x < half.cols; ++x) {
      const double w = half.at<float>(y, x);
      if (!mask.at<uchar>(y, x) || w < 0.03) continue;
      out.area += std::min(w, 1.0);
      sum += std::min(w, 1.0) * cv::Point2d(x, y);
    }
  out.middle = sum / out.area + cv::Point2d(box.tl());
  return out;
}

/// How far the middle of a disc's image lies from the image of its centre, and its area, px^2.
struct DiscImage {
  cv::Point2d offset;
  double area = 0;
};

DiscImage disc_image(const PlaneView& view, cv::Point2d centre, double radius) {
  constexpr int kCorners = 64;
  const cv::Point2d from = view(centre);
  const auto corner = [&](int i) {
    const double angle = 2 * CV_PI * i / kCorners;
    return view(centre + radius * cv::Point2d(std::cos(angle), std::sin(angle))) - from;
  };
  DiscImage out;
  cv::Point2d before = corner(kCorners - 1);
  for (int i = 0; i < kCorners; ++i) {
    const cv::Point2d now = corner(i);
    const double twice = before.cross(now);
    out.area += twice / 2;
    out.offset += twice / 6 * (before + now);
    before = now;
  }
  out.offset = out.offset / out.area;
  out.area = std::abs(out.area);
  return out;
}

/// The middles of the blobs without what the view makes of discs. False: they lie on a line.
bool correct_middles(const ImageTarget& target, const std::vector<Blob>& blobs, cv::Size image,
                     std::vector<cv::Point2d>& centres) {
  const double some = 0.25 * cv::norm(target.points[1] - target.points[0]);  // a radius
  centres.clear();
  for (const Blob& blob : blobs) centres.push_back(blob.middle);
  for (int pass = 0; pass < 2; ++pass) {  // the first view is that of middles
    const PlaneView view = fit_plane_view(target.points, centres, image);
    if (view.rms > 1e8) return false;
    std::vector<double> radii;
    for (size_t i = 0; i < blobs.size(); ++i)
      radii.push_back(some *
                      std::sqrt(blobs[i].area / disc_image(view, target.points[i], some).area));
    const double usual = median(radii);
    for (size_t i = 0; i < blobs.size(); ++i) {
      const double radius = i == 0 && target.large_origin ? radii[0] : usual;
      centres[i] = blobs[i].middle - disc_image(view, target.points[i], radius).offset;
    }
  }
  return true;
}

/// How the plane lies at each point of a grid: the ways in px of one unit, as columns. OpenCV's
/// grid may be the mirror image of the rig's, which of an asymmetric one is another pattern.
std::vector<cv::Matx22d> ways_of(const ImageTarget& target, const std::vector<cv::Point2f>& found) {
  std::vector<cv::Point2d> pixels(found.begin(), found.end()), fitted;
  cv::Mat best;
  double least = 1e300;
  for (const double side : {1., -1.}) {
    std::vector<cv::Point2d> plane;
    for (int i = 0; i < target.rows * target.columns; ++i) {
      const int row = i / target.columns, column = i % target.columns;
      plane.emplace_back(target.asymmetric ? 2 * column + side * (row % 2) : column, row);
    }
    const cv::Mat h = cv::findHomography(plane, pixels);
    if (h.empty()) continue;
    cv::perspectiveTransform(plane, fitted, h);
    double sum = 0;
    for (size_t i = 0; i < pixels.size(); ++i) sum += cv::norm(fitted[i] - pixels[i]);
    if (sum >= least) continue;
    least = sum, best = h;
  }
  std::vector<cv::Matx22d> out;
  if (best.empty()) return out;
  const cv::Matx33d h(best), back = h.inv();
  for (const cv::Point2d& p : pixels) {
    const cv::Vec3d q = back * cv::Vec3d(p.x, p.y, 1), at = h * (q / q[2]);
    cv::Matx22d way;
    for (int k = 0; k < 2; ++k) {
      way(0, k) = (h(0, k) - p.x * h(2, k)) / at[2];
      way(1, k) = (h(1, k) - p.y * h(2, k)) / at[2];
    }
    out.push_back(way);
  }
  return out;
}

/// Pixels of area for one unit of area of the plane, at a point of it.
double area_scale(const cv::Matx33d& h, cv::Point2d p) {
  const double w = h(2, 0) * p.x + h(2, 1) * p.y + h(2, 2);
  return std::abs(cv::determinant(h) / (w * w * w));
}

/// Distances of the blobs from the places of the grid, rms after the best homography, px; of a
/// numbering that runs the wrong way round 1e9.
double misfit(const ImageTarget& target, const std::vector<Blob>& way) {
  std::vector<cv::Point2d> middles, fitted;
  for (const Blob& blob : way) middles.push_back(blob.middle);
  const cv::Mat h = cv::findHomography(target.points, middles);
  if (h.empty() || cv::determinant(h) <= 0) return 1e9;
  cv::perspectiveTransform(target.points, fitted, h);
  double sum = 0;
  for (size_t i = 0; i < way.size(); ++i) {
    const cv::Point2d d = fitted[i] - middles[i];
    sum += d.dot(d);
  }
  return std::sqrt(sum / static_cast<double>(way.size()));
}

/// Numbers the circles: rows and columns turn as those of the rig, point 0 is the bigger one if
/// there is one, else of the ways that fit alike the one nearest to the image's top-left.
void number(const ImageTarget& target, std::vector<Blob>& blobs) {
  const int rows = target.rows, columns = target.columns;
  std::vector<Blob> mirrored(blobs.size());
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      mirrored[r * columns + c] = blobs[r * columns + columns - 1 - c];
  std::vector<std::vector<Blob>> ways = {blobs, mirrored};
  for (int i = 0; i < 2; ++i) {
    ways.emplace_back(ways[i].rbegin(), ways[i].rend());
    std::vector<Blob> turned(blobs.size());
    if (rows != columns || target.asymmetric) continue;
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < columns; ++c)
        turned[r * columns + c] = ways[i][(columns - 1 - c) * columns + r];
    ways.push_back(turned);
    ways.emplace_back(turned.rbegin(), turned.rend());
  }
  std::vector<double> misfits;
  for (const std::vector<Blob>& way : ways) misfits.push_back(misfit(target, way));
  const double limit = 2 * *std::min_element(misfits.begin(), misfits.end()) + 0.1;
  const auto rank = [&](const std::vector<Blob>& way) {
    if (!target.large_origin) return way[0].middle.x + way[0].middle.y;
    std::vector<cv::Point2d> middles;
    for (const Blob& blob : way) middles.push_back(blob.middle);
    const cv::Mat h = cv::findHomography(target.points, middles);
    return h.empty() ? 0 : -way[0].area / area_scale(cv::Matx33d(h), target.points[0]);
  };
  size_t best = 0;
  double least = 1e300;
  for (size_t i = 0; i < ways.size(); ++i) {
    if (misfits[i] > limit) continue;
    const double one = rank(ways[i]);
    if (one < least) least = one, best = i;
  }
  blobs = ways[best];
}

bool find_grid(const cv::Mat& image, const ImageTarget& target, std::vector<cv::Point2f>& found) {
  cv::SimpleBlobDetector::Params parameters;
  parameters.minArea = 12;
  parameters.maxArea = static_cast<float>(image.total()) / 20;
  parameters.minDistBetweenBlobs = 4;
  parameters.minConvexity = 0.8f;
  const int kind = target.asymmetric ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
  const auto look = [&](float step, uchar colour, int way) {
    parameters.thresholdStep = step;
    parameters.blobColor = colour;
    return cv::findCirclesGrid(image, {target.columns, target.rows}, found, kind | way,
                               cv::SimpleBlobDetector::create(parameters));
  };
  // Half of the thresholds find dark circles unless their contrast is small.
  if (look(20, 0, 0)) return true;
  for (const uchar colour : {0, 255})
    for (const int way : {0, static_cast<int>(cv::CALIB_CB_CLUSTERING)})
      if (look(10, colour, way)) return true;
  return false;
}

}  // namespace

Detection find_circles(const cv::Mat& image, const ImageTarget& target) {
  Detection out;
  std::vector<cv::Point2f> found;
  if (!find_grid(image, target, found)) {
    out.reason = "no grid of " + std::to_string(target.rows) + " x " +
                 std::to_string(target.columns) + " circles";
    return out;
  }
  const std::vector<cv::Matx22d> ways = ways_of(target, found);
  if (ways.empty()) {
    out.reason = "the circles lie on a line";
    return out;
  }
  std::vector<Blob> blobs;
  const double nearest = target.asymmetric ? std::sqrt(2.) : 1;  // neighbours, in units
  for (size_t i = 0; i < found.size(); ++i) {
    blobs.push_back(measure_blob(image, found[i], nearest * ways[i]));
    if (blobs.back().area == 0) {
      out.reason = "a circle of the grid has no edge";
      return out;
    }
  }
  number(target, blobs);
  if (!correct_middles(target, blobs, image.size(), out.pixels)) {
    out.pixels.clear();
    out.reason = "the circles lie on a line";
    return out;
  }
  for (size_t i = 0; i < blobs.size(); ++i) out.ids.push_back(static_cast<int>(i));
  return out;
}

}  // namespace kincal
