#include "bent_boards.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../../solver/levenberg_marquardt.h"
#include "../rig/geometry.h"
#include "../rig/targets.h"
#include "../rig/words.h"

namespace kincal {
namespace {

/// Sums over the views of one board.
struct Screen {
  double along = 0, all = 0;  // of t; of squared residuals
  long shapes = 0, residuals = 0;

  bool stands_out() const {
    if (shapes == 0 || all == 0) return false;
    const auto n = static_cast<double>(shapes);
    return along / n > (1 + 4 * std::sqrt(2 / n)) * all / static_cast<double>(residuals);
  }
};

/// By target: boards that are flat in the rig.
std::map<int, Screen> screened(const Solution& solution, const Residuals& residuals) {
  const Rig& rig = solution.rig();
  std::map<int, Screen> out;
  std::map<int, Eigen::Matrix2Xd> shapes;
  for (const ViewResiduals& r : residuals.after) {
    const Target& target = rig.targets[r.view->target];
    if (!target.grid || target.bulge.cols() > 0 || !solution.samples()[r.sample].train ||
        rig.sensors[r.view->sensor].model->measures_pose() || !r.whitened.allFinite())
      continue;
    Eigen::Matrix2Xd& shape = shapes[r.view->target];
    if (shape.cols() == 0) shape = warp_shapes(target.layout);
    const auto n =
        r.view->ids.empty() ? shape.cols() : static_cast<Eigen::Index>(r.view->ids.size());
    if (n == 0 || r.whitened.size() % n != 0) continue;
    const Eigen::Index rows = r.whitened.size() / n;
    const Eigen::Map<const MatrixXd> w(r.whitened.data(), rows, n);
    Eigen::Matrix2Xd b(2, n);
    for (Eigen::Index i = 0; i < n; ++i)
      b.col(i) = shape.col(r.view->ids.empty() ? i : r.view->ids[static_cast<size_t>(i)]);
    b.colwise() -= b.rowwise().mean().eval();
    Screen& screen = out[r.view->target];
    for (int k = 0; k < 2; ++k) {
      const double size = b.row(k).squaredNorm();
      if (size < 1e-12) continue;
      screen.along += (w * b.row(k).transpose()).squaredNorm() / size;
      screen.shapes += rows;
    }
    screen.all += w.squaredNorm();
    screen.residuals += w.size();
  }
  return out;
}

/// A Bend is what a board's two numbers were worth.
struct Bend {
  Eigen::Vector2d warp{0, 0};
  double fell = 0;  // chi2, with the loss
  double pull = 0;  // the largest move of a number that counts, in its sigmas
};

/// By how many of its sigmas a number moves, at most, from the solution's values to others of the
/// same layout.
double largest_move(const Solution& solution, const VectorXd& shared) {
  double out = 0;
  for (const ParameterEstimate& e : solution.parameters) {
    const Parameter& p = solution.table().all[e.parameter];
    const VectorXd move =
        e.pose ? VectorXd(log_se3(inverse(*e.pose) * get_pose(shared, p.start)))
               : VectorXd(shared.segment(p.start, static_cast<Eigen::Index>(e.value.size())) -
                          solution.values.shared.segment(
                              p.start, static_cast<Eigen::Index>(e.value.size())));
    for (size_t c = 0; c < e.sigma.size(); ++c)
      if (e.freed[c] && e.sigma[c] > 0)
        out = std::max(out, std::abs(move(static_cast<Eigen::Index>(c))) / e.sigma[c]);
  }
  return out;
}

/// The last step once more, from where it ended, with the warp of a board free as well. The rig
/// that has it has one parameter more, in the middle.
Bend bend_of(const Solution& solution, int target) {
  Rig rig = solution.rig();
  rig.targets[target].bulge = warp_shapes(rig.targets[target].layout);
  const Recording bent(std::move(rig), solution.samples());
  const int warp = bent.table.target_warp[target];
  const int before = bent.table.all[warp].start;
  const auto moved = [&](int parameter) { return parameter < warp ? parameter : parameter + 1; };
  const auto widened = [&](const VectorXd& shared) {
    VectorXd out = VectorXd::Zero(shared.size() + 2);
    out.head(before) = shared.head(before);
    out.tail(shared.size() - before) = shared.tail(shared.size() - before);
    return out;
  };
  EstimationSetup setup = solution.setup;
  for (Freed& f : setup.free) f.parameter = moved(f.parameter);
  for (Prior& p : setup.priors) p.parameter = moved(p.parameter);
  if (setup.initial.size() > 0) setup.initial = widened(setup.initial);
  const auto at = std::find_if(setup.free.begin(), setup.free.end(),
                               [&](const Freed& f) { return f.parameter > warp; });
  Values values = solution.values;
  values.shared = widened(values.shared);
  SolverOptions options;
  options.max_iterations = 10;
  setup.free.insert(at, {warp, {0, 1}});
  Estimation problem(bent, solution.training(), setup);
  VectorXd state = problem.pack(values);
  problem.renew(state);
  Bend out;
  out.fell = 2 * solution.cost - LevenbergMarquardt(problem, options).solve(state).cost.doubled;
  problem.unpack(state, values);
  out.warp = values.shared.segment<2>(before);
  VectorXd shared(solution.values.shared.size());
  shared << values.shared.head(before), values.shared.tail(shared.size() - before);
  out.pull = largest_move(solution, shared);
  return out;
}

}  // namespace

std::vector<Finding> bent_boards(const Solution& solution, const Residuals& residuals) {
  constexpr double kClear = 18, kLeast = 2e-5, kMost = 0.05;  // chi2 of two; m; of the diagonal
  constexpr double kPull = 2;                                 // in sigmas: less does no harm
  std::vector<Finding> out;
  for (const auto& entry : screened(solution, residuals)) {
    if (!entry.second.stands_out()) continue;
    const Target& target = solution.rig().targets[entry.first];
    const Bend bend = bend_of(solution, entry.first);
    const double left = solution.chi2_data - bend.fell,
                 noise = std::max(1.0, left / std::max(1.0, solution.dof_data)),
                 size = bend.warp.cwiseAbs().maxCoeff(),
                 diagonal = target.square * (target.layout.rowwise().maxCoeff() -
                                             target.layout.rowwise().minCoeff())
                                                .norm();
    if (!(bend.fell > kClear * noise) ||
        !(bend.fell > 0.5 * (solution.chi2_data - solution.dof_data)) || size < kLeast ||
        size > kMost * diagonal || bend.pull < kPull)
      continue;
    out.push_back(
        {"bent",
         "Target " + quoted(target.name) +
             text(" is not flat: with its middle standing out by %.2g mm along x and %.2g mm along "
                  "y",
                  1e3 * bend.warp.x(), 1e3 * bend.warp.y()) +
             text(" chi2 falls from %.4g to %.4g. Print it on something flat; or write \"warp: [0, "
                  "0]\" in its entry of the rig, and the bend is estimated.",
                  solution.chi2_data, left),
         {target.name},
         solution.chi2_data,
         left});
  }
  return out;
}

}  // namespace kincal
