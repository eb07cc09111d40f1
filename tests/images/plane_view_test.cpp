// Proves that the view of a plane is fitted through a lens, of few points without one, and that
// what cannot be fitted says so.
#include "../../io/images/plane_view.h"

#include "../fixtures/render.h"
#include "catch2/catch.hpp"

namespace plane_view_test {

using namespace kincal;
using namespace fixtures;

TEST_CASE("images: the view of a plane is a homography and two radial numbers") {
  PictureCamera camera;
  camera.cx = 0.5 * (camera.width - 1), camera.cy = 0.5 * (camera.height - 1);
  camera.rotation = turned(0.4, -0.3, 0.7);
  aim(camera, 4, 3, 9);
  std::vector<cv::Point2d> plane, pixels;
  for (int y = 0; y < 7; ++y)
    for (int x = 0; x < 9; ++x) {
      plane.emplace_back(x, y);
      pixels.push_back(project(camera, x, y));
    }
  const cv::Size size(camera.width, camera.height);
  const PlaneView view = fit_plane_view(plane, pixels, size);
  CHECK(view.rms < 0.01);
  CHECK(cv::norm(view({4.3, 2.6}) - project(camera, 4.3, 2.6)) < 0.01);
  // In focal lengths the lens has -0.12, the numbers count from half the diagonal.
  CHECK(view.k1 == Approx(-0.12 * std::pow(view.radius / camera.f, 2)).epsilon(0.1));
  for (const size_t count : {4, 5, 8, 11}) {
    std::vector<cv::Point2d> some, seen;
    for (size_t i = 0; i < count; ++i) {
      some.push_back(plane[i * 37 % plane.size()]);
      seen.push_back(pixels[i * 37 % plane.size()]);
    }
    CHECK(fit_plane_view(some, seen, size).rms < 1);
  }
  pixels[30] += cv::Point2d(20, 0);
  CHECK(fit_plane_view(plane, pixels, size).worst > 15);
  const std::vector<cv::Point2d> line = {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {4, 4}};
  CHECK(fit_plane_view(line, line, size).rms == 1e9);
  CHECK(fit_plane_view({line.begin(), line.begin() + 3}, {line.begin(), line.begin() + 3}, size)
            .rms == 1e9);
}

}  // namespace plane_view_test
