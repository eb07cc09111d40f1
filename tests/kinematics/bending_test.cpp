// kinematics/bending.h: joints that bend under weights.
//
// Proves: the equilibrium of a branched tree is one of every joint's moment, which is computed from
// masses that sit somewhere, not from first moments; the motion of a tip by origins, positions,
// loads and compliances is that of differences, joint by joint, with the stator's directions and
// with the rotor's; a robot that would fall over is told. Does not prove: that robots bend so.
#include "../../kinematics/bending.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "../fixtures/random.h"

namespace bending_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// A trunk of a turning joint, a fixed one and a turning one, with two arms: of two turning joints
/// and of one, which slides, and one that turns.
struct Branched {
  Tree tree;
  Skeleton skeleton;
  std::vector<double> mass;      // by joint, of its child
  std::vector<Vector3d> centre;  // in the child's frame
  std::vector<double> position;
  std::vector<Pose> origin;
  std::vector<Vector3d> compliance;
  Vector3d gravity;
  bool rotor = false;

  explicit Branched(unsigned seed) {
    Random random(seed);
    const auto vector = [&](double size) {
      return Vector3d(random.uniform(-size, size), random.uniform(-size, size),
                      random.uniform(-size, size));
    };
    const int parents[] = {0, 1, 2, 3, 4, 3, 6};
    const JointType types[] = {JointType::revolute, JointType::fixed,    JointType::continuous,
                               JointType::revolute, JointType::revolute, JointType::prismatic,
                               JointType::revolute};
    tree.links = {"root"};
    std::vector<char> bends;
    for (int j = 0; j < 7; ++j) {
      Joint joint;
      joint.name = "j" + std::to_string(j);
      joint.type = types[j];
      joint.parent = parents[j];
      joint.child = j + 1;
      joint.axis = vector(1).normalized();
      tree.links.push_back("l" + std::to_string(j + 1));
      tree.joints.push_back(joint);
      origin.push_back({exp_so3(vector(1)), vector(0.4)});
      position.push_back(types[j] == JointType::fixed       ? 0
                         : types[j] == JointType::prismatic ? 0.1
                                                            : random.uniform(-1, 1));
      mass.push_back(random.uniform(1, 5));
      centre.push_back(vector(0.2));
      bends.push_back(types[j] == JointType::revolute || types[j] == JointType::continuous);
      compliance.push_back(bends.back() ? Vector3d(vector(1e-3)) : Vector3d::Zero());
    }
    finish_tree(tree);
    skeleton = Skeleton(tree, bends);
    gravity = 9.81 * vector(1).normalized();
  }
  Pose motion(int j) const { return joint_motion(tree.joints[j], position[j]); }
  /// Poses of all links with these deflections by joint.
  std::vector<Pose> links(const std::vector<Vector3d>& delta) const {
    std::vector<Pose> out(tree.links.size());
    for (int j = 0; j < 7; ++j)
      out[j + 1] =
          out[tree.joints[j].parent] * origin[j] * Pose{exp_so3(delta[j]), {0, 0, 0}} * motion(j);
    return out;
  }
  /// First moments as bending wants them. (Masses behind the sliding joint count where it stands.)
  std::vector<Vector3d> loads() const {
    std::vector<Vector3d> out(7);
    std::vector<double> behind(7);
    for (int j = 6; j >= 0; --j) {
      out[j] = mass[j] * centre[j];
      behind[j] = mass[j];
      for (int k = j + 1; k < 7; ++k)
        if (tree.joints[k].parent == j + 1) {
          Vector3d there = origin[k].translation;
          if (tree.joints[k].type == JointType::prismatic)
            there = origin[k] * motion(k).translation;
          out[j] += behind[k] * there;
          behind[j] += behind[k];
        }
    }
    return out;
  }
  BentPosture posture() const {
    BentPosture at;
    at.resize(skeleton);
    for (int j = 0; j < 7; ++j) {
      at.origin[j] = origin[j].rotation;
      at.motion[j] = motion(j).rotation;
    }
    at.load = loads();
    at.compliance = compliance;
    at.gravity = gravity;
    at.rotor = rotor;
    return at;
  }
  std::vector<Vector3d> deltas(const BentPosture& at) const {
    std::vector<Vector3d> out(7, Vector3d::Zero());
    for (int i = 0; i < skeleton.size(); ++i) out[skeleton.bending[i]] = at.delta[i];
    return out;
  }
  /// The tip of the longer arm at the equilibrium.
  Pose tip(BentPosture at) const {
    REQUIRE(bend(skeleton, at));
    return links(deltas(at))[5];
  }
};

const int kPath[] = {0, 1, 2, 3, 4};  // joints from the root to link 5

}  // namespace

TEST_CASE("bending: moments of masses are in balance with the springs") {
  for (const bool rotor : {false, true}) {
    Branched robot(1);
    robot.rotor = rotor;
    BentPosture at = robot.posture();
    REQUIRE(bend(robot.skeleton, at));
    const std::vector<Vector3d> delta = robot.deltas(at);
    const std::vector<Pose> links = robot.links(delta);
    double largest = 0;
    for (int i = 0; i < robot.skeleton.size(); ++i) {
      const int j = robot.skeleton.bending[i];
      const Pose frame = links[robot.tree.joints[j].parent] * robot.origin[j];
      Vector3d moment = Vector3d::Zero();
      for (int k = j; k < 7; ++k)
        if (robot.skeleton.carries(j, k))
          moment += (links[k + 1] * robot.centre[k] - frame.translation)
                        .cross(robot.mass[k] * robot.gravity);
      Matrix3d basis = axis_basis(robot.tree.joints[j].axis);
      if (rotor) basis = robot.motion(j).rotation * basis;
      const Vector3d expected = basis * robot.compliance[j].asDiagonal() * basis.transpose() *
                                frame.rotation.transpose() * moment;
      CHECK((delta[j] - expected).norm() < 1e-12);
      largest = std::max(largest, delta[j].norm());
    }
    CHECK(largest > 0.01);  // far from the rigid posture
  }
}

TEST_CASE("bending: derivatives of a tip, joint by joint") {
  for (const bool rotor : {false, true})
    for (unsigned seed : {1u, 2u}) {
      Branched robot(seed);
      robot.rotor = rotor;
      BentPosture at = robot.posture();
      REQUIRE(bend(robot.skeleton, at));
      const std::vector<Pose> links = robot.links(robot.deltas(at));
      differentiate(robot.skeleton, at);
      const auto frame_of = [&](int j) {
        return links[robot.tree.joints[j].parent] * robot.origin[j];
      };
      MatrixXd by_delta = MatrixXd::Zero(6, 3 * robot.skeleton.size());
      for (const int j : kPath)
        if (const int i = robot.skeleton.index[j]; i >= 0)
          by_delta.middleCols<3>(3 * i) = deflection_twists(at, i, 1, frame_of(j));
      BendingColumns through;
      through_equilibrium(at, by_delta, through);
      const Pose tip = robot.tip(at);
      const auto numeric = [&](auto change) {  // twist seen from the root
        constexpr double h = 1e-5;
        Pose moved[2];
        for (const int side : {0, 1}) {
          Branched other = robot;
          BentPosture posture = robot.posture();
          change(other, posture, side ? h : -h);
          moved[side] = other.tip(posture);
        }
        return Vector6d((log_se3(moved[1] * inverse(tip)) - log_se3(moved[0] * inverse(tip))) /
                        (2 * h));
      };
      const auto on_path = [](int j) {
        return std::count(std::begin(kPath), std::end(kPath), j) > 0;
      };
      for (int j = 0; j < 7; ++j)
        for (int c = 0; c < 3; ++c) {
          INFO("joint " << j << " component " << c << " seed " << seed << " rotor " << rotor);
          const Vector3d unit = Vector3d::Unit(c);
          const auto check = [&](const VectorXd& analytic, const Vector6d& expected) {
            CHECK((analytic - expected).norm() < 1e-7 * (1 + expected.norm()));
          };
          const Vector6d by_load =
              numeric([&](Branched&, BentPosture& p, double h) { p.load[j] += h * unit; });
          check(bent_by_load(robot.skeleton, at, through, j).col(c), by_load);
          VectorXd direct = VectorXd::Zero(6);
          if (on_path(j)) direct = adjoint(frame_of(j)).col(3 + c);
          check(direct + bent_by_origin(robot.skeleton, at, through, j).col(c),
                numeric([&](Branched& b, BentPosture& p, double h) {
                  b.origin[j].rotation = b.origin[j].rotation * exp_so3(h * unit);
                  p.origin[j] = b.origin[j].rotation;
                }));
          const int i = robot.skeleton.index[j];
          if (i < 0) continue;
          check(bent_by_compliance(robot.skeleton, at, through, j).col(c),
                numeric([&](Branched&, BentPosture& p, double h) {
                  p.compliance[j](c) += 1e-3 * h;
                }) * 1e3);
          direct.setZero();
          Pose bent = frame_of(j);
          bent.rotation = bent.rotation * at.bend[i];
          if (on_path(j)) direct = position_twist(robot.tree.joints[j], 1, bent);
          check(
              direct + bent_by_position(robot.skeleton, at, through, j, robot.tree.joints[j].axis),
              numeric([&](Branched& b, BentPosture& p, double h) {
                b.position[j] += h;
                p.motion[j] = b.motion(j).rotation;
              }));
        }
    }
}

TEST_CASE("bending: springs that give way have no equilibrium") {
  Branched robot(1);
  for (Vector3d& c : robot.compliance) c *= 1e4;
  BentPosture at = robot.posture();
  CHECK_FALSE(bend(robot.skeleton, at));
}

}  // namespace bending_test
