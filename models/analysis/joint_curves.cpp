#include "joint_curves.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "../rig/configuration.h"
#include "../rig/numbers.h"

namespace kincal {
namespace {

constexpr int kPlaces = 200;  // over the joint's range: of a turn two in each piece of a curve

/// The further terms of one joint's model.
struct Terms {
  const JointModel* model;
  VectorXd own;                 // [offset, scale, further parameters]
  MatrixXd covariance;          // of the further parameters; NaN: not determined
  std::vector<char> estimated;  // by further parameter

  VectorXd at(double reading) const {
    VectorXd out(own.size() - 2);
    for (Eigen::Index k = 0; k < out.size(); ++k)
      out(k) = model->by_own(static_cast<int>(k) + 2, reading, own.data());
    return out;
  }
  double error(double reading) const {
    return model->position(reading, own.data()) - (own(1) * reading + own(0));
  }
};

bool is_term(const Parameter& p, int joint) {
  return p.kind == ParameterKind::joint_shape && p.owner == joint;
}

void set_unknown(Eigen::Index k, MatrixXd& covariance) {
  covariance.row(k).setConstant(kNan);
  covariance.col(k).setConstant(kNan);
}

Terms terms_of(const Solution& solution, int joint) {
  const ParameterTable& table = solution.table();
  const int start = table.all[table.joint_offset[joint]].start;
  Terms out;
  out.model = solution.rig().joints[joint].model.get();
  out.own = solution.values.shared.segment(start, out.model->size());
  const Eigen::Index n = out.own.size() - 2;
  out.covariance = MatrixXd::Zero(n, n);
  out.estimated.assign(static_cast<size_t>(n), 0);
  const bool predicted = solution.prediction.has_value();
  const std::vector<Component>& columns =
      predicted ? solution.prediction->columns : solution.columns;
  const MatrixXd& covariance = predicted ? solution.prediction->covariance : solution.covariance;
  std::vector<std::pair<Eigen::Index, Eigen::Index>> own_columns;  // further parameter, column
  for (size_t i = 0; i < columns.size() && covariance.rows() > 0; ++i) {
    const Parameter& p = table.all[columns[i].parameter];
    if (is_term(p, joint))
      own_columns.push_back({p.start + columns[i].index - start - 2, static_cast<Eigen::Index>(i)});
  }
  for (const auto& [a, i] : own_columns) {
    out.estimated[static_cast<size_t>(a)] = 1;
    for (const auto& [b, j] : own_columns) out.covariance(a, b) = covariance(i, j);
  }
  for (const ParameterEstimate& e : solution.parameters)
    for (size_t c = 0; c < e.sigma.size(); ++c)
      if (is_term(table.all[e.parameter], joint) && std::isnan(e.sigma[c])) {
        const Eigen::Index k =
            table.all[e.parameter].start + static_cast<Eigen::Index>(c) - start - 2;
        set_unknown(k, out.covariance);
      }
  return out;
}

/// sqrt(t' C t) over the terms that are not zero.
double sigma_of(const VectorXd& t, const MatrixXd& covariance) {
  double out = 0;
  for (Eigen::Index a = 0; a < t.size(); ++a)
    for (Eigen::Index b = 0; t(a) != 0 && b < t.size(); ++b)
      if (t(b) != 0) out += t(a) * covariance(a, b) * t(b);
  return std::sqrt(std::max(out, std::isnan(out) ? kNan : 0));
}

/// The usual range with all readings (low to high) in it. Of more than a turn, in which a curve
/// repeats, the turn about them.
std::pair<double, double> drawn_range(const Joint& joint, double low, double high) {
  auto [from, to] = usual_range(joint);
  if (!(low <= high)) return {from, to};
  if (joint.type != JointType::prismatic && to - from > 2 * kPi) {
    from = (low + high) / 2 - kPi;
    to = from + 2 * kPi;
  }
  return {std::min(from, low), std::max(to, high)};
}

JointCurve curve_of(const Solution& solution, int joint, Terms terms) {
  JointCurve out;
  out.joint = joint;
  double low = kInfinity, high = -kInfinity;
  VectorXd mean = VectorXd::Zero(terms.own.size() - 2), seen = mean;
  double level = 0, squares = 0, count = 0;
  for (const int i : solution.training()) {
    const double q = solution.samples()[i].readings[joint];
    if (!std::isfinite(q)) continue;
    low = std::min(low, q);
    high = std::max(high, q);
    const VectorXd t = terms.at(q);
    mean += t;
    seen += t.cwiseAbs();
    const double error = terms.error(q);
    level += error;
    squares += error * error;
    ++count;
  }
  if (count > 0) {
    mean /= count;
    level /= count;
    out.rms = std::sqrt(std::max(0.0, squares / count - level * level));
  }
  std::tie(low, high) = drawn_range(solution.rig().tree.joints[joint], low, high);
  const bool any = std::count(terms.estimated.begin(), terms.estimated.end(), 1) > 0;
  for (Eigen::Index k = 0; k < seen.size(); ++k)  // a step drops those that no sample depends on
    if (any && seen(k) == 0 && !terms.estimated[static_cast<size_t>(k)])
      set_unknown(k, terms.covariance);
  for (int i = 0; i <= kPlaces; ++i) {
    const double q = low + (high - low) * i / kPlaces;
    out.reading.push_back(q);
    out.error.push_back(terms.error(q) - level);
    out.sigma.push_back(sigma_of(terms.at(q) - mean, terms.covariance));
  }
  return out;
}

}  // namespace

std::vector<JointCurve> joint_curves(const Solution& solution) {
  std::vector<JointCurve> out;
  const Rig& rig = solution.rig();
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    if (solution.table().joint_offset[j] < 0 || rig.joints[j].model->size() <= 2) continue;
    Terms terms = terms_of(solution, static_cast<int>(j));
    if (terms.own.tail(terms.own.size() - 2).isZero(0) && terms.covariance.isZero(0)) continue;
    out.push_back(curve_of(solution, static_cast<int>(j), std::move(terms)));
  }
  return out;
}

}  // namespace kincal
