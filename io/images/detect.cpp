#include "detect.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "finders.h"

namespace kincal {
namespace {

using Points2 = std::vector<cv::Point2d>;

/// Distances of a homography fitted to the pixels with the lens undone by one radial number, in
/// the pixels' own scale. `r` is the radius that `k` belongs to.
double homography_rms(const Points2& plane, const Points2& pixels, cv::Point2d centre, double r,
                      double k) {
  Points2 straight;
  double scale = 0;
  for (const cv::Point2d& p : pixels) {
    const cv::Point2d d = (p - centre) / r;
    const double factor = 1 + k * d.dot(d);
    straight.push_back(centre + factor * (p - centre));
    scale += factor;
  }
  const cv::Mat h = cv::findHomography(plane, straight);
  if (h.empty()) return 1e9;
  Points2 fitted;
  cv::perspectiveTransform(plane, fitted, h);
  double sum = 0;
  for (size_t i = 0; i < fitted.size(); ++i)
    sum += (fitted[i] - straight[i]).dot(fitted[i] - straight[i]);
  return std::sqrt(sum / static_cast<double>(fitted.size())) * static_cast<double>(fitted.size()) /
         scale;
}

/// The best homography with a radial distortion. The mean square is nearly a parabola in the one
/// number that is left, so a few steps to the lowest point of one are enough.
double fit_rms(const cv::Mat& image, const ImageTarget& target, const Detection& found) {
  if (found.ids.size() < 5) return 0;  // four points fit any homography
  Points2 plane;
  for (int id : found.ids) plane.push_back(target.points[id]);
  const cv::Point2d centre(0.5 * (image.cols - 1), 0.5 * (image.rows - 1));
  const double r = cv::norm(centre);
  std::map<double, double> tried;  // the number, and the mean square
  const auto square = [&](double k) {
    const double rms = homography_rms(plane, found.pixels, centre, r, k);
    return tried[k] = rms * rms;
  };
  square(0);
  if (found.ids.size() < 6) return std::sqrt(tried[0]);
  square(-0.3), square(0.4);
  for (int i = 0; i < 6; ++i) {
    auto best = tried.begin();
    for (auto one = tried.begin(); one != tried.end(); ++one)
      if (one->second < best->second) best = one;
    if (best == tried.begin()) ++best;
    if (std::next(best) == tried.end()) --best;
    const auto [x, y] = *best;
    const auto [x0, y0] = *std::prev(best);
    const auto [x1, y1] = *std::next(best);
    const double left = (y - y0) / (x - x0), right = (y1 - y) / (x1 - x);
    if (!(right > left)) break;
    const double lowest = 0.5 * (x0 + x) - left * 0.5 * (x1 - x0) / (right - left);
    const double next = std::clamp(lowest, -0.5, 1.5);
    if (std::abs(next - x) < 1e-4 || tried.count(next)) break;
    square(next);
  }
  double least = tried[0];
  for (const auto& one : tried) least = std::min(least, one.second);
  return std::sqrt(least);
}

/// Noise of a part of a picture. A fifth of the pixels, those where the smoothed picture is
/// flattest, are compared with their neighbours by second differences both ways, which see no
/// slope and no straight edge along the pixels. No less than rounding to whole levels.
double noise_of(const cv::Mat& part) {
  cv::Mat fine, smooth, dx, dy, slopes, rough;
  part.convertTo(fine, CV_32F);
  cv::GaussianBlur(fine, smooth, {0, 0}, 1.5);
  cv::Sobel(smooth, dx, CV_32F, 1, 0);
  cv::Sobel(smooth, dy, CV_32F, 0, 1);
  cv::magnitude(dx, dy, slopes);
  cv::filter2D(fine, rough, CV_32F, cv::Matx33f(1, -2, 1, -2, 4, -2, 1, -2, 1));
  std::vector<std::pair<float, float>> all;
  for (int y = 1; y + 1 < part.rows; ++y)
    for (int x = 1; x + 1 < part.cols; ++x)
      all.emplace_back(slopes.at<float>(y, x), rough.at<float>(y, x));
  const size_t flat = all.size() / 5;
  std::nth_element(all.begin(), all.begin() + static_cast<long>(flat), all.end());
  double sum = 0;
  for (size_t i = 0; i < flat; ++i) sum += all[i].second * all[i].second;
  constexpr double kRounding = 1. / 12, kGain = 36;  // the sum of the squared weights
  return std::sqrt(std::max(kRounding, sum / (kGain * static_cast<double>(flat))));
}

}  // namespace

/// The steepest edges are as steep as the blur lets them: a step of height A blurred by sigma has
/// the slope A / (sigma sqrt(2 pi)).
void judge(const cv::Mat& image, Detection& found) {
  std::vector<cv::Point2f> pixels(found.pixels.begin(), found.pixels.end());
  const cv::Rect box = cv::boundingRect(pixels) & cv::Rect(0, 0, image.cols, image.rows);
  if (box.width < 5 || box.height < 5) return;
  const cv::Mat part = image(box);
  cv::Mat dx, dy, slopes;
  cv::Sobel(part, dx, CV_32F, 1, 0, 3, 0.125);
  cv::Sobel(part, dy, CV_32F, 0, 1, 3, 0.125);
  cv::magnitude(dx, dy, slopes);
  std::vector<float> values, steepness;
  const int step = 1 + part.cols * part.rows / 50000;  // so many are enough
  for (int y = 1; y + 1 < part.rows; ++y)
    for (int x = 1 + y % step; x + 1 < part.cols; x += step) {
      values.push_back(part.at<uchar>(y, x));
      steepness.push_back(slopes.at<float>(y, x));
    }
  const auto at = [](std::vector<float>& all, double share) {
    const auto place = all.begin() + static_cast<long>(share * static_cast<double>(all.size() - 1));
    std::nth_element(all.begin(), place, all.end());
    return static_cast<double>(*place);
  };
  const double height = at(values, 0.95) - at(values, 0.05);
  found.contrast = height / 255;
  const double width = height / (std::sqrt(2 * CV_PI) * std::max(1e-3, at(steepness, 0.995)));
  constexpr double kOwn = 5. / 12;  // px^2, of the pixel and of the difference across two of them
  found.blur = std::sqrt(std::max(0.0, width * width - kOwn));
  constexpr int kEnough = 180;  // px
  const cv::Point middle(part.cols / 2, part.rows / 2);
  found.noise =
      noise_of(part(cv::Rect(middle.x - kEnough / 2, middle.y - kEnough / 2, kEnough, kEnough) &
                    cv::Rect(0, 0, part.cols, part.rows)));
}

Detection detect(const cv::Mat& image, const ImageTarget& target) {
  using Kind = ImageTarget::Kind;
  Detection found = target.kind == Kind::charuco   ? find_charuco(image, target)
                    : target.kind == Kind::tags    ? find_tags(image, target)
                    : target.kind == Kind::marker  ? find_marker(image, target)
                    : target.kind == Kind::circles ? find_circles(image, target)
                                                   : find_chessboard(image, target);
  if (found.ids.empty()) return found;
  if (found.contrast == 0) judge(image, found);
  found.rms = fit_rms(image, target, found);
  return found;
}

void draw(cv::Mat& picture, const ImageTarget& target, const Detection& found) {
  constexpr int kShift = 4;  // of a pixel: sixteenths
  const auto fine = [](cv::Point2d p) { return cv::Point(cv::Point2d(p * (1 << kShift))); };
  const int size = std::max(3, picture.cols / 250), font = cv::FONT_HERSHEY_SIMPLEX;
  for (size_t i = 0; i < found.ids.size(); ++i) {
    const double share = static_cast<double>(found.ids[i]) /
                         static_cast<double>(std::max<size_t>(1, target.points.size() - 1));
    const cv::Scalar colour(255 * share, 128 * (1 - std::abs(2 * share - 1)), 255 * (1 - share));
    const cv::Point2d p = found.pixels[i];
    for (const cv::Point2d d : {cv::Point2d(size, 0), cv::Point2d(0, size)})
      cv::line(picture, fine(p - d), fine(p + d), colour, 1, cv::LINE_AA, kShift);
    cv::circle(picture, fine(p), size << kShift, colour, 1, cv::LINE_AA, kShift);
    if (i == 0 || i + 1 == found.ids.size() || found.ids.size() <= 16)
      cv::putText(picture, std::to_string(found.ids[i]), cv::Point(p) + cv::Point(size, -size),
                  font, 0.15 * size, colour, std::max(1, size / 3), cv::LINE_AA);
  }
}

}  // namespace kincal
