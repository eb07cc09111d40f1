#include "arm_scale.h"

#include <algorithm>
#include <cmath>

#include "lone_lengths.h"

namespace kincal {
namespace {

constexpr int kScaleRounds = 60, kFits = 3;

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
  constexpr double kStep = 0.01, kMost = 0.5;  // of m
  constexpr double kFar = 0.1;                 // share of the arm's longest length
  ArmScale out;
  const VectorXd lengths = lengths_of(recording, problem, columns, initial);
  if (lengths.size() == 0) return std::nullopt;
  for (size_t s = 0; s < recording.rig.sensors.size(); ++s)
    if (const Sensor& sensor = recording.rig.sensors[s];
        measures_lengths(sensor) &&
        farthest_measured(recording, static_cast<int>(s)) > kFar * lengths.cwiseAbs().maxCoeff())
      out.sensors.push_back(sensor.name);
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
    if (!(std::abs(m) < kMost)) return std::nullopt;  // what is that wrong is another mistake
    out.sigma = 1 / std::sqrt(curvature);
    const Widths learned = learn_widths(with(m), factor, kScaleRounds);
    if (!learned.defined) return std::nullopt;
    factor = learned.factor;
  }
  out.factor = 1 + m;
  out.gain = log_evidence(with(m), factor) - log_evidence(problem, widths.factor);
  if (!std::isfinite(out.gain)) return std::nullopt;
  const std::optional<double> alone = lone_length_gain(recording, problem, columns, widths);
  if (alone && *alone > out.gain) return std::nullopt;
  return out;
}

}  // namespace kincal
