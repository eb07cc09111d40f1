// Chessboards: found by OpenCV, corners refined, numbered from the dark end.
//
// Numbering. What OpenCV returns may begin at any corner of the board. Point 0 is made such that
// rows and columns turn as those of the rig (y down, clockwise in the image, as the print is seen
// from its front), and that the outer square at point 0 is dark where the colours of both ends
// differ (rows + columns odd; of a square board: neighbouring ends, rows odd). What is then still
// open, half a turn or of a square board even a quarter, is no difference in the picture: of those
// ways point 0 is the one nearest to the image's top-left corner.
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "finders.h"
#include "saddle.h"

namespace kincal {
namespace {

using Corners = std::vector<cv::Point2d>;

/// The grid turned by a quarter: columns become rows. Only of square boards.
Corners quarter_turn(const Corners& corners, int size) {
  Corners out(corners.size());
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c) out[r * size + c] = corners[(size - 1 - c) * size + r];
  return out;
}

/// How bright the outer square at point 0 is: beyond it, along the diagonal of the first cell.
double outer_square(const cv::Mat& image, const Corners& corners, int columns) {
  const cv::Point2d at = 1.5 * corners[0] - 0.5 * corners[columns + 1];
  const cv::Point2d side = (corners[1] - corners[0]) * 0.15,
                    down = (corners[columns] - corners[0]) * 0.15;
  double sum = 0;
  int n = 0;
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j) {
      const cv::Point p = at + i * side + j * down;
      if (!cv::Rect(0, 0, image.cols, image.rows).contains(p)) continue;
      sum += image.at<uchar>(p);
      ++n;
    }
  return n ? sum / n : 128;
}

/// How bright the cell behind point 0 is: of the same colour as the outer square across from it.
double first_cell(const cv::Mat& image, const Corners& corners, int columns) {
  const cv::Point2d m = 0.25 * (corners[0] + corners[1] + corners[columns] + corners[columns + 1]);
  return image.at<uchar>(cv::Point(m));
}

Corners numbered(const cv::Mat& image, Corners corners, int rows, int columns) {
  const cv::Point2d x = corners[columns - 1] - corners[0],
                    y = corners[(rows - 1) * columns] - corners[0];
  if (x.cross(y) < 0)
    for (int r = 0; r < rows; ++r)
      std::reverse(corners.begin() + r * columns, corners.begin() + (r + 1) * columns);
  std::vector<Corners> ways = {corners};
  if (rows == columns)
    for (int i = 0; i < 3; ++i) ways.push_back(quarter_turn(ways.back(), rows));
  else
    ways.emplace_back(corners.rbegin(), corners.rend());
  // The cells of the print alternate, so the first cell and the outer square at point 0 are of one
  // colour; both together are safer than either, a hand may cover the rim.
  std::vector<double> brightness, distance;
  for (const Corners& way : ways) {
    brightness.push_back(first_cell(image, way, columns) + outer_square(image, way, columns));
    distance.push_back(way[0].x + way[0].y);
  }
  const bool told = (rows == columns ? rows : rows + columns) % 2 == 1;
  const double middle = 0.5 * (*std::min_element(brightness.begin(), brightness.end()) +
                               *std::max_element(brightness.begin(), brightness.end()));
  size_t best = ways.size();
  for (size_t i = 0; i < ways.size(); ++i) {
    if (told && brightness[i] > middle) continue;
    if (best == ways.size() || distance[i] < distance[best]) best = i;
  }
  return ways[best];
}

/// The corners of a numbered grid, with the ways to their neighbours.
std::vector<Saddle> saddles_of(const Corners& corners, int rows, int columns) {
  std::vector<Saddle> out;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c) {
      const int left = std::max(0, c - 1), right = std::min(columns - 1, c + 1);
      const int up = std::max(0, r - 1), down = std::min(rows - 1, r + 1);
      Saddle one;
      one.id = r * columns + c;
      one.pixel = corners[one.id];
      const cv::Point2d x = (corners[r * columns + right] - corners[r * columns + left]) /
                            (right - left),
                        y = (corners[down * columns + c] - corners[up * columns + c]) / (down - up);
      one.sides = cv::Matx22d(x.x, y.x, x.y, y.y);
      one.reach = one.strip = 0.45;
      out.push_back(one);
    }
  return out;
}

}  // namespace

Detection find_chessboard(const cv::Mat& image, const ImageTarget& target) {
  Detection out;
  const cv::Size size(target.columns, target.rows);
  std::vector<cv::Point2f> found;
  if (!cv::findChessboardCornersSB(image, size, found, cv::CALIB_CB_NORMALIZE_IMAGE) &&
      !cv::findChessboardCorners(image, size, found,
                                 cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE)) {
    out.reason = "no chessboard of " + std::to_string(target.rows) + " x " +
                 std::to_string(target.columns) + " inner corners";
    return out;
  }
  const Corners corners =
      numbered(image, Corners(found.begin(), found.end()), target.rows, target.columns);
  out = refined(image, saddles_of(corners, target.rows, target.columns));
  if (out.ids.empty()) out.reason = "its squares are too small for the blur";
  return out;
}

cv::Size size_instead(const cv::Mat& image, const ImageTarget& target) {
  // The larger ones first: a part of a board looks like a smaller one.
  for (const auto& [rows, columns] :
       {std::pair(1, 1), {1, 0}, {0, 1}, {1, -1}, {-1, 1}, {0, -1}, {-1, 0}, {-1, -1}}) {
    const cv::Size size(target.columns + columns, target.rows + rows);
    std::vector<cv::Point2f> found;
    if (size.width > 2 && size.height > 2 &&
        cv::findChessboardCornersSB(image, size, found, cv::CALIB_CB_NORMALIZE_IMAGE))
      return size;
  }
  return {};
}

}  // namespace kincal
