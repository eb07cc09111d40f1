#include "ceres_bal.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include "../kinematics/transform.h"

namespace kincal::benchmarks {
namespace {

using Matrix23 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

struct Reprojection {
  const double* pixel;

  template <class T>
  bool operator()(const T* camera, const T* point, T* r) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    for (int i = 0; i < 3; ++i) p[i] += camera[3 + i];
    const T u = -p[0] / p[2], v = -p[1] / p[2], s = u * u + v * v;
    const T scale = camera[6] * (1.0 + s * (camera[7] + s * camera[8]));
    r[0] = scale * u - pixel[0];
    r[1] = scale * v - pixel[1];
    return true;
  }
};

/// What all observations of a camera share, computed once an evaluation.
struct CameraFrame {
  Matrix3d rotation, left_jacobian;  // R(w + d) = exp(J_l d) R(w)
};

class AnalyticReprojection final : public ceres::SizedCostFunction<2, 9, 3> {
 public:
  AnalyticReprojection(const double* pixel, const CameraFrame* frame)
      : pixel_(pixel), frame_(frame) {}

  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    const double* camera = x[0];
    const Vector3d turned = frame_->rotation * Eigen::Map<const Vector3d>(x[1]);
    const Vector3d p = turned + Eigen::Map<const Vector3d>(camera + 3);
    const double inverse_depth = 1 / p.z(), u = -p.x() * inverse_depth, v = -p.y() * inverse_depth,
                 s = u * u + v * v;
    const double f = camera[6], radial = 1 + s * (camera[7] + s * camera[8]);
    r[0] = f * radial * u - pixel_[0];
    r[1] = f * radial * v - pixel_[1];
    if (!jacobians) return true;
    const double slope = 2 * (camera[7] + 2 * s * camera[8]);
    const double uu = f * (radial + slope * u * u), uv = f * slope * u * v,
                 vv = f * (radial + slope * v * v);
    Matrix23 by_p;  // d(u, v) / dp = -(1 0 u; 0 1 v) / z
    by_p << -uu * inverse_depth, -uv * inverse_depth, -(uu * u + uv * v) * inverse_depth,  //
        -uv * inverse_depth, -vv * inverse_depth, -(uv * u + vv * v) * inverse_depth;
    if (jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 2, 9, Eigen::RowMajor>> out(jacobians[0]);
      Matrix23 by_turn;  // a (w x q) = (q x a) w
      for (int k = 0; k < 2; ++k)
        by_turn.row(k) = turned.cross(Vector3d(by_p.row(k).transpose())).transpose();
      out.leftCols<3>() = by_turn.lazyProduct(frame_->left_jacobian);
      out.middleCols<3>(3) = by_p;
      out.rightCols<3>() << radial * u, f * s * u, f * s * s * u, radial * v, f * s * v,
          f * s * s * v;
    }
    if (jacobians[1]) {
      Eigen::Map<Matrix23> out(jacobians[1]);
      out = by_p.lazyProduct(frame_->rotation);
    }
    return true;
  }

 private:
  const double* pixel_;
  const CameraFrame* frame_;
};

/// Computes the cameras' frames whenever Ceres is about to evaluate somewhere else.
class Frames final : public ceres::EvaluationCallback {
 public:
  explicit Frames(const std::vector<double>& cameras)
      : cameras_(cameras), frames_(cameras.size() / 9) {}
  void PrepareForEvaluation(bool, bool new_point) override {
    if (!new_point) return;
    for (size_t c = 0; c < frames_.size(); ++c) {
      const Vector3d w(cameras_[9 * c], cameras_[9 * c + 1], cameras_[9 * c + 2]);
      frames_[c] = {exp_so3(w), left_jacobian_so3(w)};
    }
  }
  const CameraFrame* frame(int camera) const { return &frames_[camera]; }

 private:
  const std::vector<double>& cameras_;
  std::vector<CameraFrame> frames_;
};

}  // namespace

struct CeresBal::Implementation {
  explicit Implementation(const BundleAdjustmentData& d)
      : data(d), cameras(d.cameras), points(d.points), frames(cameras) {}

  const BundleAdjustmentData& data;
  std::vector<double> cameras, points;
  Frames frames;
  std::unique_ptr<ceres::Problem> problem;
};

CeresBal::~CeresBal() = default;

CeresBal::CeresBal(const BundleAdjustmentData& data, bool analytic)
    : i_(std::make_unique<Implementation>(data)) {
  ceres::Problem::Options options;
  if (analytic) options.evaluation_callback = &i_->frames;
  i_->problem = std::make_unique<ceres::Problem>(options);
  for (size_t k = 0; k < data.camera_of.size(); ++k) {
    const double* pixel = &data.pixels[2 * k];
    ceres::CostFunction* cost = nullptr;
    if (analytic)
      cost = new AnalyticReprojection(pixel, i_->frames.frame(data.camera_of[k]));
    else
      cost = new ceres::AutoDiffCostFunction<Reprojection, 2, 9, 3>(new Reprojection{pixel});
    i_->problem->AddResidualBlock(cost, nullptr, &i_->cameras[9 * data.camera_of[k]],
                                  &i_->points[3 * data.point_of[k]]);
  }
}

Run CeresBal::solve(bool sparse, int threads) {
  i_->cameras = i_->data.cameras;  // same sizes: the storage stays where Ceres knows it
  i_->points = i_->data.points;
  ceres::Solver::Options options;
  options.linear_solver_type = sparse ? ceres::SPARSE_SCHUR : ceres::DENSE_SCHUR;
  options.function_tolerance = 1e-6;
  options.gradient_tolerance = 1e-10;
  options.parameter_tolerance = 1e-8;
  options.max_num_iterations = 200;
  options.num_threads = threads;
  options.logging_type = ceres::SILENT;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (size_t p = 0; p < i_->points.size(); p += 3)
    if (i_->problem->HasParameterBlock(&i_->points[p]))
      options.linear_solver_ordering->AddElementToGroup(&i_->points[p], 0);
  for (size_t c = 0; c < i_->cameras.size(); c += 9)
    if (i_->problem->HasParameterBlock(&i_->cameras[c]))
      options.linear_solver_ordering->AddElementToGroup(&i_->cameras[c], 1);
  ceres::Solver::Summary summary;
  Run run;
  const double cpu = cpu_seconds(), wall = wall_seconds();
  ceres::Solve(options, i_->problem.get(), &summary);
  run.seconds = cpu_seconds() - cpu;
  run.wall = wall_seconds() - wall;
  run.start_cost = summary.initial_cost;
  run.cost = summary.final_cost;
  run.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps -
                   1;  // the evaluation at the start counts as a step
  run.converged = summary.termination_type == ceres::CONVERGENCE;
  return run;
}

}  // namespace kincal::benchmarks
