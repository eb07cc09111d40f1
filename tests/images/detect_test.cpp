// Proves that targets are found where they are: pictures of prints, made by rays through a lens,
// and the pixels that the detectors return beside the true ones; bias and scatter of each detector.
// Not proved: real light, dirt, rolling shutters.
#include "../../io/images/detect.h"

#include <cmath>
#include <ctime>
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "../../io/document/yaml.h"
#include "../../io/images/saddle.h"
#include "../../models/rig/targets.h"
#include "../fixtures/render.h"
#include "catch2/catch.hpp"

namespace detect_test {

using namespace kincal;
using namespace fixtures;

namespace {

struct Errors {
  int count = 0;
  cv::Point2d bias;
  double rms = 0, worst = 0;
};

/// Compares what was found with where the points are.
Errors errors_of(const PictureCamera& camera, const ImageTarget& target, const Detection& found) {
  Errors out;
  for (size_t i = 0; i < found.ids.size(); ++i) {
    const cv::Point2d p = target.points[found.ids[i]];
    const cv::Point2d d = found.pixels[i] - project(camera, p.x, p.y);
    out.bias += d;
    out.rms += d.dot(d);
    out.worst = std::max(out.worst, cv::norm(d));
  }
  out.count = static_cast<int>(found.ids.size());
  if (out.count == 0) return out;
  out.bias /= out.count;
  out.rms = std::sqrt(out.rms / out.count);
  return out;
}

ImageTarget target_of(const std::string& text, const GridLayout& grid) {
  const Node node = parse_yaml(text, "target");
  const std::string path = "target";
  std::vector<cv::Point2d> points;
  const Eigen::Matrix3Xd layout = grid_layout(grid);
  for (int i = 0; i < layout.cols(); ++i) points.emplace_back(layout(0, i), layout(1, i));
  return read_image_target("board", top(node, path), points);
}

/// Postures of the camera: straight, and tilted both ways and turned in the image.
std::vector<PictureCamera> postures(double mx, double my, double depth) {
  std::vector<PictureCamera> out;
  for (const cv::Vec3d& angles : {cv::Vec3d(0, 0, 0.03), cv::Vec3d(0.5, 0.1, 0.2),
                                  cv::Vec3d(-0.2, 0.6, -0.3), cv::Vec3d(0.3, -0.4, 0.6)}) {
    PictureCamera camera;
    camera.rotation = turned(angles[0], angles[1], angles[2]);
    aim(camera, mx, my, depth);
    out.push_back(camera);
  }
  return out;
}

/// Every posture: all points, of the right numbers, bias and scatter below the limits.
void check_target(const ImageTarget& target, const std::vector<PictureCamera>& cameras,
                  const std::function<double(double, double)>& print, double rms,
                  double least = 1) {
  cv::Point2d bias;
  for (const PictureCamera& camera : cameras) {
    const Detection found = detect(render(camera, print), target);
    const Errors e = errors_of(camera, target, found);
    std::string ids;
    for (const int id : found.ids) ids += " " + std::to_string(id);
    CAPTURE(ids, found.reason, e.bias.x, e.bias.y, e.rms, e.worst, found.rms, found.blur);
    CHECK(e.count >= least * static_cast<double>(target.points.size()));
    CHECK(e.rms < rms);
    bias += e.bias / static_cast<double>(cameras.size());
  }
  CAPTURE(bias.x, bias.y);
  CHECK(std::abs(bias.x) < 0.02);
  CHECK(std::abs(bias.y) < 0.02);
}

/// The print of a chessboard whose outer square at point 0 is dark.
double chessboard(double x, double y, int rows, int columns) {
  if (x < -1 || y < -1 || x > columns || y > rows) return 1;
  return (static_cast<int>(std::floor(x)) + static_cast<int>(std::floor(y))) % 2 == 0 ? 0 : 1;
}

/// The print of a marker from (0, 0) to (1, 1), y down: its bits in a dark border.
double marker(double x, double y, int dictionary, int id, int border) {
  static std::map<std::pair<int, int>, cv::Mat> known;
  cv::Mat& bits = known[{dictionary, id}];
  if (bits.empty()) {
    const auto all = cv::aruco::getPredefinedDictionary(dictionary);
    bits = cv::aruco::Dictionary::getBitsFromByteList(all->bytesList.rowRange(id, id + 1),
                                                      all->markerSize);
  }
  const int size = bits.rows + 2 * border;
  const int c = static_cast<int>(std::floor(x * size)) - border;
  const int r = static_cast<int>(std::floor(y * size)) - border;
  return c < 0 || r < 0 || c >= bits.cols || r >= bits.rows ? 0 : bits.at<uchar>(r, c);
}

/// The print of a ChArUco board, markers of 0.7 squares. `odd`: where they are.
double charuco(double x, double y, int rows, int columns, int odd) {
  if (x < 0 || y < 0 || x >= columns || y >= rows) return 1;
  const int c = static_cast<int>(x), r = static_cast<int>(y);
  if ((r + c) % 2 != odd) return 0;
  int id = 0;
  for (int i = 0; i < r * columns + c; ++i) id += (i / columns + i % columns) % 2 == odd;
  const double u = (x - c - 0.15) / 0.7, v = (y - r - 0.15) / 0.7;
  return u < 0 || v < 0 || u >= 1 || v >= 1 ? 1 : marker(u, v, cv::aruco::DICT_5X5_250, id, 1);
}

/// The print of Kalibr's grid, y up: tags of 1 with gaps of 0.3 and dark squares between their
/// corners. OpenCV's codes stand on their heads in it.
double tags(double x, double y, int rows, int columns) {
  const double pitch = 1.3;
  if (x < -0.3 || y < -0.3 || x >= columns * pitch || y >= rows * pitch) return 1;
  const int c = static_cast<int>(std::floor(x / pitch)),
            r = static_cast<int>(std::floor(y / pitch));
  const double u = x - c * pitch, v = y - r * pitch;
  if (u < 1 && v < 1 && c >= 0 && r >= 0)
    return marker(1 - u, v, cv::aruco::DICT_APRILTAG_36h11, r * columns + c, 2);
  return u >= 1 && v >= 1 ? 0 : 1;
}

/// As seen from the front where y of the print points up.
std::vector<PictureCamera> upright(std::vector<PictureCamera> cameras, double mx, double my,
                                   double depth) {
  for (PictureCamera& camera : cameras) {
    camera.rotation = camera.rotation * turned(CV_PI, 0, 0);
    aim(camera, mx, my, depth);
  }
  return cameras;
}

}  // namespace

TEST_CASE("images: a ChArUco board is found, whole and in part") {
  const ImageTarget target = target_of(
      "{type: charuco, rows: 6, columns: 8, square: 0.03, marker: 0.021, dictionary: "
      "DICT_5X5_250}",
      {GridLayout::Kind::charuco, 6, 8});
  for (const int odd : {1, 0}) {
    const auto print = [&](double x, double y) { return charuco(x, y, 6, 8, odd); };
    check_target(target, postures(4, 3, 12), print, 0.1);
  }
  PictureCamera camera = postures(4, 3, 12)[1];
  camera.translation[0] += 5;
  camera.rotation = camera.rotation * turned(0, 0, 0.2);
  const Detection part =
      detect(render(camera, [](double x, double y) { return charuco(x, y, 6, 8, 1); }), target);
  const Errors e = errors_of(camera, target, part);
  CHECK(e.count > 8);
  CHECK(e.count < 35);
  CHECK(e.worst < 0.3);
}

TEST_CASE("images: the rim of a ChArUco print has no corners") {
  const ImageTarget target = target_of(
      "{type: charuco, rows: 7, columns: 8, square: 0.03, marker: 0.021, dictionary: "
      "DICT_5X5_250}",
      {GridLayout::Kind::charuco, 7, 8});
  for (const PictureCamera& camera : postures(4, 3, 12)) {
    const Detection found =
        detect(render(camera, [](double x, double y) { return charuco(x, y, 6, 8, 1); }), target);
    CHECK(found.ids.size() == 35);
    CHECK(found.ids.back() == 34);
    CHECK(!found.no_corners.empty());
    CHECK(errors_of(camera, target, found).worst < 0.3);
  }
}

TEST_CASE("images: a ChArUco board that one threshold cannot read is looked at with all") {
  const ImageTarget target = target_of(
      "{type: charuco, rows: 6, columns: 8, square: 0.03, marker: 0.021, dictionary: "
      "DICT_5X5_250}",
      {GridLayout::Kind::charuco, 6, 8});
  PictureCamera camera = postures(4, 3, 12)[0];
  const auto print = [](double x, double y) { return charuco(x, y, 6, 8, 1); };
  const cv::Mat image = render(camera, print);
  const cv::Mat hand = image.clone();  // over the upper left markers
  cv::rectangle(hand, cv::Rect(100, 80, 150, 120), cv::Scalar(60), cv::FILLED);
  cv::Mat dim;  // so dark that ink is 7 grey levels below paper in a few windows only
  image.convertTo(dim, CV_8U, 0.09, 20);
  for (const auto& [picture, least] : {std::make_pair(hand, 24), std::make_pair(dim, 30)}) {
    const Errors e = errors_of(camera, target, detect(picture, target));
    CHECK(e.count >= least);
    CHECK(e.worst < 0.3);
  }
}

TEST_CASE("images: Kalibr's grid of AprilTags is found, whole and in part") {
  const ImageTarget target = target_of(
      "{type: apriltag_grid, rows: 4, columns: 5, tag: 0.03, spacing: 0.3, family: tag36h11}",
      {GridLayout::Kind::tags, 4, 5, false, 0.3});
  const auto print = [](double x, double y) { return tags(x, y, 4, 5); };
  const std::vector<PictureCamera> cameras = upright(postures(3.1, 2.45, 11), 3.1, 2.45, 11);
  check_target(target, cameras, print, 0.15);
  PictureCamera camera = cameras[1];
  camera.translation[0] += 3;
  const Errors e = errors_of(camera, target, detect(render(camera, print), target));
  CHECK(e.count >= 16);
  CHECK(e.count < 80);
  CHECK(e.worst < 0.4);
  camera.blur = 2;  // tags and the squares between them run into each other
  camera.rotation = turned(0.1, 10 * CV_PI / 180, 0.1) * turned(CV_PI, 0, 0);
  aim(camera, 3.1, 2.45, 11);
  const Errors blurred = errors_of(camera, target, detect(render(camera, print), target));
  CHECK(blurred.count == 80);
  CHECK(blurred.rms < 0.1);
}

TEST_CASE("images: tags that no contour shows are read, and none that is not there") {
  const ImageTarget target = target_of(
      "{type: apriltag_grid, rows: 4, columns: 5, tag: 0.03, spacing: 0.3, family: tag36h11}",
      {GridLayout::Kind::tags, 4, 5, false, 0.3});
  const auto print = [](double x, double y) { return tags(x, y, 4, 5); };
  const PictureCamera camera = upright(postures(3.1, 2.45, 11), 3.1, 2.45, 11)[0];
  const cv::Mat image = render(camera, print);
  cv::Mat dim;
  image.convertTo(dim, CV_8U, 0.09, 20);
  CHECK(errors_of(camera, target, detect(dim, target)).count >= 76);
  // Tag 6 covered, tag 7 with another's code, tag 8 scratched: one cell of its border is bright.
  const auto spoilt = [&](double x, double y) {
    if (x > 1.2 && x < 2.4 && y > 1.2 && y < 2.4) return 0.3;
    if (x > 2.6 && x < 3.6 && y > 1.3 && y < 2.3)
      return marker(3.6 - x, y - 1.3, cv::aruco::DICT_APRILTAG_36h11, 400, 2);
    if (x > 4.3 && x < 4.4 && y > 1.3 && y < 1.4) return 1.0;
    return print(x, y);
  };
  const Detection found = detect(render(camera, spoilt), target);
  std::set<int> read;
  for (const int id : found.ids) read.insert(id / 4);
  CHECK(read.count(6) + read.count(7) == 0);
  CHECK(read.count(8) == 1);
  CHECK(read.size() == 18);
  // A grid of plain tags: only its edges are there to be located.
  const auto plain = [](double x, double y) {
    const int c = static_cast<int>(std::floor(x / 1.3)), r = static_cast<int>(std::floor(y / 1.3));
    const double u = x - 1.3 * c, v = y - 1.3 * r;
    if (c < 0 || r < 0 || c > 4 || r > 3 || u > 1 || v > 1) return 1.0;
    return marker(1 - u, v, cv::aruco::DICT_APRILTAG_36h11, 5 * r + c, 1);
  };
  check_target(target, upright(postures(3.1, 2.45, 11), 3.1, 2.45, 11), plain, 0.15);
}

TEST_CASE("images: grids of circles are found, and big ones seen obliquely are where they are") {
  const auto print = [](bool asymmetric, bool large, int rows, int columns, double radius) {
    return [=](double x, double y) {
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c) {
          const double dx = x - (asymmetric ? 2 * c + r % 2 : c), dy = y - r;
          const double size = radius * (large && r + c == 0 ? 1.4 : 1);
          if (dx * dx + dy * dy < size * size) return 0;
        }
      return 1;
    };
  };
  const ImageTarget symmetric = target_of("{type: circles, rows: 5, columns: 7, spacing: 0.03}",
                                          {GridLayout::Kind::circles, 5, 7});
  check_target(symmetric, postures(3, 2, 10), print(false, false, 5, 7, 0.33), 0.02);
  const ImageTarget large =
      target_of("{type: circles, rows: 5, columns: 7, spacing: 0.03, origin: large}",
                {GridLayout::Kind::circles, 5, 7});
  std::vector<PictureCamera> cameras = postures(3, 2, 10);
  check_target(large, cameras, print(false, true, 5, 7, 0.25), 0.02);
  for (PictureCamera& camera : cameras) {  // head down
    camera.rotation = camera.rotation * turned(0, 0, CV_PI);
    aim(camera, 3, 2, 10);
  }
  check_target(large, cameras, print(false, true, 5, 7, 0.25), 0.02);
  const ImageTarget asymmetric =
      target_of("{type: circles, rows: 11, columns: 4, spacing: 0.02, asymmetric: true}",
                {GridLayout::Kind::circles, 11, 4, true});
  cameras = postures(3.5, 5, 20);
  check_target(asymmetric, cameras, print(true, false, 11, 4, 0.5), 0.02);
  for (PictureCamera& camera : cameras) {  // head down: an odd number of rows tells
    camera.rotation = camera.rotation * turned(0, 0, CV_PI);
    aim(camera, 3.5, 5, 20);
  }
  check_target(asymmetric, cameras, print(true, false, 11, 4, 0.5), 0.02);
}

TEST_CASE("images: neither the lens nor falling light moves the centres of circles") {
  const ImageTarget target = target_of("{type: circles, rows: 5, columns: 7, spacing: 0.03}",
                                       {GridLayout::Kind::circles, 5, 7});
  const auto print = [](double x, double y) {
    const double dx = x - std::round(x), dy = y - std::round(y);
    return x < -0.5 || y < -0.5 || x > 6.5 || y > 4.5 || dx * dx + dy * dy > 0.33 * 0.33 ? 1. : 0.;
  };
  double outwards = 0, squares = 0;
  int count = 0;
  for (PictureCamera& camera : postures(3, 2, 10)) {
    camera.k1 = -0.25;
    RandomStream draws(7);
    cv::Mat light = exposed(camera, print, draws);
    REQUIRE(light.type() == CV_64F);
    for (int y = 0; y < light.rows; ++y)  // half as bright in the corners
      for (int x = 0; x < light.cols; ++x)
        light.at<double>(y, x) *=
            (1 - 0.5 * (std::pow(x - 319.5, 2) + std::pow(y - 239.5, 2)) / (400. * 400));
    const Detection found = detect(develop(light, 0, draws), target);
    REQUIRE(found.ids.size() == 35);
    for (size_t i = 0; i < found.ids.size(); ++i) {
      const cv::Point2d p = target.points[found.ids[i]], at = project(camera, p.x, p.y),
                        away = at - cv::Point2d(camera.cx, camera.cy), e = found.pixels[i] - at;
      if (cv::norm(away) < 80) continue;
      outwards += e.dot(away) / cv::norm(away);
      squares += e.dot(e);
      ++count;
    }
  }
  CAPTURE(outwards / count, std::sqrt(squares / count));
  CHECK(std::abs(outwards / count) < 0.003);  // it was -0.06
  CHECK(std::sqrt(squares / count) < 0.015);
}

TEST_CASE("images: a single marker is found by its edges") {
  ImageTarget target;
  for (const auto& [text, dictionary] :
       {std::make_pair("{type: marker, dictionary: DICT_4X4_50, id: 7, size: 0.05}",
                       cv::aruco::DICT_4X4_50),
        std::make_pair("{type: marker, dictionary: tag36h11, id: 7, size: 0.05}",
                       cv::aruco::DICT_APRILTAG_36h11)}) {
    const Node node = parse_yaml(text, "target");
    const std::string path = "target";
    target = read_image_target("marker", top(node, path),
                               {{-0.5, 0.5}, {0.5, 0.5}, {0.5, -0.5}, {-0.5, -0.5}});
    const auto print = [d = dictionary](double x, double y) {
      return std::abs(x) > 0.5 || std::abs(y) > 0.5 ? 1 : marker(x + 0.5, 0.5 - y, d, 7, 1);
    };
    check_target(target, upright(postures(0, 0, 4), 0, 0, 4), print, 0.1);
  }
}

TEST_CASE("images: a chessboard is found where it is, and numbered from its dark end") {
  const ImageTarget target = target_of("{type: chessboard, rows: 6, columns: 9, square: 0.02}",
                                       {GridLayout::Kind::corners, 6, 9});
  const auto print = [](double x, double y) { return chessboard(x, y, 6, 9); };
  std::vector<PictureCamera> cameras = postures(4, 2.5, 14);
  check_target(target, cameras, print, 0.1);
  for (PictureCamera& camera : cameras) {  // head down: the numbers go with the print
    camera.rotation = camera.rotation * turned(0, 0, CV_PI);
    aim(camera, 4, 2.5, 14);
  }
  check_target(target, cameras, print, 0.1);
}

TEST_CASE("images: a lattice of other steps is not taken for the board's") {
  // Of every third picture like these OpenCV returns rows that are sheared by a square: corners of
  // the board and of its rim.
  const ImageTarget target = target_of("{type: chessboard, rows: 4, columns: 5, square: 0.02}",
                                       {GridLayout::Kind::corners, 4, 5});
  const auto print = [](double x, double y) {
    return x < -2 || y < -2 || x > 6 || y > 5 ? 0.4 : chessboard(x, y, 4, 5);
  };
  RandomStream draws(5);
  for (int i = 0; i < 15; ++i) {
    const auto around = [&](double middle, double most) {
      return middle + draws.uniform(-most, most);
    };
    PictureCamera camera{400, 300, 772.5, 199.5, 149.5, 0};
    camera.noise = 2;
    const double x = around(1.12, 0.08), y = around(0.34, 0.08), z = around(-1.73, 0.1);
    camera.rotation = turned(x, y, z);
    camera.translation = {around(0, 1), around(-0.3, 1), 26};
    const Errors e = errors_of(camera, target, detect(render(camera, print), target));
    CHECK(e.count >= 18);
    CHECK(e.worst < 0.1);
  }
}

TEST_CASE("images: a part of a larger chessboard is no smaller one") {
  const ImageTarget small = target_of("{type: chessboard, rows: 4, columns: 5, square: 0.02}",
                                      {GridLayout::Kind::corners, 4, 5});
  const ImageTarget large = target_of("{type: chessboard, rows: 6, columns: 7, square: 0.02}",
                                      {GridLayout::Kind::corners, 6, 7});
  const auto alone = [](double x, double y) { return chessboard(x, y, 6, 7); };
  // A small board of 0.6 squares to the right of it, its point 0 at (8.5, 1.5).
  const auto both = [&](double x, double y) {
    return x < 7.5 ? alone(x, y) : chessboard((x - 8.5) / 0.6, (y - 1.5) / 0.6, 4, 5);
  };
  for (PictureCamera camera : postures(3, 2.5, 14)) {
    camera.blur = 0.8;
    const Detection part = detect(render(camera, alone), small);
    CHECK(part.ids.empty());
    CHECK(part.reason.find("looks like it") != std::string::npos);
    aim(camera, 5.5, 2.5, 18);
    const cv::Mat picture = render(camera, both);
    const Errors e = errors_of(camera, large, detect(picture, large));
    CHECK(e.count == 42);
    CHECK(e.worst < 0.3);
    const Detection found = detect(picture, small);
    CHECK(found.ids.size() == 20);
    for (size_t i = 0; i < found.ids.size(); ++i) {
      const int id = found.ids[i];
      const cv::Point2d at = project(camera, 8.5 + 0.6 * (id % 5), 1.5 + 0.6 * (id / 5));
      CHECK(cv::norm(found.pixels[i] - at) < 0.3);
    }
  }
}

TEST_CASE("images: the print of every type is what its finder looks for") {
  using Kind = GridLayout::Kind;
  struct Row {
    std::string text;
    GridLayout grid;
    cv::Point3d middle;  // and the distance
    bool y_up = false;
  };
  for (
      const Row& row : std::vector<Row>{
          {"{type: chessboard, rows: 6, columns: 9, square: 1}",
           {Kind::corners, 6, 9},
           {4, 2.5, 14}},
          {"{type: charuco, rows: 6, columns: 8, square: 1, marker: 0.7, dictionary: DICT_5X5_250}",
           {Kind::charuco, 6, 8},
           {4, 3, 12}},
          {"{type: charuco, rows: 7, columns: 5, square: 1, marker: 0.75, dictionary: DICT_4X4_50}",
           {Kind::charuco, 7, 5},
           {2.5, 3.5, 12}},
          {"{type: circles, rows: 5, columns: 7, spacing: 1, origin: large}",
           {Kind::circles, 5, 7},
           {3, 2, 10}},
          {"{type: circles, rows: 11, columns: 4, spacing: 1, asymmetric: true}",
           {Kind::circles, 11, 4, true},
           {3.5, 5, 20}},
          {"{type: apriltag_grid, rows: 4, columns: 5, tag: 1, spacing: 0.3, family: tag36h11}",
           {Kind::tags, 4, 5, false, 0.3},
           {3.1, 2.45, 11},
           true}}) {
    INFO(row.text);
    const ImageTarget target = target_of(row.text, row.grid);
    const cv::Point3d m = row.middle;
    std::vector<PictureCamera> cameras = postures(m.x, m.y, m.z);
    if (row.y_up) cameras = upright(cameras, m.x, m.y, m.z);
    check_target(target, cameras, print_of(target).brightness, 0.15, 0.9);
  }
}

TEST_CASE(
    "images: what blurs a picture is told in pixels, and a picture without a board gives none") {
  const ImageTarget target = target_of("{type: chessboard, rows: 6, columns: 9, square: 0.02}",
                                       {GridLayout::Kind::corners, 6, 9});
  PictureCamera camera = postures(4, 2.5, 14)[0];
  for (const double blur : {0.8, 2.0}) {
    camera.blur = blur;
    const Detection found =
        detect(render(camera, [](double x, double y) { return chessboard(x, y, 6, 9); }), target);
    REQUIRE(found.ids.size() == 54);
    CHECK(found.blur == Approx(blur).epsilon(0.25));
    CHECK(found.contrast == Approx(190. / 255).epsilon(0.15));
    CHECK(found.rms < 0.1);
  }
  const Detection none =
      detect(render(camera, [](double x, double) { return x > 3 ? 1 : 0; }), target);
  CHECK(none.ids.empty());
  CHECK_FALSE(none.reason.empty());
}

namespace {

/// A board seen at a tilt, `size` px between its corners in the middle, and what was found of it.
struct Shot {
  double size = 30, tilt = 0, blur = 0.6, noise = 2;
};

/// Squared errors of the coordinates, mean, and the squared sigma that was predicted; the share of
/// the corners that were found.
struct Honesty {
  double errors = 0, sigmas = 0, found = 0;
};

Honesty honesty(bool markers, const Shot& shot) {
  const ImageTarget target =
      markers ? target_of(
                    "{type: charuco, rows: 5, columns: 7, square: 1, marker: 0.7, dictionary: "
                    "DICT_5X5_250}",
                    {GridLayout::Kind::charuco, 5, 7})
              : target_of("{type: chessboard, rows: 5, columns: 6, square: 1}",
                          {GridLayout::Kind::corners, 5, 6});
  PictureCamera camera;
  camera.blur = shot.blur;
  camera.noise = shot.noise;
  camera.rotation = turned(0.06, shot.tilt * CV_PI / 180, 0.13);
  aim(camera, markers ? 3.5 : 2.5, markers ? 2.5 : 2, camera.f / shot.size);
  const Detection found =
      detect(render(camera,
                    [&](double x, double y) {
                      return markers ? charuco(x, y, 5, 7, 1) : chessboard(x, y, 5, 6);
                    }),
             target);
  const Errors e = errors_of(camera, target, found);
  return {0.5 * e.rms * e.rms, found.sigma * found.sigma,
          e.count / static_cast<double>(target.points.size())};
}

}  // namespace

TEST_CASE("images: the sigma of a corner is as large as its errors") {
  for (const bool markers : {false, true}) {
    double errors = 0, sigmas = 0;
    for (const Shot& shot : {Shot{40, 0, 0.6, 2}, Shot{40, 40, 1.1, 2}, Shot{30, 20, 0.8, 5}}) {
      const Honesty one = honesty(markers, shot);
      INFO(markers << " " << shot.size << " px, tilt " << shot.tilt);
      CHECK(one.found > 0.85);
      CHECK(std::sqrt(one.errors) == Approx(std::sqrt(one.sigmas)).epsilon(0.25));
      errors += one.errors / one.sigmas / 3;
      sigmas += 1. / 3;
    }
    CHECK(std::sqrt(errors / sigmas) == Approx(1).epsilon(0.15));
  }
}

TEST_CASE("images: corners of a ChArUco board that its markers leave no room are left out") {
  const Honesty small = honesty(true, {20, 55, 1.2, 2});
  CHECK(small.found < 0.5);
  CHECK(honesty(true, {40, 60, 0.8, 2}).errors < 0.05 * 0.05);
}

namespace {

const ImageTarget& charuco_board() {
  static const ImageTarget board = target_of(
      "{type: charuco, rows: 5, columns: 7, square: 1, marker: 0.7, dictionary: DICT_5X5_250}",
      {GridLayout::Kind::charuco, 5, 7});
  return board;
}

}  // namespace

TEST_CASE("images: a corner at the rim of the image that was guessed farther in is none") {
  PictureCamera camera;
  camera.noise = 1;
  camera.k1 = 0;
  aim(camera, (camera.cx - 2.5) / 40, 0, camera.f / 40);
  const cv::Mat image =
      render(camera, [](double x, double y) { return chessboard(x, y, 100, 100); });
  const auto refined_from = [&](double x, double away, Saddle& corner) {
    corner.pixel = project(camera, x, 1) + cv::Point2d(away, 0);
    corner.sides = cv::Matx22d(40, 0, 0, 40);
    corner.reach = corner.strip = 0.45;
    return refine(image, corner, nullptr);
  };
  Saddle corner;
  REQUIRE(project(camera, 0, 1).x < 4);
  CHECK_FALSE(refined_from(0, 0, corner));
  CHECK_FALSE(refined_from(0, 1.5, corner));  // a window there would be in the image
  CHECK(refined_from(1, 1.5, corner));
  CHECK(cv::norm(corner.pixel - project(camera, 1, 1)) < 0.1);
}

TEST_CASE("images: light that falls off moves no corner") {
  for (const double light : {0., 0.4}) {
    PictureCamera camera;
    camera.vignetting = light;
    camera.rotation = turned(0.2, -0.3, 0.2);
    aim(camera, 3.5, 2.5, camera.f / 45);
    camera.translation[0] += 3;  // to where it falls off most
    const Errors markers =
        errors_of(camera, charuco_board(),
                  detect(render(camera, [](double x, double y) { return charuco(x, y, 5, 7, 1); }),
                         charuco_board()));
    const ImageTarget squares = target_of("{type: chessboard, rows: 4, columns: 5, square: 1}",
                                          {GridLayout::Kind::corners, 4, 5});
    const Errors plain = errors_of(
        camera, squares,
        detect(render(camera, [](double x, double y) { return chessboard(x, y, 4, 5); }), squares));
    INFO(light << ": " << markers.count << " " << markers.rms << ", " << plain.count << " "
               << plain.rms);
    CHECK(markers.count >= 12);
    CHECK(markers.rms < 0.009);  // of both coordinates
    CHECK(plain.count == 20);
    CHECK(plain.rms < 0.009);
  }
}

TEST_CASE("images: a corner beside which something lies before the print is left out") {
  PictureCamera camera;
  camera.noise = 2;
  camera.rotation = turned(0.2, 0.1, 0.2);
  aim(camera, 2.5, 2.5, camera.f / 40);
  const Detection found = detect(
      render(camera,
             [](double x, double y) {
               return x > 3.12 + 0.3 * (y - 2) ? 1 : charuco(x, y, 5, 7, 1);  // 5 px from (3, 2)
             }),
      charuco_board());
  const Errors e = errors_of(camera, charuco_board(), found);
  INFO(e.count << " corners, worst " << e.worst << " px");
  CHECK(e.count >= 8);
  CHECK(e.worst < 0.1);
  CHECK(std::count(found.ids.begin(), found.ids.end(), 8) == 0);
}

TEST_CASE("images: a row of corners has the noise of the fields beside it") {
  PictureCamera camera;
  camera.noise = 2;
  aim(camera, 3.5, -2.5, camera.f / 60);  // the first row is the image's last
  const Detection found = detect(
      render(camera, [](double x, double y) { return charuco(x, y, 5, 7, 1); }), charuco_board());
  INFO(found.reason);
  REQUIRE(found.ids.size() >= 4);
  REQUIRE(found.ids.back() < 6);
  CHECK(found.noise == Approx(2).epsilon(0.15));
  CHECK(found.sigma > 0.008);
}

// Not run with the others: errors in predicted sigmas, docs/results/corner_sigmas.csv.
TEST_CASE("images: table of sigmas", "[.table]") {
  std::printf("\n| target, px between corners | tilt | noise 1 | 2 | 5 | found |\n");
  std::printf("| --- | --- | --- | --- | --- | --- |\n");
  for (const bool markers : {false, true})
    for (const double size : {15., 25., 40., 60.})
      for (const double tilt : {0., 30., 60.}) {
        std::printf("| %s, %.0f | %.0f |", markers ? "charuco" : "chessboard", size, tilt);
        double share = 0;
        for (const double noise : {1., 2., 5.}) {
          double ratio = 0, count = 0;
          for (const double blur : {0.5, 1.0, 1.5}) {
            const Honesty one = honesty(markers, {size, tilt, blur, noise});
            share += one.found / 9;
            if (one.found == 0) continue;
            ratio += one.found * one.errors / one.sigmas;
            count += one.found;
          }
          if (count > 0)
            std::printf(" %.2f |", std::sqrt(ratio / count));
          else
            std::printf(" not found |");
        }
        std::printf(" %.0f %% |\n", 100 * share);
        std::fflush(stdout);
      }
}

// Not run with the others: makes docs/results/detection_errors.csv (benchmarks/detectors).
TEST_CASE("images: table of errors against blur, noise and tilt", "[.table]") {
  struct Row {
    std::string name, text;
    GridLayout grid;
    std::function<double(double, double)> print;
    cv::Point3d middle;  // and the distance
    bool y_up = false;
  };
  const auto dots = [](double x, double y) {
    const double dx = x - std::round(x), dy = y - std::round(y);
    const bool on = x > -0.5 && y > -0.5 && x < 6.5 && y < 4.5;
    return on && dx * dx + dy * dy < 0.09 ? 0 : 1;
  };
  const std::vector<Row> rows = {
      {"chessboard 6 x 9",
       "{type: chessboard, rows: 6, columns: 9, square: 1}",
       {GridLayout::Kind::corners, 6, 9},
       [](double x, double y) { return chessboard(x, y, 6, 9); },
       {4, 2.5, 14}},
      {"charuco 6 x 8",
       "{type: charuco, rows: 6, columns: 8, square: 1, marker: 0.7, dictionary: DICT_5X5_250}",
       {GridLayout::Kind::charuco, 6, 8},
       [](double x, double y) { return charuco(x, y, 6, 8, 1); },
       {4, 3, 12}},
      {"circles 5 x 7",
       "{type: circles, rows: 5, columns: 7, spacing: 1}",
       {GridLayout::Kind::circles, 5, 7},
       dots,
       {3, 2, 10}},
      {"apriltag_grid 4 x 5",
       "{type: apriltag_grid, rows: 4, columns: 5, tag: 1, spacing: 0.3, family: tag36h11}",
       {GridLayout::Kind::tags, 4, 5, false, 0.3},
       [](double x, double y) { return tags(x, y, 4, 5); },
       {3.1, 2.45, 11},
       true}};
  std::printf(
      "| target, px between points | straight | blur 1 | 2 | 4 px | noise 2 | 5 | 15 | tilt 30 | "
      "50 | 65 deg |\n");
  std::printf("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  for (const Row& row : rows) {
    const ImageTarget target = target_of(row.text, row.grid);
    std::printf("| %s, %.0f |", row.name.c_str(), 600 / row.middle.z);
    for (const auto& [blur, noise, tilt] : std::vector<std::array<double, 3>>{{0.6, 0, 10},
                                                                              {1, 0, 10},
                                                                              {2, 0, 10},
                                                                              {4, 0, 10},
                                                                              {0.6, 2, 10},
                                                                              {0.6, 5, 10},
                                                                              {0.6, 15, 10},
                                                                              {0.6, 0, 30},
                                                                              {0.6, 0, 50},
                                                                              {0.6, 0, 65}}) {
      PictureCamera camera;
      camera.blur = blur;
      camera.noise = noise;
      camera.rotation = turned(0.1, tilt * CV_PI / 180, 0.1) * turned(row.y_up ? CV_PI : 0, 0, 0);
      aim(camera, row.middle.x, row.middle.y, row.middle.z);
      const Errors e = errors_of(camera, target, detect(render(camera, row.print), target));
      if (e.count == 0)
        std::printf(" not found |");
      else if (e.count < static_cast<int>(target.points.size()))
        std::printf(" %.3f (%d %%) |", e.rms,
                    static_cast<int>(100. * e.count / static_cast<double>(target.points.size())));
      else
        std::printf(" %.3f |", e.rms);
    }
    std::printf("\n");
  }
}

namespace {

/// CPU seconds of one call, in this thread.
double seconds(const std::function<void()>& work) {
  const std::clock_t start = std::clock();
  work();
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

}  // namespace

// Not run with the others: seconds beside bare OpenCV, in turns (benchmarks/detectors speed).
TEST_CASE("images: table of speed", "[.speed]") {
  cv::setNumThreads(1);
  struct Row {
    std::string name;
    ImageTarget target;
    std::function<double(double, double)> print;
    cv::Point3d middle;  // and the distance
    std::function<void(const cv::Mat&)> bare;
    bool y_up = false;
  };
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_250);
  const auto board = cv::aruco::CharucoBoard::create(8, 6, 1, 0.7f, dictionary);
  const auto april = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  const std::vector<Row> rows = {
      {"chessboard 6 x 9: findChessboardCornersSB, cornerSubPix",
       target_of("{type: chessboard, rows: 6, columns: 9, square: 1}",
                 {GridLayout::Kind::corners, 6, 9}),
       [](double x, double y) { return chessboard(x, y, 6, 9); },
       {4, 2.5, 14},
       [](const cv::Mat& image) {
         std::vector<cv::Point2f> found;
         cv::findChessboardCornersSB(image, {9, 6}, found, cv::CALIB_CB_NORMALIZE_IMAGE);
         cv::cornerSubPix(image, found, {10, 10}, {-1, -1}, {3, 60, 1e-4});
       }},
      {"charuco 6 x 8: detectMarkers, interpolateCornersCharuco",
       target_of("{type: charuco, rows: 6, columns: 8, square: 1, marker: 0.7, dictionary: "
                 "DICT_5X5_250}",
                 {GridLayout::Kind::charuco, 6, 8}),
       [](double x, double y) { return charuco(x, y, 6, 8, 1); },
       {4, 3, 12},
       [&](const cv::Mat& image) {
         std::vector<std::vector<cv::Point2f>> corners;
         std::vector<int> ids;
         cv::Mat found, numbers;
         cv::aruco::detectMarkers(image, dictionary, corners, ids);
         cv::aruco::interpolateCornersCharuco(corners, ids, image, board, found, numbers);
       }},
      {"circles 5 x 7: findCirclesGrid",
       target_of("{type: circles, rows: 5, columns: 7, spacing: 1}",
                 {GridLayout::Kind::circles, 5, 7}),
       [](double x, double y) {
         const double dx = x - std::round(x), dy = y - std::round(y);
         return x > -0.5 && y > -0.5 && x < 6.5 && y < 4.5 && dx * dx + dy * dy < 0.09 ? 0 : 1;
       },
       {3, 2, 10},
       [](const cv::Mat& image) {
         std::vector<cv::Point2f> found;
         cv::findCirclesGrid(image, {7, 5}, found);
       }},
      {"apriltag_grid 4 x 5: detectMarkers, refined by cornerSubPix",
       target_of("{type: apriltag_grid, rows: 4, columns: 5, tag: 1, spacing: 0.3, family: "
                 "tag36h11}",
                 {GridLayout::Kind::tags, 4, 5, false, 0.3}),
       [](double x, double y) { return tags(x, y, 4, 5); },
       {3.1, 2.45, 11},
       [&](const cv::Mat& image) {
         const auto parameters = cv::aruco::DetectorParameters::create();
         parameters->markerBorderBits = 2;
         parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
         std::vector<std::vector<cv::Point2f>> corners;
         std::vector<int> ids;
         cv::aruco::detectMarkers(image, april, corners, ids, parameters);
       },
       true}};
  std::printf(
      "\n| 640 x 480 | OpenCV, images a second | kincal | time |\n| --- | --- | --- | --- |\n");
  for (const Row& row : rows) {
    std::vector<double> bare, whole, ratio;
    const cv::Point3d m = row.middle;
    std::vector<PictureCamera> cameras = postures(m.x, m.y, m.z);
    if (row.y_up) cameras = upright(cameras, m.x, m.y, m.z);
    for (PictureCamera& camera : cameras) {
      camera.noise = 2;
      const cv::Mat image = render(camera, row.print);
      for (int i = 0; i < 8; ++i) {
        bare.push_back(seconds([&] { row.bare(image); }));
        whole.push_back(seconds([&] { CHECK(!detect(image, row.target).ids.empty()); }));
        ratio.push_back(whole.back() / bare.back());
      }
    }
    for (std::vector<double>* all : {&bare, &whole, &ratio}) std::sort(all->begin(), all->end());
    const size_t half = bare.size() / 2;
    std::printf("| %s | %.0f | %.0f | %.2f x |\n", row.name.c_str(), 1 / bare[half],
                1 / whole[half], ratio[half]);
    std::fflush(stdout);
  }
}

}  // namespace detect_test
