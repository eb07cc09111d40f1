#include "pr2_like.h"

#include <stdexcept>

#include "../models/rig/selection.h"
#include "../models/sensors/sensors.h"
#include "random.h"

namespace kincal::benchmarks {
namespace {

constexpr int kColumns = 8, kRows = 6;  // corners of the board
constexpr double kSquare = 0.05;        // m
constexpr double kWidth = 640, kHeight = 480;

struct Limits {
  double low, high;
};
using ArmLimits = std::vector<Limits>;

// ---------------------------------------------------------------- robots

int add_joint(Rig& rig, const std::string& name, int parent, const Vector3d& axis,
              const Pose& origin) {
  Joint joint;
  joint.name = name;
  joint.type = JointType::revolute;
  joint.parent = parent;
  joint.child = static_cast<int>(rig.tree.links.size());
  joint.axis = axis;
  joint.parent_T_joint = origin;
  rig.tree.links.push_back(name + "_link");
  rig.tree.joints.push_back(joint);
  rig.joints.push_back({});
  return joint.child;
}

/// Links behind each joint of a 7-joint arm, from the shoulder on.
std::vector<int> add_arm(Rig& rig, const std::string& prefix, const Pose& base_T_shoulder) {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  const auto along = [](double length) {
    return Pose{Matrix3d::Identity(), Vector3d(length, 0, 0)};
  };
  std::vector<int> links;
  links.push_back(add_joint(rig, prefix + "shoulder_pan", 0, z, base_T_shoulder));
  links.push_back(add_joint(rig, prefix + "shoulder_lift", links.back(), y, along(0.1)));
  links.push_back(add_joint(rig, prefix + "upper_arm_roll", links.back(), x, along(0)));
  links.push_back(add_joint(rig, prefix + "elbow_flex", links.back(), y, along(0.4)));
  links.push_back(add_joint(rig, prefix + "forearm_roll", links.back(), x, along(0)));
  links.push_back(add_joint(rig, prefix + "wrist_flex", links.back(), y, along(0.321)));
  links.push_back(add_joint(rig, prefix + "wrist_roll", links.back(), x, along(0)));
  return links;
}
/// `mirror`: +1 for a left arm, -1 for a right one.
ArmLimits arm_limits(double mirror) {
  const auto side = [&](double low, double high) {
    return mirror > 0 ? Limits{low, high} : Limits{-high, -low};
  };
  return {side(-0.5, 1.2), {-0.3, 1.2},  side(-0.6, 3.0), {-2.0, -0.2},
          {-kPi, kPi},     {-1.9, -0.2}, {-kPi, kPi}};
}

/// A camera that looks along the link's x axis, tilted down by `pitch`.
int add_camera(Rig& rig, const std::string& name, int link, const Vector3d& at, double pitch,
               double focal, double sigma) {
  Matrix3d looking_along_x;
  looking_along_x << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  Sensor s;
  s.name = name;
  s.type = "camera";
  s.link = link;
  s.link_T_sensor = {rotation_from_rpy({0, pitch, 0}) * looking_along_x, at};
  s.pose_given = true;
  s.model = make_camera(Lens::brown_conrady, 5);
  s.parameters = camera_parameters(Lens::brown_conrady, {focal, focal, kWidth / 2, kHeight / 2},
                                   {-0.05, 0.02, 0, 0, 0}, 0);
  s.sigma = {sigma, sigma};
  s.image_width = static_cast<int>(kWidth);
  s.image_height = static_cast<int>(kHeight);
  rig.sensors.push_back(s);
  return static_cast<int>(rig.sensors.size()) - 1;
}
int add_hand(Rig& rig, const std::string& name, int link, double sigma) {
  Sensor s;
  s.name = name;
  s.type = "point";
  s.link = link;
  s.link_T_sensor = {Matrix3d::Identity(), Vector3d(0.18, 0, 0)};
  s.pose_given = true;
  s.model = make_point();
  s.sigma = {sigma, sigma, sigma};
  rig.sensors.push_back(s);
  return static_cast<int>(rig.sensors.size()) - 1;
}
void add_board(Rig& rig) {
  Target board;
  board.name = "board";
  board.type = "chessboard";
  board.square = kSquare;
  board.layout.resize(3, kColumns * kRows);
  for (int i = 0; i < kRows; ++i)
    for (int j = 0; j < kColumns; ++j)
      board.layout.col(i * kColumns + j) << j - 0.5 * (kColumns - 1), i - 0.5 * (kRows - 1), 0;
  rig.targets.push_back(board);
}

// ---------------------------------------------------------------- what is estimated

/// Frees offsets, scales, poses of sensors and fx fy cx cy k1 k2, each with a weak prior; `whole`:
/// the origins of joints and the rest of the distortion as well.
void free_all(RobotProblem& p, bool whole = false) {
  const auto add = [&](const std::string& pattern, double sigma) {
    const std::vector<Freed> found = p.table.select(pattern);
    merge(p.setup.free, found);
    for (const Freed& f : found)
      for (int c : f.components) p.setup.priors.push_back({f.parameter, c, sigma});
  };
  add("joint/*/offset", 0.1);
  add("joint/*/scale", 0.1);
  if (whole) add("joint/*/origin", 0.1);
  for (const Sensor& s : p.rig.sensors) {
    add("sensor/" + s.name + "/pose", 0.1);
    if (s.parameters.empty()) continue;
    add("sensor/" + s.name + "/intrinsics", 50);
    if (whole) {
      add("sensor/" + s.name + "/distortion", 0.5);
      continue;
    }
    add("sensor/" + s.name + "/distortion.k1", 0.5);
    add("sensor/" + s.name + "/distortion.k2", 0.5);
  }
  p.setup.noise = NoiseMode::none;
  for (size_t s = 0; s < p.rig.sensors.size(); ++s) p.setup.sensors.push_back(static_cast<int>(s));
}

/// The real robot: as designed, but for errors of realistic size.
void draw_truth(RobotProblem& p, Random& random) {
  p.start.shared = p.truth.shared = p.table.initial;
  VectorXd& values = p.truth.shared;
  const auto start = [&](int parameter) { return p.table.all[parameter].start; };
  for (size_t j = 0; j < p.rig.joints.size(); ++j) {
    values(start(p.table.joint_offset[j])) += random.normal(0.02);
    values(start(p.table.joint_scale[j])) += random.normal(0.005);
  }
  for (size_t s = 0; s < p.rig.sensors.size(); ++s) {
    const int pose = start(p.table.sensor_pose[s]);
    set_pose(values, pose, get_pose(values, pose) * random.motion(0.005, 0.01));
    if (p.rig.sensors[s].parameters.empty()) continue;
    const int intrinsics = start(p.table.sensor_block[s]),
              distortion = start(p.table.sensor_block[s] + 1);
    for (int i = 0; i < 4; ++i) values(intrinsics + i) += random.normal(5);
    for (int i = 0; i < 2; ++i) values(distortion + i) += random.normal(0.02);
  }
}

// ---------------------------------------------------------------- samples

std::vector<Pose> true_links(const RobotProblem& p, const std::vector<double>& readings) {
  std::vector<Pose> origins;
  std::vector<double> positions;
  for (size_t j = 0; j < readings.size(); ++j) {
    origins.push_back(p.rig.tree.joints[j].parent_T_joint);
    positions.push_back(p.truth.shared(p.table.all[p.table.joint_scale[j]].start) * readings[j] +
                        p.truth.shared(p.table.all[p.table.joint_offset[j]].start));
  }
  return link_poses(p.rig.tree, origins, positions);
}

/// What sensor s really measures, without noise; false if it does not see the whole board.
bool observe_board(const RobotProblem& p, int s, const std::vector<Pose>& base_T_link,
                   const Pose& base_T_board, std::vector<double>& z) {
  const Sensor& sensor = p.rig.sensors[s];
  const Target& board = p.rig.targets[0];
  const Eigen::Matrix3Xd points = board.square * board.layout;
  const Pose base_T_sensor = base_T_link[sensor.link] *
                             get_pose(p.truth.shared, p.table.all[p.table.sensor_pose[s]].start);
  const int rows = sensor.model->rows(), n = board.count();
  std::vector<int> ids(n);
  for (int i = 0; i < n; ++i) ids[i] = i;
  std::vector<double> own, nothing(static_cast<size_t>(n) * rows, 0.0);
  for (size_t b = 0; b < sensor.parameters.size(); ++b) {
    const Parameter& parameter = p.table.all[p.table.sensor_block[s] + b];
    for (int i = 0; i < parameter.size(); ++i) own.push_back(p.truth.shared(parameter.start + i));
  }
  ViewInput view;
  view.sensor_T_target = inverse(base_T_sensor) * base_T_board;
  view.parameters = own.data();
  view.points = &points;
  view.ids = ids.data();
  view.count = n;
  view.z = nothing.data();
  z.assign(static_cast<size_t>(n) * rows, 0.0);
  if (!sensor.model->evaluate(view, Columns(), z.data(), nullptr)) return false;
  if (rows == 3) return view.sensor_T_target.translation.norm() < 2;
  // From the front (the board's z axis points away from who reads it), not too steeply, not too
  // near, all of it in the image.
  if (view.sensor_T_target.rotation.col(2).dot(view.sensor_T_target.translation.normalized()) < 0.3)
    return false;
  for (int i = 0; i < n; ++i) {
    const Vector3d q = view.sensor_T_target * Vector3d(points.col(i));
    if (q.z() < 0.25 || std::abs(q.x() / q.z()) > 0.9 || std::abs(q.y() / q.z()) > 0.9)
      return false;
    if (z[2 * i] < 10 || z[2 * i] > kWidth - 10 || z[2 * i + 1] < 10 || z[2 * i + 1] > kHeight - 10)
      return false;
  }
  return true;
}

void draw(std::vector<double>& readings, int first, const ArmLimits& limits, Random& random) {
  for (size_t i = 0; i < limits.size(); ++i)
    readings[first + i] = random.uniform(limits[i].low, limits[i].high);
}

/// A point of a box. One statement a number: compilers differ in which argument they evaluate
/// first.
Vector3d between(const Limits& x, const Limits& y, const Limits& z, Random& random) {
  Vector3d p;
  p.z() = random.uniform(z.low, z.high);
  p.y() = random.uniform(y.low, y.high);
  p.x() = random.uniform(x.low, x.high);
  return p;
}

/// A part of the robot that is posed by itself until its sensors see the board.
struct Limb {
  int first_joint;
  ArmLimits limits;
  std::vector<int> sensors;
};

/// One sample: limbs are posed one after the other; false if one of them does not find a posture.
bool draw_sample(RobotProblem& p, const Pose& base_T_board, const std::vector<Limb>& limbs,
                 int tries, Random& random) {
  Sample sample;
  sample.id = std::to_string(p.samples.size());
  sample.readings.assign(p.rig.joints.size(), 0.0);
  for (const Limb& limb : limbs) {
    std::vector<View> views;
    for (int t = 0; t < tries; ++t) {
      draw(sample.readings, limb.first_joint, limb.limits, random);
      const std::vector<Pose> base_T_link = true_links(p, sample.readings);
      views.clear();
      for (int s : limb.sensors) {
        View view;
        view.sensor = s;
        view.target = 0;
        view.sigma = p.rig.sensors[s].sigma;
        if (!observe_board(p, s, base_T_link, base_T_board, view.z)) break;
        for (int i = 0; i < p.rig.targets[0].count(); ++i) view.ids.push_back(i);
        views.push_back(view);
      }
      if (views.size() == limb.sensors.size()) break;
      views.clear();
    }
    if (views.size() != limb.sensors.size()) return false;
    for (View& view : views) sample.views.push_back(std::move(view));
  }
  for (View& view : sample.views)
    for (double& z : view.z) z += random.normal(view.sigma[0]);
  const std::pair<int, int> key(static_cast<int>(p.samples.size()), 0);
  p.truth.targets[key] = base_T_board;
  p.start.targets[key] = base_T_board * random.motion(0.01, 0.02);
  p.samples.push_back(std::move(sample));
  return true;
}

void check(const RobotProblem& p, long rows, long shared, long private_unknowns) {
  const Estimation estimation(p, p.training(), p.setup);
  const Counts c = count(estimation);
  if (c.rows != rows || c.shared != shared || c.private_unknowns != private_unknowns)
    throw std::logic_error(p.name + " has " + std::to_string(c.rows) + " residuals, " +
                           std::to_string(c.shared) + " shared and " +
                           std::to_string(c.private_unknowns) + " private unknowns");
}

}  // namespace

Counts count(const Estimation& estimation) {
  Counts c;
  c.shared = estimation.shared_size();
  for (const GroupShape& g : estimation.groups())
    c.rows += g.rows, c.private_unknowns += g.private_size;
  return c;
}

RobotProblem pr2_like(int boards) {
  Rig rig;
  rig.tree.links = {"base"};
  const int pan = add_joint(rig, "head_pan", 0, Vector3d::UnitZ(),
                            {Matrix3d::Identity(), Vector3d(-0.017, 0, 0.38)});
  const int head = add_joint(rig, "head_tilt", pan, Vector3d::UnitY(),
                             {Matrix3d::Identity(), Vector3d(0.068, 0, 0)});
  const std::vector<int> left = add_arm(rig, "l_", {Matrix3d::Identity(), Vector3d(0, 0.188, 0)});
  const std::vector<int> right = add_arm(rig, "r_", {Matrix3d::Identity(), Vector3d(0, -0.188, 0)});
  const std::vector<int> eyes = {
      add_camera(rig, "narrow_left", head, {0.05, 0.06, 0.11}, 0, 600, 0.125),
      add_camera(rig, "narrow_right", head, {0.05, -0.03, 0.11}, 0, 600, 0.125),
      add_camera(rig, "wide_left", head, {0.04, 0.03, 0.09}, 0, 380, 0.25),
      add_camera(rig, "wide_right", head, {0.04, -0.06, 0.09}, 0, 380, 0.25)};
  const int forearms[2] = {
      add_camera(rig, "forearm_left", left[4], {0.135, 0, 0.044}, 0.3, 430, 0.5),
      add_camera(rig, "forearm_right", right[4], {0.135, 0, 0.044}, 0.3, 430, 0.5)};
  const int hands[2] = {add_hand(rig, "hand_left", left[6], 0.0005),
                        add_hand(rig, "hand_right", right[6], 0.001)};
  const int first_of_arm[2] = {2, 9};
  add_board(rig);
  finish_tree(rig.tree);

  RobotProblem p("pr2-like-" + std::to_string(boards), std::move(rig));
  free_all(p);
  Random random(1);
  draw_truth(p, random);
  Matrix3d facing;  // the board's axes as the head sees them: x to its right, y down, z away
  facing << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  while (static_cast<int>(p.samples.size()) < boards) {
    const Vector3d at = between({0.75, 1.15}, {-0.45, 0.45}, {-0.25, 0.45}, random);
    const Vector3d w = random.vector(0.3);
    const double bearing = std::atan2(at.y(), at.x()),
                 depression = std::atan2(0.45 - at.z(), at.head<2>().norm());
    const Pose base_T_board{rotation_from_rpy({0, depression, bearing}) * facing * exp_so3(w), at};
    const Limits pan_limits{bearing - 0.12, bearing + 0.12},
        tilt_limits{depression - 0.12, depression + 0.12};
    const int arm = static_cast<int>(p.samples.size() % 2),
              other = 1 - arm;  // `arm`: whose hand sees the board
    draw_sample(p, base_T_board,
                {{0, {pan_limits, tilt_limits}, eyes},
                 {first_of_arm[other], arm_limits(other == 0 ? 1 : -1), {forearms[other]}},
                 {first_of_arm[arm], arm_limits(arm == 0 ? 1 : -1), {hands[arm]}}},
                3000, random);
  }
  check(p, 624L * boards + 116, 116, 6L * boards);
  return p;
}

RobotProblem four_arms(int samples) {
  Rig rig;
  rig.tree.links = {"base"};
  std::vector<Limb> limbs;
  for (int a = 0; a < 4; ++a) {  // in two rows, all looking along x
    const std::string number = std::to_string(a);
    const std::vector<int> arm =
        add_arm(rig, "arm" + number + "_",
                {Matrix3d::Identity(), Vector3d(-0.3 * (a / 2), a % 2 ? -0.3 : 0.3, 0)});
    Limb limb{7 * a,
              arm_limits(a % 2 ? -1 : 1),
              {add_camera(rig, "camera" + number, arm[6], {0.1, 0, 0}, 0, 430, 0.25)}};
    if (a == 0)
      limb.sensors.push_back(add_camera(rig, "camera4", arm[6], {0.1, 0.05, 0}, 0, 430, 0.25));
    limbs.push_back(limb);
  }
  add_board(rig);
  finish_tree(rig.tree);

  RobotProblem p("four-arms-" + std::to_string(samples), std::move(rig));
  free_all(p);
  Random random(2);
  draw_truth(p, random);
  Matrix3d facing;
  facing << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  while (static_cast<int>(p.samples.size()) < samples) {
    const Vector3d at = between({0.8, 1.2}, {-0.3, 0.3}, {-0.4, 0.2}, random);
    draw_sample(p, {facing * exp_so3(random.vector(0.3)), at}, limbs, 5000, random);
  }
  check(p, 480L * samples + 116, 116, 6L * samples);
  return p;
}

RobotProblem cell(int arms, int boards) {
  // Stations in a ring, 1.26 m apart, that look towards its middle: x ahead, y to the left. Board k
  // is between the stations k and k + 1.
  const double radius = 1.26 * arms / (2 * kPi);
  const auto station = [&](double k) {
    const double angle = 2 * kPi * k / arms;
    return Pose{rotation_from_rpy({0, 0, angle + kPi}),
                Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0)};
  };
  Rig rig;
  rig.tree.links = {"base"};
  std::vector<int> hands, fixed;
  for (int a = 0; a < arms; ++a) {
    const std::string number = std::to_string(a);
    const std::vector<int> arm = add_arm(rig, "arm" + number + "_", station(a));
    hands.push_back(add_camera(rig, "hand" + number, arm[6], {0.1, 0, 0}, 0, 430, 0.25));
    const Pose mast = station(a) * Pose{Matrix3d::Identity(), Vector3d(-0.4, 0, 0.5)};
    fixed.push_back(add_camera(rig, "fixed" + number, 0, {0, 0, 0}, 0, 430, 0.25));
    Sensor& camera = rig.sensors.back();
    camera.link_T_sensor =
        mast * Pose{rotation_from_rpy({0, 0.3, 0}), Vector3d::Zero()} * camera.link_T_sensor;
  }
  add_board(rig);
  finish_tree(rig.tree);

  RobotProblem p("cell-" + std::to_string(arms), std::move(rig));
  free_all(p, true);
  Random random(3);
  draw_truth(p, random);
  Matrix3d facing;
  facing << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  while (static_cast<int>(p.samples.size()) < boards) {
    const int k = static_cast<int>(p.samples.size()) % arms, next = (k + 1) % arms;
    const Vector3d at = between({0.9, 1.3}, {-0.2, 0.2}, {-0.4, 0.2}, random);
    // From its station an arm has the board on its left or right, so its shoulder turns there.
    ArmLimits left = arm_limits(1), right = arm_limits(-1);
    left[0] = {-1, 0.2}, right[0] = {-0.2, 1};
    draw_sample(p, station(k + 0.5) * Pose{facing * exp_so3(random.vector(0.3)), at},
                {{0, {}, {fixed[k], fixed[next]}},
                 {7 * k, left, {hands[k]}},
                 {7 * next, right, {hands[next]}}},
                5000, random);
  }
  check(p, 384L * boards + 86 * arms, 86L * arms, 6L * boards);
  return p;
}

}  // namespace kincal::benchmarks
