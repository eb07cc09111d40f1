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

/// Writes a row of L to columns `ld` apart: a' (v + w x p) = [a | p x a]' [v | w].
inline void store_twist(double* l, std::ptrdiff_t ld, const Pack* p, const Pack* a) {
  for (int j = 0; j < 3; ++j) store(l + j * ld, a[j]);
  store(l + 3 * ld, p[1] * a[2] - p[2] * a[1]);
  store(l + 4 * ld, p[2] * a[0] - p[0] * a[2]);
  store(l + 5 * ld, p[0] * a[1] - p[1] * a[0]);
}

/// m p, of a 3 x 3 matrix row by row.
inline void turn(const double* m, const Pack* p, Pack* out) {
  for (int k = 0; k < 3; ++k) out[k] = m[3 * k] * p[0] + m[3 * k + 1] * p[1] + m[3 * k + 2] * p[2];
}

/// The points that begin at i, in the target's frame.
inline void load_points(const PointView& v, int i, Pack* p) {
  for (int k = 0; k < 3; ++k) p[k] = load(v.points + k * v.stride + i) * v.scale;
}

template <class Sensor, bool Derivatives>
bool run(const PointView& v, const PointRows& to, double& squares) {
  constexpr int rows = Sensor::kRows, own = Sensor::kOwn;
  const double* t = v.translation;
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
    Pack point[3], turned[3];
    load_points(v, i, point);
    turn(v.rotation, point, turned);
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
      const Pack a[3] = {weight * d_p[3 * k], weight * d_p[3 * k + 1], weight * d_p[3 * k + 2]};
      store_twist(to.l + row, to.ld, p, a);
      for (int j = 0; j < own; ++j)
        if (to.own[j] >= 0) store(to.l + to.own[j] * to.ld + row, weight * d_own[k * own + j]);
      if (to.square >= 0)
        store(to.l + to.square * to.ld + row,
              (a[0] * turned[0] + a[1] * turned[1] + a[2] * turned[2]) / v.scale);
    }
  }
  squares = sum(total);
  return Sensor::defined(lowest) && squares == squares;  // not a number: not defined
}

template <class Sensor>
bool view(const PointView& v, const PointRows& to, double& squares) {
  return to.l ? run<Sensor, true>(v, to, squares) : run<Sensor, false>(v, to, squares);
}

/// The tilting laser; its formulas stand at the head of tilting_laser.h.
template <bool Derivatives>
bool run_scan(const PointView& v, const PointRows& to, double& squares) {
  const ScanView& scan = *v.scan;
  const double *side = scan.rotation, *a = scan.axis;
  const int stride = v.stride;
  Pack total = {};
  for (int i = 0; i < stride; i += kLanes) {
    Pack point[3], turned[3], p[3];
    load_points(v, i, point);
    turn(v.rotation, point, turned);
    const Pack behind[3] = {turned[0] + v.translation[0], turned[1] + v.translation[1],
                            turned[2] + v.translation[2]};
    const Pack cosine = load(scan.turns + i), sine = load(scan.turns + stride + i),
               slid = load(scan.turns + 2 * stride + i), versine = 1 - cosine;
    const Pack s[3] = {sine * a[0], sine * a[1], sine * a[2]};
    const Pack motion[9] = {versine * (a[0] * a[0]) + cosine, versine * (a[0] * a[1]) - s[2],
                            versine * (a[0] * a[2]) + s[1],   versine * (a[1] * a[0]) + s[2],
                            versine * (a[1] * a[1]) + cosine, versine * (a[1] * a[2]) - s[0],
                            versine * (a[2] * a[0]) - s[1],   versine * (a[2] * a[1]) + s[0],
                            versine * (a[2] * a[2]) + cosine};
    Pack at_joint[3], e[3];
    for (int k = 0; k < 3; ++k)
      at_joint[k] = motion[3 * k] * behind[0] + motion[3 * k + 1] * behind[1] +
                    motion[3 * k + 2] * behind[2] + slid * a[k];
    turn(side, at_joint, p);
    for (int k = 0; k < 3; ++k) {
      p[k] += scan.translation[k];
      e[k] = p[k] - load(v.measured + k * stride + i);
    }
    // What moves with the joint's position, before the turn to the sensor's frame.
    const Pack along[3] = {a[0] + Pack{}, a[1] + Pack{}, a[2] + Pack{}};
    const Pack around[3] = {a[1] * at_joint[2] - a[2] * at_joint[1],
                            a[2] * at_joint[0] - a[0] * at_joint[2],
                            a[0] * at_joint[1] - a[1] * at_joint[0]};
    const Pack* by_position = scan.prismatic ? along : around;
    for (int k = 0; k < 3; ++k) {
      const int row = k * stride + i;
      Pack w[3], at[3], b[3];  // the root's row, times the side's rotation, times the motion
      for (int j = 0; j < 3; ++j) w[j] = load(scan.roots + (3 * k + j) * stride + i);
      const Pack white = w[0] * e[0] + w[1] * e[1] + w[2] * e[2];
      total += white * white;
      store(to.r + row, white);
      if (!Derivatives) continue;
      for (int j = 0; j < 3; ++j) at[j] = w[0] * side[j] + w[1] * side[3 + j] + w[2] * side[6 + j];
      for (int j = 0; j < 3; ++j)
        b[j] = at[0] * motion[j] + at[1] * motion[3 + j] + at[2] * motion[6 + j];
      store_twist(to.l + row, to.ld, behind, b);
      if (to.square >= 0)
        store(to.l + to.square * to.ld + row,
              (b[0] * turned[0] + b[1] * turned[1] + b[2] * turned[2]) / v.scale);
      if (to.sensor_side < 0) continue;
      store_twist(to.l + to.sensor_side * to.ld + row, to.ld, p, w);
      const Pack by = at[0] * by_position[0] + at[1] * by_position[1] + at[2] * by_position[2];
      for (int n = 0; n < scan.numbers; ++n)
        store(to.l + (to.joint + n) * to.ld + row, by * load(scan.by_own + n * stride + i));
    }
  }
  squares = sum(total);
  return squares == squares;
}

bool scan_view(const PointView& v, const PointRows& to, double& squares) {
  return to.l ? run_scan<true>(v, to, squares) : run_scan<false>(v, to, squares);
}

}  // namespace

extern const ViewKernels kViewKernels;
const ViewKernels kViewKernels = {view<Camera<0>>, view<Camera<5>>, view<Camera<8>>, view<Point>,
                                  scan_view};

}  // namespace KINCAL_ISA
}  // namespace kincal
