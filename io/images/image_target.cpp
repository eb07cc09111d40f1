#include "image_target.h"

#include <algorithm>
#include <map>
#include <opencv2/aruco.hpp>

namespace kincal {
namespace {

/// Returns OpenCV's number of a dictionary, by OpenCV's name (DICT_5X5_100) or an AprilTag family
/// (tag36h11, 36h11); -1: there is none of that name.
int marker_dictionary(const std::string& name) {
  static const char* const sizes[] = {"50", "100", "250", "1000"};
  std::map<std::string, int> known = {{"ARUCO_ORIGINAL", cv::aruco::DICT_ARUCO_ORIGINAL},
                                      {"16h5", cv::aruco::DICT_APRILTAG_16h5},
                                      {"25h9", cv::aruco::DICT_APRILTAG_25h9},
                                      {"36h10", cv::aruco::DICT_APRILTAG_36h10},
                                      {"36h11", cv::aruco::DICT_APRILTAG_36h11}};
  for (int bits = 4; bits <= 7; ++bits)
    for (int i = 0; i < 4; ++i)
      known[std::to_string(bits) + "X" + std::to_string(bits) + "_" + sizes[i]] =
          cv::aruco::DICT_4X4_50 + 4 * (bits - 4) + i;
  std::string bare = name;
  for (const char* prefix : {"cv2.aruco.", "cv::aruco::", "DICT_", "APRILTAG_", "tag", "t"})
    if (bare.rfind(prefix, 0) == 0) bare.erase(0, std::string(prefix).size());
  std::replace(bare.begin(), bare.end(), 'x', 'X');
  const auto found = known.find(bare);
  return found == known.end() ? -1 : found->second;
}

}  // namespace

std::string dictionary_name(int dictionary) {
  static const char* const names[] = {"DICT_ARUCO_ORIGINAL", "tag16h5", "tag25h9", "tag36h10",
                                      "tag36h11"};
  static const char* const sizes[] = {"50", "100", "250", "1000"};
  const int bits = 4 + dictionary / 4, other = dictionary - cv::aruco::DICT_ARUCO_ORIGINAL;
  if (other >= 0) return other < 5 ? names[other] : "";
  return "DICT_" + std::to_string(bits) + "X" + std::to_string(bits) + "_" + sizes[dictionary % 4];
}

ImageTarget read_image_target(const std::string& name, const Field& field,
                              std::vector<cv::Point2d> points) {
  using Kind = ImageTarget::Kind;
  ImageTarget out;
  out.name = name;
  out.points = std::move(points);
  const std::string type = field["type"].string();
  const auto dictionary = [&](const std::string& key) {
    out.dictionary = marker_dictionary(field[key].string());
    if (out.dictionary < 0)
      field[key].fail("there is no dictionary '" + field[key].string() +
                      "'; valid: OpenCV's names (DICT_4X4_50 to DICT_7X7_1000, "
                      "DICT_ARUCO_ORIGINAL) and tag16h5, tag25h9, tag36h10, tag36h11");
  };
  const auto first_id = [&](int count) {
    if (!field.has("first_id")) return;
    out.marker_id = field["first_id"].integer(0, 100000);
    const int all = cv::aruco::getPredefinedDictionary(out.dictionary)->bytesList.rows;
    if (out.marker_id + count > all)
      field["first_id"].fail("the board's markers would be " + std::to_string(out.marker_id) +
                             " to " + std::to_string(out.marker_id + count - 1) +
                             ", the dictionary has " + std::to_string(all));
  };
  if (field.has("rows")) {
    out.rows = field["rows"].integer(1, 10000);
    out.columns = field["columns"].integer(1, 10000);
  }
  if (type == "chessboard") {
    if (out.rows < 3 || out.columns < 3)
      field.fail("a chessboard needs at least 3 x 3 inner corners to be found in an image");
  } else if (type == "circles") {
    out.kind = Kind::circles;
    out.asymmetric = field.has("asymmetric") && field["asymmetric"].boolean();
    out.large_origin = field.has("origin");
    if (out.rows < 2 || out.columns < 2)
      field.fail("a grid needs at least 2 x 2 circles to be found in an image");
  } else if (type == "charuco") {
    out.kind = Kind::charuco;
    out.marker = field["marker"].positive() / field["square"].positive();
    if (out.marker >= 1) field["marker"].fail("a marker is smaller than its square");
    dictionary("dictionary");
    first_id((out.rows * out.columns + 1) / 2);
  } else if (type == "apriltag_grid") {
    out.kind = Kind::tags;
    out.gap = field["spacing"].number_at_least(0);
    dictionary("family");
    first_id(out.rows * out.columns);
  } else if (type == "marker") {
    out.kind = Kind::marker;
    out.marker_id = field["id"].integer(0, 100000);
    dictionary("dictionary");
  } else {
    field["type"].fail("targets of type '" + type + "' are not found in images");
  }
  return out;
}

bool look_alike(const ImageTarget& a, const ImageTarget& b) {
  using Kind = ImageTarget::Kind;
  const auto codes = [](const ImageTarget& t) {
    return t.kind == Kind::charuco || t.kind == Kind::tags || t.kind == Kind::marker;
  };
  if (codes(a) != codes(b)) return false;
  if (codes(a)) {
    const auto count = [](const ImageTarget& t) {
      return t.kind == Kind::marker ? 1
             : t.kind == Kind::tags ? t.rows * t.columns
                                    : (t.rows * t.columns + 1) / 2;
    };
    return a.dictionary == b.dictionary && a.marker_id < b.marker_id + count(b) &&
           b.marker_id < a.marker_id + count(a);
  }
  return a.kind == b.kind && a.asymmetric == b.asymmetric &&
         ((a.rows == b.rows && a.columns == b.columns) ||
          (a.kind == Kind::chessboard && a.rows == b.columns && a.columns == b.rows));
}

bool same_print(const ImageTarget& a, const ImageTarget& b) {
  using Kind = ImageTarget::Kind;
  return a.kind == b.kind && a.kind != Kind::circles && a.kind != Kind::marker &&
         a.rows == b.rows && a.columns == b.columns && a.marker == b.marker && a.gap == b.gap &&
         a.dictionary == b.dictionary && a.marker_id == b.marker_id;
}

ImageTarget image_target(const RigFile& rig, const Target& target) {
  std::vector<cv::Point2d> points;
  const Eigen::Matrix3Xd& places = target.grid ? target.layout : target.points;
  for (int i = 0; i < target.count(); ++i) points.emplace_back(places(0, i), places(1, i));
  return read_image_target(target.name, top(rig.node, rig.path)["targets"][target.name], points);
}

}  // namespace kincal
