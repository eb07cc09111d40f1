// kinematics/tree.h: structure, paths, mimics and the derivatives along a path.
//
// Proves: a path multiplied up equals inverse(root_T_a) root_T_b for every two links of a tree with
// every kind of joint; what follows a joint that does not move stands still; what lies above the
// common ancestor is not touched; the twists by position and by origin agree entry by entry with
// central differences, up and down; malformed structures are refused by name. Does not prove: that
// link_poses means what a URDF means; that is proved against urdfdom in io/urdf/urdf_test.cpp.
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <stdexcept>

#include "../../kinematics/tree.h"

namespace tree_test {

using namespace kincal;
using Catch::Matchers::Contains;

namespace {

constexpr double kStep = 1e-5;

int add_link(Tree& tree, const std::string& name) {
  tree.links.push_back(name);
  return static_cast<int>(tree.links.size()) - 1;
}

/// Adds a joint "<child>_joint" and its child link.
Joint& add_joint(Tree& tree, JointType type, const std::string& parent, const std::string& child,
                 const Vector3d& axis, const Vector3d& xyz, const Vector3d& rpy) {
  Joint joint;
  joint.name = child + "_joint";
  joint.type = type;
  joint.parent = tree.find_link(parent);
  joint.child = add_link(tree, child);
  joint.axis = axis.normalized();
  joint.parent_T_joint = {rotation_from_rpy(rpy), xyz};
  tree.joints.push_back(joint);
  return tree.joints.back();
}

/// base - shoulder - elbow - slide - wheel - tip         (revolute, revolute oblique, prismatic
/// negative, continuous, fixed)
///             |        \- finger - nail             (mimics elbow by -0.5; mimics finger,
///             prismatic)
///             \- head - eye                             (revolute about -z, fixed)
///  base - float - above                                 (floating, revolute)
Tree make_tree() {
  Tree tree;
  add_link(tree, "base");
  add_joint(tree, JointType::revolute, "base", "shoulder", {0, 0, 1}, {0.1, 0.2, 0.7},
            {0.3, -0.2, 1.1});
  add_joint(tree, JointType::revolute, "shoulder", "elbow", {1, -2, 0.5}, {0.5, 0, 0.1},
            {-1.2, 0.4, 2.0});
  add_joint(tree, JointType::prismatic, "elbow", "slide", {-1, 0, 0}, {0, 0.3, 0},
            {0, 1.5707963267948966, 0});
  add_joint(tree, JointType::continuous, "slide", "wheel", {0.3, 0.3, -0.9}, {0, 0, -0.2},
            {3, 0, 0.1});
  add_joint(tree, JointType::fixed, "wheel", "tip", {0, 1, 0}, {0.05, 0.06, 0.07}, {0.7, 0.8, 0.9});
  add_joint(tree, JointType::revolute, "elbow", "finger", {0, -1, 0}, {0.02, 0, 0.1}, {0, 0, 1})
      .mimic = Mimic{1, -0.5, 0.1};
  add_joint(tree, JointType::prismatic, "finger", "nail", {0, 0.6, 0.8}, {0.01, 0, 0}, {1, 0, 0})
      .mimic = Mimic{5, 0.2, -0.03};
  add_joint(tree, JointType::revolute, "shoulder", "head", {0, 0, -1}, {0, 0, 0.4}, {0, -0.5, 0});
  add_joint(tree, JointType::fixed, "head", "eye", {1, 0, 0}, {0.1, 0, 0}, {-1.57, 0, -1.57});
  add_joint(tree, JointType::floating, "base", "float", {1, 0, 0}, {1, 2, 3}, {0.1, 0.2, 0.3});
  add_joint(tree, JointType::revolute, "float", "above", {0, 1, 0}, {0, 0, 1}, {0, 0, 0.2});
  finish_tree(tree);
  return tree;
}

std::vector<Pose> origins_of(const Tree& tree) {
  std::vector<Pose> origins;
  for (const Joint& joint : tree.joints) origins.push_back(joint.parent_T_joint);
  return origins;
}

/// Positions of all joints, followers included.
std::vector<double> random_positions(const Tree& tree, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::vector<double> positions;
  for (const Joint& joint : tree.joints) {
    const double u = static_cast<double>(engine() >> 11) * 0x1p-53;
    positions.push_back(joint.moves() ? 4 * u - 2 : 0);
  }
  follow_mimics(tree, positions);
  return positions;
}

/// a_T_b along a path, and the frame of each joint before its motion.
Pose walk_path(const Tree& tree, const Path& path, const std::vector<Pose>& origins,
               const std::vector<double>& positions, std::vector<Pose>* joint_frames = nullptr) {
  Pose here;
  for (const PathStep& step : path) {
    Pose a_T_joint, there;
    walk(step, origins[step.joint], joint_motion(tree.joints[step.joint], positions[step.joint]),
         here, a_T_joint, there);
    if (joint_frames) joint_frames->push_back(a_T_joint);
    here = there;
  }
  return here;
}

double largest_difference(const Pose& a, const Pose& b) {
  return std::max((a.rotation - b.rotation).cwiseAbs().maxCoeff(),
                  (a.translation - b.translation).cwiseAbs().maxCoeff());
}

/// The twist per unit between two poses 2 kStep apart, as seen from a.
Vector6d central_difference(const Pose& plus, const Pose& minus) {
  return log_se3(plus * inverse(minus)) / (2 * kStep);
}

void check_entries(const Vector6d& analytic, const Vector6d& numeric) {
  for (int i = 0; i < 6; ++i) {
    INFO("entry " << i << ": " << analytic(i) << " against " << numeric(i));
    CHECK(std::abs(analytic(i) - numeric(i)) < 1e-9);
  }
}

bool floats(const Tree& tree, int link) {
  const std::string& name = tree.links[link];
  return name == "float" || name == "above";
}

/// Calls `check` with every path that can be walked.
template <class Check>
void for_all_paths(const Tree& tree, const Check& check) {
  const int links = static_cast<int>(tree.links.size());
  for (int a = 0; a < links; ++a)
    for (int b = 0; b < links; ++b)
      if (floats(tree, a) == floats(tree, b) && !(floats(tree, a) && a == b)) {
        INFO(tree.links[a] << " -> " << tree.links[b]);
        check(a, b, find_path(tree, a, b));
      }
}

}  // namespace

TEST_CASE("names are found") {
  const Tree tree = make_tree();
  CHECK(tree.links[tree.root] == "base");
  CHECK(tree.find_link("eye") == 9);
  CHECK(tree.find_link("eye_joint") == -1);
  CHECK(tree.find_joint("eye_joint") == 8);
  CHECK(tree.find_joint("eye") == -1);
  CHECK(tree.joint_above[tree.root] == -1);
  CHECK(tree.joint_above[tree.find_link("tip")] == tree.find_joint("tip_joint"));
}

TEST_CASE("a path between any two links equals the way over the root") {
  const Tree tree = make_tree();
  const std::vector<Pose> origins = origins_of(tree);
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const std::vector<double> positions = random_positions(tree, seed);
    const std::vector<Pose> root_T_link = link_poses(tree, origins, positions);
    CHECK(largest_difference(root_T_link[tree.root], Pose{}) == 0);
    for_all_paths(tree, [&](int a, int b, const Path& path) {
      CHECK(largest_difference(walk_path(tree, path, origins, positions),
                               inverse(root_T_link[a]) * root_T_link[b]) < 5e-15);
    });
  }
}

TEST_CASE("link poses put a link where its joints say, computed by hand") {
  Tree tree;
  add_link(tree, "base");
  const double half_pi = std::acos(0.0);
  add_joint(tree, JointType::revolute, "base", "a", {0, 0, -1}, {1, 0, 0}, {0, 0, 0});
  add_joint(tree, JointType::prismatic, "a", "b", {0, 1, 0}, {0, 0, 2}, {half_pi, 0, 0});
  finish_tree(tree);
  // A quarter turn about -z takes x to -y; b slides along a's z (its y after the roll): 0.5 up.
  const std::vector<Pose> poses = link_poses(tree, origins_of(tree), {half_pi, 0.5});
  CHECK((poses[1].rotation * Vector3d::UnitX() + Vector3d::UnitY()).norm() < 1e-15);
  CHECK((poses[2].translation - Vector3d(1, 0, 2.5)).norm() < 1e-15);
}

TEST_CASE("what lies above the common ancestor is not walked") {
  const Tree tree = make_tree();
  const Path path = find_path(tree, tree.find_link("eye"), tree.find_link("finger"));
  std::vector<std::pair<std::string, int>> steps;
  for (const PathStep& step : path)
    steps.emplace_back(tree.joints[step.joint].name, step.direction);
  CHECK(steps ==
        std::vector<std::pair<std::string, int>>{
            {"eye_joint", -1}, {"head_joint", -1}, {"elbow_joint", 1}, {"finger_joint", 1}});
  CHECK(find_path(tree, 3, 3).empty());
}

TEST_CASE("twists by position agree with central differences, up and down") {
  const Tree tree = make_tree();
  const std::vector<Pose> origins = origins_of(tree);
  const std::vector<double> positions = random_positions(tree, 6);
  int ups = 0, downs = 0;
  for_all_paths(tree, [&](int, int, const Path& path) {
    std::vector<Pose> frames;
    walk_path(tree, path, origins, positions, &frames);
    for (size_t i = 0; i < path.size(); ++i) {
      const int j = path[i].joint;
      if (!tree.joints[j].moves()) continue;
      INFO(tree.joints[j].name << ", direction " << path[i].direction);
      std::vector<double> plus = positions, minus = positions;  // this joint alone: followers stay
      plus[j] += kStep, minus[j] -= kStep;
      check_entries(position_twist(tree.joints[j], path[i].direction, frames[i]),
                    central_difference(walk_path(tree, path, origins, plus),
                                       walk_path(tree, path, origins, minus)));
      ++(path[i].direction > 0 ? downs : ups);
    }
  });
  CHECK(ups > 20);
  CHECK(downs > 20);
}

TEST_CASE("twists by a joint with followers agree with central differences") {
  const Tree tree = make_tree();
  const std::vector<Pose> origins = origins_of(tree);
  const std::vector<double> positions = random_positions(tree, 7);
  for_all_paths(tree, [&](int, int, const Path& path) {
    std::vector<Pose> frames;
    walk_path(tree, path, origins, positions, &frames);
    for (size_t master = 0; master < tree.joints.size(); ++master) {
      if (!tree.joints[master].has_reading()) continue;
      INFO(tree.joints[master].name);
      Vector6d twist = Vector6d::Zero();
      for (size_t i = 0; i < path.size(); ++i) {
        const Driver d = driver(tree, path[i].joint);
        if (d.joint == static_cast<int>(master) && tree.joints[path[i].joint].moves())
          twist +=
              d.factor * position_twist(tree.joints[path[i].joint], path[i].direction, frames[i]);
      }
      std::vector<double> plus = positions, minus = positions;
      plus[master] += kStep, minus[master] -= kStep;
      follow_mimics(tree, plus), follow_mimics(tree, minus);
      check_entries(twist, central_difference(walk_path(tree, path, origins, plus),
                                              walk_path(tree, path, origins, minus)));
    }
  });
}

TEST_CASE("twists by an origin's increment agree with central differences, up and down") {
  const Tree tree = make_tree();
  const std::vector<Pose> origins = origins_of(tree);
  const std::vector<double> positions = random_positions(tree, 8);
  for_all_paths(tree, [&](int, int, const Path& path) {
    std::vector<Pose> frames;
    walk_path(tree, path, origins, positions, &frames);
    for (size_t i = 0; i < path.size(); ++i) {
      const int j = path[i].joint;
      // Down, the increment acts in the joint's frame before its motion; up, in the same frame.
      const Matrix6d analytic = path[i].direction * adjoint(frames[i]);
      for (int k = 0; k < 6; ++k) {
        INFO(tree.joints[j].name << ", direction " << path[i].direction << ", increment " << k);
        std::vector<Pose> plus = origins, minus = origins;
        plus[j] = origins[j] * exp_se3(kStep * Vector6d::Unit(k));
        minus[j] = origins[j] * exp_se3(-kStep * Vector6d::Unit(k));
        check_entries(analytic.col(k), central_difference(walk_path(tree, path, plus, positions),
                                                          walk_path(tree, path, minus, positions)));
      }
    }
  });
}

TEST_CASE("mimics follow through chains") {
  const Tree tree = make_tree();
  std::vector<double> positions(tree.joints.size(), 0);
  positions[1] = 0.8;
  positions[5] = 99;  // overwritten
  follow_mimics(tree, positions);
  CHECK(positions[1] == 0.8);
  CHECK(positions[5] == Approx(-0.5 * 0.8 + 0.1));
  CHECK(positions[6] == Approx(0.2 * positions[5] - 0.03));
  CHECK(driver(tree, 6).joint == 1);
  CHECK(driver(tree, 6).factor == Approx(-0.1));
  CHECK(driver(tree, 3).joint == 3);
  CHECK(driver(tree, 3).factor == 1);
  CHECK_FALSE(tree.joints[5].has_reading());
}

TEST_CASE("a follower of what does not move stands still") {
  for (const char* master : {"tip_joint", "float_joint"})
    for (const JointType type : {JointType::fixed, JointType::floating, JointType::planar}) {
      Tree tree = make_tree();
      const int leader = tree.find_joint(master);
      tree.joints[leader].type = type;
      add_joint(tree, JointType::revolute, "head", "claw", {0, 3, 4}, {0.1, 0, 0}, {0, 0, 1})
          .mimic = Mimic{leader, -0.5, 0.3};
      const int claw = tree.find_joint("claw_joint");
      add_joint(tree, JointType::prismatic, "claw", "thumb", {0, 0, 1}, {0, 0, 0.1}, {1, 0, 0})
          .mimic = Mimic{claw, 2, 0.05};
      const int thumb = tree.find_joint("thumb_joint");
      finish_tree(tree);
      INFO(master << " of type " << static_cast<int>(type));
      for (const int j : {claw, thumb}) {
        CHECK_FALSE(tree.joints[j].moves());
        CHECK_FALSE(tree.joints[j].drives());
        CHECK_FALSE(tree.joints[j].has_reading());
      }
      for (const double position : {0.0, -3.0, std::nan("")}) {  // wherever it is asked for
        const Pose turned = joint_motion(tree.joints[claw], position),
                   slid = joint_motion(tree.joints[thumb], position);
        CHECK(turned.rotation == rotation_about(Vector3d(0, 0.6, 0.8), 0.3));
        CHECK(turned.translation == Vector3d::Zero());
        CHECK(slid.translation == Vector3d(0, 0, 2 * 0.3 + 0.05));
      }
      // Once the leader moves, so do they.
      tree.joints[leader].type = JointType::revolute;
      finish_tree(tree);
      CHECK(tree.joints[claw].moves());
      CHECK(tree.joints[thumb].moves());
      CHECK(joint_motion(tree.joints[thumb], 0.2).translation == Vector3d(0, 0, 0.2));
    }
}

TEST_CASE("a floating or planar joint on a path is named, off the path it does not matter") {
  Tree tree = make_tree();
  const int base = tree.find_link("base"), above = tree.find_link("above"),
            floating = tree.find_link("float");
  CHECK_THROWS_WITH(find_path(tree, base, above),
                    Contains("'float_joint'") && Contains("floating"));
  CHECK_THROWS_AS(find_path(tree, above, tree.find_link("tip")), std::invalid_argument);
  CHECK(find_path(tree, floating, above).size() == 1);
  CHECK(find_path(tree, tree.find_link("eye"), tree.find_link("tip")).size() == 6);
  tree.joints[tree.find_joint("float_joint")].type = JointType::planar;
  CHECK_THROWS_WITH(find_path(tree, above, base), Contains("'float_joint'") && Contains("planar"));
}

TEST_CASE("malformed structures are refused by name") {
  const Vector3d z = Vector3d::UnitZ(), zero = Vector3d::Zero();
  Tree tree;
  SECTION("no links") { CHECK_THROWS_WITH(finish_tree(tree), Contains("no links")); }
  SECTION("two roots") {
    add_link(tree, "left");
    add_link(tree, "right");
    CHECK_THROWS_WITH(finish_tree(tree),
                      Contains("'left'") && Contains("'right'") && Contains("root"));
  }
  SECTION("two parents") {
    add_link(tree, "base");
    add_joint(tree, JointType::fixed, "base", "a", z, zero, zero);
    Joint second = tree.joints[0];
    second.name = "second";
    tree.joints.push_back(second);
    CHECK_THROWS_WITH(finish_tree(tree),
                      Contains("'a'") && Contains("'a_joint'") && Contains("'second'"));
  }
  SECTION("a loop") {
    add_link(tree, "base");
    add_joint(tree, JointType::fixed, "base", "a", z, zero, zero);
    add_joint(tree, JointType::fixed, "a", "b", z, zero, zero);
    tree.joints[0].parent = tree.find_link("b");
    tree.links.erase(tree.links.begin());  // no root is left
    for (Joint& joint : tree.joints) --joint.parent, --joint.child;
    CHECK_THROWS_WITH(finish_tree(tree), Contains("loop") && Contains("'a'"));
  }
  SECTION("a loop detached from the root") {
    add_link(tree, "base");
    add_joint(tree, JointType::fixed, "base", "a", z, zero, zero);
    add_joint(tree, JointType::fixed, "a", "b", z, zero, zero);
    tree.joints[0].parent = tree.find_link("b");
    CHECK_THROWS_WITH(finish_tree(tree), Contains("loop") && Contains("'a'"));
  }
  SECTION("a joint under its own child") {
    add_link(tree, "base");
    add_joint(tree, JointType::fixed, "base", "a", z, zero, zero).parent = 1;
    CHECK_THROWS_WITH(finish_tree(tree), Contains("loop") && Contains("'a'"));
  }
  SECTION("mimics in a ring") {
    add_link(tree, "base");
    add_joint(tree, JointType::revolute, "base", "a", z, zero, zero).mimic = Mimic{1, 1, 0};
    add_joint(tree, JointType::revolute, "a", "b", z, zero, zero).mimic = Mimic{0, 1, 0};
    CHECK_THROWS_WITH(finish_tree(tree), Contains("mimics itself") && Contains("'a_joint'"));
  }
  SECTION("a joint that mimics itself") {
    add_link(tree, "base");
    add_joint(tree, JointType::revolute, "base", "a", z, zero, zero).mimic = Mimic{0, 1, 0};
    CHECK_THROWS_WITH(finish_tree(tree), Contains("mimics itself"));
  }
}

}  // namespace tree_test
