#include "bent_boards.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../fitting/fit.h"
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

constexpr size_t kEnough = 1000;  // samples that tell whether a board is bent

/// A Bend is what a board's two numbers were worth.
struct Bend {
  Eigen::Vector2d warp{0, 0};
  double fell = 0;  // chi2, with the loss
  double pull = 0;  // the largest move of a number that counts, in its sigmas
};

/// By how many of its sigmas a number moves, at most, between shared values of the solution's
/// layout.
double largest_move(const Solution& solution, const VectorXd& from, const VectorXd& to) {
  double out = 0;
  for (const ParameterEstimate& e : solution.parameters) {
    const Parameter& p = solution.table().all[e.parameter];
    const VectorXd move =
        e.pose ? VectorXd(log_se3(inverse(get_pose(from, p.start)) * get_pose(to, p.start)))
               : VectorXd((to - from).segment(p.start, static_cast<Eigen::Index>(e.value.size())));
    for (size_t c = 0; c < e.sigma.size(); ++c)
      if (e.freed[c] && e.sigma[c] > 0)
        out = std::max(out, std::abs(move(static_cast<Eigen::Index>(c))) / e.sigma[c]);
  }
  return out;
}

/// Twice the cost of a few steps of a recording from values, which then are where they led.
double solved(const Recording& recording, const EstimationSetup& setup, Values& values) {
  FitOptions options;
  options.solver.max_iterations = 10;
  Fit found = fit(recording, recording.training(), setup, std::move(values), options);
  values = std::move(found.values);
  return found.summary.cost.doubled;
}

/// The last step once more, from where it ended, with the warp of a board free as well. The rig
/// that has it has one parameter more, in the middle. Of many samples every so-manieth is enough:
/// what these say by themselves is found first then.
Bend bend_of(const Solution& solution, int target) {
  const std::vector<int> all = solution.training();
  const size_t every = (all.size() + kEnough - 1) / kEnough;
  std::vector<Sample> samples;
  Values values;  // by samples as they count here
  values.shared = solution.values.shared;
  for (size_t i = 0; i < all.size(); i += every) {
    const int from = all[i], to = static_cast<int>(samples.size());
    for (auto it = solution.values.targets.lower_bound({from, 0});
         it != solution.values.targets.end() && it->first.first == from; ++it)
      values.targets[{to, it->first.second}] = it->second;
    for (auto it = solution.values.errors.lower_bound({from, 0});
         it != solution.values.errors.end() && it->first.first == from; ++it)
      values.errors[{to, it->first.second}] = it->second;
    samples.push_back(solution.samples()[from]);
  }
  EstimationSetup setup = solution.setup;
  const Recording flat = solution.recording->with_samples(std::move(samples));
  const double share = static_cast<double>(all.size()) / static_cast<double>(flat.samples.size());
  const double before = every == 1 ? 2 * solution.cost : solved(flat, setup, values);
  const VectorXd shared_before = values.shared;

  Rig rig = solution.rig();
  rig.targets[target].bulge = warp_shapes(rig.targets[target].layout);
  const Recording bent = flat.with_rig(std::move(rig));
  const int warp = bent.table.target_warp[target];
  const int start = bent.table.all[warp].start;
  const auto moved = [&](int parameter) { return parameter < warp ? parameter : parameter + 1; };
  const auto widened = [&](const VectorXd& shared) {
    VectorXd out = VectorXd::Zero(shared.size() + 2);
    out.head(start) = shared.head(start);
    out.tail(shared.size() - start) = shared.tail(shared.size() - start);
    return out;
  };
  for (Freed& f : setup.free) f.parameter = moved(f.parameter);
  for (Prior& p : setup.priors) p.parameter = moved(p.parameter);
  if (setup.initial.size() > 0) setup.initial = widened(setup.initial);
  const auto at = std::find_if(setup.free.begin(), setup.free.end(),
                               [&](const Freed& f) { return f.parameter > warp; });
  values.shared = widened(values.shared);
  setup.free.insert(at, {warp, {0, 1}});
  Bend out;
  out.fell = share * (before - solved(bent, setup, values));
  out.warp = values.shared.segment<2>(start);
  VectorXd shared(solution.values.shared.size());
  shared << values.shared.head(start), values.shared.tail(shared.size() - start);
  out.pull = largest_move(solution, shared_before, shared);
  return out;
}

}  // namespace

Notices bent_boards(const Solution& solution, const Residuals& residuals) {
  constexpr double kClear = 18, kLeast = 2e-5, kMost = 0.05;  // chi2 of two; m; of the diagonal
  constexpr double kPull = 2;                                 // in sigmas: less does no harm
  Notices out;
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
    Notice bent =
        make_notice(NoticeKind::bent, {Subject::target(target.name)},
                    "target " + quoted(target.name) +
                        text(" is not flat: with a warp of %.2g mm along x and %.2g mm along y",
                             1e3 * bend.warp.x(), 1e3 * bend.warp.y()) +
                        text(" chi2 falls from %.4g to %.4g", solution.chi2_data, left),
                    "",
                    "mount it on a flat plate; or write \"warp: [0, 0]\" in its entry of the rig "
                    "to estimate the warp");
    bent.chi2_as_is = solution.chi2_data;
    bent.chi2_corrected = left;
    out.push_back(std::move(bent));
  }
  return out;
}

}  // namespace kincal
