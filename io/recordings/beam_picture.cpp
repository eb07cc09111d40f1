#include "beam_picture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "../../models/rig/numbers.h"

namespace kincal {
namespace {

constexpr double kSeen = 1e-6;  // weight of a pixel that a beam has seen

/// What no beam has seen gets the mean of what is around it, from near to far.
void fill_gaps(cv::Mat& sum, cv::Mat& weight) {
  for (int size = 5; size < 130; size = 2 * size + 1) {
    cv::Mat wide, count;
    cv::blur(sum, wide, {size, size});
    cv::blur(weight, count, {size, size});
    const cv::Mat gaps = (weight <= kSeen) & (count > kSeen);
    wide.copyTo(sum, gaps);
    count.copyTo(weight, gaps);
  }
}

}  // namespace

cv::Mat BeamPicture::grey() const {
  cv::Mat out;
  const double scale = 255 / std::max(1e-12, bright - dark);
  level.convertTo(out, CV_8U, scale, -scale * dark);
  return out;
}

BeamPicture picture_of(const std::vector<const Beam*>& beams, const Eigen::Vector2d& step,
                       double pitch) {
  BeamPicture out;
  BeamBox box;
  std::vector<double> levels;
  for (const Beam* b : beams) box.take(b->place()), levels.push_back(b->intensity);
  out.left = box.low(0), out.top = box.low(1), out.pitch = pitch;
  out.dark = quantile(levels, 0.02), out.bright = quantile(levels, 0.98);
  const Eigen::Vector2d size = (box.high - box.low) / pitch;
  const int width = static_cast<int>(size(0)) + 2, height = static_cast<int>(size(1)) + 2;
  cv::Mat sum = cv::Mat::zeros(height, width, CV_32F), weight = sum.clone();
  const double reach_x = std::max(1., step(0) / pitch), reach_y = std::max(1., step(1) / pitch);
  for (const Beam* b : beams) {
    const double x = (b->u - out.left) / pitch, y = (b->v - out.top) / pitch;
    const double level = std::clamp(b->intensity, out.dark, out.bright);
    const int first_x = std::max(0, static_cast<int>(std::ceil(x - reach_x))),
              last_x = std::min(width - 1, static_cast<int>(std::floor(x + reach_x)));
    const int first_y = std::max(0, static_cast<int>(std::ceil(y - reach_y))),
              last_y = std::min(height - 1, static_cast<int>(std::floor(y + reach_y)));
    for (int row = first_y; row <= last_y; ++row)
      for (int column = first_x; column <= last_x; ++column) {
        const double w = (1 - std::abs(column - x) / reach_x) * (1 - std::abs(row - y) / reach_y);
        sum.at<float>(row, column) += static_cast<float>(w * level);
        weight.at<float>(row, column) += static_cast<float>(w);
      }
  }
  fill_gaps(sum, weight);
  out.level = cv::Mat(height, width, CV_32F, cv::Scalar(0.5 * (out.dark + out.bright)));
  cv::divide(sum, weight, sum);
  sum.copyTo(out.level, weight > kSeen);
  return out;
}

}  // namespace kincal
