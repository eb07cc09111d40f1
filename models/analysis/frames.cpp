#include "frames.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "../../kinematics/floating.h"
#include "../../solver/observability.h"
#include "../rig/configuration.h"
#include "../rig/elasticity.h"
#include "../rig/geometry.h"
#include "../rig/random_stream.h"

namespace kincal {
namespace {

constexpr int kPostures = 1000;
constexpr std::uint64_t kSeed = 1;
constexpr double kMoves = 1e-4;  // of what the parts of a direction move by themselves

bool reachable(const Rig& rig, int link) {
  try {
    find_path(rig.tree, rig.base, link);
    return true;
  } catch (const std::invalid_argument&) {
    return false;
  }
}

SigmaStatistics statistics(std::vector<double> v) {
  if (v.empty()) return {kNan, kNan, kNan};
  double squared = 0;
  for (double x : v) {
    if (!std::isfinite(x)) return {kNan, kNan, kNan};
    squared += x * x;
  }
  std::sort(v.begin(), v.end());
  const size_t n = v.size();
  return {std::sqrt(squared / static_cast<double>(n)), (v[(n - 1) / 2] + v[n / 2]) / 2, v.back()};
}

/// Squared sigmas of position and rotation at one posture; NaN: a direction that nothing determines
/// moves it.
struct Variances {
  double position, rotation, position_by_readings, rotation_by_readings;
};
Variances variances(const FrameDerivative& d, const Unknowns& unknowns) {
  const MatrixXd covariance = d.by_unknowns * unknowns.covariance * d.by_unknowns.transpose();
  Variances out{covariance.diagonal().head<3>().sum(), covariance.diagonal().tail<3>().sum(), 0, 0};
  for (Eigen::Index c = 0; c < d.by_readings.cols(); ++c) {  // (no rows of a matrix of nothing)
    out.position_by_readings += d.by_readings.col(c).head<3>().squaredNorm();
    out.rotation_by_readings += d.by_readings.col(c).tail<3>().squaredNorm();
  }
  for (Eigen::Index k = 0; k < unknowns.undetermined.cols(); ++k) {
    const VectorXd direction = unknowns.undetermined.col(k);
    const Vector6d motion = d.by_unknowns * direction;
    double size = 0;  // m and rad alike: a lever of a metre
    for (Eigen::Index i = 0; i < direction.size(); ++i)
      size += std::abs(direction(i)) *
              (d.by_unknowns.col(i).head<3>().norm() + d.by_unknowns.col(i).tail<3>().norm());
    if (motion.head<3>().norm() > kMoves * size) out.position = kNan;
    if (motion.tail<3>().norm() > kMoves * size) out.rotation = kNan;
  }
  return out;
}

/// As variances(), of a frame: nothing is known of one whose own pose is not.
Variances frame_variances(const FrameDerivative& d, const Unknowns& unknowns, const Frame& frame) {
  Variances out = variances(d, unknowns);
  if (std::count(unknowns.unseen.begin(), unknowns.unseen.end(), frame.pose))
    out.position = out.rotation = kNan;
  return out;
}

/// Parameters that `frame` depends on and earlier steps estimated, but the last one held.
std::vector<std::string> held_on_path(const Solution& solution, const Frame& frame) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  std::vector<int> path_parameters;
  for (const PathStep& step : find_path(rig.tree, rig.base, frame.link)) {
    path_parameters.push_back(table.joint_origin[step.joint]);
    if (!rig.tree.joints[step.joint].moves()) continue;
    const int d = driver(rig.tree, step.joint).joint;
    for (int p = table.joint_offset[d]; p < table.joint_origin[d]; ++p)
      path_parameters.push_back(p);
  }
  if (frame.pose >= 0) path_parameters.push_back(frame.pose);
  std::vector<std::string> out;
  const std::string& last = solution.steps.back().name;
  for (const ParameterEstimate& e : solution.parameters) {
    const auto is_same = [&](int p) { return p == e.parameter; };
    if (std::none_of(path_parameters.begin(), path_parameters.end(), is_same)) continue;
    for (size_t c = 0; c < e.freed.size(); ++c) {
      const bool now = e.step == last && e.sigma[c] != 0;  // NaN: freed and not determined
      if (e.freed[c] && !now) out.push_back(e.component_name(c));
    }
  }
  return out;
}

}  // namespace

std::vector<Frame> all_frames(const Rig& rig, const ParameterTable& table) {
  std::vector<Frame> out;
  for (size_t l = 0; l < rig.tree.links.size(); ++l)
    if (!is_between_axes(rig.tree, static_cast<int>(l)) && reachable(rig, static_cast<int>(l)))
      out.push_back({rig.tree.links[l], static_cast<int>(l), -1});
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    if (reachable(rig, rig.sensors[s].link))
      out.push_back({"sensor/" + rig.sensors[s].name, rig.sensors[s].link, table.sensor_pose[s]});
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0 && reachable(rig, rig.targets[t].link))
      out.push_back({"target/" + rig.targets[t].name, rig.targets[t].link, table.target_pose[t]});
  return out;
}

std::optional<Frame> find_frame(const Rig& rig, const ParameterTable& table,
                                const std::string& name) {
  for (const Frame& f : all_frames(rig, table))
    if (f.name == name) return f;
  return std::nullopt;
}

Charts charts_of(const Solution& solution) {
  Charts out;
  for (const Freed& f : solution.setup.free) {
    const Parameter& p = solution.table().all[f.parameter];
    if (p.pose && !f.whole(p))
      out[f.parameter] = right_jacobian_se3(log_se3(inverse(get_pose(solution.initial, p.start)) *
                                                    get_pose(solution.values.shared, p.start)));
  }
  return out;
}

Unknowns last_unknowns(const Linearisation& at) {
  const Solution& solution = at.solution;
  Unknowns out;
  out.columns = solution.columns;
  out.covariance = at.observability().covariance;
  out.undetermined = at.observability().null_space;
  if (solution.prediction) {
    const std::vector<Component>& all = solution.prediction->columns;
    const MatrixXd directions = std::exchange(out.undetermined, {});
    out.undetermined.setZero(static_cast<Eigen::Index>(all.size()), directions.cols());
    for (size_t i = 0; directions.size() > 0 && i < all.size(); ++i)
      for (size_t j = 0; j < out.columns.size(); ++j)
        if (all[i] == out.columns[j])
          out.undetermined.row(static_cast<Eigen::Index>(i)) =
              directions.row(static_cast<Eigen::Index>(j));
    out.columns = all;
    out.covariance = solution.prediction->covariance;
  }
  out.charts = charts_of(solution);
  out.unseen = unseen_poses(solution).open;
  return out;
}

UnseenPoses unseen_poses(const Solution& solution) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  std::vector<char> seen(table.all.size(), 0);
  for (const int i : solution.training())
    for (const View& v : solution.samples()[i].views) {
      seen[table.sensor_pose[v.sensor]] = 1;
      if (table.target_pose[v.target] >= 0) seen[table.target_pose[v.target]] = 1;
    }
  // The automatic path estimates every pose that it sees; of other rigs the steps say which.
  const bool automatic = solution.prediction.has_value();
  const std::vector<int> open = open_poses(rig, table);
  UnseenPoses out;
  for (const std::vector<int>* poses : {&table.sensor_pose, &table.target_pose})
    for (const int p : *poses)
      if (p >= 0 && !seen[p]) {
        if (automatic && is_given(rig, table.all[p]))
          out.given.push_back(p);
        else if (automatic || std::count(open.begin(), open.end(), p))
          out.open.push_back(p);
      }
  return out;
}

std::vector<Readings> random_postures(const Rig& rig, int count, std::uint64_t seed) {
  RandomStream draws(seed);
  std::vector<Readings> out(count, Readings(rig.tree.joints.size(), kNan));
  for (Readings& readings : out) draw_readings(rig.tree, draws, readings);
  return out;
}

Pose base_T_frame(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                  const Frame& frame, const Readings& readings, const Conditions& conditions) {
  const Pose base_T_link =
      Configuration(rig, table, values, readings, conditions).base_T_link(frame.link);
  return frame.pose < 0 ? base_T_link : base_T_link * get_pose(values, table.all[frame.pose].start);
}

namespace {

/// Unknowns by parameter: component and column of each.
using ColumnsOf = std::map<int, std::vector<std::pair<int, int>>>;

/// Adds to the columns of a joint's own numbers what its position moves.
void add_own_numbers(const Configuration& robot, const ColumnsOf& columns, int joint,
                     const Vector6d& twist, MatrixXd& by_unknowns) {
  const ParameterTable& table = robot.table();
  int first = 0;  // own number of the parameter's first component
  for (int p = table.joint_offset[joint]; p < table.joint_origin[joint]; ++p) {
    if (const auto found = columns.find(p); found != columns.end())
      for (const auto& [number, column] : found->second)
        by_unknowns.col(column) += robot.by_own_number(joint, first + number) * twist;
    first += table.all[p].size();
  }
}

/// Adds to the columns of twists what moves through bending joints; `by_delta` has the path's
/// columns by their deflections.
void add_bending(const Configuration& robot, const Unknowns& unknowns, const ColumnsOf& columns,
                 const MatrixXd& by_delta, MatrixXd& by_unknowns) {
  const Rig& rig = robot.rig();
  const ParameterTable& table = robot.table();
  const Skeleton& skeleton = *rig.elasticity->skeleton;
  BentPosture bent = *robot.bent();
  differentiate(skeleton, bent);
  BendingColumns through;
  through_equilibrium(bent, by_delta, through);
  const auto add = [&](int parameter, const auto& twists) {  // a function: only what is asked for
    const auto found = columns.find(parameter);
    if (found == columns.end()) return;
    const ThreeColumns all = twists();
    for (const auto& c : found->second) by_unknowns.col(c.second) += all.col(c.first);
  };
  for (int j = 0; j < static_cast<int>(rig.tree.joints.size()); ++j) {
    if (skeleton.index[j] >= 0)
      add(table.compliance[j], [&] { return bent_by_compliance(skeleton, bent, through, j); });
    add(table.load[j], [&] { return bent_by_load(skeleton, bent, through, j); });
    if (const auto found = columns.find(table.joint_origin[j]); found != columns.end()) {
      const auto chart = unknowns.charts.find(table.joint_origin[j]);
      Eigen::Matrix<double, 3, 6> turned = Eigen::Matrix<double, 3, 6>::Zero();
      if (chart == unknowns.charts.end())
        turned.rightCols<3>().setIdentity();
      else
        turned = chart->second.bottomRows<3>();
      const MatrixXd twists = bent_by_origin(skeleton, bent, through, j) * turned;
      for (const auto& c : found->second) by_unknowns.col(c.second) += twists.col(c.first);
    }
    const Joint& joint = rig.tree.joints[j];
    if (!joint.moves() || joint.type == JointType::prismatic ||
        stands_for_balance(rig, robot.readings(), j))
      continue;
    const Driver d = driver(rig.tree, j);
    const OneColumn twist = d.factor * bent_by_position(skeleton, bent, through, j, joint.axis);
    add_own_numbers(robot, columns, d.joint, twist, by_unknowns);
  }
}

}  // namespace

FrameDerivative frame_derivative(const Rig& rig, const ParameterTable& table,
                                 const VectorXd& values, const Unknowns& unknowns,
                                 const Frame& frame, const Readings& readings) {
  FrameDerivative out;
  const Configuration robot(rig, table, values, readings);
  ColumnsOf columns;
  for (size_t c = 0; c < unknowns.columns.size(); ++c)
    columns[unknowns.columns[c].parameter].push_back(
        {unknowns.columns[c].index, static_cast<int>(c)});
  out.by_unknowns.setZero(6, static_cast<Eigen::Index>(unknowns.columns.size()));  // twists first
  const auto add_pose = [&](int parameter, double direction, const Pose& a_T_pose) {
    const auto found = columns.find(parameter);
    if (found == columns.end()) return;
    const auto chart = unknowns.charts.find(parameter);
    const Matrix6d twists = direction * adjoint(a_T_pose) *
                            (chart == unknowns.charts.end() ? Matrix6d::Identity() : chart->second);
    for (const auto& c : found->second) out.by_unknowns.col(c.second) += twists.col(c.first);
  };
  std::map<int, Vector6d> by_reading;  // joint with a reading -> twist by it
  MatrixXd by_delta;
  if (rig.elasticity) by_delta.setZero(6, 3 * rig.elasticity->skeleton->size());
  Pose base_T_link;
  for (const PathStep& step : find_path(rig.tree, rig.base, frame.link)) {
    const Joint& joint = rig.tree.joints[step.joint];
    Pose base_T_joint, base_T_next;
    walk(step, robot.origin(step.joint), robot.motion(step.joint), base_T_link, base_T_joint,
         base_T_next);
    add_pose(table.joint_origin[step.joint], step.direction, base_T_joint);
    if (const int i = rig.elasticity ? rig.elasticity->skeleton->index[step.joint] : -1; i >= 0) {
      by_delta.middleCols<3>(3 * i) =
          deflection_twists(*robot.bent(), i, step.direction, base_T_joint);
      base_T_joint.rotation = base_T_joint.rotation * robot.bent()->bend[i];
    }
    if (joint.moves()) {
      const Driver d = driver(rig.tree, step.joint);
      const Vector6d twist = d.factor * position_twist(joint, step.direction, base_T_joint);
      add_own_numbers(robot, columns, d.joint, twist, out.by_unknowns);
      for_each_reading(rig, d.joint, [&](int by) {
        by_reading.emplace(by, Vector6d::Zero()).first->second +=
            robot.by_reading_of(d.joint, by) * twist;
      });
    }
    base_T_link = base_T_next;
  }
  if (by_delta.size() > 0 && !columns.empty())
    add_bending(robot, unknowns, columns, by_delta, out.by_unknowns);
  Pose base_T_frame = base_T_link;
  if (frame.pose >= 0) {
    base_T_frame = base_T_link * get_pose(values, table.all[frame.pose].start);
    add_pose(frame.pose, 1, base_T_frame);
  }
  out.by_joints.resize(6, static_cast<Eigen::Index>(by_reading.size()));
  for (const auto& r : by_reading) {
    out.by_joints.col(static_cast<Eigen::Index>(out.moving.size())) = r.second;
    out.moving.push_back(r.first);
  }
  for (MatrixXd* twists : {&out.by_unknowns, &out.by_joints})
    if (twists->cols() > 0)
      twists->topRows<3>() -=
          skew(base_T_frame.translation) * twists->bottomRows<3>();  // v + w x p
  out.by_readings.resize(6, out.by_joints.cols());
  for (size_t i = 0; i < out.moving.size(); ++i)
    if (const double sigma = rig.joints[out.moving[i]].sigma; sigma > 0) {
      out.by_readings.col(static_cast<Eigen::Index>(out.joints.size())) =
          sigma * out.by_joints.col(static_cast<Eigen::Index>(i));
      out.joints.push_back(out.moving[i]);
    }
  out.by_readings.conservativeResize(6, static_cast<Eigen::Index>(out.joints.size()));
  return out;
}

FrameReport report_frame(const Solution& solution, const Unknowns& unknowns, const Frame& frame) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  FrameReport out;
  out.frame = frame.name;
  out.base = rig.tree.links[rig.base];
  std::vector<Readings> samples;
  for (const Sample& s : solution.samples())
    if (has_readings(rig, frame.link, s.readings)) samples.push_back(s.readings);
  const std::vector<std::pair<std::string, std::vector<Readings>>> workspaces = {
      {"samples", samples}, {"limits", random_postures(rig, kPostures, kSeed)}};
  for (const auto& workspace : workspaces) {
    if (workspace.second.empty()) continue;
    std::vector<double> sigma[4];
    for (const Readings& readings : workspace.second) {
      const Variances v = frame_variances(
          frame_derivative(rig, table, solution.values.shared, unknowns, frame, readings), unknowns,
          frame);
      sigma[0].push_back(std::sqrt(v.position));
      sigma[1].push_back(std::sqrt(v.rotation));
      sigma[2].push_back(std::sqrt(v.position + v.position_by_readings));
      sigma[3].push_back(std::sqrt(v.rotation + v.rotation_by_readings));
    }
    out.workspaces.push_back({workspace.first, static_cast<long>(workspace.second.size()),
                              statistics(sigma[0]), statistics(sigma[1]), statistics(sigma[2]),
                              statistics(sigma[3])});
  }
  out.held = held_on_path(solution, frame);
  return out;
}

std::map<int, Matrix3d> position_covariances(const Solution& solution, const Unknowns& unknowns) {
  const Rig& rig = solution.rig();
  const ParameterTable& table = solution.table();
  std::map<int, Matrix3d> out;
  for (const Frame& frame : all_frames(rig, table)) {
    if (frame.pose < 0) continue;
    for (const Sample& sample : solution.samples()) {
      if (!has_readings(rig, frame.link, sample.readings)) continue;
      const FrameDerivative d =
          frame_derivative(rig, table, solution.values.shared, unknowns, frame, sample.readings);
      const auto by_unknowns = d.by_unknowns.topRows<3>();
      if (std::isfinite(frame_variances(d, unknowns, frame).position))
        out[frame.pose] = by_unknowns * unknowns.covariance * by_unknowns.transpose();
      break;
    }
  }
  return out;
}

FrameDifference compare_frame(const CalibratedRobot& a, const CalibratedRobot& b, const Frame& in_a,
                              const Frame& in_b, const std::vector<Readings>& postures_a,
                              const std::vector<Readings>& postures_b) {
  struct Side {
    const CalibratedRobot& robot;
    const Frame& frame;
    const std::vector<Readings>& postures;
  };
  const Side sides[] = {{a, in_a, postures_a}, {b, in_b, postures_b}};
  FrameDifference out{in_a.name, 0, 0, 0, 0, 0, 0, 0};
  for (size_t i = 0; i < postures_a.size(); ++i) {
    if (!has_readings(*a.rig, in_a.link, postures_a[i])) continue;
    ++out.postures;
    Pose pose[2];
    for (int k = 0; k < 2; ++k) {
      const CalibratedRobot& r = sides[k].robot;
      const Readings& readings = sides[k].postures[i];
      pose[k] = base_T_frame(*r.rig, *r.table, r.values, sides[k].frame, readings);
      Variances v{kNan, kNan, 0, 0};
      if (r.unknowns)
        v = frame_variances(
            frame_derivative(*r.rig, *r.table, r.values, *r.unknowns, sides[k].frame, readings),
            *r.unknowns, sides[k].frame);
      out.position_sigma += v.position;
      out.rotation_sigma += v.rotation;
    }
    const Pose e = inverse(pose[0]) * pose[1];
    const double position = e.translation.norm(), rotation = log_so3(e.rotation).norm();
    out.position_rms += position * position;
    out.rotation_rms += rotation * rotation;
    out.position_worst = std::max(out.position_worst, position);
    out.rotation_worst = std::max(out.rotation_worst, rotation);
  }
  const double n = out.postures > 0 ? static_cast<double>(out.postures) : kNan;
  for (double* squared :
       {&out.position_rms, &out.rotation_rms, &out.position_sigma, &out.rotation_sigma})
    *squared = std::sqrt(*squared / n);
  if (out.postures == 0) out.position_worst = out.rotation_worst = kNan;
  return out;
}

}  // namespace kincal
