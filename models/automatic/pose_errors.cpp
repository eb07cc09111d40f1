#include "pose_errors.h"

#include <algorithm>
#include <cmath>

#include "../../kinematics/floating.h"
#include "../analysis/linearisation.h"
#include "../evidence/evidence.h"
#include "widths.h"

namespace kincal {
namespace {

// (The numbers are from simulated robots: see the header.)
constexpr double kAlways = 4;   // widths of the rest: of what is the same in all poses
constexpr double kReach = 0.5;  // m, of an arm about where it works: there errors vary
constexpr int kNumbers = 6 * (10 + 4);
constexpr double kShift = 1e-3, kTurn = 1e-3;  // m, rad: usual errors of a robot's poses
const std::vector<double> kFactors = {1.0 / 9, 1.0 / 3, 1, 3, 9, 27};  // of these

/// The axes of a floating joint's error, if it has noise.
std::vector<int> noisy_axes(const Rig& rig, int joint) {
  std::vector<int> out;
  const Joint& of = rig.tree.joints[joint];
  for (int k = 0; of.first_axis >= 0 && k < kPoseAxes; ++k)
    if (const int axis = of.first_axis + kPoseAxes + k; rig.joints[axis].sigma > 0)
      out.push_back(axis);
  return out;
}

/// The error of a pose's reading by each number of the trend, in their usual errors.
Eigen::Matrix<double, 6, kNumbers> errors_at(const Pose& pose) {
  Eigen::Matrix<double, 1, 10> turned;
  Eigen::Matrix<double, 1, 4> moved;
  turned << 1, pose.rotation.reshaped().transpose();
  moved << 1, pose.translation.transpose() / kReach;
  Matrix6d by_base = Matrix6d::Zero();  // a twist at the base, seen from the flange
  by_base.topLeftCorner<3, 3>() = by_base.bottomRightCorner<3, 3>() = pose.rotation.transpose();
  by_base.topRightCorner<3, 3>() = -pose.rotation.transpose() * skew(pose.translation);
  Eigen::Matrix<double, 6, kNumbers> out;
  for (int k = 0; k < 10; ++k) out.middleCols<6>(6 * k) = turned(k) * Matrix6d::Identity();
  for (int k = 0; k < 4; ++k) out.middleCols<6>(6 * (10 + k)) = moved(k) * by_base;
  return out;
}

ReadingTrend trend_of(const Solution& solution, int joint) {
  const Tree& tree = solution.rig().tree;
  ReadingTrend out;
  out.axes = noisy_axes(solution.rig(), joint);
  const int first = tree.joints[joint].first_axis + kPoseAxes;
  for (const Sample& sample : solution.samples()) {
    const Pose pose = pose_reading(tree, joint, sample.readings);
    const bool absent = !pose.rotation.allFinite() || !pose.translation.allFinite();
    const auto all = absent ? Eigen::Matrix<double, 6, kNumbers>::Zero().eval() : errors_at(pose);
    MatrixXd& at = out.at.emplace_back(out.axes.size(), kNumbers);
    for (size_t a = 0; a < out.axes.size(); ++a)
      at.row(static_cast<Eigen::Index>(a)) = all.row(out.axes[a] - first);
  }
  return out;
}

/// The noise of a floating joint's poses.
struct PoseNoise {
  double shift = 0, turn = 0;  // m, rad
  double log_of_robot = 0;     // of unstated noise of this size: odds of a robot's inaccuracy
  bool stated = true;
};

/// Log density of a size whose usual one is this, but for a constant.
double log_usual(double size, double usual) {
  const double u = std::log(size / usual) / kWidthSpread;
  return -u * u / 2;
}

PoseNoise noise_of(const Rig& rig, const std::vector<int>& axes) {
  PoseNoise out;
  for (const int axis : axes) {
    const JointSettings& of = rig.joints[axis];
    const bool shifts = rig.tree.joints[axis].type == JointType::prismatic;
    double& size = shifts ? out.shift : out.turn;
    if (size == 0 && of.noise_guess > 0) {
      out.stated = false;
      out.log_of_robot +=
          log_usual(of.sigma, shifts ? kShift : kTurn) - log_usual(of.sigma, of.noise_guess);
    }
    size = of.sigma;
  }
  return out;
}

/// The widths of the numbers with usual errors times a factor; what is always the same may be as
/// large as all errors of poses whose noise nobody stated.
VectorXd widths_of(double factor, const PoseNoise& noise) {
  VectorXd out(kNumbers);
  for (int k = 0; k < kNumbers; ++k) {
    const bool shifts = k % 6 < 3, always = k < 6 || (k >= 60 && k < 66);
    out(k) = factor * (shifts ? kShift : kTurn) * (always ? kAlways : 1);
    if (always && !noise.stated) out(k) = std::max(out(k), shifts ? noise.shift : noise.turn);
  }
  return out;
}

/// Adds them to a prediction, which covers both.
void cover(const WeighedTrend& trend, const std::vector<Component>& columns, double probability,
           Prediction& out) {
  MatrixXd other = out.covariance;
  std::vector<Eigen::Index> place(columns.size(), -1);
  for (size_t i = 0; i < columns.size(); ++i) {
    const auto found = std::find(out.columns.begin(), out.columns.end(), columns[i]);
    if (found != out.columns.end()) place[i] = found - out.columns.begin();
  }
  const MatrixXd more = trend.wider + trend.moved * trend.moved.transpose();
  for (Eigen::Index i = 0; i < more.rows(); ++i)
    for (Eigen::Index j = 0; j < more.cols(); ++j)
      if (place[i] >= 0 && place[j] >= 0) other(place[i], place[j]) += more(i, j);
  const MatrixXd both = covering(out.covariance, other, probability);
  out.lasting.conservativeResizeLike(MatrixXd::Zero(both.rows(), both.cols()));
  out.lasting += both - out.covariance;
  out.covariance = both;
}

}  // namespace

std::vector<PoseErrors> add_pose_errors(Solution& solution) {
  std::vector<PoseErrors> out;
  if (!solution.prediction || solution.noise != NoiseMode::latent) return out;
  const Tree& tree = solution.rig().tree;
  for (int j = 0; j < static_cast<int>(tree.joints.size()); ++j) {
    if (noisy_axes(solution.rig(), j).empty()) continue;
    const ReadingTrend trend = trend_of(solution, j);
    const PoseNoise noise = noise_of(solution.rig(), trend.axes);
    std::vector<VectorXd> widths;
    for (const double factor : kFactors) widths.push_back(widths_of(factor, noise));
    const std::vector<WeighedTrend> all = weigh_trend(linearise(solution), trend, widths);
    const WeighedTrend* best = nullptr;
    double most = 0;
    for (size_t k = 0; k < all.size(); ++k) {
      const double u = std::log(kFactors[k]) / kWidthSpread, odds = all[k].gain - u * u / 2;
      if (!std::isfinite(odds) || (best && !(odds > most))) continue;
      best = &all[k];
      most = odds;
    }
    if (!best) continue;
    most += noise.log_of_robot;
    out.push_back({j, most});
    cover(*best, solution.columns, 1 / (1 + std::exp(-most)), *solution.prediction);
  }
  return out;
}

}  // namespace kincal
