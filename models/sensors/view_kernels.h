// The inner loop over the points of a view for the commonest sensors, several points at a time,
// compiled for several instruction sets and chosen at run time. The same numbers as
// SensorModel::evaluate(), whitened, in another order: residual k of point i is row k * stride + i,
// with stride = padded(count); rows of no point are zero.
#pragma once

#include <cstddef>

namespace kincal {

struct PointView {
  const double* points;    // x .., y .., z .. of the seen points, stride apart; what is behind the
                           // last repeats it
  double scale;            // of the points (the spacing of a grid, else 1)
  const double* rotation;  // sensor_R_target, row by row
  const double* translation;
  const double* parameters;  // the sensor's own numbers
  const double*
      measured;          // component after component, stride apart; finite numbers behind the last
  const double* weight;  // 1 / sigma, one a component
  int count, stride;
};

/// PointRows says where the columns of L go (column-major, `ld` apart): 6 of the pose from 0 on,
/// own number j at own[j] (-1: not wanted), the spacing at square (or -1).
struct PointRows {
  double* r;
  double* l;  // null: residuals only
  std::ptrdiff_t ld;
  const int* own;
  int square;
};

/// A ViewKernel adds the sum of squared whitened residuals to `squares`; false where a residual is
/// undefined.
using ViewKernel = bool (*)(const PointView& view, const PointRows& to, double& squares);

struct ViewKernels {
  ViewKernel pinhole, brown_conrady5, brown_conrady8, point;
};
const ViewKernels& view_kernels();
/// Returns the kernels of each of all_kernels(), in the same order.
const ViewKernels& view_kernels(int set);

}  // namespace kincal
