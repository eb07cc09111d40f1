// Grids of AprilTags: Kalibr's, with borders of two cells and dark squares at the tags' corners, or
// plain ones.
//
// What is far darker than its surroundings is mostly a tag apart from the squares that touch it. So
// one search of the picture finds many tags of the grid. One view of a plane that explains them
// says where the others are and which cells of them are bright: those that look so are there. Only
// if no view explains what was found, or too much cannot be read, the picture is searched in all
// ways, and in twice the size.
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

#include "../../models/rig/words.h"
#include "finders.h"
#include "markers.h"
#include "saddle.h"

namespace kincal {
namespace {

/// The tags of a grid in a picture.
struct TagGrid {
  int border = 2;            // cells: Kalibr's; that of plain tags is 1
  int turn = 1;              // OpenCV turns a family's codes its own way: corner i of what it finds
                             // is point turn - i of the tag
  std::map<int, Quad> tags;  // by number, corners in the order of the points
  PlaneView view;            // of what the points say
};

constexpr std::array<int, 4> kTurns = {1, 3, 0,
                                       2};  // of a single tag the first, as OpenCV 4 has it
constexpr int kFirstWidth = 15;             // px, of the windows of the first search
constexpr double kFirstDarker = 0.16;       // of the range of brightness in the picture

int point_of(int corner, int turn) { return (turn - corner + 4) % 4; }

int tag_count(const ImageTarget& target) { return target.rows * target.columns; }

double cells_of(const ImageTarget& target, int border) {
  return bits_of(target.dictionary) + 2 * border;
}

Quad in_order_of_points(const Quad& quad, int turn) {
  Quad out;
  for (int i = 0; i < 4; ++i) out[static_cast<size_t>(point_of(i, turn))] = quad[i];
  return out;
}

/// The tag's edges, located in the picture.
Quad sharp(const cv::Mat& image, const ImageTarget& target, const TagGrid& grid, const Quad& tag) {
  const Quad clockwise = in_order_of_points(tag, grid.turn);  // its own inverse
  const double cell = edge_length(tag) / cells_of(target, grid.border);
  return in_order_of_points(
      refine_quad(image, clockwise, std::clamp(0.8 * grid.border * cell, 1.5, 5.0)), grid.turn);
}

Quad as_seen(const ImageTarget& target, const PlaneView& view, int id) {
  Quad out;
  for (int k = 0; k < 4; ++k) out[k] = view(target.points[4 * id + k]);
  return out;
}

/// Whether one view explains all tags: then it is the grid's.
bool explained(const ImageTarget& target, cv::Size image, TagGrid& grid) {
  Places plane, pixels;
  for (const auto& [id, tag] : grid.tags)
    for (int k = 0; k < 4; ++k) {
      plane.push_back(target.points[4 * id + k]);
      pixels.push_back(tag[k]);
    }
  return grid.tags.size() > 1 && in_one_view(plane, pixels, image, grid.view);
}

/// Whether the cells of a tag are dark and bright as its code is, where the view has them.
bool reads(const cv::Mat& image, const ImageTarget& target, const TagGrid& grid, int id) {
  const auto dictionary = cv::aruco::getPredefinedDictionary(target.dictionary);
  const cv::Mat bits = cv::aruco::Dictionary::getBitsFromByteList(
      dictionary->bytesList.rowRange(target.marker_id + id, target.marker_id + id + 1),
      dictionary->markerSize);
  const int border = grid.border, size = bits.rows + 2 * border;
  std::array<cv::Point2d, 4> corners;
  for (int i = 0; i < 4; ++i) corners[i] = target.points[4 * id + point_of(i, grid.turn)];
  std::array<std::vector<double>, 2> cells;  // dark and bright ones
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c) {
      const bool inside = std::min(r, c) >= border && std::max(r, c) < size - border;
      const cv::Point2d at = corners[0] + (c + 0.5) / size * (corners[1] - corners[0]) +
                             (r + 0.5) / size * (corners[3] - corners[0]);
      cells[inside ? bits.at<uchar>(r - border, c - border) : 0].push_back(
          brightness(image, grid.view(at)));
    }
  std::array<double, 2> mean{};
  for (const int i : {0, 1})
    for (const double value : cells[i]) mean[i] += value / static_cast<double>(cells[i].size());
  const double middle = 0.5 * (mean[0] + mean[1]);
  int wrong = 0;
  for (const double value : cells[0]) wrong += value > middle;
  for (const double value : cells[1]) wrong += value < middle;
  return mean[1] - mean[0] > 8 && wrong <= size * size / 40;
}

/// Adds tags that can be read where the view has them; returns how many it has in the picture that
/// cannot.
int add_read(const cv::Mat& image, const ImageTarget& target, TagGrid& grid) {
  const cv::Rect inside(6, 6, image.cols - 12, image.rows - 12);
  int missed = 0;
  for (int id = 0; id < tag_count(target); ++id) {
    if (grid.tags.count(id)) continue;
    const Quad tag = as_seen(target, grid.view, id);
    if (!std::all_of(tag.begin(), tag.end(),
                     [&](const cv::Point2d& p) { return inside.contains(cv::Point(p)); }))
      continue;
    if (reads(image, target, grid, id))
      grid.tags[id] = tag;
    else
      ++missed;
  }
  return missed;
}

/// Grey levels between the dark and the bright twentieth of a picture.
int range_of(const cv::Mat& image) {
  std::array<int, 256> levels{};
  int count = 0;
  const int step = 1 + static_cast<int>(image.total() / 5000);  // so many are enough
  for (int y = 0; y < image.rows; ++y)
    for (int x = y % step; x < image.cols; x += step) ++levels[image.at<uchar>(y, x)], ++count;
  const auto level = [&](double share) {
    int i = 0;
    for (int before = levels[0]; i < 255 && before < share * count;) before += levels[++i];
    return i;
  };
  return level(0.95) - level(0.05);
}

/// One search, and what the view of it adds. False: that is not enough.
bool first_look(const cv::Mat& image, const ImageTarget& target, TagGrid& grid) {
  const double darker = std::max(3.0, kFirstDarker * range_of(image));
  for (const int border : {2, 1}) {
    const Markers found = find_markers(image, target, {border, darker, kFirstWidth, kFirstWidth});
    for (const int turn : kTurns) {
      grid = {border, turn, {}, {}};
      for (const auto& [id, quad] : found)
        if (id < tag_count(target)) grid.tags[id] = in_order_of_points(quad, turn);
      if (!explained(target, image.size(), grid)) continue;
      const int missed = add_read(image, target, grid);
      if (missed > static_cast<int>(grid.tags.size()) / 4) return false;
      for (auto& [id, tag] : grid.tags) tag = as_seen(target, grid.view, id);
      return true;
    }
  }
  return false;
}

/// All that a picture shows of tags, with the border that more of them have. Small tags are read
/// better in a bigger picture, where contours have finer corners; blur joins tags and the squares
/// at their corners, which a darker threshold parts.
Markers search_all(const cv::Mat& image, const ImageTarget& target, int& border) {
  border = 2;
  Markers tags = find_markers(image, target, {border});
  const auto add = [&](const cv::Mat& picture, int scale, double darker) {
    const cv::Point2d half(0.5, 0.5);
    Markers more;
    for (auto one : find_markers(picture, target, {border, darker})) {
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
  const Markers plain = find_markers(image, target, {});
  if (plain.size() > tags.size()) tags = plain, border = 1;
  for (auto one = tags.begin(); one != tags.end();)
    one = one->first < tag_count(target) ? std::next(one) : tags.erase(one);
  return tags;
}

/// The tags that agree with one homography, of all that were found, and those that their view adds.
TagGrid all_looks(const cv::Mat& image, const ImageTarget& target, std::string& reason) {
  TagGrid grid;
  const Markers found = search_all(image, target, grid.border);
  if (found.empty()) {
    reason = "no tag of its family and ids";
    return grid;
  }
  Places pixels;
  for (const auto& one : found) pixels.insert(pixels.end(), one.second.begin(), one.second.end());
  const double tolerance = 3 + 0.1 * edge_length(found.begin()->second);
  cv::Mat inliers;
  int best = 0;
  for (const int turn : kTurns) {
    Places plane;
    for (const auto& one : found)
      for (int i = 0; i < 4; ++i) plane.push_back(target.points[4 * one.first + point_of(i, turn)]);
    cv::Mat mask;
    const int count = agreeing(plane, pixels, tolerance, mask);
    if (count > best) best = count, grid.turn = turn, inliers = mask;
  }
  int row = 0;
  for (const auto& [id, quad] : found) {
    if (best >= 4 && cv::countNonZero(inliers.rowRange(row, row + 4)) == 4 && !grid.tags.count(id))
      grid.tags[id] = sharp(image, target, grid, in_order_of_points(quad, grid.turn));
    row += 4;
  }
  if (grid.tags.empty()) reason = "the tags are not arranged as on this grid";
  for (size_t before = 0; before < grid.tags.size();) {
    before = grid.tags.size();
    const std::map<int, Quad> known = grid.tags;
    if (!explained(target, image.size(), grid)) break;
    add_read(image, target, grid);
    for (auto& [id, tag] : grid.tags)
      if (!known.count(id)) tag = sharp(image, target, grid, tag);
  }
  return grid;
}

}  // namespace

Detection find_tags(const cv::Mat& image, const ImageTarget& target,
                    const Compression& compression) {
  TagGrid grid;
  std::string reason;
  // Where dark squares touch the corners, these are better known than by the tag's edges.
  const auto squares = [&] { return grid.border == 2 && target.gap > 0; };
  if (!first_look(image, target, grid))
    grid = all_looks(image, target, reason);
  else if (!squares())
    for (auto& one : grid.tags) one.second = sharp(image, target, grid, one.second);
  if (!reason.empty()) return missing(reason);
  Detection out;
  std::vector<Saddle> saddles;
  for (const auto& [id, tag] : grid.tags)
    for (int k = 0; k < 4; ++k) {
      const cv::Point2d x = tag[(k + 1) % 4] - tag[k], y = tag[(k + 3) % 4] - tag[k];
      Saddle one;
      one.id = 4 * id + k;
      one.pixel = tag[k];
      one.sides = cv::Matx22d(x.x, y.x, x.y, y.y);
      one.reach = one.strip = 0.8 * std::min(target.gap, 2 / cells_of(target, grid.border));
      saddles.push_back(one);
      out.ids.push_back(one.id);
      out.pixels.push_back(one.pixel);
    }
  if (squares()) out = refined(image, compression, saddles);
  if (out.ids.empty())
    return missing(
        text("the gaps between its tags (spacing: %g) are too narrow for the blur, "
             "or no dark squares are there",
             target.gap));
  return out;
}

}  // namespace kincal
