#include "detect.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "finders.h"
#include "plane_view.h"

namespace kincal {
namespace {

/// Noise of a part of a picture. A sixteenth of the pixels, those where the smoothed picture is
/// flattest (beside small markers there are not many more), are compared with their neighbours by
/// second differences both ways, which see no slope and no straight edge along the pixels. No less
/// than rounding to whole levels.
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
  const size_t flat = 1 + all.size() / 16;
  std::nth_element(all.begin(), all.begin() + static_cast<long>(flat), all.end());
  double sum = 0;
  for (size_t i = 0; i < flat; ++i) sum += all[i].second * all[i].second;
  constexpr double kRounding = 1. / 12, kGain = 36;  // the sum of the squared weights
  return std::sqrt(std::max(kRounding, sum / (kGain * static_cast<double>(flat))));
}

PlaneView view_of(const ImageTarget& target, const Detection& found, cv::Size image) {
  std::vector<cv::Point2d> plane;
  for (const int id : found.ids) plane.push_back(target.points[id]);
  return fit_plane_view(plane, found.pixels, image);
}

/// The picture without a board: grey, with the picture's noise, where its points are and around
/// them.
cv::Mat without_board(const cv::Mat& image, const ImageTarget& target, const Detection& found,
                      const PlaneView& view) {
  const double rim = target.kind == ImageTarget::Kind::tags ? target.gap + 0.05 : 1.05;
  cv::Point2d low(1e9, 1e9), high(-1e9, -1e9);
  for (const int id : found.ids) {
    const cv::Point2d p = target.points[id];
    low = {std::min(low.x, p.x - rim), std::min(low.y, p.y - rim)};
    high = {std::max(high.x, p.x + rim), std::max(high.y, p.y + rim)};
  }
  std::vector<cv::Point> outline;
  for (const cv::Point2d& corner : {low, cv::Point2d(high.x, low.y), high, {low.x, high.y}})
    outline.emplace_back(view(corner));
  cv::Mat grey(image.size(), image.type()), mask = cv::Mat::zeros(image.size(), CV_8U);
  cv::RNG(1).fill(grey, cv::RNG::NORMAL, cv::mean(image), cv::Scalar::all(found.noise));
  cv::fillConvexPoly(mask, outline, cv::Scalar(1));
  cv::Mat out = image.clone();
  grey.copyTo(out, mask);
  return out;
}

/// Whether points are where a board that was found before has them.
bool seen_before(const ImageTarget& target, const Detection& found, const PlaneView& before) {
  size_t same = 0;
  for (size_t i = 0; i < found.ids.size(); ++i) {
    const cv::Point2d p = target.points[found.ids[i]], at = before(p);
    same += cv::norm(found.pixels[i] - at) < 0.5 * cv::norm(before(p + cv::Point2d(1, 0)) - at);
  }
  return 2 * same > found.ids.size();
}

}  // namespace

/// The steepest edges are as steep as the blur lets them: a step of height A blurred by sigma has
/// the slope A / (sigma sqrt(2 pi)). Where the points are one row, the fields beside it are looked
/// at as well.
void judge(const cv::Mat& image, Detection& found) {
  std::vector<cv::Point2f> pixels(found.pixels.begin(), found.pixels.end());
  cv::Rect box = cv::boundingRect(pixels);
  const int side = std::max(box.width, box.height) / std::max(1, static_cast<int>(pixels.size()));
  const cv::Point wider(std::max(0, side - box.width / 2), std::max(0, side - box.height / 2));
  box = cv::Rect(box.tl() - wider, box.br() + wider) & cv::Rect(0, 0, image.cols, image.rows);
  if (box.width < 5 || box.height < 5) return;
  const cv::Mat part = image(box);
  std::array<int, 256> levels{};
  std::vector<int> steepness;                          // squared, of 8 times the slope
  const int step = 1 + part.cols * part.rows / 20000;  // so many are enough
  for (int y = 1; y + 1 < part.rows; ++y) {
    const uchar *up = part.ptr(y - 1), *here = part.ptr(y), *down = part.ptr(y + 1);
    for (int x = 1 + y % step; x + 1 < part.cols; x += step) {
      const int left = up[x - 1] + 2 * here[x - 1] + down[x - 1];
      const int right = up[x + 1] + 2 * here[x + 1] + down[x + 1];
      const int above = up[x - 1] + 2 * up[x] + up[x + 1];
      const int below = down[x - 1] + 2 * down[x] + down[x + 1];
      ++levels[here[x]];
      steepness.push_back((right - left) * (right - left) + (below - above) * (below - above));
    }
  }
  if (steepness.empty()) return;
  const auto place = [&](double share) {
    return static_cast<long>(share * static_cast<double>(steepness.size() - 1));
  };
  const auto level = [&](double share) {
    long before = 0;
    int i = 0;
    while (i < 255 && (before += levels[i]) <= place(share)) ++i;
    return i;
  };
  const auto steep = steepness.begin() + place(0.995);
  std::nth_element(steepness.begin(), steep, steepness.end());
  const double height = level(0.95) - level(0.05);
  const double width = height / (std::sqrt(2 * CV_PI) * std::max(1e-3, 0.125 * std::sqrt(*steep)));
  found.contrast = height / 255;
  constexpr double kOwn = 5. / 12;  // px^2, of the pixel and of the difference across two of them
  found.blur = std::sqrt(std::max(0.0, width * width - kOwn));
  constexpr int kEnough = 180;  // px
  const cv::Point middle(part.cols / 2, part.rows / 2);
  found.noise =
      noise_of(part(cv::Rect(middle.x - kEnough / 2, middle.y - kEnough / 2, kEnough, kEnough) &
                    cv::Rect(0, 0, part.cols, part.rows)));
}

Detection detect(const cv::Mat& image, const ImageTarget& target, const Compression& compression) {
  using Kind = ImageTarget::Kind;
  // OpenCV's searches draw random numbers from the thread's generator: begun anew, so that what is
  // found in a picture does not depend on those before it.
  cv::theRNG() = cv::RNG();
  Detection found = target.kind == Kind::charuco   ? find_charuco(image, target, compression)
                    : target.kind == Kind::tags    ? find_tags(image, target, compression)
                    : target.kind == Kind::marker  ? find_marker(image, target)
                    : target.kind == Kind::circles ? find_circles(image, target)
                                                   : find_chessboard(image, target, compression);
  if (found.ids.empty()) return found;
  if (found.contrast == 0) judge(image, found);
  if (found.ids.size() > 4)  // four points fit any homography
    found.rms = view_of(target, found, image.size()).rms;
  return found;
}

std::vector<Detection> detect_boards(const cv::Mat& image, const ImageTarget& target, size_t count,
                                     const Compression& compression) {
  std::vector<Detection> out;
  std::vector<PlaneView> views;
  cv::Mat rest = image;
  const size_t most = count + 2;  // the rest of a board may be found again
  for (size_t look = 0; out.size() < count; ++look) {
    Detection found = detect(rest, target, compression);
    if (found.ids.empty() || look == most) {
      if (found.reason.empty()) found = {}, found.reason = "only parts of a board found before";
      out.resize(count, found);
      break;
    }
    const PlaneView view = view_of(target, found, image.size());
    if (out.size() + 1 < count) rest = without_board(rest, target, found, view);
    if (std::any_of(views.begin(), views.end(),
                    [&](const PlaneView& one) { return seen_before(target, found, one); }))
      continue;
    views.push_back(view);
    out.push_back(std::move(found));
  }
  return out;
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
