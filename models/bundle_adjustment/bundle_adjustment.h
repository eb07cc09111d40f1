// Bundle adjustment in the large (Agarwal et al., ECCV 2010): free points seen by free cameras,
// through the same solver. A group is a point (3 private unknowns), the shared unknowns are the
// cameras' (9 each: rotation, translation, f, k1, k2).
#pragma once

#include <vector>

#include "../../solver/aligned.h"
#include "../../solver/problem.h"
#include "bundle_kernels.h"

namespace kincal {

/// BundleAdjustmentData are cameras, points and what was observed. Camera c has 9 numbers (rotation
/// vector, translation, f, k1, k2); p_camera = R p + t, the camera looks along -z: q = -p_camera.xy
/// / p_camera.z, pixel = f (1 + k1 |q|^2 + k2 |q|^4) q. Cost = 1/2 sum |predicted - observed|^2.
struct BundleAdjustmentData {
  std::vector<double> cameras;           // 9 each
  std::vector<double> points;            // 3 each
  std::vector<int> camera_of, point_of;  // by observation
  std::vector<double> pixels;            // 2 each
};

/// The state of a BundleAdjustment has kCameraNumbers a camera, then kPointNumbers a point, then
/// slack. The problem keeps no Jacobian and no rows: what a point contributes is computed again
/// whenever it is needed, from observations ordered by point.
class BundleAdjustment final : public RangeProblem {
 public:
  /// @throws std::invalid_argument if an index is out of range, an array too short, or a camera
  /// sees a point twice.
  explicit BundleAdjustment(const BundleAdjustmentData& data);

  VectorXd initial() const { return initial_; }
  /// Gives the cameras and points of a state, as in the data.
  void unpack(const VectorXd& state, std::vector<double>& cameras,
              std::vector<double>& points) const;

  int shared_size() const override { return 9 * cameras_; }
  const std::vector<GroupShape>& groups() const override { return groups_; }
  void set_workers(int count) override;
  void prepare(const VectorXd&) override {}
  bool evaluate(int group, const VectorXd& state, int worker, Cost& cost) const override;
  bool evaluate_range(int first, int last, const VectorXd& state, int worker,
                      Cost& cost) const override;
  void prepare_range(int first, int last, const VectorXd& state, int worker) const override;
  bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                 Cost& cost) const override;
  void recompute_rows(int first, int last, const VectorXd& state, const VectorXd& shared_step,
                      int worker, double* rows) const override;
  bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const override;
  void retract(const VectorXd& state, const VectorXd& shared_step, const VectorXd& private_step,
               VectorXd& moved) const override;
  bool renew(const VectorXd&) override { return false; }

 private:
  struct alignas(kCacheLine) Scratch {  // one worker's
    std::vector<double> rows;           // kObservationNumbers an observation of the range at hand
    std::vector<double> steps;          // kCameraNumbers a camera
    int first = 0;                      // its first observation
    bool defined = true;
  };

  Observations observations(const VectorXd& state) const;

  int cameras_ = 0, points_ = 0;
  VectorXd initial_;
  std::vector<GroupShape> groups_;
  std::vector<int> start_;                 // first observation of each point
  std::vector<int> camera_of_, point_of_;  // by observation, point after point, cameras ascending
  std::vector<double> u_, v_;
  std::vector<int> column_;  // 3, 12, 21, ...: where the cameras of a point stand in its rows
  mutable std::vector<Scratch> scratch_;
};

}  // namespace kincal
