#include "gauge_errors.h"

#include <algorithm>

#include "../../solver/decompositions.h"
#include "width_problem.h"

namespace kincal {
namespace {

constexpr double kUnknown = 1;  // m, rad: as of poses that may be anywhere (evidence.h)

}  // namespace

void add_gauges(const FitWithGroups& fit, const std::vector<Gauge>& gauges, Prediction& out) {
  WidthGroup fixed{"gauges", {}, {}, true};
  for (const Gauge& gauge : gauges)
    if (!gauge.given) fixed.members.push_back({gauge.fixed, kUnknown});
  if (fixed.members.empty()) return;
  FitWithGroups with = fit;
  with.groups.groups.push_back(std::move(fixed));
  const auto group = static_cast<int>(fit.groups.groups.size());
  const FitWidths at =
      width_problem(*fit.recording,
                    data_problem(*fit.recording, fit.setup, fit.values, with.groups), with.groups);
  const Beside of = beside(at.problem, fit.factor, group, group);
  WidthProblem one = alone(at.problem, of);
  const VectorXd as_it_is = VectorXd::Ones(1);
  Posterior known = posterior(one, as_it_is, true);
  if (!known.defined) {  // by rounding: the data say nothing
    one.normal.setZero();
    one.gradient.setZero();
    known = posterior(one, as_it_is, true);
  }
  const VectorXd step = known.value - one.at;
  const MatrixXd follow = -solve_symmetric(of.h, at.problem.normal(of.others, of.own));
  const auto all = out.covariance.rows(), more = static_cast<Eigen::Index>(of.own.size());
  MatrixXd moved = MatrixXd::Zero(all + more, more);  // by each that was fixed, by column
  moved.bottomRows(more).setIdentity();
  for (size_t i = 0; i < of.others.size(); ++i) {
    const auto found = std::find(out.columns.begin(), out.columns.end(), at.columns[of.others[i]]);
    if (found != out.columns.end())
      moved.row(found - out.columns.begin()) = follow.row(static_cast<Eigen::Index>(i));
  }
  MatrixXd covariance = MatrixXd::Zero(all + more, all + more);
  covariance.topLeftCorner(all, all) = out.covariance;
  out.covariance =
      covariance + moved * (known.covariance + step * step.transpose()) * moved.transpose();
  for (const int i : of.own) out.columns.push_back(at.columns[i]);
}

}  // namespace kincal
