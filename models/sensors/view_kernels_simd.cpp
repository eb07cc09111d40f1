// Compiled once for each instruction set; see solver/simd.h and view_kernels.h.
#include "../../solver/simd.h"
#include "brown_conrady.h"
#include "view_kernels.h"

namespace kincal {
namespace KINCAL_ISA {
namespace {

/// What a camera sees: kRows residuals of the point p in its frame; `defined`: lowest number that
/// must be above 0.
template <int N>
struct Camera {
  static constexpr int kRows = 2, kOwn = 5 + N;
  template <bool Derivatives>
  static void predict(const double* parameters, const Pack* p, Pack* z, Pack* d_p, Pack* d_own) {
    brown_conrady<N>(parameters, Pack(p[0] - parameters[4 + N]), p[1], p[2], z,
                     Derivatives ? d_p : nullptr, Derivatives ? d_own : nullptr);
  }
  static bool defined(Pack p_z) {
    for (int i = 0; i < kLanes; ++i)
      if (!(p_z[i] > 1e-9)) return false;
    return true;
  }
};

struct Point {
  static constexpr int kRows = 3, kOwn = 0;
  template <bool Derivatives>
  static void predict(const double*, const Pack* p, Pack* z, Pack* d_p, Pack*) {
    for (int k = 0; k < 3; ++k) z[k] = p[k];
    if (Derivatives)
      for (int k = 0; k < 9; ++k) d_p[k] = all(k % 4 == 0 ? 1 : 0);
  }
  static bool defined(Pack) { return true; }
};

template <class Sensor, bool Derivatives>
bool run(const PointView& v, const PointRows& to, double& squares) {
  constexpr int rows = Sensor::kRows, own = Sensor::kOwn;
  const double *r = v.rotation, *t = v.translation;
  const int stride = v.stride;
  Pack total = {};
  Pack lowest = all(1);
  for (int i = 0; i < stride; i += kLanes) {
    const int left = v.count - i;  // points in this pack and behind it
    if (left <= 0) {
      for (int k = 0; k < rows; ++k) {
        store(to.r + k * stride + i, Pack{});
        if (!Derivatives) continue;
        for (int c = 0; c < 6; ++c) store(to.l + c * to.ld + k * stride + i, Pack{});
        for (int c = 0; c < own; ++c)
          if (to.own[c] >= 0) store(to.l + to.own[c] * to.ld + k * stride + i, Pack{});
        if (to.square >= 0) store(to.l + to.square * to.ld + k * stride + i, Pack{});
      }
      continue;
    }
    Pack mask = all(1);
    if (left < kLanes)
      for (int lane = left; lane < kLanes; ++lane) mask[lane] = 0;
    const Pack x = load(v.points + i) * v.scale, y = load(v.points + stride + i) * v.scale,
               z = load(v.points + 2 * stride + i) * v.scale;
    const Pack turned[3] = {r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z,
                            r[6] * x + r[7] * y + r[8] * z};
    const Pack p[3] = {turned[0] + t[0], turned[1] + t[1], turned[2] + t[2]};
    lowest = p[2] < lowest ? p[2] : lowest;
    Pack predicted[rows], d_p[3 * rows], d_own[rows * own + 1];
    Sensor::template predict<Derivatives>(v.parameters, p, predicted, d_p, d_own);
    for (int k = 0; k < rows; ++k) {
      const Pack weight = mask * v.weight[k];
      const Pack e = weight * (predicted[k] - load(v.measured + k * stride + i));
      total += e * e;
      const int row = k * stride + i;
      store(to.r + row, e);
      if (!Derivatives) continue;
      const Pack a = weight * d_p[3 * k], b = weight * d_p[3 * k + 1], c = weight * d_p[3 * k + 2];
      store(to.l + row, a);
      store(to.l + to.ld + row, b);
      store(to.l + 2 * to.ld + row, c);
      store(to.l + 3 * to.ld + row, p[1] * c - p[2] * b);  // a' (v + w x p) = [a | p x a]' [v | w]
      store(to.l + 4 * to.ld + row, p[2] * a - p[0] * c);
      store(to.l + 5 * to.ld + row, p[0] * b - p[1] * a);
      for (int j = 0; j < own; ++j)
        if (to.own[j] >= 0) store(to.l + to.own[j] * to.ld + row, weight * d_own[k * own + j]);
      if (to.square >= 0)
        store(to.l + to.square * to.ld + row,
              (a * turned[0] + b * turned[1] + c * turned[2]) / v.scale);
    }
  }
  squares = sum(total);
  return Sensor::defined(lowest) && squares == squares;  // not a number: not defined
}

template <class Sensor>
bool view(const PointView& v, const PointRows& to, double& squares) {
  return to.l ? run<Sensor, true>(v, to, squares) : run<Sensor, false>(v, to, squares);
}

}  // namespace

extern const ViewKernels kViewKernels;
const ViewKernels kViewKernels = {view<Camera<0>>, view<Camera<5>>, view<Camera<8>>, view<Point>};

}  // namespace KINCAL_ISA
}  // namespace kincal
