// Random numbers that are the same on every platform: the standard fixes the engine, not its
// distributions.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>

#include "../kinematics/transform.h"

namespace kincal::benchmarks {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  double normal(double sigma) {
    const double u = 1 - uniform(), v = uniform();
    return sigma * std::sqrt(-2 * std::log(u)) * std::cos(6.283185307179586 * v);
  }
  Vector3d vector(double sigma) {
    const double x = normal(sigma), y = normal(sigma), z = normal(sigma);
    return {x, y, z};
  }
  /// A small motion: sigmas in m and rad.
  Pose motion(double translation, double rotation) {
    Vector6d xi;
    const Vector3d v = vector(translation), w = vector(rotation);
    xi << v, w;
    return exp_se3(xi);
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace kincal::benchmarks
