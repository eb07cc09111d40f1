#include "simulation.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <stdexcept>

#include "../fitting/starts.h"
#include "../rig/configuration.h"
#include "../rig/draws.h"
#include "../rig/selection.h"
#include "../rig/targets.h"
#include "../rig/words.h"
#include "../sensors/tilting_laser.h"

namespace kincal {
namespace {

using Eigen::Matrix3Xd;
using Pair = std::pair<int, int>;  // (sensor, target)

constexpr double kWidestBearing = 135 * kPi / 180, kShortestRange = 0.1;
constexpr double kLeastFront = 0.17364817766693036;  // cos 80 degrees
constexpr double kHandHeld = 0.5;                    // m
constexpr int kTrials = 1000;                        // a sample
constexpr int kArc = 8;                              // directions between the axis and a point where a lens is looked at

// ------------------------------------------------------------------------------------------------ draws
enum Stream : std::uint64_t { kTruthStream, kPostureStream, kFirstSampleStream };

// ------------------------------------------------------------------------------------------------ rigs
bool is_chain(const Sensor& sensor) { return sensor.model->sight() == Sight::chain; }

/// Does the posture move the target relative to the sensor? A scanning joint is no part of the posture.
bool moves_between(const Rig& rig, int sensor, int target) {
  const Sensor& s = rig.sensors[sensor];
  const int link = rig.targets[target].link >= 0 ? rig.targets[target].link : rig.base;
  return !joints_between(rig, s.link, link, s.scanning_joint).empty();
}

/// What random postures are about: a free target in a chain's hand or placed (holder -1), or all mounted ones (target -1).
struct Group {
  int target, holder;
  std::vector<Pair> seers;  // who may see it
};

std::vector<Group> groups_of(const Rig& rig, const std::vector<Pair>& pairs) {
  std::vector<Group> groups;
  Group mounted{-1, -1, {}};
  for (int t = 0; t < static_cast<int>(rig.targets.size()); ++t) {
    std::vector<int> holders;
    std::vector<Pair> seers;
    for (const Pair& p : pairs) {
      if (p.second != t) continue;
      if (is_chain(rig.sensors[p.first]))
        holders.push_back(p.first);
      else
        seers.push_back(p);
    }
    if (rig.targets[t].link >= 0) {
      mounted.seers.insert(mounted.seers.end(), seers.begin(), seers.end());
      continue;
    }
    if (seers.empty()) continue;
    if (holders.empty()) holders.push_back(-1);
    for (int h : holders) groups.push_back({t, h, seers});
  }
  if (!mounted.seers.empty()) groups.push_back(mounted);
  return groups;
}

// ------------------------------------------------------------------------------------------------ one robot
/// A sample in the making.
struct Draft {
  Sample sample;                 // as logged
  std::vector<double> readings;  // true
  std::map<int, Pose> targets;   // true base_T_target of free targets
  std::vector<Simulation::Dropped> dropped;
};

/// The image of a camera in px, and its focal length and principal point.
struct Image {
  double focal, cx, cy, width, height;
};

/// A rig as it really is.
class World {
 public:
  World(const Rig& rig, const ParameterTable& table, const VectorXd& truth) : rig_(rig), table_(table), truth_(truth) {
    for (int t = 0; t < static_cast<int>(rig.targets.size()); ++t) points_.push_back(target_points(rig, table, truth, t));
  }

  /// A posture carried out. Of `views` those that cannot be are dropped; `listed`: with a word, and boards may be seen from behind.
  Draft carry_out(const Posture& posture, const std::vector<Pair>& views, bool listed, Draws noise) const;

  /// base_T_target of a target that is placed where the sensor is likely to see it.
  Pose place(const Sample& robot, int sensor, int target, Draws& draws) const;

 private:
  Configuration at(const Sample& robot) const { return Configuration(rig_, table_, truth_, robot.readings); }
  Pose base_T_sensor(const Sample& robot, int sensor, double scan_reading = 0) const {
    return at(robot).with(rig_.sensors[sensor].scanning_joint, scan_reading).base_T_sensor(sensor);
  }
  const double* own_numbers(int sensor) const {
    const int block = table_.sensor_block[sensor];
    return block >= 0 ? truth_.data() + table_.all[block].start : nullptr;
  }
  std::optional<Image> image_of(int sensor) const;
  bool front_shows(int target, const Vector3d& eye) const;
  bool look(const Sample& robot, const Pair& view, const Pose& base_T_target, bool any_side, std::vector<double>& z,
            std::string& why) const;
  bool scan(const Sample& robot, const Pair& view, const Pose& base_T_target, std::vector<double>& z) const;
  bool inside(int sensor, const Matrix3Xd& p_sensor, const std::vector<double>& pixels, std::string& why) const;
  bool predict(int sensor, const Matrix3Xd& p_sensor, std::vector<double>& z, RowMatrix* by_point) const;
  void add_noise(int sensor, Draws& noise, std::vector<double>& z) const;

  const Rig& rig_;
  const ParameterTable& table_;
  const VectorXd& truth_;
  std::vector<Matrix3Xd> points_;
};

std::optional<Image> World::image_of(int sensor) const {
  const Sensor& s = rig_.sensors[sensor];
  for (size_t b = 0; b < s.parameters.size(); ++b) {
    if (s.parameters[b].name != "intrinsics" || s.parameters[b].values.size() != 4) continue;
    const double* k = truth_.data() + table_.all[table_.sensor_block[sensor] + static_cast<int>(b)].start;
    const bool known = s.image_width > 0 && s.image_height > 0;
    return Image{k[0], k[2], k[3], known ? s.image_width : 2 * k[2] + 1, known ? s.image_height : 2 * k[3] + 1};
  }
  return std::nullopt;
}

/// Is the target's printed side turned to `eye` (in the target's frame)? Boards count x right and y down, seen from their front, so z
/// points into them; those of Kalibr's AprilTags y up.
bool World::front_shows(int target, const Vector3d& eye) const {
  const Target& t = rig_.targets[target];
  if (!t.grid) return true;
  const Vector3d sight = (eye - points_[target].rowwise().mean()).normalized();
  return (t.type == "apriltag_grid" ? sight.z() : -sight.z()) >= kLeastFront;
}

/// What a pointwise sensor would measure of points in its frame (residual = predicted - 0), and the derivative by them.
bool World::predict(int sensor, const Matrix3Xd& p_sensor, std::vector<double>& z, RowMatrix* by_point) const {
  const SensorModel& model = *rig_.sensors[sensor].model;
  const int n = static_cast<int>(p_sensor.cols());
  std::vector<int> ids(n);
  for (int i = 0; i < n; ++i) ids[i] = i;
  const std::vector<double> zeros(n * model.numbers(), 0.0);
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

/// Are all pixels in the image, and is the lens one to one from its axis to each point? With J (2 x 3) by the point p, det [J; p] > 0
/// where turning the direction moves the pixel the right way round.
bool World::inside(int sensor, const Matrix3Xd& p_sensor, const std::vector<double>& pixels, std::string& why) const {
  const std::optional<Image> image = image_of(sensor);
  if (!image) return true;
  const int n = static_cast<int>(p_sensor.cols());
  why = "a point is outside the image";
  for (int i = 0; i < n; ++i) {
    const double u = pixels[2 * i], v = pixels[2 * i + 1];
    if (!(u >= -0.5 && u <= image->width - 0.5 && v >= -0.5 && v <= image->height - 0.5)) return false;
  }
  why = "a point is where the lens is not one to one";
  Matrix3Xd arc(3, n * kArc);
  for (int i = 0; i < n; ++i) {
    const Vector3d p = p_sensor.col(i);
    const double rho = std::hypot(p.x(), p.y()), angle = std::atan2(rho, p.z());
    const Eigen::Vector2d away = rho > 0 ? Eigen::Vector2d(p.head<2>() / rho) : Eigen::Vector2d(1, 0);
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
bool World::scan(const Sample& robot, const Pair& view, const Pose& base_T_target, std::vector<double>& z) const {
  const Sensor& s = rig_.sensors[view.first];
  const int j = s.scanning_joint;
  const Joint& joint = rig_.tree.joints[j];
  const Path path = find_path(rig_.tree, rig_.base, s.link);
  const auto step = std::find_if(path.begin(), path.end(), [&](const PathStep& p) { return p.joint == j; });
  const double* own = truth_.data() + table_.all[table_.joint_offset[j]].start;
  const Pose origin = get_pose(truth_, table_.all[table_.joint_origin[j]].start);
  const Pose base_T_parent = at(robot).with(j, 0).base_T_link(joint.parent);
  const Pose base_T_child = at(robot).with(j, 0).base_T_link(joint.child);
  const Pose sensor_T_base = inverse(base_T_sensor(robot, view.first, 0));
  const bool down = step->direction > 0;  // from the base; from the sensor it is the other way round
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
      if (range <= kShortestRange || std::abs(bearing) > least || (hit && std::abs(bearing) >= least)) continue;
      least = std::abs(bearing);
      hit = true;
      best[0] = t, best[1] = bearing, best[2] = range;
    }
    if (!hit) return false;
    z.insert(z.end(), best, best + 3);
  }
  return true;
}

/// Numbers of a view without noise. False, and why, where the target is not seen whole.
bool World::look(const Sample& robot, const Pair& view, const Pose& base_T_target, bool any_side, std::vector<double>& z,
                 std::string& why) const {
  const Sensor& s = rig_.sensors[view.first];
  const Sight sight = s.model->sight();
  if (sight == Sight::scan) {
    if (!scan(robot, view, base_T_target, z)) return why = "a point is out of the scan's reach", false;
    const Vector3d eye = inverse(base_T_target) * base_T_sensor(robot, view.first, z[0]).translation;
    return any_side || front_shows(view.second, eye) || (why = "its front is turned away", false);
  }
  const Pose sensor_T_target = inverse(base_T_sensor(robot, view.first)) * base_T_target;
  if (sight == Sight::pose) {
    const Vector3d& t = sensor_T_target.translation;
    const Eigen::Vector4d q = quaternion_from_rotation(sensor_T_target.rotation);
    z = {t.x(), t.y(), t.z(), q[0], q[1], q[2], q[3]};
    return true;
  }
  if (sight == Sight::rays && !any_side && !front_shows(view.second, inverse(sensor_T_target).translation))
    return why = "its front is turned away", false;
  const Matrix3Xd p_sensor = (sensor_T_target.rotation * points_[view.second]).colwise() + sensor_T_target.translation;
  if (!predict(view.first, p_sensor, z, nullptr))
    return why = sight == Sight::rays ? "a point is behind the camera" : "a point has no measurement", false;
  return sight != Sight::rays || inside(view.first, p_sensor, z, why);
}

void World::add_noise(int sensor, Draws& noise, std::vector<double>& z) const {
  const Sensor& s = rig_.sensors[sensor];
  if (s.model->sight() == Sight::pose) {
    const Pose t{rotation_from_quaternion(Eigen::Map<const Eigen::Vector4d>(z.data() + 3)), Eigen::Map<const Vector3d>(z.data())};
    const Pose measured = t * inverse(noise.error(s.sigma));
    Eigen::Map<Vector3d>(z.data()) = measured.translation;
    Eigen::Map<Eigen::Vector4d>(z.data() + 3) = quaternion_from_rotation(measured.rotation);
    return;
  }
  const size_t numbers = s.sigma.size();
  for (size_t i = 0; i < z.size(); ++i) z[i] += s.sigma[i % numbers] * noise.normal();
}

Draft World::carry_out(const Posture& posture, const std::vector<Pair>& views, bool listed, Draws noise) const {
  Draft draft;
  draft.readings = posture.readings;
  draft.targets = posture.targets;
  draft.sample.id = posture.id;
  draft.sample.readings = posture.readings;
  for (size_t j = 0; j < posture.readings.size(); ++j)
    if (!std::isnan(posture.readings[j])) draft.sample.readings[j] += rig_.joints[j].sigma * noise.normal();

  Sample robot;
  robot.readings = posture.readings;
  std::map<int, int> holders;  // by free target
  for (const Pair& v : views) {
    if (!is_chain(rig_.sensors[v.first]) || rig_.targets[v.second].link >= 0 || draft.targets.count(v.second)) continue;
    draft.targets[v.second] = base_T_sensor(robot, v.first) * noise.error(rig_.sensors[v.first].sigma);
    holders[v.second] = v.first;
  }
  for (const Pair& v : views) {
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
      why = target.link >= 0          ? "it is mounted on link " + quoted(rig_.tree.links[target.link])
            : holder != holders.end() ? "it is held by " + quoted(rig_.sensors[holder->second].name)
                                      : "it is placed, not held";
    } else {
      const Pose base_T_target = target.link < 0 ? draft.targets.at(v.second)
                                                 : at(robot).base_T_target(v.second);
      seen = look(robot, v, base_T_target, listed, view.z, why);
    }
    if (!seen) {
      if (listed) draft.dropped.push_back({posture.id, v.first, v.second, why});
      continue;
    }
    if (!view.z.empty()) add_noise(v.first, noise, view.z);
    for (int i = 0; !sensor.model->whole_pose() && i < target.count(); ++i) view.ids.push_back(i);
    draft.sample.views.push_back(std::move(view));
  }
  return draft;
}

/// Cameras: the board fills 20 to 60 % of the image, at least 0.4 m away. Lasers: 2 to 6 times its extent, at least 0.5 m away. Both: its
/// front to them, tilted up to 45 degrees and turned at will. Others: 0.5 to 2 m away, at will.
Pose World::place(const Sample& robot, int sensor, int target, Draws& draws) const {
  const Sensor& s = rig_.sensors[sensor];
  const Target& t = rig_.targets[target];
  const double size = extent(points_[target]);
  const std::optional<Image> image = s.model->sight() == Sight::rays ? image_of(sensor) : std::nullopt;
  const bool scans = s.model->sight() == Sight::scan;
  Vector3d ahead;
  double distance, reading = 0;
  if (image) {
    const double fill = draws.uniform(0.2, 0.6), free = 1 - fill;
    const double u = image->width * (0.5 + free * draws.uniform(-0.5, 0.5)), v = image->height * (0.5 + free * draws.uniform(-0.5, 0.5));
    ahead = Vector3d((u - image->cx) / image->focal, (v - image->cy) / image->focal, 1).normalized();
    distance = size > 0 ? std::max(0.4, image->focal * size / (fill * std::min(image->width, image->height))) : draws.uniform(0.4, 2);
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
    const double about = draws.uniform(-kPi, kPi), tilt = draws.uniform(0, kPi / 4), turn = draws.uniform(-kPi, kPi);
    const Matrix3d facing = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), ahead).toRotationMatrix();
    sensor_T_target.rotation = facing * exp_so3(tilt * Vector3d(std::cos(about), std::sin(about), 0)) * exp_so3(turn * Vector3d::UnitZ());
    if (t.type == "apriltag_grid") sensor_T_target.rotation *= exp_so3(kPi * Vector3d::UnitX());
  } else {
    sensor_T_target.rotation = draws.rotation();
  }
  sensor_T_target.translation = distance * ahead - sensor_T_target.rotation * points_[target].rowwise().mean();
  return base_T_sensor(robot, sensor, reading) * sensor_T_target;
}

// ------------------------------------------------------------------------------------------------ random postures
/// Draws postures until they show enough.
class RandomPostures {
 public:
  RandomPostures(const Rig& rig, const World& world, const std::vector<Pair>& pairs, const SimulationOptions& options)
      : rig_(rig), world_(world), pairs_(pairs), options_(options), groups_(groups_of(rig, pairs)), draws_(options.seed, kPostureStream) {
    if (groups_.empty())
      throw std::invalid_argument("no sensor of this rig sees a target; a chain only holds one, and needs another sensor that sees it");
    std::set<int> joints;
    for (const Pair& p : pairs)
      for (int j : needed_readings(rig, p.first, p.second)) joints.insert(j);
    joints_.assign(joints.begin(), joints.end());
    for (const Pair& p : pairs)
      if (rig.targets[p.second].link >= 0 && moves_between(rig, p.first, p.second)) moving_.insert(p);
  }

  Draft next(int k) {
    const Group& group = groups_[k % groups_.size()];
    const Pair goal = group.seers[(k / groups_.size()) % group.seers.size()];
    const std::pair<int, Pair> effort{group.holder, goal};
    for (int i = 0; i < kTrials && !hopeless_.count(effort); ++i)
      if (std::optional<Draft> draft = attempt(k, group, &goal)) return *draft;
    hopeless_.insert(effort);
    while (relaxed_ < static_cast<long>(kTrials) * options_.samples) {
      ++relaxed_;
      if (std::optional<Draft> draft = attempt(k, group, nullptr)) return *draft;
    }
    give_up(group);
  }

  long trials() const { return trials_; }

 private:
  /// A sample if a random posture shows enough, and the goal if there is one.
  std::optional<Draft> attempt(int k, const Group& group, const Pair* goal) {
    ++trials_;
    Posture posture;
    posture.id = std::to_string(k);
    posture.id = "sample_" + std::string(posture.id.size() < 4 ? 4 - posture.id.size() : 0, '0') + posture.id;
    posture.readings.assign(rig_.tree.joints.size(), kNan);
    for (int j : joints_) {
      const auto [low, high] = usual_range(rig_.tree.joints[j]);
      posture.readings[j] = draws_.uniform(low, high);
    }
    std::vector<Pair> views;
    if (group.holder >= 0) {
      views.push_back({group.holder, group.target});
    } else if (group.target >= 0) {
      Sample robot;
      robot.readings = posture.readings;
      const int before = goal ? goal->first : group.seers[draws_.index(group.seers.size())].first;
      posture.targets[group.target] = world_.place(robot, before, group.target, draws_);
    }
    const Draws noise(options_.seed, kFirstSampleStream + static_cast<std::uint64_t>(k));
    if (goal) {  // the cheap question first
      std::vector<Pair> first = views;
      first.push_back(*goal);
      if (world_.carry_out(posture, first, false, noise).sample.views.size() < first.size()) return std::nullopt;
    }
    for (const Pair& p : pairs_)
      if (!is_chain(rig_.sensors[p.first]) && (p.second == group.target || rig_.targets[p.second].link >= 0)) views.push_back(p);
    Draft draft = world_.carry_out(posture, views, false, noise);
    size_t free = 0;
    bool mounted = false;
    for (const View& v : draft.sample.views) {
      if (!is_chain(rig_.sensors[v.sensor])) seen_.insert({v.sensor, v.target});
      free += v.target == group.target;
      mounted = mounted || moving_.empty() || moving_.count({v.sensor, v.target});
    }
    const size_t needed = std::min<size_t>(2, group.seers.size() + (group.holder >= 0));
    if (group.target >= 0 ? free < needed : !mounted || draft.sample.views.empty()) return std::nullopt;
    return draft;
  }

  [[noreturn]] void give_up(const Group& group) const {
    std::string text = "no random posture shows enough within " + std::to_string(trials_) + " trials";
    if (group.target >= 0) {
      text += ": free target " + quoted(rig_.targets[group.target].name);
      text += group.holder >= 0 ? ", held by " + quoted(rig_.sensors[group.holder].name) + "," : "";
      text +=
          group.holder >= 0 || group.seers.size() == 1 ? " must be seen whole by a sensor" : " must be seen whole by two sensors at once";
    }
    std::string never;
    for (const Pair& p : group.seers)
      if (!seen_.count(p))
        never += (never.empty() ? "" : ", ") + quoted(rig_.targets[p.second].name) + " by " + quoted(rig_.sensors[p.first].name);
    throw std::runtime_error(text + (never.empty() ? "" : "; never seen: " + never) + "; give postures that show it");
  }

  const Rig& rig_;
  const World& world_;
  const std::vector<Pair>& pairs_;
  const SimulationOptions& options_;
  std::vector<Group> groups_;
  Draws draws_;
  std::vector<int> joints_;
  std::set<Pair> moving_;                    // pairs of mounted targets that a posture moves
  std::set<std::pair<int, Pair>> hopeless_;  // goals, with the holder, that were not met once
  std::set<Pair> seen_;
  long trials_ = 0, relaxed_ = 0;
};

// ------------------------------------------------------------------------------------------------ given postures
bool all_there(const Rig& rig, const Posture& posture, int sensor, int target) {
  for (int j : needed_readings(rig, sensor, target))
    if (std::isnan(posture.readings[j])) return false;
  return true;
}

/// @throws std::invalid_argument
void check_posture(const Rig& rig, const Posture& posture) {
  const std::string where = "posture " + quoted(posture.id) + ": ";
  if (posture.readings.size() != rig.tree.joints.size())
    throw std::invalid_argument(where + "one reading a joint is expected, NaN for none");
  for (const auto& t : posture.targets)
    if (rig.targets.at(t.first).link >= 0)
      throw std::invalid_argument(where + "target " + quoted(rig.targets[t.first].name) + " is mounted");
  std::set<int> held;
  for (const Pair& v : posture.views)
    if (is_chain(rig.sensors.at(v.first))) held.insert(v.second);
  for (const Pair& v : posture.views) {
    const Target& target = rig.targets.at(v.second);
    const std::string view = where + "sensor " + quoted(rig.sensors[v.first].name) + ", target " + quoted(target.name) + ": ";
    for (int j : needed_readings(rig, v.first, v.second))
      if (std::isnan(posture.readings[j]))
        throw std::invalid_argument(view + "needs joint " + quoted(rig.tree.joints[j].name) + ", which the posture lacks");
    if (target.link >= 0) continue;
    if (held.count(v.second) && posture.targets.count(v.second))
      throw std::invalid_argument(view + "the target is held by a chain, its pose cannot be given too");
    if (!held.count(v.second) && !posture.targets.count(v.second))
      throw std::invalid_argument(view + "the target is free: either a chain that holds it or its pose is needed");
  }
}

/// Views of a posture that lists none: one held target in turn if it places none, and all that sees the placed and the mounted ones.
std::vector<Pair> views_of(const Rig& rig, const Posture& posture, const std::vector<Pair>& pairs, int k) {
  std::vector<Pair> views, holds;
  for (const Pair& p : pairs)
    if (is_chain(rig.sensors[p.first]) && posture.targets.empty() && all_there(rig, posture, p.first, p.second)) holds.push_back(p);
  if (!holds.empty()) views.push_back(holds[k % holds.size()]);
  for (const Pair& p : pairs) {
    const bool there =
        rig.targets[p.second].link >= 0 || posture.targets.count(p.second) || (!holds.empty() && p.second == views[0].second);
    if (!is_chain(rig.sensors[p.first]) && there && all_there(rig, posture, p.first, p.second)) views.push_back(p);
  }
  return views;
}

void check_truth(const ParameterTable& table, const VectorXd& truth) {
  if (truth.size() != table.initial.size()) throw std::invalid_argument("the truth has another number of values than the rig");
  for (const Parameter& p : table.all)
    for (int c = 0; c < p.size(); ++c)
      if (const char* why = improper_value(p, c, truth(p.start + c)))
        throw std::invalid_argument("the true " + p.component_name(c) + " is " + std::to_string(truth(p.start + c)) + "; " + why);
}

}  // namespace

VectorXd draw_truth(const ParameterTable& table, const std::vector<Spread>& spread, std::uint64_t seed) {
  std::vector<std::vector<double>> sigma;
  for (const Parameter& p : table.all) sigma.emplace_back(p.size(), 0.0);
  for (const Spread& s : spread) {
    if (!(s.sigma >= 0 && std::isfinite(s.sigma)))
      throw std::invalid_argument("spread of '" + s.pattern + "': a number of at least 0 is expected");
    const std::vector<Freed> found = table.find(s.pattern, "--spread");
    for (const Freed& f : found)
      for (int c : f.components) sigma[f.parameter][c] = s.sigma;
  }
  VectorXd truth = table.initial;
  Draws draws(seed, kTruthStream);
  for (size_t i = 0; i < table.all.size(); ++i) {
    const Parameter& p = table.all[i];
    VectorXd moved(p.size());
    for (int c = 0; c < p.size(); ++c) moved(c) = sigma[i][c] * draws.normal();
    if (p.pose && !moved.isZero(0))
      set_pose(truth, p.start, get_pose(truth, p.start) * exp_se3(moved));
    else if (!p.pose)
      truth.segment(p.start, p.size()) += moved;
  }
  check_truth(table, truth);
  return truth;
}

std::vector<std::pair<int, int>> usual_pairs(const Rig& rig) {
  bool boards = false, points = false, small = false;
  const auto holdable = [](const Target& t) { return t.link < 0 && !on_a_line(target_points(t)); };
  const auto is_small = [](const Target& t) { return extent(target_points(t)) <= kHandHeld; };
  for (const Target& t : rig.targets) {
    boards = boards || t.grid;
    points = points || !t.grid;
    small = small || (holdable(t) && is_small(t));
  }
  std::vector<Pair> pairs;
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    for (size_t t = 0; t < rig.targets.size(); ++t) {
      const Target& target = rig.targets[t];
      bool fits = true;
      switch (rig.sensors[s].model->sight()) {
        case Sight::chain:
          fits = holdable(target) && (is_small(target) || !small);
          break;
        case Sight::rays:
        case Sight::scan:
          fits = target.grid || !boards;
          break;
        case Sight::points:
          fits = !target.grid || !points;
          break;
        default:
          break;
      }
      if (fits) pairs.push_back({static_cast<int>(s), static_cast<int>(t)});
    }
  return pairs;
}

Simulation simulate(const Rig& rig, const ParameterTable& table, const VectorXd& truth, const SimulationOptions& options) {
  if (options.samples < 1) throw std::invalid_argument("at least one sample is expected");
  check_truth(table, truth);
  for (const Sensor& s : rig.sensors) {
    const SensorModel& m = *s.model;
    const bool known = m.sight() == Sight::chain || m.sight() == Sight::pose || m.sight() == Sight::scan;
    if (!known && (m.whole_pose() || m.has_own_noise() || m.numbers() != m.rows()))
      throw std::invalid_argument("sensor " + quoted(s.name) + ": sensors of type " + quoted(s.type) + " cannot be simulated");
    if (static_cast<int>(s.sigma.size()) != m.sigmas())
      throw std::invalid_argument("sensor " + quoted(s.name) + ": it needs " + std::to_string(m.sigmas()) + " sigmas");
  }
  Simulation out;
  out.truth = truth;
  const World world(rig, table, truth);
  const std::vector<Pair> pairs = options.pairs.empty() ? usual_pairs(rig) : options.pairs;
  std::vector<char> busy(rig.sensors.size(), 0);
  std::optional<RandomPostures> random;
  if (options.postures.empty()) random.emplace(rig, world, pairs, options);
  for (const Posture& posture : options.postures) check_posture(rig, posture);

  std::set<std::string> ids;
  for (const Posture& posture : options.postures) ids.insert(posture.id);
  for (int k = 0; k < options.samples; ++k) {
    Draft draft;
    if (random) {
      draft = random->next(k);
    } else {
      const size_t count = options.postures.size();
      Posture posture = options.postures[k % count];
      if (k >= static_cast<int>(count)) {  // once more, with new noise
        const std::string id = posture.id + "_" + std::to_string(k / count + 1);
        for (posture.id = id; !ids.insert(posture.id).second;) posture.id += "_";
      }
      const bool listed = !posture.views.empty();
      draft = world.carry_out(posture, listed ? posture.views : views_of(rig, posture, pairs, k), listed,
                              Draws(options.seed, kFirstSampleStream + static_cast<std::uint64_t>(k)));
    }
    out.dropped.insert(out.dropped.end(), draft.dropped.begin(), draft.dropped.end());
    if (draft.sample.views.empty()) continue;
    for (const View& v : draft.sample.views) {
      busy[v.sensor] = 1;
      if (rig.targets[v.target].link < 0) out.targets[{static_cast<int>(out.samples.size()), v.target}] = draft.targets.at(v.target);
    }
    out.samples.push_back(std::move(draft.sample));
    out.true_readings.push_back(std::move(draft.readings));
  }
  if (random) out.trials = random->trials();
  for (size_t s = 0; s < busy.size(); ++s)
    if (!busy[s]) out.idle.push_back(static_cast<int>(s));
  return out;
}

}  // namespace kincal
