// The inner loop over the points of a view for the commonest sensors, several points at a time,
// compiled for several instruction sets and chosen at run time. The same numbers as
// SensorModel::evaluate(), whitened, in another order: residual k of point i is row k * stride + i,
// with stride = padded(count); rows of no point are zero.
#pragma once

#include <cstddef>

namespace kincal {

/// A ScanView is what the kernel of a scanning sensor reads besides. Arrays have a number for each
/// point, `stride` apart; the PointView's pose is that of the target behind the joint.
struct ScanView {
  const double* rotation;  // from the joint, on the sensor's side of it, to the sensor, row by row
  const double* translation;
  const double* axis;  // of the joint
  bool prismatic;
  const double* turns;   // cosine and sine of the joint's motion, and how far it slides
  const double* by_own;  // derivatives of that by the joint's own numbers, one after the other
  int numbers;           // how many these are
  const double* roots;   // 3 x 3 a point, row by row, that whiten it; zero behind the last
};

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
  const ScanView* scan = nullptr;  // of a scanning sensor, whose roots stand for the weights
};

/// PointRows says where the columns of L go (column-major, `ld` apart): 6 of the pose from 0 on,
/// own number j at own[j] (-1: not wanted), the spacing at square (or -1). Of a scanning sensor the
/// pose is that behind the joint, and its side's at sensor_side and the joint's numbers from joint
/// on are wanted together (or -1).
struct PointRows {
  double* r;
  double* l;  // null: residuals only
  std::ptrdiff_t ld;
  const int* own;
  int square;
  int sensor_side = -1, joint = -1;
};

/// A ViewKernel adds the sum of squared whitened residuals to `squares`; false where a residual is
/// undefined.
using ViewKernel = bool (*)(const PointView& view, const PointRows& to, double& squares);

struct ViewKernels {
  ViewKernel pinhole, brown_conrady5, brown_conrady8, point, tilting_laser;
};
const ViewKernels& view_kernels();
/// Returns the kernels of each of all_kernels(), in the same order.
const ViewKernels& view_kernels(int set);

}  // namespace kincal
