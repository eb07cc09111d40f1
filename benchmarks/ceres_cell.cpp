#include "ceres_cell.h"

#include <array>
#include <stdexcept>

#include "ceres_views.h"

namespace kincal::benchmarks {
namespace {

constexpr int kJoints = 7;
constexpr int kLens = 9;                         // fx fy cx cy, k1 k2 p1 p2 k3
constexpr int kFixed = 6 + kLens;                // numbers of a fixed camera: pose, lens
constexpr int kArm = 2 * kJoints + 6 * kJoints;  // offsets, scales, origins
constexpr int kColumns = 7 * kJoints + 6;        // of M: offsets, origins, camera's pose

/// Residuals of a corner and their derivatives by the board's twist [v | w] and by the lens.
struct CornerRows {
  double r[2];
  Rows_t<2, 6> by_twist;
  Rows_t<2, kLens> by_lens;

  bool compute(const ViewData& view, const Pose& sensor_T_board, const double* lens, int i,
               bool derivatives) {
    const double weight = view.inverse_sigma, fx = lens[0] * weight, fy = lens[1] * weight;
    const double k1 = lens[4], k2 = lens[5], p1 = lens[6], p2 = lens[7], k3 = lens[8];
    const Vector3d p = sensor_T_board * Vector3d(view.corners->col(i));
    if (!(p.z() > 1e-9)) return false;
    const double inverse_depth = 1 / p.z(), u = p.x() * inverse_depth, v = p.y() * inverse_depth;
    const double s = u * u + v * v, radial = 1 + s * (k1 + s * (k2 + s * k3));
    const double a = u * radial + 2 * p1 * u * v + p2 * (s + 2 * u * u),
                 b = v * radial + p1 * (s + 2 * v * v) + 2 * p2 * u * v;
    r[0] = fx * a + (lens[2] - view.z[2 * i]) * weight;
    r[1] = fy * b + (lens[3] - view.z[2 * i + 1]) * weight;
    if (!derivatives) return true;
    const double slope = 2 * (k1 + s * (2 * k2 + 3 * k3 * s));
    const double au = radial + slope * u * u + 2 * p1 * v + 6 * p2 * u,
                 av = slope * u * v + 2 * p1 * u + 2 * p2 * v,
                 bv = radial + slope * v * v + 6 * p1 * v + 2 * p2 * u;
    Rows_t<2, 6>& l = by_twist;  // a (v + w x p) = [a | p x a]
    l(0, 0) = fx * inverse_depth * au, l(0, 1) = fx * inverse_depth * av,
         l(0, 2) = -fx * inverse_depth * (au * u + av * v);
    l(1, 0) = fy * inverse_depth * av, l(1, 1) = fy * inverse_depth * bv,
         l(1, 2) = -fy * inverse_depth * (av * u + bv * v);
    for (int k = 0; k < 2; ++k) {
      l(k, 3) = p.y() * l(k, 2) - p.z() * l(k, 1);
      l(k, 4) = p.z() * l(k, 0) - p.x() * l(k, 2);
      l(k, 5) = p.x() * l(k, 1) - p.y() * l(k, 0);
    }
    by_lens << weight * a, 0, weight, 0, fx * u * s, fx * u * s * s, fx * 2 * u * v,
        fx * (s + 2 * u * u), fx * u * s * s * s,  //
        0, weight * b, 0, weight, fy * v * s, fy * v * s * s, fy * (s + 2 * v * v), fy * 2 * u * v,
        fy * v * s * s * s;
    return true;
  }
};

/// A fixed camera: board 6, camera 15.
class FixedView final : public ceres::SizedCostFunction<2 * kCorners, 6, kFixed> {
 public:
  explicit FixedView(const ViewData& view) : view_(view) {}

  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    const Eigen::Map<const Vector6d> xi_board(x[0]), xi_pose(x[1]);
    const Pose sensor_T_board = inverse(view_.chain->link_T_sensor * exp_se3(xi_pose)) *
                                (view_.base_T_board * exp_se3(xi_board));
    Rows_t<6, 6> by_board, by_pose;
    if (jacobians) {
      by_board = seen_through(sensor_T_board, right_jacobian(xi_board));
      by_pose = -right_jacobian(xi_pose);
    }
    CornerRows corner;
    for (int i = 0; i < kCorners; ++i) {
      if (!corner.compute(view_, sensor_T_board, x[1] + 6, i, jacobians)) return false;
      r[2 * i] = corner.r[0];
      r[2 * i + 1] = corner.r[1];
      if (!jacobians) continue;
      const Rows_t<2, 6>& l = corner.by_twist;
      if (jacobians[0]) Eigen::Map<Rows_t<2, 6>>(jacobians[0] + 12 * i) = l.lazyProduct(by_board);
      if (!jacobians[1]) continue;
      Eigen::Map<Rows_t<2, kFixed>> out(jacobians[1] + 2 * kFixed * i);
      out.leftCols<6>() = l.lazyProduct(by_pose);
      out.rightCols<kLens>() = corner.by_lens;
    }
    return true;
  }

 private:
  ViewData view_;
};

/// A camera in the hand of an arm: board 6, arm and camera 71 (offsets, scales, origins, pose,
/// lens). The arm is walked once.
class ArmView final : public ceres::SizedCostFunction<2 * kCorners, 6, kArm + kFixed> {
 public:
  explicit ArmView(const ViewData& view) : view_(view) {}

  bool Evaluate(double const* const* x, double* r, double** jacobians) const override {
    Pose sensor_T_board;
    Rows_t<6, 6> by_board;
    Rows_t<6, kColumns> by_arm;
    compute(x[0], x[1], jacobians, sensor_T_board, by_board, by_arm);
    CornerRows corner;
    for (int i = 0; i < kCorners; ++i) {
      if (!corner.compute(view_, sensor_T_board, x[1] + kArm + 6, i, jacobians)) return false;
      r[2 * i] = corner.r[0];
      r[2 * i + 1] = corner.r[1];
      if (!jacobians) continue;
      const Rows_t<2, 6>& l = corner.by_twist;
      if (jacobians[0]) Eigen::Map<Rows_t<2, 6>>(jacobians[0] + 12 * i) = l.lazyProduct(by_board);
      if (!jacobians[1]) continue;
      const Rows_t<2, kColumns> moved = l.lazyProduct(by_arm);
      Eigen::Map<Rows_t<2, kArm + kFixed>> out(jacobians[1] + 2 * (kArm + kFixed) * i);
      out.leftCols<kJoints>() = moved.leftCols<kJoints>();
      for (int j = 0; j < kJoints; ++j) out.col(kJoints + j) = moved.col(j) * view_.readings[j];
      out.middleCols<kColumns - kJoints>(2 * kJoints) = moved.rightCols<kColumns - kJoints>();
      out.rightCols<kLens>() = corner.by_lens;
    }
    return true;
  }

 private:
  void compute(const double* board, const double* arm, bool derivatives, Pose& sensor_T_board,
               Rows_t<6, 6>& by_board, Rows_t<6, kColumns>& by_arm) const {
    const Eigen::Map<const Vector6d> xi_board(board), xi_pose(arm + kArm);
    Pose base_T_here, base_T_joint[kJoints];
    for (int j = 0; j < kJoints; ++j) {
      const Eigen::Map<const Vector6d> xi(arm + 2 * kJoints + 6 * j);
      base_T_joint[j] = base_T_here * (view_.chain->origins[j] * exp_se3(xi));
      const Vector3d turn = (arm[kJoints + j] * view_.readings[j] + arm[j]) * view_.chain->axes[j];
      base_T_here = {base_T_joint[j].rotation * exp_so3(turn), base_T_joint[j].translation};
    }
    const Pose sensor_T_base =
        inverse(base_T_here * (view_.chain->link_T_sensor * exp_se3(xi_pose)));
    sensor_T_board = sensor_T_base * (view_.base_T_board * exp_se3(xi_board));
    if (!derivatives) return;
    by_board = seen_through(sensor_T_board, right_jacobian(xi_board));
    by_arm.rightCols<6>() = -right_jacobian(xi_pose);
    for (int j = 0; j < kJoints; ++j) {  // what moves the sensor moves the board the other way
      const Pose sensor_T_joint = sensor_T_base * base_T_joint[j];
      const Vector3d axis = sensor_T_joint.rotation * view_.chain->axes[j];
      by_arm.block<3, 1>(0, j) = axis.cross(sensor_T_joint.translation);
      by_arm.block<3, 1>(3, j) = -axis;
      const Eigen::Map<const Vector6d> xi(arm + 2 * kJoints + 6 * j);
      by_arm.middleCols<6>(kJoints + 6 * j) = -seen_through(sensor_T_joint, right_jacobian(xi));
    }
  }

  ViewData view_;
};

}  // namespace

struct CeresCell::Implementation {
  std::vector<Chain> chains;                 // by sensor
  std::vector<std::vector<double>> cameras;  // by sensor: its arm, if it has one; pose, lens
  std::vector<std::vector<double>> start;    // of these
  std::vector<std::array<double, 6>> boards;
  Eigen::Matrix3Xd corners;
  ceres::Problem problem;

  void reset() {
    cameras = start;  // same sizes: the storage stays where Ceres knows it
    for (auto& b : boards) b.fill(0);
  }
};

CeresCell::~CeresCell() = default;

CeresCell::CeresCell(const RobotProblem& p) : i_(std::make_unique<Implementation>()) {
  Implementation& m = *i_;
  const Rig& rig = p.rig;
  std::vector<std::vector<double>> sigmas(rig.sensors.size());
  // Number `component` of a parameter with its prior; of a pose: the motion from the start, 0.
  const auto add = [&](size_t s, int parameter, int component, bool pose) {
    for (const Prior& prior : p.setup.priors)
      if (prior.parameter == parameter && prior.component == component) {
        m.start[s].push_back(pose ? 0 : p.start.shared(p.table.all[parameter].start + component));
        sigmas[s].push_back(prior.sigma);
        return;
      }
    throw std::logic_error("no prior of " + p.table.all[parameter].name);
  };
  m.start.resize(rig.sensors.size());
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    Chain chain;
    chain.link_T_sensor = sensor.link_T_sensor;
    std::vector<int> joints;
    for (const PathStep& step : find_path(rig.tree, rig.base, sensor.link)) {
      joints.push_back(step.joint);
      chain.origins.push_back(rig.tree.joints[step.joint].parent_T_joint);
      chain.axes.push_back(rig.tree.joints[step.joint].axis);
    }
    m.chains.push_back(std::move(chain));
    for (const int j : joints) add(s, p.table.joint_offset[j], 0, false);
    for (const int j : joints) add(s, p.table.joint_scale[j], 0, false);
    for (const int j : joints)
      for (int c = 0; c < 6; ++c) add(s, p.table.joint_origin[j], c, true);
    for (int c = 0; c < 6; ++c) add(s, p.table.sensor_pose[s], c, true);
    for (int c = 0; c < 4; ++c) add(s, p.table.sensor_block[s], c, false);
    for (int c = 0; c < 5; ++c) add(s, p.table.sensor_block[s] + 1, c, false);
  }
  m.boards.resize(p.samples.size());
  m.reset();
  m.corners = rig.targets[0].square * rig.targets[0].layout;
  for (size_t k = 0; k < p.samples.size(); ++k)
    for (const View& v : p.samples[k].views) {
      const size_t s = v.sensor;
      const auto path = find_path(rig.tree, rig.base, rig.sensors[s].link);
      const ViewData view{&m.chains[s],
                          path.empty() ? nullptr : &p.samples[k].readings[path.front().joint],
                          p.start.targets.at({static_cast<int>(k), 0}),
                          &m.corners,
                          v.z.data(),
                          1 / v.sigma[0]};
      ceres::CostFunction* cost = nullptr;
      if (path.empty())
        cost = new FixedView(view);
      else
        cost = new ArmView(view);
      m.problem.AddResidualBlock(cost, nullptr, m.boards[k].data(), m.cameras[s].data());
    }
  for (size_t s = 0; s < m.cameras.size(); ++s)
    m.problem.AddResidualBlock(new DiagonalPrior(m.start[s], sigmas[s]), nullptr,
                               m.cameras[s].data());
}

Run CeresCell::solve(bool sparse, int threads) {
  i_->reset();
  ceres::Solver::Options options;
  options.linear_solver_type = sparse ? ceres::SPARSE_SCHUR : ceres::DENSE_SCHUR;
  options.function_tolerance = 1e-6;
  options.gradient_tolerance = 1e-10;
  options.parameter_tolerance = 1e-8;
  options.max_num_iterations = 100;
  options.num_threads = threads;
  options.logging_type = ceres::SILENT;
  options.jacobi_scaling = false;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (auto& b : i_->boards) options.linear_solver_ordering->AddElementToGroup(b.data(), 0);
  for (auto& c : i_->cameras) options.linear_solver_ordering->AddElementToGroup(c.data(), 1);
  ceres::Solver::Summary summary;
  Run run;
  const double cpu = cpu_seconds(), wall = wall_seconds();
  ceres::Solve(options, &i_->problem, &summary);
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
