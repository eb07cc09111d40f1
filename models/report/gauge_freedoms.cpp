#include "gauge_freedoms.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "../analysis/gauges.h"
#include "../rig/geometry.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/words.h"

namespace kincal {
namespace {

/// Names of components that only a prior or the width of a group decides.
std::set<std::string> undecided(const Report& report) {
  std::set<std::string> out;
  for (const PriorDecides& p : report.explanation.prior_decides) out.insert(p.name);
  for (const AutomaticGroup& g : report.automatic) {
    for (const AutomaticNumber& n : g.numbers)
      if (n.undetermined()) out.insert(n.name);
    for (const AutomaticNumber& n : g.unseen) out.insert(n.name);
  }
  return out;
}

/// The unknowns, their second moments, and which of them are choices: columns of components of
/// joints that move targets before sensors as the other unknowns do, in every posture. Components
/// that only a prior determines come first.
struct Choices {
  const std::vector<Component>& columns;
  const MatrixXd& moments;
  std::vector<Eigen::Index> numbers;
  MatrixXd left = moments;  // given the choices
};

/// Takes an unknown as known.
void condition(MatrixXd& moments, Eigen::Index i) {
  if (moments(i, i) > 0) moments -= (moments.col(i) * moments.row(i) / moments(i, i)).eval();
}

std::vector<Eigen::Index> choices_among(const Solution& solution,
                                        const std::vector<Component>& columns,
                                        const std::set<std::string>& undecided) {
  constexpr double kNegligible = 5e-3;  // of a column's length, as in rig/geometry.h
  const ParameterTable& table = solution.table();
  const auto rank = [&](Eigen::Index i) {  // 0: no component of a joint that could be a choice
    const Component& c = columns[static_cast<size_t>(i)];
    const ParameterKind kind = table.all[c.parameter].kind;
    const bool origin = kind == ParameterKind::joint_origin;
    if (!(origin || kind == ParameterKind::joint_offset) ||
        (origin && !solution.rig().tree.joints[table.all[c.parameter].owner].moves()))
      return 0;
    return !undecided.count(table.name(c)) ? 1 : origin ? 2 : 3;
  };
  std::vector<Eigen::Index> order(columns.size()), out;
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](Eigen::Index a, Eigen::Index b) { return rank(a) < rank(b); });
  MatrixXd left = squared_motions(*solution.recording, solution.values.shared, columns);
  const VectorXd whole = left.diagonal();
  for (const Eigen::Index i : order)
    if (left(i, i) > kNegligible * kNegligible * whole(i))
      left -= (left.col(i) * left.row(i) / left(i, i)).eval();
    else if (rank(i) > 0 && whole(i) > 0)
      out.push_back(i);
  return out;
}

/// The variance from which a number of a pose is known so badly that it is said.
double open_variance(const ParameterTable& table, const Component& c) {
  return std::pow(pose_scales(table.all[c.parameter].units[c.index]).yardstick, 2);
}

/// The choices on which loose poses depend, of those at the base and of others.
std::vector<ZeroGauge> zero_gauges(const Solution& solution, const Choices& now) {
  constexpr double kMatters = 0.1;  // share of a pose's variance
  const ParameterTable& table = solution.table();
  const Tree& tree = solution.rig().tree;
  const int base = common_body(solution.rig());
  const MatrixXd& all = now.moments;
  ZeroGauge gauges[2];  // at the base, behind the last joints
  gauges[1].at_base = false;
  const auto component = [&](Eigen::Index i) { return now.columns[static_cast<size_t>(i)]; };
  const auto joint_of = [&](Eigen::Index f) { return table.all[component(f).parameter].owner; };
  const auto sits_at_base = [&](Eigen::Index p) {  // what has this pose
    const Parameter& pose = table.all[component(p).parameter];
    const int link =
        pose.kind == ParameterKind::sensor_pose   ? solution.rig().sensors[pose.owner].link
        : pose.kind == ParameterKind::target_pose ? solution.rig().targets[pose.owner].link
                                                  : tree.joints[pose.owner].parent;
    return body_of(tree, link) == base;
  };
  struct Share {
    double largest;
    Eigen::Index choice;
    bool at_base;  // of the pose that has the largest
  };
  std::vector<Share> shares;
  for (const Eigen::Index f : now.numbers) shares.push_back({0, f, true});
  for (Eigen::Index p = 0; p < all.rows(); ++p) {
    if (!table.all[component(p).parameter].pose ||
        std::count(now.numbers.begin(), now.numbers.end(), p) ||
        !(all(p, p) > open_variance(table, component(p))))
      continue;
    const bool at_base = sits_at_base(p);
    bool hangs = false;
    for (Share& one : shares) {
      const Eigen::Index f = one.choice;
      const double share = all(f, f) > 0 ? all(p, f) * all(p, f) / (all(p, p) * all(f, f)) : 0;
      if (share > one.largest) one = {share, f, at_base};
      hangs = hangs || share > kMatters;
    }
    if (hangs) gauges[!at_base].sigma[component(p)] = std::sqrt(std::max(0.0, now.left(p, p)));
  }
  std::stable_sort(shares.begin(), shares.end(),
                   [](const Share& a, const Share& b) { return a.largest > b.largest; });
  for (const auto& [share, f, at_base] : shares) {
    if (!(share > kMatters)) break;
    ZeroGauge& gauge = gauges[!at_base];
    if (gauge.numbers.empty()) {
      gauge.joint = tree.joints[joint_of(f)].name;
      gauge.is_zero = table.all[component(f).parameter].kind == ParameterKind::joint_offset;
    }
    gauge.numbers.push_back(table.name(component(f)));
  }
  std::vector<ZeroGauge> out;
  for (ZeroGauge& gauge : gauges)
    if (!gauge.sigma.empty()) out.push_back(std::move(gauge));
  return out;
}

/// Sizes of targets that, were they known, would make numbers of poses known well that are not,
/// given the choices.
std::map<Component, std::string> sizes_to_measure(const Solution& solution, const Choices& now) {
  const ParameterTable& table = solution.table();
  std::map<Component, std::string> out;
  for (size_t s = 0; s < now.columns.size(); ++s) {
    if (table.all[now.columns[s].parameter].kind != ParameterKind::square) continue;
    MatrixXd known = now.left;
    condition(known, static_cast<Eigen::Index>(s));
    for (size_t i = 0; i < now.columns.size(); ++i) {
      const Component& c = now.columns[i];
      const Eigen::Index at = static_cast<Eigen::Index>(i);
      const double open = open_variance(table, c);
      if (table.all[c.parameter].pose && now.left(at, at) > open && known(at, at) <= open)
        out.insert({c, table.name(now.columns[s])});
    }
  }
  return out;
}

}  // namespace

GaugeFreedoms find_gauge_freedoms(const Report& report) {
  const Solution& solution = report.solution;
  const std::vector<Component>& columns =
      solution.prediction ? solution.prediction->columns : solution.columns;
  MatrixXd moments = solution.prediction ? solution.prediction->covariance : solution.covariance;
  const bool loose = std::any_of(solution.parameters.begin(), solution.parameters.end(),
                                 [](const ParameterEstimate& e) {
                                   for (size_t c = 0; e.pose && c < e.sigma.size(); ++c)
                                     if (e.sigma[c] > pose_scales(e.units[c]).yardstick)
                                       return true;
                                   return false;
                                 });
  if (!loose || moments.rows() != static_cast<Eigen::Index>(columns.size())) return {};
  GaugeFreedoms out;
  for (size_t i = 0; i < columns.size(); ++i)
    if (std::any_of(report.gauges.begin(), report.gauges.end(),
                    [&](const Gauge& g) { return !g.given && g.fixed == columns[i]; }))
      condition(moments, static_cast<Eigen::Index>(i));
  for (size_t i = 0; i < columns.size() && !report.gauges.empty(); ++i)
    out.fixed[columns[i]] = std::sqrt(
        std::max(0.0, moments(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i))));
  const std::set<std::string> names = undecided(report);
  Choices now = {columns, moments, choices_among(solution, columns, names)};
  for (const Eigen::Index i : now.numbers) condition(now.left, i);
  out.sizes = sizes_to_measure(solution, now);
  out.zeros = zero_gauges(solution, now);
  return out;
}

const GaugeFreedoms& gauge_freedoms(const Report& report) {
  static const GaugeFreedoms nothing;
  return report.gauge_freedoms ? *report.gauge_freedoms : nothing;
}

JudgedSigma judged_sigma(const GaugeFreedoms& freedoms, const ParameterEstimate& e, size_t c) {
  JudgedSigma out{e.sigma[c], nullptr, ""};
  const Component component = {e.parameter, static_cast<int>(c)};
  if (const auto fixed = freedoms.fixed.find(component); fixed != freedoms.fixed.end())
    out.sigma = std::min(out.sigma, fixed->second);
  if (const auto size = freedoms.sizes.find(component); size != freedoms.sizes.end())
    out.size = size->second;
  if (!(out.sigma < pose_scales(e.units[c]).open)) return out;
  for (const ZeroGauge& zero : freedoms.zeros) {
    const auto found = zero.sigma.find(component);
    if (found != zero.sigma.end() && found->second < out.sigma)
      out.sigma = found->second, out.zero = &zero;
  }
  return out;
}

std::string measure_words(const std::vector<std::string>& sizes) {
  const std::string them = sizes.size() > 1 ? "them" : "it";
  return "measure " + listed(sizes) + " over several fields, write " + them +
         " into the rig, and fix " + them + " (`fix`)";
}

}  // namespace kincal
