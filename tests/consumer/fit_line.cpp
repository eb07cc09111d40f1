// The solver alone, without robots: parallel parabolas y = height_k + slope x + bend x^2 through
// points of three series. The heights are private to their series, slope and bend are shared; all
// must come out as planted, with dense and with sparse reduced systems.
#include <kincal/solver.h>

#include <cmath>
#include <cstdio>
#include <vector>

using namespace kincal;

namespace {

constexpr int kSeries = 3, kPoints = 5;
constexpr double kSlope = 0.7, kBend = -0.2;
double height(int series) { return 1.5 * series - 1; }

/// State: slope, bend, then the heights.
class Parabolas final : public Problem {
 public:
  Parabolas() {
    GroupShape shape;
    shape.private_size = 1;
    shape.columns = {0, 1};
    shape.rows = kPoints;
    groups_.assign(kSeries, shape);
  }
  int shared_size() const override { return 2; }
  const std::vector<GroupShape>& groups() const override { return groups_; }
  void set_workers(int) override {}
  void prepare(const VectorXd&) override {}
  bool evaluate(int group, const VectorXd& state, int, Cost& cost) const override {
    cost.doubled = cost.chi2 = rows(group, state).col(3).squaredNorm();
    return true;
  }
  bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                 Cost& cost) const override {
    const MatrixXd a = rows(group, state), gram = a.transpose() * a;
    for (int i = 0; i < 4; ++i) to.rows[i] += gram(0, i);
    for (int i = 0; i < 2; ++i) {
      for (int j = 0; j <= i; ++j)
        to.shared[to.origin[to.row[j]] + to.row[i]] += gram(1 + i, 1 + j);
      to.gradient[to.row[i]] += gram(1 + i, 3);
    }
    return evaluate(group, state, worker, cost);
  }
  bool square_root(int group, const VectorXd& state, int, MatrixXd& out) const override {
    out = rows(group, state);
    return true;
  }
  void retract(const VectorXd& state, const VectorXd& shared_step, const VectorXd& private_step,
               VectorXd& moved) const override {
    moved = state;
    moved.head(2) += shared_step;
    moved.tail(kSeries) += private_step;
  }
  bool renew(const VectorXd&) override { return false; }

 private:
  /// [by the height, by slope and bend, residual]
  static MatrixXd rows(int series, const VectorXd& state) {
    MatrixXd out(kPoints, 4);
    for (int i = 0; i < kPoints; ++i) {
      const double x = i - 1, measured = height(series) + kSlope * x + kBend * x * x;
      out.row(i) << 1, x, x * x, state(2 + series) + state(0) * x + state(1) * x * x - measured;
    }
    return out;
  }
  std::vector<GroupShape> groups_;
};

bool recovers(LinearSolver choice) {
  Parabolas problem;
  SolverOptions options;
  options.linear_solver = choice;
  LevenbergMarquardt solver(problem, options);
  VectorXd state = VectorXd::Zero(2 + kSeries);
  const SolveSummary& summary = solver.solve(state);
  double worst = std::max(std::abs(state(0) - kSlope), std::abs(state(1) - kBend));
  for (int k = 0; k < kSeries; ++k) worst = std::max(worst, std::abs(state(2 + k) - height(k)));
  const Observability seen = observe(problem, state);
  std::printf("%s: %d iterations, worst error %.2g, rank %ld of %ld rows\n", solver.linear_solver(),
              summary.iterations, worst, seen.rank, seen.rows);
  return summary.outcome == Outcome::converged && worst < 1e-9 && seen.rank == 2 + kSeries &&
         seen.rows == kSeries * kPoints;
}

}  // namespace

int main() {
  const bool dense = recovers(LinearSolver::dense), sparse = recovers(LinearSolver::cholmod);
  return dense && sparse ? 0 : 1;
}
