// kincal-parts: what the parts of an estimation cost, through the public interfaces.
#include <benchmark/benchmark.h>

#include <map>
#include <memory>

#include "../models/joints/joint_model.h"
#include "../models/sensors/sensors.h"
#include "../solver/kernels.h"
#include "../solver/levenberg_marquardt.h"
#include "../solver/observability.h"
#include "../solver/reduced_system.h"
#include "../solver/threads.h"
#include "pr2_like.h"
#include "random.h"
#include "run.h"

namespace kincal::benchmarks {
namespace {

const RobotProblem& pr2() {
  static const RobotProblem problem = pr2_like(64);
  return problem;
}
const RobotProblem& arms() {
  static const RobotProblem problem = four_arms(64);
  return problem;
}

/// An estimation of all of a problem at its start.
struct Started {
  Estimation estimation;
  VectorXd state;

  explicit Started(const RobotProblem& p)
      : estimation(p, p.training(), p.setup), state(estimation.pack(p.start)) {
    estimation.renew(state);
    estimation.prepare(state);
  }
};

// ---------------------------------------------------------------- kinematics

/// An arm of 7 joints: motions from positions, the walk, and the twist of each joint.
void chain_of_7(benchmark::State& bench) {
  const Tree& tree = pr2().rig.tree;
  const Path path = find_path(tree, pr2().rig.base, tree.find_link("l_wrist_roll_link"));
  const std::vector<double>& positions = pr2().samples[0].readings;
  for (auto _ : bench) {
    Pose here, joint, there;
    Eigen::Matrix<double, 6, 7> twists;
    int column = 0;
    for (const PathStep& step : path) {
      const Joint& j = tree.joints[step.joint];
      walk(step, j.parent_T_joint, joint_motion(j, positions[step.joint]), here, joint, there);
      twists.col(column++) = position_twist(j, step.direction, joint);
      here = there;
    }
    benchmark::DoNotOptimize(twists);
    benchmark::DoNotOptimize(here);
  }
}
BENCHMARK(chain_of_7);

// ---------------------------------------------------------------- sensors: one view with
// derivatives

void view(benchmark::State& bench, const SensorModel& model,
          const std::vector<ParameterBlock>& blocks, int count) {
  Random random(3);
  const Target& board = pr2().rig.targets[0];
  const Eigen::Matrix3Xd points = board.square * board.layout;
  std::vector<int> ids;
  std::vector<double> own, z;
  for (int i = 0; i < board.count(); ++i) ids.push_back(i);
  for (const ParameterBlock& b : blocks) own.insert(own.end(), b.values.begin(), b.values.end());
  if (model.measures_pose()) {
    z = {0.01, 0, 1, 0, 0, 0, 1};
  } else {
    for (int i = 0; i < count * model.measurement_size(); ++i) z.push_back(random.uniform(0.1, 1));
  }
  Scan scan;
  scan.axis = Vector3d::UnitY();
  scan.behind_T_target = {Matrix3d::Identity(), Vector3d(0, 0, 1)};
  const double joint[] = {0.01, 1.001};  // offset, scale
  scan.model = linear_joint().get();
  scan.own = joint;
  ViewInput input;
  input.sensor_T_target = {exp_so3(Vector3d(0.1, 0.2, 0.3)), Vector3d(0.02, 0.01, 1)};
  input.scan = model.scans() ? &scan : nullptr;
  input.parameters = own.data();
  input.points = &points;
  input.ids = ids.data();
  input.count = count;
  input.z = z.data();
  Columns columns;
  if (model.scans()) {
    columns.sensor_side = 6;
    columns.joint = 12;
    columns.total = 14;
  }
  if (!own.empty()) {
    columns.parameters = columns.total;
    columns.total += static_cast<int>(own.size());
  }
  const int rows = model.blocks(count) * model.rows();
  RowMatrix rows_of_l = RowMatrix::Zero(rows, columns.total);
  Eigen::Ref<RowMatrix> l(rows_of_l);
  VectorXd r(rows);
  for (auto _ : bench) {
    if (!model.evaluate(input, columns, r.data(), &l)) bench.SkipWithError("undefined");
    benchmark::DoNotOptimize(rows_of_l.data());
    benchmark::ClobberMemory();
  }
  bench.counters["residuals"] = rows;
  bench.counters["columns"] = columns.total;
}
void view_camera(benchmark::State& bench) {
  view(bench, *make_camera(Lens::brown_conrady, 5),
       camera_parameters(Lens::brown_conrady, {500, 500, 320, 240}, {-0.1, 0.02, 0, 0, 0}, 0), 48);
}
void view_point(benchmark::State& bench) { view(bench, *make_point(), {}, 48); }
void view_pose(benchmark::State& bench) { view(bench, *make_pose(), {}, 1); }
void view_chain(benchmark::State& bench) { view(bench, *make_chain(), {}, 1); }
void view_tilting_laser(benchmark::State& bench) { view(bench, *make_tilting_laser(), {}, 48); }
BENCHMARK(view_camera);
BENCHMARK(view_point);
BENCHMARK(view_pose);
BENCHMARK(view_chain);
BENCHMARK(view_tilting_laser);

// ---------------------------------------------------------------- one sample

constexpr int kRoom = 8;  // behind rows, for kernels that write whole vectors

void sample(benchmark::State& bench, const RobotProblem& p, bool derivatives) {
  Started s(p);
  const GroupShape& shape = s.estimation.groups()[0];
  const int k = shape.private_size, m = shape.size() - k, stride = shape.size() + 1 + kRoom;
  std::vector<double> rows(static_cast<size_t>(k + 1) * stride),
      shared(static_cast<size_t>(m + 1) * (m + kRoom)), gradient(m + kRoom);
  std::vector<std::ptrdiff_t> origin(m);
  std::vector<int> row(m);
  for (int i = 0; i < m; ++i) {
    origin[i] = static_cast<std::ptrdiff_t>(i) * (m + kRoom);
    row[i] = i;
  }
  const GroupEquations to{rows.data(),   stride,     shared.data(),
                          origin.data(), row.data(), gradient.data()};
  for (auto _ : bench) {
    Cost cost;
    if (derivatives)
      s.estimation.linearise(0, s.state, 0, to, cost);
    else
      s.estimation.evaluate(0, s.state, 0, cost);
    benchmark::DoNotOptimize(cost);
    benchmark::ClobberMemory();
  }
  bench.counters["residuals"] = shape.rows;
  bench.counters["columns"] = shape.size();
}
/// PR2-like: five cameras and a hand. Rows of all views, their Gram matrices, expanded to the
/// sample's columns.
void linearise_sample(benchmark::State& bench) { sample(bench, pr2(), true); }
/// The same sample's cost alone.
void evaluate_sample(benchmark::State& bench) { sample(bench, pr2(), false); }
/// Five cameras on arms, 32 columns a view.
void linearise_sample_arms(benchmark::State& bench) { sample(bench, arms(), true); }
BENCHMARK(linearise_sample)->Unit(benchmark::kMicrosecond);
BENCHMARK(evaluate_sample)->Unit(benchmark::kMicrosecond);
BENCHMARK(linearise_sample_arms)->Unit(benchmark::kMicrosecond);

// ---------------------------------------------------------------- the whole

/// One iteration: 64 samples x 5 cameras x 48 corners, 32 columns a view, 116 shared parameters:
/// CPU time between the ends of the first and the third iteration, halved.
void iteration(benchmark::State& bench) {
  Started s(arms());
  double times[2] = {0, 0};
  SolverOptions options;
  options.max_iterations = 3;
  options.progress = Progress([&](const Progress::News& news) {
    if (news.iteration == 1) times[0] = cpu_seconds();
    if (news.iteration == 3) times[1] = cpu_seconds();
    return true;
  });
  LevenbergMarquardt lm(s.estimation, options);
  VectorXd state;
  for (auto _ : bench) {
    state = s.state;
    times[0] = times[1] = 0;
    lm.solve(state);
    if (times[1] == 0) bench.SkipWithError("fewer than three iterations");
    bench.SetIterationTime((times[1] - times[0]) / 2);
  }
  bench.counters["shared"] = s.estimation.shared_size();
}
BENCHMARK(iteration)->Unit(benchmark::kMillisecond)->UseManualTime();

/// Cholesky of the dense reduced system of 116 unknowns.
void factor_116(benchmark::State& bench) {
  Started s(arms());
  MatrixXd matrix;
  VectorXd gradient;
  LevenbergMarquardt(s.estimation, {}).reduced(s.state, matrix, gradient);
  ReducedSystem system(s.estimation.shared_size(), s.estimation.groups(), LinearSolver::dense);
  std::vector<double> values(system.storage(), 0.0);
  for (int j = 0; j < matrix.cols(); ++j)
    for (int i = j; i < matrix.rows(); ++i)
      values[static_cast<size_t>(system.origin()[j] + i)] = matrix(i, j);
  std::vector<double> factored = values;
  ThreadPool alone(1);
  for (auto _ : bench) {  // the copy is 1 us of it
    factored = values;
    if (!system.factor(factored.data(), alone)) bench.SkipWithError("not positive definite");
  }
}
BENCHMARK(factor_116)->Unit(benchmark::kMicrosecond);

/// Rank, covariance and unobservable directions of 116 shared parameters from 64 samples.
void covariance(benchmark::State& bench) {
  Started s(arms());
  for (auto _ : bench) {
    const Observability result = observe(s.estimation, s.state);
    benchmark::DoNotOptimize(result.rank);
  }
}
BENCHMARK(covariance)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kincal::benchmarks

BENCHMARK_MAIN();
