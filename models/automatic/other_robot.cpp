#include "other_robot.h"

#include <algorithm>
#include <cmath>

#include "../evidence/evidence.h"
#include "../rig/scales.h"
#include "other_models.h"
#include "width_problem.h"

namespace kincal {
namespace {

constexpr int kRobotRounds = 60;      // to learn widths
constexpr int kRobotFits = 2;         // each with the widths of the one before
constexpr double kOtherRobot = 0.01;  // odds beforehand

/// S_i of a member; 0: S_i = s_i.
double other_start(const ParameterTable& table, const Member& member, const VectorXd& initial) {
  const Component& c = member.component;
  const Parameter& p = table.all[c.parameter];
  if (p.kind != ParameterKind::joint_origin || c.index > 2) return 0;
  const Pose origin = get_pose(initial, p.start);
  const double length = (origin.rotation.transpose() * origin.translation)(c.index),
               start = std::min(scales(p.kind, p.units[c.index]).usual, std::abs(length));
  return start > member.start ? start : 0;
}

/// Moves the lengths of `start` into a group of their own, behind the others, whose width is known.
void split(const std::map<Component, double>& start, FitWidths& of) {
  for (size_t i = 0; i < of.columns.size(); ++i) {
    const auto found = start.find(of.columns[i]);
    if (found == start.end()) continue;
    of.problem.group[i] = of.problem.groups;
    of.problem.start(static_cast<Eigen::Index>(i)) = found->second;
  }
  of.problem.known.resize(of.problem.groups++, 0);
  of.problem.known.push_back(1);
}

/// The setup with priors of these widths.
EstimationSetup with_widths(EstimationSetup setup, const FitWidths& of, const VectorXd& factor) {
  for (Prior& prior : setup.priors) {
    const auto found = std::find(of.columns.begin(), of.columns.end(),
                                 Component{prior.parameter, prior.component});
    const auto i = found - of.columns.begin();
    if (found != of.columns.end() && of.problem.group[i] >= 0)
      prior.sigma = of.problem.start(i) * factor(of.problem.group[i]);
  }
  return setup;
}

/// m: by how far a fit's values are from another's, by unknown.
VectorXd moved(const ParameterTable& table, const FitWidths& of, const VectorXd& initial,
               const VectorXd& from, const VectorXd& to) {
  VectorXd out(static_cast<Eigen::Index>(of.columns.size()));
  for (Eigen::Index i = 0; i < out.size(); ++i)
    out(i) = of.problem.start(i) > 0 ? value_of(table, initial, to, of.columns[i]) -
                                           value_of(table, initial, from, of.columns[i])
                                     : value_of(table, from, to, of.columns[i]);
  return out;
}

/// The alternative for a group, in which these lengths have widths of their own.
OtherRobot other_robot(const Recording& recording, const GroupedFit& fitted, int group,
                       const std::map<Component, double>& start, const FitOptions& options) {
  OtherRobot out;
  FitWidths other = fitted.at;
  split(start, other);
  VectorXd factor(other.problem.groups);
  factor << fitted.widths.factor, 1;
  factor(group) = 1;  // these lengths may have widened it
  Widths widths = learn_widths(other.problem, factor, kRobotRounds);
  const double hyperprior = log_hyperprior(fitted.at.problem, fitted.widths.factor);
  const auto gains = [&](double gain) {
    gain += log_hyperprior(other.problem, widths.factor) - hyperprior;
    const double odds = kOtherRobot * std::expm1(std::min(gain, 100.0));
    out.probability = odds > 0 ? odds / (1 + odds) : 0;
    return odds > 0;
  };
  if (!widths.defined || !gains(log_evidence(other.problem, widths.factor) -
                                log_evidence(fitted.at.problem, fitted.widths.factor)))
    return out;
  Values values = fitted.values;
  EstimationSetup setup;
  for (int k = 0; k < kRobotFits && widths.defined; ++k) {
    setup = with_widths(fitted.setup, other, widths.factor);
    const Fit done = fit(recording, recording.training(), setup, values, options);
    if (!done.defined()) return {};
    values = done.values;
    other = width_problem(recording,
                          data_problem(recording, done.problem->setup(), values, fitted.groups),
                          fitted.groups);
    split(start, other);
    widths = learn_widths(other.problem, widths.factor, kRobotRounds);
  }
  if (!widths.defined) return {};
  const std::vector<int> samples = recording.training();
  const EstimationSetup own = with_widths(fitted.setup, fitted.at, fitted.widths.factor);
  setup = with_widths(setup, other, widths.factor);
  if (!gains(evidence({{recording, samples, setup, values}}).log -
             evidence({{recording, samples, own, fitted.values}}).log))
    return {};
  const Selection selection = hold(other.problem, widths);
  const VectorXd m =
      moved(recording.table, other, fitted.setup.initial, fitted.values.shared, values.shared);
  out.second_moment = selection.second_moment + m * m.transpose();
  const WidthGroup& of = fitted.groups.groups[group];
  for (const std::vector<Member>* members : {&of.members, &of.unseen})
    for (const Member& member : *members) {
      const auto found = start.find(member.component);
      out.width.push_back(found == start.end() ? 0 : found->second);
    }
  return out;
}

}  // namespace

double OtherRobot::mixed(size_t k, double own) const {
  if (width[k] == 0) return own;
  return std::sqrt(covering_variance(Eigen::Vector2d(own * own, width[k] * width[k]),
                                     Eigen::Vector2d(1 - probability, probability)));
}

std::vector<OtherRobot> other_robots(const Recording& recording, const GroupedFit& fitted,
                                     const FitOptions& options) {
  std::vector<OtherRobot> out;
  if (some_suit_no_size(recording, fitted.at, fitted.setup.initial)) return out;
  for (int g = 0; g < fitted.at.problem.groups; ++g) {
    std::map<Component, double> start;
    const WidthGroup& group = fitted.groups.groups[g];
    for (const std::vector<Member>* members : {&group.members, &group.unseen})
      for (const Member& m : *members)
        if (const double other = other_start(recording.table, m, fitted.setup.initial); other > 0)
          start[m.component] = other;
    if (start.empty() || !fitted.at.problem.learns(g)) continue;
    OtherRobot one = other_robot(recording, fitted, g, start, options);
    one.group = g;
    if (one.probability > 0) out.push_back(std::move(one));
  }
  return out;
}

}  // namespace kincal
