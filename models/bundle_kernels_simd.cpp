// Compiled once for each instruction set; see solver/simd.h and bundle_kernels.h.
#include "../solver/simd.h"
#include "bundle_kernels.h"

namespace kincal {
namespace KINCAL_ISA {
namespace {

// With p = R X + t, q = -p.xy / p.z, s = |q|^2, d = 1 + k1 s + k2 s^2, pixel = f d q:
//   d pixel / d q = f (d 1 + 2 (k1 + 2 k2 s) q q'),   d q / d p = -1/p.z [1 | q],   d p / d X = R,  d p / d t = 1,
//   d p / d w = -[R X]x  for the increment R <- exp(w) R.
bool observe(const Observations& o, int first, int last, double* rows, double& squares) {
  Pack total = {};
  bool defined = true;
  for (int i = first; i < last; i += kLanes) {
    const int n = last - i < kLanes ? last - i : kLanes;
    double in[kCameraNumbers + 5][kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      const int at = i + (lane < n ? lane : n - 1);
      const double *c = o.cameras + static_cast<std::ptrdiff_t>(o.camera_of[at]) * kCameraNumbers,
                   *x = o.points + static_cast<std::ptrdiff_t>(o.point_of[at]) * 3;
      for (int k = 0; k < kCameraNumbers; ++k) in[k][lane] = c[k];
      for (int k = 0; k < 3; ++k) in[kCameraNumbers + k][lane] = x[k];
      in[kCameraNumbers + 3][lane] = o.u[at];
      in[kCameraNumbers + 4][lane] = o.v[at];
    }
    Pack c[kCameraNumbers + 5];
    for (int k = 0; k < kCameraNumbers + 5; ++k) c[k] = load(in[k]);
    const Pack *x = c + kCameraNumbers, *t = c + 9;
    const Pack f = c[12], k1 = c[13], k2 = c[14];
    const Pack tx = c[0] * x[0] + c[1] * x[1] + c[2] * x[2], ty = c[3] * x[0] + c[4] * x[1] + c[5] * x[2],
               tz = c[6] * x[0] + c[7] * x[1] + c[8] * x[2];
    const Pack depth = tz + t[2], w = -1.0 / depth;
    const Pack qx = (tx + t[0]) * w, qy = (ty + t[1]) * w, s = qx * qx + qy * qy;
    const Pack d = 1.0 + s * (k1 + s * k2);
    Pack ru = f * d * qx - x[3], rv = f * d * qy - x[4];
    if (n < kLanes)
      for (int lane = n; lane < kLanes; ++lane) ru[lane] = rv[lane] = 0;
    total += ru * ru + rv * rv;
    for (int lane = 0; lane < n; ++lane) defined = defined && depth[lane] != 0;
    if (!rows) continue;
    const Pack slope = 2.0 * (k1 + 2.0 * k2 * s);
    const Pack uu = f * (d + slope * qx * qx), uv = f * slope * qx * qy, vv = f * (d + slope * qy * qy);
    // By p: (w, 0, w qx), (0, w, w qy).
    const Pack ux = uu * w, uy = uv * w, uz = ux * qx + uy * qy, vx = uy, vy = vv * w, vz = vx * qx + vy * qy;
    Pack out[26] = {
        ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux, ux, uy, uz, d * qx, f * s * qx, f * s * s * qx,
        ty * vz - tz * vy, tz * vx - tx * vz, tx * vy - ty * vx, vx, vy, vz, d * qy, f * s * qy, f * s * s * qy,
        ux * c[0] + uy * c[3] + uz * c[6], ux * c[1] + uy * c[4] + uz * c[7], ux * c[2] + uy * c[5] + uz * c[8],
        vx * c[0] + vy * c[3] + vz * c[6], vx * c[1] + vy * c[4] + vz * c[7], vx * c[2] + vy * c[5] + vz * c[8], ru, rv};
    double turned[26][kLanes];
    for (int k = 0; k < 26; ++k) store(turned[k], out[k]);
    for (int lane = 0; lane < n; ++lane) {
      double* row = rows + static_cast<std::ptrdiff_t>(i - first + lane) * kObservationNumbers;
      for (int k = 0; k < 9; ++k) row[k] = turned[k][lane];
      for (int k = 0; k < 9; ++k) row[16 + k] = turned[9 + k][lane];
      for (int k = 0; k < 8; ++k) row[32 + k] = turned[18 + k][lane];
    }
  }
  squares += sum(total);
  return defined && squares == squares;
}

void add_point(const double* observations, int count, const int* camera, const int* column, double* rows, int stride, int size,
               double* shared, const std::ptrdiff_t* origin, double* gradient) {
  double p[9] = {};
  for (int k = 0; k < count; ++k) {
    const double* u = observations + static_cast<std::ptrdiff_t>(k) * kObservationNumbers;
    const double *v = u + 16, *x = u + 32, *y = u + 35;
    const double ru = u[38], rv = u[39];
    constexpr int packs = (9 + kLanes - 1) / kLanes;
    Pack up[packs], vp[packs];
    for (int i = 0; i < packs; ++i) up[i] = load(u + i * kLanes), vp[i] = load(v + i * kLanes);
    for (int a = 0; a < 3; ++a) {
      for (int b = a; b < 3; ++b) p[3 * a + b] += x[a] * x[b] + y[a] * y[b];
      double* row = rows + static_cast<std::ptrdiff_t>(a) * stride;
      row[size] += x[a] * ru + y[a] * rv;
      double* q = row + column[k];
      for (int i = 0; i < packs; ++i) store(q + i * kLanes, load(q + i * kLanes) + up[i] * x[a] + vp[i] * y[a]);
    }
    if (!shared) continue;
    const int first = 9 * camera[k];
    for (int j = 0; j < 9; ++j) {
      double* c = shared + origin[first + j] + first;
      for (int i = j; i < 9; i += kLanes) store(c + i, load(c + i) + load(u + i) * u[j] + load(v + i) * v[j]);
    }
    double* b = gradient + first;
    for (int i = 0; i + kLanes <= 9; i += kLanes) store(b + i, load(b + i) + load(u + i) * ru + load(v + i) * rv);
    b[8] += u[8] * ru + v[8] * rv;
  }
  for (int a = 0; a < 3; ++a)
    for (int b = a; b < 3; ++b) rows[static_cast<std::ptrdiff_t>(a) * stride + b] += p[3 * a + b];
}

}  // namespace

extern const BundleKernels kBundleKernels;
const BundleKernels kBundleKernels = {observe, add_point};

}  // namespace KINCAL_ISA
}  // namespace kincal
