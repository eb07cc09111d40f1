// Inner loops of bundle_adjustment.h, several observations at a time; compiled for several instruction sets, chosen at run time.
#pragma once

#include <cstddef>

namespace kincal {

constexpr int kCameraNumbers = 15;      // rotation (row by row), translation, f, k1, k2
constexpr int kObservationNumbers = 40; // d_u_d_camera (9, then 7 zeros), d_v_d_camera (likewise), d_uv_d_point (2 x 3), r (2)

struct Observations {
  const double* cameras;  // kCameraNumbers each
  const double* points;   // 3 each
  const int *camera_of, *point_of;
  const double *u, *v;    // measured
};

struct BundleKernels {
  /// Observations first .. last - 1: adds their squared residuals; to `rows`, unless null, their derivatives. False where undefined.
  bool (*observe)(const Observations& o, int first, int last, double* rows, double& squares);
  /// Adds the equations of one point seen by `count` cameras: camera k has columns column[k] .. + 8 in the group's rows (privates
  /// counted) and the shared columns 9 camera[k] .. + 8. `rows` and shared arrays have slack, where zeros may be added. shared null: rows only.
  void (*add_point)(const double* observations, int count, const int* camera, const int* column, double* rows, int stride, int size,
                    double* shared, const std::ptrdiff_t* origin, double* gradient);
};
const BundleKernels& bundle_kernels();

}  // namespace kincal
