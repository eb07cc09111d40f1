// The lens of pinhole and Brown-Conrady cameras, with derivatives, for one number or for a pack of
// them: no Eigen here, so that files compiled for several instruction sets may include it
// (solver/simd.h). The formulas are in cameras.h.
#pragma once

namespace kincal {

/// Computes the image of a point (x, y, depth) in front of the rectified camera, x less the
/// baseline; N distortion numbers stand behind fx fy cx cy. d_p is 2 x 3, by the point; d_own is 2
/// x 5 + N, by the camera's numbers; both are row-major, and given both or neither. It has more
/// than 6 parameters because T is a number here and a pack of numbers in the kernels: all are
/// passed singly.
template <int N, class T>
__attribute__((always_inline)) inline void brown_conrady(const double* parameters, const T& x,
                                                         const T& y, const T& depth, T* pixel,
                                                         T* d_p, T* d_own) {
  const double fx = parameters[0], fy = parameters[1];
  const double* d = parameters + 4;
  const T inverse_depth = 1.0 / depth, u = x * inverse_depth, v = y * inverse_depth;
  T a = u, b = v;
  T a_u = u * 0.0 + 1.0, a_v = u * 0.0, b_v = a_u;  // d(a, b) / d(u, v); symmetric: b_u = a_v
  T radial = a_u, inverse_denominator = a_u, uu = u * u, vv = v * v, uv = u * v;
  const T s = uu + vv;
  if constexpr (N > 0) {
    const double k1 = d[0], k2 = d[1], p1 = d[2], p2 = d[3], k3 = d[4];
    radial = 1.0 + s * (k1 + s * (k2 + s * k3));
    T d_radial = k1 + s * (2 * k2 + 3 * k3 * s);
    if constexpr (N == 8) {
      const double k4 = d[5], k5 = d[6], k6 = d[7];
      inverse_denominator = 1.0 / (1.0 + s * (k4 + s * (k5 + s * k6)));
      radial = radial * inverse_denominator;
      d_radial = (d_radial - radial * (k4 + s * (2 * k5 + 3 * k6 * s))) * inverse_denominator;
    }
    a = u * radial + 2 * p1 * uv + p2 * (s + 2 * uu);
    b = v * radial + p1 * (s + 2 * vv) + 2 * p2 * uv;
    a_u = radial + 2 * uu * d_radial + 2 * p1 * v + 6 * p2 * u;
    a_v = 2 * uv * d_radial + 2 * p1 * u + 2 * p2 * v;
    b_v = radial + 2 * vv * d_radial + 6 * p1 * v + 2 * p2 * u;
  }
  pixel[0] = fx * a + parameters[2];
  pixel[1] = fy * b + parameters[3];
  if (!d_p) return;
  const T ix = fx * inverse_depth, iy = fy * inverse_depth;
  d_p[0] = ix * a_u, d_p[1] = ix * a_v, d_p[2] = -ix * (a_u * u + a_v * v);
  d_p[3] = iy * a_v, d_p[4] = iy * b_v, d_p[5] = -iy * (a_v * u + b_v * v);
  T *dx = d_own, *dy = d_own + 5 + N;
  const T none = u * 0.0;
  dx[0] = a, dx[1] = none, dx[2] = none + 1.0, dx[3] = none;
  dy[0] = none, dy[1] = b, dy[2] = none, dy[3] = none + 1.0;
  if constexpr (N > 0) {
    const T s1 = s * inverse_denominator, s2 = s * s1, s3 = s * s2;
    dx[4] = fx * u * s1, dx[5] = fx * u * s2, dx[6] = fx * 2 * uv, dx[7] = fx * (s + 2 * uu),
    dx[8] = fx * u * s3;
    dy[4] = fy * v * s1, dy[5] = fy * v * s2, dy[6] = fy * (s + 2 * vv), dy[7] = fy * 2 * uv,
    dy[8] = fy * v * s3;
    if constexpr (N == 8) {
      dx[9] = -dx[4] * radial, dx[10] = -dx[5] * radial, dx[11] = -dx[8] * radial;
      dy[9] = -dy[4] * radial, dy[10] = -dy[5] * radial, dy[11] = -dy[8] * radial;
    }
  }
  dx[4 + N] = -d_p[0];
  dy[4 + N] = -d_p[3];
}

}  // namespace kincal
