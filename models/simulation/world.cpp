#include "world.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "../rig/targets.h"
#include "../rig/words.h"
#include "../sensors/tilting_laser.h"

namespace kincal {

namespace {

constexpr double kWidestBearing = 135 * kPi / 180, kShortestRange = 0.1;
constexpr double kLeastFront = 0.17364817766693036;  // cos 80 degrees
constexpr int kArc = 8;  // directions between the axis and a point where a lens is looked at

}  // namespace

Conditions draw_conditions(const Rig& rig, std::uint64_t seed, int k) {
  RandomStream draws(seed, kFirstConditionsStream + static_cast<std::uint64_t>(k));
  Conditions out;
  constexpr double kRate = 0.5, kSlideRate = 0.1;  // rad/s, m/s, at most
  const size_t joints = rig.joints.size();
  for (size_t j = 0; j < joints; ++j) {
    if (!rig.joints[j].terms.backlash) continue;
    out.approach.resize(joints, 0);
    out.approach[j] = draws.uniform() < 0.5 ? -1 : 1;
  }
  constexpr double kWarmer = 10;  // K, or colder, at most
  if (std::any_of(rig.joints.begin(), rig.joints.end(),
                  [](const JointSettings& j) { return j.terms.temperature.has_value(); }))
    out.temperature = kReferenceTemperature + kWarmer * draws.uniform(-1, 1);
  if (rig.elasticity && !rig.payloads.empty())
    out.payload =
        static_cast<int>(draws.uniform() * static_cast<double>(rig.payloads.size() + 1)) - 1;
  if (std::none_of(rig.sensors.begin(), rig.sensors.end(),
                   [](const Sensor& s) { return s.time_offset || s.line_time; }))
    return out;
  out.rates.resize(joints, 0);
  for (size_t j = 0; j < joints; ++j)
    if (rig.tree.joints[j].has_reading())
      out.rates[j] = (rig.tree.joints[j].type == JointType::prismatic ? kSlideRate : kRate) *
                     draws.uniform(-1, 1);
  return out;
}

World::World(const Rig& rig, const ParameterTable& table, const VectorXd& truth)
    : rig_(rig), table_(table), truth_(truth) {
  for (int t = 0; t < static_cast<int>(rig.targets.size()); ++t)
    points_.push_back(target_points(rig, table, truth, t));
}

std::optional<CameraImage> World::image_of(int sensor) const {
  const Sensor& s = rig_.sensors[sensor];
  for (size_t b = 0; b < s.parameters.size(); ++b) {
    const Parameter& block = table_.all[table_.sensor_block[sensor] + static_cast<int>(b)];
    if (block.kind != ParameterKind::intrinsics || block.size() != 4) continue;
    const double* k = truth_.data() + block.start;
    const bool known = s.image_width > 0 && s.image_height > 0;
    return CameraImage{k[0], k[2], k[3], known ? s.image_width : 2 * k[2] + 1,
                       known ? s.image_height : 2 * k[3] + 1};
  }
  return std::nullopt;
}

/// Is the target's printed side turned to `eye` (in the target's frame)? Boards count x right and y
/// down, seen from their front, so z points into them; some count y up.
bool World::front_shows(int target, const Vector3d& eye) const {
  const Target& t = rig_.targets[target];
  if (!t.grid && !t.y_up) return true;  // points without a front
  const Vector3d sight = (eye - points_[target].rowwise().mean()).normalized();
  return (t.y_up ? sight.z() : -sight.z()) >= kLeastFront;
}

/// What a pointwise sensor would measure of points in its frame (residual = predicted - 0), and the
/// derivative by them.
bool World::predict(int sensor, const Matrix3Xd& p_sensor, std::vector<double>& z,
                    RowMatrix* by_point) const {
  const SensorModel& model = *rig_.sensors[sensor].model;
  const int n = static_cast<int>(p_sensor.cols());
  std::vector<int> ids(n);
  for (int i = 0; i < n; ++i) ids[i] = i;
  const std::vector<double> zeros(n * model.measurement_size(), 0.0);
  ViewInput in;
  in.parameters = own_numbers(sensor);
  in.points = &p_sensor;
  in.ids = ids.data();
  in.count = n;
  in.z = zeros.data();
  z.resize(n * model.rows());
  if (!by_point) return model.evaluate(in, Columns(), z.data(), nullptr);
  RowMatrix rows = RowMatrix::Zero(n * model.rows(), 6);
  Eigen::Ref<RowMatrix> l(rows);
  if (!model.evaluate(in, Columns(), z.data(), &l)) return false;
  *by_point = rows.leftCols<3>();
  return true;
}

/// Are all pixels in the image, and is the lens one to one from its axis to each point? With J (2 x
/// 3) by the point p, det [J; p] > 0 where turning the direction moves the pixel the right way
/// round.
bool World::inside(int sensor, const Matrix3Xd& p_sensor, const std::vector<double>& pixels,
                   std::string& why) const {
  const std::optional<CameraImage> image = image_of(sensor);
  if (!image) return true;
  const int n = static_cast<int>(p_sensor.cols());
  why = "a point is outside the image";
  for (int i = 0; i < n; ++i) {
    const double u = pixels[2 * i], v = pixels[2 * i + 1];
    if (!(u >= -0.5 && u <= image->width - 0.5 && v >= -0.5 && v <= image->height - 0.5))
      return false;
  }
  why = "a point is where the lens is not one to one";
  Matrix3Xd arc(3, n * kArc);
  for (int i = 0; i < n; ++i) {
    const Vector3d p = p_sensor.col(i);
    const double rho = std::hypot(p.x(), p.y()), angle = std::atan2(rho, p.z());
    const Eigen::Vector2d away =
        rho > 0 ? Eigen::Vector2d(p.head<2>() / rho) : Eigen::Vector2d(1, 0);
    for (int k = 1; k <= kArc; ++k) {
      const double a = angle * k / kArc;
      arc.col(i * kArc + k - 1) << p.norm() * std::sin(a) * away, p.norm() * std::cos(a);
    }
  }
  std::vector<double> ignored;
  RowMatrix by_point;
  if (!predict(sensor, arc, ignored, &by_point)) return false;
  for (int i = 0; i < n * kArc; ++i) {
    Matrix3d m;
    m << by_point.middleRows(2 * i, 2), arc.col(i).transpose();
    if (!(m.determinant() > 0)) return false;
  }
  return true;
}

/// Rays that hit all points; see the head of the header.
bool World::scan(const Sample& robot, const SensorTarget& view, const Pose& base_T_target,
                 std::vector<double>& z) const {
  const Sensor& s = rig_.sensors[view.first];
  const int j = s.scanning_joint;
  const Joint& joint = rig_.tree.joints[j];
  const Path path = find_path(rig_.tree, rig_.base, s.link);
  const auto step =
      std::find_if(path.begin(), path.end(), [&](const PathStep& p) { return p.joint == j; });
  const double* own = truth_.data() + table_.all[table_.joint_offset[j]].start;
  const Pose origin = get_pose(truth_, table_.all[table_.joint_origin[j]].start);
  const Pose base_T_parent = at(robot, view.first).with(j, 0).base_T_link(joint.parent);
  const Pose base_T_child = at(robot, view.first).with(j, 0).base_T_link(joint.child);
  const Pose sensor_T_base = inverse(base_T_sensor(robot, view.first, 0));
  const bool down =
      step->direction > 0;  // from the base; from the sensor it is the other way round
  const Pose sensor_T_joint = sensor_T_base * (down ? base_T_child : base_T_parent * origin);
  const Pose joint_T_target = inverse(down ? base_T_parent * origin : base_T_child) * base_T_target;
  const double direction = down ? -1 : 1;
  const Vector3d n = sensor_T_joint.rotation.row(2), &u = joint.axis;
  const double c = sensor_T_joint.translation.z();
  const auto [low, high] = usual_range(joint);

  const Matrix3Xd& points = points_[view.second];
  z.clear();
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const Vector3d x = joint_T_target * Vector3d(points.col(i));
    std::vector<double> angles;  // direction * position
    if (joint.type == JointType::prismatic) {
      angles.push_back(-(n.dot(x) + c) / n.dot(u));
    } else {
      const double a = n.dot(x - u * u.dot(x)), b = n.dot(u.cross(x)), d = n.dot(u) * u.dot(x) + c;
      const double middle = std::atan2(b, a), side = std::acos(-d / std::hypot(a, b));
      for (double q : {middle - side, middle + side})
        for (double turns : {-2.0, -1.0, 0.0, 1.0, 2.0}) angles.push_back(q + 2 * kPi * turns);
    }
    double best[3], least = kWidestBearing;
    bool hit = false;
    for (double q : angles) {
      const double t = rig_.joints[j].model->reading(direction * q, own);
      if (!(t >= low && t <= high)) continue;  // NaN too: never in the plane
      const Vector3d p = sensor_T_joint * (joint_motion(joint, q) * x);
      const double bearing = std::atan2(p.y(), p.x()), range = p.norm();
      if (range <= kShortestRange || std::abs(bearing) > least ||
          (hit && std::abs(bearing) >= least))
        continue;
      least = std::abs(bearing);
      hit = true;
      best[0] = t, best[1] = bearing, best[2] = range;
    }
    if (!hit) return false;
    z.insert(z.end(), best, best + 3);
  }
  return true;
}

/// Points in the frame of a camera and their pixels, each at the time of its row. In: both at the
/// time of row 0.
bool World::roll(const Sample& robot, const SensorTarget& view, const Pose& base_T_target,
                 Matrix3Xd& p_sensor, std::vector<double>& z) const {
  constexpr int kRounds = 8;  // the motion within an image is a small part of it
  const auto [sensor, target] = view;
  std::vector<double> pixel;
  for (Eigen::Index i = 0; i < p_sensor.cols(); ++i)
    for (int round = 0; round < kRounds; ++round) {
      const Configuration then = at(robot, sensor, z[2 * i + 1]);
      const Pose where =
          rig_.targets[target].link >= 0 ? then.base_T_target(target) : base_T_target;
      p_sensor.col(i) =
          inverse(then.base_T_sensor(sensor)) * (where * Vector3d(points_[target].col(i)));
      if (!predict(sensor, p_sensor.col(i), pixel, nullptr)) return false;
      std::copy(pixel.begin(), pixel.end(), z.begin() + 2 * i);
    }
  return true;
}

/// Numbers of a view without noise. False, and why, where the target is not seen whole.
bool World::look(const Sample& robot, const SensorTarget& view, const Pose& base_T_target,
                 bool any_side, std::vector<double>& z, std::string& why) const {
  const Sensor& s = rig_.sensors[view.first];
  const MeasurementKind kind = s.model->measurement_kind();
  if (kind == MeasurementKind::scan) {
    if (!scan(robot, view, base_T_target, z))
      return why = "a point is out of the scan's reach", false;
    const Vector3d eye =
        inverse(base_T_target) * base_T_sensor(robot, view.first, z[0]).translation;
    return any_side || front_shows(view.second, eye) || (why = "its front is turned away", false);
  }
  const Pose sensor_T_target = inverse(base_T_sensor(robot, view.first)) * base_T_target;
  if (kind == MeasurementKind::pose) {
    const double* const own = own_numbers(view.first);
    const Vector3d t = sensor_T_target.translation * (own ? own[0] : 1);
    const Eigen::Vector4d q = quaternion_from_rotation(sensor_T_target.rotation);
    z = {t.x(), t.y(), t.z(), q[0], q[1], q[2], q[3]};
    return true;
  }
  if (kind == MeasurementKind::rays && !any_side &&
      !front_shows(view.second, inverse(sensor_T_target).translation))
    return why = "its front is turned away", false;
  Matrix3Xd p_sensor =
      (sensor_T_target.rotation * points_[view.second]).colwise() + sensor_T_target.translation;
  if (!predict(view.first, p_sensor, z, nullptr) ||
      (s.line_time && !roll(robot, view, base_T_target, p_sensor, z)))
    return why = kind == MeasurementKind::rays ? "a point is behind the camera"
                                               : "a point has no measurement",
           false;
  return kind != MeasurementKind::rays || inside(view.first, p_sensor, z, why);
}

void World::add_noise(int sensor, RandomStream& noise, std::vector<double>& z) const {
  const Sensor& s = rig_.sensors[sensor];
  if (s.model->measurement_kind() == MeasurementKind::pose) {
    const Pose t{rotation_from_quaternion(Eigen::Map<const Eigen::Vector4d>(z.data() + 3)),
                 Eigen::Map<const Vector3d>(z.data())};
    const Pose measured = t * inverse(noise.error(s.sigma));
    Eigen::Map<Vector3d>(z.data()) = measured.translation;
    Eigen::Map<Eigen::Vector4d>(z.data() + 3) = quaternion_from_rotation(measured.rotation);
    return;
  }
  const size_t numbers = s.sigma.size();
  for (size_t i = 0; i < z.size(); ++i) z[i] += s.sigma[i % numbers] * noise.normal();
}

Draft World::carry_out(const Posture& posture, const std::vector<SensorTarget>& views, bool listed,
                       RandomStream noise) const {
  Draft draft;
  draft.readings = posture.readings;
  draft.targets = posture.targets;
  draft.sample.id = posture.id;
  draft.sample.readings = posture.readings;
  draft.sample.conditions = posture.conditions;
  for (size_t j = 0; j < posture.readings.size(); ++j)
    if (!std::isnan(posture.readings[j]))
      draft.sample.readings[j] += rig_.joints[j].sigma * noise.normal();

  Sample robot;
  robot.readings = posture.readings;
  robot.conditions = posture.conditions;
  std::map<int, int> holders;  // by free target
  for (const SensorTarget& v : views) {
    if (!is_chain(rig_.sensors[v.first]) || rig_.targets[v.second].link >= 0 ||
        draft.targets.count(v.second))
      continue;
    draft.targets[v.second] =
        base_T_sensor(robot, v.first) * noise.error(rig_.sensors[v.first].sigma);
    holders[v.second] = v.first;
  }
  for (const SensorTarget& v : views) {
    const Sensor& sensor = rig_.sensors[v.first];
    const Target& target = rig_.targets[v.second];
    View view;
    view.sensor = v.first;
    view.target = v.second;
    view.sigma = sensor.sigma;
    std::string why;
    bool seen;
    if (is_chain(sensor)) {
      const auto holder = holders.find(v.second);
      seen = holder != holders.end() && holder->second == v.first;
      why = target.link >= 0 ? "it is mounted on link " + quoted(rig_.tree.links[target.link])
            : holder != holders.end() ? "it is held by " + quoted(rig_.sensors[holder->second].name)
                                      : "it is placed, not held";
    } else {
      const Pose base_T_target =
          target.link < 0 ? draft.targets.at(v.second) : at(robot, v.first).base_T_target(v.second);
      seen = look(robot, v, base_T_target, listed, view.z, why);
    }
    if (!seen) {
      if (listed) draft.dropped.push_back({posture.id, v.first, v.second, why});
      draft.unseen.push_back(std::move(why));
      continue;
    }
    if (!view.z.empty()) add_noise(v.first, noise, view.z);
    for (int i = 0; !sensor.model->measures_pose() && i < target.count(); ++i)
      view.ids.push_back(i);
    draft.sample.views.push_back(std::move(view));
  }
  return draft;
}

Pose World::place(const Sample& robot, int sensor, int target, RandomStream& draws) const {
  const Sensor& s = rig_.sensors[sensor];
  const Target& t = rig_.targets[target];
  const double size = extent(points_[target]);
  const std::optional<CameraImage> image =
      s.model->measurement_kind() == MeasurementKind::rays ? image_of(sensor) : std::nullopt;
  const bool scans = s.model->measurement_kind() == MeasurementKind::scan;
  Vector3d ahead;
  double distance, reading = 0;
  if (image) {
    const double fill = draws.uniform(0.2, 0.6), free = 1 - fill;
    const double u = image->width * (0.5 + free * draws.uniform(-0.5, 0.5)),
                 v = image->height * (0.5 + free * draws.uniform(-0.5, 0.5));
    ahead =
        Vector3d((u - image->cx) / image->focal, (v - image->cy) / image->focal, 1).normalized();
    distance =
        size > 0
            ? std::max(0.4, image->focal * size / (fill * std::min(image->width, image->height)))
            : draws.uniform(0.4, 2);
  } else if (scans) {
    const auto [low, high] = usual_range(rig_.tree.joints[s.scanning_joint]);
    reading = draws.uniform(low, high);
    const double bearing = draws.uniform(-kPi / 3, kPi / 3);
    ahead = {std::cos(bearing), std::sin(bearing), 0};
    distance = std::max(0.5, size * draws.uniform(2, 6));
  } else {
    ahead = draws.rotation().col(2);
    distance = draws.uniform(0.5, 2);
  }
  Pose sensor_T_target;
  if (image || scans) {
    const double about = draws.uniform(-kPi, kPi), tilt = draws.uniform(0, kPi / 4),
                 turn = draws.uniform(-kPi, kPi);
    const Matrix3d facing = rotation_between(Vector3d::UnitZ(), ahead);
    sensor_T_target.rotation = facing *
                               exp_so3(tilt * Vector3d(std::cos(about), std::sin(about), 0)) *
                               exp_so3(turn * Vector3d::UnitZ());
    if (t.y_up) sensor_T_target.rotation *= exp_so3(kPi * Vector3d::UnitX());
  } else {
    sensor_T_target.rotation = draws.rotation();
  }
  sensor_T_target.translation =
      distance * ahead - sensor_T_target.rotation * points_[target].rowwise().mean();
  return base_T_sensor(robot, sensor, reading) * sensor_T_target;
}

}  // namespace kincal
