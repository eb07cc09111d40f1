#include "free_zeros.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "../analysis/hand_eye.h"
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

/// Parameters that say where something on this body is.
std::set<int> poses_on(const Solution& solution, int body) {
  const Rig& rig = solution.rig();
  std::set<int> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    if (body_of(rig.tree, rig.sensors[s].link) == body)
      out.insert(solution.table().sensor_mount[s]);
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0 && body_of(rig.tree, rig.targets[t].link) == body)
      out.insert(solution.table().target_mount[t]);
  return out;
}

/// True if no joint moves below this body: what sits there is at an end.
bool is_end(const Tree& tree, int body) {
  return std::none_of(tree.joints.begin(), tree.joints.end(), [&](const Joint& joint) {
    return joint.moves() && body_of(tree, joint.parent) == body;
  });
}

/// The unknowns' second moments and names, and which of them nothing but a prior decides.
struct Undecided {
  const std::vector<Component>& columns;
  const MatrixXd& moments;
  std::set<std::string> names;
};

/// Numbers of the joints that `chosen` names, against the poses of `at_end`.
template <class Chosen>
std::optional<FreeZero> free_zero(const Solution& solution, const Undecided& now,
                                  const std::set<int>& at_end, const Chosen& chosen) {
  const ParameterTable& table = solution.table();
  const Tree& tree = solution.rig().tree;
  MatrixXd left = now.moments;
  std::vector<Eigen::Index> numbers, poses;
  for (size_t i = 0; i < now.columns.size(); ++i) {
    const Parameter& p = table.all[now.columns[i].parameter];
    if (at_end.count(now.columns[i].parameter)) poses.push_back(static_cast<Eigen::Index>(i));
    const bool of_joint =
        p.kind == ParameterKind::joint_offset || p.kind == ParameterKind::joint_origin;
    if (of_joint && chosen(tree.joints[p.owner]) && now.names.count(table.name(now.columns[i])))
      numbers.push_back(static_cast<Eigen::Index>(i));
  }
  if (numbers.empty() || poses.empty()) return std::nullopt;
  FreeZero out;
  double most = 0;
  for (const Eigen::Index f : numbers) {  // how much of the poses hangs on each by itself
    double share = 0;
    for (const Eigen::Index p : poses)
      if (left(p, p) > 0 && left(f, f) > 0)
        share = std::max(share, left(p, f) * left(p, f) / (left(p, p) * left(f, f)));
    if (!(share > most)) continue;
    most = share;
    const Parameter& p = table.all[now.columns[f].parameter];
    out.joint = tree.joints[p.owner].name;
    out.number = table.name(now.columns[f]);
    out.is_zero = p.kind == ParameterKind::joint_offset;
  }
  for (const Eigen::Index f : numbers)
    if (left(f, f) > 0) left -= (left.col(f) * left.row(f) / left(f, f)).eval();
  for (const Eigen::Index p : poses)
    out.sigma[now.columns[p]] = std::sqrt(std::max(0.0, left(p, p)));
  return out.joint.empty() ? std::nullopt : std::optional(std::move(out));
}

}  // namespace

std::vector<FreeZero> free_zeros(const Report& report) {
  const Solution& solution = report.solution;
  solution.refresh();
  const Tree& tree = solution.rig().tree;
  const Undecided now = {
      solution.prediction ? solution.prediction->columns : solution.columns,
      solution.prediction ? solution.prediction->covariance : solution.covariance,
      undecided(report)};
  if (now.moments.rows() != static_cast<Eigen::Index>(now.columns.size())) return {};
  std::vector<FreeZero> out;
  const int base = body_of(tree, solution.rig().base);
  const auto first = [&](const Joint& joint) {
    return joint.moves() && body_of(tree, joint.parent) == base;
  };
  if (auto zero = free_zero(solution, now, poses_on(solution, base), first))
    out.push_back(std::move(*zero));
  for (const Joint& joint : tree.joints) {
    if (!joint.moves() || body_of(tree, joint.parent) == base || !is_end(tree, joint.child))
      continue;
    const auto last = [&](const Joint& other) { return &other == &joint; };
    if (auto zero = free_zero(solution, now, poses_on(solution, joint.child), last)) {
      zero->at_base = false;
      out.push_back(std::move(*zero));
    }
  }
  return out;
}

JudgedSigma judged_sigma(const std::vector<FreeZero>& zeros, const ParameterEstimate& e, size_t c) {
  JudgedSigma out{e.sigma[c], nullptr};
  const double open = e.units[c] == "rad" ? 30 * kPi / 180 : 0.3;
  if (!(out.sigma < open)) return out;
  for (const FreeZero& zero : zeros) {
    const auto found = zero.sigma.find({e.parameter, static_cast<int>(c)});
    if (found != zero.sigma.end() && found->second < out.sigma) out = {found->second, &zero};
  }
  return out;
}

std::string height_to_hold(const Report& report, const ParameterEstimate& e, size_t c) {
  constexpr double kAlong = 0.3;  // a length whose share along the axes is as large
  const Solution& solution = report.solution;
  const Rig& rig = solution.rig();
  const std::optional<Vector3d> up = only_turning_axis(rig.tree);
  if (!up || c > 2) return "";
  const auto along = [&](const ParameterEstimate& pose, size_t component) {
    const Parameter& p = solution.table().all[pose.parameter];
    const bool sensor = p.kind == ParameterKind::sensor_pose;
    if (!pose.pose || (!sensor && p.kind != ParameterKind::target_pose)) return 0.0;
    const int link = sensor ? rig.sensors[p.owner].link : rig.targets[p.owner].link;
    if (link < 0) return 0.0;
    return std::abs(up->dot((turned_at_zero(rig.tree, link) * pose.pose->rotation).col(component)));
  };
  if (along(e, c) < kAlong) return "";
  std::string hold;
  double most = 0;
  for (const ParameterEstimate& pose : solution.parameters)
    for (size_t i = 0; i < 3 && i < pose.sigma.size(); ++i)
      if (const double now = along(pose, i); pose.freed[i] && now > most + 1e-3)
        most = now, hold = pose.component_name(i);
  return hold;
}

}  // namespace kincal
