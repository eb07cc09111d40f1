#include "bundle_adjustment.h"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>

#include "../../kinematics/transform.h"
#include "../../solver/kernels.h"

namespace kincal {

namespace baseline {
extern const BundleKernels kBundleKernels;
}
#ifdef KINCAL_X86_SETS
namespace avx2 {
extern const BundleKernels kBundleKernels;
}
namespace avx512 {
extern const BundleKernels kBundleKernels;
}
#endif

const BundleKernels& bundle_kernels() {
#ifdef KINCAL_X86_SETS
  if (instruction_set() == 2) return avx512::kBundleKernels;
  if (instruction_set() == 1) return avx2::kBundleKernels;
#endif
  return baseline::kBundleKernels;
}

namespace {

using RowMatrix3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

}  // namespace

BundleAdjustment::BundleAdjustment(const BundleAdjustmentData& data)
    : cameras_(static_cast<int>(data.cameras.size() / 9)),
      points_(static_cast<int>(data.points.size() / 3)) {
  const size_t n = data.camera_of.size();
  if (data.cameras.size() % 9 != 0 || data.points.size() % 3 != 0 || data.point_of.size() != n ||
      data.pixels.size() != 2 * n)
    throw std::invalid_argument(
        "bundle adjustment: 9 numbers a camera, 3 a point, one camera, one point and 2 pixels an "
        "observation");
  for (size_t i = 0; i < n; ++i)
    if (data.camera_of[i] < 0 || data.camera_of[i] >= cameras_ || data.point_of[i] < 0 ||
        data.point_of[i] >= points_)
      throw std::invalid_argument("bundle adjustment: observation " + std::to_string(i) +
                                  ": there is no camera " + std::to_string(data.camera_of[i]) +
                                  " or no point " + std::to_string(data.point_of[i]));
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return data.point_of[a] != data.point_of[b] ? data.point_of[a] < data.point_of[b]
                                                : data.camera_of[a] < data.camera_of[b];
  });
  start_.assign(points_ + 1, 0);
  for (int i : order) {
    if (!camera_of_.empty() && camera_of_.back() == data.camera_of[i] &&
        point_of_.back() == data.point_of[i])
      throw std::invalid_argument("bundle adjustment: camera " + std::to_string(data.camera_of[i]) +
                                  " sees point " + std::to_string(data.point_of[i]) + " twice");
    camera_of_.push_back(data.camera_of[i]);
    point_of_.push_back(data.point_of[i]);
    u_.push_back(data.pixels[2 * i]);
    v_.push_back(data.pixels[2 * i + 1]);
    ++start_[data.point_of[i] + 1];
  }
  std::partial_sum(start_.begin(), start_.end(), start_.begin());
  groups_.resize(points_);
  int most = 0;
  for (int p = 0; p < points_; ++p) {
    GroupShape& g = groups_[p];
    g.private_size = 3;
    g.rows = 2 * (start_[p + 1] - start_[p]);
    most = std::max(most, start_[p + 1] - start_[p]);
    g.columns.reserve(9 * static_cast<size_t>(start_[p + 1] - start_[p]));
    for (int o = start_[p]; o < start_[p + 1]; ++o)
      for (int c = 0; c < 9; ++c) g.columns.push_back(9 * camera_of_[o] + c);
  }
  for (int k = 0; k < most; ++k) column_.push_back(3 + 9 * k);

  u_.resize(u_.size() + kSlack, 0.0);
  v_.resize(v_.size() + kSlack, 0.0);
  initial_.setZero(kCameraNumbers * static_cast<Eigen::Index>(cameras_) +
                   kPointNumbers * static_cast<Eigen::Index>(points_) + kSlack);
  for (int c = 0; c < cameras_; ++c) {
    const double* from = data.cameras.data() + 9 * static_cast<size_t>(c);
    double* to = initial_.data() + kCameraNumbers * static_cast<size_t>(c);
    Eigen::Map<RowMatrix3d>{to} = exp_so3(Vector3d(from));
    std::copy_n(from + 3, 6, to + 9);
  }
  for (int p = 0; p < points_; ++p)
    std::copy_n(data.points.data() + 3 * static_cast<size_t>(p), 3,
                initial_.data() + kCameraNumbers * static_cast<size_t>(cameras_) +
                    kPointNumbers * static_cast<size_t>(p));
  set_workers(1);
}

void BundleAdjustment::set_workers(int count) {
  size_t most = 0;  // observations of a range, wherever it begins
  for (int p = 0; p < points_; ++p)
    most = std::max<size_t>(most, start_[std::min(points_, p + kRange)] - start_[p]);
  scratch_.resize(count);
  for (Scratch& s : scratch_)
    s.rows.assign((most + kSlack) * kObservationNumbers, 0.0),
        s.steps.assign(kCameraNumbers * static_cast<size_t>(cameras_), 0.0);
}

void BundleAdjustment::unpack(const VectorXd& state, std::vector<double>& cameras,
                              std::vector<double>& points) const {
  cameras.resize(9 * static_cast<size_t>(cameras_));
  for (int c = 0; c < cameras_; ++c) {
    const double* from = state.data() + kCameraNumbers * static_cast<size_t>(c);
    double* to = cameras.data() + 9 * static_cast<size_t>(c);
    Eigen::Map<Vector3d>{to} = log_so3(Eigen::Map<const RowMatrix3d>(from));
    std::copy_n(from + 9, 6, to + 3);
  }
  points.resize(3 * static_cast<size_t>(points_));
  for (int p = 0; p < points_; ++p)
    std::copy_n(state.data() + kCameraNumbers * static_cast<size_t>(cameras_) +
                    kPointNumbers * static_cast<size_t>(p),
                3, points.data() + 3 * static_cast<size_t>(p));
}

Observations BundleAdjustment::observations(const VectorXd& state) const {
  return {state.data(),      state.data() + kCameraNumbers * static_cast<size_t>(cameras_),
          camera_of_.data(), point_of_.data(),
          u_.data(),         v_.data()};
}

bool BundleAdjustment::evaluate_range(int first, int last, const VectorXd& state, int,
                                      Cost& cost) const {
  double squares = 0;
  const bool defined =
      bundle_kernels().observe(observations(state), start_[first], start_[last], nullptr, squares);
  cost.doubled += squares;
  cost.chi2 += squares;
  return defined;
}

bool BundleAdjustment::evaluate(int group, const VectorXd& state, int worker, Cost& cost) const {
  cost = {};
  return evaluate_range(group, group + 1, state, worker, cost);
}

void BundleAdjustment::prepare_range(int first, int last, const VectorXd& state, int worker) const {
  Scratch& s = scratch_[worker];
  double squares = 0;
  s.first = start_[first];
  s.defined = bundle_kernels().observe(observations(state), start_[first], start_[last],
                                       s.rows.data(), squares);
}

bool BundleAdjustment::linearise(int group, const VectorXd&, int worker, const GroupEquations& to,
                                 Cost& cost) const {
  const Scratch& s = scratch_[worker];
  if (!s.defined) return false;
  const int first = start_[group], count = start_[group + 1] - first;
  const double* rows = s.rows.data() + static_cast<size_t>(first - s.first) * kObservationNumbers;
  bundle_kernels().add_point(rows, count, camera_of_.data() + first, column_.data(), to.rows,
                             to.stride, groups_[group].size(), to.shared, to.origin, to.gradient);
  cost = {};
  for (int k = 0; k < count; ++k) {
    const double* r = rows + static_cast<size_t>(k) * kObservationNumbers + 22;
    cost.chi2 += r[0] * r[0] + r[1] * r[1];
  }
  cost.doubled = cost.chi2;
  return true;
}

void BundleAdjustment::recompute_rows(int first, int last, const VectorXd& state,
                                      const VectorXd& shared_step, int worker, double* rows) const {
  Scratch& s = scratch_[worker];
  for (int o = start_[first]; o < start_[last]; ++o) {  // of the cameras that these points see
    const size_t c = static_cast<size_t>(camera_of_[o]);
    std::copy_n(shared_step.data() + 9 * c, 9, s.steps.data() + kCameraNumbers * c);
  }
  bundle_kernels().condense(observations(state), start_.data() + first, last - first,
                            s.steps.data(), s.rows.data(), rows);
}

bool BundleAdjustment::square_root(int group, const VectorXd& state, int worker,
                                   MatrixXd& rows) const {
  prepare_range(group, group + 1, state, worker);
  const Scratch& s = scratch_[worker];
  const int count = start_[group + 1] - start_[group], size = groups_[group].size();
  rows.setZero(2 * count, size + 1);
  for (int k = 0; k < count; ++k) {
    const double* o = s.rows.data() + static_cast<size_t>(k) * kObservationNumbers;
    for (int i = 0; i < 2; ++i) {
      rows.row(2 * k + i).head<3>() = Eigen::Map<const Eigen::RowVector3d>(o + 16 + 3 * i);
      rows.row(2 * k + i).segment<8>(column_[k]) =
          Eigen::Map<const Eigen::Matrix<double, 1, 8>>(o + 8 * i);
      rows(2 * k + i, column_[k] + 8) = o[24 + i];
      rows(2 * k + i, size) = o[22 + i];
    }
  }
  return s.defined;
}

void BundleAdjustment::retract(const VectorXd& state, const VectorXd& shared_step,
                               const VectorXd& private_step, VectorXd& moved) const {
  moved = state;
  for (int c = 0; c < cameras_; ++c) {
    double* camera = moved.data() + kCameraNumbers * static_cast<size_t>(c);
    const double* step = shared_step.data() + 9 * static_cast<size_t>(c);
    Eigen::Map<RowMatrix3d> rotation(camera);
    rotation = exp_so3(Vector3d(step)) * Matrix3d(rotation);
    for (int k = 0; k < 6; ++k) camera[9 + k] += step[3 + k];
  }
  double* points = moved.data() + kCameraNumbers * static_cast<size_t>(cameras_);
  for (int p = 0; p < points_; ++p)
    for (int k = 0; k < 3; ++k)
      points[kPointNumbers * static_cast<size_t>(p) + k] +=
          private_step(3 * static_cast<Eigen::Index>(p) + k);
}

}  // namespace kincal
