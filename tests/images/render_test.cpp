// Proves of pictures of a simulation: the rays of a camera are those of its lens (by OpenCV's own
// projection, not ours); a pixel is the share of the ink in it; near sheets hide far ones, backs
// are grey; what is random is the same for the same seed. That prints are what the finders look for
// is in detect_test.cpp.
#include "../../io/images/render.h"

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "../../models/sensors/sensors.h"
#include "../fixtures/render.h"
#include "catch2/catch.hpp"

namespace render_test {

using namespace kincal;

namespace {

Rig rig_with_camera(Lens lens, const std::vector<double>& distortion, double baseline) {
  Rig rig;
  rig.tree.links = {"base"};
  Sensor camera;
  camera.name = "eye";
  camera.type = "camera";
  camera.link = 0;
  camera.model = make_camera(lens, static_cast<int>(distortion.size()));
  camera.parameters = camera_parameters(lens, {300, 310, 99.5, 82.25}, distortion, baseline);
  camera.sigma = {0.1};
  camera.image_width = 200;
  camera.image_height = 160;
  rig.sensors.push_back(camera);
  return rig;
}

/// Where OpenCV says that a camera sees the points.
std::vector<cv::Point2d> projected(Lens lens, const std::vector<double>& distortion,
                                   const std::vector<cv::Point3d>& points) {
  const cv::Matx33d k(300, 0, 99.5, 0, 310, 82.25, 0, 0, 1);
  const cv::Vec3d zero(0, 0, 0);
  std::vector<cv::Point2d> out;
  if (lens == Lens::kannala_brandt)
    cv::fisheye::projectPoints(points, out, zero, zero, k, distortion);
  else
    cv::projectPoints(points, zero, zero, k, distortion, out);
  return out;
}

/// A camera of square pixels without a lens, before a wall.
CameraRays plain_rays(int width, int height, double f) {
  CameraRays out;
  out.width = width;
  out.height = height;
  for (int row = 0; row <= height; ++row)
    for (int column = 0; column <= width; ++column)
      out.directions.emplace_back((column - 0.5 * width) / f, (row - 0.5 * height) / f, 1);
  return out;
}

Sheet sheet_at(const Print& print, double distance) {
  Sheet out;
  out.print = &print;
  out.camera_T_print.translation.z() = distance;
  return out;
}

const Look kPlain{0, 0, 0, "grey"};

}  // namespace

TEST_CASE("render: the rays of a camera are those of its lens") {
  struct Row {
    Lens lens;
    std::vector<double> distortion;
    double baseline = 0;
  };
  for (const Row& row :
       std::vector<Row>{{Lens::pinhole, {}},
                        {Lens::pinhole, {}, 0.12},
                        {Lens::brown_conrady, {-0.2, 0.05, 0.001, -0.002, 0.01}},
                        {Lens::brown_conrady, {0.2, 0.1, 0.001, -0.002, 0.01, 0.3, 0.02, 0.001}},
                        {Lens::kannala_brandt, {0.02, -0.01, 0.003, -0.001}}}) {
    const Rig rig = rig_with_camera(row.lens, row.distortion, row.baseline);
    const ParameterTable table(rig);
    const CameraRays rays = camera_rays(rig, table, table.initial, 0);
    CHECK(rays.eye == Vector3d(row.baseline, 0, 0));
    std::vector<cv::Point3d> points;
    for (const Vector3d& d : rays.directions) points.emplace_back(3 * d.x(), 3 * d.y(), 3 * d.z());
    const std::vector<cv::Point2d> pixels = projected(row.lens, row.distortion, points);
    double worst = 0;
    for (size_t i = 0; i < pixels.size(); ++i) {
      const cv::Point2d corner(static_cast<double>(i % 201) - 0.5,
                               static_cast<double>(i / 201) - 0.5);
      worst = std::max(worst, cv::norm(pixels[i] - corner));
    }
    CHECK(worst < 1e-4);
  }
}

TEST_CASE("render: a pixel is the share of the ink in it") {
  const CameraRays rays = plain_rays(20, 400, 100);
  for (const double edge : {0.0, 0.2, 0.37, 0.75}) {  // px right of the middle, along the pixels
    const Print print{[&](double x, double) { return x < edge / 100 ? 0. : 1.; },
                      cv::Rect2d(-9, -9, 18, 18)};
    const cv::Mat picture = take_picture(rays, {sheet_at(print, 1)}, kPlain, RandomStream(3));
    CHECK(cv::mean(picture.col(9))[0] == 30);
    // Few shares are possible, and each is rounded to whole grey levels.
    CHECK(cv::mean(picture.col(10))[0] == Approx(220 - 190 * edge).margin(0.5));
    CHECK(cv::mean(picture.col(11))[0] == 220);
  }
}

TEST_CASE("render: what is near hides what is far, and backs are grey") {
  const CameraRays rays = plain_rays(40, 40, 20);
  const Print white{[](double, double) { return 1.; }, cv::Rect2d(-1, -1, 2, 2)};
  const Print black{[](double, double) { return 0.; }, cv::Rect2d(-0.1, -0.1, 0.2, 0.2)};
  for (const bool first : {true, false}) {
    std::vector<Sheet> sheets = {sheet_at(white, 2), sheet_at(black, 1)};
    if (first) std::swap(sheets[0], sheets[1]);
    const cv::Mat picture = take_picture(rays, sheets, kPlain, RandomStream(3));
    CHECK(picture.at<uchar>(20, 20) == 30);
    CHECK(picture.at<uchar>(20, 25) == 220);
    CHECK(picture.at<uchar>(2, 2) == cv::saturate_cast<uchar>(30 + 190 * 0.45));
  }
  Sheet behind = sheet_at(white, -1);
  CHECK(take_picture(rays, {behind}, kPlain, RandomStream(3)).at<uchar>(20, 20) == 116);
  Sheet turned = sheet_at(white, 1);
  turned.y_up = true;
  CHECK(take_picture(rays, {turned}, kPlain, RandomStream(3)).at<uchar>(20, 20) == 125);
}

TEST_CASE("render: corners get darker, noise is as asked for and the same for the same seed") {
  const CameraRays rays = plain_rays(200, 200, 100);
  const Print white{[](double, double) { return 0.5; }, cv::Rect2d(-9, -9, 18, 18)};
  const Look dark{0, 0, 0.3, "grey"}, noisy{0, 5, 0, "grey"};
  const cv::Mat light = take_picture(rays, {sheet_at(white, 1)}, dark, RandomStream(3));
  CHECK(light.at<uchar>(100, 100) == 125);
  CHECK(light.at<uchar>(0, 0) == Approx(125 * 0.7).margin(1));
  const cv::Mat one = take_picture(rays, {sheet_at(white, 1)}, noisy, RandomStream(3));
  cv::Scalar mean, sigma;
  cv::meanStdDev(one, mean, sigma);
  CHECK(mean[0] == Approx(125).margin(0.2));
  CHECK(sigma[0] == Approx(5).epsilon(0.03));
  CHECK(cv::norm(one, take_picture(rays, {sheet_at(white, 1)}, noisy, RandomStream(3)),
                 cv::NORM_INF) == 0);
  CHECK(cv::norm(one, take_picture(rays, {sheet_at(white, 1)}, noisy, RandomStream(4)),
                 cv::NORM_INF) > 0);
}

}  // namespace render_test
