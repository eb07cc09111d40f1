#include "print.h"

#include <cmath>
#include <opencv2/aruco.hpp>

namespace kincal {
namespace {

int cell_of(double x) { return static_cast<int>(std::floor(x)); }

/// The bits of `count` markers from `first` on, with a dark border.
std::vector<cv::Mat> marker_bits(int dictionary, int first, int count, int border) {
  const auto all = cv::aruco::getPredefinedDictionary(dictionary);
  std::vector<cv::Mat> out;
  for (int id = first; id < first + count && id < all->bytesList.rows; ++id) {
    cv::Mat bits = cv::aruco::Dictionary::getBitsFromByteList(all->bytesList.rowRange(id, id + 1),
                                                              all->markerSize);
    cv::copyMakeBorder(bits, bits, border, border, border, border, cv::BORDER_CONSTANT, 0);
    out.push_back(bits);
  }
  return out;
}

/// The bit of a marker at a place in it, from (0, 0) to (1, 1), y down.
double bit_at(const cv::Mat& bits, double x, double y) {
  return bits.at<uchar>(std::min(cell_of(y * bits.rows), bits.rows - 1),
                        std::min(cell_of(x * bits.cols), bits.cols - 1));
}

Print chessboard_print(int rows, int columns) {
  const auto brightness = [=](double x, double y) {
    if (x < -1 || y < -1 || x > columns || y > rows) return 1.0;
    return (cell_of(x) + cell_of(y)) % 2 == 0 ? 0.0 : 1.0;
  };
  return {brightness, cv::Rect2d(-2, -2, columns + 3, rows + 3)};
}

Print charuco_print(const ImageTarget& target) {
  const int rows = target.rows, columns = target.columns;
  const auto bits = marker_bits(target.dictionary, target.marker_id, (rows * columns + 1) / 2, 1);
  const double size = target.marker, rim = 0.5 * (1 - size);
  const auto brightness = [=](double x, double y) {
    if (x < 0 || y < 0 || x >= columns || y >= rows) return 1.0;
    const int c = cell_of(x), r = cell_of(y);
    if ((r + c) % 2 == 0) return 0.0;
    const double u = (x - c - rim) / size, v = (y - r - rim) / size;
    if (u < 0 || v < 0 || u >= 1 || v >= 1) return 1.0;
    const size_t id =
        static_cast<size_t>(r * columns + c) / 2;  // every other square of a row has one
    return id < bits.size() ? bit_at(bits[id], u, v) : 1.0;
  };
  return {brightness, cv::Rect2d(-1, -1, columns + 2, rows + 2)};
}

Print circles_print(const ImageTarget& target) {
  const int rows = target.rows, columns = target.columns;
  const bool shifted = target.asymmetric, large = target.large_origin;
  const double usual = shifted ? 0.4 : large ? 0.25 : 0.3;
  const auto brightness = [=](double x, double y) {
    for (int r = std::max(0, cell_of(y)); r <= std::min(rows - 1, cell_of(y) + 1); ++r) {
      const int shift = shifted ? r % 2 : 0, pitch = shifted ? 2 : 1;
      const int c = std::clamp(cell_of((x - shift) / pitch + 0.5), 0, columns - 1);
      const double dx = x - pitch * c - shift, dy = y - r;
      const double radius = large && r + c == 0 ? 1.4 * usual : usual;
      if (dx * dx + dy * dy < radius * radius) return 0.0;
    }
    return 1.0;
  };
  const double width = shifted ? 2 * columns - 1 : columns - 1;
  return {brightness, cv::Rect2d(-1.5, -1.5, width + 3, rows + 2)};
}

/// As Kalibr prints them: y up, codes upside down as OpenCV has them, a dark square between the
/// corners of four tags.
Print tags_print(const ImageTarget& target) {
  const int rows = target.rows, columns = target.columns;
  const double gap = target.gap, pitch = 1 + gap;
  const auto bits = marker_bits(target.dictionary, target.marker_id, rows * columns, 2);
  const auto brightness = [=](double x, double y) {
    if (x < -gap || y < -gap || x >= columns * pitch || y >= rows * pitch) return 1.0;
    const int c = cell_of(x / pitch), r = cell_of(y / pitch);
    const double u = x - c * pitch, v = y - r * pitch;
    if (u >= 1 && v >= 1) return 0.0;
    const size_t id = static_cast<size_t>(r) * columns + static_cast<size_t>(c);
    if (u >= 1 || v >= 1 || c < 0 || r < 0 || id >= bits.size()) return 1.0;
    return bit_at(bits[id], 1 - u, v);
  };
  return {brightness, cv::Rect2d(-1, -1, columns * pitch + 2 - gap, rows * pitch + 2 - gap)};
}

Print marker_print(const ImageTarget& target) {
  const double size = target.points[1].x - target.points[0].x;
  const auto bits = marker_bits(target.dictionary, target.marker_id, 1, 1);
  const auto brightness = [=](double x, double y) {
    const double u = x / size + 0.5, v = 0.5 - y / size;
    if (bits.empty() || u < 0 || v < 0 || u >= 1 || v >= 1) return 1.0;
    return bit_at(bits[0], u, v);
  };
  return {brightness, cv::Rect2d(-0.8 * size, -0.8 * size, 1.6 * size, 1.6 * size)};
}

}  // namespace

Print print_of(const ImageTarget& target) {
  switch (target.kind) {
    case ImageTarget::Kind::charuco:
      return charuco_print(target);
    case ImageTarget::Kind::circles:
      return circles_print(target);
    case ImageTarget::Kind::tags:
      return tags_print(target);
    case ImageTarget::Kind::marker:
      return marker_print(target);
    default:
      return chessboard_print(target.rows, target.columns);
  }
}

}  // namespace kincal
