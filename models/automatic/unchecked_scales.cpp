#include "unchecked_scales.h"

#include <cmath>

#include "../../solver/decompositions.h"

namespace kincal {
namespace {

/// Sets of unknowns that are one length each: the scale of a sliding joint, the squares of all
/// boards (of one printer). Not what the rig's own priors say something of.
std::vector<std::vector<int>> scales_of(const Recording& recording, const FitWidths& widths) {
  std::vector<std::vector<int>> out;
  std::vector<int> squares;
  for (size_t i = 0; i < widths.columns.size(); ++i) {
    const Parameter& p = recording.table.all[widths.columns[i].parameter];
    if (widths.problem.group[i] < 0) continue;
    if (p.kind == ParameterKind::square) squares.push_back(static_cast<int>(i));
    if (p.kind == ParameterKind::joint_scale &&
        recording.rig.tree.joints[p.owner].type == JointType::prismatic)
      out.push_back({static_cast<int>(i)});
  }
  if (!squares.empty()) out.push_back(squares);
  return out;
}

/// Mounts and lenses.
bool always_estimated(const Recording& recording, const FitWidths& widths, Eigen::Index i) {
  const ParameterKind kind = recording.table.all[widths.columns[i].parameter].kind;
  return widths.problem.start(i) == 0 ||
         (widths.problem.group[i] >= 0 &&
          (kind == ParameterKind::intrinsics || kind == ParameterKind::distortion));
}

}  // namespace

std::vector<UncheckedScale> unchecked_scales(const Recording& recording, const FitWidths& widths,
                                             const VectorXd& factor, const VectorXd& sigma,
                                             const VectorXd& shared) {
  constexpr double kShare = 0.01, kSeen = 9, kMatters = 1;  // 3 sigmas; sigmas of another number
  const WidthProblem& problem = widths.problem;
  const ParameterTable& table = recording.table;
  const auto n = static_cast<Eigen::Index>(widths.columns.size());
  std::vector<UncheckedScale> out;
  for (const std::vector<int>& scaled : scales_of(recording, widths)) {
    VectorXd v = VectorXd::Zero(n);
    for (const int i : scaled) v(i) = kShare * shared(table.all[widths.columns[i].parameter].start);
    MatrixXd others = problem.normal;
    for (Eigen::Index i = 0; i < n; ++i)
      if (problem.start(i) > 0) {
        const int group = problem.group[i];
        const double width = problem.start(i) * (group >= 0 ? factor(group) : 1);
        others(i, i) += 1 / (width * width);
      }
    VectorXd pull = -(problem.normal * v);
    for (const int i : scaled) {
      others.row(i).setZero();
      others.col(i).setZero();
      others(i, i) = 1;
      pull(i) = 0;
    }
    const VectorXd moved = solve_symmetric(others, pull);
    if (!(v.dot(problem.normal * (v + moved)) < kSeen)) continue;
    Eigen::Index worst = -1;
    double most = kMatters;
    for (Eigen::Index i = 0; i < n; ++i)
      if (always_estimated(recording, widths, i) && sigma(i) > 0 &&
          std::abs(moved(i)) > most * sigma(i)) {
        most = std::abs(moved(i)) / sigma(i);
        worst = i;
      }
    if (worst < 0) continue;
    UncheckedScale one;
    for (const int i : scaled) one.scales.push_back(table.name(widths.columns[i]));
    one.worst = table.name(widths.columns[worst]);
    one.unit = table.unit(widths.columns[worst]);
    one.moved = std::abs(moved(worst));
    one.sigmas = most;
    out.push_back(std::move(one));
  }
  return out;
}

}  // namespace kincal
