#include "compensation.h"

#include <algorithm>
#include <cmath>
#include <functional>
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
TipMotion tip_motion(const RobotTip& robot, const Readings& readings, const Pose& base_T_tip) {
  const FrameDerivative d = frame_derivative(*robot.robot.rig, *robot.robot.table,
                                             robot.robot.values, {}, robot.tip, readings);
  TipMotion out;
  out.joints = moving_joints(*robot.robot.rig, robot.tip);
  out.columns.setZero(6, static_cast<Eigen::Index>(out.joints.size()));
  const Matrix3d back = base_T_tip.rotation.transpose();
  for (size_t i = 0; i < d.moving.size(); ++i) {
    const auto k =
        std::find(out.joints.begin(), out.joints.end(), d.moving[i]) - out.joints.begin();
    if (k == out.columns.cols()) continue;  // another reading, which stays
    out.columns.col(k).head<3>() = back * d.by_joints.col(static_cast<Eigen::Index>(i)).head<3>();
    out.columns.col(k).tail<3>() = back * d.by_joints.col(static_cast<Eigen::Index>(i)).tail<3>();
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

Compensated compensate(const RobotTip& real, const Pose& wanted, const Readings& at,
                       bool position_only) {
  double least = std::numeric_limits<double>::infinity();
  Compensated out{at, least, least};
  Readings now = at;
  for (int step = 0; step < kSteps; ++step) {
    const Pose base_T_tip = real.base_T_tip(now), left = inverse(real.at(now)) * wanted;
    VectorXd e(6);
    e << left.translation, log_so3(left.rotation);
    const TipMotion motion = tip_motion(real, now, base_T_tip);
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

Compensated compensate(const RobotTip& real, const RobotTip& planned, const Readings& at,
                       bool position_only) {
  return compensate(real, planned.at(at), same_positions(real, planned, at), position_only);
}

namespace {

/// What is left of a task at a pose of the tip, and its derivative by the readings.
struct TaskError {
  VectorXd error;
  MatrixXd by_readings;
};
using Task = std::function<TaskError(const Pose& base_T_tip, const TipMotion& motion)>;

/// Returns readings within the joints' usual ranges at which less than 1 um (urad) of the task is
/// left, by damped Gauss-Newton steps; joints that stand at a limit and would leave it stay.
std::optional<Readings> reach(const RobotTip& robot, const Readings& start, const Task& task) {
  constexpr int kReachSteps = 50;
  constexpr double kNear = 1e-6, kLongest = 0.5, kReachDamping = 1e-6;  // m; rad or m; of the trace
  const Rig& rig = *robot.robot.rig;
  Readings now = start;
  for (int step = 0; step < kReachSteps; ++step) {
    const Pose base_T_tip = robot.base_T_tip(now);
    const TipMotion motion = tip_motion(robot, now, base_T_tip);
    TaskError left = task(base_T_tip, motion);
    if (left.error.norm() < kNear) return now;
    MatrixXd& j = left.by_readings;
    VectorXd by;
    for (bool all = false; !all;) {  // again without the joints that would leave their limits
      MatrixXd gram = j * j.transpose();
      gram.diagonal().array() += kReachDamping * gram.trace();
      if (!(gram.trace() > 0)) return std::nullopt;
      by = j.transpose() * solve_symmetric(gram, left.error);
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

}  // namespace

std::optional<Readings> reach_point(const RobotTip& robot, const Vector3d& point,
                                    const Vector3d& wanted, const Readings& start) {
  return reach(robot, start, [&](const Pose& base_T_tip, const TipMotion& motion) {
    return TaskError{inverse(base_T_tip) * wanted - point,
                     motion.columns.topRows<3>() - skew(point) * motion.columns.bottomRows<3>()};
  });
}

std::optional<Readings> reach_pose(const RobotTip& robot, const Pose& from_T_tip,
                                   const Readings& start, bool position_only) {
  const Pose wanted = robot.base_T_from(start) * from_T_tip;
  const Eigen::Index rows = position_only ? 3 : 6;
  return reach(robot, start, [&](const Pose& base_T_tip, const TipMotion& motion) {
    const Pose left = inverse(base_T_tip) * wanted;
    VectorXd e(6);
    e << left.translation, log_so3(left.rotation);
    return TaskError{e.head(rows), motion.columns.topRows(rows)};
  });
}

}  // namespace kincal
