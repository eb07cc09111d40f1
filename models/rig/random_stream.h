// Random numbers that are the same everywhere: std::mt19937_64, uniform numbers of 53 bits and
// Box-Muller, nothing that differs between standard libraries.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "../../kinematics/transform.h"
#include "numbers.h"

namespace kincal {

class RandomStream {
 public:
  explicit RandomStream(std::uint64_t seed) : engine_(seed) {}
  /// Starts one of many independent streams of a seed.
  RandomStream(std::uint64_t seed, std::uint64_t stream)
      : engine_(splitmix64(splitmix64(seed) + stream)) {}

  /// Returns 64 random bits.
  std::uint64_t bits() { return engine_(); }
  /// Returns a number that is uniform in [0, 1).
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// Returns a number from 0 to count - 1.
  int index(std::size_t count) {
    return std::min(static_cast<int>(uniform() * static_cast<double>(count)),
                    static_cast<int>(count) - 1);
  }
  /// Draws from N(0, 1).
  double normal() {
    const double u = 1 - uniform(), v = uniform();
    return std::sqrt(-2 * std::log(u)) * std::cos(2 * kPi * v);
  }
  Vector3d normals() {
    Vector3d v;
    for (int i = 0; i < 3; ++i) v(i) = normal();
    return v;
  }
  /// Draws a small motion whose translation and Log of the rotation are N(0, diag sigma^2); `sigma`
  /// has 6 numbers, m and rad.
  Pose error(const std::vector<double>& sigma) {
    const Eigen::Map<const Vector6d> s(sigma.data());
    Pose e;
    e.translation = s.head<3>().cwiseProduct(normals());
    e.rotation = exp_so3(s.tail<3>().cwiseProduct(normals()));
    return e;
  }
  /// Draws any rotation, uniformly.
  Matrix3d rotation() {
    Eigen::Vector4d q;
    for (int i = 0; i < 4; ++i) q(i) = normal();
    return rotation_from_quaternion(q);
  }

 private:
  /// Turns neighbouring seeds into unrelated ones (Steele, Lea, Flood 2014).
  static std::uint64_t splitmix64(std::uint64_t x) {
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
  }

  std::mt19937_64 engine_;
};

}  // namespace kincal
