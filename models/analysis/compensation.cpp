#include "compensation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "../rig/configuration.h"

namespace kincal {
namespace {

constexpr int kSteps = 30;          // three digits each: more than it takes
constexpr int kPositionSteps = 5;   // couplings of some percent: two digits each
constexpr double kDamping = 1e-12;  // c, of the trace: above rounding, below what slows the steps

/// The joints with the readings that move a frame, without those that they are coupled to.
std::vector<int> moving_joints(const Rig& rig, const Frame& tip) {
  std::vector<int> out;
  for (const PathStep& step : find_path(rig.tree, rig.base, tip.link)) {
    if (!rig.tree.joints[step.joint].moves()) continue;
    const int joint = driver(rig.tree, step.joint).joint;
    if (std::find(out.begin(), out.end(), joint) == out.end()) out.push_back(joint);
  }
  return out;
}

/// Readings at which the joints that move the tip are where the planned robot's are at `at`.
Readings same_positions(const RobotTip& real, const RobotTip& planned, const Readings& at) {
  const Configuration wanted(*planned.robot.rig, *planned.robot.table, planned.robot.values, at);
  Readings out = at;
  for (int step = 0; step < kPositionSteps; ++step) {
    const Readings last = out;
    const Configuration robot(*real.robot.rig, *real.robot.table, real.robot.values, last,
                              real.conditions);
    for (const int j : moving_joints(*real.robot.rig, real.tip))
      out[j] += (wanted.position(j) - robot.position(j)) / robot.by_reading_of(j, j);
  }
  return out;
}

/// The motion of the frame, seen from itself, by the readings of the joints that move it (6 x
/// joints); which these are.
struct TipMotion {
  MatrixXd columns;
  std::vector<int> joints;
};
TipMotion tip_motion(const Configuration& robot, const Frame& tip, const Pose& base_T_tip) {
  const Rig& rig = robot.rig();
  TipMotion out;
  out.joints = moving_joints(rig, tip);
  out.columns.setZero(6, static_cast<Eigen::Index>(out.joints.size()));
  const Matrix3d back = base_T_tip.rotation.transpose();
  Pose a_T_from;
  for (const PathStep& step : find_path(rig.tree, rig.base, tip.link)) {
    Pose a_T_joint, a_T_to;
    walk(step, robot.origin(step.joint), robot.motion(step.joint), a_T_from, a_T_joint, a_T_to);
    a_T_from = a_T_to;
    const Joint& joint = rig.tree.joints[step.joint];
    if (!joint.moves()) continue;
    const Driver d = driver(rig.tree, step.joint);
    const Vector6d twist = position_twist(
        joint, step.direction, a_T_joint * Pose{robot.bend_of(step.joint), Vector3d::Zero()});
    for_each_reading(rig, d.joint, [&](int by) {
      const double by_reading = d.factor * robot.by_reading_of(d.joint, by);
      const auto k = std::find(out.joints.begin(), out.joints.end(), by) - out.joints.begin();
      if (k == out.columns.cols()) return;  // another reading, which stays
      out.columns.col(k).head<3>() +=
          by_reading * (back * (twist.head<3>() + twist.tail<3>().cross(base_T_tip.translation)));
      out.columns.col(k).tail<3>() += by_reading * (back * twist.tail<3>());
    });
  }
  return out;
}

}  // namespace

std::vector<Frame> still_frames(const Rig& rig, const ParameterTable& table) {
  std::vector<Frame> out;
  for (const Frame& frame : all_frames(rig, table))
    if (frame.pose >= 0 && joints_between(rig, rig.base, frame.link).empty()) out.push_back(frame);
  return out;
}

Compensated compensate(const RobotTip& real, const RobotTip& planned, const Readings& at,
                       bool position_only) {
  const Pose wanted = planned.at(at);
  double least = std::numeric_limits<double>::infinity();
  Compensated out{at, least, least};
  Readings now = same_positions(real, planned, at);
  for (int step = 0; step < kSteps; ++step) {
    const Configuration robot(*real.robot.rig, *real.robot.table, real.robot.values, now,
                              real.conditions);
    const Pose base_T_tip = real.base_T_tip(now), left = inverse(real.at(now)) * wanted;
    VectorXd e(6);
    e << left.translation, log_so3(left.rotation);
    const TipMotion motion = tip_motion(robot, real.tip, base_T_tip);
    if (motion.joints.empty())
      throw std::invalid_argument("no joint moves '" + real.tip.name + "'");
    const Eigen::Index rows = position_only ? 3 : 6;
    const double size = e.head(rows).norm();
    if (!(size < 0.5 * least)) break;  // rounding, or it cannot be reached better
    least = size;
    out = {now, e.head<3>().norm(), e.tail<3>().norm()};
    const MatrixXd j = motion.columns.topRows(rows);
    const bool square = j.cols() >= rows;
    MatrixXd gram = square ? MatrixXd(j * j.transpose()) : MatrixXd(j.transpose() * j);
    gram.diagonal().array() += kDamping * gram.trace();
    const VectorXd by = square ? VectorXd(j.transpose() * solve_symmetric(gram, e.head(rows)))
                               : VectorXd(solve_symmetric(gram, j.transpose() * e.head(rows)));
    for (size_t i = 0; i < motion.joints.size(); ++i)
      now[motion.joints[i]] += by(static_cast<Eigen::Index>(i));
  }
  return out;
}

std::optional<Readings> reach_point(const RobotTip& robot, const Vector3d& point,
                                    const Vector3d& wanted, const Readings& start) {
  constexpr int kReachSteps = 50;
  constexpr double kNear = 1e-6, kLongest = 0.5, kReachDamping = 1e-6;  // m; rad or m; of the trace
  const Rig& rig = *robot.robot.rig;
  Readings now = start;
  for (int step = 0; step < kReachSteps; ++step) {
    const Configuration at(rig, *robot.robot.table, robot.robot.values, now);
    const Pose base_T_tip = robot.base_T_tip(now);
    const Vector3d e = inverse(base_T_tip) * wanted - point;
    if (e.norm() < kNear) return now;
    const TipMotion motion = tip_motion(at, robot.tip, base_T_tip);
    MatrixXd j = motion.columns.topRows<3>() - skew(point) * motion.columns.bottomRows<3>();
    VectorXd by;
    for (bool all = false; !all;) {  // again without the joints that would leave their limits
      MatrixXd gram = j * j.transpose();
      gram.diagonal().array() += kReachDamping * gram.trace();
      if (!(gram.trace() > 0)) return std::nullopt;
      by = j.transpose() * solve_symmetric(gram, e);
      all = true;
      for (Eigen::Index c = 0; c < by.size(); ++c) {
        const int joint = motion.joints[static_cast<size_t>(c)];
        const auto [low, high] = usual_range(rig.tree.joints[joint]);
        if (!(now[joint] <= low && by(c) < 0) && !(now[joint] >= high && by(c) > 0)) continue;
        j.col(c).setZero();
        all = false;
      }
    }
    const double longest = by.cwiseAbs().maxCoeff();
    if (!std::isfinite(longest)) return std::nullopt;
    if (longest > kLongest) by *= kLongest / longest;
    for (Eigen::Index c = 0; c < by.size(); ++c) {
      double& reading = now[motion.joints[static_cast<size_t>(c)]];
      const auto [low, high] = usual_range(rig.tree.joints[motion.joints[static_cast<size_t>(c)]]);
      reading = std::clamp(reading + by(c), low, high);
    }
  }
  return std::nullopt;
}

}  // namespace kincal
