// models/rig/geometry.h: which components of joint origins are independent. Against the sets that
// papers and hands have found for real robots, and against the rank of derivatives by differences
// of the fixture's own kinematics, at other postures. Not proved: that the numbers kept are the
// best conditioned ones; they are the first in a fixed order.
#include "../../../models/rig/geometry.h"

#include <Eigen/SVD>
#include <algorithm>
#include <catch2/catch.hpp>

#include "../../../models/rig/parameters.h"
#include "../../../models/rig/selection.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/transforms.h"

namespace geometry_test {

using namespace kincal;
using fixture::add_joint;
using fixture::add_link;
using fixture::at;
using fixture::link_index;

namespace {

constexpr double kHalf = kPi / 2;

/// "joint .x .ry" of every joint, in the order given.
std::vector<std::string> text(const Tree& tree, const std::vector<OriginComponents>& found) {
  static const char* const names[] = {" .x", " .y", " .z", " .rx", " .ry", " .rz"};
  std::vector<std::string> out;
  for (const OriginComponents& o : found) {
    out.push_back(tree.joints[o.joint].name);
    for (int c : o.components) out.back() += names[c];
  }
  return out;
}

std::vector<std::string> geometry(const Rig& rig, const std::string& base, const std::string& tip,
                                  bool base_pose = true, bool tip_pose = true) {
  std::vector<char> has_pose(rig.tree.links.size(), 0);
  has_pose[link_index(rig, base)] = base_pose;
  has_pose[link_index(rig, tip)] = tip_pose;
  return text(rig.tree, independent_geometry(
                            rig.tree, {{link_index(rig, base), link_index(rig, tip)}}, has_pose));
}

struct Row {
  Vector3d xyz, rpy;
  Vector3d axis = Vector3d::UnitZ();
  JointType type = JointType::revolute;
};

/// Links l0, l1, ..., joints j1, j2, ... and a fixed joint to `tool` in the end.
Rig serial(const std::vector<Row>& rows) {
  Rig rig;
  add_link(rig, "l0");
  for (size_t i = 0; i < rows.size(); ++i)
    add_joint(rig, rows[i].type, "j" + std::to_string(i + 1), "l" + std::to_string(i),
              "l" + std::to_string(i + 1), rows[i].axis, at(rows[i].xyz, rows[i].rpy));
  add_joint(rig, JointType::fixed, "flange", "l" + std::to_string(rows.size()), "tool", {1, 0, 0},
            at({0, 0.02, 0.09}, {0.3, 0, 0}));
  finish_tree(rig.tree);
  return rig;
}

const std::vector<Row> kAubo = {{{0, 0, 0}, {0, 0, 0}},
                                {{0, 0, 0.1632}, {kHalf, -kHalf, 0}},
                                {{0.647, 0, 0}, {2 * kHalf, 0, 0}},
                                {{0.6005, 0, 0}, {2 * kHalf, 0, kHalf}},
                                {{0, 0, 0.2013}, {-kHalf, 0, 0}},
                                {{0, 0, 0.1025}, {kHalf, 0, 0}}};
const std::vector<std::string> kAuboSet = {"j2 .y .ry", "j3 .x .y .rx .ry", "j4 .x .y .rx .ry",
                                           "j5 .x .y .rx .ry", "j6 .x .y .rx .ry"};

}  // namespace

TEST_CASE("geometry: the sets of known robots") {
  SECTION("Aubo i10: 18 numbers, three parallel axes") {
    const Rig rig = serial(kAubo);
    CHECK(geometry(rig, "l0", "tool") == kAuboSet);
    CHECK(geometry(rig, "l0", "l6") == kAuboSet);  // a fixed joint has no numbers of its own
  }
  SECTION("Panda: 22 numbers, axes that cross") {
    const Rig rig = serial({{{0, 0, 0.333}, {0, 0, 0}},
                            {{0, 0, 0}, {-kHalf, 0, 0}},
                            {{0, -0.316, 0}, {kHalf, 0, 0}},
                            {{0.0825, 0, 0}, {kHalf, 0, 0}},
                            {{-0.0825, 0.384, 0}, {-kHalf, 0, 0}},
                            {{0, 0, 0}, {kHalf, 0, 0}},
                            {{0.088, 0, 0}, {kHalf, 0, 0}}});
    CHECK(geometry(rig, "l0", "tool") ==
          std::vector<std::string>{"j2 .x .rx", "j3 .x .y .rx .ry", "j4 .x .y .rx .ry",
                                   "j5 .x .y .rx .ry", "j6 .x .y .rx .ry", "j7 .x .y .rx .ry"});
  }
  SECTION("a positioner with two axes: their distance and angle") {
    const Rig rig = serial({{{0, 0, 0}, {0, 0, 0}}, {{0, 0, 0}, {-kHalf, -kHalf, 0}}});
    CHECK(geometry(rig, "l0", "tool") == std::vector<std::string>{"j2 .y .ry"});
  }
  SECTION("a gantry: two angles between three axes, the third's two") {
    const Rig rig = serial({{{0, 0, 0.1}, {0, 0, 0}, {1, 0, 0}, JointType::prismatic},
                            {{0, 0.2, 0}, {0, 0, 0}, {0, 1, 0}, JointType::prismatic},
                            {{0.1, 0, 0}, {0, 0, 0}, {0, 0, -1}, JointType::prismatic}});
    // Of 2 * 3 + 6 the poses at the ends hold 9: translations commute with all three axes. Turning
    // everything is the ends' too.
    const std::vector<std::string> found = geometry(rig, "l0", "tool");
    CHECK(found == std::vector<std::string>{"j2 .rz", "j3 .rx .ry"});
  }
}

TEST_CASE("geometry: the way may be walked from either end") {
  const Rig rig = serial(kAubo);
  std::vector<std::string> up = geometry(rig, "tool", "l0");
  std::sort(up.begin(), up.end());
  CHECK(up == kAuboSet);
}

TEST_CASE("geometry: signs of axes change nothing, rounded angles neither") {
  std::vector<Row> rows = kAubo;
  for (size_t i = 0; i < rows.size(); i += 2) rows[i].axis = -rows[i].axis;
  CHECK(geometry(serial(rows), "l0", "tool") == kAuboSet);
  rows = kAubo;
  rows[1].rpy = {1.57, -1.571, 0};
  rows[2].rpy = {3.14, 0, 0};
  CHECK(geometry(serial(rows), "l0", "tool") == kAuboSet);
}

TEST_CASE("geometry: an end where no pose stands has its six numbers in the set") {
  const Rig rig = serial(kAubo);
  const auto count = [](const std::vector<std::string>& all) {
    long n = 0;
    for (const std::string& s : all) n += std::count(s.begin(), s.end(), '.');
    return n;
  };
  CHECK(count(geometry(rig, "l0", "tool", true, true)) == 18);
  const std::vector<std::string> no_base = geometry(rig, "l0", "tool", false, true),
                                 no_tip = geometry(rig, "l0", "tool", true, false);
  CHECK(count(no_base) == 24);
  CHECK(no_base[0] == "j1 .x .y .rx .ry");
  CHECK(no_base[1] == "j2 .x .y .rx .ry");
  CHECK(count(no_tip) == 24);
  CHECK(no_tip.back() == "flange .x .y .rx .ry");  // z and rz are joint 6's
  CHECK(count(geometry(rig, "l0", "tool", false, false)) == 30);
}

TEST_CASE("geometry: what is kept is independent, and spans everything that origins can do") {
  // By differences of a_T_b, every origin component of every joint of the robot, at postures of our
  // own.
  const Rig rig = fixture::nasty_robot();
  struct Case {
    std::vector<std::pair<std::string, std::string>> chains;
    std::vector<std::string> posed;
  };
  const std::vector<Case> cases = {
      {{{"pole", "tool"}}, {"pole", "tool"}},      // prismatic, oblique, continuous, up and down
      {{{"tool", "wobble"}}, {"tool", "wobble"}},  // two limbs
      {{{"plinth", "nail"}}, {"plinth", "nail"}},  // followers of followers
      {{{"tool", "nail"}}, {"tool"}},              // no pose at the tip
      {{{"torso", "tool"}}, {}},                   // none at all
      {{{"tool", "eye"}, {"wobble", "eye"}, {"table", "wobble"}},
       {"tool", "eye", "wobble", "table"}}};
  fixture::Random random(3);
  for (const Case& c : cases) {
    INFO(c.chains[0].first << ".." << c.chains[0].second);
    std::vector<Chain> chains;
    std::vector<char> has_pose(rig.tree.links.size(), 0);
    for (const auto& chain : c.chains)
      chains.push_back({link_index(rig, chain.first), link_index(rig, chain.second)});
    for (const std::string& link : c.posed) has_pose[link_index(rig, link)] = 1;
    const std::vector<OriginComponents> found = independent_geometry(rig.tree, chains, has_pose);

    std::vector<fixture::TruePosture> postures;
    for (int i = 0; i < 60; ++i)
      postures.push_back(fixture::random_posture(rig, random, 1.5, true));
    // Rows: Log of a_T_b before and after. The moved link's pose on the right, link by link, for
    // ends.
    const auto column = [&](int joint, int link, int k) {
      constexpr double h = 1e-5;
      Vector6d xi = Vector6d::Zero();
      xi(k) = h;
      VectorXd out(static_cast<Eigen::Index>(6 * chains.size() * postures.size()));
      Eigen::Index row = 0;
      for (const fixture::TruePosture& p : postures)
        for (const Chain& chain : chains) {
          const auto relative = [&](double sign) {
            Rig other = rig;
            const fixture::Isometry3d step = fixture::exponential(sign * xi);
            if (joint >= 0) {
              Pose& origin = other.tree.joints[joint].parent_T_joint;
              origin = fixture::to_pose(fixture::isometry(origin) * step);
            }
            fixture::Isometry3d a = fixture::root_T_link(other, chain.base, p),
                                b = fixture::root_T_link(other, chain.tip, p);
            if (link >= 0 && chain.base == link) a = a * step;
            if (link >= 0 && chain.tip == link) b = b * step;
            return fixture::Isometry3d(a.inverse() * b);
          };
          const fixture::Isometry3d plus = relative(1), minus = relative(-1);
          out.segment<3>(row) = (plus.translation() - minus.translation()) / (2 * h);
          out.segment<3>(row + 3) =
              fixture::rotation_vector(plus.linear() * minus.linear().transpose()) / (2 * h);
          row += 6;
        }
      return out;
    };
    std::vector<VectorXd> ends, kept, all;
    for (size_t l = 0; l < has_pose.size(); ++l)
      for (int k = 0; k < 6 && has_pose[l]; ++k) ends.push_back(column(-1, static_cast<int>(l), k));
    for (const OriginComponents& o : found)
      for (int k : o.components) kept.push_back(column(o.joint, -1, k));
    for (size_t j = 0; j < rig.tree.joints.size(); ++j)
      for (int k = 0; k < 6; ++k) all.push_back(column(static_cast<int>(j), -1, k));
    const auto rank = [&](std::vector<VectorXd> columns, const std::vector<VectorXd>& more) {
      columns.insert(columns.end(), more.begin(), more.end());
      columns.erase(std::remove_if(columns.begin(), columns.end(),
                                   [](const VectorXd& v) { return v.norm() < 1e-6; }),
                    columns.end());
      if (columns.empty()) return Eigen::Index(0);
      MatrixXd m(columns[0].size(), static_cast<Eigen::Index>(columns.size()));
      for (size_t i = 0; i < columns.size(); ++i)
        m.col(static_cast<Eigen::Index>(i)) = columns[i].normalized();
      return fixture::dense::svd_rank(m, 1e-6);
    };
    const Eigen::Index of_ends = rank(ends, {}), with_kept = rank(ends, kept);
    CHECK(with_kept == of_ends + static_cast<Eigen::Index>(kept.size()));
    CHECK(rank(ends, all) == with_kept);
  }
}

TEST_CASE("geometry: as the name of parameters") {
  Rig rig = serial(kAubo);
  Eigen::Matrix3Xd point = Eigen::Matrix3Xd::Zero(3, 1);
  fixture::add_points(rig, "reflector", point, "tool", at({0, 0, 0}));
  fixture::add_tracker(rig, "tracker", "l0", at({1, 0, 0}), {0.001, 0.001, 0.001});
  const ParameterTable table(rig);
  const std::vector<Freed> found = table.select("geometry/l0..tool");
  REQUIRE(found.size() == 5);
  CHECK(table.all[found[0].parameter].name == "joint/j2/origin");
  CHECK(found[0].components == std::vector<int>{1, 4});
  CHECK_FALSE(table.is_plain_name("geometry/l0..tool"));
  const auto message = [&](const std::string& pattern) -> std::string {
    CHECK(table.select(pattern).empty());
    try {
      table.find(pattern, "here");
    } catch (const NameError& error) {
      CHECK(error.valid == rig.tree.links);
      return error.what();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "nothing";
  };
  CHECK(message("geometry/l0..tol") == "here: 'geometry/l0..tol': there is no link 'tol'");
  CHECK(message("geometry/lo..tool") == "here: 'geometry/lo..tool': there is no link 'lo'");
  CHECK(
      message("geometry/l0.tool") ==
      "here: 'geometry/l0.tool': geometry/BASE..TIP is expected, two links with two dots between");
  CHECK(message("geometry/l6..tool").find("here: 'geometry/l6..tool' has no number of its own") ==
        0);
}

}  // namespace geometry_test
