// models/automatic/groups: what the automatic path estimates of a rig.
//
// Proves, on small robots: the mounts, names, members and starting widths of the groups of an arm
// with a camera in its hand, of two arms and a head, of joints that stand before the paths part, of
// rectified pairs, sliding joints, tilting lasers and targets of one point; that of
// origins every number but that of the own axis is there, and nothing lacks (by ranks of numeric
// derivatives of the independent forward model); what is left out; groups chosen by names and globs
// and what is said of names that mean none; the rig's own priors. Does not prove: that widths are
// right for real robots, nor anything of estimates (automatic_test.cpp).
#include "../../../models/automatic/groups.h"

#include <Eigen/QR>
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <set>

#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"

namespace groups_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;
using Catch::Matchers::StartsWith;

namespace {

using Names = std::vector<std::string>;

const Vector3d kX{1, 0, 0}, kY{0, 1, 0}, kZ{0, 0, 1};

/// A row of revolute joints from a link on: NAME1, NAME2, ... with links NAME1_link, ...
std::string add_row(Rig& rig, std::string parent, const std::string& name,
                    const std::vector<Vector3d>& axes) {
  for (size_t i = 0; i < axes.size(); ++i) {
    const std::string joint = name + std::to_string(i + 1), child = joint + "_link";
    add_joint(rig, JointType::revolute, joint, parent, child, axes[i],
              at({0.05 + 0.02 * static_cast<double>(i), 0.01, 0.2}), 1e-4);
    parent = child;
  }
  return parent;
}

/// An arm of six joints with a camera in its hand; a board stands on its base.
Rig arm() {
  Rig rig;
  add_link(rig, "base");
  const std::string hand = add_row(rig, "base", "a", {kZ, kY, kY, kX, kY, kX});
  finish_tree(rig.tree);
  add_camera(rig, "eye", hand, at({0, 0, 0.05}), Lens::brown_conrady,
             {-0.1, 0.02, 1e-3, -1e-3, 0.01});
  add_grid(rig, "board", 4, 5, 0.04, "base", at({0.6, 0, 0}));
  return rig;
}

/// A head with a camera, and two arms with a board in each hand; what carries them all is `below`.
Rig two_arms(const std::string& below = "base", Rig rig = {}) {
  if (rig.tree.links.empty()) add_link(rig, "base");
  const std::string head = add_row(rig, below, "head", {kZ, kY}),
                    left = add_row(rig, below, "left", {kZ, kY, kX}),
                    right = add_row(rig, below, "right", {kZ, kY, kX});
  finish_tree(rig.tree);
  add_camera(rig, "eye", head, at({0, 0, 0.05}));
  add_grid(rig, "left_board", 3, 4, 0.03, left, at({0.1, 0, 0}));
  add_grid(rig, "right_board", 3, 4, 0.05, right, at({0.1, 0, 0}));
  return rig;
}

/// Samples in which every sensor sees every target, with numbers that nobody looks at.
/// All numbers measured are the same, and change from sample to sample by a share of them.
std::vector<Sample> seen(const Rig& rig, double measured = 0.5, double change = 0) {
  std::vector<Sample> out;
  Random random(1);
  for (int n = 0; n < 3; ++n) {
    Sample sample = make_sample(rig, random_posture(rig, random, 1, false), std::to_string(n));
    for (size_t t = 0; t < rig.targets.size(); ++t)
      for (size_t s = 0; s < rig.sensors.size(); ++s) {
        View v;
        v.sensor = static_cast<int>(s);
        v.target = static_cast<int>(t);
        v.sigma = rig.sensors[s].sigma;
        v.ids = seen_ids(rig, v);
        v.z.assign(v.ids.size() * rig.sensors[s].model->measurement_size(),
                   measured * (1 + change * n));
        sample.views.push_back(v);
      }
    out.push_back(sample);
  }
  return out;
}

Names names(const Recording& recording, const std::vector<Member>& members) {
  Names out;
  for (const Member& m : members) out.push_back(recording.table.name(m.component));
  std::sort(out.begin(), out.end());
  return out;
}
Names names(const Recording& recording, const std::vector<Freed>& freed) {
  Names out;
  for (const Freed& f : freed)
    for (const int c : f.components) out.push_back(recording.table.name({f.parameter, c}));
  std::sort(out.begin(), out.end());
  return out;
}
/// The names of all components of parameters.
Names whole_poses(const Names& parameters) {
  Names out;
  for (const std::string& p : parameters)
    for (const char* c : {"x", "y", "z", "rx", "ry", "rz"}) out.push_back(p + "." + c);
  std::sort(out.begin(), out.end());
  return out;
}
Names sorted(Names n) {
  std::sort(n.begin(), n.end());
  return n;
}
std::set<std::string> group_names(const AutomaticGroups& groups) {
  std::set<std::string> out;
  for (const WidthGroup& g : groups.groups) CHECK(out.insert(g.name).second);
  return out;
}
const WidthGroup& group(const AutomaticGroups& groups, const std::string& name) {
  for (const WidthGroup& g : groups.groups)
    if (g.name == name) return g;
  FAIL("no group " << name);
  return groups.groups[0];
}
bool all_start(const std::vector<Member>& members, double start) {
  return std::all_of(members.begin(), members.end(),
                     [&](const Member& m) { return std::abs(m.start - start) <= 1e-12 * start; });
}

/// Columns of derivatives of sensor_T_target of every pair in some postures, by components of poses
/// and by offsets.
MatrixXd derivatives(const Rig& rig, const ParameterTable& table,
                     const std::vector<Component>& by) {
  constexpr int kPostures = 30;
  Random random(3);
  std::vector<TruePosture> postures;
  for (int n = 0; n < kPostures; ++n) postures.push_back(random_posture(rig, random, 1.5, false));
  const auto poses = [&](const Rig& r) {
    std::vector<Isometry3d> out;
    for (const TruePosture& p : postures)
      for (size_t s = 0; s < r.sensors.size(); ++s)
        for (size_t t = 0; t < r.targets.size(); ++t)
          out.push_back(sensor_T_target(r, static_cast<int>(s), static_cast<int>(t), p));
    return out;
  };
  const std::vector<Isometry3d> before = poses(rig);
  MatrixXd out(6 * before.size(), by.size());
  for (size_t c = 0; c < by.size(); ++c) {
    const auto twist = [&](double h) {
      VectorXd values = table.initial;
      const Parameter& p = table.all[by[c].parameter];
      if (p.pose) {
        Vector6d xi = Vector6d::Zero();
        xi(by[c].index) = h;
        set_pose(values, p.start, to_pose(isometry(get_pose(values, p.start)) * exponential(xi)));
      } else {
        values(p.start + by[c].index) += h;
      }
      const std::vector<Isometry3d> now = poses(with_values(rig, table, values));
      VectorXd d(6 * now.size());
      for (size_t i = 0; i < now.size(); ++i) {
        const Isometry3d e = before[i].inverse() * now[i];
        d.segment<6>(6 * static_cast<Eigen::Index>(i)) << e.translation(),
            rotation_vector(e.linear());
      }
      return d;
    };
    out.col(static_cast<Eigen::Index>(c)) = derivative(twist, 1e-3);
  }
  return out;
}

long rank(const MatrixXd& m) { return fixture::dense::qr_rank(m, 1e-7); }

/// Checks that with the mounts and offsets nothing of the origins between sensors and targets is
/// missing, and that every origin there has all its numbers but its own axis'.
void check_geometry(const Recording& recording, const AutomaticGroups& groups) {
  const Rig& rig = recording.rig;
  std::vector<Component> members = components_of(groups.mounts), offsets, all = members;
  for (const WidthGroup& g : groups.groups) {
    if (g.name.rfind("lengths/", 0) == 0 || g.name.rfind("angles/", 0) == 0)
      for (const Member& m : g.members) members.push_back(m.component);
    if (g.name == "offsets" || g.name == "slides")
      for (const Member& m : g.members) offsets.push_back(m.component);
  }
  for (size_t j = 0; j < rig.joints.size(); ++j)
    for (int c = 0; c < 6; ++c) all.push_back({recording.table.joint_origin[j], c});
  for (const WidthGroup& g : groups.groups)
    if (g.name.rfind("lengths/", 0) == 0) {
      std::map<int, int> count;  // of lengths and angles, by origin
      for (const WidthGroup& h : groups.groups)
        if (h.name == g.name || h.name == "angles/" + g.name.substr(8))
          for (const std::vector<Member>* of : {&h.members, &h.unseen})
            for (const Member& m : *of) ++count[m.component.parameter];
      for (const auto& entry : count)
        CHECK(entry.second ==
              (rig.tree.joints[recording.table.all[entry.first].owner].moves() ? 5 : 6));
    }
  members.insert(members.end(), offsets.begin(), offsets.end());
  all.insert(all.end(), offsets.begin(), offsets.end());
  CHECK(rank(derivatives(rig, recording.table, members)) ==
        rank(derivatives(rig, recording.table, all)));
}

/// Checks that no origin's member moves along the joint's own axis.
void check_own_axes(const Recording& recording, const AutomaticGroups& groups) {
  const Rig& rig = recording.rig;
  for (const WidthGroup& g : groups.groups)
    for (const std::vector<Member>* members : {&g.members, &g.unseen})
      for (const Member& m : *members) {
        const Parameter& p = recording.table.all[m.component.parameter];
        if (p.kind != ParameterKind::joint_origin) continue;
        INFO(recording.table.name(m.component) << " in " << g.name);
        const int c = m.component.index;
        CHECK((c < 3 ? "lengths/" : "angles/") == g.name.substr(0, g.name.find('/') + 1));
        const Joint& joint = rig.tree.joints[p.owner];
        if ((c < 3) == (joint.type == JointType::prismatic))
          CHECK(std::abs(joint.axis(c % 3)) < 0.5);
      }
}

}  // namespace

TEST_CASE("groups: an arm with a camera in its hand") {
  const Recording recording(arm(), seen(arm()));
  const AutomaticGroups groups = make_groups(recording, {});
  CHECK(names(recording, groups.mounts) == whole_poses({"sensor/eye/pose", "target/board/pose"}));
  CHECK(groups.pointing.empty());
  CHECK(groups.stated.empty());
  CHECK(group_names(groups) == std::set<std::string>{"offsets", "lengths/a1..a6", "angles/a1..a6",
                                                     "sizes", "focal lengths", "centres",
                                                     "distortion"});
  const WidthGroup& offsets = group(groups, "offsets");
  CHECK(names(recording, offsets.members) == Names{"joint/a1/offset", "joint/a2/offset",
                                                   "joint/a3/offset", "joint/a4/offset",
                                                   "joint/a5/offset", "joint/a6/offset"});
  CHECK(all_start(offsets.members, 5e-3));
  const WidthGroup &lengths = group(groups, "lengths/a1..a6"),
                   &angles = group(groups, "angles/a1..a6");
  CHECK(all_start(lengths.members, 1e-3));
  CHECK(all_start(angles.members, 2e-3));
  CHECK(names(recording, group(groups, "sizes").members) == Names{"target/board/square"});
  CHECK(all_start(group(groups, "sizes").members, 0.01 * 0.04));
  CHECK(names(recording, group(groups, "focal lengths").members) ==
        Names{"sensor/eye/intrinsics.fx", "sensor/eye/intrinsics.fy"});
  CHECK(all_start(group(groups, "focal lengths").members, 0.02 * 500));
  CHECK(names(recording, group(groups, "centres").members) ==
        Names{"sensor/eye/intrinsics.cx", "sensor/eye/intrinsics.cy"});
  CHECK(all_start(group(groups, "centres").members, 0.02 * 500));
  const std::vector<Member>& lens = group(groups, "distortion").members;
  REQUIRE(lens.size() == 5);
  CHECK(all_start({lens[0], lens[1], lens[4]}, 0.5));
  CHECK(all_start({lens[2], lens[3]}, 0.001));  // tangential
  for (const WidthGroup& g : groups.groups) CHECK(g.unseen.empty());
  check_geometry(recording, groups);
  check_own_axes(recording, groups);
}

TEST_CASE("groups: each arm and the head is a run of its own") {
  const Recording recording(two_arms(), seen(two_arms()));
  const AutomaticGroups groups = make_groups(recording, {});
  CHECK(names(recording, groups.mounts) ==
        whole_poses({"sensor/eye/pose", "target/left_board/pose", "target/right_board/pose"}));
  CHECK(group_names(groups) ==
        std::set<std::string>{"offsets", "lengths/head1..head2", "angles/head1..head2",
                              "lengths/left1..left3", "angles/left1..left3",
                              "lengths/right1..right3", "angles/right1..right3", "sizes",
                              "focal lengths", "centres"});
  CHECK(group(groups, "offsets").members.size() == 8);
  const WidthGroup& sizes = group(groups, "sizes");
  REQUIRE(names(recording, sizes.members) ==
          Names{"target/left_board/square", "target/right_board/square"});
  CHECK(sizes.members[0].start == Approx(0.01 * 0.03));
  CHECK(sizes.members[1].start == Approx(0.01 * 0.05));
  for (const char* run : {"head1..head2", "left1..left3", "right1..right3"})
    for (const char* kind : {"lengths/", "angles/"})
      for (const std::string& n : names(recording, group(groups, std::string(kind) + run).members))
        CHECK_THAT(n, StartsWith("joint/" + std::string(run).substr(0, 4)));
  check_geometry(recording, groups);
  check_own_axes(recording, groups);
}

TEST_CASE("groups: joints before the paths part are members that no measurement sees") {
  Rig below;
  add_link(below, "base");
  add_joint(below, JointType::prismatic, "lift", "base", "lifted", kZ, at({0, 0, 0.4}), 1e-4);
  add_joint(below, JointType::revolute, "waist", "lifted", "waist", kZ, at({0.1, 0, 0.1}), 1e-4);
  add_joint(below, JointType::revolute, "idle", "waist", "idle", kZ, at({0.1, 0, 0.1}), 1e-4);
  const Rig rig = two_arms("waist", below);
  const Recording recording(rig, seen(rig));
  const AutomaticGroups groups = make_groups(recording, {});
  CHECK(names(recording, group(groups, "offsets").unseen) == Names{"joint/waist/offset"});
  CHECK(group(groups, "offsets").members.size() == 8);
  CHECK(names(recording, group(groups, "slides").unseen) == Names{"joint/lift/offset"});
  CHECK(group(groups, "slides").members.empty());
  CHECK(all_start(group(groups, "slides").unseen, 1e-3));
  const WidthGroup &lengths = group(groups, "lengths/lift..waist"),
                   &angles = group(groups, "angles/lift..waist");
  CHECK(lengths.members.empty());
  CHECK(angles.members.empty());
  CHECK(names(recording, lengths.unseen) ==
        sorted({"joint/lift/origin.x", "joint/lift/origin.y", "joint/waist/origin.x",
                "joint/waist/origin.y", "joint/waist/origin.z"}));
  CHECK(names(recording, angles.unseen) ==
        sorted({"joint/lift/origin.rx", "joint/lift/origin.ry", "joint/lift/origin.rz",
                "joint/waist/origin.rx", "joint/waist/origin.ry"}));
  CHECK(all_start(lengths.unseen, 1e-3));
  CHECK(all_start(angles.unseen, 2e-3));
  for (const WidthGroup& g : groups.groups)
    for (const std::vector<Member>* members : {&g.members, &g.unseen})
      for (const std::string& n : names(recording, *members)) CHECK_THAT(n, !Contains("idle"));
  check_own_axes(recording, groups);

  // A frame there is asked for: its joints are members that no measurement sees, in a run of their
  // own, and the other groups are the same.
  const AutomaticGroups asked = make_groups(recording, {{}, {}, {"idle", "sensor/none"}});
  CHECK(names(recording, group(asked, "offsets").unseen) ==
        sorted({"joint/idle/offset", "joint/waist/offset"}));
  CHECK(names(recording, group(asked, "lengths/idle..idle").unseen) ==
        sorted({"joint/idle/origin.x", "joint/idle/origin.y", "joint/idle/origin.z"}));
  CHECK(names(recording, group(asked, "angles/idle..idle").unseen) ==
        sorted({"joint/idle/origin.rx", "joint/idle/origin.ry"}));
  CHECK(asked.groups.size() == groups.groups.size() + 2);
  for (const WidthGroup& g : groups.groups)
    CHECK(names(recording, group(asked, g.name).members) == names(recording, g.members));
}

TEST_CASE("groups: a rectified pair has one mount") {
  Rig rig;
  add_link(rig, "base");
  const std::string hand = add_row(rig, "base", "a", {kZ, kY, kX});
  add_joint(rig, JointType::fixed, "rig_joint", hand, "optical", kX, at({0.02, 0, 0.1}));
  add_joint(rig, JointType::fixed, "other_joint", hand, "other", kX, at({0.02, 0.2, 0.1}));
  finish_tree(rig.tree);
  add_grid(rig, "board", 4, 5, 0.04, "base", at({0.6, 0, 0}));
  const Pose pose = at({0, 0, 0.01});
  add_camera(rig, "left", "optical", pose);
  SECTION("alone") {
    add_camera(rig, "right", "optical", pose, Lens::pinhole, {}, 0.1);
    const Recording recording(rig, seen(rig));
    const AutomaticGroups groups = make_groups(recording, {});
    CHECK(names(recording, groups.mounts) ==
          whole_poses({"joint/rig_joint/origin", "target/board/pose"}));
    CHECK(names(recording, group(groups, "baselines").members) == Names{"sensor/right/baseline"});
    CHECK(all_start(group(groups, "baselines").members, 2e-3));
    for (const WidthGroup& g : groups.groups)
      for (const std::string& n : names(recording, g.members))
        CHECK_THAT(n, !Contains("rig_joint"));
    check_geometry(recording, groups);
  }
  SECTION("with another camera on its link") {
    add_camera(rig, "right", "optical", pose, Lens::pinhole, {}, 0.1);
    add_camera(rig, "third", "optical", at({0, 0.1, 0}));
    const Recording recording(rig, seen(rig));
    CHECK(names(recording, make_groups(recording, {}).mounts) ==
          whole_poses({"joint/rig_joint/origin", "sensor/third/pose", "target/board/pose"}));
  }
  SECTION("two pairs in turn, one of them on a link that moves") {
    add_camera(rig, "left2", hand, pose);
    add_camera(rig, "right", "optical", pose, Lens::pinhole, {}, 0.1);
    add_camera(rig, "right2", hand, pose, Lens::pinhole, {}, 0.1);
    const Recording recording(rig, seen(rig));
    CHECK(names(recording, make_groups(recording, {}).mounts) ==
          whole_poses({"joint/rig_joint/origin", "sensor/left2/pose", "sensor/right2/pose",
                       "target/board/pose"}));
  }
  SECTION("no pair: another place, or the same baseline") {
    add_camera(rig, "right", "optical", at({0.1, 0, 0.01}), Lens::pinhole, {}, 0.1);
    add_camera(rig, "twin", "optical", pose);
    const Recording recording(rig, seen(rig));
    CHECK(names(recording, make_groups(recording, {}).mounts) ==
          whole_poses(
              {"sensor/left/pose", "sensor/right/pose", "sensor/twin/pose", "target/board/pose"}));
  }
}

TEST_CASE("groups: a joint that slides") {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "turn", "base", "turned", kZ, at({0, 0, 0.1}), 1e-4);
  add_joint(rig, JointType::prismatic, "slide", "turned", "slid", kX, at({0.1, 0, 0.1}), 1e-4);
  add_joint(rig, JointType::revolute, "wrist", "slid", "hand", kY, at({0.1, 0, 0}), 1e-4);
  add_joint(rig, JointType::revolute, "roll", "hand", "tool", kX, at({0.1, 0, 0}), 1e-4);
  finish_tree(rig.tree);
  add_tracker(rig, "tracker", "base", at({1, 0, 0}), {1e-4, 1e-4, 1e-4});
  Eigen::Matrix3Xd marks(3, 3);
  marks << 0, 0.1, 0, 0, 0, 0.1, 0, 0, 0.02;
  add_points(rig, "marks", marks, "tool", at({0, 0, 0.1}));
  const Recording recording(rig, seen(rig));
  GroupChoice choice;
  choice.with = {"gears"};
  const AutomaticGroups groups = make_groups(recording, choice);
  CHECK(group_names(groups) == std::set<std::string>{"offsets", "slides", "gears", "marker points",
                                                     "lengths/turn..roll", "angles/turn..roll"});
  CHECK(names(recording, group(groups, "slides").members) == Names{"joint/slide/offset"});
  CHECK(all_start(group(groups, "slides").members, 1e-3));
  CHECK(names(recording, group(groups, "offsets").members) ==
        Names{"joint/roll/offset", "joint/turn/offset", "joint/wrist/offset"});
  CHECK(names(recording, group(groups, "gears").members) ==
        Names{"joint/roll/scale", "joint/slide/scale", "joint/turn/scale", "joint/wrist/scale"});
  CHECK(all_start(group(groups, "gears").members, 1e-3));
  check_geometry(recording, groups);
  check_own_axes(recording, groups);
}

TEST_CASE("groups: a laser that tilts") {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "scan", "base", "tilted", kY, at({0, 0, 0.6}), 1e-4);
  const std::string hand = add_row(rig, "base", "a", {kZ, kY, kX});
  finish_tree(rig.tree);
  add_laser(rig, "laser", "tilted", at({0.02, 0, 0}), "scan", {1e-3, 1e-3, 5e-3});
  add_grid(rig, "board", 4, 5, 0.04, hand, at({0.1, 0, 0}));
  const Recording recording(rig, seen(rig));
  GroupChoice choice;
  choice.with = {"gears"};
  const AutomaticGroups groups = make_groups(recording, choice);
  CHECK(names(recording, group(groups, "scan scales").members) == Names{"joint/scan/scale"});
  CHECK(all_start(group(groups, "scan scales").members, 0.02));
  CHECK(names(recording, group(groups, "scan offsets").members) == Names{"joint/scan/offset"});
  CHECK(all_start(group(groups, "scan offsets").members, 0.01));
  for (const char* other : {"offsets", "gears"})
    for (const std::string& n : names(recording, group(groups, other).members))
      CHECK_THAT(n, StartsWith("joint/a"));
  CHECK(group_names(make_groups(recording, {})).count("scan scales") == 1);
  check_own_axes(recording, groups);
}

TEST_CASE("groups: scale and offset of the range, where the rig states them") {
  Rig rig;
  add_link(rig, "base");
  const std::string hand = add_row(rig, "base", "a", {kZ, kY, kX});
  finish_tree(rig.tree);
  const int depth = add_tracker(rig, "depth", hand, at({0, 0, 0.1}), {1e-3, 1e-3, 1e-3});
  add_grid(rig, "board", 4, 5, 0.04, "base", at({0.5, 0, 0}));
  const Recording without(rig, seen(rig));
  CHECK(group_names(make_groups(without, {})).count("ranges") == 0);
  rig.sensors[depth].model = make_ranged_point();
  rig.sensors[depth].parameters = range_parameters(1, 0);
  const Recording recording(rig, seen(rig));
  const AutomaticGroups groups = make_groups(recording, {});
  CHECK(names(recording, group(groups, "ranges").members) ==
        Names{"sensor/depth/range_offset", "sensor/depth/range_scale"});
  CHECK(group(groups, "ranges").members[0].start == Approx(0.005));
  CHECK(group(groups, "ranges").members[1].start == Approx(0.005));
}

TEST_CASE("groups: what nothing can turn") {
  Rig rig;
  add_link(rig, "base");
  const std::string hand = add_row(rig, "base", "a", {kZ, kY, kX});
  finish_tree(rig.tree);
  SECTION("a target of one point") {
    add_tracker(rig, "tracker", "base", at({1, 0, 0}), {1e-4, 1e-4, 1e-4});
    add_points(rig, "ball", Vector3d(0, 0, 0), hand, at({0, 0, 0.1}));
    std::vector<Sample> samples = seen(rig);
    for (size_t i = 0; i < samples.size(); ++i) samples[i].views[0].z[i % 3] += 0.1;
    const Recording recording(rig, samples);
    const AutomaticGroups groups = make_groups(recording, {});
    CHECK(names(recording, groups.mounts) ==
          whole_poses({"sensor/tracker/pose", "target/ball/pose"}));
    CHECK(names(recording, groups.pointing) ==
          Names{"target/ball/pose.rx", "target/ball/pose.ry", "target/ball/pose.rz"});
    CHECK(groups.pivots.size() == 1);
  }
  SECTION("points on a line") {
    add_tracker(rig, "tracker", "base", at({1, 0, 0}), {1e-4, 1e-4, 1e-4});
    Eigen::Matrix3Xd rod(3, 3);
    rod << 0, 0.01, 0.02, 0.1, 0.3, 0.5, 0, 0, 0;
    add_points(rig, "rod", rod, hand, at({0, 0, 0.1}));
    std::vector<Sample> samples = seen(rig);
    for (size_t i = 0; i < samples.size(); ++i) samples[i].views[0].z[i % 3] += 0.1;
    const Recording recording(rig, samples);
    const AutomaticGroups groups = make_groups(recording, {});
    CHECK(names(recording, groups.pointing) == Names{"target/rod/pose.ry"});
    CHECK(groups.pivots.empty());
  }
  SECTION("a sensor that sees points at its own origin only") {
    add_tracker(rig, "tip", hand, at({0, 0, 0.1}), {1e-4, 1e-4, 1e-4});
    Eigen::Matrix3Xd dimples(3, 3);
    dimples << 0, 0.1, 0, 0, 0, 0.1, 0, 0, 0.02;
    add_points(rig, "plate", dimples, "base", at({0.5, 0, 0}));
    const Recording recording(rig, seen(rig, 0));
    const AutomaticGroups groups = make_groups(recording, {});
    CHECK(names(recording, groups.mounts) == whole_poses({"sensor/tip/pose", "target/plate/pose"}));
    CHECK(names(recording, groups.pointing) ==
          Names{"sensor/tip/pose.rx", "sensor/tip/pose.ry", "sensor/tip/pose.rz"});
    // A tip that is elsewhere in the sensor's frame, always at the same place, turns nothing
    // either.
    const Recording tip(rig, seen(rig, 0.1));
    const AutomaticGroups beside = make_groups(tip, {});
    CHECK(names(tip, beside.pointing) == names(recording, groups.pointing));
    CHECK((beside.pivots.begin()->second - Vector3d::Constant(0.1)).norm() < 1e-12);
    const Recording elsewhere(rig, seen(rig, 0.1, 1));
    CHECK(names(elsewhere, make_groups(elsewhere, {}).pointing).size() == 1);  // along a line
    // Noise is no spread; a spread of three sigmas tells the rotation.
    for (const auto& [sigmas, fixed] : {std::pair(1.0, 3), std::pair(3.0, 0)}) {
      std::vector<Sample> samples = seen(rig, 0);
      int k = 0;
      for (Sample& sample : samples)
        for (double& z : sample.views[0].z) z += sigmas * 1e-4 * std::cos(7 * k * k + 3 * k), ++k;
      const Recording noisy(rig, samples);
      CHECK(names(noisy, make_groups(noisy, {}).pointing).size() == static_cast<size_t>(fixed));
    }
  }
}

TEST_CASE("groups: only what training samples depend on") {
  Rig rig = two_arms();
  std::vector<Sample> samples = seen(rig);
  for (Sample& s : samples)  // the right board is seen by held-out samples only
    s.views.erase(
        std::remove_if(s.views.begin(), s.views.end(), [](const View& v) { return v.target == 1; }),
        s.views.end());
  samples.push_back(seen(rig)[0]);
  samples.back().train = false;
  const Recording recording(rig, samples);
  const AutomaticGroups groups = make_groups(recording, {});
  CHECK(names(recording, groups.mounts) ==
        whole_poses({"sensor/eye/pose", "target/left_board/pose"}));
  for (const WidthGroup& g : groups.groups)
    for (const std::vector<Member>* members : {&g.members, &g.unseen})
      for (const std::string& n : names(recording, *members)) CHECK_THAT(n, !Contains("right"));
  for (Sample& s : samples) s.train = false;
  CHECK_THROWS_AS(make_groups(Recording(rig, samples), {}), std::invalid_argument);
}

TEST_CASE("groups: chosen by names and globs") {
  const Recording recording(two_arms(), seen(two_arms()));
  const std::set<std::string> usual = group_names(make_groups(recording, {}));
  const auto with = [&](const Names& add, const Names& leave) {
    GroupChoice choice;
    choice.with = add;
    choice.without = leave;
    return group_names(make_groups(recording, choice));
  };
  std::set<std::string> expected = usual;
  CHECK(usual.count("gears") == 0);
  expected.insert("gears");
  CHECK(with({"gears"}, {}) == expected);
  CHECK(with({"g*s"}, {}) == expected);
  CHECK(with({"offsets"}, {}) == usual);  // it is among them anyway
  expected = usual;
  for (const char* run : {"head1..head2", "left1..left3", "right1..right3"})
    expected.erase(std::string("lengths/") + run);
  expected.erase("sizes");
  CHECK(with({}, {"lengths/*", "sizes"}) == expected);
  CHECK(with({}, {"gears"}) == usual);
  CHECK(with({"gears"}, {"gears"}) == usual);
  CHECK_THROWS_WITH(with({"offsets", "nothing"}, {}),
                    StartsWith("group[1]: ") && Contains("'nothing'"));
  CHECK_THROWS_WITH(with({}, {"sizes", "offsets", "length/*"}),
                    StartsWith("no_group[2]: ") && Contains("'length/*'"));
  try {
    with({"gear"}, {});
    FAIL("no error");
  } catch (const NameError& error) {
    CHECK(error.name == "gear");
    std::set<std::string> all = usual;
    for (const char* more :
         {"gears", "compliance", "compliance across", "loads", "prints", "warps"})
      all.insert(more);
    for (const char* joint :  // error curves and ripples may be asked for, too
         {"head1", "head2", "left1", "left2", "left3", "right1", "right2", "right3"})
      for (const char* kind : {"curve/", "ripple/"}) all.insert(std::string(kind) + joint);
    for (const std::string& name : error.valid)  // and couplings to next joints
      if (StartsWith("coupling/").match(name)) all.insert(name);
    CHECK(std::set<std::string>(error.valid.begin(), error.valid.end()) == all);
  }
}

TEST_CASE("groups: numbers that the rig's priors name have their own widths") {
  Rig rig = arm();
  const auto prior = [](const std::string& pattern, double translation, double rotation,
                        bool split) {
    PriorSetting p;
    p.pattern = pattern;
    p.translation = translation;
    p.rotation = rotation;
    p.split = split;
    p.where = "rig.yaml:3: priors";
    return p;
  };
  rig.priors = {prior("joint/a[23]/offset", 0.02, 0.02, false),
                prior("sensor/eye/pose", 0.003, 0.01, true),
                prior("joint/a3/offset", 0.001, 0.001, false),
                prior("target/board/square", 1e-5, 1e-5, false)};
  const Recording recording(rig, seen(rig)), plain(arm(), seen(arm()));
  const AutomaticGroups groups = make_groups(recording, {}), before = make_groups(plain, {});
  CHECK(names(recording, group(groups, "offsets").members) ==
        Names{"joint/a1/offset", "joint/a4/offset", "joint/a5/offset", "joint/a6/offset"});
  CHECK(group_names(groups).count("sizes") == 0);  // nothing is left of it
  CHECK(names(recording, groups.mounts) == names(plain, before.mounts));
  Names expected = whole_poses({"sensor/eye/pose"});
  expected.insert(expected.end(), {"joint/a2/offset", "joint/a3/offset", "target/board/square"});
  CHECK(names(recording, groups.stated) == sorted(expected));
  for (const Member& m : groups.stated) {
    const std::string name = recording.table.name(m.component);
    INFO(name);
    const double width = name == "joint/a2/offset"       ? 0.02
                         : name == "joint/a3/offset"     ? 0.001  // the later prior
                         : name == "target/board/square" ? 1e-5
                         : m.component.index < 3         ? 0.003
                                                         : 0.01;
    CHECK(m.start == width);
  }
  rig.priors = {prior("joint/nobody/offset", 0.02, 0.02, false)};
  CHECK_THROWS_WITH(make_groups(Recording(rig, seen(rig)), {}),
                    StartsWith("rig.yaml:3: priors: 'joint/nobody/offset'"));
}

}  // namespace groups_test
