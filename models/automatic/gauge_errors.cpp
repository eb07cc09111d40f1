#include "gauge_errors.h"

#include <algorithm>

#include "../../solver/decompositions.h"
#include "width_problem.h"

namespace kincal {
namespace {

constexpr double kUnknown = 1;  // m, rad: as of poses that may be anywhere (evidence.h)

std::vector<Component> fixed_by(const std::vector<Gauge>& gauges) {
  std::vector<Component> out;
  for (const Gauge& gauge : gauges)
    if (!gauge.given) out.push_back(gauge.fixed);
  return out;
}

/// The quadratic model of a fit with further components free.
FitWidths with_free(const FitWithGroups& fit, const std::vector<Component>& further) {
  EstimationSetup setup = fit.setup;
  for (const Component& c : further) merge(setup.free, {{c.parameter, {c.index}}});
  for (Freed& f : setup.free) std::sort(f.components.begin(), f.components.end());
  return width_problem(*fit.recording, data_problem(*fit.recording, setup, fit.values, fit.groups),
                       fit.groups);
}

}  // namespace

void add_gauges(const FitWithGroups& fit, const std::vector<Gauge>& gauges, Prediction& out) {
  const std::vector<Component> fixed = fixed_by(gauges);
  if (fixed.empty()) return;
  const FitWidths at = with_free(fit, fixed);
  const WidthProblem& p = at.problem;
  std::vector<int> z, others;
  for (const Component& c : fixed)
    z.push_back(
        static_cast<int>(std::find(at.columns.begin(), at.columns.end(), c) - at.columns.begin()));
  VectorXd slope = p.gradient;
  MatrixXd h = p.normal;
  for (int i = 0; i < p.start.size(); ++i) {
    if (std::count(z.begin(), z.end(), i)) continue;
    others.push_back(i);
    if (p.start(i) == 0) continue;
    const double width = p.start(i) * (p.group[i] < 0 ? 1 : fit.factor(p.group[i]));
    h(i, i) += 1 / (width * width);
    slope(i) += p.at(i) / (width * width);
  }
  const MatrixXd follow = -solve_symmetric(MatrixXd(h(others, others)), MatrixXd(h(others, z)));
  // (Where the data say nothing, rounding says less than that.)
  const SymmetricEigen told = symmetric_eigen(MatrixXd(h(z, z)) + h(z, others) * follow);
  const MatrixXd left = told.vectors *
                        (told.values.cwiseMax(0).array() + 1 / (kUnknown * kUnknown))
                            .inverse()
                            .matrix()
                            .asDiagonal() *
                        told.vectors.transpose();
  const VectorXd step = -left * (slope(z) + follow.transpose() * slope(others));
  const auto all = out.covariance.rows(), more = static_cast<Eigen::Index>(fixed.size());
  MatrixXd moved = MatrixXd::Zero(all + more, more);  // by each that was fixed, by column
  moved.bottomRows(more).setIdentity();
  for (size_t i = 0; i < others.size(); ++i) {
    const auto found = std::find(out.columns.begin(), out.columns.end(), at.columns[others[i]]);
    if (found != out.columns.end())
      moved.row(found - out.columns.begin()) = follow.row(static_cast<Eigen::Index>(i));
  }
  MatrixXd covariance = MatrixXd::Zero(all + more, all + more);
  covariance.topLeftCorner(all, all) = out.covariance;
  out.covariance = covariance + moved * (left + step * step.transpose()) * moved.transpose();
  out.columns.insert(out.columns.end(), fixed.begin(), fixed.end());
}

}  // namespace kincal
