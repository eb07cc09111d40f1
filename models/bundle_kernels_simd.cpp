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
  for (int i = first; i < last; i += kLanes) {
    const int n = last - i < kLanes ? last - i : kLanes;
    Pack c[kCameraNumbers], x[kLanes > kPointNumbers ? kLanes : kPointNumbers];
    const double *camera[kLanes], *point[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      const int at = i + (lane < n ? lane : n - 1);
      camera[lane] = o.cameras + static_cast<std::ptrdiff_t>(o.camera_of[at]) * kCameraNumbers;
      point[lane] = o.points + static_cast<std::ptrdiff_t>(o.point_of[at]) * kPointNumbers;
    }
    for (int k = 0; k < kCameraNumbers; k += kLanes) {
      for (int lane = 0; lane < kLanes; ++lane) c[k + lane] = load(camera[lane] + k);
      transpose(c + k);
    }
    for (int k = 0; k < kPointNumbers; k += kLanes) {  // the last point has slack behind it
      for (int lane = 0; lane < kLanes; ++lane) x[k + lane] = load(point[lane] + k);
      transpose(x + k);
    }
    const Pack* t = c + 9;
    const Pack f = c[12], k1 = c[13], k2 = c[14];
    const Pack tx = c[0] * x[0] + c[1] * x[1] + c[2] * x[2], ty = c[3] * x[0] + c[4] * x[1] + c[5] * x[2],
               tz = c[6] * x[0] + c[7] * x[1] + c[8] * x[2];
    const Pack depth = tz + t[2], w = -1.0 / depth;
    const Pack qx = (tx + t[0]) * w, qy = (ty + t[1]) * w, s = qx * qx + qy * qy;
    const Pack d = 1.0 + s * (k1 + s * k2);
    Pack ru = f * d * qx - load(o.u + i), rv = f * d * qy - load(o.v + i);
    if (n < kLanes)
      for (int lane = n; lane < kLanes; ++lane) ru[lane] = rv[lane] = 0;
    total += ru * ru + rv * rv;
    if (!rows) continue;
    const Pack slope = 2.0 * (k1 + 2.0 * k2 * s);
    const Pack uu = f * (d + slope * qx * qx), uv = f * slope * qx * qy, vv = f * (d + slope * qy * qy);
    // By p: (w, 0, w qx), (0, w, w qy).
    const Pack ux = uu * w, uy = uv * w, uz = ux * qx + uy * qy, vx = uy, vy = vv * w, vz = vx * qx + vy * qy;
    const Pack fs = f * s, none = {};
    Pack out[kObservationNumbers] = {
        ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux, ux, uy, uz, d * qx, fs * qx,
        ty * vz - tz * vy, tz * vx - tx * vz, tx * vy - ty * vx, vx, vy, vz, d * qy, fs * qy,
        ux * c[0] + uy * c[3] + uz * c[6], ux * c[1] + uy * c[4] + uz * c[7], ux * c[2] + uy * c[5] + uz * c[8],
        vx * c[0] + vy * c[3] + vz * c[6], vx * c[1] + vy * c[4] + vz * c[7], vx * c[2] + vy * c[5] + vz * c[8], ru, rv,
        fs * s * qx, fs * s * qy, none, none, none, none, none, none};
    double* to = rows + static_cast<std::ptrdiff_t>(i - first) * kObservationNumbers;
    for (int k = 0; k < kObservationNumbers; k += kLanes) {
      transpose(out + k);
      for (int lane = 0; lane < kLanes; ++lane) store(to + lane * kObservationNumbers + k, out[k + lane]);
    }
  }
  squares += sum(total);
  return squares - squares == 0;  // a point in the plane of a camera's centre is infinitely far away
}

constexpr int kEight = 8 / kLanes;

void add_point(const double* observations, int count, const int* camera, const int* column, double* rows, int stride, int size,
               double* shared, const std::ptrdiff_t* origin, double* gradient) {
  double p[9] = {}, a[3] = {};
  for (int k = 0; k < count; ++k) {
    const double* u = observations + static_cast<std::ptrdiff_t>(k) * kObservationNumbers;
    const double *v = u + 8, *x = u + 16, *y = u + 19;
    const double ru = u[22], rv = u[23], u8 = u[24], v8 = u[25];
    Pack up[kEight], vp[kEight];
    for (int i = 0; i < kEight; ++i) up[i] = load(u + i * kLanes), vp[i] = load(v + i * kLanes);
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) p[3 * i + j] += x[i] * x[j] + y[i] * y[j];
      a[i] += x[i] * ru + y[i] * rv;
      double* q = rows + static_cast<std::ptrdiff_t>(i) * stride + column[k];
      for (int e = 0; e < kEight; ++e) store(q + e * kLanes, up[e] * x[i] + vp[e] * y[i]);
      q[8] = u8 * x[i] + v8 * y[i];
    }
    const int first = 9 * camera[k];
    for (int j = 0; j < 8; ++j) {  // of the upper triangle, which is scratch, too
      double* c = shared + origin[first + j] + first;
      for (int e = 0; e < kEight; ++e) store(c + e * kLanes, load(c + e * kLanes) + up[e] * u[j] + vp[e] * v[j]);
      c[8] += u8 * u[j] + v8 * v[j];
    }
    shared[origin[first + 8] + first + 8] += u8 * u8 + v8 * v8;
    double* b = gradient + first;
    for (int e = 0; e < kEight; ++e) store(b + e * kLanes, load(b + e * kLanes) + up[e] * ru + vp[e] * rv);
    b[8] += u8 * ru + v8 * rv;
  }
  for (int i = 0; i < 3; ++i) {
    double* row = rows + static_cast<std::ptrdiff_t>(i) * stride;
    for (int j = i; j < 3; ++j) row[j] = p[3 * i + j];
    row[size] = a[i];
  }
}

void condense_point(const double* observations, int count, const int* camera, const double* shared_step, double* rows) {
  for (int k = 0; k < count; ++k) {
    const double* u = observations + static_cast<std::ptrdiff_t>(k) * kObservationNumbers;
    const double *v = u + 8, *x = u + 16, *y = u + 19, *d = shared_step + 9 * camera[k];
    const double ru = u[22], rv = u[23];
    Pack su = {}, sv = {};
    for (int e = 0; e < kEight; ++e) {
      const Pack step = load(d + e * kLanes);
      su += load(u + e * kLanes) * step;
      sv += load(v + e * kLanes) * step;
    }
    const double u_moved = ru + sum(su) + u[24] * d[8], v_moved = rv + sum(sv) + u[25] * d[8];
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) rows[5 * i + j] += x[i] * x[j] + y[i] * y[j];
      rows[5 * i + 3] += x[i] * ru + y[i] * rv;
      rows[5 * i + 4] += x[i] * u_moved + y[i] * v_moved;
    }
  }
}

}  // namespace

extern const BundleKernels kBundleKernels;
const BundleKernels kBundleKernels = {observe, add_point, condense_point};

}  // namespace KINCAL_ISA
}  // namespace kincal
