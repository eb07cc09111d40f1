// solver/: observability, planted gauges, Levenberg-Marquardt, threads, dense against sparse and
// CHOLMOD.
//
// Proves: observe() gives the inverse of the dense normal matrix, the rank and the degrees of
// freedom of the stacked Jacobian, also where a sample does not determine its own unknowns; every
// planted gauge is found, no other one is, named with the right coefficients, independent gauges
// apart, and nothing is found once the gauge is held; the estimate moves orthogonally to a gauge;
// noise-free truth is recovered; dense and sparse agree; any number of threads gives the same bits;
// all outcomes. Does not prove: that sigmas are honest over many seeds (statistics are tested on
// the example), nor rows and derivatives (models/estimation/estimation_test.cpp).
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <memory>
#include <set>

#include "../../models/rig/parameters.h"
#include "../../solver/elimination.h"
#include "../../solver/levenberg_marquardt.h"
#include "../../solver/observability.h"
#include "../fixtures/dense.h"
#include "../fixtures/forward_model.h"
#include "../fixtures/problem.h"
#include "../fixtures/random.h"
#include "../fixtures/rigs.h"
#include "../fixtures/samples.h"
#include "../fixtures/stacked.h"
#include "../fixtures/transforms.h"

namespace solver_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

using Names = std::vector<std::pair<std::string, double>>;

SolveSummary solve(Setting& s, VectorXd& state, int threads = 1,
                   LinearSolver choice = LinearSolver::automatic) {
  SolverOptions options;
  options.threads = threads;
  options.linear_solver = choice;
  LevenbergMarquardt solver(*s.problem, options);
  return solver.solve(state);
}

/// What observe() says, in names.
std::vector<Names> directions(const Setting& s, const Observability& o) {
  std::vector<Names> out;
  for (const auto& d : o.directions) {
    Names names;
    for (const auto& [column, coefficient] : d)
      names.push_back({s.problem->column_name(column), coefficient});
    out.push_back(names);
  }
  return out;
}

std::string text(const std::vector<Names>& all) {
  std::string out;
  for (const Names& d : all) {
    for (const auto& [name, c] : d) out += "  " + std::to_string(c) + " " + name;
    out += "\n";
  }
  return out;
}

Observability observe_at(Setting& s, const VectorXd& state) {
  s.problem->set_workers(1);
  s.problem->renew(state);
  s.problem->prepare(state);
  return observe(*s.problem, state);
}

/// Same names and ratios.
bool same_direction(const Names& a, const Names& b, double tolerance) {
  const std::map<std::string, double> x(a.begin(), a.end()), y(b.begin(), b.end());
  if (x.size() != y.size()) return false;
  double xx = 0, yy = 0, xy = 0;
  for (const auto& [name, v] : x) {
    if (!y.count(name)) return false;
    xx += v * v, yy += y.at(name) * y.at(name), xy += v * y.at(name);
  }
  const double sign = xy < 0 ? -1 : 1, factor = sign * std::sqrt(xx / yy);
  for (const auto& [name, v] : x)
    if (!(std::abs(v - factor * y.at(name)) < tolerance * std::abs(v))) return false;
  return true;
}

/// Whether a direction is a combination of others.
bool in_span(const Names& direction, const std::vector<Names>& basis) {
  std::map<std::string, int> row;
  for (const Names& d : basis)
    for (const auto& [name, c] : d) row.insert({name, static_cast<int>(row.size())});
  for (const auto& [name, c] : direction) row.insert({name, static_cast<int>(row.size())});
  MatrixXd a = MatrixXd::Zero(static_cast<Eigen::Index>(row.size()),
                              static_cast<Eigen::Index>(basis.size()));
  VectorXd b = VectorXd::Zero(a.rows());
  for (size_t k = 0; k < basis.size(); ++k)
    for (const auto& [name, c] : basis[k]) a(row[name], static_cast<Eigen::Index>(k)) = c;
  for (const auto& [name, c] : direction) b(row[name]) = c;
  if (basis.empty()) return false;
  const VectorXd x = dense::qr_solve(a, b);
  return (a * x - b).norm() < 1e-5 * b.norm();
}

constexpr double kSquare = 0.2;

/// base -pan- neck -tilt- head -mount1- cam1, head -mount2- cam2;  base -scan- laser
/// base -j1- -j2- -j3- -j4- -roll- wrist -tool- tool;  base -px py pz rz ry rx- flange (a robot
/// known by its flange) `change` may bend it before anything is made.
Rig gauge_rig() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "pan", "base", "neck", {0, 0, 1}, at({0.1, 0.05, 0.9}));
  add_joint(rig, JointType::revolute, "tilt", "neck", "head", {0, 1, 0}, at({0.05, 0, 0.1}));
  add_joint(rig, JointType::fixed, "mount1", "head", "cam1", {1, 0, 0},
            at({0.3, 0.2, 0.1}, {-kPi / 2, 0, -kPi / 2}));
  add_joint(rig, JointType::fixed, "mount2", "head", "cam2", {1, 0, 0},
            at({0.25, -0.25, 0.15}, {-kPi / 2, 0, -kPi / 2}));
  add_joint(rig, JointType::revolute, "scan", "base", "laser", {0, 1, 0}, at({0.1, 0, 0.6}));
  add_joint(rig, JointType::revolute, "j1", "base", "l1", {0, 0, 1}, at({0, 0, 0.3}));
  add_joint(rig, JointType::revolute, "j2", "l1", "l2", {0, 1, 0}, at({0.1, 0, 0.2}));
  add_joint(rig, JointType::revolute, "j3", "l2", "l3", {0, 1, 0}, at({0.4, 0, 0.1}));
  add_joint(rig, JointType::revolute, "j4", "l3", "l4", {0.6, 0, 0.8}, at({0.3, 0, 0}));
  add_joint(rig, JointType::revolute, "roll", "l4", "wrist", {1, 0, 0},
            at({0.1, 0, 0.05}, {0, 0.7, 0.4}));
  add_joint(rig, JointType::fixed, "tool", "wrist", "tool", {1, 0, 0}, at({0.1, 0, 0}));
  std::string parent = "base";
  for (const char* name : {"px", "py", "pz", "rz", "ry", "rx"}) {
    const char axis = name[1];
    add_joint(rig, name[0] == 'p' ? JointType::prismatic : JointType::revolute, name, parent,
              std::string("flange_") + name,
              {axis == 'x' ? 1.0 : 0, axis == 'y' ? 1.0 : 0, axis == 'z' ? 1.0 : 0}, Pose());
    parent = std::string("flange_") + name;
  }
  return rig;
}

/// Sensors and targets of the gauge robot.
void equip(Rig& rig) {
  finish_tree(rig.tree);
  add_camera(rig, "cam1", "cam1", Pose());
  add_camera(rig, "cam2", "cam2", Pose());
  add_camera(rig, "loose_cam", "cam1", at({0.02, 0, 0}));
  add_tracker(rig, "tracker", "base", Pose(), {0.001, 0.001, 0.001});
  add_tracker(rig, "hand_tracker", "base", Pose(), {0.001, 0.001, 0.001});
  add_tracker(rig, "touch", "tool", at({0.05, 0.02, 0.1}), {0.001, 0.001, 0.001});
  add_chain(rig, "hand", "tool", at({0.2, 0, 0}, {0, kPi / 2, 0}), 0.001,
            0.002);  // its z is the axis of `roll`, which it meets
  add_chain(rig, "flange", "flange_rx", at({0.1, 0.2, 0.05}, {0.2, 0.4, 0.1}), 0.001, 0.002);
  add_laser(rig, "laser", "laser", Pose(), "scan", {0.001, 0.001, 0.002});

  add_grid(rig, "wall", 5, 6, kSquare, "base",
           at({2.5, 0.5, 1.4}, {-kPi / 2 - 0.4, 0, -kPi / 2 + 0.3}));
  Eigen::Matrix3Xd marks(3, 5);
  marks << 0, 0.3, 0.05, -0.1, 0.1, 0, 0.05, 0.3, 0.1, -0.2, 0, 0.1, -0.05, 0.3, 0.1;
  add_points(rig, "marks", marks, "tool", at({0.05, 0.1, 0.1}, {0.3, 0.2, 0.1}));
  add_grid(rig, "board", 4, 5, 0.05);
  add_grid(rig, "loose", 4, 5, 0.1);
  add_points(rig, "probe", marks);
  add_points(rig, "pin", Eigen::Matrix3Xd::Zero(3, 1), "base",
             at({0.5, 0.2, 0.4}, {0.2, 0.1, 0.4}));
}

/// Exact samples of it: the cameras and the laser see the wall, the tracker the marks on the tool;
/// hand_tracker the board in the hand, that the flange holds as well; loose_cam the loose board;
/// touch the pin. `stand` fixes readings.
void take_samples(Setting& s, const Rig& truth, int count, unsigned long seed,
                  const std::map<std::string, double>& stand = {}, bool noise = false) {
  Random random(seed);
  s.samples.clear();
  s.boards.clear();
  const auto sensor = [&](const char* n) { return sensor_index(truth, n); };
  const auto target = [&](const char* n) { return target_index(truth, n); };
  Random* r = noise ? &random : nullptr;
  for (int k = 0; k < count; ++k) {
    TruePosture p;
    for (bool seen = false; !seen;) {
      p = random_posture(truth, random, 1.3, noise);
      for (const char* joint : {"pan", "tilt"}) p.readings[joint_index(truth, joint)] *= 0.4;
      for (const auto& [joint, reading] : stand) p.readings[joint_index(truth, joint)] = reading;
      seen = see(truth, sensor("cam1"), target("wall"), p) &&
             see(truth, sensor("cam2"), target("wall"), p);
    }
    p.boards[target("board")] = in_hand(truth, sensor("hand"), p, r);
    p.boards[target("loose")] =
        in_front(truth, sensor("loose_cam"), target("loose"), p, 1.2, 0.7, random);
    p.boards[target("probe")] = in_front(truth, sensor("cam1"), target("probe"), p, 1.5, 1, random);
    // The flange goes where the board is.
    const Isometry3d flange = p.boards[target("board")] *
                              isometry(truth.sensors[sensor("flange")].link_T_sensor).inverse();
    const Vector3d angles = rpy_from_rotation(flange.linear());
    const char* names[] = {"px", "py", "pz", "rx", "ry", "rz"};
    Matrix3d axes;
    for (int i = 0; i < 3; ++i) axes.col(i) = truth.tree.joints[joint_index(truth, names[i])].axis;
    const Vector3d along = axes.inverse() * flange.translation();
    for (int i = 0; i < 3; ++i) {
      p.readings[joint_index(truth, names[i])] = along(i);
      p.readings[joint_index(truth, names[3 + i])] = angles(i);
    }
    Sample sample = make_sample(truth, p, "s" + std::to_string(k));
    const std::pair<const char*, const char*> pairs[] = {
        {"cam1", "wall"},  {"cam2", "wall"},    {"laser", "wall"},         {"tracker", "marks"},
        {"hand", "board"}, {"flange", "board"}, {"hand_tracker", "board"}, {"loose_cam", "loose"},
        {"touch", "pin"},  {"cam1", "probe"},   {"cam2", "probe"}};
    for (const auto& [a, b] : pairs) add_view(sample, truth, sensor(a), target(b), p, r);
    s.samples.push_back(sample);
    s.boards.push_back(p.boards);
  }
}

std::vector<std::string> without(const std::vector<std::string>& all,
                                 const std::set<std::string>& held) {
  std::vector<std::string> out;
  for (const std::string& name : all) {
    bool part = false;
    for (const std::string& h : held) part |= h != name && h.rfind(name + ".", 0) == 0;
    if (held.count(name)) continue;
    if (!part) {
      out.push_back(name);
      continue;
    }
    for (const char* c : {"x", "y", "z", "rx", "ry", "rz"})
      if (!held.count(name + "." + c)) out.push_back(name + "." + c);
  }
  return out;
}

struct Planted {
  std::string what;
  std::vector<std::string> sensors, free;
  std::vector<Names> expected;
  std::set<std::string> hold;                // holding these cures it
  std::map<std::string, double> stand = {};  // readings that never change
  bool shared_only = true;                   // no pose of a free target takes part
  std::function<void(Rig&)> bend = {};       // changes the robot first
  bool span = false;                         // several bases are as good: the subspace is compared
  std::set<std::string> small =
      {};  // take part with less than the 0.02 of the scaled unit vector that is named
};

/// [v | w] of a rotation about `axis` through the parent's origin, as an increment on the right of
/// a frame at `pose` undoes it.
Vector6d undoing(const Pose& pose, const Vector3d& axis) {
  Vector6d out;
  const Vector3d v = -(pose.rotation.transpose() * axis.cross(pose.translation)),
                 w = -(pose.rotation.transpose() * axis);
  out << v, w;
  return out;
}
void append(Names& names, const std::string& pose, const Vector6d& xi) {
  const char* components[] = {"x", "y", "z", "rx", "ry", "rz"};
  for (int k = 0; k < 6; ++k)
    if (std::abs(xi(k)) > 1e-9) names.push_back({pose + "." + components[k], xi(k)});
}

const char* kComponents[] = {"x", "y", "z", "rx", "ry", "rz"};

std::vector<Planted> planted_gauges() {
  std::vector<Planted> all;
  const Rig plain = gauge_rig();
  const auto origin = [&](const char* joint) {
    return plain.tree.joints[joint_index(plain, joint)].parent_T_joint;
  };

  all.push_back({"wrist roll and the board's roll in the hand",
                 {"hand", "hand_tracker"},
                 {"joint/roll/offset", "sensor/hand/pose"},
                 {{{"joint/roll/offset", 1}, {"sensor/hand/pose.rz", -1}}},
                 {"sensor/hand/pose.rz"}});
  {
    Planted p{"a camera's pose and its mount",
              {"cam1"},
              {"joint/mount1/origin", "sensor/cam1/pose"},
              {},
              {"joint/mount1/origin"}};
    for (const char* c : kComponents)
      p.expected.push_back({{std::string("joint/mount1/origin.") + c, 1},
                            {std::string("sensor/cam1/pose.") + c, -1}});
    all.push_back(p);
  }
  {
    // The fixed joint behind the wrist, turned by 90 degrees against the marks' frame: x y z of one
    // are z x y of the other.
    Planted p{"two rigid poses in a row, turned",
              {"tracker"},
              {"joint/tool/origin", "target/marks/pose"},
              {},
              {"joint/tool/origin"}};
    p.bend = [](Rig& rig) {
      Matrix3d r;
      r << 0, 1, 0, 0, 0, 1, 1, 0, 0;
      rig.targets[target_index(rig, "marks")].link_T_target = {r, Vector3d::Zero()};
    };
    const int turned[] = {1, 2, 0};  // column of r in which row i has its 1
    for (int i = 0; i < 3; ++i)
      for (int part : {0, 3})
        p.expected.push_back(
            {{std::string("joint/tool/origin.") + kComponents[part + i], 1},
             {std::string("target/marks/pose.") + kComponents[part + turned[i]], -1}});
    all.push_back(p);
  }
  all.push_back({"offset and origin about the same axis",
                 {"cam1"},
                 {"joint/tilt/offset", "joint/tilt/origin"},
                 {{{"joint/tilt/offset", 1}, {"joint/tilt/origin.ry", -1}}},
                 {"joint/tilt/origin.ry"}});
  all.push_back({"the same about a negative axis",
                 {"cam1"},
                 {"joint/tilt/offset", "joint/tilt/origin"},
                 {{{"joint/tilt/offset", 1}, {"joint/tilt/origin.ry", 1}}},
                 {"joint/tilt/offset"},
                 {},
                 true,
                 [](Rig& rig) { rig.tree.joints[joint_index(rig, "tilt")].axis *= -1; }});
  all.push_back(
      {"the same about an oblique axis",
       {"tracker"},
       {"joint/j4/offset", "joint/j4/origin"},
       {{{"joint/j4/offset", 1}, {"joint/j4/origin.rx", -0.6}, {"joint/j4/origin.rz", -0.8}}},
       {"joint/j4/offset"}});
  all.push_back(
      {"a prismatic joint's offset and its origin",
       {"flange", "hand_tracker"},
       {"joint/py/offset", "joint/py/origin"},
       {{{"joint/py/offset", 1}, {"joint/py/origin.y", -0.6}, {"joint/py/origin.z", -0.8}}},
       {"joint/py/offset"},
       {},
       true,
       [](Rig& rig) { rig.tree.joints[joint_index(rig, "py")].axis << 0, 0.6, 0.8; }});
  all.push_back({"offset and scale of a joint that stands still",
                 {"tracker"},
                 {"joint/j3/offset", "joint/j3/scale", "joint/j4/offset"},
                 {{{"joint/j3/offset", -0.5}, {"joint/j3/scale", 1}}},
                 {"joint/j3/scale"},
                 {{"j3", 0.5}}});
  all.push_back({"scale of a joint that stands at 0",
                 {"tracker"},
                 {"joint/j3/offset", "joint/j3/scale", "joint/j4/scale"},
                 {{{"joint/j3/scale", 1}}},
                 {"joint/j3/scale"},
                 {{"j3", 0}}});
  {
    Planted p{"two fixed joints in a row",
              {"tracker"},
              {"joint/tool/origin", "joint/again/origin"},
              {},
              {"joint/again/origin"}};
    p.bend = [](Rig& rig) {
      add_joint(rig, JointType::fixed, "again", "tool", "tool2", {1, 0, 0}, Pose());
      finish_tree(rig.tree);
      rig.targets[target_index(rig, "marks")].link = link_index(rig, "tool2");
    };
    for (const char* c : kComponents)
      p.expected.push_back({{std::string("joint/tool/origin.") + c, 1},
                            {std::string("joint/again/origin.") + c, -1}});
    all.push_back(p);
  }
  {
    Planted p{"a camera that sees nothing but free boards",
              {"loose_cam"},
              {"sensor/loose_cam/pose", "sensor/loose_cam/intrinsics"},
              {},
              {"sensor/loose_cam/pose"}};
    for (const char* c : kComponents)
      p.expected.push_back({{std::string("sensor/loose_cam/pose.") + c, 1}});
    p.shared_only = false;
    all.push_back(p);
  }
  all.push_back({"baseline and mount of one camera",
                 {"cam1"},
                 {"sensor/cam1/pose", "sensor/cam1/baseline"},
                 {{{"sensor/cam1/pose.x", 1}, {"sensor/cam1/baseline", -1}}},
                 {"sensor/cam1/baseline"}});
  all.push_back({"size of free boards that one camera sees",
                 {"loose_cam"},
                 {"target/loose/square", "sensor/loose_cam/intrinsics"},
                 {{{"target/loose/square", 1}}},
                 {"target/loose/square"},
                 {},
                 false});
  {
    // The three points of a rigid set that are not held: moved and turned with the pose.
    Planted p{"a mounted target's pose and one of its points",
              {"tracker"},
              {"target/marks/pose.x", "target/marks/pose.y", "target/marks/points"},
              {},
              {"target/marks/pose.x", "target/marks/pose.y"}};
    for (int axis : {0, 1}) {
      Names d = {{std::string("target/marks/pose.") + kComponents[axis], 1}};
      for (int i = 0; i < 5; ++i)
        d.push_back({"target/marks/points." + std::to_string(i) + "." + kComponents[axis], -1});
      p.expected.push_back(d);
    }
    all.push_back(p);
  }
  {
    // j3 follows master, which is nowhere on the way, by -0.5.
    Planted p{"a master's offset and its follower's origin",
              {"tracker"},
              {"joint/master/offset", "joint/j3/origin"},
              {{{"joint/master/offset", 1}, {"joint/j3/origin.ry", 0.5}}},
              {"joint/master/offset"}};
    p.bend = [](Rig& rig) {
      add_joint(rig, JointType::revolute, "master", "base", "master", {0, 0, 1}, Pose());
      finish_tree(rig.tree);
      rig.tree.joints[joint_index(rig, "j3")].mimic = Mimic{joint_index(rig, "master"), -0.5, 0.1};
    };
    all.push_back(p);
  }
  {
    // Two followers of one master about the same axis that cancel: neither its offset nor its scale
    // shows.
    Planted p{"a chain of mimics that cancels",
              {"tracker"},
              {"joint/master/offset", "joint/master/scale", "joint/j1/offset"},
              {{{"joint/master/offset", 1}}, {{"joint/master/scale", 1}}},
              {"joint/master/offset", "joint/master/scale"}};
    p.bend = [](Rig& rig) {
      add_joint(rig, JointType::revolute, "master", "tool", "t1", {0, 0, 1}, at({0.1, 0, 0}));
      add_mimic(rig, JointType::revolute, "back", "t1", "t2", {0, 0, -1}, Pose(), "master", 0.5, 0);
      add_mimic(rig, JointType::revolute, "rest", "t2", "t3", {0, 0, 1}, Pose(), "back", -1, 0);
      finish_tree(rig.tree);
      rig.targets[target_index(rig, "marks")].link = link_index(rig, "t3");
    };
    all.push_back(p);
  }
  {
    Planted p{"head tilt and both cameras' mounts",
              {"cam1", "cam2"},
              {"joint/tilt/offset", "joint/mount1/origin", "joint/mount2/origin"},
              {},
              {"joint/tilt/offset"}};
    Names d = {{"joint/tilt/offset", 1}};
    append(d, "joint/mount1/origin", undoing(origin("mount1"), Vector3d::UnitY()));
    append(d, "joint/mount2/origin", undoing(origin("mount2"), Vector3d::UnitY()));
    p.small = {"joint/mount1/origin.z", "joint/mount2/origin.z"};  // along the line of sight
    d.erase(std::remove_if(d.begin(), d.end(),
                           [&](const auto& c) { return p.small.count(c.first) > 0; }),
            d.end());
    p.expected = {d};
    all.push_back(p);
  }
  all.push_back({"the first joint's offset and the tracker's place",
                 {"tracker"},
                 {"joint/j1/offset", "sensor/tracker/pose"},
                 {{{"joint/j1/offset", 1}, {"sensor/tracker/pose.rz", 1}}},
                 {"joint/j1/offset"}});
  all.push_back({"a scanning joint's offset and the laser's pose",
                 {"laser"},
                 {"joint/scan/offset", "joint/scan/scale", "sensor/laser/pose"},
                 {{{"joint/scan/offset", 1}, {"sensor/laser/pose.ry", -1}}},
                 {"joint/scan/offset"}});
  {
    Planted p{"two grips of boards that nothing else sees",
              {"hand", "flange"},
              {"sensor/hand/pose", "sensor/flange/pose"},
              {},
              {"sensor/hand/pose"}};
    for (const char* c : kComponents)
      p.expected.push_back(
          {{std::string("sensor/hand/pose.") + c, 1}, {std::string("sensor/flange/pose.") + c, 1}});
    p.shared_only = false;
    all.push_back(p);
  }
  all.push_back(
      {"rotation of a single mounted point",
       {"touch"},
       {"target/pin/pose"},
       {{{"target/pin/pose.rx", 1}}, {{"target/pin/pose.ry", 1}}, {{"target/pin/pose.rz", 1}}},
       {"target/pin/pose.rx", "target/pin/pose.ry", "target/pin/pose.rz"}});
  {
    // Moved by v = p x w while it turns by w.
    Planted p{
        "rotation about a single mounted point beside its frame",
        {"touch"},
        {"target/pin/pose"},
        {{{"target/pin/pose.rx", 1}, {"target/pin/pose.z", -0.2}},
         {{"target/pin/pose.ry", 1}, {"target/pin/pose.z", 0.3}},
         {{"target/pin/pose.rz", 1}, {"target/pin/pose.x", 0.2}, {"target/pin/pose.y", -0.3}}},
        {"target/pin/pose.rx", "target/pin/pose.ry", "target/pin/pose.rz"}};
    p.bend = [](Rig& rig) { rig.targets[target_index(rig, "pin")].points << 0.3, 0.2, 0; };
    p.span = true;
    all.push_back(p);
  }
  {
    // Parallel axes: along them, and about them.
    Planted p{"origins of two parallel joints",
              {"tracker"},
              {"joint/j2/origin", "joint/j3/origin"},
              {{{"joint/j2/origin.y", 1}, {"joint/j3/origin.y", -1}}},
              {"joint/j2/origin.y", "joint/j2/origin.ry"}};
    Names turn = {{"joint/j2/origin.ry", 1}};
    append(turn, "joint/j3/origin", undoing(origin("j3"), Vector3d::UnitY()));
    p.expected.push_back(turn);
    all.push_back(p);
  }
  {
    Planted p{
        "four independent gauges in one problem",
        {"cam1", "tracker", "laser", "hand", "hand_tracker"},
        {"joint/roll/offset", "sensor/hand/pose", "joint/tilt/offset", "joint/tilt/origin",
         "joint/j3/scale", "joint/j3/offset", "joint/scan/offset", "sensor/laser/pose",
         "joint/j4/offset"},
        {{{"joint/roll/offset", 1}, {"sensor/hand/pose.rz", -1}},
         {{"joint/tilt/offset", 1}, {"joint/tilt/origin.ry", -1}},
         {{"joint/j3/offset", -0.5}, {"joint/j3/scale", 1}},
         {{"joint/scan/offset", 1}, {"sensor/laser/pose.ry", -1}}},
        {"sensor/hand/pose.rz", "joint/tilt/origin.ry", "joint/j3/scale", "joint/scan/offset"},
        {{"j3", 0.5}}};
    // The marks would see the roll without the hand: they sit before it.
    p.bend = [](Rig& rig) { rig.targets[target_index(rig, "marks")].link = link_index(rig, "l4"); };
    all.push_back(p);
  }
  return all;
}

}  // namespace

TEST_CASE("gauges: each is found, alone, named with its coefficients, and gone when it is held") {
  const std::vector<Planted> all = planted_gauges();
  REQUIRE(all.size() >= 20);
  for (const Planted& p : all) {
    INFO(p.what);
    Setting s;
    s.rig = gauge_rig();
    equip(s.rig);
    if (p.bend) p.bend(s.rig);
    take_samples(s, s.rig, 14, 100, p.stand);
    const Rig truth = s.rig;
    s.make(p.sensors, p.free);
    {
      const Observability o = observe_at(s, s.start());
      const std::vector<Names> found = directions(s, o);
      INFO("found:\n" << text(found) << "expected:\n" << text(p.expected));
      CHECK(found.size() == p.expected.size());
      std::set<std::string> involved = p.small;
      for (const Names& e : p.expected) {
        if (p.span)
          CHECK(in_span(e, found));
        else
          CHECK(std::any_of(found.begin(), found.end(),
                            [&](const Names& f) { return same_direction(f, e, 1e-5); }));
        for (const auto& [name, c] : e) involved.insert(name);
      }
      for (int c = 0; c < s.problem->shared_size(); ++c) {
        INFO(s.problem->column_name(c));
        CHECK(static_cast<bool>(o.unobservable[c]) ==
              (involved.count(s.problem->column_name(c)) > 0));
      }
      CHECK(o.covariance.allFinite());
      CHECK(o.dof() == o.rows - o.rank);
      const Stacked stacked = stack(*s.problem, s.start());
      CHECK(o.rows == stacked.j.rows());
      CHECK(o.rank == stacked.j.cols() - static_cast<long>(p.expected.size()));
    }

    // A robot that differs a little: the minimum is found, and lies, to first order, nearest to the
    // start along each gauge.
    Random random(7);
    const double kMove = 1e-3;
    Rig start = moved(truth, p.free, random, kMove, kMove, 0.1, kMove);
    s.rig = start;
    s.make(p.sensors, p.free);
    VectorXd state = s.start();
    const SolveSummary summary = solve(s, state);
    CHECK(summary.outcome == Outcome::converged);
    CHECK(summary.cost.chi2 < 1e-9);
    const Observability o = observe_at(s, state);
    INFO("after solving:\n" << text(directions(s, o)));
    CHECK(o.directions.size() == p.expected.size());
    if (p.shared_only) {
      // Increments as unknowns are: log(T0^-1 T) for poses, differences else; metric: squared
      // column norms, as the format's scaling.
      Values after;
      after.shared = s.table.initial;
      s.problem->unpack(state, after);
      const Stacked stacked = stack(*s.problem, state);
      VectorXd moved_by(s.problem->shared_size());
      for (int c = 0; c < s.problem->shared_size(); ++c) {
        const auto [index, component] = s.problem->columns()[c];
        const Parameter& parameter = s.table.all[index];
        moved_by(c) = parameter.pose ? log_se3(inverse(get_pose(s.table.initial, parameter.start)) *
                                               get_pose(after.shared, parameter.start))(component)
                                     : after.shared(parameter.start + component) -
                                           s.table.initial(parameter.start + component);
      }
      const VectorXd norm = stacked.j.rightCols(s.problem->shared_size()).colwise().norm();
      const VectorXd scaled = norm.cwiseProduct(moved_by);
      for (const auto& d : o.directions) {
        VectorXd n = VectorXd::Zero(scaled.size());
        for (const auto& [column, coefficient] : d) n(column) = coefficient * norm(column);
        if (n.norm() == 0) continue;  // columns that have no influence at all
        double part = 0;
        for (const auto& [column, coefficient] : d) part += std::pow(scaled(column), 2);
        CHECK(std::abs(n.dot(scaled)) / n.norm() < 0.03 * std::sqrt(part) + 1e-9);
      }
      for (int c = 0; c < scaled.size(); ++c)
        if (norm(c) == 0)
          CHECK(std::abs(moved_by(c)) < 1e-15);  // exp and log of the rest of the pose leave 1e-17
    }

    // Held, it is gone, and what was freed beside it is found exactly.
    s.rig = truth;
    Random again(8);
    const std::vector<std::string> rest = without(p.free, p.hold);
    if (rest.empty()) continue;
    s.rig = moved(truth, rest, again, kMove, kMove, 0.1, kMove);
    s.make(p.sensors, rest);
    state = s.start();
    CHECK(solve(s, state).outcome == Outcome::converged);
    const Observability cured = observe_at(s, state);
    INFO("held:\n" << text(directions(s, cured)));
    CHECK(cured.directions.empty());
    CHECK(std::count(cured.unobservable.begin(), cured.unobservable.end(), 0) ==
          s.problem->shared_size());
    Values found;
    found.shared = s.table.initial;
    s.problem->unpack(state, found);
    CHECK((found.shared - ParameterTable(truth).initial).cwiseAbs().maxCoeff() < 1e-6);
  }
}

TEST_CASE(
    "gauges: with noise the minimum is found, the same one as with the gauge held, in every mode") {
  for (const Planted& p : planted_gauges())
    for (const NoiseMode mode :
         {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none}) {
      // Two grips of a board that nothing else sees are free together only where the grips'
      // residuals are nothing: with noise the estimate may trade one grip's translation against its
      // rotation.
      if (p.what.find("two grips") == 0) continue;
      INFO(p.what << ", mode " << static_cast<int>(mode));
      Setting s;
      s.rig = gauge_rig();
      equip(s.rig);
      if (p.bend) p.bend(s.rig);
      for (const char* joint : {"pan", "tilt", "j1", "j2", "j4", "roll"})
        s.rig.joints[joint_index(s.rig, joint)].sigma = 0.001;
      take_samples(s, s.rig, 14, 200, p.stand, true);
      const Rig truth = s.rig;
      const std::vector<std::string> rest = without(p.free, p.hold);
      double chi2[2] = {0, 0};
      long dof[2] = {0, 0};
      for (const int held : {0, 1}) {
        if (held && rest.empty()) continue;
        Random random(9);
        s.rig = moved(truth, rest.empty() ? p.free : rest, random, 0.01, 0.01, 1, 0.01);
        s.make(p.sensors, held ? rest : p.free, mode);
        VectorXd state = s.start();
        const SolveSummary summary = solve(s, state);
        INFO((held ? "held" : "free") << ", " << summary.iterations << " iterations");
        CHECK(summary.outcome == Outcome::converged);
        const Observability o = observe_at(s, state);
        INFO(text(directions(s, o)));
        CHECK(o.directions.size() == (held ? 0 : p.expected.size()));
        chi2[held] = summary.cost.chi2;
        dof[held] = o.dof();
        CHECK(o.dof() > 20);
        if (mode != NoiseMode::none && mode != NoiseMode::point)
          CHECK(std::abs(summary.cost.chi2 / static_cast<double>(o.dof()) - 1) <
                6 / std::sqrt(o.dof() / 2.0));
      }
      if (rest.empty()) continue;
      // The covariances of marginal and point depend on where along the gauge the estimate lies.
      CHECK(std::abs(chi2[0] / chi2[1] - 1) <
            (mode == NoiseMode::latent || mode == NoiseMode::none ? 1e-9 : 0.02));
      CHECK(dof[0] == dof[1]);
    }
}

namespace {

VectorXd shared_of(const Setting& s, const VectorXd& state) {
  Values v;
  v.shared = s.table.initial;
  s.problem->unpack(state, v);
  return v.shared;
}

MatrixXd dense_covariance(const Stacked& stacked, int shared) {
  // By a QR of the whole, columns scaled.
  const VectorXd norm = stacked.j.colwise().norm();
  const MatrixXd scaled = stacked.j * norm.cwiseInverse().asDiagonal();
  const Eigen::Index n = stacked.j.cols();
  const MatrixXd r = dense::upper(scaled);
  const MatrixXd inverse_r =
      norm.cwiseInverse().asDiagonal() *
      MatrixXd(r.triangularView<Eigen::Upper>().solve(MatrixXd::Identity(n, n)));
  return (inverse_r * inverse_r.transpose()).bottomRightCorner(shared, shared);
}

}  // namespace

TEST_CASE(
    "observability: covariance, rank and degrees of freedom are those of the stacked Jacobian") {
  for (const NoiseMode mode :
       {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none}) {
    Setting s = nasty_in(mode, {LossKind::huber, 2}, 8, 61, 1e-3);
    const VectorXd state = s.start();
    const Observability o = observe_at(s, state);
    INFO(text(directions(s, o)));
    REQUIRE(o.directions.empty());
    const Stacked stacked = stack(*s.problem, state);
    const int n = s.problem->shared_size();
    const MatrixXd expected = dense_covariance(stacked, n);
    REQUIRE(o.covariance.rows() == n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j)
        CHECK(std::abs(o.covariance(i, j) - expected(i, j)) <
              1e-8 * std::sqrt(expected(i, i) * expected(j, j)));
    CHECK(o.rows == stacked.j.rows());
    CHECK(o.rank == stacked.j.cols());
    CHECK(o.dof() == stacked.j.rows() - stacked.j.cols());
  }
}

TEST_CASE("observability: a free target that its sample does not determine is eliminated by rank") {
  // One reflector (rank 3 of 6), three points on a line (rank 5), two samples of each and one of a
  // board that is whole; seen by a camera and a tracker whose poses are asked for: enough in common
  // to tie the one to the other, up to nothing at all.
  Random random(71);
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::fixed, "mast", "base", "mast", {1, 0, 0},
            at({0.1, 0.2, 0.3}, {0.1, 0.2, 0.3}));
  add_camera(rig, "camera", "mast", at({0.2, 0, 0}, {0.3, 0.1, 0.2}));
  add_tracker(rig, "tracker", "base", at({0, 0.5, 0.1}), {0.001, 0.002, 0.001});
  Eigen::Matrix3Xd line(3, 3);
  line << 0.1, 0.2, 0.4, 0, 0, 0, 0.05, 0.1, 0.2;
  const int reflector = add_points(rig, "reflector", Eigen::Vector3d(0.02, 0.01, 0)),
            rod = add_points(rig, "rod", line), board = add_grid(rig, "board", 3, 3, 0.1);
  finish_tree(rig.tree);
  Setting s;
  s.rig = rig;
  const std::vector<std::vector<int>> shown = {{reflector}, {rod},       {reflector, rod}, {board},
                                               {rod},       {reflector}, {reflector}};
  for (const std::vector<int>& targets : shown) {
    TruePosture p = empty_posture(rig);
    Sample sample = make_sample(rig, p, "s" + std::to_string(s.samples.size()));
    for (const int t : targets) p.boards[t] = in_front(rig, 0, t, p, 1.2, 1, random);
    for (const int t : targets)
      for (const int sensor : {0, 1}) REQUIRE(add_view(sample, rig, sensor, t, p, &random));
    s.samples.push_back(sample);
    s.boards.push_back(p.boards);
  }
  for (const bool with_board : {true, false}) {
    if (!with_board) {
      s.samples.erase(s.samples.begin() + 3);
      s.boards.erase(s.boards.begin() + 3);
    }
    s.make({"camera", "tracker"}, {"sensor/camera/pose"});
    VectorXd state = s.start();
    CHECK(solve(s, state).outcome == Outcome::converged);
    const Observability o = observe_at(s, state);
    INFO(text(directions(s, o)));
    CHECK(o.directions.empty());
    // By hand: what the shared unknowns keep when the privates' range is projected away, by
    // singular values.
    const Stacked stacked = stack(*s.problem, state);
    const MatrixXd own = stacked.j.leftCols(stacked.privates), shared = stacked.j.rightCols(6);
    const dense::Svd svd = dense::svd(own);
    const long rank = (svd.values.array() > 1e-9 * svd.values(0)).count();
    CHECK(rank == (with_board ? 4 * 3 + 3 * 5 + 6 : 4 * 3 + 3 * 5));
    const MatrixXd range = svd.u.leftCols(rank);
    const MatrixXd rest = shared - range * (range.transpose() * shared);
    const MatrixXd expected = dense::inverse(rest.transpose() * rest);
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j)
        CHECK(std::abs(o.covariance(i, j) - expected(i, j)) <
              1e-7 * std::sqrt(expected(i, i) * expected(j, j)));
    CHECK(o.rank == rank + 6);
    CHECK(o.rows == stacked.j.rows());
    CHECK(o.dof() == stacked.j.rows() - rank - 6);
  }
}

TEST_CASE("observability: what has no influence at all is a direction of its own") {
  Setting s;
  s.rig = gauge_rig();
  equip(s.rig);
  take_samples(s, s.rig, 6, 3);
  s.make({"cam1"},
         {"joint/pan/offset", "joint/j1/offset", "sensor/cam2/baseline", "joint/scan/origin.x"});
  const Observability o = observe_at(s, s.start());
  const std::vector<Names> found = directions(s, o);
  INFO(text(found));
  CHECK(found.size() == 3);
  for (const char* name : {"joint/j1/offset", "sensor/cam2/baseline", "joint/scan/origin.x"})
    CHECK(std::any_of(found.begin(), found.end(), [&](const Names& f) {
      return same_direction(f, {{name, 1}}, 1e-9);
    }));
}

TEST_CASE("observability: priors count as rows and hold a gauge") {
  Setting s;
  s.rig = gauge_rig();
  equip(s.rig);
  take_samples(s, s.rig, 6, 3);
  s.make({"cam1"}, {"joint/tilt/offset", "joint/tilt/origin"});
  const long rows = observe_at(s, s.start()).rows;
  EstimationSetup setup = s.problem->setup();
  setup.priors = {{s.table.joint_offset[joint_index(s.rig, "tilt")], 0, 0.01}};
  s.problem = std::make_unique<Estimation>(s, s.training(), setup);
  const Observability o = observe_at(s, s.start());
  CHECK(o.directions.empty());
  CHECK(o.rows == rows + 1);
  CHECK(std::sqrt(o.covariance(0, 0)) == Approx(0.01).epsilon(1e-3));
}

TEST_CASE(
    "levenberg-marquardt: truth without noise is recovered to 1e-8, in every mode and from a "
    "perturbed start") {
  for (const NoiseMode mode :
       {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none}) {
    Rig truth;
    Setting s = nasty(10, 81, false, kDetermined, 0.02, &truth);
    const Values values = s.values;
    s.make(sensor_names(s.rig), kDetermined, mode);
    s.values = values;
    VectorXd state = s.start();
    const SolveSummary summary = solve(s, state);
    INFO("mode " << static_cast<int>(mode) << ", " << summary.iterations << " iterations, chi2 "
                 << summary.cost.chi2);
    CHECK(summary.outcome == Outcome::converged);
    CHECK(summary.cost.chi2 < 1e-10);
    CHECK(summary.history.size() == static_cast<size_t>(summary.iterations) + 1);
    for (size_t i = 1; i < summary.history.size(); ++i) CHECK(summary.history[i].second >= 0);
    // Of partly freed poses every component is compared: the held ones are the truth's.
    CHECK((shared_of(s, state) - ParameterTable(truth).initial).cwiseAbs().maxCoeff() < 1e-8);
    Values found;
    found.shared = s.table.initial;
    s.problem->unpack(state, found);
    for (size_t k = 0; k < s.boards.size(); ++k)
      for (const auto& [target, board] : s.boards[k]) {
        const auto it = found.targets.find({static_cast<int>(k), target});
        if (it != found.targets.end())
          CHECK((isometry(it->second).matrix() - board.matrix()).cwiseAbs().maxCoeff() < 1e-7);
      }
  }
}

TEST_CASE(
    "levenberg-marquardt: at the minimum the gradient vanishes, with noise, every mode and loss") {
  for (const NoiseMode mode :
       {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none})
    for (const LossKind loss :
         {LossKind::none, LossKind::huber, LossKind::soft_l1, LossKind::cauchy, LossKind::tukey}) {
      Setting s = nasty_in(mode, {}, 6, 91, 5e-3);
      VectorXd state = s.start();
      REQUIRE(solve(s, state).outcome == Outcome::converged);
      if (loss != LossKind::none) {  // from the minimum without a loss, as a following step would
        Values there;
        there.shared = s.table.initial;
        s.problem->unpack(state, there);
        s.make(sensor_names(s.rig), kDetermined, mode,
               {loss, loss == LossKind::tukey ? 20.0 : 2.0});
        s.values = there;
        state = s.start();
      }
      const SolveSummary summary = solve(s, state);
      INFO("mode " << static_cast<int>(mode) << ", loss " << static_cast<int>(loss) << ", "
                   << summary.iterations << " iterations");
      CHECK(summary.outcome == Outcome::converged);
      // J'r = 0 with covariances evaluated here: steps of what is left are below 1e-6 sigma.
      s.problem->renew(state);
      s.problem->prepare(state);
      const Stacked stacked = stack(*s.problem, state);
      const VectorXd norm = stacked.j.colwise().norm().cwiseMax(1e-300);
      const MatrixXd scaled = stacked.j * norm.cwiseInverse().asDiagonal();
      const VectorXd step = dense::qr_solve(scaled, stacked.r);
      CHECK((scaled * step).norm() < 1e-5);
      // The cost reported is the cost there.
      Cost sum;
      for (size_t g = 0; g < s.problem->groups().size(); ++g) {
        Cost c;
        REQUIRE(s.problem->evaluate(static_cast<int>(g), state, 0, c));
        sum.chi2 += c.chi2;
        sum.doubled += c.doubled;
      }
      CHECK(summary.cost.chi2 == Approx(sum.chi2).epsilon(1e-8));
      CHECK(summary.cost.doubled == Approx(sum.doubled).epsilon(1e-8));
    }
}

TEST_CASE("levenberg-marquardt: dense, sparse and CHOLMOD agree") {
  for (const NoiseMode mode : {NoiseMode::latent, NoiseMode::marginal}) {
    double chi2[3];
    VectorXd shared[3], sigma;
    for (const int k : {0, 1, 2}) {
      Setting s = nasty_in(mode, {}, 8, 101, 5e-3);
      VectorXd state = s.start();
      SolverOptions options;
      options.linear_solver = k == 0   ? LinearSolver::dense
                              : k == 1 ? LinearSolver::sparse
                                       : LinearSolver::cholmod;
      LevenbergMarquardt solver(*s.problem, options);
      CHECK(std::string(solver.linear_solver()) == (k == 0   ? "dense"
                                                    : k == 1 ? "sparse"
                                                             : "cholmod"));
      const SolveSummary summary = solver.solve(state);
      REQUIRE(summary.outcome == Outcome::converged);
      chi2[k] = summary.cost.chi2;
      const Observability o = observe_at(s, state);
      // Unknowns as increments: compared where they are plain numbers or, for poses, through a
      // tangent.
      const VectorXd values_now = shared_of(s, state);
      shared[k].resize(s.problem->shared_size());
      for (int c = 0; c < s.problem->shared_size(); ++c) {
        const auto [index, component] = s.problem->columns()[c];
        const Parameter& p = s.table.all[index];
        shared[k](c) = p.pose ? log_se3(inverse(get_pose(s.table.initial, p.start)) *
                                        get_pose(values_now, p.start))(component)
                              : values_now(p.start + component);
      }
      sigma = o.covariance.diagonal().cwiseSqrt();
    }
    for (const int k : {1, 2}) {
      CHECK(std::abs(chi2[0] / chi2[k] - 1) < 1e-10);
      CHECK(((shared[0] - shared[k]).cwiseQuotient(sigma)).cwiseAbs().maxCoeff() < 1e-6);
    }
  }
}

TEST_CASE("levenberg-marquardt: the same bits with any number of threads") {
  for (const NoiseMode mode : {NoiseMode::latent, NoiseMode::marginal})
    for (const LinearSolver choice :
         {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod}) {
      VectorXd first;
      SolveSummary one;
      for (const int threads : {1, 2, 3, 2}) {
        Setting s = nasty_in(mode, {}, 7, 111, 1e-2);
        VectorXd state = s.start();
        const SolveSummary summary = solve(s, state, threads, choice);
        REQUIRE(summary.outcome == Outcome::converged);
        if (first.size() == 0) {
          first = state;
          one = summary;
          continue;
        }
        INFO(threads << " threads");
        REQUIRE(state.size() == first.size());
        CHECK(std::memcmp(state.data(), first.data(),
                          sizeof(double) * static_cast<size_t>(state.size())) == 0);
        CHECK(summary.cost.chi2 == one.cost.chi2);
        CHECK(summary.history == one.history);
      }
    }
}

TEST_CASE("levenberg-marquardt: cancelled, out of iterations, undefined at the start") {
  Setting s = nasty(6, 121, true, kDetermined, 1e-2);
  const VectorXd start = s.start();
  {
    SolverOptions options;
    int calls = 0;
    options.progress = Progress([&](const Progress::News& news) {
      ++calls;
      CHECK(news.iteration == calls);
      CHECK(news.chi2 > 0);
      return news.iteration < 2;
    });
    VectorXd state = start;
    LevenbergMarquardt solver(*s.problem, options);
    CHECK(solver.solve(state).outcome == Outcome::cancelled);
    CHECK(calls == 2);
  }
  {
    SolverOptions options;
    options.max_iterations = 1;
    VectorXd state = start;
    LevenbergMarquardt solver(*s.problem, options);
    const SolveSummary summary = solver.solve(state);
    CHECK(summary.outcome == Outcome::not_converged);
    CHECK(summary.iterations == 1);
    CHECK(summary.history.size() == 2);
    CHECK(summary.history[1].first < summary.history[0].first);
  }
  {
    // A board behind the camera in one sample: the group is named and nothing has moved.
    Random random(122);
    Setting behind;
    add_link(behind.rig, "base");
    add_camera(behind.rig, "camera", "base", Pose());
    const int board = add_grid(behind.rig, "board", 3, 4, 0.1);
    finish_tree(behind.rig.tree);
    for (int k = 0; k < 4; ++k) {
      TruePosture p = empty_posture(behind.rig);
      p.boards[board] = in_front(behind.rig, 0, board, p, 1, 0.8, random);
      Sample sample = make_sample(behind.rig, p, "s" + std::to_string(k));
      REQUIRE(add_view(sample, behind.rig, 0, board, p, &random));
      behind.samples.push_back(sample);
      behind.boards.push_back(p.boards);
    }
    behind.make({"camera"}, {"sensor/camera/intrinsics"});
    behind.values.targets[{2, board}].translation.z() -= 3;
    VectorXd state = behind.start();
    const VectorXd before = state;
    const SolveSummary summary = solve(behind, state);
    CHECK(summary.outcome == Outcome::undefined_start);
    REQUIRE(summary.undefined_group >= 0);
    CHECK(behind.problem->sample_of(summary.undefined_group) == 2);
    CHECK(state == before);
    behind.values.targets[{2, board}] = to_pose(behind.boards[2].at(board));
    state = behind.start();
    CHECK(solve(behind, state).outcome == Outcome::converged);
  }
}

namespace {

/// Hands everything on to an Estimation and counts trials that it calls undefined.
class Watched final : public Problem {
 public:
  explicit Watched(Estimation& inner) : inner_(inner) {}
  mutable int undefined = 0;
  int shared_size() const override { return inner_.shared_size(); }
  const std::vector<GroupShape>& groups() const override { return inner_.groups(); }
  void set_workers(int count) override { inner_.set_workers(count); }
  void prepare(const VectorXd& state) override { inner_.prepare(state); }
  bool evaluate(int group, const VectorXd& state, int worker, Cost& cost) const override {
    return count(inner_.evaluate(group, state, worker, cost));
  }
  bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                 Cost& cost) const override {
    return count(inner_.linearise(group, state, worker, to, cost));
  }
  void begin_piece(int worker) const override { inner_.begin_piece(worker); }
  void end_piece(int worker, const GroupEquations& to) const override {
    inner_.end_piece(worker, to);
  }
  bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const override {
    return inner_.square_root(group, state, worker, rows);
  }
  void retract(const VectorXd& state, const VectorXd& shared, const VectorXd& own,
               VectorXd& moved) const override {
    inner_.retract(state, shared, own, moved);
  }
  bool renew(const VectorXd& state) override { return inner_.renew(state); }

 private:
  bool count(bool defined) const {
    undefined += !defined;
    return defined;
  }
  Estimation& inner_;
};

}  // namespace

TEST_CASE(
    "levenberg-marquardt: a trial that puts a point behind its camera is rejected, and the minimum "
    "found all the same") {
  Rig rig;
  add_link(rig, "base");
  add_camera(rig, "camera", "base", Pose());
  const int board = add_grid(rig, "board", 3, 4, 0.1);
  finish_tree(rig.tree);
  int met = 0;
  for (int trial = 0; trial < 20; ++trial) {
    Random random(200 + trial);
    Setting s;
    s.rig = rig;
    TruePosture p = empty_posture(rig);
    p.boards[board] = in_front(rig, 0, board, p, 0.45, 0.6, random);
    Sample sample = make_sample(rig, p, "near");
    if (!add_view(sample, rig, 0, board, p, &random)) continue;
    s.samples = {sample};
    s.boards = {p.boards};
    s.make({"camera"}, {});
    // Far too far away and turned: the first full step overshoots.
    Pose& start = s.values.targets[{0, board}];
    start.translation +=
        Vector3d(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(1, 4));
    start.rotation = (start.rotation * random.rotation(0.7)).eval();
    VectorXd state = s.start();
    Watched watched(*s.problem);
    LevenbergMarquardt solver(watched, {});
    const SolveSummary summary = solver.solve(state);
    INFO("trial " << trial << ", undefined " << watched.undefined);
    if (summary.outcome != Outcome::converged || summary.cost.chi2 > 100)
      continue;  // another minimum (the mirrored board): not the point here
    met += watched.undefined > 0;
    for (size_t i = 1; i < summary.history.size(); ++i)
      CHECK(summary.history[i].first <= summary.history[i - 1].first * (1 + 1e-12));
    Values found;
    found.shared = s.table.initial;
    s.problem->unpack(state, found);
    CHECK((isometry(found.targets.at({0, board})).matrix() - p.boards.at(board).matrix())
              .cwiseAbs()
              .maxCoeff() < 0.05);
  }
  INFO("trials that met it: " << met);
  CHECK(met >= 1);
}

namespace {

/// A bundle adjustment in small, nothing of kincal's models: y_k = exp(a t) p_k with one shared
/// rate a and private amplitudes p. `misfit`: size of what no such curve explains.
class Curves final : public Problem {
 public:
  explicit Curves(int count, double misfit = 0) : misfit_(misfit) {
    for (int g = 0; g < count; ++g) shapes_.push_back({1, {0}, 5});
  }
  double datum(int group, int k) const {
    return (1 + 0.3 * group) * std::exp(-0.7 * k * 0.3) +
           misfit_ * std::cos(2.0 * group + 2.3 * k * k);
  }
  int shared_size() const override { return 1; }
  const std::vector<GroupShape>& groups() const override { return shapes_; }
  void set_workers(int) override {}
  void prepare(const VectorXd&) override {}
  bool evaluate(int group, const VectorXd& state, int, Cost& cost) const override {
    cost = {};
    for (int k = 0; k < 5; ++k) {
      const double r = state(1 + group) * std::exp(state(0) * k * 0.3) - datum(group, k);
      cost.chi2 += r * r;
    }
    cost.doubled = cost.chi2;
    return std::isfinite(cost.chi2);
  }
  bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                 Cost& cost) const override {
    MatrixXd rows;
    square_root(group, state, worker, rows);
    const MatrixXd gram = rows.transpose() * rows;
    for (int i = 0; i < 3; ++i) to.rows[i] += gram(0, i);
    to.shared[to.origin[to.row[0]] + to.row[0]] += gram(1, 1);
    to.gradient[to.row[0]] += gram(1, 2);
    return evaluate(group, state, worker, cost);
  }
  bool square_root(int group, const VectorXd& state, int, MatrixXd& rows) const override {
    rows.resize(5, 3);
    for (int k = 0; k < 5; ++k) {
      const double e = std::exp(state(0) * k * 0.3);
      rows.row(k) << e, state(1 + group) * e * k * 0.3, state(1 + group) * e - datum(group, k);
    }
    return true;
  }
  void retract(const VectorXd& state, const VectorXd& shared, const VectorXd& own,
               VectorXd& moved) const override {
    moved = state;
    moved(0) += shared(0);
    moved.tail(own.size()) += own;
  }
  bool renew(const VectorXd&) override { return false; }

 private:
  double misfit_;
  std::vector<GroupShape> shapes_;
};

}  // namespace

// Second derivatives of large residuals, which the steps lack: most of these problems need damping
// to the end, or undamped steps fall too short. What it does not prove: that it is the lowest of
// several minima.
TEST_CASE("levenberg-marquardt: it knows the minimum of what no model explains") {
  int most = 0, solved = 0;
  for (double misfit : {0.3, 1.0, 2.0, 3.0, 5.0, 8.0})
    for (int count = 1; count <= 9; ++count) {
      INFO("misfit " << misfit << ", " << count << " curves");
      Curves curves(count, misfit);
      VectorXd state = VectorXd::Ones(count + 1);
      LevenbergMarquardt solver(curves, {});
      const SolveSummary summary = solver.solve(state);
      if (std::abs(state(0)) > 10) continue;  // the best rate is infinite: there is no minimum
      ++solved;
      CHECK(summary.outcome == Outcome::converged);
      most = std::max(most, summary.iterations);
      // The gradient, in standard deviations: of each unknown alone.
      VectorXd gradient = VectorXd::Zero(count + 1), norm = gradient;
      MatrixXd rows;
      for (int g = 0; g < count; ++g) {
        curves.square_root(g, state, 0, rows);
        const VectorXd gr = rows.transpose() * rows.col(2);
        gradient(1 + g) += gr(0);
        gradient(0) += gr(1);
        norm(1 + g) += rows.col(0).squaredNorm();
        norm(0) += rows.col(1).squaredNorm();
      }
      for (int i = 0; i <= count; ++i)
        if (norm(i) > 0) CHECK(std::abs(gradient(i)) / std::sqrt(norm(i)) < 1e-5);
      // With the rule off it goes on, and nowhere else.
      SolverOptions on;
      on.stop = false;
      on.max_iterations = 300;
      VectorXd far = state;
      LevenbergMarquardt again(curves, on);
      again.solve(far);
      for (int i = 0; i <= count; ++i)
        CHECK(std::abs(far(i) - state(i)) * std::sqrt(norm(i)) < 1e-3);
    }
  CHECK(solved >= 40);
  CHECK(most <= 40);
}

// The differences of gradients beside a Hessian from differences of the cost alone. What it does
// not prove: anything of sparse systems, which have none.
TEST_CASE("levenberg-marquardt: second derivatives are those of the cost") {
  const int count = 4;
  Curves curves(count, 3);
  const VectorXd state = VectorXd::LinSpaced(count + 1, 0.4, 1.3);
  const auto cost_at = [&](const VectorXd& x) {
    double sum = 0;
    Cost cost;
    for (int g = 0; g < count; ++g) {
      curves.evaluate(g, x, 0, cost);
      sum += cost.doubled / 2;
    }
    return sum;
  };
  const double h = 1e-4;
  MatrixXd hessian(count + 1, count + 1);
  for (int i = 0; i <= count; ++i)
    for (int j = 0; j <= count; ++j) {
      VectorXd sum = VectorXd::Zero(4);
      for (int k = 0; k < 4; ++k) {
        VectorXd x = state;
        x(i) += k & 1 ? h : -h;
        x(j) += k & 2 ? h : -h;
        sum(k) = cost_at(x);
      }
      hessian(i, j) = (sum(3) - sum(1) - sum(2) + sum(0)) / (4 * h * h);
    }
  Arrowhead arrowhead(curves, LinearSolver::automatic, 1);
  Cost cost;
  const auto reduced = [&] {
    REQUIRE(arrowhead.assemble(state, 0, true, true, cost) == Arrowhead::Assembly::fine);
    return arrowhead.system.full(arrowhead.damped_matrix().data())(0, 0);
  };
  const double without = reduced();
  REQUIRE(arrowhead.find_curvature(state, [] { return true; }));
  const double with = reduced();
  double expected = hessian(0, 0);
  for (int i = 1; i <= count; ++i) expected -= hessian(0, i) * hessian(0, i) / hessian(i, i);
  CHECK(std::abs(with / expected - 1) < 1e-3);     // one-sided, over 1e-3 standard deviations
  CHECK(std::abs(without / expected - 1) > 0.05);  // what is lacking is not little here
  arrowhead.forget_curvature();
  CHECK(reduced() == without);
}

// What no model explains, of a kind that takes undamped steps long without them. What it does not
// prove: how many steps other problems need (benchmarks/stopping.py counts them).
TEST_CASE("levenberg-marquardt: second derivatives save steps where residuals are large") {
  int with = 0, without = 0;
  for (double misfit : {3.0, 5.0, 8.0})
    for (int count = 2; count <= 9; ++count) {
      Curves curves(count, misfit);
      SolverOptions options;
      VectorXd state = VectorXd::Ones(count + 1), other = state;
      LevenbergMarquardt solver(curves, options);
      const SolveSummary fast = solver.solve(state);
      options.second_derivatives = false;
      LevenbergMarquardt plain(curves, options);
      const SolveSummary slow = plain.solve(other);
      if (std::abs(state(0)) > 10 || std::abs(other(0)) > 10) continue;
      CHECK(fast.outcome == Outcome::converged);
      CHECK(std::abs(fast.cost.doubled / slow.cost.doubled - 1) < 1e-9);
      with = std::max(with, fast.iterations);
      without = std::max(without, slow.iterations);
    }
  CAPTURE(with, without);
  CHECK(with < without);
}

TEST_CASE("levenberg-marquardt: close to the minimum the first step is undamped already") {
  Curves curves(4, 0.01);
  SolverOptions options;
  VectorXd far = VectorXd::Ones(5);
  const SolveSummary best = LevenbergMarquardt(curves, options).solve(far);
  REQUIRE(best.outcome == Outcome::converged);
  VectorXd damped = far, close = far;
  damped.array() += 1e-4;
  close.array() += 1e-4;
  const SolveSummary with = LevenbergMarquardt(curves, options).solve(damped);
  options.near_minimum = true;
  const SolveSummary without = LevenbergMarquardt(curves, options).solve(close);
  REQUIRE(without.outcome == Outcome::converged);
  CHECK(with.history[1].second > 1e-5);
  CHECK(without.history[1].second < 1e-9);
  CHECK((close - far).norm() < 1e-6 * far.norm());
}

TEST_CASE(
    "levenberg-marquardt: can be cancelled between the linearisations of second derivatives") {
  int asked = 0;
  for (int count = 2; count <= 9 && asked == 0; ++count) {
    Curves curves(count, 5.0);
    SolverOptions options;
    int last = 0, again = 0;
    const auto count_again = [&](const Progress::News& news) {
      CHECK(news.chi2 > 0);
      again += news.iteration == last;
      last = news.iteration;
      return true;
    };
    options.progress = Progress(count_again);
    VectorXd state = VectorXd::Ones(count + 1);
    LevenbergMarquardt(curves, options).solve(state);
    asked = again;
    if (asked == 0) continue;
    last = again = 0;
    options.progress = Progress([&](const Progress::News& news) {
      count_again(news);
      return again == 0;
    });
    state = VectorXd::Ones(count + 1);
    LevenbergMarquardt solver(curves, options);
    const SolveSummary summary = solver.solve(state);
    CHECK(summary.outcome == Outcome::cancelled);
    CHECK(summary.iterations == last);
    CHECK(again == 1);
    double left = 0;  // the state is the last iteration's
    for (int g = 0; g < count; ++g) {
      Cost cost;
      curves.evaluate(g, state, 0, cost);
      left += cost.doubled;
    }
    CHECK(std::abs(left / summary.cost.doubled - 1) < 1e-12);
  }
  CHECK(asked > 0);
}

TEST_CASE("levenberg-marquardt: a problem that has nothing to do with robots") {
  Curves curves(9);
  VectorXd state = VectorXd::Ones(10);
  LevenbergMarquardt solver(curves, {});
  const SolveSummary summary = solver.solve(state);
  CHECK(summary.outcome == Outcome::converged);
  CHECK(std::abs(state(0) + 0.7) < 1e-9);
  for (int g = 0; g < 9; ++g) CHECK(std::abs(state(1 + g) - (1 + 0.3 * g)) < 1e-9);
  const Observability o = observe(curves, state);
  CHECK(o.rows == 45);
  CHECK(o.rank == 10);
}

}  // namespace solver_test
