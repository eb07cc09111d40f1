// models/design: the test poses of ISO 9283.
//
// Workspaces made by hand: a ball, a box, a shell, a plate. Proves: the cube is the largest one to
// 3 % in a ball and a box, and within them; P1 is its centre, the others stand in one inclined
// plane through two of its edges, at 0.8 of the half diagonal; a hollow ball's cube stays out of
// the hollow; a plate has no cube. Does not prove: that a robot reaches a point
// (tests/program/verify_test.py).
#include "../../../models/design/test_poses.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/rig/random_stream.h"

namespace test_poses_test {

using namespace kincal;

namespace {

/// A workspace by whether a point is in it; readings are the point.
template <class Inside>
TestPoses poses_in(const Inside& inside) {
  const ReachPoint reach = [&](const Vector3d& point) -> std::optional<std::vector<double>> {
    if (!inside(point)) return std::nullopt;
    return std::vector<double>{point.x(), point.y(), point.z()};
  };
  RandomStream draws(5);
  std::vector<Vector3d> known;
  while (known.size() < 500) {
    const double x = draws.uniform(-2, 2), y = draws.uniform(-2, 2), z = draws.uniform(-2, 2);
    if (inside(Vector3d(x, y, z))) known.push_back({x, y, z});
  }
  return find_test_poses(known, reach);
}

void check_poses(const TestPoses& found) {
  REQUIRE(found.poses.size() == 5);
  const double half = 0.5 * std::sqrt(3.0) * found.edge;
  CHECK((found.poses[0].point - found.centre).norm() < 1e-12);
  Vector3d sum(0, 0, 0);
  for (int p = 0; p < 5; ++p) {
    const TestPose& pose = found.poses[static_cast<size_t>(p)];
    CHECK(pose.name == "P" + std::to_string(p + 1));
    CHECK(pose.readings == std::vector<double>{pose.point.x(), pose.point.y(), pose.point.z()});
    if (p > 0) CHECK((pose.point - found.centre).norm() == Approx(0.8 * half));
    sum += pose.point - found.centre;
  }
  CHECK(sum.norm() < 1e-12);
  // The sides round the plane: an edge of 0.8, a diagonal of a face, and so on; right angles.
  const Vector3d along = found.poses[2].point - found.poses[1].point,
                 up = found.poses[3].point - found.poses[2].point;
  CHECK(along.norm() == Approx(0.8 * found.edge));
  CHECK(up.norm() == Approx(0.8 * std::sqrt(2.0) * found.edge));
  CHECK(std::abs(along.dot(up)) < 1e-12);
  CHECK(std::abs(along.z()) < 1e-12);
  CHECK(up.z() == Approx(0.8 * found.edge));
}

}  // namespace

TEST_CASE("test poses: a ball") {
  const Vector3d centre(0.3, -0.2, 0.5);
  const TestPoses found = poses_in([&](const Vector3d& p) { return (p - centre).norm() <= 1; });
  check_poses(found);
  const double most = 2 / std::sqrt(3.0);
  CHECK(found.edge > 0.97 * most);
  CHECK(found.edge <= most);
}

TEST_CASE("test poses: a box") {
  const TestPoses found = poses_in([](const Vector3d& p) {
    return std::abs(p.x()) < 1.5 && std::abs(p.y()) < 1 && p.z() > 0 && p.z() < 0.9;
  });
  check_poses(found);
  CHECK(found.edge > 0.97 * 0.9);
  CHECK(found.edge < 0.9);
}

TEST_CASE("test poses: a hollow ball") {
  const TestPoses found =
      poses_in([](const Vector3d& p) { return p.norm() <= 1.5 && p.norm() > 0.4; });
  check_poses(found);
  CHECK(found.edge > 0.5);
  CHECK(found.centre.norm() > 0.4 + 0.5 * found.edge - 0.05);
}

TEST_CASE("test poses: a plate has no cube") {
  const TestPoses found =
      find_test_poses({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}},
                      [](const Vector3d& p) -> std::optional<std::vector<double>> {
                        if (std::abs(p.z()) > 1e-9) return std::nullopt;
                        return std::vector<double>{0};
                      });
  CHECK(found.edge == 0);
  CHECK(found.poses.empty());
  CHECK(find_test_poses({{1, 2, 3}}, [](const Vector3d&) { return std::vector<double>{0}; }).edge ==
        0);
}

}  // namespace test_poses_test
