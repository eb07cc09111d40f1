// Inner loops of bundle_adjustment.h, several observations at a time; compiled for several
// instruction sets, chosen at run time.
#pragma once

#include <cstddef>

namespace kincal {

constexpr int kCameraNumbers = 16;       // rotation (row by row), translation, f, k1, k2, nothing
constexpr int kPointNumbers = 4;         // x, y, z, nothing
constexpr int kObservationNumbers = 32;  // d_u_d_camera 0-7, d_v_d_camera 0-7, d_uv_d_point (2 x
                                         // 3), r (2), d_uv_d_camera 8, nothing

struct Observations {
  const double* cameras;  // kCameraNumbers each
  const double* points;   // kPointNumbers each
  const int *camera_of, *point_of;
  const double *u, *v;  // measured; slack behind them
};

struct BundleKernels {
  /// Adds the squared residuals of observations first .. last - 1; writes their derivatives to
  /// `rows` (room for a few more), unless null. False where undefined.
  bool (*observe)(const Observations& o, int first, int last, double* rows, double& squares);
  /// Adds the equations of one point seen by `count` cameras: camera k has columns column[k] .. + 8
  /// in the group's rows (privates counted) and the shared columns 9 camera[k] .. + 8. `rows` and
  /// shared arrays have slack, where zeros may be added.
  void (*add_point)(const double* observations, int count, const int* camera, const int* column,
                    double* rows, int stride, int size, double* shared,
                    const std::ptrdiff_t* origin, double* gradient);
  /// Computes [P | a | a + Q dx] (3 x 5, row by row) of points whose observations are start[p] ..
  /// start[p + 1] - 1, p from 0 to points - 1. `rows` has room for one number more. `steps` is dx,
  /// kCameraNumbers a camera, and `scratch` has kObservationNumbers an observation and a few more.
  void (*condense)(const Observations& o, const int* start, int points, const double* steps,
                   double* scratch, double* rows);
};
const BundleKernels& bundle_kernels();

}  // namespace kincal
