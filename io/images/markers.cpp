// Boards with markers: ChArUco, grids of AprilTags as Kalibr prints them, single markers. OpenCV
// finds the markers; the corners are located here, because OpenCV 4.6 reports ChArUco corners and
// its AprilTag refinement half a pixel off.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "finders.h"
#include "plane_view.h"
#include "saddle.h"

namespace kincal {
namespace {

using Quad = std::array<cv::Point2d, 4>;  // clockwise from the marker's upper left
using Markers = std::multimap<int, Quad>;
using Places = std::vector<cv::Point2d>;

/// Widths of the windows (px) whose mean parts ink from paper.
struct Windows {
  int least = 3, most = 43;  // wide windows part tags from squares that touch them
};

/// All that are seen whole. A number may be there twice: what else looks like a code.
/// `darker`: by how many grey levels than what is around it is ink.
Markers find_markers(const cv::Mat& image, int dictionary, int border, double darker = 7,
                     Windows windows = {}) {
  const auto parameters = cv::aruco::DetectorParameters::create();
  parameters->markerBorderBits = border;
  parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_NONE;
  parameters->minMarkerPerimeterRate = 0.02;
  parameters->adaptiveThreshWinSizeMin = windows.least;
  parameters->adaptiveThreshWinSizeMax = windows.most;
  parameters->adaptiveThreshWinSizeStep = 4;
  if (border > 1) parameters->perspectiveRemoveIgnoredMarginPerCell = 0.3;  // blurred by neighbours
  parameters->adaptiveThreshConstant = darker;
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
  cv::aruco::detectMarkers(image, cv::aruco::getPredefinedDictionary(dictionary), corners, ids,
                           parameters);
  Markers out;
  for (size_t i = 0; i < ids.size(); ++i) {
    Quad quad;
    bool whole = true;  // edges at the rim of the image are not where they seem
    for (size_t k = 0; k < 4; ++k) {
      quad[k] = corners[i][k];
      whole = whole && cv::Rect(6, 6, image.cols - 12, image.rows - 12).contains(corners[i][k]);
    }
    if (!whole) continue;
    out.emplace(ids[i], quad);
  }
  return out;
}

double edge_length(const Quad& quad) {
  double out = 1e9;
  for (size_t k = 0; k < 4; ++k) out = std::min(out, cv::norm(quad[k] - quad[(k + 1) % 4]));
  return out;
}

double brightness(const cv::Mat& image, cv::Point2d p) {
  const int x = std::clamp(static_cast<int>(std::floor(p.x)), 0, image.cols - 2);
  const int y = std::clamp(static_cast<int>(std::floor(p.y)), 0, image.rows - 2);
  const double a = std::clamp(p.x - x, 0., 1.), b = std::clamp(p.y - y, 0., 1.);
  return (1 - b) * ((1 - a) * image.at<uchar>(y, x) + a * image.at<uchar>(y, x + 1)) +
         b * ((1 - a) * image.at<uchar>(y + 1, x) + a * image.at<uchar>(y + 1, x + 1));
}

/// How far beside the line through `p` along its `normal` the edge is: the middle of the slope.
double edge_offset(const cv::Mat& image, cv::Point2d p, cv::Point2d normal, double reach) {
  double weight = 0, sum = 0;
  for (double o = -reach; o <= reach; o += 0.25) {
    const double slope =
        brightness(image, p + (o + 0.5) * normal) - brightness(image, p + (o - 0.5) * normal);
    if (slope <= 0) continue;  // out of the marker it gets brighter
    weight += slope * slope;
    sum += slope * slope * o;
  }
  return weight > 0 ? sum / weight : 0;
}

/// Moves the corners of a dark quad to where its edges meet: each is a parabola (of the lens)
/// fitted to where the brightness changes; its ends are left out, blur makes them round.
Quad refine_quad(const cv::Mat& image, const Quad& given, double reach) {
  Quad quad = given;
  for (int pass = 0; pass < 3; ++pass) {
    std::array<cv::Point2d, 4> begin, begin_way, end, end_way;
    for (size_t k = 0; k < 4; ++k) {
      const cv::Point2d from = quad[k], way = quad[(k + 1) % 4] - from;
      const double length = cv::norm(way);
      const cv::Point2d normal = cv::Point2d(way.y, -way.x) / length;  // out of the quad
      const int n = std::clamp(static_cast<int>(length), 12, 120);
      cv::Mat a(n, 3, CV_64F), b(n, 1, CV_64F), x;
      for (int i = 0; i < n; ++i) {
        const double t = 0.1 + 0.8 * i / (n - 1);
        a.at<double>(i, 0) = 1, a.at<double>(i, 1) = t, a.at<double>(i, 2) = t * t;
        b.at<double>(i) = edge_offset(image, from + t * way, normal, pass ? 0.7 * reach : reach);
      }
      cv::solve(a, b, x, cv::DECOMP_QR);
      const double c0 = x.at<double>(0), c1 = x.at<double>(1), c2 = x.at<double>(2);
      begin[k] = from + c0 * normal, begin_way[k] = way + c1 * normal;
      end[k] = from + way + (c0 + c1 + c2) * normal, end_way[k] = way + (c1 + 2 * c2) * normal;
    }
    for (size_t k = 0; k < 4; ++k) {
      const size_t before = (k + 3) % 4;
      const double cross = end_way[before].cross(begin_way[k]);
      if (std::abs(cross) < 1e-9) return given;
      const double t = (begin[k] - end[before]).cross(begin_way[k]) / cross;
      quad[k] = end[before] + t * end_way[before];
      if (cv::norm(quad[k] - given[k]) > 2 * reach + 2) return given;
    }
  }
  return quad;
}

int bits_of(int dictionary) { return cv::aruco::getPredefinedDictionary(dictionary)->markerSize; }

/// The points that agree with one homography, and its worst distances for those that do.
int agreeing(const Places& plane, const Places& pixels, double tolerance, cv::Mat& inliers) {
  if (plane.size() < 4) return 0;
  const cv::Mat h = cv::findHomography(plane, pixels, cv::RANSAC, tolerance, inliers, 2000);
  return h.empty() ? 0 : cv::countNonZero(inliers);
}

bool on_one_line(const Places& points) {
  std::vector<cv::Point2f> fine(points.begin(), points.end());
  const cv::RotatedRect box = cv::minAreaRect(fine);
  return std::min(box.size.width, box.size.height) < 1e-3f;
}

Detection missing(const std::string& reason) {
  Detection out;
  out.reason = reason;
  return out;
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

/// All markers in their squares of a layout, if one view of a plane explains them: no number was
/// misread, and the lens is not too much for the view. Contours run inside of the ink, so a
/// marker's corners may be a pixel or two off, its middle not.
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
  if (placed.size() < 4) return {};
  view = fit_plane_view(plane, pixels, image);
  for (size_t i = 0; i < placed.size(); ++i) {
    cv::Point2d off;
    double most = 0;
    for (size_t k = 4 * i; k < 4 * i + 4; ++k) {
      const cv::Point2d d = pixels[k] - view(plane[k]);
      off += 0.25 * d;
      most = std::max(most, cv::norm(d));
    }
    if (!(cv::norm(off) < 1.2 && most < 2 + 0.1 * edge_length(placed[i].quad))) return {};
  }
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
  const Markers markers =
      find_markers(image, target.dictionary, 1, 7, {kFirstWindow, kFirstWindow});
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
  Markers markers = find_markers(image, target.dictionary, 1);
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
    reason = "the markers do not lie as on this board";
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

Detection find_charuco(const cv::Mat& image, const ImageTarget& target) {
  std::string reason;
  BoardLook look = first_look(image, target);
  if (!look.complete) look = second_look(image, target, reason);
  if (!reason.empty()) return missing(reason);
  Detection out = refined(image, look.corners);
  out.layouts = look.layouts;
  if (out.ids.empty() && !look.corners.empty())
    return missing("what is free beside its markers is too narrow for the blur");
  if (out.ids.size() < 4 || on_one_line(out.pixels))
    return missing(std::to_string(out.ids.size()) + " corners: too few, or on a line");
  return out;
}

Detection find_tags(const cv::Mat& image, const ImageTarget& target) {
  int border = 2;  // Kalibr's; a grid of plain tags has 1
  Markers tags = find_markers(image, target.dictionary, border);
  // Small tags are read better in a bigger picture, where contours have finer corners; blur joins
  // tags and the squares at their corners, which a darker threshold parts.
  const auto add = [&](const cv::Mat& picture, int scale, double darker) {
    const cv::Point2d half(0.5, 0.5);
    Markers more;
    for (auto one : find_markers(picture, target.dictionary, border, darker)) {
      for (cv::Point2d& p : one.second) p = (p + half) / scale - half;
      if (!tags.count(one.first)) more.insert(one);
    }
    tags.insert(more.begin(), more.end());
  };
  cv::Mat bigger;
  cv::resize(image, bigger, {}, 2, 2, cv::INTER_CUBIC);
  add(bigger, 2, 7);
  add(image, 1, 20);
  add(bigger, 2, 20);
  const Markers plain = find_markers(image, target.dictionary, 1);
  if (plain.size() > tags.size()) tags = plain, border = 1;
  for (auto one = tags.begin(); one != tags.end();)
    one = one->first < target.rows * target.columns ? std::next(one) : tags.erase(one);
  if (tags.empty()) return missing("no tag of its family and numbers");

  // OpenCV turns a family's codes its own way: the grid tells which corner is which, and for a
  // single tag what OpenCV 4 does.
  Places pixels;
  for (const auto& one : tags) pixels.insert(pixels.end(), one.second.begin(), one.second.end());
  cv::Mat inliers;
  int best = 0, best_turn = 1;
  const double tolerance = 3 + 0.1 * edge_length(tags.begin()->second);
  for (const int turn : {1, 3, 0, 2}) {
    Places plane;
    for (const auto& one : tags)
      for (int k = 0; k < 4; ++k)
        plane.push_back(target.points[4 * one.first + (turn - k + 4) % 4]);
    cv::Mat mask;
    const int count = agreeing(plane, pixels, tolerance, mask);
    if (count > best) best = count, best_turn = turn, inliers = mask;
  }
  if (best < 4) return missing("the tags do not lie as on this grid");
  Detection out;
  std::vector<Saddle> saddles;
  int row = 0;
  for (auto& [id, quad] : tags) {
    const bool good = cv::countNonZero(inliers.rowRange(row, row + 4)) == 4;
    row += 4;
    if (!good || (!out.ids.empty() && out.ids.back() == 4 * id + 3)) continue;
    const double cells = bits_of(target.dictionary) + 2 * border;  // of a tag's edge
    const Quad sharp =
        refine_quad(image, quad, std::clamp(0.8 * border * edge_length(quad) / cells, 1.5, 5.0));
    for (int k = 0; k < 4; ++k) {
      const size_t at = static_cast<size_t>(best_turn - k + 4) % 4;
      const cv::Point2d x = sharp[(at + 1) % 4] - sharp[at], y = sharp[(at + 3) % 4] - sharp[at];
      Saddle one;
      one.id = 4 * id + k;
      one.pixel = sharp[at];
      one.sides = cv::Matx22d(x.x, y.x, x.y, y.y);
      one.reach = one.strip = 0.8 * std::min(target.gap, 2 / cells);
      saddles.push_back(one);
      out.ids.push_back(one.id);
      out.pixels.push_back(one.pixel);
    }
  }
  if (out.ids.empty()) return missing("the tags do not lie as on this grid");
  // Where dark squares touch the corners, these are better known than by the tag's edges.
  if (border == 2 && target.gap > 0) out = refined(image, saddles);
  if (out.ids.empty()) return missing("its tags are too small for the blur");
  return out;
}

Detection find_marker(const cv::Mat& image, const ImageTarget& target) {
  const Markers markers = find_markers(image, target.dictionary, 1);
  const auto found = markers.find(target.marker_id);
  if (markers.count(target.marker_id) != 1)
    return missing("no marker " + std::to_string(target.marker_id) + ", or more than one");
  const double cell = edge_length(found->second) / (bits_of(target.dictionary) + 2);
  const Quad quad = refine_quad(image, found->second, std::clamp(0.6 * cell, 1.5, 5.0));
  Detection out;
  out.ids = {0, 1, 2, 3};
  out.pixels.assign(quad.begin(), quad.end());
  return out;
}

}  // namespace kincal
