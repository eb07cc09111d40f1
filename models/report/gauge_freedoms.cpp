#include "gauge_freedoms.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "../analysis/gauges.h"
#include "../rig/geometry.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"

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

/// Parameters that say where something on this body is: poses, and origins of its fixed joints.
std::set<int> poses_on(const Solution& solution, int body) {
  const Rig& rig = solution.rig();
  std::set<int> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    if (body_of(rig.tree, rig.sensors[s].link) == body)
      out.insert(solution.table().sensor_mount[s]);
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0 && body_of(rig.tree, rig.targets[t].link) == body)
      out.insert(solution.table().target_mount[t]);
  for (size_t j = 0; j < rig.tree.joints.size(); ++j)
    if (const Joint& joint = rig.tree.joints[j];
        joint.is_rigid() && body_of(rig.tree, joint.child) == body)
      out.insert(solution.table().joint_origin[j]);
  return out;
}

/// True if this body moves against the base and no sensor or target is on a body further out.
bool is_end(const Rig& rig, int body) {
  const Tree& tree = rig.tree;
  if (body == common_body(rig)) return false;
  std::vector<int> links;
  for (const Sensor& s : rig.sensors) links.push_back(s.link);
  for (const Target& t : rig.targets)
    if (t.link >= 0) links.push_back(t.link);
  return std::none_of(links.begin(), links.end(), [&](int link) {
    for (int b = body_of(tree, link); b != body && tree.joint_above[b] >= 0;) {
      b = body_of(tree, tree.joints[tree.joint_above[b]].parent);
      if (b == body) return true;
    }
    return false;
  });
}

/// The unknowns, their second moments, and which of them are choices: columns of numbers of joints
/// that nothing but a prior decides, and that move what is seen, in any posture, as the other
/// unknowns do.
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
  const auto rank = [&](Eigen::Index i) {  // 0: no number of a joint that could be a choice
    const Component& c = columns[static_cast<size_t>(i)];
    const ParameterKind kind = table.all[c.parameter].kind;
    if (!undecided.count(table.name(c))) return 0;
    if (kind == ParameterKind::joint_origin &&
        !solution.rig().tree.joints[table.all[c.parameter].owner].moves())
      return 0;
    return kind == ParameterKind::joint_origin ? 1 : kind == ParameterKind::joint_offset ? 2 : 0;
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

/// The choices against the poses at one end.
std::optional<ZeroGauge> zero_gauge(const Solution& solution, const Choices& now,
                                    const std::set<int>& at_end) {
  constexpr double kMatters = 0.1;  // share of a pose's variance
  const ParameterTable& table = solution.table();
  const MatrixXd& all = now.moments;
  std::vector<Eigen::Index> poses;  // loose ones
  for (size_t i = 0; i < now.columns.size(); ++i)
    if (const Eigen::Index at = static_cast<Eigen::Index>(i);
        at_end.count(now.columns[i].parameter) &&
        all(at, at) > open_variance(table, now.columns[i]))
      poses.push_back(at);
  std::vector<std::pair<double, Eigen::Index>> shares;
  for (const Eigen::Index f : now.numbers) {  // how much of the poses hangs on each by itself
    double share = 0;
    for (const Eigen::Index p : poses)
      if (all(f, f) > 0) share = std::max(share, all(p, f) * all(p, f) / (all(p, p) * all(f, f)));
    if (share > kMatters) shares.push_back({share, f});
  }
  if (shares.empty()) return std::nullopt;
  std::stable_sort(shares.begin(), shares.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  ZeroGauge out;
  const Parameter& first = table.all[now.columns[shares[0].second].parameter];
  out.joint = solution.rig().tree.joints[first.owner].name;
  out.is_zero = first.kind == ParameterKind::joint_offset;
  for (const auto& s : shares) out.numbers.push_back(table.name(now.columns[s.second]));
  for (const Eigen::Index p : poses)
    out.sigma[now.columns[p]] = std::sqrt(std::max(0.0, now.left(p, p)));
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
  const Tree& tree = solution.rig().tree;
  const std::vector<Component>& columns =
      solution.prediction ? solution.prediction->columns : solution.columns;
  const MatrixXd& moments =
      solution.prediction ? solution.prediction->covariance : solution.covariance;
  const bool loose = std::any_of(solution.parameters.begin(), solution.parameters.end(),
                                 [](const ParameterEstimate& e) {
                                   for (size_t c = 0; e.pose && c < e.sigma.size(); ++c)
                                     if (e.sigma[c] > pose_scales(e.units[c]).yardstick)
                                       return true;
                                   return false;
                                 });
  if (!loose || moments.rows() != static_cast<Eigen::Index>(columns.size())) return {};
  const std::set<std::string> names = undecided(report);
  Choices now = {columns, moments, choices_among(solution, columns, names)};
  for (const Eigen::Index i : now.numbers) condition(now.left, i);
  GaugeFreedoms out;
  out.sizes = sizes_to_measure(solution, now);
  const int base = common_body(solution.rig());
  if (auto zero = zero_gauge(solution, now, poses_on(solution, base)))
    out.zeros.push_back(std::move(*zero));
  std::set<int> ends;
  for (const Joint& joint : tree.joints)
    if (joint.moves() && is_end(solution.rig(), joint.child))
      ends.merge(poses_on(solution, joint.child));
  if (auto zero = zero_gauge(solution, now, ends)) {
    zero->at_base = false;
    out.zeros.push_back(std::move(*zero));
  }
  return out;
}

const GaugeFreedoms& gauge_freedoms(const Report& report) {
  static const GaugeFreedoms nothing;
  return report.gauge_freedoms ? *report.gauge_freedoms : nothing;
}

JudgedSigma judged_sigma(const GaugeFreedoms& freedoms, const ParameterEstimate& e, size_t c) {
  JudgedSigma out{e.sigma[c], nullptr, ""};
  const Component component = {e.parameter, static_cast<int>(c)};
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

std::string measure_words(const std::string& size) {
  return "measure " + size + " over several fields, write it into the rig, and fix it (`fix`)";
}

}  // namespace kincal
