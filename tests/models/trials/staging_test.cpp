// models/trials/staging.h: a simulated arm with a tracker, three of whose groups are wrong in turn.
// What is wrong is kept and comes out right, what is right is not kept; the order of samples and
// what is held out change nothing. Not proved: that the thresholds are the best ones; the sets of
// real robots in staging_test.py show that they serve.
#include "../../../models/trials/staging.h"

#include <algorithm>
#include <catch2/catch.hpp>

#include "../../../models/calibration/calibration.h"
#include "../../../models/rig/parameters.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/transforms.h"

using namespace kincal;
using fixture::add_joint;
using fixture::add_link;
using fixture::at;

namespace {

/// Four joints; a tracker on a fixed base sees three reflectors on the flange; another on the same
/// base sees one on the elbow.
Rig arm() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "j1", "base", "l1", {0, 0, 1}, at({0, 0, 0.2}), 0.0001);
  add_joint(rig, JointType::revolute, "j2", "l1", "l2", {0, 1, 0}, at({0, 0.05, 0.1}), 0.0001);
  add_joint(rig, JointType::revolute, "j3", "l2", "l3", {0, 1, 0}, at({0, 0, 0.4}), 0.0001);
  add_joint(rig, JointType::revolute, "j4", "l3", "l4", {1, 0, 0}, at({0.3, 0, 0}), 0.0001);
  add_joint(rig, JointType::fixed, "flange_joint", "l4", "flange", {1, 0, 0}, at({0.08, 0, 0}));
  finish_tree(rig.tree);
  for (Joint& joint : rig.tree.joints)
    if (joint.has_reading()) joint.lower = -2, joint.upper = 2;
  Eigen::Matrix3Xd marks(3, 3);
  marks << 0, 0.1, 0, 0, 0, 0.12, 0.05, 0.06, 0.04;
  fixture::add_points(rig, "marks", marks, "flange", at({0.01, 0.02, 0.03}));
  fixture::add_tracker(rig, "tracker", "base", at({2, 1, 0.5}, {0.1, 0.2, 2.5}),
                       {0.0001, 0.0001, 0.0001});
  return rig;
}

std::vector<Sample> samples_of(const Rig& rig,
                               const std::vector<std::pair<std::string, double>>& wrong, int count,
                               std::uint64_t seed) {
  const ParameterTable table(rig);
  VectorXd truth = table.initial;
  for (const auto& w : wrong)
    for (const Freed& f : table.find(w.first, "test")) {
      const Parameter& p = table.all[f.parameter];
      for (int c : f.components) {
        Vector6d xi = Vector6d::Zero();
        if (p.pose)
          xi(c) = w.second, set_pose(truth, p.start, get_pose(truth, p.start) * exp_se3(xi));
        if (!p.pose) truth(p.start + c) += w.second;
      }
    }
  SimulationOptions options;
  options.seed = seed;
  options.samples = count;
  return simulate(rig, table, truth, options).samples;
}

/// Names of the groups that are freed in the end.
std::vector<std::string> kept(const Staging& staging) {
  std::vector<std::string> out;
  for (const Step& step : staging.steps) out.push_back(step.name);
  return out;
}

const StagingTrial& trial(const Staging& staging, const std::string& group) {
  for (const StagingTrial& t : staging.trials)
    if (t.group == group && !t.removal) return t;
  throw std::logic_error("no trial of " + group);
}

}  // namespace

TEST_CASE("staging: keeps what was wrong and not what was right") {
  const Rig rig = arm();
  SECTION("nothing is wrong") {
    const Staging s = *stage(rig, samples_of(rig, {}, 40, 1), {});
    CHECK(kept(s) == std::vector<std::string>{"mounts"});
    CHECK(s.folds == 5);
    CHECK(s.units == 40);
    CHECK_FALSE(s.by_target);
    CHECK(s.trials.size() == 4);  // mounts, offsets, geometry, scales: each tried once
    for (const StagingTrial& t : s.trials)
      CHECK(t.error_after == Approx(1).margin(0.25));  // in sigmas
  }
  SECTION("mounts") {
    const Staging s = *stage(
        rig,
        samples_of(rig, {{"sensor/tracker/pose.x", 0.02}, {"target/marks/pose.rz", 0.03}}, 40, 2),
        {});
    CHECK(kept(s) == std::vector<std::string>{"mounts"});
    CHECK(trial(s, "mounts").error_before > 20);
    CHECK(trial(s, "mounts").error_after < 1.25);
  }
  SECTION("an offset") {
    const Staging s = *stage(rig, samples_of(rig, {{"joint/j3/offset", 0.01}}, 40, 3), {});
    CHECK(kept(s) == std::vector<std::string>{"mounts", "joint offsets"});
    // Those of the first and last joint are the tracker's and the marks' own.
    CHECK(trial(s, "joint offsets").parameters ==
          std::vector<std::string>{"joint/j2/offset", "joint/j3/offset"});
    CHECK_FALSE(trial(s, "gear scales").kept);
    CHECK_FALSE(trial(s, "geometry/base..flange").kept);
  }
  SECTION("an axis") {
    const Staging s = *stage(rig, samples_of(rig, {{"joint/j3/origin.rx", 0.004}}, 40, 4), {});
    CHECK(kept(s).back() == "geometry/base..flange");
    CHECK_FALSE(trial(s, "gear scales").kept);
    const Step& last = s.steps.back();
    CHECK(std::count(last.free.begin(), last.free.end(), "geometry/base..flange") == 1);
    for (const std::string& name : last.free)
      CHECK(name.find("offset") == std::string::npos);  // contained in the geometry
  }
  SECTION("a gear") {
    const Staging s = *stage(rig, samples_of(rig, {{"joint/j2/scale", 0.004}}, 40, 5), {});
    // Offsets and geometry lower the error before the scales are tried; with these they are not
    // needed any more.
    CHECK(kept(s) == std::vector<std::string>{"mounts", "gear scales"});
  }
}

TEST_CASE("staging: its steps run and find the truth") {
  Rig rig = arm();
  const std::vector<Sample> samples =
      samples_of(rig, {{"joint/j2/offset", -0.008}, {"joint/j3/offset", 0.01}}, 40, 6);
  const Staging s = *stage(rig, samples, {});
  rig.steps = s.steps;
  const Solution result = calibrate(make_recording(rig, samples), {});
  CHECK(result.status == Status::converged);
  for (const ParameterEstimate& e : result.parameters) {
    if (e.name == "joint/j2/offset") CHECK(std::abs(e.value[0] + 0.008) < 4 * e.sigma[0]);
    if (e.name == "joint/j3/offset") CHECK(std::abs(e.value[0] - 0.01) < 4 * e.sigma[0]);
  }
  CHECK(result.chi2 / static_cast<double>(result.dof) < 1.25);
}

TEST_CASE("staging: held-out samples are not looked at, and the order does not matter") {
  const Rig rig = arm();
  std::vector<Sample> samples = samples_of(rig, {{"joint/j3/offset", 0.01}}, 30, 7);
  const auto same = [](const Staging& a, const Staging& b) {
    REQUIRE(a.trials.size() == b.trials.size());
    for (size_t i = 0; i < a.trials.size(); ++i) {
      CHECK(a.trials[i].group == b.trials[i].group);
      CHECK(a.trials[i].kept == b.trials[i].kept);
      CHECK(a.trials[i].error_after == b.trials[i].error_after);  // to the last bit
    }
    CHECK(kept(a) == kept(b));
  };
  const Staging plain = *stage(rig, samples, {});
  std::vector<Sample> turned(samples.rbegin(), samples.rend());
  same(plain, *stage(rig, turned, {}));
  Sample wrong = samples[0];
  wrong.id = "wrong";
  wrong.train = false;
  for (double& z : wrong.views[0].z) z += 1;
  samples.push_back(wrong);
  same(plain, *stage(rig, samples, {}));
}

TEST_CASE("staging: samples that fit nothing do not decide") {
  const Rig rig = arm();
  std::vector<Sample> samples = samples_of(rig, {{"joint/j3/offset", 0.01}}, 40, 8);
  for (double& z : samples[5].views[0].z) z += 0.05;  // 500 sigmas
  const Staging s = *stage(rig, samples, {});
  CHECK(trial(s, "joint offsets").kept);
  CHECK_FALSE(trial(s, "gear scales").kept);
}

TEST_CASE("staging: progress cancels, and there must be training samples") {
  const Rig rig = arm();
  std::vector<Sample> samples = samples_of(rig, {}, 20, 9);
  StagingOptions options;
  std::vector<std::string> seen;
  options.progress = [&](const std::string& what) {
    seen.push_back(what);
    return seen.size() < 2;
  };
  CHECK_FALSE(stage(rig, samples, options));
  CHECK(seen == std::vector<std::string>{"mounts", "joint offsets"});
  for (Sample& sample : samples) sample.train = false;
  CHECK_THROWS_AS(stage(rig, samples, {}), std::invalid_argument);
}
