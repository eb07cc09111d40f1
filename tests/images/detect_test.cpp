// Proves that targets are found where they are: pictures of prints, made by rays through a lens,
// and the pixels that the detectors return beside the true ones; bias and scatter of each detector.
// Not proved: real light, dirt, rolling shutters.
#include "../../io/images/detect.h"

#include <cmath>

#include "../../io/document/yaml.h"
#include "../../models/rig/targets.h"
#include "../fixtures/render.h"
#include "catch2/catch.hpp"

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
                  const std::function<double(double, double)>& print, double rms) {
  cv::Point2d bias;
  for (const PictureCamera& camera : cameras) {
    const Detection found = detect(render(camera, print), target);
    const Errors e = errors_of(camera, target, found);
    CAPTURE(found.reason, e.bias.x, e.bias.y, e.rms, e.worst, found.rms, found.blur);
    CHECK(e.count == static_cast<int>(target.points.size()));
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

}  // namespace

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
