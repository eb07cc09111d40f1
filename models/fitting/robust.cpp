#include "robust.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "../rig/numbers.h"

#include "../rig/distributions.h"

namespace kincal {
std::vector<double> robust_noise_ratios(const Rig& rig,
                                        const std::vector<ViewResiduals>& residuals) {
  std::vector<std::vector<double>> sizes(rig.sensors.size());
  for (const ViewResiduals& r : residuals)
    for (Eigen::Index i = 0; i < r.whitened.size(); ++i)
      if (std::isfinite(r.whitened(i))) sizes[r.view->sensor].push_back(std::abs(r.whitened(i)));
  std::vector<double> out(rig.sensors.size(), 1.0);
  for (size_t s = 0; s < sizes.size(); ++s)
    if (!sizes[s].empty())
      out[s] = std::max(1.4826 * median(std::move(sizes[s])),
                        rig.sensors[s].model->measurement_kind() == MeasurementKind::chain
                            ? 1.0
                            : kLeastNoiseRatio);
  return out;
}

SolveSummary solve_graduated(Estimation& problem, const Rig& rig, SolverOptions options,
                             VectorXd& state, const std::vector<double>* noise_ratios) {
  constexpr double kFall = 4, kSteady = 1.05;
  problem.renew(state);
  std::vector<double> scales = robust_noise_ratios(rig, problem.residuals(state));
  const double largest = *std::max_element(scales.begin(), scales.end());
  scales.assign(scales.size(), noise_ratios
                                   ? std::max(largest, *std::max_element(noise_ratios->begin(),
                                                                         noise_ratios->end()))
                                   : largest);
  problem.set_noise_ratios(scales);
  options.relative_decrease = 1e-3;
  options.max_iterations = 20;
  LevenbergMarquardt solver(problem, options);
  SolveSummary summary;
  for (bool steady = false; !steady;) {
    summary = uncancelled(solver.solve(state));
    if (summary.outcome == Outcome::undefined_start) return summary;
    problem.renew(state);
    const std::vector<double> seen =
        noise_ratios ? *noise_ratios : robust_noise_ratios(rig, problem.residuals(state));
    steady = true;
    for (size_t s = 0; s < scales.size(); ++s) {
      const double next = std::min(scales[s], std::max(seen[s], scales[s] / kFall));
      steady = steady && scales[s] <= kSteady * next;
      scales[s] = next;
    }
    problem.set_noise_ratios(scales);
  }
  return summary;
}

double chi2_bound(long n) {
  constexpr double kSigmas = 6;
  return chi2_quantile(normal_tail(kSigmas), static_cast<double>(n));
}

}  // namespace kincal
