#include "starts.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "../../solver/levenberg_marquardt.h"
#include "../sensors/tilting_laser.h"

namespace kincal {
namespace {

using Eigen::Matrix3Xd;

Matrix3d nearest_rotation(const Matrix3d& m) {
  const SingularValues3 svd = singular_values(m);
  const double sign = (svd.u * svd.v.transpose()).determinant() < 0 ? -1 : 1;
  return svd.u * Vector3d(1, 1, sign).asDiagonal() * svd.v.transpose();
}

Matrix3Xd columns_of(const std::vector<Vector3d>& points) {
  Matrix3Xd out(3, static_cast<Eigen::Index>(points.size()));
  for (size_t i = 0; i < points.size(); ++i) out.col(static_cast<Eigen::Index>(i)) = points[i];
  return out;
}

Matrix3Xd select_columns(const Matrix3Xd& points, const std::vector<int>& ids) {
  Matrix3Xd out(3, static_cast<Eigen::Index>(ids.size()));
  for (size_t i = 0; i < ids.size(); ++i) out.col(static_cast<Eigen::Index>(i)) = points.col(ids[i]);
  return out;
}

/// Directions (x, y, 1) of a view's pixels, by Newton's method on the sensor's own projection far away (where a baseline
/// does not show). False for each that does not converge.
std::vector<bool> directions(const Sensor& sensor, const double* parameters, const View& view, int count, Matrix3Xd& xy1) {
  constexpr double kFar = 1e6;
  std::vector<bool> good(count, false);
  Matrix3Xd point(3, 1);
  const int id = 0;
  Columns columns;
  RowMatrix rows(2, 6);
  for (int i = 0; i < count; ++i) {
    Eigen::Vector2d p(0, 0), r;
    for (int step = 0; step < 100 && !good[i]; ++step) {
      point << kFar * p, kFar;
      ViewInput in;
      in.parameters = parameters;
      in.points = &point;
      in.ids = &id;
      in.count = 1;
      in.z = view.z.data() + 2 * i;
      rows.setZero();
      Eigen::Ref<RowMatrix> l(rows);
      if (!sensor.model->evaluate(in, columns, r.data(), &l)) break;
      const Eigen::Vector2d step_p = (rows.leftCols<2>() * kFar).inverse() * r;
      if (!step_p.allFinite()) break;
      p -= step_p;
      if (p.norm() > 50) p *= 50 / p.norm();
      good[i] = step_p.norm() < 1e-9;
    }
    xy1.col(i) << p, 1;
  }
  return good;
}

/// Poses sensor_T_target of points c whose directions are xy1: DLT, for planes both mirror solutions.
std::vector<Pose> perspective_poses(const Matrix3Xd& c, const Matrix3Xd& xy1) {
  const Eigen::Index n = c.cols();
  std::vector<Pose> out;
  if (n == 0) return out;
  const Vector3d mean = c.rowwise().mean(), sight = xy1.rowwise().mean();
  const Matrix3Xd centred = c.colwise() - mean;
  const SingularValues svd = singular_values(centred, Eigen::ComputeFullU);
  Vector3d spread = Vector3d::Zero();
  spread.head(svd.values.size()) = svd.values;
  Matrix3d axes = svd.u;  // columns: principal axes in the target's frame
  if (axes.determinant() < 0) axes.col(2) *= -1;
  const double size = std::max(centred.colwise().norm().maxCoeff(), 1e-6);
  const bool flat = spread(2) <= 1e-6 * spread(0);
  if (n >= 4 && spread(1) > 1e-6 * spread(0) && (flat || n >= 6)) {
    const Matrix3Xd q = axes.transpose() * centred / size;
    const double scale = std::max((xy1.colwise() - sight).norm() / std::sqrt(static_cast<double>(n)), 1e-12);
    const int k = flat ? 3 : 4;  // columns of the projective matrix: x, y, (z,) 1
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(2 * n, 3 * k);
    for (Eigen::Index i = 0; i < n; ++i) {
      VectorXd h(k);
      if (flat)
        h << q.col(i).head<2>(), 1;
      else
        h << q.col(i), 1;
      const Vector3d s = (xy1.col(i) - sight) / scale;
      a.row(2 * i).head(k) = h.transpose();
      a.row(2 * i).tail(k) = -s.x() * h.transpose();
      a.row(2 * i + 1).segment(k, k) = h.transpose();
      a.row(2 * i + 1).tail(k) = -s.y() * h.transpose();
    }
    const SymmetricEigen solution = symmetric_eigen(a.transpose() * a);
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor> m =
        Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>>(VectorXd(solution.vectors.col(0)).data(), 3, k);
    m.topRows<2>() = (scale * m.topRows<2>() + sight.head<2>() * m.row(2)).eval();
    const double norm = (m.col(0).norm() + m.col(1).norm()) / 2;
    m *= (m(2, k - 1) > 0 ? 1 : -1) / norm;
    Matrix3d r;
    r.leftCols<2>() = m.leftCols<2>();
    if (flat)
      r.col(2) = Vector3d(m.col(0)).cross(Vector3d(m.col(1)));
    else
      r.col(2) = m.col(2);
    r = nearest_rotation(r);
    const Vector3d t = m.col(k - 1) * size, line = t.normalized();
    std::vector<Matrix3d> rotations = {r};
    // A plane's mirror image across the line of sight looks almost the same from afar.
    if (flat) rotations.push_back((2 * line * line.transpose() - Matrix3d::Identity()) * r * Vector3d(-1, -1, 1).asDiagonal());
    for (const Matrix3d& rotation : rotations) {
      Pose pose;
      pose.rotation = rotation * axes.transpose();
      pose.translation = t - pose.rotation * mean;
      out.push_back(pose);
    }
  }
  const bool in_front = std::any_of(out.begin(), out.end(),
                                    [&](const Pose& p) { return ((p.rotation.row(2) * c).array() + p.translation.z()).minCoeff() > 0; });
  if (!in_front || n < 6)  // too few points, or all but degenerate ones
    for (double sign : {1.0, -1.0}) {
      Pose pose;
      pose.rotation.diagonal() << 1, sign, sign;
      pose.translation = std::max(1.0, 4 * size) * sight - pose.rotation * mean;
      out.push_back(pose);
    }
  return out;
}

/// Directions of a view's pixels that could be found, and the places of their points in the view.
Matrix3Xd seen_directions(const Rig& rig, const ParameterTable& table, const VectorXd& values, const View& view, int count,
                          std::vector<int>& keep) {
  Matrix3Xd xy1(3, count);
  const int block = table.sensor_block[view.sensor];
  const std::vector<bool> good =
      directions(rig.sensors[view.sensor], block >= 0 ? values.data() + table.all[block].start : nullptr, view, count, xy1);
  keep.clear();
  for (int i = 0; i < count; ++i)
    if (good[i]) keep.push_back(i);
  return select_columns(xy1, keep);
}

/// Pose of one camera from points and directions of many views together: of perspective_poses() that with the least angles.
/// False if they do not determine it.
bool pose_from_directions(const Matrix3Xd& points, const Matrix3Xd& xy1, Pose& camera_T_frame) {
  if (points.cols() < 4 || on_a_line(points)) return false;
  double least = std::numeric_limits<double>::infinity();
  for (const Pose& pose : perspective_poses(points, xy1)) {
    double sum = 0;
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      sum += ((pose * Vector3d(points.col(i))).normalized() - xy1.col(i).normalized()).norm();
    if (sum < least) least = sum, camera_T_frame = pose;
  }
  return std::isfinite(least);
}

/// Pose frame_T_target of points p seen along rays o + s d, all in the frame:  d x (R p + t) = d x o, linear in R and t. Coordinates
/// along the points' principal axes; of a plane the third column of R is the cross product. False if the rays do not determine it.
bool pose_from_rays(const Matrix3Xd& p, const Matrix3Xd& o, const Matrix3Xd& d, Pose& frame_T_target) {
  const Eigen::Index n = p.cols();
  if (n < 4 || on_a_line(p)) return false;
  const Vector3d mean = p.rowwise().mean();
  const SingularValues svd = singular_values(p.colwise() - mean, Eigen::ComputeFullU);
  Matrix3d axes = svd.u;
  if (axes.determinant() < 0) axes.col(2) *= -1;
  const Matrix3Xd q = axes.transpose() * (p.colwise() - mean);
  const int k = svd.values(2) <= 1e-6 * svd.values(0) ? 2 : 3;
  Eigen::MatrixXd a(3 * n, 3 * k + 3);
  VectorXd right(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Matrix3d cross = skew(d.col(i));
    for (int c = 0; c < k; ++c) a.block<3, 3>(3 * i, 3 * c) = q(c, i) * cross;
    a.block<3, 3>(3 * i, 3 * k) = cross;
    right.segment<3>(3 * i) = cross * o.col(i);
  }
  VectorXd x;
  if (!least_squares(a, right, 1e-6, x)) return false;
  Matrix3d r;
  r.col(0) = x.segment<3>(0);
  r.col(1) = x.segment<3>(3);
  if (k == 3)
    r.col(2) = x.segment<3>(6);
  else
    r.col(2) = r.col(0).cross(r.col(1)) / std::max(r.col(0).norm(), 1e-12);
  r = nearest_rotation(r);
  for (Eigen::Index i = 0; i < n; ++i) right.segment<3>(3 * i) = d.col(i).cross(Vector3d(o.col(i) - r * q.col(i)));
  const Vector3d t = least_squares(Eigen::Matrix<double, Eigen::Dynamic, 3>(a.rightCols<3>()), right);
  frame_T_target.rotation = r * axes.transpose();
  frame_T_target.translation = t - frame_T_target.rotation * mean;
  return true;
}

/// What one view says of sensor_T_target, by itself; nothing for chains' and scanners' views.
std::vector<Pose> view_poses(const Rig& rig, const ParameterTable& table, const VectorXd& values, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const Target& target = rig.targets[view.target];
  const std::vector<int> ids = view_ids(view, target);
  const Matrix3Xd points = select_columns(target_points(rig, table, values, view.target), ids);
  const Eigen::Index n = points.cols();
  switch (sensor.model->sight()) {
    case Sight::pose: {
      Pose z;
      z.translation << view.z[0], view.z[1], view.z[2];
      z.rotation = rotation_from_quaternion(Eigen::Vector4d(view.z[3], view.z[4], view.z[5], view.z[6]));
      return {z};
    }
    case Sight::chain:
      return {Pose()};
    case Sight::points:
      return {fit_points(points, Eigen::Map<const Matrix3Xd>(view.z.data(), 3, n))};
    case Sight::rays: {
      std::vector<int> keep;
      const Matrix3Xd xy1 = seen_directions(rig, table, values, view, static_cast<int>(n), keep);
      return perspective_poses(select_columns(points, keep), xy1);
    }
    default:
      return {};
  }
}

/// The points of a scanning view in the base frame.
Matrix3Xd scanned_points(const Rig& rig, const ParameterTable& table, const VectorXd& values, const Sample& sample, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const Pose link_T_sensor = get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
  Matrix3Xd out(3, static_cast<Eigen::Index>(view.z.size() / 3));
  for (Eigen::Index i = 0; i < out.cols(); ++i) {
    const double* z = view.z.data() + 3 * i;
    out.col(i) =
        Configuration(rig, table, values, sample.readings).with(sensor.scanning_joint, z[0]).base_T_link(sensor.link) * link_T_sensor * TiltingLaser::measured_point(z);
  }
  return out;
}

/// Proposals for base_T_target from one view whose sensor's pose is known.
std::vector<Pose> proposals(const Rig& rig, const ParameterTable& table, const VectorXd& values, const Sample& sample, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  if (sensor.model->sight() == Sight::scan) {
    const std::vector<int> ids = view_ids(view, rig.targets[view.target]);
    return {
        fit_points(select_columns(target_points(rig, table, values, view.target), ids), scanned_points(rig, table, values, sample, view))};
  }
  const Pose base_T_sensor =
      Configuration(rig, table, values, sample.readings).base_T_link(sensor.link) * get_pose(values, table.all[table.sensor_pose[view.sensor]].start);
  std::vector<Pose> out;
  for (const Pose& p : view_poses(rig, table, values, view)) out.push_back(base_T_sensor * p);
  return out;
}

/// Mean of poses that is not moved by a minority of wrong ones: around the medoid, of those within three median distances.
Pose robust_mean(const std::vector<Pose>& poses, double length) {
  const auto distance = [&](const Pose& a, const Pose& b) {
    return log_so3(a.rotation.transpose() * b.rotation).norm() + (a.translation - b.translation).norm() / length;
  };
  size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  const size_t stride = std::max<size_t>(1, poses.size() / 200);  // enough candidates for many samples
  for (size_t i = 0; i < poses.size(); i += stride) {
    double sum = 0;
    for (const Pose& p : poses) sum += distance(poses[i], p);
    if (sum < least) least = sum, best = i;
  }
  std::vector<double> away;
  for (const Pose& p : poses) away.push_back(distance(poses[best], p));
  std::vector<double> sorted = away;
  std::nth_element(sorted.begin(), sorted.begin() + sorted.size() / 2, sorted.end());
  const double limit = 3 * sorted[sorted.size() / 2] + 1e-9;
  Matrix3d rotation = Matrix3d::Zero();
  Vector3d translation = Vector3d::Zero();
  int count = 0;
  for (size_t i = 0; i < poses.size(); ++i)
    if (away[i] <= limit) rotation += poses[i].rotation, translation += poses[i].translation, ++count;
  return {nearest_rotation(rotation), translation / count};
}

/// X and Y of A_i X = Y B_i. False if the rotations do not determine them.
bool robot_world_hand_eye(const std::vector<Pose>& a, const std::vector<Pose>& b, Pose& x, Pose& y) {
  const Eigen::Index n = static_cast<Eigen::Index>(a.size());
  if (n < 3) return false;
  Eigen::Matrix<double, 9, 9> t = Eigen::Matrix<double, 9, 9>::Zero();  // vec(R_Y) = (R_B (x) R_A) vec(R_X)
  for (Eigen::Index i = 0; i < n; ++i)
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) t.block<3, 3>(3 * r, 3 * c) += b[i].rotation(r, c) * a[i].rotation;
  const SingularValues9 svd = singular_values(t);
  if (svd.values(0) - svd.values(1) < 1e-4 * n) return false;
  Eigen::Matrix<double, 9, 1> vx = svd.v.col(0), vy = svd.u.col(0);
  Matrix3d rx = Eigen::Map<Matrix3d>(vx.data()), ry = Eigen::Map<Matrix3d>(vy.data());
  if (rx.determinant() < 0) rx = -rx;
  if (ry.determinant() < 0) ry = -ry;
  x.rotation = nearest_rotation(rx);
  y.rotation = nearest_rotation(ry);
  Eigen::MatrixXd m(3 * n, 6);
  VectorXd right(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {  // R_A t_X - t_Y = R_Y t_B - t_A
    m.block<3, 3>(3 * i, 0) = a[i].rotation;
    m.block<3, 3>(3 * i, 3) = -Matrix3d::Identity();
    right.segment<3>(3 * i) = y.rotation * b[i].translation - a[i].translation;
  }
  const VectorXd solution = shortest_least_squares(m, right);
  x.translation = solution.head<3>();
  y.translation = solution.tail<3>();
  return true;
}

/// The same with a minority of relations that are grossly wrong: least squares over all, or where three relations explain the middle one
/// better by far (a third of the discrepancy; 200 draws), over those that these explain (five times the middle one).
bool robust_robot_world_hand_eye(const std::vector<Pose>& a, const std::vector<Pose>& b, Pose& x, Pose& y) {
  if (!robot_world_hand_eye(a, b, x, y)) return false;
  const size_t n = a.size();
  std::vector<double> away(n);
  const auto middle = [&](const Pose& x_of, const Pose& y_of) {
    for (size_t i = 0; i < n; ++i) {
      const Pose difference = inverse(y_of * b[i]) * (a[i] * x_of);
      away[i] = log_so3(difference.rotation).norm() + difference.translation.norm();
    }
    std::vector<double> sorted = away;
    std::nth_element(sorted.begin(), sorted.begin() + n / 2, sorted.end());
    return sorted[n / 2];
  };
  double least = middle(x, y) / 3;
  bool better = false;
  std::mt19937_64 engine(1);
  for (int draw = 0; draw < 200 && n > 6; ++draw) {
    const size_t i = engine() % n, j = engine() % n, k = engine() % n;
    Pose trial_x, trial_y;
    if (i == j || j == k || k == i || !robot_world_hand_eye({a[i], a[j], a[k]}, {b[i], b[j], b[k]}, trial_x, trial_y)) continue;
    const double one = middle(trial_x, trial_y);
    if (one < least) least = one, x = trial_x, y = trial_y, better = true;
  }
  for (int round = 0; better && round < 5; ++round) {
    const double limit = 5 * middle(x, y) + 1e-9;
    std::vector<Pose> kept_a, kept_b;
    for (size_t i = 0; i < n; ++i)
      if (away[i] <= limit) kept_a.push_back(a[i]), kept_b.push_back(b[i]);
    if (!robot_world_hand_eye(kept_a, kept_b, x, y)) break;
  }
  return true;
}

}  // namespace

Pose fit_points(const Matrix3Xd& a, const Matrix3Xd& b) {
  Pose out;
  if (a.cols() == 0) return out;
  const Vector3d ca = a.rowwise().mean(), cb = b.rowwise().mean();
  if (a.cols() >= 2) {
    const Matrix3Xd da = a.colwise() - ca, db = b.colwise() - cb;
    if (a.cols() >= 3)
      out.rotation = nearest_rotation(db * da.transpose());
    else if (da.col(0).norm() > 0 && db.col(0).norm() > 0)
      out.rotation = Eigen::Quaterniond::FromTwoVectors(da.col(0), db.col(0)).toRotationMatrix();
  }
  out.translation = cb - out.rotation * ca;
  return out;
}

void start_targets(const Recording& recording, const std::vector<int>& samples, const std::vector<int>& sensors, const Loss& loss,
                   Values& values, bool refined) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const std::vector<Sample>& all = recording.samples;
  std::vector<char> used(rig.sensors.size(), 0);
  for (int s : sensors) used[s] = 1;
  for (int index : samples) {
    std::vector<int> targets;
    for (const View& v : all[index].views)
      if (used[v.sensor] && rig.targets[v.target].link < 0 && std::find(targets.begin(), targets.end(), v.target) == targets.end())
        targets.push_back(v.target);
    for (int target : targets) {
      EstimationSetup setup;
      setup.noise = NoiseMode::none;
      setup.sensors = sensors;
      setup.only_target = target;
      setup.loss = {LossKind::soft_l1, 1};
      Estimation rank(recording, {index}, setup);
      Values trial;
      trial.shared = values.shared;
      const auto before = values.targets.find({index, target});
      if (before != values.targets.end()) {  // from an earlier step: kept, if it can be evaluated
        trial.targets[{index, target}] = before->second;
        const VectorXd state = rank.pack(trial);
        rank.renew(state);
        Cost cost;
        if (rank.evaluate(0, state, 0, cost) && std::isfinite(cost.twice)) continue;
      }
      setup.loss = loss;
      Estimation refine(recording, {index}, setup);
      std::vector<Pose> found;
      for (const View& v : all[index].views)
        if (used[v.sensor] && v.target == target)
          for (const Pose& p : proposals(rig, table, values.shared, all[index], v)) found.push_back(p);
      std::vector<std::pair<double, size_t>> order;
      for (size_t i = 0; i < found.size(); ++i) {
        trial.targets[{index, target}] = found[i];
        const VectorXd state = rank.pack(trial);
        rank.renew(state);
        Cost cost;
        if (rank.evaluate(0, state, 0, cost) && std::isfinite(cost.twice)) order.push_back({cost.twice, i});
      }
      if (order.empty())
        throw std::runtime_error("sample '" + all[index].id + "': no start found for the pose of target '" + rig.targets[target].name +
                                 "': at every pose that its views propose some point lies behind a camera");
      std::sort(order.begin(), order.end());
      double least = std::numeric_limits<double>::infinity();
      Pose best = found[order[0].second];
      if (!refined) {
        values.targets[{index, target}] = best;
        continue;
      }
      for (size_t i = 0; i < order.size() && i < 2; ++i) {
        trial.targets[{index, target}] = found[order[i].second];
        VectorXd state = refine.pack(trial);
        SolverOptions options;
        options.max_iterations = 60;
        const SolveSummary summary = LevenbergMarquardt(refine, options).solve(state);
        if (summary.outcome != Outcome::undefined_start && summary.cost.twice < least * (1 - 1e-9)) {
          least = summary.cost.twice;
          refine.unpack(state, trial);
          best = trial.targets[{index, target}];
        }
      }
      values.targets[{index, target}] = best;
    }
  }
}

std::optional<Pose> pose_from_view(const Rig& rig, const ParameterTable& table, const VectorXd& values, const View& view) {
  const Sight sight = rig.sensors[view.sensor].model->sight();
  const Matrix3Xd points = select_columns(target_points(rig, table, values, view.target), view_ids(view, rig.targets[view.target]));
  if (sight == Sight::chain) return Pose();
  if (sight != Sight::pose && !((sight == Sight::points || (sight == Sight::rays && points.cols() >= 4)) && !on_a_line(points)))
    return std::nullopt;
  // Alone with its sensor at the origin of a one-view problem: the same refinement as for free targets.
  Rig alone;
  alone.tree.links = {"base"};
  finish_tree(alone.tree);
  alone.targets = {rig.targets[view.target]};
  alone.targets[0].link = -1;
  alone.sensors = {rig.sensors[view.sensor]};
  alone.sensors[0].link = 0;
  alone.sensors[0].link_T_sensor = Pose();
  std::vector<Sample> one(1);
  one[0].views = {view};
  one[0].views[0].sensor = one[0].views[0].target = 0;
  const Recording recording(std::move(alone), std::move(one));
  const ParameterTable& small = recording.table;
  Values result;
  result.shared = small.initial;
  const auto copy = [&](int to, int from) {
    if (from < 0) return;
    const Parameter& p = table.all[from];
    result.shared.segment(small.all[to].start, p.size()) = values.segment(p.start, p.size());
  };
  for (size_t b = 0; b < recording.rig.sensors[0].parameters.size(); ++b)
    copy(small.sensor_block[0] + static_cast<int>(b), table.sensor_block[view.sensor] + static_cast<int>(b));
  copy(small.target_square[0], table.target_square[view.target]);
  copy(small.target_points[0], table.target_points[view.target]);
  try {
    start_targets(recording, {0}, {0}, {LossKind::soft_l1, 3}, result);
  } catch (const std::runtime_error&) {  // at every pose some point lies behind the camera
    return std::nullopt;
  }
  return result.targets[{0, 0}];
}

std::vector<std::string> start_unknown_poses(const Recording& recording, const std::vector<int>& samples, const std::vector<int>& unknown,
                                             Values& values) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const std::vector<Sample>& all = recording.samples;
  std::vector<char> known(table.all.size(), 1);
  for (int p : unknown) known[p] = 0;
  const auto start_of = [&](int p) { return table.all[p].start; };
  std::vector<int> open = unknown;
  std::vector<std::string> failed;

  // What each view alone says of sensor_T_target; a camera's two mirror solutions by their own residuals.
  struct Seen {
    int sample;
    const View* view;
    bool pose;  // `sensor_T_target` is there
    Pose sensor_T_target;
  };
  std::vector<Seen> seen;
  for (int index : samples)
    for (const View& v : all[index].views) {
      const std::optional<Pose> pose = pose_from_view(rig, table, values.shared, v);
      seen.push_back({index, &v, pose.has_value(), pose.value_or(Pose())});
    }

  while (!open.empty()) {
    // base_T_target where sensors with known poses see a free target, or where a mounted one's pose is known.
    std::vector<int> known_sensors;
    for (int s = 0; s < static_cast<int>(rig.sensors.size()); ++s)
      if (known[table.sensor_pose[s]]) known_sensors.push_back(s);
    Values with;
    with.shared = values.shared;
    std::map<std::pair<int, int>, Pose> hub;
    for (int index : samples) {
      try {
        start_targets(recording, {index}, known_sensors, {LossKind::soft_l1, 3}, with);
      } catch (const std::runtime_error&) {
      }
      for (const View& v : all[index].views)
        if (rig.targets[v.target].link >= 0 && known[table.target_pose[v.target]])
          hub[{index, v.target}] = Configuration(rig, table, values.shared, all[index].readings).base_T_link(rig.targets[v.target].link) *
                                   get_pose(values.shared, start_of(table.target_pose[v.target]));
    }
    for (const auto& t : with.targets) hub[t.first] = t.second;

    // One unknown in a relation: means of poses, or point correspondences, whichever has more to say.
    int best = -1;
    size_t most = 0;
    Pose best_pose;
    for (int parameter : open) {
      std::vector<Pose> poses;
      std::vector<Vector3d> from, to;                                 // the unknown pose takes `from` to `to`
      std::vector<Vector3d> ray_points, ray_origins, ray_directions;  // where single views have no pose: points, and rays that they lie on
      for (const Seen& s : seen) {
        const View& v = *s.view;
        const Sensor& sensor = rig.sensors[v.sensor];
        const bool scan = sensor.model->sight() == Sight::scan;
        const Matrix3Xd points = select_columns(target_points(rig, table, values.shared, v.target), view_ids(v, rig.targets[v.target]));
        const auto rays_of = [&](const Pose& frame_T_points, const Pose& frame_T_sensor) {
          std::vector<int> keep;
          const Matrix3Xd xy1 = seen_directions(rig, table, values.shared, v, static_cast<int>(points.cols()), keep);
          for (size_t i = 0; i < keep.size(); ++i) {
            ray_points.push_back(frame_T_points * Vector3d(points.col(keep[i])));
            ray_origins.push_back(frame_T_sensor.translation);
            ray_directions.push_back(frame_T_sensor.rotation * xy1.col(static_cast<Eigen::Index>(i)));
          }
        };
        const bool lone_rays = sensor.model->sight() == Sight::rays && !s.pose;
        if (table.sensor_pose[v.sensor] == parameter && hub.count({s.sample, v.target})) {
          const Pose g = hub[{s.sample, v.target}];
          if (lone_rays) rays_of(inverse(Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(sensor.link)) * g, Pose());
          if (s.pose)
            poses.push_back(inverse(Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(sensor.link)) * g * inverse(s.sensor_T_target));
          if (scan || sensor.model->sight() == Sight::points)
            for (Eigen::Index i = 0; i < points.cols(); ++i) {
              const double* z = v.z.data() + 3 * i;
              const Pose link = scan ? Configuration(rig, table, values.shared, all[s.sample].readings).with(sensor.scanning_joint, z[0]).base_T_link(sensor.link)
                                     : Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(sensor.link);
              from.push_back(scan ? TiltingLaser::measured_point(z) : Vector3d(z[0], z[1], z[2]));
              to.push_back(inverse(link) * (g * Vector3d(points.col(i))));
            }
        }
        if (table.target_pose[v.target] == parameter && known[table.sensor_pose[v.sensor]]) {
          const Pose target_link = Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(rig.targets[v.target].link);
          if (lone_rays)
            rays_of(Pose(), inverse(target_link) * Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(sensor.link) *
                                get_pose(values.shared, start_of(table.sensor_pose[v.sensor])));
          if (scan || sensor.model->sight() == Sight::points) {
            Matrix3Xd in_base;
            if (scan) {
              in_base = scanned_points(rig, table, values.shared, all[s.sample], v);
            } else {
              const Pose base_T_sensor = Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(sensor.link) *
                                         get_pose(values.shared, start_of(table.sensor_pose[v.sensor]));
              in_base.resize(3, points.cols());
              for (Eigen::Index i = 0; i < points.cols(); ++i)
                in_base.col(i) = base_T_sensor * Vector3d(Eigen::Map<const Vector3d>(v.z.data() + 3 * i));
            }
            for (Eigen::Index i = 0; i < points.cols(); ++i) {
              from.push_back(points.col(i));
              to.push_back(inverse(target_link) * Vector3d(in_base.col(i)));
            }
          } else if (s.pose) {
            poses.push_back(inverse(target_link) * Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(sensor.link) *
                            get_pose(values.shared, start_of(table.sensor_pose[v.sensor])) * s.sensor_T_target);
          }
        }
      }
      if (poses.empty() && from.empty() && !ray_points.empty()) {
        const bool is_sensor = std::count(table.sensor_pose.begin(), table.sensor_pose.end(), parameter) > 0;
        Pose found;
        if (is_sensor && pose_from_directions(columns_of(ray_points), columns_of(ray_directions), found)) poses.push_back(inverse(found));
        if (!is_sensor && pose_from_rays(columns_of(ray_points), columns_of(ray_origins), columns_of(ray_directions), found))
          poses.push_back(found);
      }
      const Matrix3Xd a = columns_of(from), b = columns_of(to);
      const bool by_points = !from.empty() && !on_a_line(a);
      const size_t weight = std::max(poses.size() * 4, by_points ? from.size() : size_t(0));
      if (weight <= most) continue;
      most = weight;
      best = parameter;
      best_pose = poses.size() * 4 >= (by_points ? from.size() : 0) ? robust_mean(poses, 1.0) : fit_points(a, b);
    }
    const auto settle = [&](int parameter, const Pose& pose) {
      set_pose(values.shared, start_of(parameter), pose);
      known[parameter] = 1;
      open.erase(std::find(open.begin(), open.end(), parameter));
    };
    if (best >= 0) {
      settle(best, best_pose);
      continue;
    }

    // Two unknowns in a relation L_a X_a P = L_b X_b Q, that is A X = Y B with A = L_b^-1 L_a, X = X_a, Y = X_b, B = Q P^-1.
    struct Pair {
      std::vector<Pose> a, b;
    };
    std::map<std::pair<int, int>, Pair> pairs;
    const auto side = [&](const Seen& s, int& parameter, Pose& link) {
      parameter = table.sensor_pose[s.view->sensor];
      link = Configuration(rig, table, values.shared, all[s.sample].readings).base_T_link(rig.sensors[s.view->sensor].link);
    };
    for (size_t i = 0; i < seen.size(); ++i) {
      if (!seen[i].pose || known[table.sensor_pose[seen[i].view->sensor]]) continue;
      int pa, pb;
      Pose la, lb;
      side(seen[i], pa, la);
      const int target = seen[i].view->target;
      if (rig.targets[target].link >= 0) {
        pb = table.target_pose[target];
        if (known[pb]) continue;
        lb = Configuration(rig, table, values.shared, all[seen[i].sample].readings).base_T_link(rig.targets[target].link);
        Pair& pair = pairs[{pa, pb}];
        pair.a.push_back(inverse(lb) * la);
        pair.b.push_back(inverse(seen[i].sensor_T_target));
        continue;
      }
      for (size_t k = i + 1; k < seen.size() && seen[k].sample == seen[i].sample; ++k) {
        if (!seen[k].pose || seen[k].view->target != target || known[table.sensor_pose[seen[k].view->sensor]]) continue;
        side(seen[k], pb, lb);
        if (pa == pb) continue;
        Pair& pair = pairs[{pa, pb}];
        pair.a.push_back(inverse(lb) * la);
        pair.b.push_back(seen[k].sensor_T_target * inverse(seen[i].sensor_T_target));
      }
    }
    std::pair<int, int> chosen(-1, -1);
    Pose x, y;
    most = 0;
    for (const auto& p : pairs) {
      Pose trial_x, trial_y;
      if (p.second.a.size() <= most || !robust_robot_world_hand_eye(p.second.a, p.second.b, trial_x, trial_y)) continue;
      most = p.second.a.size();
      chosen = p.first;
      x = trial_x;
      y = trial_y;
    }
    if (chosen.first >= 0) {
      settle(chosen.first, x);
      settle(chosen.second, y);
      continue;
    }
    failed.push_back(table.all[open.front()].name);  // nothing ties it to anything: the identity, and the others from there
    settle(open.front(), get_pose(values.shared, start_of(open.front())));
  }
  return failed;
}

}  // namespace kincal
