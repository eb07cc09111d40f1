#include "other_models.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "../../solver/decompositions.h"
#include "../rig/scales.h"

namespace kincal {
namespace {

constexpr int kLearnRounds = 60, kFits = 3;  // of widths; of a factor in common

constexpr double kFarOfArm = 0.1;  // share of the arm's longest length
constexpr double kTold = 5;        // sigmas of a length that may be wrong alone
constexpr double kOwnWidth = 10;   // times the starting width, to begin with

// Log odds beforehand, against the groups as they are.
const double kArmScale = std::log(0.01), kLength = std::log(0.1), kPrior = std::log(0.1);

bool measures_lengths(const Sensor& sensor) {
  const MeasurementKind kind = sensor.model->measurement_kind();
  return kind == MeasurementKind::points || kind == MeasurementKind::pose ||
         kind == MeasurementKind::scan;
}

/// The farthest that a sensor measured, m. (A ball that sits in a socket measures 0: no scale.)
double farthest_measured(const Recording& recording, int sensor) {
  const MeasurementKind kind = recording.rig.sensors[sensor].model->measurement_kind();
  const size_t stride = kind == MeasurementKind::pose ? 7 : 3;
  double out = 0;
  for (const Sample& sample : recording.samples)
    for (const View& v : sample.views)
      for (size_t i = 0; v.sensor == sensor && i + stride <= v.z.size(); i += stride)
        out = std::max(out, kind == MeasurementKind::scan
                                ? std::abs(v.z[i + 2])
                                : std::hypot(v.z[i], v.z[i + 1], v.z[i + 2]));
  return out;
}

/// l: of the URDF, by unknown, in the joint's own frame; 0: no length of the arm.
VectorXd lengths_of(const Recording& recording, const FitWidths& at, const VectorXd& initial) {
  VectorXd out = VectorXd::Zero(at.problem.at.size());
  for (Eigen::Index i = 0; i < out.size(); ++i) {
    const Parameter& p = recording.table.all[at.columns[i].parameter];
    if (at.problem.group[i] < 0 || p.kind != ParameterKind::joint_origin || at.columns[i].index > 2)
      continue;
    const Pose origin = get_pose(initial, p.start);
    out(i) = (origin.rotation.transpose() * origin.translation)(at.columns[i].index);
  }
  return out;
}

std::optional<OtherModel> common_factor(const Recording& recording, const FitWidths& at,
                                        const Widths& widths, const VectorXd& initial) {
  constexpr double kStep = 0.01, kMost = 0.5;  // of m
  OtherModel out;
  out.kind = NoticeKind::arm_scale;
  const VectorXd lengths = lengths_of(recording, at, initial);
  if (!(lengths.squaredNorm() > 0)) return std::nullopt;
  for (size_t s = 0; s < recording.rig.sensors.size(); ++s)
    if (const Sensor& sensor = recording.rig.sensors[s];
        measures_lengths(sensor) && farthest_measured(recording, static_cast<int>(s)) >
                                        kFarOfArm * lengths.cwiseAbs().maxCoeff())
      out.where.push_back(Subject::sensor(sensor.name));
  if (out.where.empty()) return std::nullopt;
  const auto with = [&](double m) {
    WidthProblem counted = at.problem;
    counted.at -= m * lengths;
    return counted;
  };
  double m = 0;
  VectorXd factor = widths.factor;
  for (int k = 0; k < kFits; ++k) {
    const double below = log_evidence(with(m - kStep), factor),
                 here = log_evidence(with(m), factor),
                 above = log_evidence(with(m + kStep), factor);
    const double curvature = (2 * here - below - above) / (kStep * kStep);
    if (!(curvature > 0)) return std::nullopt;
    m += (above - below) / (2 * kStep * curvature);
    if (!(std::abs(m) < kMost)) return std::nullopt;  // so large an error is another mistake
    out.sigma = 1 / std::sqrt(curvature);
    const Widths learned = learn_widths(with(m), factor, kLearnRounds);
    if (!learned.defined) return std::nullopt;
    factor = learned.factor;
  }
  out.value = 1 + m;
  out.log_odds =
      kArmScale + log_evidence(with(m), factor) - log_evidence(at.problem, widths.factor);
  return out;
}

bool is_size(const Parameter& p) {
  return p.kind == ParameterKind::square || p.kind == ParameterKind::baseline;
}

/// The unknown of the largest length that is not of joint `owner` and is `told` sigmas off; -1:
/// there is none.
Eigen::Index largest_length(const Recording& recording, const FitWidths& of, const Posterior& at,
                            double told, int owner) {
  Eigen::Index largest = -1;
  for (Eigen::Index i = 0; i < at.value.size(); ++i) {
    const Parameter& p = recording.table.all[of.columns[i].parameter];
    const double size = std::abs(at.value(i));
    if (of.problem.group[i] >= 0 && p.kind == ParameterKind::joint_origin &&
        of.columns[i].index < 3 && p.owner != owner && size > told * std::sqrt(at.variance(i)) &&
        (largest < 0 || size > std::abs(at.value(largest))))
      largest = i;
  }
  return largest;
}

/// The values with the sizes fixed at the rig's values, at the same widths.
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
  return learn_widths(problem, factor, kLearnRounds);
}

OtherModel one_length(const Recording& recording, const Component& length, double gain) {
  OtherModel out;
  out.kind = NoticeKind::link_length;
  out.where = {Subject::parameter(recording.table.name(length))};
  out.log_odds = kLength + gain;
  return out;
}

/// The largest length that the data tell, with a width of its own.
std::optional<OtherModel> length_besides(const Recording& recording, const FitWidths& at,
                                         const Widths& widths) {
  const Eigen::Index length = largest_length(recording, at, widths.posterior, kTold, -1);
  if (length < 0) return std::nullopt;
  WidthProblem alone = at.problem;
  const Widths found = learn_with_own_width(alone, length, widths);
  if (!found.defined) return std::nullopt;
  return one_length(recording, at.columns[length],
                    log_evidence(alone, found.factor) - log_evidence(at.problem, widths.factor));
}

/// The length that may be wrong in place of sizes whose estimates are more than three sigmas from
/// the rig's values. With the sizes fixed there, its error is at least that of a mistake
/// (rig/scales.h), and 2.5 times that of any length of another joint.
std::optional<OtherModel> length_for_sizes(const Recording& recording, const FitWidths& at,
                                           const Widths& widths) {
  constexpr double kOtherSize = 3;          // sigmas
  constexpr double kHeldSize = 1e-5;        // of its starting width
  constexpr double kSingleLinkTimes = 2.5;  // as much as the lengths of other joints
  constexpr double kRoughly = 0.4;          // of a lone length, before widths are learned anew
  FitWidths held = at;
  std::vector<Eigen::Index> sizes;
  Subjects other;
  for (Eigen::Index i = 0; i < at.problem.at.size(); ++i) {
    const Component& c = at.columns[i];
    if (at.problem.group[i] < 0 || !is_size(recording.table.all[c.parameter])) continue;
    held.problem.group[i] = -1;
    held.problem.start(i) *= kHeldSize;
    sizes.push_back(i);
    if (std::abs(widths.posterior.value(i)) > kOtherSize * std::sqrt(widths.posterior.variance(i)))
      other.push_back(Subject::parameter(recording.table.name(c)));
  }
  if (other.empty()) return std::nullopt;
  const double least = scales(ParameterKind::joint_origin, "m").least;
  Posterior roughly = widths.posterior;  // (to learn widths takes longer)
  roughly.value = with_sizes_held(widths.posterior, sizes);
  const Eigen::Index largest = largest_length(recording, held, roughly, 0, -1);
  if (largest < 0 || std::abs(roughly.value(largest)) < kRoughly * least) return std::nullopt;
  Widths found = learn_widths(held.problem, widths.factor, kLearnRounds);
  if (!found.defined) return std::nullopt;
  const Eigen::Index length = largest_length(recording, held, found.posterior, kTold, -1);
  if (length < 0) return std::nullopt;
  found = learn_with_own_width(held.problem, length, widths);
  if (!found.defined) return std::nullopt;
  const int joint = recording.table.all[at.columns[length].parameter].owner;
  const Eigen::Index next = largest_length(recording, held, found.posterior, 0, joint);
  const double off = std::abs(found.posterior.value(length));
  if (off < least || (next >= 0 && off < kSingleLinkTimes * std::abs(found.posterior.value(next))))
    return std::nullopt;
  OtherModel out = one_length(
      recording, at.columns[length],
      log_evidence(held.problem, found.factor) - log_evidence(at.problem, widths.factor));
  out.value = found.posterior.value(length);
  out.where.insert(out.where.end(), other.begin(), other.end());
  out.moved = found.posterior.value - widths.posterior.value;
  return out;
}

void add_priors(const Recording& recording, const FitWidths& at, const Widths& widths,
                std::vector<OtherModel>& out) {
  constexpr double kContradicted = 3;  // times as wide, at least
  const std::vector<PriorSetting>& stated = recording.rig.priors;
  if (stated.empty()) return;
  WidthProblem problem = at.problem;
  for (size_t k = 0; k < stated.size(); ++k)
    for (const Freed& f : recording.table.find(stated[k].pattern, stated[k].where))
      for (size_t i = 0; i < at.columns.size(); ++i)
        if (problem.group[i] < 0 && problem.start(static_cast<Eigen::Index>(i)) > 0 &&
            at.columns[i].parameter == f.parameter &&
            std::count(f.components.begin(), f.components.end(), at.columns[i].index) > 0)
          problem.group[i] = problem.groups + static_cast<int>(k);
  const int first = problem.groups;
  problem.groups += static_cast<int>(stated.size());
  VectorXd as_stated = VectorXd::Ones(problem.groups), wide = as_stated;
  as_stated.head(first) = widths.factor;
  wide.tail(problem.groups - first).setConstant(kOwnWidth);
  const Widths found = learn_widths(problem, wide, kLearnRounds);
  if (!found.defined) return;
  const double gain = log_evidence(problem, found.factor) - log_evidence(problem, as_stated);
  for (size_t k = 0; k < stated.size(); ++k) {
    OtherModel one;
    one.kind = NoticeKind::prior;
    one.where = {{Subject::Kind::prior, stated[k].pattern}};
    one.value = found.factor(first + static_cast<int>(k));
    one.log_odds = kPrior + gain;
    if (one.value > kContradicted) out.push_back(std::move(one));
  }
}

}  // namespace

std::vector<OtherModel> other_models(const Recording& recording, const FitWidths& at,
                                     const Widths& widths, const VectorXd& initial) {
  std::vector<OtherModel> out;
  if (auto length = length_for_sizes(recording, at, widths)) out.push_back(std::move(*length));
  if (auto factor = common_factor(recording, at, widths, initial)) {
    out.push_back(std::move(*factor));
    if (auto length = length_besides(recording, at, widths)) out.push_back(std::move(*length));
  }
  add_priors(recording, at, widths, out);
  out.erase(std::remove_if(out.begin(), out.end(),
                           [](const OtherModel& m) { return !std::isfinite(m.log_odds); }),
            out.end());
  return out;
}

bool some_suit_no_size(const Recording& recording, const FitWidths& at, const VectorXd& initial) {
  const double far = kFarOfArm * lengths_of(recording, at, initial).lpNorm<Eigen::Infinity>();
  for (size_t s = 0; s < recording.rig.sensors.size(); ++s) {
    const Sensor& sensor = recording.rig.sensors[s];
    if (sensor.model->measurement_kind() == MeasurementKind::chain ||
        (measures_lengths(sensor) && farthest_measured(recording, static_cast<int>(s)) <= far))
      return true;
  }
  return false;
}

std::vector<const OtherModel*> told_models(const std::vector<OtherModel>& all, NoticeKind kind) {
  std::vector<const OtherModel*> out;
  for (const OtherModel& m : all)
    if (m.kind == kind &&
        (m.replaces_sizes() ? m.log_odds > -std::log(kAsLikelyOdds)
                            : m.log_odds > std::log(kFoundOdds) &&
                                  std::none_of(all.begin(), all.end(), [&](const OtherModel& o) {
                                    return o.kind != kind &&
                                           o.log_odds > m.log_odds + std::log(kAsLikelyOdds);
                                  })))
      out.push_back(&m);
  return out;
}

}  // namespace kincal
