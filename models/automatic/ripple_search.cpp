#include "ripple_search.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "../../solver/decompositions.h"
#include "../../solver/observability.h"
#include "width_problem.h"

namespace kincal {
namespace {

// Of 200 simulated arms without ripple (120 samples) these gave none: at most 1.5 % (95 %).
constexpr int kFewestCycles = 3;        // in a turn; fewer are those of error curves
constexpr int kMostCycles = 400;        // in a turn; of real arms the largest found was 335
constexpr int kDraws = 20;              // the largest of so many is about the 95 % point
constexpr double kAboveChance = 1.5;    // times that: see the header
constexpr size_t kLeastPostures = 100;  // of a joint; 36 gave false ones

/// By draw: the gain in chi2 of a ripple of a joint over what it leaves, a sample; `sign` has a
/// column for each draw. `left` is that of the first.
VectorXd gains(const JointErrors& errors, int cycles, const MatrixXd& sign, double& left) {
  const auto count = static_cast<Eigen::Index>(errors.reading.size());
  MatrixXd weighted(3, count);
  Matrix3d m = Matrix3d::Zero();
  double all = 0;
  size_t seen = 0;
  for (Eigen::Index s = 0; s < count; ++s) {
    const double angle = cycles * errors.reading[s];
    const Vector3d f(1, std::cos(angle), std::sin(angle));
    m += errors.curvature[s] * f * f.transpose();
    weighted.col(s) = errors.slope[s] * f;
    if (!(errors.curvature[s] > 0)) continue;
    all += errors.slope[s] * errors.slope[s] / errors.curvature[s];
    ++seen;
  }
  if (seen < kLeastPostures) return VectorXd::Zero(sign.cols());
  const MatrixXd g = weighted * sign, solved = solve_symmetric(m, g);
  const Eigen::ArrayXd with = g.cwiseProduct(solved).colwise().sum().transpose(),
                       offset = g.row(0).cwiseAbs2().transpose() / m(0, 0);
  const Eigen::ArrayXd rest = (all - with) / static_cast<double>(seen);
  left = rest(0);
  return (with - offset) / rest;
}

}  // namespace

std::vector<JointErrors> joint_errors(const FitWithGroups& fit) {
  const Recording& recording = *fit.recording;
  if (recording.training().size() < kLeastPostures) return {};
  const DataProblem data = data_problem(recording, fit.setup, fit.values, fit.groups);
  const std::vector<std::string>& possible = fit.groups.further;
  std::vector<JointErrors> out;
  std::vector<int> of_column(data.problem->columns().size(), -1);
  for (size_t c = 0; c < of_column.size(); ++c) {
    const Parameter& p = recording.table.all[data.problem->columns()[c].parameter];
    if (p.kind != ParameterKind::joint_offset) continue;
    const std::string group = kRippleOf + recording.rig.tree.joints[p.owner].name;
    if (std::find(possible.begin(), possible.end(), group) == possible.end() ||
        !recording.rig.joints[p.owner].terms.gear_ratios.empty())
      continue;
    of_column[c] = static_cast<int>(out.size());
    out.push_back({p.owner, {}, {}, {}});
  }
  MatrixXd rows;
  long rank = 0;
  for (size_t g = 0; g < data.problem->groups().size(); ++g) {
    const int sample = data.problem->sample_of(static_cast<int>(g));
    const GroupShape& shape = data.problem->groups()[g];
    data.problem->square_root(static_cast<int>(g), data.state, 0, rows);
    const MatrixXd left = eliminate(std::move(rows), shape.private_size, rank);
    const VectorXd residual = left.col(left.cols() - 1);
    std::vector<VectorXd> by(out.size());
    for (size_t i = 0; i < shape.columns.size(); ++i)
      if (const int k = of_column[shape.columns[i]]; k >= 0)
        by[k] = left.col(static_cast<Eigen::Index>(i));
    for (size_t k = 0; k < out.size(); ++k) {
      const bool depends = by[k].size() > 0;
      out[k].reading.push_back(depends ? recording.samples[sample].readings[out[k].joint] : 0);
      out[k].curvature.push_back(depends ? by[k].squaredNorm() : 0);
      out[k].slope.push_back(depends ? by[k].dot(residual) : 0);
    }
  }
  return out;
}

std::optional<FoundRipple> find_ripple(const std::vector<JointErrors>& errors) {
  if (errors.empty()) return {};
  std::mt19937_64 random(1);
  MatrixXd sign(static_cast<Eigen::Index>(errors[0].reading.size()), kDraws + 1);
  for (Eigen::Index i = 0; i < sign.size(); ++i) sign.data()[i] = (random() >> 40) & 1 ? 1 : -1;
  sign.col(0).setOnes();
  VectorXd most = VectorXd::Zero(sign.cols());
  FoundRipple best;
  for (const JointErrors& one : errors)
    for (int cycles = kFewestCycles; cycles <= kMostCycles; ++cycles) {
      double left = 1;
      const VectorXd gain = gains(one, cycles, sign, left);
      if (gain(0) > most(0)) best = {one.joint, cycles, 0, left};
      most = most.cwiseMax(gain);
    }
  if (!(most(0) > kAboveChance * most.tail(kDraws).maxCoeff())) return {};
  best.log_candidates =
      std::log(static_cast<double>(errors.size()) * (kMostCycles - kFewestCycles + 1));
  return best;
}

}  // namespace kincal
