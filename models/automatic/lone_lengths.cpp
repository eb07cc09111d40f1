#include "lone_lengths.h"

#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../rig/scales.h"

namespace kincal {
namespace {

constexpr double kOtherSize = 3, kTold = 5;  // sigmas
constexpr double kHeldSize = 1e-5;           // of its starting width
constexpr double kOwnWidth = 10;             // times the starting width, to begin with
constexpr double kNotAlone = 10;             // odds beforehand
constexpr double kRoughly = 0.4;             // of a lone length, before widths are learned anew
constexpr int kLoneRounds = 60;

bool is_size(const Parameter& p) {
  return p.kind == ParameterKind::square || p.kind == ParameterKind::baseline;
}

/// The unknown of the largest length but those of joint `owner`; -1: there is none. Only what the
/// data tell by `told` sigmas.
Eigen::Index largest_length(const Recording& recording, const std::vector<Component>& columns,
                            const WidthProblem& problem, const Posterior& at, double told,
                            int owner) {
  Eigen::Index largest = -1;
  for (Eigen::Index i = 0; i < at.value.size(); ++i) {
    const Parameter& p = recording.table.all[columns[i].parameter];
    const double size = std::abs(at.value(i));
    if (problem.group[i] >= 0 && p.kind == ParameterKind::joint_origin && columns[i].index < 3 &&
        p.owner != owner && size > told * std::sqrt(at.variance(i)) &&
        (largest < 0 || size > std::abs(at.value(largest))))
      largest = i;
  }
  return largest;
}

/// The values with the sizes put to what the rig has, at the same widths.
VectorXd with_sizes_held(const Posterior& at, const std::vector<Eigen::Index>& sizes) {
  const auto n = static_cast<Eigen::Index>(sizes.size());
  MatrixXd across(at.value.size(), n), between(n, n);
  VectorXd off(n);
  for (Eigen::Index j = 0; j < n; ++j) {
    across.col(j) = at.covariance.col(sizes[j]);
    off(j) = at.value(sizes[j]);
    for (Eigen::Index i = 0; i < n; ++i) between(i, j) = at.covariance(sizes[i], sizes[j]);
  }
  return at.value - across * solve_symmetric(between, off);
}

/// Learns the widths with one for this number alone, in a group that `problem` gets behind the
/// others.
Widths learn_with_own_width(WidthProblem& problem, Eigen::Index number, const Widths& widths) {
  problem.group[number] = problem.groups++;
  VectorXd factor(problem.groups);
  factor << widths.factor, kOwnWidth;
  return learn_widths(problem, factor, kLoneRounds);
}

}  // namespace

std::optional<double> lone_length_gain(const Recording& recording, const WidthProblem& problem,
                                       const std::vector<Component>& columns,
                                       const Widths& widths) {
  const Eigen::Index length =
      largest_length(recording, columns, problem, widths.posterior, kTold, -1);
  if (length < 0) return std::nullopt;
  WidthProblem alone = problem;
  const Widths found = learn_with_own_width(alone, length, widths);
  if (!found.defined) return std::nullopt;
  return log_evidence(alone, found.factor) - log_evidence(problem, widths.factor) -
         std::log(kNotAlone);
}

std::optional<LoneAlternative> lone_length(const Recording& recording, const WidthProblem& problem,
                                           const std::vector<Component>& columns,
                                           const Widths& widths) {
  LoneAlternative out;
  WidthProblem held = problem;
  std::vector<Eigen::Index> sizes;
  for (Eigen::Index i = 0; i < problem.at.size(); ++i) {
    if (problem.group[i] < 0 || !is_size(recording.table.all[columns[i].parameter])) continue;
    held.group[i] = -1;
    held.start(i) *= kHeldSize;
    sizes.push_back(i);
    if (std::abs(widths.posterior.value(i)) > kOtherSize * std::sqrt(widths.posterior.variance(i)))
      out.length.sizes.push_back(recording.table.name(columns[i]));
  }
  if (out.length.sizes.empty()) return std::nullopt;
  const double least = scales(ParameterKind::joint_origin, "m").least;
  Posterior roughly = widths.posterior;  // (to learn widths takes longer)
  roughly.value = with_sizes_held(widths.posterior, sizes);
  const Eigen::Index largest = largest_length(recording, columns, held, roughly, 0, -1);
  if (largest < 0 || std::abs(roughly.value(largest)) < kRoughly * least) return std::nullopt;
  Widths found = learn_widths(held, widths.factor, kLoneRounds);
  if (!found.defined) return std::nullopt;
  const Eigen::Index length = largest_length(recording, columns, held, found.posterior, kTold, -1);
  if (length < 0) return std::nullopt;
  found = learn_with_own_width(held, length, widths);
  if (!found.defined) return std::nullopt;
  const int joint = recording.table.all[columns[length].parameter].owner;
  const Eigen::Index next = largest_length(recording, columns, held, found.posterior, 0, joint);
  const double off = std::abs(found.posterior.value(length));
  if (off < least || (next >= 0 && off < kLoneTimes * std::abs(found.posterior.value(next))))
    return std::nullopt;
  out.length.length = recording.table.name(columns[length]);
  out.length.gain = log_evidence(held, found.factor) - log_evidence(problem, widths.factor);
  if (!std::isfinite(out.length.gain)) return std::nullopt;
  out.moved = found.posterior.value - widths.posterior.value;
  out.probability = 1 / (1 + kNotAlone * std::exp(-out.length.gain));
  return out;
}

}  // namespace kincal
