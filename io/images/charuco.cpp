// ChArUco boards: markers say which corners are seen and nearly where, the corners are located as
// saddle points, because OpenCV 4.6 reports them half a pixel off.
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "finders.h"
#include "markers.h"
#include "saddle.h"

namespace kincal {
namespace {

bool on_one_line(const Places& points) {
  std::vector<cv::Point2f> fine(points.begin(), points.end());
  const cv::RotatedRect box = cv::minAreaRect(fine);
  return std::min(box.size.width, box.size.height) < 1e-3f;
}

/// The markers of a ChArUco board that agree with one layout: by number in the board, with the
/// square they are in.
struct Placed {
  cv::Point square;
  Quad quad;
};

/// The squares of a board that have markers, in the order of their numbers. `odd`: those whose row
/// + column is odd (the upper left square is dark), else even (OpenCV's boards with an even number
/// of rows before 4.6).
std::vector<cv::Point> marker_squares(const ImageTarget& target, int odd) {
  std::vector<cv::Point> squares;
  for (int r = 0; r < target.rows; ++r)
    for (int c = 0; c < target.columns; ++c)
      if ((r + c) % 2 == odd) squares.emplace_back(c, r);
  return squares;
}

/// The corners of a marker in the plane of the board, in squares, clockwise from the upper left.
Quad marker_corners(const cv::Point& square, double marker) {
  const cv::Point2d middle = cv::Point2d(square) + cv::Point2d(0.5, 0.5);
  const double m = 0.5 * marker;
  return {middle + cv::Point2d(-m, -m), middle + cv::Point2d(m, -m), middle + cv::Point2d(m, m),
          middle + cv::Point2d(-m, m)};
}

/// Whether an inner corner is one of a square's.
bool touches(const cv::Point& square, const cv::Point& corner) {
  return (corner.x == square.x || corner.x == square.x + 1) &&
         (corner.y == square.y || corner.y == square.y + 1);
}

/// The markers that agree with the layout `odd`.
std::vector<Placed> placed_markers(const Markers& markers, const ImageTarget& target, int odd) {
  const std::vector<cv::Point> squares = marker_squares(target, odd);
  std::vector<Placed> all, out;
  Places plane, pixels;
  double edge = 0;
  for (const auto& [id, quad] : markers) {
    if (id >= static_cast<int>(squares.size())) continue;
    all.push_back({squares[id], quad});
    for (const cv::Point2d& p : marker_corners(squares[id], target.marker)) plane.push_back(p);
    pixels.insert(pixels.end(), quad.begin(), quad.end());
    edge += edge_length(quad);
  }
  cv::Mat inliers;
  if (agreeing(plane, pixels,
               3 + 0.15 * edge / static_cast<double>(std::max<size_t>(1, all.size())), inliers) < 4)
    return out;
  for (size_t i = 0; i < all.size(); ++i)
    if (cv::countNonZero(inliers.rowRange(static_cast<int>(4 * i), static_cast<int>(4 * i + 4))) ==
        4)
      out.push_back(all[i]);
  return out;
}

/// The inner corner at (x, y) as the markers around it have it; false: none touches it.
bool predict(const std::vector<Placed>& markers, double marker, const cv::Point& corner,
             Saddle& out) {
  Places plane, pixels;
  for (const Placed& one : markers) {
    if (!touches(one.square, corner)) continue;
    for (const cv::Point2d& p : marker_corners(one.square, marker)) plane.push_back(p);
    pixels.insert(pixels.end(), one.quad.begin(), one.quad.end());
  }
  if (plane.empty()) return false;
  const cv::Mat h = cv::findHomography(plane, pixels);
  if (h.empty()) return false;
  const cv::Point2d x(0.5, 0), y(0, 0.5), at(corner);
  Places near = {at, at + x, at - x, at + y, at - y};
  cv::perspectiveTransform(near, near, h);
  out.pixel = near[0];
  out.sides = cv::Matx22d(near[1].x - near[2].x, near[3].x - near[4].x, near[1].y - near[2].y,
                          near[3].y - near[4].y);
  return true;
}

constexpr int kFirstWindow = 23;  // px

/// The layout that more markers agree with, if the target says none.
int layout_of(const ImageTarget& target, const std::array<int, 2>& layouts) {
  return target.layout >= 0 ? target.layout : layouts[0] > layouts[1] ? 0 : 1;
}

/// A look at a board: in which layout its markers lie, and where its corners should be.
struct BoardLook {
  std::array<int, 2> layouts{};  // markers that agree with each
  std::vector<Saddle> corners;
  bool complete = false;  // nothing more can be in the picture
};

/// Numbers a corner, if it is in the image.
void add_corner(const ImageTarget& target, const cv::Point& corner, cv::Size image, Saddle one,
                std::vector<Saddle>& out) {
  if (!cv::Rect(3, 3, image.width - 6, image.height - 6).contains(cv::Point(one.pixel))) return;
  one.id = (corner.y - 1) * (target.columns - 1) + corner.x - 1;
  one.reach = 0.45;
  one.strip = 0.9 * 0.5 * (1 - target.marker);  // the markers are beside it
  out.push_back(one);
}

/// All markers in their squares of a layout, if one view of a plane explains them.
std::vector<Placed> in_one_view(const Markers& markers, const ImageTarget& target, int odd,
                                cv::Size image, PlaneView& view) {
  const std::vector<cv::Point> squares = marker_squares(target, odd);
  std::vector<Placed> placed;
  Places plane, pixels;
  for (const auto& [id, quad] : markers) {
    if (id >= static_cast<int>(squares.size())) continue;
    placed.push_back({squares[id], quad});
    for (const cv::Point2d& p : marker_corners(squares[id], target.marker)) plane.push_back(p);
    pixels.insert(pixels.end(), quad.begin(), quad.end());
  }
  if (placed.size() < 4 || !in_one_view(plane, pixels, image, view)) placed.clear();
  return placed;
}

/// Whether the picture has no marker but these that could be read: every corner of the board is at
/// one of them, or all markers around it reach out of the image.
bool nothing_missing(const std::vector<Placed>& placed, const ImageTarget& target, int odd,
                     const PlaneView& view, cv::Size image) {
  const cv::Rect inside(8, 8, image.width - 16, image.height - 16);
  std::set<std::pair<int, int>> at;
  for (const Placed& one : placed)
    for (const int dx : {0, 1})
      for (const int dy : {0, 1}) at.emplace(one.square.x + dx, one.square.y + dy);
  for (const cv::Point& square : marker_squares(target, odd)) {
    const Quad corners = marker_corners(square, target.marker);
    if (!std::all_of(corners.begin(), corners.end(),
                     [&](const cv::Point2d& p) { return inside.contains(cv::Point(view(p))); }))
      continue;
    for (const int x : {square.x, square.x + 1})
      for (const int y : {square.y, square.y + 1})
        if (x > 0 && y > 0 && x < target.columns && y < target.rows && !at.count({x, y}))
          return false;
  }
  return true;
}

/// The markers that one threshold finds: an eighth of the time, and enough for most pictures.
BoardLook first_look(const cv::Mat& image, const ImageTarget& target) {
  BoardLook out;
  const Markers markers = find_markers(image, target, {1, 7, kFirstWindow, kFirstWindow});
  std::array<std::vector<Placed>, 2> placed;
  std::array<PlaneView, 2> views;
  for (const int odd : {0, 1}) {
    placed[odd] = in_one_view(markers, target, odd, image.size(), views[odd]);
    out.layouts[odd] = static_cast<int>(placed[odd].size());
  }
  const int odd = layout_of(target, out.layouts);
  const PlaneView& view = views[odd];
  if (placed[odd].empty() || !nothing_missing(placed[odd], target, odd, view, image.size()))
    return out;
  for (int r = 1; r < target.rows; ++r)
    for (int c = 1; c < target.columns; ++c) {
      const cv::Point corner(c, r);
      if (std::none_of(placed[odd].begin(), placed[odd].end(),
                       [&](const Placed& one) { return touches(one.square, corner); }))
        continue;
      Saddle one;
      const cv::Point2d at(corner), x(0.5, 0), y(0, 0.5);
      const cv::Point2d across = view(at + x) - view(at - x), down = view(at + y) - view(at - y);
      one.pixel = view(at);
      one.sides = cv::Matx22d(across.x, down.x, across.y, down.y);
      add_corner(target, corner, image.size(), one, out.corners);
    }
  out.complete = true;
  return out;
}

/// The same with all thresholds: whatever markers agree.
BoardLook second_look(const cv::Mat& image, const ImageTarget& target, std::string& reason) {
  BoardLook out;
  Markers markers = find_markers(image, target, {});
  for (auto& one : markers) {
    const double reach =
        std::clamp(0.6 * edge_length(one.second) / (bits_of(target.dictionary) + 2), 1.5, 5.0);
    one.second = refine_quad(image, one.second, reach);
  }
  std::array<std::vector<Placed>, 2> placed;
  for (const int odd : {0, 1}) {
    placed[odd] = placed_markers(markers, target, odd);
    out.layouts[odd] = static_cast<int>(placed[odd].size());
  }
  const std::vector<Placed>& best = placed[layout_of(target, out.layouts)];
  if (markers.empty())
    reason = "no marker of its dictionary";
  else if (best.size() < std::min<size_t>(2, markers.size()))
    reason = "the markers are not arranged as on this board";
  if (!reason.empty()) return out;
  for (int r = 1; r < target.rows; ++r)
    for (int c = 1; c < target.columns; ++c) {
      Saddle one;
      if (predict(best, target.marker, {c, r}, one))
        add_corner(target, {c, r}, image.size(), one, out.corners);
    }
  return out;
}

}  // namespace

Detection find_charuco(const cv::Mat& image, const ImageTarget& target,
                       const Compression& compression) {
  std::string reason;
  BoardLook look = first_look(image, target);
  if (!look.complete) look = second_look(image, target, reason);
  if (!reason.empty()) return missing(reason);
  Detection out = refined(image, compression, look.corners);
  out.layouts = look.layouts;
  if (out.ids.empty() && !look.corners.empty())
    return missing("the gaps beside its markers are too narrow for the blur");
  if (out.ids.size() < 4 || on_one_line(out.pixels))
    return missing(std::to_string(out.ids.size()) + " corners: too few, or on a line");
  return out;
}

}  // namespace kincal
