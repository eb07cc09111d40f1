#include "base_choice.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "../rig/geometry.h"
#include "../rig/numbers.h"

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

/// Parameters that say where something at the base is.
std::set<int> poses_at_base(const Solution& solution) {
  const Rig& rig = solution.rig();
  const int base = body_of(rig.tree, rig.base);
  std::set<int> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    if (body_of(rig.tree, rig.sensors[s].link) == base)
      out.insert(solution.table().sensor_mount[s]);
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0 && body_of(rig.tree, rig.targets[t].link) == base)
      out.insert(solution.table().target_mount[t]);
  return out;
}

}  // namespace

std::optional<BaseChoice> base_choice(const Report& report) {
  const Solution& solution = report.solution;
  solution.refresh();
  const ParameterTable& table = solution.table();
  const Tree& tree = solution.rig().tree;
  const std::vector<Component>& columns =
      solution.prediction ? solution.prediction->columns : solution.columns;
  MatrixXd left = solution.prediction ? solution.prediction->covariance : solution.covariance;
  if (left.rows() != static_cast<Eigen::Index>(columns.size())) return std::nullopt;
  const std::set<std::string> open = undecided(report);
  const std::set<int> poses = poses_at_base(solution);
  std::vector<Eigen::Index> first, at_base;
  for (size_t i = 0; i < columns.size(); ++i) {
    const Parameter& p = table.all[columns[i].parameter];
    if (poses.count(columns[i].parameter)) at_base.push_back(static_cast<Eigen::Index>(i));
    const bool of_joint =
        p.kind == ParameterKind::joint_offset || p.kind == ParameterKind::joint_origin;
    if (of_joint && tree.joints[p.owner].moves() && open.count(table.name(columns[i])) &&
        body_of(tree, tree.joints[p.owner].parent) == body_of(tree, solution.rig().base))
      first.push_back(static_cast<Eigen::Index>(i));
  }
  if (first.empty() || at_base.empty()) return std::nullopt;
  BaseChoice out;
  double most = 0;
  for (const Eigen::Index f : first) {  // how much of what is at the base hangs on each by itself
    double share = 0;
    for (const Eigen::Index p : at_base)
      if (left(p, p) > 0 && left(f, f) > 0)
        share = std::max(share, left(p, f) * left(p, f) / (left(p, p) * left(f, f)));
    if (!(share > most)) continue;
    most = share;
    const Parameter& p = table.all[columns[f].parameter];
    out.joint = tree.joints[p.owner].name;
    out.number = table.name(columns[f]);
    out.is_zero = p.kind == ParameterKind::joint_offset;
  }
  for (const Eigen::Index f : first)
    if (left(f, f) > 0) left -= (left.col(f) * left.row(f) / left(f, f)).eval();
  for (const Eigen::Index p : at_base) out.sigma[columns[p]] = std::sqrt(std::max(0.0, left(p, p)));
  return out.joint.empty() ? std::nullopt : std::optional(std::move(out));
}

double sigma_to_judge(const std::optional<BaseChoice>& choice, const ParameterEstimate& e,
                      size_t c) {
  const double open = e.units[c] == "rad" ? 30 * kPi / 180 : 0.3;
  if (!choice || !(e.sigma[c] < open)) return e.sigma[c];
  const auto found = choice->sigma.find({e.parameter, static_cast<int>(c)});
  return found == choice->sigma.end() ? e.sigma[c] : found->second;
}

}  // namespace kincal
