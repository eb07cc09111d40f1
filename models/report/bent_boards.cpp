#include "bent_boards.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "../automatic/further.h"
#include "../rig/scales.h"
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

constexpr size_t kEnough = 1000;  // samples that show whether a board is warped

/// The fit of a solution, with the priors of its last step: of many samples a thousand, evenly
/// spread.
FitWithGroups fit_of(const Solution& solution) {
  const std::vector<int> all = solution.training();
  const size_t every = (all.size() + kEnough - 1) / kEnough;
  std::vector<Sample> samples;
  Values values;
  values.shared = solution.values.shared;
  for (size_t i = 0; i < all.size(); i += every) {
    const int from = all[i], to = static_cast<int>(samples.size());
    const auto take = [&](const auto& own, auto& taken) {
      for (auto at = own.lower_bound({from, 0}); at != own.end() && at->first.first == from; ++at)
        taken[{to, at->first.second}] = at->second;
    };
    take(solution.values.targets, values.targets);
    take(solution.values.errors, values.errors);
    samples.push_back(solution.samples()[from]);
  }
  FitWithGroups out{make_recording(solution.recording->with_samples(std::move(samples))),
                    solution.setup,
                    std::move(values),
                    {},
                    {}};
  for (const Prior& p : solution.setup.priors)
    out.groups.stated.push_back({{p.parameter, p.component}, p.sigma});
  return out;
}

/// Boards whose warp moves nothing by so many sigmas do no harm.
constexpr double kHarm = 2;

/// The screened boards that have a warp, with it: of two components, m.
std::map<int, Eigen::Vector2d> warped(const Solution& solution, const std::vector<int>& boards) {
  const FitWithGroups fit = fit_of(solution);
  FurtherModel model;
  Rig rig = solution.rig();
  for (const int t : boards) rig.targets[t].bulge = warp_shapes(rig.targets[t].layout);
  model.recording = make_recording(fit.recording->with_rig(std::move(rig)));
  model.left = std::max(1.0, solution.chi2_data / std::max(1.0, solution.dof_data));
  const ParameterTable& table = model.recording->table;
  for (const int t : boards) {
    const int warp = table.target_warp[t];
    const double width = scales(ParameterKind::warp, "m").width;
    model.groups.push_back({table.all[warp].name, {{{warp, 0}, width}, {{warp, 1}, width}}, {}});
  }
  const FurtherTrial found = try_model(fit, model, *fit.recording);
  std::map<int, Eigen::Vector2d> out;
  for (const int t : boards)
    if (const auto at = found.value.find(table.all[table.target_warp[t]].name);
        at != found.value.end() && found.moves.at(at->first) > kHarm)
      out[t] = at->second;
  return out;
}

}  // namespace

Notices bent_boards(const Solution& solution, const Residuals& residuals) {
  std::vector<int> boards;
  for (const auto& [target, screen] : screened(solution, residuals))
    if (screen.stands_out()) boards.push_back(target);
  if (boards.empty()) return {};
  Notices out;
  for (const auto& [t, warp] : warped(solution, boards)) {
    const Target& target = solution.rig().targets[t];
    out.push_back(make_notice(
        NoticeKind::bent, {Subject::target(target.name)},
        "target " + quoted(target.name) + " is not flat" +
            text(": it has a warp of about %.2g mm along x and %.2g mm along y", 1e3 * warp.x(),
                 1e3 * warp.y()),
        "",
        "mount it on a flat plate; or write \"warp: [0, 0]\" in its entry of the rig to estimate "
        "the warp"));
  }
  return out;
}

}  // namespace kincal
