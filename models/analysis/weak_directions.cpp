#include "weak_directions.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "../../solver/decompositions.h"
#include "../../solver/observability.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/selection.h"
#include "../rig/words.h"
#include "reasons.h"

namespace kincal {
namespace {

constexpr double kListed = 0.02;  // part of a direction, in yardsticks
constexpr double kStrong = 0.99;  // correlation
constexpr double kPriorShare = 0.9;

EstimationSetup without_priors(EstimationSetup setup) {
  setup.priors.clear();
  return setup;
}

/// The shared unknowns of the last step: what each is, and what its sigma is measured by.
struct SharedColumns {
  std::vector<std::string> names, units;
  VectorXd prior, yardstick,
      sigma;  // sigma of the prior, 0: none; the yardstick; sigma in the result
  std::map<std::string, int> by_name;

  int count() const { return static_cast<int>(names.size()); }
  /// The column with the largest part of a direction in yardsticks.
  int largest(const VectorXd& d) const {
    Eigen::Index i;
    d.cwiseQuotient(yardstick).cwiseAbs().maxCoeff(&i);
    return static_cast<int>(i);
  }
};

SharedColumns make_columns(const ParameterTable& table, const Solution& solution) {
  const std::vector<Component> components = components_of(solution.setup.free);
  const int n = static_cast<int>(components.size());
  SharedColumns out;
  out.prior = VectorXd::Zero(n);
  out.yardstick.resize(n);
  out.sigma.resize(n);
  for (int i = 0; i < n; ++i) {
    out.names.push_back(table.name(components[i]));
    out.units.push_back(table.unit(components[i]));
    out.by_name[out.names[i]] = i;
    for (const Prior& p : solution.setup.priors)
      if (p.parameter == components[i].parameter && p.component == components[i].index)
        out.prior(i) = p.sigma;
    out.yardstick(i) = scales(table, components[i], solution.values.shared).yardstick;
    if (out.prior(i) > 0) out.yardstick(i) = std::min(out.yardstick(i), out.prior(i));
    out.sigma(i) = std::sqrt(std::max(0.0, solution.covariance(i, i)));
  }
  return out;
}

std::vector<PriorDecides> where_priors_decide(const SharedColumns& columns) {
  std::vector<PriorDecides> out;
  for (int i = 0; i < columns.count(); ++i)
    if (columns.prior(i) > 0 && columns.sigma(i) > kPriorShare * columns.prior(i))
      out.push_back({columns.names[i], columns.units[i], columns.prior(i), columns.sigma(i)});
  return out;
}

/// Weak directions as they are found; reasons come later.
struct Found {
  std::vector<WeakDirection> weak;
  std::vector<WeakColumns> directions;  // the same, by column
  size_t null_directions =
      0;  // how many of them nothing, or a prior alone, determines: the first ones

  /// `first`: the column that would be held, with its sigmas from the data alone and with priors.
  void add(const SharedColumns& columns, VectorXd d, int first, double sigma,
           double sigma_with_priors) {
    d /= d(first);
    std::vector<std::pair<double, int>> order;
    for (int i = 0; i < columns.count(); ++i) {
      const double size = std::abs(d(i)) / columns.yardstick(i) * columns.yardstick(first);
      if (i == first || size > kListed) order.push_back({i == first ? -1e300 : -size, i});
    }
    std::stable_sort(order.begin(), order.end());
    WeakDirection named;
    named.sigma = sigma;
    named.sigma_with_priors = sigma_with_priors;
    named.unit = columns.units[first];
    WeakColumns by_column;
    by_column.determined = std::isfinite(sigma);
    for (const auto& o : order) {
      named.parameters.push_back({columns.names[o.second], d(o.second)});
      by_column.columns.push_back(o.second);
    }
    by_column.coefficients = std::move(d);
    weak.push_back(std::move(named));
    directions.push_back(std::move(by_column));
  }
};

/// The covariance and null directions of the data without any prior.
struct DataAlone {
  MatrixXd covariance;
  std::vector<char> lost;  // by column: it takes part in a null direction
};

/// Adds the null directions to `found`: those of the result, then those that only priors hold.
DataAlone find_null_directions(const Recording& recording, const Solution& solution,
                               const SharedColumns& columns, Found& found) {
  const int n = columns.count();
  DataAlone out{solution.covariance, std::vector<char>(n, 0)};
  for (const Direction& direction : solution.unobservable) {
    VectorXd d = VectorXd::Zero(n);
    for (const auto& c : direction) d(columns.by_name.at(c.first)) = c.second;
    found.add(columns, d, columns.largest(d), kNan, kNan);
  }
  for (const ParameterEstimate& e : solution.parameters)
    for (size_t c = 0; c < e.sigma.size(); ++c) {
      const auto column =
          columns.by_name.find(e.components[c].empty() ? e.name : e.name + "." + e.components[c]);
      if (column != columns.by_name.end() && !std::isfinite(e.sigma[c]))
        out.lost[column->second] = 1;
    }
  if (!solution.setup.priors.empty()) {
    ProblemAt at(recording, without_priors(solution.setup), solution.values);
    const Observability data = observe(at.problem, at.state);
    out.covariance = data.covariance;
    for (const auto& direction : data.directions) {
      VectorXd d = VectorXd::Zero(n);
      for (const auto& c : direction) d(c.first) = c.second;
      bool known = false;  // among the result's own
      for (const WeakColumns& other : found.directions)
        known =
            known ||
            std::abs(d.cwiseQuotient(columns.yardstick)
                         .normalized()
                         .dot(other.coefficients.cwiseQuotient(columns.yardstick).normalized())) >
                0.999;
      if (known) continue;
      const int largest = columns.largest(d);
      found.add(columns, d, largest, kNan, columns.sigma(largest));
    }
    for (int i = 0; i < n; ++i) out.lost[i] = out.lost[i] || data.unobservable[i];
  }
  found.null_directions = found.directions.size();
  return out;
}

std::vector<Correlation> strong_correlations(const SharedColumns& columns, const DataAlone& data) {
  const MatrixXd& covariance = data.covariance;
  std::vector<Correlation> out;
  for (int i = 0; i < columns.count(); ++i)
    for (int j = 0; j < i; ++j) {
      if (data.lost[i] || data.lost[j] || !(covariance(i, i) > 0) || !(covariance(j, j) > 0))
        continue;
      const double c = covariance(i, j) / std::sqrt(covariance(i, i) * covariance(j, j));
      if (std::abs(c) > kStrong) out.push_back({columns.names[j], columns.names[i], c});
    }
  std::stable_sort(out.begin(), out.end(), [](const Correlation& a, const Correlation& b) {
    return std::abs(a.correlation) > std::abs(b.correlation);
  });
  return out;
}

/// The columns that would have to be held, the worst first, so that no other one is weak.
std::vector<int> find_pivots(const SharedColumns& columns, const DataAlone& data) {
  std::vector<int> pivots;
  std::vector<char> lost = data.lost;
  MatrixXd left = data.covariance;  // what is left of it with the pivots held
  while (true) {
    int worst = -1;
    double most = 1;
    for (int i = 0; i < columns.count(); ++i)
      if (!lost[i] && std::sqrt(std::max(0.0, left(i, i))) / columns.yardstick(i) > most) {
        most = std::sqrt(left(i, i)) / columns.yardstick(i);
        worst = i;
      }
    if (worst < 0) break;
    const VectorXd column = left.col(worst);
    left -= column * column.transpose() / column(worst);
    lost[worst] = 1;
    pivots.push_back(worst);
  }
  return pivots;
}

/// Adds a direction for each pivot: how the others follow it.
void add_pivots(const SharedColumns& columns, const MatrixXd& covariance,
                const std::vector<int>& pivots, Found& found) {
  const int n = columns.count(), k = static_cast<int>(pivots.size());
  if (k == 0) return;
  MatrixXd columns_of(n, k), among(k, k);
  for (int a = 0; a < k; ++a) columns_of.col(a) = covariance.col(pivots[a]);
  for (int a = 0; a < k; ++a) among.row(a) = columns_of.row(pivots[a]);
  const MatrixXd regression = solve_symmetric(among, columns_of.transpose()).transpose();
  for (int a = 0; a < k; ++a)
    found.add(columns, regression.col(a), pivots[a], std::sqrt(covariance(pivots[a], pivots[a])),
              columns.sigma(pivots[a]));
}

/// The covariance of the data alone if the joints' readings were exact; nullopt where they are
/// taken as exact.
std::optional<MatrixXd> with_exact_readings(const Recording& recording, const Solution& solution) {
  if (solution.setup.noise == NoiseMode::none) return std::nullopt;
  EstimationSetup setup = without_priors(solution.setup);
  setup.noise = NoiseMode::none;
  ProblemAt at(recording, setup, solution.values);
  return observe(at.problem, at.state).covariance;
}

/// Rewrites the reason of a weak direction if the noise of the joints' readings is it. `exact`:
/// sigma of its first parameter without that noise.
void name_joint_noise(WeakDirection& weak, double exact) {
  if (weak.reason != "unknown" && weak.reason != "free_targets") return;
  if (!(exact < 0.5 * weak.sigma)) return;
  std::vector<std::string> involved;
  for (const auto& p : weak.parameters) involved.push_back(p.first);
  weak.why =
      listed(involved) + (involved.size() > 1 ? " move together" : " moves") +
      (weak.reason == "free_targets" ? ", and free targets go along" : "") +
      ": the noise of the joint readings hides the information about it. With exact readings " +
      involved[0] + " would be known to " +
      (weak.unit == "m"     ? length_text(exact)
       : weak.unit == "rad" ? angle_text(exact)
                            : text("%.2g", exact));
  weak.cure =
      "record more samples in more varied postures, fix a sensor or mounted target, or state "
      "smaller joint sigmas if they are too large; or fix " +
      involved[0];
  weak.reason = "joint_noise";
}

/// Gives every direction its reason.
void give_reasons(const Recording& recording, const Solution& solution, Found& found) {
  Scene scene(recording, without_priors(solution.setup), solution.values);
  std::vector<VectorXd> coefficients;
  for (const WeakColumns& d : found.directions) coefficients.push_back(d.coefficients);
  const std::vector<Effects> effects = effects_of(scene, coefficients);
  std::optional<MatrixXd> exact;
  if (found.directions.size() > found.null_directions)
    exact = with_exact_readings(recording, solution);
  for (size_t k = 0; k < found.directions.size(); ++k) {
    WeakDirection& weak = found.weak[k];
    const Reason reason = find_reason(scene, found.directions[k], effects[k]);
    weak.reason = reason.kind;
    weak.why = reason.why;
    weak.cure = reason.cure;
    weak.joints = reason.joints;
    if (k < found.null_directions || !exact) continue;
    const int first = found.directions[k].columns[0];
    name_joint_noise(weak, std::sqrt(std::max(0.0, (*exact)(first, first))));
  }
}

}  // namespace

std::string Explanation::text() const {
  std::string out;
  for (const WeakDirection& w : weak)
    out += w.parameters[0].first +
           (std::isfinite(w.sigma)
                ? kincal::text(": known to %.3g ", w.sigma) + w.unit + " from the data alone"
                : ": not determined by the data") +
           "\n  why: " + w.why + "\n  cure: " + w.cure + "\n";
  return out;
}

Explanation explain(const Linearisation& at) {
  const Solution& solution = at.solution;
  Explanation out;
  const SharedColumns columns = make_columns(solution.table(), solution);
  if (columns.count() == 0) return out;
  out.prior_decides = where_priors_decide(columns);
  Found found;
  const DataAlone data = find_null_directions(*solution.recording, solution, columns, found);
  out.correlations = strong_correlations(columns, data);
  add_pivots(columns, data.covariance, find_pivots(columns, data), found);
  if (!found.directions.empty()) give_reasons(*solution.recording, solution, found);
  out.weak = std::move(found.weak);
  return out;
}

}  // namespace kincal
