#include "test_poses.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kincal {
namespace {

constexpr int kLattice = 13;             // points along the longest side
constexpr double kLeastStep = 1.0 / 16;  // of a step of the lattice
constexpr double kPlaneShare = 0.4;      // of the edge: 0.8 of half of it

struct Cube {
  Vector3d centre{0, 0, 0};
  double edge = 0;
};

bool inside(const Cube& cube, const ReachPoint& reach) {
  // Corners first: they are missed most.
  for (const int ones : {3, 2, 1, 0})
    for (int i = -1; i <= 1; ++i)
      for (int j = -1; j <= 1; ++j)
        for (int k = -1; k <= 1; ++k)
          if (i * i + j * j + k * k == ones &&
              !reach(cube.centre + 0.5 * cube.edge * Vector3d(i, j, k)))
            return false;
  return true;
}

/// The largest cube of lattice points that are all reached, by the edges of the cubes that end at
/// each point.
Cube largest_of_lattice(const Vector3d& low, const Vector3d& size, double step,
                        const ReachPoint& reach) {
  std::array<int, 3> count;
  for (int k = 0; k < 3; ++k) count[k] = static_cast<int>(std::lround(size(k) / step)) + 1;
  std::vector<int> edges(static_cast<size_t>(count[0] * count[1] * count[2]), 0);
  const auto edge_at = [&](int x, int y, int z) -> int& {
    return edges[(static_cast<size_t>(x) * count[1] + y) * count[2] + z];
  };
  int most = 0;
  Cube out;
  for (int x = 0; x < count[0]; ++x)
    for (int y = 0; y < count[1]; ++y)
      for (int z = 0; z < count[2]; ++z) {
        const Vector3d point = low + step * Vector3d(x, y, z);
        if (!reach(point)) continue;
        int edge = x && y && z ? kLattice : 0;  // in points before this one
        for (int n = 1; n < 8 && edge > 0; ++n)
          edge = std::min(edge, edge_at(x - (n & 1), y - (n >> 1 & 1), z - (n >> 2)));
        edge_at(x, y, z) = edge + 1;
        if (edge < most || edge == 0) continue;
        most = edge;
        out.edge = step * edge;
        out.centre = point - 0.5 * out.edge * Vector3d::Ones();
      }
  return out;
}

/// Grows a cube by a quarter of a step, each time towards the first of 27 places in which it can.
Cube grown(Cube cube, double step, const ReachPoint& reach) {
  const double least = kLeastStep * step;
  while (step >= least) {
    bool grew = false;
    for (int n = 0; n < 27 && !grew; ++n) {
      const Cube next{
          cube.centre + step * Eigen::Vector3i(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1).cast<double>(),
          cube.edge + 0.25 * step};
      grew = inside(next, reach);
      if (grew) cube = next;
    }
    if (!grew) step *= 0.5;
  }
  return cube;
}

/// The five poses on one of the four planes that are inclined about a horizontal edge.
std::vector<TestPose> poses_on(const Cube& cube, int plane, const ReachPoint& reach) {
  std::vector<TestPose> out;
  for (int p = 0; p < 5; ++p) {
    Vector3d corner(0, 0, 0);
    if (p > 0) {
      // Round the plane: low, low, high, high; along its horizontal edge there and back.
      const double high = p > 2 ? 1 : -1, along = p == 2 || p == 3 ? 1 : -1,
                   across = plane & 1 ? high : -high;
      corner = plane & 2 ? Vector3d(along, across, high) : Vector3d(across, along, high);
    }
    const Vector3d point = cube.centre + kPlaneShare * cube.edge * corner;
    const std::optional<std::vector<double>> readings = reach(point);
    if (!readings) return {};
    out.push_back({"P" + std::to_string(p + 1), point, *readings});
  }
  return out;
}

}  // namespace

TestPoses find_test_poses(const std::vector<Vector3d>& known, const ReachPoint& reach) {
  Vector3d low = known[0], high = known[0];
  for (const Vector3d& point : known) {
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  TestPoses out;
  const double step = (high - low).maxCoeff() / (kLattice - 1);
  if (!(step > 0)) return out;
  Cube cube = largest_of_lattice(low, high - low, step, reach);
  if (!(cube.edge > 0)) return out;
  cube = grown(cube, step, reach);
  out.centre = cube.centre;
  out.edge = cube.edge;
  for (int plane = 0; plane < 4 && out.poses.empty(); ++plane)
    out.poses = poses_on(cube, plane, reach);
  return out;
}

}  // namespace kincal
