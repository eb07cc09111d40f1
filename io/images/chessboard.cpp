// Chessboards: found by OpenCV, corners refined, numbered from the dark end.
//
// Numbering. What OpenCV returns may begin at any corner of the board. Point 0 is made such that
// rows and columns turn as those of the rig (y down, clockwise in the image, as the print is seen
// from its front), and that the outer square at point 0 is dark where the colours of both ends
// differ (rows + columns odd; of a square board: neighbouring ends, rows odd). What is then still
// open, half a turn or of a square board even a quarter, is no difference in the picture: of those
// ways point 0 is the one nearest to the image's top-left corner.
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "../../models/rig/numbers.h"
#include "finders.h"
#include "plane_view.h"
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

/// How much brighter the cells are that have the colour of the first, and of the outer square at
/// point 0: means of all cells with alternating signs.
double first_colour(const cv::Mat& image, const Corners& corners, int rows, int columns) {
  double sum = 0;
  for (int r = 0; r + 1 < rows; ++r)
    for (int c = 0; c + 1 < columns; ++c) {
      const auto at = corners.begin() + r * columns + c;
      const cv::Point2d m = 0.25 * (at[0] + at[1] + at[columns] + at[columns + 1]);
      sum += ((r + c) % 2 == 0 ? 1 : -1) * image.at<uchar>(cv::Point(m));
    }
  return sum;
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
  const bool told = (rows == columns ? rows : rows + columns) % 2 == 1;
  size_t best = ways.size();
  for (size_t i = 0; i < ways.size(); ++i) {
    if (told && first_colour(image, ways[i], rows, columns) > 0) continue;
    const auto near = [](const Corners& way) { return way[0].x + way[0].y; };
    if (best == ways.size() || near(ways[i]) < near(ways[best])) best = i;
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
      one.squares = true;
      out.push_back(one);
    }
  return out;
}

/// A Pattern is the lattice of a chessboard in a picture, also beyond the corners that were found.
class Pattern {
 public:
  /// `basis`: the lattice's steps along columns and rows, in those of the corners that were found.
  Pattern(const cv::Mat& image, const PlaneView& view, const cv::Matx22d& basis,
          const cv::Size& size)
      : image_(image), view_(view), basis_(basis), size_(size) {
    std::vector<double> heights;
    for (int r = 0; r < size.height; ++r)
      for (int c = 0; c < size.width; ++c) heights.push_back(fields_at(cv::Point(c, r)).height);
    usual_ = median(std::move(heights));
  }

  /// Whether a board is there whose point 0 is at `first`: corners along each of its lines.
  bool board_at(const cv::Point& first) const {
    for (int r = 0; r < size_.height; ++r)
      if (!(across(first.y + r, first) > 0.5)) return false;
    for (int c = 0; c < size_.width; ++c)
      if (!(down(first.x + c, first) > 0.5)) return false;
    return true;
  }

  /// Whether the pattern goes on beyond a side of such a board, as that of a larger one does.
  bool goes_on(const cv::Point& first) const {
    const cv::Point end = first + cv::Point(size_);
    return across(first.y - 1, first) > 0.7 || across(end.y, first) > 0.7 ||
           down(first.x - 1, first) > 0.7 || down(end.x, first) > 0.7;
  }

  Corners corners_at(const cv::Point& first) const {
    Corners out;
    for (int r = 0; r < size_.height; ++r)
      for (int c = 0; c < size_.width; ++c) out.push_back(place(first + cv::Point(c, r)));
    return out;
  }

  /// The picture with the larger board painted over that goes on around a smaller one.
  cv::Mat without_board(const cv::Point& first) const {
    cv::Point low = first, high = first + cv::Point(size_) - cv::Point(1, 1);
    constexpr int kMost = 40;
    while (low.y > -kMost && across(low.y - 1, first) > 0.5) --low.y;
    while (high.y < kMost && across(high.y + 1, first) > 0.5) ++high.y;
    while (low.x > -kMost && down(low.x - 1, first) > 0.5) --low.x;
    while (high.x < kMost && down(high.x + 1, first) > 0.5) ++high.x;
    constexpr double kRim = 1.1;  // squares
    const cv::Point2d a = cv::Point2d(low) - cv::Point2d(kRim, kRim),
                      b = cv::Point2d(high) + cv::Point2d(kRim, kRim);
    std::vector<cv::Point> outline;
    for (const cv::Point2d& corner : {a, cv::Point2d(b.x, a.y), b, cv::Point2d(a.x, b.y)})
      outline.emplace_back(place(corner));
    cv::Mat out = image_.clone();
    cv::fillConvexPoly(out, outline, cv::mean(image_));
    return out;
  }

 private:
  /// How the four fields around a place differ: `whole` is 1 where two opposite ones are dark and
  /// two bright, and a half at the rim of a board; `height` in grey levels.
  struct Fields {
    double whole = 0, height = 0;
    bool visible = false;
  };

  cv::Point2d place(const cv::Point2d& p) const {
    return view_(
        {basis_(0, 0) * p.x + basis_(0, 1) * p.y, basis_(1, 0) * p.x + basis_(1, 1) * p.y});
  }

  /// Two places of each field, beside both of its edges: lattices with other edges have the same
  /// corners.
  Fields fields_at(const cv::Point2d& p) const {
    std::array<double, 8> levels{};
    double turn = 0;
    size_t n = 0;
    for (const cv::Point2d& away : {cv::Point2d(0.4, 0.2), cv::Point2d(0.2, 0.4)})
      for (const int x : {-1, 1})
        for (const int y : {-1, 1}) {
          const cv::Point2d at = place({p.x + x * away.x, p.y + y * away.y});
          if (!(at.x >= 0 && at.y >= 0 && at.x < image_.cols - 1 && at.y < image_.rows - 1))
            return {};
          levels[n] = level(at);
          turn += x * y * levels[n++];
        }
    std::sort(levels.begin(), levels.end());
    Fields out;
    out.height = 0.5 * (levels[6] + levels[7] - levels[0] - levels[1]);
    out.whole = std::abs(turn) / std::max(1., 4 * out.height);
    out.visible = true;
    return out;
  }

  /// Between the four pixels around a place.
  double level(const cv::Point2d& at) const {
    const int x = static_cast<int>(at.x), y = static_cast<int>(at.y);
    const double a = at.x - x, b = at.y - y;
    const uchar *above = image_.ptr(y) + x, *below = image_.ptr(y + 1) + x;
    return (1 - b) * ((1 - a) * above[0] + a * above[1]) + b * ((1 - a) * below[0] + a * below[1]);
  }

  /// Which share of the visible places of a line are corners; 0: fewer than two are visible.
  double share(const cv::Point& from, const cv::Point& step, int count) const {
    int visible = 0, such = 0;
    for (int i = 0; i < count; ++i) {
      const Fields at = fields_at(from + i * step);
      visible += at.visible;
      such += at.whole > 0.75 && at.height > 0.3 * usual_;
    }
    return visible < 2 ? 0 : static_cast<double>(such) / visible;
  }
  double across(int row, const cv::Point& first) const {
    return share({first.x, row}, {1, 0}, size_.width);
  }
  double down(int column, const cv::Point& first) const {
    return share({column, first.y}, {0, 1}, size_.height);
  }

  const cv::Mat& image_;
  PlaneView view_;
  cv::Matx22d basis_;
  cv::Size size_;
  double usual_ = 0;  // height
};

/// A Board is where the whole board is that OpenCV found, or a part of it.
struct Board {
  Corners corners;  // empty: it is nowhere there
  cv::Mat rest;     // then: the picture without the larger board that a part was found of
};

/// What OpenCV finds may be a part of a larger board, or lie a few squares off, also sheared: of
/// a board that is tilted by 60 degrees the lattice with steps of a square across, and of one
/// across and one down, can look as square as its own. The whole board is where corners are along
/// all of its lines, and none beyond them.
Board whole_board(const cv::Mat& image, const Corners& corners, const cv::Size& size) {
  std::vector<cv::Point2d> plane;
  for (int i = 0; i < size.area(); ++i) plane.emplace_back(i % size.width, i / size.width);
  const PlaneView view = fit_plane_view(plane, corners, image.size());
  const Pattern found(image, view, cv::Matx22d::eye(), size);
  if (found.board_at({0, 0}) && !found.goes_on({0, 0})) return {corners, {}};
  Board out;
  const double step = std::min(cv::norm(corners[1] - corners[0]),
                               cv::norm(corners[static_cast<size_t>(size.width)] - corners[0]));
  if (!(view.rms < 0.05 * step)) return out;  // no lattice at all
  const int most = std::max(size.width, size.height);
  for (const int shear : {0, 1, -1, 2, -2})
    for (const bool by_rows : {true, false}) {
      const Pattern pattern(
          image, view, by_rows ? cv::Matx22d(1, shear, 0, 1) : cv::Matx22d(1, 0, shear, 1), size);
      for (int y = -most; y <= most; ++y)
        for (int x = -most; x <= most; ++x) {
          if (!pattern.board_at({x, y})) continue;
          if (!pattern.goes_on({x, y})) return {pattern.corners_at({x, y}), {}};
          if (out.rest.empty()) out.rest = pattern.without_board({x, y});
        }
    }
  return out;
}

/// A Search is a way to look for a board: on a picture so many times smaller, by which of OpenCV's
/// two methods.
struct Search {
  int smaller = 1;
  bool sectors = true;
};

/// The ways, one after the other: a large picture costs many times what a small one does, which
/// shows most boards as well.
std::vector<Search> searches(const cv::Size& image) {
  constexpr int kSmallest = 480;  // px, of the longer side
  int smaller = 1;
  while (std::max(image.width, image.height) >= 2 * smaller * kSmallest) smaller *= 2;
  std::vector<Search> out;
  for (; smaller > 0; smaller /= 2) out.push_back({smaller, true});
  out.push_back({1, false});
  return out;
}

/// OpenCV's corners; empty: none.
Corners corners_by(const Search& way, const cv::Mat& image, const cv::Size& size) {
  cv::Mat small = image;
  if (way.smaller > 1)
    cv::resize(image, small, {}, 1. / way.smaller, 1. / way.smaller, cv::INTER_AREA);
  std::vector<cv::Point2f> found;
  if (!(way.sectors
            ? cv::findChessboardCornersSB(small, size, found, cv::CALIB_CB_NORMALIZE_IMAGE)
            : cv::findChessboardCorners(
                  small, size, found, cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE)))
    return {};
  const cv::Point2d scale(static_cast<double>(image.cols) / small.cols,
                          static_cast<double>(image.rows) / small.rows);
  Corners out;
  for (const cv::Point2f& p : found)
    out.emplace_back((p.x + 0.5) * scale.x - 0.5, (p.y + 0.5) * scale.y - 0.5);
  return out;
}

/// The corners of a numbered grid where the picture has them, and where they were guessed if it has
/// not: a small picture says them to a few tenths of a pixel.
Corners nearer(const cv::Mat& image, const Corners& corners, int rows, int columns) {
  Corners out;
  for (Saddle& one : saddles_of(corners, rows, columns)) {
    refine(image, one, nullptr);
    out.push_back(one.pixel);
  }
  return out;
}

}  // namespace

Detection find_chessboard(const cv::Mat& image, const ImageTarget& target,
                          const Compression& compression) {
  Detection out;
  out.reason = "no chessboard of " + std::to_string(target.rows) + " x " +
               std::to_string(target.columns) + " inner corners";
  const cv::Size size(target.columns, target.rows);
  for (const Search& way : searches(image.size())) {
    cv::Mat rest = image;
    constexpr int kBoards = 4;  // larger ones that are looked past
    for (int i = 0; i < kBoards && !rest.empty(); ++i) {
      Corners corners = corners_by(way, rest, size);
      if (corners.empty()) break;
      const Board board = whole_board(rest, corners, size);
      if (!board.corners.empty()) {
        corners = numbered(image, board.corners, target.rows, target.columns);
        if (way.smaller > 1) corners = nearer(image, corners, target.rows, target.columns);
        out = refined(image, compression, saddles_of(corners, target.rows, target.columns));
        if (2 * out.ids.size() >= corners.size()) return out;
        out = {};
        out.reason = "its squares are too small for the blur";
        return out;
      }
      out.reason = board.rest.empty() ? "something looks like it, but it has no squares"
                                      : "a part of a larger chessboard looks like it";
      rest = board.rest;
    }
  }
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
