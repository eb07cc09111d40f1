// What the tests of models/ and solver/ share: a small but nasty robot with every type of sensor and target, and an independent
// forward model that makes its samples.
//
// The forward model here is the formats' text written down a second time, as plainly as possible: link poses by climbing from a link
// to the root with Eigen's isometries, residuals and own covariances sensor by sensor, derivatives only ever numeric. It shares the
// data structures of rig.h with the code under test, but none of its functions: no path, no Columns, no Estimation.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "../models/estimation/estimation.h"
#include "../models/sensors/sensors.h"

namespace kincal::fixture {

using Eigen::Isometry3d;
using Eigen::Vector2d;

constexpr double kPi = 3.14159265358979323846;

/// Numbers that are the same on every platform: the standard fixes the engine, not its distributions.
class Random {
 public:
  explicit Random(unsigned long seed) : engine_(seed) {}
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  double normal() {
    const double u = 1 - uniform(), v = uniform();
    return std::sqrt(-2 * std::log(u)) * std::cos(2 * kPi * v);
  }
  Vector3d vector(double size) {
    const double x = uniform(-size, size), y = uniform(-size, size), z = uniform(-size, size);
    return {x, y, z};
  }
  Vector3d direction() {
    const double x = normal(), y = normal(), z = normal();
    return Vector3d(x, y, z).normalized();
  }
  Vector6d twist(double translation, double rotation) {
    Vector6d xi;
    const Vector3d v = vector(translation), w = vector(rotation);
    xi << v, w;
    return xi;
  }
  /// Rotation about a random axis by up to `angle`.
  Matrix3d rotation(double angle) {
    const Vector3d axis = direction();
    return Eigen::AngleAxisd(uniform(-angle, angle), axis).toRotationMatrix();
  }
  Pose pose(double translation, double angle) {
    const Matrix3d r = rotation(angle);
    return {r, vector(translation)};
  }

 private:
  std::mt19937_64 engine_;
};

// ---------------------------------------------------------------- transforms, without kinematics/transform.h's functions

inline Isometry3d isometry(const Pose& p) {
  Isometry3d t = Isometry3d::Identity();
  t.linear() = p.rotation;
  t.translation() = p.translation;
  return t;
}
inline Pose to_pose(const Isometry3d& t) { return {t.linear(), t.translation()}; }

inline Matrix3d rpy(double roll, double pitch, double yaw) {
  return (Eigen::AngleAxisd(yaw, Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Vector3d::UnitY()) *
          Eigen::AngleAxisd(roll, Vector3d::UnitX()))
      .toRotationMatrix();
}
inline Pose at(const Vector3d& xyz, const Vector3d& angles = Vector3d::Zero()) { return {rpy(angles.x(), angles.y(), angles.z()), xyz}; }

inline Matrix3d cross_matrix(const Vector3d& v) {
  Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// exp of SE(3) as the matrix exponential it is: series of the halved matrix, squared back.
inline Isometry3d exponential(const Vector6d& xi) {
  Eigen::Matrix4d a = Eigen::Matrix4d::Zero();
  a.topLeftCorner<3, 3>() = cross_matrix(xi.tail<3>());
  a.topRightCorner<3, 1>() = xi.head<3>();
  constexpr int kHalvings = 8;
  a /= 1 << kHalvings;
  Eigen::Matrix4d sum = Eigen::Matrix4d::Identity(), term = sum;
  for (int k = 1; k <= 12; ++k) {
    term = (term * a / k).eval();
    sum += term;
  }
  for (int k = 0; k < kHalvings; ++k) sum = (sum * sum).eval();
  Isometry3d t;
  t.matrix() = sum;
  return t;
}

inline Vector3d rotation_vector(const Matrix3d& r) {
  const Eigen::AngleAxisd a(r);
  const double angle = a.angle() > kPi ? a.angle() - 2 * kPi : a.angle();
  return angle * a.axis();
}

// ---------------------------------------------------------------- building rigs

inline int add_link(Rig& rig, const std::string& name) {
  rig.tree.links.push_back(name);
  return static_cast<int>(rig.tree.links.size()) - 1;
}
inline int link_index(const Rig& rig, const std::string& name) {
  for (size_t i = 0; i < rig.tree.links.size(); ++i)
    if (rig.tree.links[i] == name) return static_cast<int>(i);
  throw std::logic_error("no link " + name);
}
inline int joint_index(const Rig& rig, const std::string& name) {
  for (size_t i = 0; i < rig.tree.joints.size(); ++i)
    if (rig.tree.joints[i].name == name) return static_cast<int>(i);
  throw std::logic_error("no joint " + name);
}
inline int sensor_index(const Rig& rig, const std::string& name) {
  for (size_t i = 0; i < rig.sensors.size(); ++i)
    if (rig.sensors[i].name == name) return static_cast<int>(i);
  throw std::logic_error("no sensor " + name);
}
inline int target_index(const Rig& rig, const std::string& name) {
  for (size_t i = 0; i < rig.targets.size(); ++i)
    if (rig.targets[i].name == name) return static_cast<int>(i);
  throw std::logic_error("no target " + name);
}

/// Joint `name` under link `parent`; its child is the new link `child`.
inline int add_joint(Rig& rig, JointType type, const std::string& name, const std::string& parent, const std::string& child,
                     const Vector3d& axis, const Pose& origin, double sigma = 0) {
  Joint joint;
  joint.name = name;
  joint.type = type;
  joint.parent = link_index(rig, parent);
  joint.child = add_link(rig, child);
  joint.axis = axis.normalized();
  joint.parent_T_joint = origin;
  rig.tree.joints.push_back(joint);
  rig.joints.push_back({sigma, 0, 1});
  return static_cast<int>(rig.tree.joints.size()) - 1;
}
inline int add_mimic(Rig& rig, JointType type, const std::string& name, const std::string& parent, const std::string& child,
                     const Vector3d& axis, const Pose& origin, const std::string& master, double multiplier, double offset) {
  const int joint = add_joint(rig, type, name, parent, child, axis, origin);
  rig.tree.joints[joint].mimic = Mimic{joint_index(rig, master), multiplier, offset};
  return joint;
}

inline int add_sensor(Rig& rig, const std::string& name, const std::string& type, const std::string& link, const Pose& pose,
                      std::shared_ptr<const SensorModel> model, std::vector<double> sigma) {
  Sensor s;
  s.name = name;
  s.type = type;
  s.link = link_index(rig, link);
  s.link_T_sensor = pose;
  s.pose_given = true;
  s.model = std::move(model);
  s.sigma = std::move(sigma);
  rig.sensors.push_back(std::move(s));
  return static_cast<int>(rig.sensors.size()) - 1;
}
inline int add_camera(Rig& rig, const std::string& name, const std::string& link, const Pose& pose, Lens lens = Lens::pinhole,
                      const std::vector<double>& distortion = {}, double baseline = 0, double sigma = 0.2) {
  const int s = add_sensor(rig, name, "camera", link, pose, make_camera(lens, static_cast<int>(distortion.size())), {sigma, sigma});
  rig.sensors[s].parameters = camera_parameters(lens, {500, 510, 319.5, 239.5}, distortion, baseline);
  rig.sensors[s].image_width = 640;
  rig.sensors[s].image_height = 480;
  return s;
}
inline int add_tracker(Rig& rig, const std::string& name, const std::string& link, const Pose& pose, const Vector3d& sigma) {
  return add_sensor(rig, name, "point", link, pose, make_point(), {sigma.x(), sigma.y(), sigma.z()});
}
inline int add_mocap(Rig& rig, const std::string& name, const std::string& link, const Pose& pose, double translation, double rotation) {
  return add_sensor(rig, name, "pose", link, pose, make_pose(), {translation, translation, translation, rotation, rotation, rotation});
}
inline int add_chain(Rig& rig, const std::string& name, const std::string& link, const Pose& pose, double translation, double rotation) {
  return add_sensor(rig, name, "chain", link, pose, make_chain(), {translation, translation, translation, rotation, rotation, rotation});
}
inline int add_laser(Rig& rig, const std::string& name, const std::string& link, const Pose& pose, const std::string& scanning_joint,
                     const Vector3d& sigma) {
  const int s = add_sensor(rig, name, "tilting_laser", link, pose, make_tilting_laser(), {sigma.x(), sigma.y(), sigma.z()});
  rig.sensors[s].scanning_joint = joint_index(rig, scanning_joint);
  return s;
}

/// A chessboard, free if `link` is empty.
inline int add_grid(Rig& rig, const std::string& name, int rows, int columns, double square, const std::string& link = "",
                    const Pose& pose = {}) {
  Target t;
  t.name = name;
  t.type = "chessboard";
  t.layout.resize(3, rows * columns);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c) t.layout.col(r * columns + c) << c, r, 0;
  t.square = square;
  t.link = link.empty() ? -1 : link_index(rig, link);
  t.link_T_target = pose;
  t.pose_given = true;
  rig.targets.push_back(t);
  return static_cast<int>(rig.targets.size()) - 1;
}
inline int add_points(Rig& rig, const std::string& name, const Eigen::Matrix3Xd& points, const std::string& link = "",
                      const Pose& pose = {}) {
  Target t;
  t.name = name;
  t.type = "points";
  t.grid = false;
  t.points = points;
  t.link = link.empty() ? -1 : link_index(rig, link);
  t.link_T_target = pose;
  t.pose_given = true;
  rig.targets.push_back(t);
  return static_cast<int>(rig.targets.size()) - 1;
}

// ---------------------------------------------------------------- the forward model

/// One posture: readings as logged, errors of them (position = scale * (reading + error) + offset), base_T_target of free targets.
struct TruePosture {
  std::vector<double> readings, errors;
  std::map<int, Isometry3d> boards;
};

inline TruePosture empty_posture(const Rig& rig) {
  const size_t n = rig.tree.joints.size();
  return {std::vector<double>(n, 0.0), std::vector<double>(n, 0.0), {}};
}

inline double position(const Rig& rig, int joint, const TruePosture& posture) {
  const Joint& j = rig.tree.joints[joint];
  if (j.mimic) return j.mimic->multiplier * position(rig, j.mimic->master, posture) + j.mimic->offset;
  const JointSettings& s = rig.joints[joint];
  return s.scale * (posture.readings[joint] + posture.errors[joint]) + s.offset;
}

inline Isometry3d root_T_link(const Rig& rig, int link, const TruePosture& posture) {
  Isometry3d t = Isometry3d::Identity();
  for (bool found = true; found;) {
    found = false;
    for (size_t i = 0; i < rig.tree.joints.size() && !found; ++i) {
      const Joint& j = rig.tree.joints[i];
      if (j.child != link) continue;
      Isometry3d motion = Isometry3d::Identity();
      if (j.type == JointType::prismatic)
        motion = Eigen::Translation3d(position(rig, static_cast<int>(i), posture) * j.axis);
      else if (j.type == JointType::revolute || j.type == JointType::continuous)
        motion = Eigen::AngleAxisd(position(rig, static_cast<int>(i), posture), j.axis);
      t = isometry(j.parent_T_joint) * motion * t;
      link = j.parent;
      found = true;
    }
  }
  return t;
}

inline Isometry3d root_T_sensor(const Rig& rig, int sensor, const TruePosture& posture) {
  return root_T_link(rig, rig.sensors[sensor].link, posture) * isometry(rig.sensors[sensor].link_T_sensor);
}
inline Isometry3d root_T_target(const Rig& rig, int target, const TruePosture& posture) {
  const Target& t = rig.targets[target];
  if (t.link >= 0) return root_T_link(rig, t.link, posture) * isometry(t.link_T_target);
  return root_T_link(rig, rig.base, posture) * posture.boards.at(target);
}
inline Isometry3d sensor_T_target(const Rig& rig, int sensor, int target, const TruePosture& posture) {
  return root_T_sensor(rig, sensor, posture).inverse() * root_T_target(rig, target, posture);
}
inline Vector3d target_point(const Target& t, int id) {
  return t.grid ? Vector3d(t.square * t.layout.col(id)) : Vector3d(t.points.col(id));
}

/// The formats' cameras, from OpenCV's documentation. False behind the camera.
inline bool project(const Sensor& s, const Vector3d& p, Vector2d& pixel) {
  const std::vector<double>& in = s.parameters[0].values;
  const double baseline = s.parameters.back().values[0];
  const std::vector<double> d = s.parameters.size() == 3 ? s.parameters[1].values : std::vector<double>();
  const double x = p.x() - baseline, y = p.y(), z = p.z();
  if (d.size() == 4) {
    const double theta = std::atan2(std::sqrt(x * x + y * y), z), phi = std::atan2(y, x);
    const double r = theta + d[0] * std::pow(theta, 3) + d[1] * std::pow(theta, 5) + d[2] * std::pow(theta, 7) + d[3] * std::pow(theta, 9);
    pixel << in[0] * r * std::cos(phi) + in[2], in[1] * r * std::sin(phi) + in[3];
    return true;
  }
  if (z <= 0) return false;
  const double xp = x / z, yp = y / z, r2 = xp * xp + yp * yp;
  double up = 1, down = 1, p1 = 0, p2 = 0;
  if (d.size() >= 5) {
    up = 1 + d[0] * r2 + d[1] * r2 * r2 + d[4] * r2 * r2 * r2;
    p1 = d[2], p2 = d[3];
  }
  if (d.size() == 8) down = 1 + d[5] * r2 + d[6] * r2 * r2 + d[7] * r2 * r2 * r2;
  const double xd = xp * up / down + 2 * p1 * xp * yp + p2 * (r2 + 2 * xp * xp);
  const double yd = yp * up / down + p1 * (r2 + 2 * yp * yp) + 2 * p2 * xp * yp;
  pixel << in[0] * xd + in[2], in[1] * yd + in[3];
  return true;
}

inline std::vector<int> seen_ids(const Rig& rig, const View& view) {
  if (!view.ids.empty()) return view.ids;
  std::vector<int> ids;
  for (int i = 0; i < rig.targets[view.target].count(); ++i) ids.push_back(i);
  return ids;
}

inline Vector3d ray_point(double bearing, double range) { return {range * std::cos(bearing), range * std::sin(bearing), 0}; }

/// TruePosture while one ray is taken: the scanning joint has the ray's reading and no error.
inline TruePosture at_ray(const Rig& rig, int sensor, TruePosture posture, double reading) {
  posture.readings[rig.sensors[sensor].scanning_joint] = reading;
  posture.errors[rig.sensors[sensor].scanning_joint] = 0;
  return posture;
}

/// Predicted minus measured, by the formats' table. `chain_points`: a chain as in noise mode `point`.
inline VectorXd residual(const Rig& rig, const View& view, const TruePosture& posture, bool chain_points = false) {
  const Sensor& s = rig.sensors[view.sensor];
  const Target& t = rig.targets[view.target];
  const std::vector<int> ids = seen_ids(rig, view);
  const Eigen::Index n = static_cast<Eigen::Index>(ids.size());
  if (s.type == "pose" || s.type == "chain") {
    Isometry3d e = sensor_T_target(rig, view.sensor, view.target, posture);
    if (s.type == "pose") {
      Isometry3d z = Isometry3d::Identity();
      z.linear() = Eigen::Quaterniond(view.z[6], view.z[3], view.z[4], view.z[5]).toRotationMatrix();
      z.translation() << view.z[0], view.z[1], view.z[2];
      e = z.inverse() * e;
    }
    if (chain_points && s.type == "chain") {
      VectorXd r(3 * n);
      for (Eigen::Index i = 0; i < n; ++i) r.segment<3>(3 * i) = e * target_point(t, ids[i]) - target_point(t, ids[i]);
      return r;
    }
    VectorXd r(6);
    r << e.translation(), rotation_vector(e.linear());
    return r;
  }
  if (s.type == "camera") {
    const Isometry3d pose = sensor_T_target(rig, view.sensor, view.target, posture);
    VectorXd r(2 * n);
    for (Eigen::Index i = 0; i < n; ++i) {
      Vector2d pixel;
      if (!project(s, pose * target_point(t, ids[i]), pixel)) throw std::logic_error("behind the camera");
      r.segment<2>(2 * i) = pixel - Vector2d(view.z[2 * i], view.z[2 * i + 1]);
    }
    return r;
  }
  VectorXd r(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double* z = view.z.data() + 3 * i;
    if (s.type == "point")
      r.segment<3>(3 * i) = sensor_T_target(rig, view.sensor, view.target, posture) * target_point(t, ids[i]) - Vector3d(z[0], z[1], z[2]);
    else
      r.segment<3>(3 * i) =
          sensor_T_target(rig, view.sensor, view.target, at_ray(rig, view.sensor, posture, z[0])) * target_point(t, ids[i]) -
          ray_point(z[1], z[2]);
  }
  return r;
}

/// Derivative of a vector by one number, at 0: five points, error of order h^4.
template <class Function>
VectorXd derivative(const Function& f, double h) {
  const VectorXd near = f(h) - f(-h), far = f(2 * h) - f(-2 * h);
  return (8 * near - far) / (12 * h);
}

/// The own noise of a view, block diagonal, by the formats' table.
inline MatrixXd own_covariance(const Rig& rig, const View& view, const TruePosture& posture, bool chain_points = false) {
  const Sensor& s = rig.sensors[view.sensor];
  const Eigen::Index n = residual(rig, view, posture, chain_points).size();
  const std::vector<int> ids = seen_ids(rig, view);
  MatrixXd c = MatrixXd::Zero(n, n);
  const VectorXd squared = Eigen::Map<const VectorXd>(view.sigma.data(), static_cast<Eigen::Index>(view.sigma.size())).cwiseAbs2();
  if (!view.covariance.empty()) {
    for (Eigen::Index i = 0; 3 * i < n; ++i) c.block<3, 3>(3 * i, 3 * i) = view.covariance[i];
  } else if (s.type == "tilting_laser") {
    // The point that a ray hits, as the target's link sees it, by the ray's three numbers; turned back into the sensor's frame.
    for (Eigen::Index i = 0; 3 * i < n; ++i) {
      const double* z = view.z.data() + 3 * i;
      const auto target_T_sensor = [&](double reading) {
        return Isometry3d(sensor_T_target(rig, view.sensor, view.target, at_ray(rig, view.sensor, posture, reading)).inverse());
      };
      Matrix3d d;
      d.col(0) = derivative([&](double h) { return VectorXd(target_T_sensor(z[0] + h) * ray_point(z[1], z[2])); }, 1e-3);
      d.col(1) = derivative([&](double h) { return VectorXd(target_T_sensor(z[0]) * ray_point(z[1] + h, z[2])); }, 1e-3);
      d.col(2) = derivative([&](double h) { return VectorXd(target_T_sensor(z[0]) * ray_point(z[1], z[2] + h)); }, 1e-3);
      d = (target_T_sensor(z[0]).linear().transpose() * d).eval();
      c.block<3, 3>(3 * i, 3 * i) = d * squared.asDiagonal() * d.transpose();
    }
  } else if (chain_points && s.type == "chain") {
    for (Eigen::Index i = 0; 3 * i < n; ++i) {
      Eigen::Matrix<double, 3, 6> g;
      g << Matrix3d::Identity(), -cross_matrix(target_point(rig.targets[view.target], ids[i]));
      c.block<3, 3>(3 * i, 3 * i) = g * squared.asDiagonal() * g.transpose();
    }
  } else {
    for (Eigen::Index i = 0; i < n; ++i) c(i, i) = squared(i % squared.size());
  }
  return c;
}

/// Derivative of a view's residual by the readings of all noisy joints, times their sigmas: J_q S^1/2. A scanning joint has none.
inline MatrixXd reading_noise(const Rig& rig, const View& view, const TruePosture& posture, bool chain_points = false) {
  const VectorXd r = residual(rig, view, posture, chain_points);
  std::vector<VectorXd> columns;
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    if (!rig.tree.joints[j].has_reading() || rig.joints[j].sigma == 0 || static_cast<int>(j) == rig.sensors[view.sensor].scanning_joint)
      continue;
    const auto moved = [&](double h) {
      TruePosture p = posture;
      p.errors[j] += h;
      return residual(rig, view, p, chain_points);
    };
    columns.push_back(rig.joints[j].sigma * derivative(moved, 1e-3));
  }
  MatrixXd m(r.size(), static_cast<Eigen::Index>(columns.size()));
  for (size_t k = 0; k < columns.size(); ++k) m.col(static_cast<Eigen::Index>(k)) = columns[k];
  return m;
}

// ---------------------------------------------------------------- samples

/// The reading at which a laser's plane meets a point, nullopt if there is none within reach.
inline std::optional<double> reading_that_hits(const Rig& rig, int sensor, int target, int id, const TruePosture& posture) {
  const auto height = [&](double reading) {
    return (sensor_T_target(rig, sensor, target, at_ray(rig, sensor, posture, reading)) * target_point(rig.targets[target], id)).z();
  };
  constexpr int kCells = 40;
  std::optional<double> best;
  for (int k = -kCells; k < kCells; ++k) {
    double a = 3.0 * k / kCells, b = 3.0 * (k + 1) / kCells, fa = height(a);
    if (fa * height(b) > 0) continue;
    for (int i = 0; i < 60; ++i) {
      const double m = (a + b) / 2, fm = height(m);
      (fm * fa <= 0 ? b : a) = m;
      if (fm * fa > 0) fa = fm;
    }
    if (!best || std::abs(a) < std::abs(*best)) best = (a + b) / 2;
  }
  return best;
}

/// What a sensor measures of a target; nullopt where it cannot see it. Without `noise` exact. The posture's errors are the truth's.
inline std::optional<View> see(const Rig& rig, int sensor, int target, const TruePosture& posture, Random* noise = nullptr,
                               const std::vector<int>& ids = {}) {
  const Sensor& s = rig.sensors[sensor];
  const Target& t = rig.targets[target];
  View v;
  v.sensor = sensor;
  v.target = target;
  v.sigma = s.sigma;
  v.where = "fixture";
  const auto error = [&](double sigma) { return noise ? sigma * noise->normal() : 0.0; };
  if (s.type == "chain") return v;
  if (s.type == "pose") {
    Vector6d e;
    for (int k = 0; k < 6; ++k) e(k) = error(s.sigma[k]);
    const Isometry3d z = sensor_T_target(rig, sensor, target, posture) * exponential(e).inverse();
    const Eigen::Quaterniond q(z.linear());
    v.z = {z.translation().x(), z.translation().y(), z.translation().z(), q.x(), q.y(), q.z(), q.w()};
    return v;
  }
  v.ids = ids.empty() ? seen_ids(rig, v) : ids;
  for (const int id : v.ids) {
    if (s.type == "tilting_laser") {
      const std::optional<double> tilt = reading_that_hits(rig, sensor, target, id, posture);
      if (!tilt) return std::nullopt;
      const Vector3d p = sensor_T_target(rig, sensor, target, at_ray(rig, sensor, posture, *tilt)) * target_point(t, id);
      v.z.push_back(*tilt + error(s.sigma[0]));
      v.z.push_back(std::atan2(p.y(), p.x()) + error(s.sigma[1]));
      v.z.push_back(p.norm() + error(s.sigma[2]));
      continue;
    }
    const Vector3d p = sensor_T_target(rig, sensor, target, posture) * target_point(t, id);
    if (s.type == "point") {
      for (int k = 0; k < 3; ++k) v.z.push_back(p(k) + error(s.sigma[k]));
      continue;
    }
    Vector2d pixel;
    const bool fisheye = s.parameters.size() == 3 && s.parameters[1].values.size() == 4;
    if (fisheye ? p.z() < -0.15 * p.norm() || p.norm() < 0.1 : p.z() < 0.1 || p.head<2>().norm() > 1.3 * p.z()) return std::nullopt;
    if (!project(s, p, pixel)) return std::nullopt;
    v.z.push_back(pixel.x() + error(s.sigma[0]));
    v.z.push_back(pixel.y() + error(s.sigma[1]));
  }
  return v;
}

/// Readings uniform within `range` (prismatic: a fifth of it), errors drawn with the joints' sigmas if `noise`.
inline TruePosture random_posture(const Rig& rig, Random& random, double range, bool noise) {
  TruePosture p = empty_posture(rig);
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    if (!rig.tree.joints[j].has_reading()) continue;
    const double r = rig.tree.joints[j].type == JointType::prismatic ? range / 5 : range;
    p.readings[j] = random.uniform(-r, r);
    if (noise) p.errors[j] = rig.joints[j].sigma * random.normal();
  }
  return p;
}

/// base_T_target of a free target whose middle stands `distance` in front of a sensor (along z), facing it within `tilt` rad.
inline Isometry3d in_front(const Rig& rig, int sensor, int target, const TruePosture& posture, double distance, double tilt,
                           Random& random) {
  const Target& t = rig.targets[target];
  Vector3d middle = Vector3d::Zero();
  for (int i = 0; i < t.count(); ++i) middle += target_point(t, i) / t.count();
  const Vector3d place(random.uniform(-0.15, 0.15) * distance, random.uniform(-0.15, 0.15) * distance, distance);
  const Matrix3d r = random.rotation(tilt);
  Isometry3d sensor_T = Isometry3d::Identity();
  sensor_T.linear() = r;
  sensor_T.translation() = place - r * middle;
  return root_T_link(rig, rig.base, posture).inverse() * root_T_sensor(rig, sensor, posture) * sensor_T;
}

/// base_T_target of a free target held by a chain, with the grip's noise if `noise`.
inline Isometry3d in_hand(const Rig& rig, int chain, const TruePosture& posture, Random* noise) {
  Vector6d e = Vector6d::Zero();
  if (noise)
    for (int k = 0; k < 6; ++k) e(k) = rig.sensors[chain].sigma[k] * noise->normal();
  return root_T_link(rig, rig.base, posture).inverse() * root_T_sensor(rig, chain, posture) * exponential(e);
}

inline Sample make_sample(const Rig& rig, const TruePosture& posture, const std::string& id) {
  Sample s;
  s.id = id;
  s.readings = posture.readings;
  for (size_t j = 0; j < s.readings.size(); ++j)
    if (!rig.tree.joints[j].has_reading()) s.readings[j] = std::nan("");
  return s;
}

/// Adds what `sensor` sees of `target`; false if it sees nothing.
inline bool add_view(Sample& sample, const Rig& rig, int sensor, int target, const TruePosture& posture, Random* noise = nullptr,
                     const std::vector<int>& ids = {}) {
  const std::optional<View> v = see(rig, sensor, target, posture, noise, ids);
  if (v) sample.views.push_back(*v);
  return v.has_value();
}

// ---------------------------------------------------------------- values

/// The rig with other values of its parameters.
inline Rig with_values(Rig rig, const ParameterTable& table, const VectorXd& values) {
  const auto pose = [&](int p) {
    Pose out;
    const double* v = values.data() + table.all[p].start;
    out.rotation << v[0], v[3], v[6], v[1], v[4], v[7], v[2], v[5], v[8];
    out.translation << v[9], v[10], v[11];
    return out;
  };
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    if (table.joint_offset[j] >= 0) rig.joints[j].offset = values(table.all[table.joint_offset[j]].start);
    if (table.joint_scale[j] >= 0) rig.joints[j].scale = values(table.all[table.joint_scale[j]].start);
    rig.tree.joints[j].parent_T_joint = pose(table.joint_origin[j]);
  }
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    rig.sensors[s].link_T_sensor = pose(table.sensor_pose[s]);
    for (size_t b = 0; b < rig.sensors[s].parameters.size(); ++b) {
      std::vector<double>& v = rig.sensors[s].parameters[b].values;
      for (size_t k = 0; k < v.size(); ++k)
        v[k] = values(table.all[table.sensor_block[s] + static_cast<int>(b)].start + static_cast<int>(k));
    }
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    Target& target = rig.targets[t];
    if (table.target_pose[t] >= 0) target.link_T_target = pose(table.target_pose[t]);
    if (table.target_square[t] >= 0) target.square = values(table.all[table.target_square[t]].start);
    if (table.target_points[t] >= 0)
      target.points = Eigen::Map<const Eigen::Matrix3Xd>(values.data() + table.all[table.target_points[t]].start, 3, target.count());
  }
  return rig;
}

inline std::vector<Freed> freed(const ParameterTable& table, const std::vector<std::string>& names) {
  std::vector<Freed> out;
  for (const std::string& name : names) {
    const std::vector<Freed> found = table.select(name);
    if (found.empty()) throw std::logic_error("nothing is called " + name);
    merge(out, found);
  }
  return out;
}

/// The rig with what `names` select moved at random: translations (m) by up to `t`, angles by up to `r`, intrinsics by up to `px`,
/// everything without a unit by up to `u`.
inline Rig moved(const Rig& rig, const std::vector<std::string>& names, Random& random, double t, double r, double px = 0, double u = 0) {
  const ParameterTable table(rig);
  VectorXd values = table.initial;
  for (const Freed& f : freed(table, names)) {
    const Parameter& p = table.all[f.parameter];
    Vector6d xi = Vector6d::Zero();
    for (const int c : f.components) {
      const double size = p.units[c] == "m" ? t : p.units[c] == "rad" ? r : p.units[c] == "px" ? px : u, step = random.uniform(-size, size);
      if (p.pose)
        xi(c) = step;
      else
        values(p.start + c) += step;
    }
    if (!p.pose) continue;
    Isometry3d pose = Isometry3d::Identity();
    pose.linear() = Eigen::Map<const Matrix3d>(values.data() + p.start);
    pose.translation() = Eigen::Map<const Vector3d>(values.data() + p.start + 9);
    pose = pose * exponential(xi);
    Eigen::Map<Matrix3d>(values.data() + p.start) = pose.linear();
    Eigen::Map<Vector3d>(values.data() + p.start + 9) = pose.translation();
  }
  return with_values(rig, table, values);
}

inline std::vector<int> all_sensors(const Rig& rig) {
  std::vector<int> out;
  for (size_t s = 0; s < rig.sensors.size(); ++s) out.push_back(static_cast<int>(s));
  return out;
}
inline std::vector<int> all_of(const std::vector<Sample>& samples) {
  std::vector<int> out;
  for (size_t s = 0; s < samples.size(); ++s) out.push_back(static_cast<int>(s));
  return out;
}

// ---------------------------------------------------------------- the nasty robot

/// ground -floor(fixed)- plinth -lift(prismatic, negative)- torso (the base of free targets)
///   plinth -pole(fixed)- pole;  plinth -turn- table
///   torso -pan(-z)- neck -tilt(oblique)- head -eye(fixed)- eye
///   torso -nod- nod -scan- scan -wobble- wobble            (the laser; scan is in the middle of its chain)
///   torso -shoulder(-y)- upper -elbow(continuous, oblique)- fore -slide(prismatic)- slide -wrist- wrist -flange(fixed)- tool
///   slide -finger(mimics elbow)- finger -nail(prismatic, mimics finger)- nail
///   torso -idle- idle                                      (nothing is there)
inline Rig nasty_robot() {
  Rig rig;
  add_link(rig, "ground");
  add_joint(rig, JointType::fixed, "floor", "ground", "plinth", {1, 0, 0}, at({0.2, -0.1, 0.3}, {0.1, -0.2, 0.4}));
  add_joint(rig, JointType::prismatic, "lift", "plinth", "torso", {0.1, 0, -1}, at({0.05, 0.02, 0.6}, {-0.3, 0.2, 2.5}), 0.001);
  rig.base = link_index(rig, "torso");
  add_joint(rig, JointType::fixed, "pole", "plinth", "pole", {0, 1, 0}, at({1.4, 0.2, 1.1}, {-1.8, 0.1, 1.3}));
  add_joint(rig, JointType::revolute, "turn", "plinth", "table", {0.1, 0, 1}, at({0.9, -0.6, 0.4}, {0.2, 0.3, -0.5}), 0.002);
  add_joint(rig, JointType::revolute, "pan", "torso", "neck", {0, 0, -1}, at({0.03, 0.05, 0.5}, {0.2, -0.1, 0.3}), 0.002);
  add_joint(rig, JointType::revolute, "tilt", "neck", "head", {0.3, 1, 0.2}, at({0.07, 0, 0.12}, {0, 0.2, 0}), 0.001);
  add_joint(rig, JointType::fixed, "eye", "head", "eye", {0, 0, 1}, at({0.08, 0.05, 0.04}, {-1.5, 0.05, -1.6}));
  add_joint(rig, JointType::revolute, "nod", "torso", "nod", {0, 1, 0}, at({0.1, 0, 0.3}, {0, 0.1, 0.2}), 0.0015);
  add_joint(rig, JointType::revolute, "scan", "nod", "scan", {0.05, 1, 0.1}, at({0.04, 0.01, 0.05}, {0.1, 0, -0.1}), 0.003);
  add_joint(rig, JointType::revolute, "wobble", "scan", "wobble", {1, 0, 0.1}, at({0.05, 0, 0.03}, {0, 0.1, 0}), 0.001);
  add_joint(rig, JointType::revolute, "shoulder", "torso", "upper", {0, -1, 0.2}, at({0.1, -0.2, 0.2}, {0.4, 0, -0.3}), 0.002);
  add_joint(rig, JointType::continuous, "elbow", "upper", "fore", {1, 2, -0.5}, at({0.3, 0, 0.02}, {0, -0.4, 1.0}), 0.0025);
  add_joint(rig, JointType::prismatic, "slide", "fore", "slide", {-1, 0, 0.2}, at({0.2, 0.03, 0}, {1.2, 0, 0}), 0.001);
  add_joint(rig, JointType::revolute, "wrist", "slide", "wrist", {1, 0, 0}, at({0.1, 0, 0.02}, {0, 0.3, 0.2}), 0.002);
  add_joint(rig, JointType::fixed, "flange", "wrist", "tool", {1, 0, 0}, at({0.06, 0.01, 0}, {0.5, -1.1, 0.2}));
  add_mimic(rig, JointType::revolute, "finger", "slide", "finger", {0, -1, 0}, at({0.02, 0, 0.1}, {0, 0, 1}), "elbow", -0.5, 0.1);
  add_mimic(rig, JointType::prismatic, "nail", "finger", "nail", {0, 0.6, 0.8}, at({0.01, 0, 0}, {1, 0, 0}), "finger", 0.2, -0.03);
  add_joint(rig, JointType::revolute, "idle", "torso", "idle", {0, 0, 1}, at({0, 0, 0.1}), 0.001);
  finish_tree(rig.tree);
  for (const char* name : {"pan", "elbow", "scan", "wrist", "turn"}) {
    rig.joints[joint_index(rig, name)].offset = 0.03;
    rig.joints[joint_index(rig, name)].scale = 1.02;
  }
  rig.joints[joint_index(rig, "lift")].scale = -0.98;
  rig.joints[joint_index(rig, "slide")].offset = -0.01;

  add_camera(rig, "pin", "wobble", at({0.02, 0.01, 0.03}, {-1.6, 0.1, -1.5}), Lens::pinhole, {}, 0.12);
  add_camera(rig, "bc5", "eye", at({0.01, -0.02, 0.005}, {0.05, 0.02, -0.03}), Lens::brown_conrady, {-0.21, 0.08, 0.002, -0.003, 0.01});
  add_camera(rig, "bc8", "nail", at({0.03, 0.02, 0.01}, {0.7, -0.4, 0.3}), Lens::brown_conrady,
             {0.11, -0.05, -0.002, 0.001, 0.02, 0.25, 0.06, 0.01}, -0.03);
  add_camera(rig, "kb", "pole", at({0.05, 0.04, 0.1}, {-0.2, 0.3, 0.1}), Lens::kannala_brandt, {0.02, -0.008, 0.003, -0.0005}, 0.02);
  add_tracker(rig, "tracker", "pole", at({-0.1, 0.2, 0}, {0.3, 1.1, -2}), {0.001, 0.002, 0.0005});
  add_tracker(rig, "depth", "eye", at({0, 0.04, 0}, {0.02, 0.5, 0}), {0.002, 0.002, 0.002});
  add_mocap(rig, "mocap", "pole", at({0.3, 0, 0.2}, {2, 0.1, 0.4}), 0.001, 0.002);
  add_chain(rig, "grip", "tool", at({0.05, 0, 0.06}, {-1.4, 0.2, 0.1}), 0.0015, 0.003);
  add_laser(rig, "laser", "wobble", at({0.03, 0.02, 0.02}, {0.1, -0.15, 0.2}), "scan", {0.0015, 0.001, 0.004});
  // A laser that stands still while the table turns: its plane holds, nearly, the table's axis.
  const Isometry3d pole = root_T_link(rig, link_index(rig, "pole"), empty_posture(rig));
  const Isometry3d table = root_T_link(rig, link_index(rig, "table"), empty_posture(rig));
  const Vector3d up = table.linear() * rig.tree.joints[joint_index(rig, "turn")].axis;
  const Vector3d normal = (table.translation() - pole.translation()).cross(up).normalized();
  Pose plane;
  plane.rotation.col(0) = up.cross(normal);
  plane.rotation.col(1) = normal.cross(plane.rotation.col(0));
  plane.rotation.col(2) = normal;
  plane.rotation = (pole.linear().transpose() * plane.rotation * rpy(0.05, 0.1, 0.4)).eval();
  plane.translation << 0.02, 0, 0.1;
  add_laser(rig, "table_laser", "pole", plane, "turn", {0.002, 0.001, 0.003});
  add_laser(rig, "slide_laser", "wrist", at({0.02, 0.01, 0}, {0.2, 1.2, 0.5}), "slide", {0.001, 0.002, 0.003});

  add_grid(rig, "board", 3, 4, 0.06);
  add_grid(rig, "wall", 3, 3, 0.08, "table", at({0.1, -0.05, 0.3}, {1.3, 0.2, -0.4}));
  Eigen::Matrix3Xd marks(3, 5), probe(3, 4);
  marks << 0, 0.1, 0.02, -0.05, 0.03, 0, 0.01, 0.12, 0.04, -0.06, 0, 0.03, -0.02, 0.08, 0.05;
  probe << 0, 0.15, 0.01, 0.05, 0.01, 0, 0.14, 0.06, 0, 0.02, -0.01, 0.11;
  add_points(rig, "marks", marks, "tool", at({0.04, 0.02, 0.1}, {0.3, 0.6, -0.2}));
  add_points(rig, "probe", probe);
  return rig;
}

/// The whole of a problem as one dense system, from Estimation::explicit_rows: columns are the privates, group after group, then the
/// shared unknowns; the rows carry whitening and the slopes of the losses.
struct Stacked {
  MatrixXd j;
  VectorXd r;
  std::vector<int> private_start;  // by group
  int privates = 0;
};

inline Stacked stack(const Estimation& problem, const VectorXd& state) {
  Stacked s;
  std::vector<MatrixXd> blocks;
  Eigen::Index rows = 0;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    s.private_start.push_back(s.privates);
    s.privates += problem.groups()[g].private_size;
    MatrixXd block;
    if (!problem.explicit_rows(static_cast<int>(g), state, block)) throw std::logic_error("undefined residual");
    rows += block.rows();
    blocks.push_back(block);
  }
  s.j = MatrixXd::Zero(rows, s.privates + problem.shared_size());
  s.r.resize(rows);
  Eigen::Index row = 0;
  for (size_t g = 0; g < blocks.size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    const Eigen::Index n = blocks[g].rows();
    s.j.block(row, s.private_start[g], n, shape.private_size) = blocks[g].leftCols(shape.private_size);
    for (size_t c = 0; c < shape.columns.size(); ++c)
      s.j.col(s.privates + shape.columns[c]).segment(row, n) = blocks[g].col(shape.private_size + static_cast<int>(c));
    s.r.segment(row, n) = blocks[g].rightCols(1);
    row += n;
  }
  return s;
}

/// Whether a view of this pair makes sense: a laser's scanning joint must stand between it and the target.
inline bool pair_allowed(const Rig& rig, int sensor, int target) {
  const int scan = rig.sensors[sensor].scanning_joint;
  if (scan < 0) return true;
  TruePosture a = empty_posture(rig), b = a;
  for (size_t t = 0; t < rig.targets.size(); ++t) a.boards[static_cast<int>(t)] = Isometry3d::Identity();
  b.boards = a.boards;
  b.readings[scan] = 0.5;
  return !sensor_T_target(rig, sensor, target, a).isApprox(sensor_T_target(rig, sensor, target, b), 1e-9);
}

/// Samples of the nasty robot, two free targets in each, every sensor and target met several times; with noise of every kind.
/// Residuals of the chain are large on purpose: nothing is in the hand.
inline std::vector<Sample> nasty_samples(const Rig& truth, int count, unsigned long seed, std::vector<TruePosture>* postures = nullptr) {
  Random random(seed);
  const int board = target_index(truth, "board"), probe = target_index(truth, "probe");
  const std::vector<std::pair<const char*, const char*>> goals = {{"pin", "wall"},  {"bc5", "marks"}, {"bc8", "wall"}, {"kb", "marks"},
                                                                  {"pin", "marks"}, {"bc5", "wall"},  {"kb", "wall"}};
  const std::vector<std::string> cameras = {"pin", "bc5", "bc8", "kb"};
  std::vector<Sample> out;
  for (int n = 0; n < count; ++n) {
    const auto& goal = goals[n % goals.size()];
    TruePosture p;
    for (int tries = 0;; ++tries) {
      if (tries == 20000) throw std::logic_error(std::string("no posture lets ") + goal.first + " see " + goal.second);
      p = random_posture(truth, random, 1.5, true);
      if (see(truth, sensor_index(truth, goal.first), target_index(truth, goal.second), p)) break;
    }
    p.boards[board] = in_front(truth, sensor_index(truth, cameras[n % 4]), board, p, random.uniform(0.5, 0.9), 0.8, random);
    p.boards[probe] = in_front(truth, sensor_index(truth, cameras[(n + 1 + n / 4) % 4]), probe, p, random.uniform(0.5, 0.9), 1.0, random);
    Sample s = make_sample(truth, p, "sample_" + std::to_string(n));
    for (const int target : {board, target_index(truth, "wall"), target_index(truth, "marks"), probe})
      for (const int sensor : all_sensors(truth)) {
        if (!pair_allowed(truth, sensor, target)) continue;
        if (!add_view(s, truth, sensor, target, p, &random,
                      target == board && n % 2 ? std::vector<int>{7, 0, 3, 10, 5} : std::vector<int>()))
          continue;
        View& v = s.views.back();
        if (truth.sensors[sensor].name != "depth") continue;
        v.sigma.clear();
        for (size_t i = 0; i < v.ids.size(); ++i) {
          const Matrix3d r = random.rotation(3);
          v.covariance.push_back(r * Vector3d(1e-6, 4e-6, random.uniform(1e-5, 1e-4)).asDiagonal() * r.transpose());
        }
      }
    out.push_back(s);
    if (postures) postures->push_back(p);
  }
  return out;
}

/// Adds a group's part of the normal equations to a matrix over [private touched r] (lower triangle; r'r stays out).
inline bool add_equations(const Problem& problem, int group, const VectorXd& state, int worker, MatrixXd& gram, Cost& cost) {
  const GroupShape& shape = problem.groups()[group];
  const int k = shape.private_size, size = shape.size(), m = size - k;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = decltype(rows)::Zero(k, size + 1);
  MatrixXd shared = MatrixXd::Zero(m, m);
  VectorXd gradient = VectorXd::Zero(m);
  std::vector<std::ptrdiff_t> origin;
  std::vector<int> row;
  for (int i = 0; i < m; ++i) {
    origin.push_back(static_cast<std::ptrdiff_t>(i) * m);
    row.push_back(i);
  }
  if (!problem.linearise(group, state, worker, {rows.data(), size + 1, shared.data(), origin.data(), row.data(), gradient.data()}, cost))
    return false;
  gram.topLeftCorner(k, k) += MatrixXd(MatrixXd(rows.leftCols(k).transpose()).triangularView<Eigen::Lower>());
  gram.block(k, 0, m + 1, k) += rows.rightCols(m + 1).transpose();
  gram.block(k, k, m, m) += MatrixXd(shared.triangularView<Eigen::Lower>());
  gram.block(size, k, 1, m) += gradient.transpose();
  return true;
}

}  // namespace kincal::fixture
