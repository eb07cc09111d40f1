// solver/threads.h, and that results do not depend on the number of threads.
//
// Proves: a ThreadPool does every piece exactly once, those of a share in their order, with workers
// in range, over very many short runs and pieces of any number; what a piece throws comes out, and
// nobody waits for ever; the estimation of a PR2-like robot and of the nasty one ends in the same
// bits for 1, 2, 3 and 5 threads, dense, sparse and CHOLMOD, with and without joint noise. Does not
// prove: that there are no data races (run this under a thread sanitizer), nor speed.
#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <memory>
#include <new>

#include "../../benchmarks/pr2_like.h"
#include "../../models/estimation/estimation.h"
#include "../../solver/levenberg_marquardt.h"
#include "../../solver/threads.h"
#include "../fixtures/problem.h"

namespace threads_test {

using namespace kincal;
using namespace kincal::fixture;

TEST_CASE("threads: a crew does every piece once, many times", "[slow]") {
  for (const int threads : {1, 2, 3, 4}) {
    ThreadPool pool(threads);
    REQUIRE(pool.size() == threads);
    bool in_range = true;
    long wrong = 0;
    for (int round = 0; round < 4000; ++round) {
      const int pieces = round % 23;
      int done[23] = {};  // without atomics: whoever returns from run() sees what was written in it
      std::atomic<bool> good{true};
      pool.run(pieces, 1 + round % ThreadPool::kMostShares, [&](int piece, int worker) {
        if (piece < 0 || piece >= pieces || worker < 0 || worker >= threads) good = false;
        ++done[piece];
      });
      in_range = in_range && good;
      for (int k = 0; k < 23; ++k) wrong += done[k] != (k < pieces);
    }
    INFO(threads << " threads");
    CHECK(in_range);
    CHECK(wrong == 0);
  }
}

TEST_CASE("threads: pauses between runs, so that threads fall asleep, and crews that never work") {
  for (int round = 0; round < 30; ++round) {
    ThreadPool idle(1 + round % 4);
    ThreadPool pool(1 + round % 3);
    for (int again = 0; again < 3; ++again) {
      std::atomic<int> sum{0};
      pool.run(10, 2, [&](int piece, int) { sum += piece; });
      CHECK(sum == 45);
      std::this_thread::sleep_for(std::chrono::microseconds(round % 2 ? 300 : 0));
    }
  }
}

TEST_CASE("threads: pieces may wait for those before them in their share") {
  for (const int threads : {1, 2, 3, 5})
    for (int shares = 1; shares <= ThreadPool::kMostShares; ++shares) {
      ThreadPool pool(threads);
      constexpr int kPieces = 13;
      int in_order = 0;
      for (int round = 0; round < 300; ++round) {
        std::atomic<int> turn[ThreadPool::kMostShares];
        for (int k = 0; k < shares; ++k) turn[k] = ThreadPool::first_of(k, kPieces, shares);
        pool.run(kPieces, shares, [&](int piece, int) {
          int share = shares - 1;
          while (ThreadPool::first_of(share, kPieces, shares) > piece) --share;
          while (turn[share] != piece) std::this_thread::yield();  // a test that ends proves it
          ++turn[share];
        });
        for (int k = 0; k < shares; ++k)
          in_order += turn[k] == ThreadPool::first_of(k + 1, kPieces, shares);
      }
      INFO(threads << " threads, " << shares << " shares");
      CHECK(in_order == 300 * shares);
    }
}

TEST_CASE("threads: no two workers with the same number are at work at once") {
  for (const int threads : {2, 3, 4}) {
    ThreadPool pool(threads);
    std::vector<std::atomic<int>> busy(threads);
    std::atomic<bool> twice{false};
    for (int round = 0; round < 500; ++round)
      pool.run(16, 4, [&](int, int worker) {
        if (busy[worker]++ != 0) twice = true;
        --busy[worker];
      });
    CHECK_FALSE(twice);
  }
}

TEST_CASE("threads: what work throws comes out of run(), and the crew goes on") {
  for (const int threads : {1, 2, 4}) {
    ThreadPool pool(threads);
    for (int round = 0; round < 200; ++round) {
      const auto fail = [&](int piece, int) {
        if (piece == round % 16) throw std::bad_alloc();
      };
      CHECK_THROWS_AS(pool.run(16, 3, fail), std::bad_alloc);
      std::atomic<int> done{0};
      pool.run(16, 3, [&](int, int) { ++done; });
      CHECK(done == 16);
    }
  }
}

namespace {

/// A problem whose memory ends in one sample.
struct Failing final : Problem {
  Estimation& real;

  explicit Failing(Estimation& problem) : real(problem) {}
  int shared_size() const override { return real.shared_size(); }
  const std::vector<GroupShape>& groups() const override { return real.groups(); }
  int prior_group() const override { return real.prior_group(); }
  void set_workers(int count) override { real.set_workers(count); }
  void prepare(const VectorXd& state) override { real.prepare(state); }
  bool evaluate(int group, const VectorXd& state, int worker, Cost& cost) const override {
    return real.evaluate(group, state, worker, cost);
  }
  bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                 Cost& cost) const override {
    if (group == 5) throw std::bad_alloc();
    return real.linearise(group, state, worker, to, cost);
  }
  void begin_piece(int worker) const override { real.begin_piece(worker); }
  void end_piece(int worker, const GroupEquations& to) const override {
    real.end_piece(worker, to);
  }
  bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const override {
    return real.square_root(group, state, worker, rows);
  }
  void retract(const VectorXd& state, const VectorXd& shared_step, const VectorXd& private_step,
               VectorXd& moved) const override {
    real.retract(state, shared_step, private_step, moved);
  }
  bool renew(const VectorXd& state) override { return real.renew(state); }
};

}  // namespace

TEST_CASE("threads: a problem that throws in one sample throws, with any number of threads") {
  const Setting setting = nasty(24, 7, true, {"sensor/pin/pose"}, 0.01);
  for (const int threads : {1, 2, 4}) {
    Failing problem(*setting.problem);
    SolverOptions options;
    options.threads = threads;
    LevenbergMarquardt solver(problem, options);
    VectorXd state = setting.start();
    CHECK_THROWS_AS(solver.solve(state), std::bad_alloc);
  }
}

namespace {

/// Solves with 1, 2, 3 and 5 threads, each twice with one solver; all must end in the same bits.
template <class Make>
void same_bits(const Make& make, LinearSolver choice) {
  VectorXd first;
  std::vector<std::pair<double, double>> history;
  for (const int threads : {1, 2, 3, 5}) {
    auto made = make();  // (what the problem refers to, the problem, its start)
    SolverOptions options;
    options.threads = threads;
    options.linear_solver = choice;
    options.max_iterations = 50;
    LevenbergMarquardt solver(*std::get<1>(made), options);
    for (int again = 0; again < 2; ++again) {
      VectorXd state = std::get<2>(made);
      const SolveSummary& summary = solver.solve(state);
      CHECK(summary.iterations > 1);
      if (first.size() == 0) {
        first = state;
        history = summary.history;
        continue;
      }
      INFO(threads << " threads, solve " << again);
      REQUIRE(state.size() == first.size());
      CHECK(std::memcmp(state.data(), first.data(),
                        sizeof(double) * static_cast<size_t>(state.size())) == 0);
      CHECK(summary.history == history);
    }
  }
}

}  // namespace

TEST_CASE("threads: a PR2-like robot, the same bits") {
  auto robot = std::make_shared<benchmarks::RobotProblem>(benchmarks::pr2_like(60));
  for (JointSettings& j : robot->rig.joints) j.sigma = 0.001;
  for (const NoiseMode mode : {NoiseMode::none, NoiseMode::latent})
    for (const LinearSolver choice :
         {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod}) {
      INFO("mode " << static_cast<int>(mode) << ", linear solver " << static_cast<int>(choice));
      same_bits(
          [&] {
            EstimationSetup setup = robot->setup;
            setup.noise = mode;
            auto problem = std::make_unique<Estimation>(*robot, robot->training(), setup);
            const VectorXd start = problem->pack(robot->start);
            return std::make_tuple(robot, std::move(problem), start);
          },
          choice);
    }
}

TEST_CASE("threads: a robot with every type of sensor, the same bits") {
  for (const NoiseMode mode : {NoiseMode::none, NoiseMode::latent})
    for (const LinearSolver choice :
         {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod})
      for (const Loss& loss : {Loss{LossKind::none, 1}, Loss{LossKind::cauchy, 2}}) {
        INFO("mode " << static_cast<int>(mode) << ", linear solver " << static_cast<int>(choice));
        same_bits(
            [&] {
              const std::shared_ptr<Setting> s(new Setting(
                  nasty_in(mode, loss, 9, 961, 1e-2)));  // in place: problems refer to its parts
              const VectorXd start = s->start();
              Estimation* problem = s->problem.get();
              return std::make_tuple(s, problem, start);
            },
            choice);
      }
}

}  // namespace threads_test
