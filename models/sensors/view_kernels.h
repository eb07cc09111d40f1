// The inner loop over the points of a view for the most common sensors, several points at a time,
// compiled for several instruction sets and chosen at run time. The same values as
// SensorModel::evaluate(), whitened, in another order: residual k of point i is row k * stride + i,
// with stride = padded(count); rows without a point are zero.
#pragma once

#include <cstddef>

namespace kincal {

/// A ScanView is the further input of the kernel of a scanning sensor. Arrays have one value per
/// point, `stride` apart. The PointView's pose is that of the target behind the joint.
struct ScanView {
  const double* rotation;  // from the joint, on the sensor's side of it, to the sensor, row by row
  const double* translation;
  const double* axis;  // of the joint
  bool prismatic;
  const double* turns;   // cosine and sine of the joint's motion, and how far it slides
  const double* by_own;  // derivatives of that by the joint's own parameters, one after the other
  int numbers;           // their number
  const double* roots;   // 3 x 3 per point, row by row, that whiten it; zero in the padding
};

struct PointView {
  const double* points;    // x .., y .., z .. of the seen points, stride apart; the
                           // padding repeats the last
  double scale;            // of the points (the spacing of a grid, else 1)
  const double* rotation;  // sensor_R_target, row by row
  const double* translation;
  const double* parameters;  // the sensor's own parameters
  const double* measured;  // component after component, stride apart; finite values in the padding
  const double* weight;    // 1 / sigma, one per component
  int count, stride;
  const ScanView* scan = nullptr;  // of a scanning sensor; its roots replace the weights
};

/// PointRows are the destinations of the columns of L (column-major, `ld` apart): 6 of the pose
/// from 0 on, own parameter j at own[j] (-1: not needed), the spacing at `square` (or -1). For a
/// scanning sensor the pose is that behind the joint; the pose of its own side, at sensor_side, and
/// the joint's parameters, from `joint` on, are either both needed or both absent (-1).
struct PointRows {
  double* r;
  double* l;  // null: residuals only
  std::ptrdiff_t ld;
  const int* own;
  int square;
  int sensor_side = -1, joint = -1;
};

/// A ViewKernel computes a view and adds the sum of squared whitened residuals to `squares`.
/// Returns false if a residual is undefined.
using ViewKernel = bool (*)(const PointView& view, const PointRows& to, double& squares);

struct ViewKernels {
  ViewKernel pinhole, brown_conrady5, brown_conrady8, point, tilting_laser;
};
const ViewKernels& view_kernels();
/// Returns the kernels for each of all_kernels(), in the same order.
const ViewKernels& view_kernels(int set);

}  // namespace kincal
