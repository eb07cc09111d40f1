#include "arm_scale.h"

#include <algorithm>
#include <cmath>

namespace kincal {
namespace {

constexpr int kScaleRounds = 60, kFits = 3;

bool measures_lengths(const Sensor& sensor) {
  const MeasurementKind kind = sensor.model->measurement_kind();
  return kind == MeasurementKind::points || kind == MeasurementKind::pose ||
         kind == MeasurementKind::scan;
}

/// l: of the URDF, by unknown, in the joint's own frame; 0: no length of the arm.
VectorXd lengths_of(const Recording& recording, const WidthProblem& problem,
                    const std::vector<Component>& columns, const VectorXd& initial) {
  VectorXd out = VectorXd::Zero(problem.at.size());
  for (Eigen::Index i = 0; i < out.size(); ++i) {
    const Parameter& p = recording.table.all[columns[i].parameter];
    if (problem.group[i] < 0 || p.kind != ParameterKind::joint_origin || columns[i].index > 2)
      continue;
    const Pose origin = get_pose(initial, p.start);
    out(i) = (origin.rotation.transpose() * origin.translation)(columns[i].index);
  }
  return out;
}

}  // namespace

std::optional<ArmScale> arm_scale(const Recording& recording, const WidthProblem& problem,
                                  const std::vector<Component>& columns, const Widths& widths,
                                  const VectorXd& initial) {
  constexpr double kStep = 0.01;  // of m
  ArmScale out;
  for (const Sensor& sensor : recording.rig.sensors)
    if (measures_lengths(sensor)) out.sensors.push_back(sensor.name);
  const VectorXd lengths = lengths_of(recording, problem, columns, initial);
  if (out.sensors.empty() || !(lengths.squaredNorm() > 0)) return std::nullopt;
  const auto with = [&](double m) {
    WidthProblem counted = problem;
    counted.at -= m * lengths;
    return counted;
  };
  double m = 0;
  VectorXd factor = widths.factor;
  for (int k = 0; k < kFits; ++k) {
    const double below = log_evidence(with(m - kStep), factor), at = log_evidence(with(m), factor),
                 above = log_evidence(with(m + kStep), factor);
    const double curvature = (2 * at - below - above) / (kStep * kStep);
    if (!(curvature > 0)) return std::nullopt;
    m += (above - below) / (2 * kStep * curvature);
    out.sigma = 1 / std::sqrt(curvature);
    const Widths learned = learn_widths(with(m), factor, kScaleRounds);
    if (!learned.defined) return std::nullopt;
    factor = learned.factor;
  }
  out.factor = 1 + m;
  out.gain = log_evidence(with(m), factor) - log_evidence(problem, widths.factor);
  if (!std::isfinite(out.gain)) return std::nullopt;
  return out;
}

}  // namespace kincal
