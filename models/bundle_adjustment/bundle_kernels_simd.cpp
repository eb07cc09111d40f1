// Compiled once for each instruction set; see solver/simd.h and bundle_kernels.h.
#include "../../solver/simd.h"
#include "bundle_kernels.h"

namespace kincal {
namespace KINCAL_ISA {
namespace {

// With p = R X + t, q = -p.xy / p.z, s = |q|^2, d = 1 + k1 s + k2 s^2, pixel = f d q:
//   d pixel / d q = f (d 1 + 2 (k1 + 2 k2 s) q q'),   d q / d p = -1/p.z [1 | q],   d p / d X = R,
//   d p / d t = 1, d p / d w = -[R X]x  for the increment R <- exp(w) R.
struct Seen {
  Pack ru, rv;        // residuals
  Pack u[12], v[12];  // derivatives by the camera's 9 and the point's 3 numbers
};

inline void numbers_of(const double* array, const int* index, int numbers, int first, int last,
                       Pack* out) {
  for (int k = 0; k < numbers; k += kLanes) {
    for (int lane = 0; lane < kLanes; ++lane)
      out[k + lane] =
          load(array +
               static_cast<std::ptrdiff_t>(index[first + lane < last ? first + lane : last - 1]) *
                   numbers +
               k);
    transpose(out + k);
  }
}

/// kLanes observations from `first` on; those behind `last` - 1 repeat it.
template <bool Derivatives>
inline void see(const Observations& o, int first, int last, Seen& seen) {
  Pack c[kCameraNumbers], x[kLanes > kPointNumbers ? kLanes : kPointNumbers];
  numbers_of(o.cameras, o.camera_of, kCameraNumbers, first, last, c);
  numbers_of(o.points, o.point_of, kPointNumbers, first, last,
             x);  // the last point has slack behind it
  const Pack* t = c + 9;
  const Pack f = c[12], k1 = c[13], k2 = c[14];
  const Pack tx = c[0] * x[0] + c[1] * x[1] + c[2] * x[2],
             ty = c[3] * x[0] + c[4] * x[1] + c[5] * x[2],
             tz = c[6] * x[0] + c[7] * x[1] + c[8] * x[2];
  const Pack w = -1.0 / (tz + t[2]), qx = (tx + t[0]) * w, qy = (ty + t[1]) * w,
             s = qx * qx + qy * qy;
  const Pack d = 1.0 + s * (k1 + s * k2);
  seen.ru = f * d * qx - load(o.u + first);
  seen.rv = f * d * qy - load(o.v + first);
  for (int lane = last - first; lane < kLanes; ++lane) seen.ru[lane] = seen.rv[lane] = 0;
  if (!Derivatives) return;
  const Pack slope = 2.0 * (k1 + 2.0 * k2 * s), fs = f * s;
  const Pack uu = f * (d + slope * qx * qx), uv = f * slope * qx * qy,
             vv = f * (d + slope * qy * qy);
  // By p: (w, 0, w qx), (0, w, w qy).
  const Pack ux = uu * w, uy = uv * w, uz = ux * qx + uy * qy, vx = uy, vy = vv * w,
             vz = vx * qx + vy * qy;
  const Pack u[12] = {ty * uz - tz * uy,
                      tz * ux - tx * uz,
                      tx * uy - ty * ux,
                      ux,
                      uy,
                      uz,
                      d * qx,
                      fs * qx,
                      fs * s * qx,
                      ux * c[0] + uy * c[3] + uz * c[6],
                      ux * c[1] + uy * c[4] + uz * c[7],
                      ux * c[2] + uy * c[5] + uz * c[8]};
  const Pack v[12] = {ty * vz - tz * vy,
                      tz * vx - tx * vz,
                      tx * vy - ty * vx,
                      vx,
                      vy,
                      vz,
                      d * qy,
                      fs * qy,
                      fs * s * qy,
                      vx * c[0] + vy * c[3] + vz * c[6],
                      vx * c[1] + vy * c[4] + vz * c[7],
                      vx * c[2] + vy * c[5] + vz * c[8]};
  for (int k = 0; k < 12; ++k) seen.u[k] = u[k], seen.v[k] = v[k];
}

bool observe(const Observations& o, int first, int last, double* rows, double& squares) {
  Pack total = {};
  Seen s;
  for (int i = first; i < last; i += kLanes) {
    rows ? see<true>(o, i, last, s) : see<false>(o, i, last, s);
    total += s.ru * s.ru + s.rv * s.rv;
    if (!rows) continue;
    const Pack none = {};
    Pack out[kObservationNumbers] = {
        s.u[0], s.u[1], s.u[2], s.u[3], s.u[4], s.u[5], s.u[6],  s.u[7],  s.v[0], s.v[1],  s.v[2],
        s.v[3], s.v[4], s.v[5], s.v[6], s.v[7], s.u[9], s.u[10], s.u[11], s.v[9], s.v[10], s.v[11],
        s.ru,   s.rv,   s.u[8], s.v[8], none,   none,   none,    none,    none,   none};
    double* to = rows + static_cast<std::ptrdiff_t>(i - first) * kObservationNumbers;
    for (int k = 0; k < kObservationNumbers; k += kLanes) {
      transpose(out + k);
      for (int lane = 0; lane < kLanes; ++lane)
        store(to + lane * kObservationNumbers + k, out[k + lane]);
    }
  }
  squares += sum(total);
  return squares - squares ==
         0;  // a point in the plane of a camera's centre is infinitely far away
}

void condense(const Observations& o, const int* start, int points, const double* steps,
              double* scratch, double* rows) {
  constexpr int numbers = 16;  // as in rows, and one more
  const int first = start[0], last = start[points];
  Seen s;
  for (int i = first; i < last; i += kLanes) {
    see<true>(o, i, last, s);
    Pack d[kCameraNumbers];
    numbers_of(steps, o.camera_of, kCameraNumbers, i, last, d);
    Pack u = s.ru, v = s.rv;
    for (int k = 0; k < 9; ++k) u += s.u[k] * d[k], v += s.v[k] * d[k];
    const Pack *x = s.u + 9, *y = s.v + 9, none = {};
    Pack out[numbers] = {x[0] * x[0] + y[0] * y[0],
                         x[0] * x[1] + y[0] * y[1],
                         x[0] * x[2] + y[0] * y[2],
                         x[0] * s.ru + y[0] * s.rv,
                         x[0] * u + y[0] * v,
                         none,
                         x[1] * x[1] + y[1] * y[1],
                         x[1] * x[2] + y[1] * y[2],
                         x[1] * s.ru + y[1] * s.rv,
                         x[1] * u + y[1] * v,
                         none,
                         none,
                         x[2] * x[2] + y[2] * y[2],
                         x[2] * s.ru + y[2] * s.rv,
                         x[2] * u + y[2] * v,
                         none};
    double* to = scratch + static_cast<std::ptrdiff_t>(i - first) * numbers;
    for (int k = 0; k < numbers; k += kLanes) {
      transpose(out + k);
      for (int lane = 0; lane < kLanes; ++lane) store(to + lane * numbers + k, out[k + lane]);
    }
  }
  for (int p = 0; p < points; ++p, rows += 15) {
    Pack total[numbers / kLanes] = {};
    for (int i = start[p]; i < start[p + 1]; ++i)
      for (int k = 0; k < numbers / kLanes; ++k)
        total[k] += load(scratch + static_cast<std::ptrdiff_t>(i - first) * numbers + k * kLanes);
    for (int k = 0; k < numbers / kLanes; ++k) store(rows + k * kLanes, total[k]);
  }
}

constexpr int kEight = 8 / kLanes;

/// More than 6 parameters because kernels take plain pointers.
void add_point(const double* observations, int count, const int* camera, const int* column,
               double* rows, int stride, int size, double* shared, const std::ptrdiff_t* origin,
               double* gradient) {
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
      for (int e = 0; e < kEight; ++e)
        store(c + e * kLanes, load(c + e * kLanes) + up[e] * u[j] + vp[e] * v[j]);
      c[8] += u8 * u[j] + v8 * v[j];
    }
    shared[origin[first + 8] + first + 8] += u8 * u8 + v8 * v8;
    double* b = gradient + first;
    for (int e = 0; e < kEight; ++e)
      store(b + e * kLanes, load(b + e * kLanes) + up[e] * ru + vp[e] * rv);
    b[8] += u8 * ru + v8 * rv;
  }
  for (int i = 0; i < 3; ++i) {
    double* row = rows + static_cast<std::ptrdiff_t>(i) * stride;
    for (int j = i; j < 3; ++j) row[j] = p[3 * i + j];
    row[size] = a[i];
  }
}

}  // namespace

extern const BundleKernels kBundleKernels;
const BundleKernels kBundleKernels = {observe, add_point, condense};

}  // namespace KINCAL_ISA
}  // namespace kincal
