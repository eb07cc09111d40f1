// OpenCV finds the markers; corners are located here, because its AprilTag refinement is half a
// pixel off.
#include "markers.h"

#include <algorithm>
#include <cmath>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "finders.h"

namespace kincal {
namespace {

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

}  // namespace

Markers find_markers(const cv::Mat& image, int dictionary, const MarkerSearch& search) {
  const auto parameters = cv::aruco::DetectorParameters::create();
  parameters->markerBorderBits = search.border;
  parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_NONE;
  parameters->minMarkerPerimeterRate = 0.02;
  parameters->adaptiveThreshWinSizeMin = search.least;
  parameters->adaptiveThreshWinSizeMax = search.most;
  parameters->adaptiveThreshWinSizeStep = 4;
  if (search.border > 1)
    parameters->perspectiveRemoveIgnoredMarginPerCell = 0.3;  // blurred by neighbours
  parameters->adaptiveThreshConstant = search.darker;
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

Markers find_markers(const cv::Mat& image, const ImageTarget& board, const MarkerSearch& search) {
  Markers out;
  for (const auto& [id, quad] : find_markers(image, board.dictionary, search))
    if (id >= board.marker_id) out.emplace(id - board.marker_id, quad);
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

int agreeing(const Places& plane, const Places& pixels, double tolerance, cv::Mat& inliers) {
  if (plane.size() < 4) return 0;
  const cv::Mat h = cv::findHomography(plane, pixels, cv::RANSAC, tolerance, inliers, 2000);
  return h.empty() ? 0 : cv::countNonZero(inliers);
}

bool in_one_view(const Places& plane, const Places& pixels, cv::Size image, PlaneView& view) {
  view = fit_plane_view(plane, pixels, image);
  for (size_t i = 0; i + 3 < plane.size(); i += 4) {
    cv::Point2d off;
    double most = 0;
    for (size_t k = i; k < i + 4; ++k) {
      const cv::Point2d d = pixels[k] - view(plane[k]);
      off += 0.25 * d;
      most = std::max(most, cv::norm(d));
    }
    const double edge = edge_length({pixels[i], pixels[i + 1], pixels[i + 2], pixels[i + 3]});
    if (!(cv::norm(off) < 1.2 && most < 2 + 0.1 * edge)) return false;
  }
  return true;
}

Detection missing(const std::string& reason) {
  Detection out;
  out.reason = reason;
  return out;
}

Detection find_marker(const cv::Mat& image, const ImageTarget& target) {
  const Markers markers = find_markers(image, target.dictionary, {});
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
