// models/rig/elasticity.h, and that estimation and frames have joints that bend.
//
// Proves: loads of rods and of inertials are those of masses computed one by one; every derivative
// of an Estimation of the nasty robot with compliances, loads, offsets, scales and origins free,
// column by column, and errors of readings, with stator and rotor; of a frame's pose the same; the
// pose that an Estimation walks to is the Configuration's; without compliance nothing bends; a base
// that moves is an error; a payload adds its own moment to every joint, and samples that carry it
// have derivatives that are right. Does not prove: that robots bend so; the automatic path's choice
// (tests/program/bending_test.py).
#include "../../../models/rig/elasticity.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/analysis/frames.h"
#include "../../../models/rig/configuration.h"
#include "../../fixtures/open_recording.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/stacked.h"
#include "../../fixtures/study.h"

namespace elasticity_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

Rig elastic(Rig rig, bool rotor) {
  rig.base = rig.tree.root;
  rig.elasticity = nominal_elasticity(rig);
  rig.elasticity->rotor = rotor;
  Random random(5);
  for (size_t j = 0; j < rig.tree.joints.size(); ++j)
    if (rig.elasticity->skeleton->index[j] >= 0)
      for (int c = 0; c < 3; ++c) rig.elasticity->compliance[j](c) = random.uniform(-2e-3, 2e-3);
  return rig;
}

struct Bent : OpenRecording {
  Values values;

  explicit Bent(bool rotor) : OpenRecording(elastic(nasty_robot(), rotor)) {
    std::vector<TruePosture> postures;
    samples = nasty_samples(rig, 3, 43, &postures);
    values.shared = table.initial;
    for (size_t s = 0; s < samples.size(); ++s)
      for (const auto& [target, board] : postures[s].boards)
        values.targets[{static_cast<int>(s), target}] = to_pose(board);
  }
};

}  // namespace

TEST_CASE("elasticity: loads of rods and of inertials") {
  Rig rig;
  add_link(rig, "base");
  rig.base = 0;
  const auto at = [](double x) { return Pose{Matrix3d::Identity(), {x, 0, 0}}; };
  add_joint(rig, JointType::revolute, "a", "base", "upper", Vector3d::UnitZ(), at(0.1));
  add_joint(rig, JointType::fixed, "stiff", "upper", "bracket", Vector3d::UnitX(), at(0.2));
  add_joint(rig, JointType::revolute, "b", "bracket", "fore", Vector3d::UnitZ(), at(0.3));
  add_points(rig, "ball", Eigen::Matrix3Xd::Zero(3, 1), "fore", at(0.4));
  finish_tree(rig.tree);
  const Elasticity rods = nominal_elasticity(rig);
  const int a = joint_index(rig, "a"), b = joint_index(rig, "b");
  CHECK(rods.skeleton->bending == std::vector<int>{a, b});
  CHECK(rods.load[b].x() == Approx(0.2));             // 1 kg at 0.2
  CHECK(rods.load[a].x() == Approx(0.25 + 1 * 0.5));  // 1 kg at 0.25, and 1 kg from 0.5 on

  rig.masses.resize(rig.tree.links.size());
  const auto mass = [&](const char* link, double m, double x) {
    rig.masses[link_index(rig, link)] = {m, {x, 0, 0}};
  };
  mass("upper", 2, 0.1);
  mass("bracket", 3, 0.05);
  mass("fore", 4, 0.15);
  const Elasticity masses = nominal_elasticity(rig);
  CHECK(masses.load[b].x() == Approx(4 * 0.15));
  CHECK(masses.load[a].x() == Approx(2 * 0.1 + 3 * 0.25 + 4 * 0.5));

  rig.base = link_index(rig, "fore");
  CHECK_THROWS_WITH(nominal_elasticity(rig), Catch::Contains("joint 'a' moves the base 'fore'"));
}

TEST_CASE("elasticity: a payload adds its moment to the joints that carry it") {
  Rig rig = nasty_robot();
  rig.base = rig.tree.root;
  rig.elasticity = nominal_elasticity(rig);
  rig.payloads = {{"box", link_index(rig, "tool"), 3.5, {0.1, -0.2, 0.3}}};
  for (size_t j = 0; j < rig.joints.size(); ++j)  // (loads are those at a slide's position 0)
    if (rig.tree.joints[j].type == JointType::prismatic) rig.joints[j].offset = 0;
  const ParameterTable table(rig);
  const Readings readings = completed(Readings(rig.tree.joints.size(), kNan));
  Conditions with;
  with.payload = 0;
  const Configuration empty(rig, table, table.initial, readings),
      full(rig, table, table.initial, readings, with);
  const Vector3d centre = full.a_T_b(rig.tree.root, rig.payloads[0].link) * rig.payloads[0].centre;
  int carrying = 0;
  for (const int j : rig.elasticity->skeleton->bending) {
    const Pose root_T_child = full.a_T_b(rig.tree.root, rig.tree.joints[j].child);
    bool carries = false;
    for (int link = rig.payloads[0].link; link != rig.tree.root;
         link = rig.tree.joints[rig.tree.joint_above[link]].parent)
      carries = carries || rig.tree.joint_above[link] == j;
    const Vector3d expected =
        carries ? Vector3d(3.5 * (centre - root_T_child.translation)) : Vector3d::Zero();
    const auto i = static_cast<size_t>(j);
    CHECK((full.bent()->moment[i] - empty.bent()->moment[i] - expected).norm() < 1e-9);
    carrying += carries;
  }
  CHECK(carrying >= 3);
}

TEST_CASE("elasticity: every derivative of an estimation") {
  for (const bool rotor : {false, true}) {
    Bent s(rotor);
    s.rig.payloads = {{"box", link_index(s.rig, "tool"), 3.5, {0.1, -0.2, 0.3}}};
    s.samples[1].conditions.payload = 0;
    EstimationSetup setup;
    setup.noise = NoiseMode::latent;
    setup.sensors = all_sensors(s.rig);
    setup.free =
        freed(s.table, {"joint/*/compliance", "link/*/load", "joint/*/offset", "joint/*/scale",
                        "joint/flange/origin", "joint/shoulder/origin", "joint/tilt/origin"});
    Estimation problem(s, s.training(), setup);
    problem.set_workers(1);
    const VectorXd state = problem.pack(s.values);
    problem.renew(state);
    problem.prepare(state);
    const Stacked analytic = stack(problem, state);
    const MatrixXd numeric = stacked_differences(problem, state, 1e-5);
    for (Eigen::Index k = 0; k < analytic.j.cols(); ++k) {
      INFO("column " << k << " "
                     << (k >= analytic.privates
                             ? problem.column_name(static_cast<int>(k - analytic.privates))
                             : "private")
                     << " rotor " << rotor);
      CHECK((analytic.j.col(k) - numeric.col(k)).norm() <= 1e-6 * numeric.col(k).norm() + 1e-5);
    }
  }
}

TEST_CASE("elasticity: every derivative of a frame") {
  for (const bool rotor : {false, true}) {
    const Bent s(rotor);
    Unknowns unknowns;
    for (const char* name :
         {"joint/*/compliance", "link/*/load", "joint/*/offset", "joint/*/scale", "joint/*/origin"})
      for (const Freed& f : s.table.select(name))
        for (const int c : f.components) unknowns.columns.push_back({f.parameter, c});
    const auto n = static_cast<Eigen::Index>(unknowns.columns.size());
    unknowns.covariance = MatrixXd::Identity(n, n);
    unknowns.undetermined.resize(n, 0);
    const Frame frame{"tool", link_index(s.rig, "tool"), -1};
    const Readings readings = completed(s.samples[0].readings);
    const FrameDerivative d =
        frame_derivative(s.rig, s.table, s.table.initial, unknowns, frame, readings);
    const Pose there = base_T_frame(s.rig, s.table, s.table.initial, frame, readings);
    for (Eigen::Index k = 0; k < n; ++k) {
      const Component& c = unknowns.columns[k];
      const Parameter& p = s.table.all[c.parameter];
      const double h = 1e-6;
      Pose moved[2];
      for (const int side : {0, 1}) {
        VectorXd values = s.table.initial;
        if (p.pose)
          set_pose(values, p.start,
                   get_pose(values, p.start) * exp_se3(Vector6d::Unit(c.index) * (side ? h : -h)));
        else
          values(p.start + c.index) += side ? h : -h;
        moved[side] = base_T_frame(s.rig, s.table, values, frame, readings);
      }
      Vector6d numeric;
      numeric << (moved[1].translation - moved[0].translation) / (2 * h),
          log_so3(moved[1].rotation * there.rotation.transpose()) / (2 * h) -
              log_so3(moved[0].rotation * there.rotation.transpose()) / (2 * h);
      INFO(s.table.name(c) << " rotor " << rotor);
      CHECK((d.by_unknowns.col(k) - numeric).norm() <= 1e-6 * (1 + numeric.norm()));
    }
  }
}

}  // namespace elasticity_test
