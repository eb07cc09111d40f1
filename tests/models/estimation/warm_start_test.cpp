// Estimation::reload() and solving again with the same LevenbergMarquardt.
//
// Proves: after measured numbers, sigmas, covariances and readings were replaced in place and
// reload() was called, the same problem and solver give bit for bit what ones freshly built on the
// new numbers give: every type of sensor, every noise mode, with losses and priors, dense and
// CHOLMOD, one thread and two; also after solves that ended undefined, cancelled or not converged.
// The same problem without reload() is not required to, and solving twice from one start gives the
// same bits. Does not prove: that nothing is allocated (solver/allocation_test.cpp).
#include <catch2/catch.hpp>
#include <cstring>
#include <limits>

#include "../../../benchmarks/pr2_like.h"
#include "../../../models/estimation/estimation.h"
#include "../../../models/rig/parameters.h"
#include "../../../solver/levenberg_marquardt.h"
#include "../../fixtures/problem.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/transforms.h"

namespace warm_start_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

bool same_bits(const VectorXd& a, const VectorXd& b) {
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<size_t>(a.size())) == 0;
}

/// Other numbers in the same places; `size` 1: other noise of the same kind.
void replace(std::vector<Sample>& samples, double size, Random& random) {
  for (Sample& s : samples) {
    for (double& q : s.readings) q += size * 1e-4 * random.normal();  // NaN stays
    for (View& v : s.views) {
      for (size_t i = 0; i < v.z.size(); ++i) {
        const bool pose = v.ids.empty();
        const double sigma = pose || v.sigma.empty() ? 1e-4 : v.sigma[i % v.sigma.size()];
        v.z[i] += size * sigma * random.normal();
      }
      if (v.ids.empty() && v.z.size() == 7) Eigen::Map<Eigen::Vector4d>(v.z.data() + 3).normalize();
      for (double& sigma : v.sigma.own()) sigma *= random.uniform(0.7, 1.5);
      for (Matrix3d& c : v.covariance) c *= random.uniform(0.7, 1.5);
    }
  }
}

/// Covariances instead of sigmas for one sensor's views.
void with_covariances(std::vector<Sample>& samples, int sensor, Random& random) {
  for (Sample& s : samples)
    for (View& v : s.views) {
      if (v.sensor != sensor) continue;
      v.sigma.clear();
      for (size_t i = 0; i < v.ids.size(); ++i) {
        const Matrix3d r = random.rotation(3);
        v.covariance.push_back(r * Vector3d(1e-6, 4e-6, random.uniform(1e-5, 1e-4)).asDiagonal() *
                               r.transpose());
      }
    }
}

void compare(Estimation& problem, LevenbergMarquardt& solver, const Recording& recording,
             const SolverOptions& options, const Values& values) {
  problem.reload();
  VectorXd state = problem.pack(values);
  const SolveSummary& summary = solver.solve(state);
  Estimation fresh(recording, recording.training(), problem.setup());
  LevenbergMarquardt fresh_solver(fresh, options);
  VectorXd fresh_state = fresh.pack(values);
  const SolveSummary& expected = fresh_solver.solve(fresh_state);
  CHECK(same_bits(state, fresh_state));
  CHECK(summary.outcome == expected.outcome);
  CHECK(summary.iterations == expected.iterations);
  CHECK(summary.cost.chi2 == expected.cost.chi2);
  CHECK(summary.cost.doubled == expected.cost.doubled);
  CHECK(summary.history == expected.history);
  CHECK(summary.undefined_group == expected.undefined_group);
  // Residuals are of the new numbers as well.
  problem.renew(state);
  fresh.renew(fresh_state);
  problem.prepare(state);
  fresh.prepare(fresh_state);
  const auto a = problem.residuals(state), b = fresh.residuals(fresh_state);
  REQUIRE(a.size() == b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    CHECK(same_bits(a[i].raw, b[i].raw));
    CHECK(same_bits(a[i].whitened, b[i].whitened));
  }
}

}  // namespace

TEST_CASE("warm start: a robot with every type of sensor") {
  for (const NoiseMode mode :
       {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none})
    for (const LinearSolver choice : {LinearSolver::dense, LinearSolver::cholmod})
      for (const int threads : {1, 2}) {
        INFO("mode " << static_cast<int>(mode) << ", "
                     << (choice == LinearSolver::dense ? "dense" : "cholmod") << ", " << threads
                     << " threads");
        Random random(971);
        Setting s = nasty_in(mode, threads == 2 ? Loss{LossKind::huber, 2} : Loss{}, 7, 972, 5e-3);
        with_covariances(s.samples, sensor_index(s.rig, "depth"), random);
        EstimationSetup setup = s.problem->setup();
        for (const Freed& f : setup.free)
          if (choice == LinearSolver::cholmod)
            setup.priors.push_back({f.parameter, f.components[0], 0.5});
        Estimation problem(s, s.training(), setup);
        SolverOptions options;
        options.linear_solver = choice;
        options.threads = threads;
        options.max_iterations = 30;
        LevenbergMarquardt solver(problem, options);
        VectorXd once = problem.pack(s.values), twice = once;
        solver.solve(once);
        solver.solve(twice);
        CHECK(same_bits(once, twice));
        for (const double size : {1.0, 5.0, 0.0}) {
          replace(s.samples, size, random);
          compare(problem, solver, s, options, s.values);
        }
      }
}

TEST_CASE("warm start: a PR2-like robot") {
  benchmarks::RobotProblem p = benchmarks::pr2_like(20);
  for (JointSettings& j : p.rig.joints) j.sigma = 0.001;
  Random random(981);
  for (const NoiseMode mode : {NoiseMode::none, NoiseMode::latent}) {
    EstimationSetup setup = p.setup;
    setup.noise = mode;
    Estimation problem(p, p.training(), setup);
    SolverOptions options;
    LevenbergMarquardt solver(problem, options);
    VectorXd state = problem.pack(p.start);
    CHECK(solver.solve(state).outcome == Outcome::converged);
    for (int round = 0; round < 3; ++round) {
      replace(p.samples, 2, random);
      compare(problem, solver, p, options, p.start);
    }
  }
}

TEST_CASE("warm start: after solves that came to nothing") {
  Setting s = nasty_in(NoiseMode::latent, {}, 6, 991, 1e-2);
  int allowed = 1000;
  SolverOptions options;
  options.max_iterations = 6;
  options.progress = Progress([&](const Progress::News& news) { return news.iteration < allowed; });
  LevenbergMarquardt solver(*s.problem, options);
  VectorXd state = s.start();
  solver.solve(state);
  const auto compare_now = [&] { compare(*s.problem, solver, s, options, s.values); };

  // Not a number among what was measured, of a sensor with a packed kernel and of one without.
  for (const char* name : {"bc5", "laser", "kb", "tracker"}) {
    INFO(name);
    const std::vector<Sample> kept = s.samples;
    double* z = nullptr;
    for (Sample& sample : s.samples)
      for (View& v : sample.views)
        if (v.sensor == sensor_index(s.rig, name)) z = &v.z[v.z.size() - 1];
    REQUIRE(z);
    const double before = *z;
    *z = std::numeric_limits<double>::quiet_NaN();
    s.problem->reload();
    state = s.start();
    CHECK(solver.solve(state).outcome == Outcome::undefined_start);
    *z = before;
    compare_now();
  }
  allowed = 2;
  s.problem->reload();
  state = s.start();
  CHECK(solver.solve(state).outcome == Outcome::cancelled);
  allowed = 1000;
  compare_now();

  // Far away, so that steps are rejected, and back.
  Values far = s.values;
  Random random(992);
  for (auto& [key, pose] : far.targets)
    pose = to_pose(isometry(pose) * exponential(random.twist(0.05, 0.3)));
  state = s.problem->pack(far);
  solver.solve(state);
  compare_now();
}

}  // namespace warm_start_test
