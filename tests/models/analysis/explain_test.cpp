// Reasons of weak directions on small rigs in which each is planted. Not proven: that every weak
// direction of any robot finds its reason (some end as "unknown").
#include "../../../models/analysis/weak_directions.h"

#include <catch2/catch.hpp>
#include <functional>

#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"
#include "../../fixtures/transforms.h"

namespace explain_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// base - a (z) - b (y) - c (x) - tool, a tracker beside the base.
Rig small_arm() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "a", "base", "one", {0, 0, 1}, at({0.1, 0, 0.3}));
  add_joint(rig, JointType::revolute, "b", "one", "two", {0, 1, 0},
            at({0.05, 0, 0.2}, {0.1, 0, 0}));
  add_joint(rig, JointType::revolute, "c", "two", "tool", {1, 0, 0},
            at({0.3, 0.02, 0}, {0, 0.2, 0.1}));
  add_joint(rig, JointType::revolute, "idle", "base", "away", {0, 0, 1}, at({0, 0.5, 0}));
  finish_tree(rig.tree);
  rig.base = rig.tree.root;
  add_tracker(rig, "tracker", "base", at({1.5, -0.5, 0.4}, {0.1, 0.2, 2.5}), {1e-4, 1e-4, 1e-4});
  return rig;
}

Eigen::Matrix3Xd four_points() {
  Eigen::Matrix3Xd p(3, 4);
  p << 0, 0.1, 0.02, -0.05, 0, 0.01, 0.12, 0.04, 0, 0.03, -0.02, 0.08;
  return p;
}

/// `count` samples of all pairs given; `edit` may change a posture. Noise-free, so the truth is the
/// solution.
std::vector<Sample> samples_of(const Rig& rig,
                               const std::vector<std::pair<std::string, std::string>>& pairs,
                               int count,
                               const std::function<void(TruePosture&, Random&)>& edit = {}) {
  Random random(7);
  std::vector<Sample> out;
  for (int i = 0; i < count; ++i) {
    TruePosture p = random_posture(rig, random, 1.0, false);
    if (edit) edit(p, random);
    Sample s = make_sample(rig, p, "s" + std::to_string(i));
    for (const auto& pair : pairs)
      add_view(s, rig, sensor_index(rig, pair.first), target_index(rig, pair.second), p, &random);
    out.push_back(s);
  }
  return out;
}

Report run(Rig rig, const std::vector<Sample>& samples, const std::vector<std::string>& free,
           const std::vector<PriorSetting>& priors = {}) {
  Step step;
  step.name = "all";
  for (size_t i = 0; i < rig.sensors.size(); ++i) step.sensors.push_back(static_cast<int>(i));
  step.free = free;
  step.priors = priors;
  rig.steps = {step};
  return study_of(rig, samples);
}

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

bool names(const WeakDirection& weak, const std::string& name) {
  return std::any_of(weak.parameters.begin(), weak.parameters.end(),
                     [&](const auto& p) { return p.first == name; });
}

}  // namespace

TEST_CASE("explain: the last joint's offset and the roll of what it holds") {
  Rig rig = small_arm();
  add_points(rig, "marks", four_points(), "tool", at({0.05, 0.02, 0.1}, {0.3, 0, 0}));
  const Report r = run(rig, samples_of(rig, {{"tracker", "marks"}}, 12),
                       {"joint/b/offset", "joint/c/offset", "target/marks/pose"});
  REQUIRE(r.solution.status == Status::unobservable);
  REQUIRE(r.explanation.weak.size() == 1);
  const WeakDirection& w = r.explanation.weak[0];
  CHECK(w.reason == "same_axis");
  CHECK(has(w.why, "same axis"));
  CHECK(has(w.why, "whatever the posture"));
  CHECK(has(w.cure, "fix "));
  CHECK(w.joints.empty());
  CHECK(names(w, "joint/c/offset"));
  CHECK(names(w, "target/marks/pose.rx"));
  CHECK(std::isnan(w.sigma));
  const auto warning = std::find_if(r.warnings.begin(), r.warnings.end(), [](const Notice& x) {
    return x.kind == NoticeKind::unobservable;
  });
  REQUIRE(warning != r.warnings.end());
  CHECK(has(sentences(*warning), "same axis"));
}

TEST_CASE("explain: a joint that never moved, and one that hardly did") {
  Rig rig = small_arm();
  add_points(rig, "marks", four_points(), "tool", at({0.05, 0.02, 0.1}));
  const double spread = GENERATE(0.0, 0.003, 1.0);
  const auto samples =
      samples_of(rig, {{"tracker", "marks"}}, 14, [&](TruePosture& p, Random& random) {
        p.readings[joint_index(rig, "b")] = 0.4 + spread * random.uniform(-0.5, 0.5);
      });
  const Report r = run(rig, samples, {"joint/a/offset", "joint/c/origin"});
  if (spread == 1.0) {
    CHECK(r.explanation.weak.empty());
    CHECK(r.solution.status == Status::converged);
    return;
  }
  REQUIRE(r.explanation.weak.size() == 1);
  const WeakDirection& w = r.explanation.weak[0];
  CHECK(w.joints == std::vector<std::string>{"b"});
  CHECK(has(w.why, spread == 0 ? "b never moved" : "b moved within"));
  CHECK(has(w.cure, "move b"));
}

TEST_CASE("explain: the base's offset against the placement of all targets") {
  Rig rig = small_arm();
  rig.sensors.clear();
  add_tracker(rig, "probe", "tool", at({0.02, 0.1, 0.3}, {0.5, 0, 0}), {1e-4, 1e-4, 1e-4});
  add_points(rig, "left", four_points(), "base", at({0.6, 0.3, 0.2}, {0.1, 0, 1}));
  add_points(rig, "right", four_points(), "base", at({0.6, -0.3, 0.2}, {0.1, 0.2, 0}));
  const Report r =
      run(rig, samples_of(rig, {{"probe", "left"}, {"probe", "right"}}, 12),
          {"joint/a/offset", "joint/b/offset", "target/left/pose", "target/right/pose"});
  REQUIRE(r.explanation.weak.size() == 1);
  const WeakDirection& w = r.explanation.weak[0];
  CHECK(w.reason == "same_axis");
  CHECK(w.joints.empty());
  for (const char* name : {"joint/a/offset", "target/left/pose.rz", "target/right/pose.rz"})
    CHECK(names(w, name));
}

TEST_CASE("explain: a single point, and points on a line") {
  Rig rig = small_arm();
  Eigen::Matrix3Xd point(3, 1), line(3, 3);
  point << 0, 0, 0;
  line << 0, 0.05, 0.1, 0, 0, 0, 0, 0, 0;
  const bool single = GENERATE(true, false);
  add_points(rig, "marks", single ? point : line, "tool", at({0.05, 0.2, 0.1}));
  const Report r = run(rig, samples_of(rig, {{"tracker", "marks"}}, 12), {"target/marks/pose"});
  REQUIRE(r.explanation.weak.size() == (single ? 3u : 1u));
  for (const WeakDirection& w : r.explanation.weak) {
    CHECK(w.reason == "on_axis");
    CHECK(has(w.why, "lie on the axis"));
    CHECK(has(w.cure, "points beside this axis"));
  }
  CHECK(r.explanation.weak[0].parameters[0].first == "target/marks/pose.rx");
}

TEST_CASE("explain: a ball on the axis of the last joint") {
  Rig rig = small_arm();
  Eigen::Matrix3Xd ball(3, 1);
  ball << 0, 0, 0;
  add_points(rig, "ball", ball, "tool", at({0.2, 0, 0}));
  const Report r = run(rig, samples_of(rig, {{"tracker", "ball"}}, 15),
                       {"joint/c/origin.y", "joint/c/origin.rz"});
  REQUIRE(r.explanation.weak.size() == 1);
  const WeakDirection& w = r.explanation.weak[0];
  CHECK(w.reason == "on_axis");
  CHECK(names(w, "joint/c/origin.y"));
  CHECK(names(w, "joint/c/origin.rz"));
  CHECK(has(w.why, "axis of c"));
}

TEST_CASE("explain: free targets go along") {
  Rig rig = small_arm();
  add_tracker(rig, "second", "base", at({-1, 0.5, 0.4}, {0.1, 0.4, 0}), {1e-4, 1e-4, 1e-4});
  add_points(rig, "loose", four_points());
  const auto samples = samples_of(
      rig, {{"tracker", "loose"}, {"second", "loose"}}, 6, [&](TruePosture& p, Random& random) {
        p.boards[target_index(rig, "loose")] = isometry(random.pose(0.5, 1));
      });
  const Report r = run(rig, samples, {"sensor/tracker/pose", "sensor/second/pose"});
  REQUIRE(r.explanation.weak.size() == 6);
  for (const WeakDirection& w : r.explanation.weak) {
    CHECK(w.reason == "free_targets");
    CHECK(has(w.why, "loose"));
  }
}

TEST_CASE("explain: nothing depends on it") {
  Rig rig = small_arm();
  add_points(rig, "marks", four_points(), "tool", at({0.05, 0.02, 0.1}));
  const Report r =
      run(rig, samples_of(rig, {{"tracker", "marks"}}, 6), {"joint/b/offset", "joint/idle/offset"});
  REQUIRE(r.explanation.weak.size() == 1);
  CHECK(r.explanation.weak[0].reason == "nothing_depends");
  CHECK(has(r.explanation.weak[0].why, "no measurement depends on joint/idle/offset"));
  const auto still = samples_of(rig, {{"tracker", "marks"}}, 6, [&](TruePosture& p, Random&) {
    p.readings[joint_index(rig, "b")] = 0;
  });
  const Report zero = run(rig, still, {"joint/a/offset", "joint/b/scale"});
  REQUIRE(zero.explanation.weak.size() == 1);
  CHECK(has(zero.explanation.weak[0].why, "b reads 0 in all samples"));
  CHECK(zero.explanation.weak[0].joints == std::vector<std::string>{"b"});
}

TEST_CASE("explain: sizes when only angles are measured") {
  Rig rig = small_arm();
  rig.sensors.clear();
  add_camera(rig, "eye", "base", at({0, 0, 0}));
  add_grid(rig, "board", 4, 5, 0.05, "base", at({-0.1, -0.1, 1.2}, {0.4, 0.3, 0.1}));
  const Report r = run(rig, samples_of(rig, {{"eye", "board"}}, 5),
                       {"target/board/pose", "target/board/square"});
  REQUIRE(r.explanation.weak.size() == 1);
  CHECK(r.explanation.weak[0].reason == "size");
  CHECK(has(r.explanation.weak[0].why, "cameras measure angles"));
}

TEST_CASE("explain: one orientation of the board") {
  Rig rig = small_arm();
  rig.sensors.clear();
  add_camera(rig, "eye", "base", at({0, 0, 0}));
  add_grid(rig, "board", 5, 6, 0.08);
  const bool tilted = GENERATE(true, false);
  const auto samples = samples_of(rig, {{"eye", "board"}}, 12, [&](TruePosture& p, Random& random) {
    Pose pose =
        at({random.uniform(-0.3, -0.1), random.uniform(-0.3, -0.1), random.uniform(0.8, 1.2)},
           tilted ? Vector3d(random.vector(0.6)) : Vector3d(0, 0, random.uniform(-0.02, 0.02)));
    p.boards[target_index(rig, "board")] = isometry(pose);
  });
  const Report r = run(rig, samples, {"sensor/eye/intrinsics"});
  if (tilted) {
    CHECK(r.explanation.weak.empty());
    return;
  }
  REQUIRE(!r.explanation.weak.empty());
  bool said = false;
  for (const WeakDirection& w : r.explanation.weak) said = said || w.reason == "one_orientation";
  CHECK(said);
}

TEST_CASE("explain: what a prior decides, and strong correlations from the data alone") {
  Rig rig = small_arm();
  add_points(rig, "marks", four_points(), "tool", at({0.05, 0.02, 0.1}));
  PriorSetting prior;
  prior.pattern = "joint/c/offset";
  prior.translation = 0.01;
  const Report r = run(rig, samples_of(rig, {{"tracker", "marks"}}, 12),
                       {"joint/c/offset", "target/marks/pose"}, {prior});
  CHECK(r.solution.status == Status::converged);
  REQUIRE(r.explanation.prior_decides.size() == 1);
  CHECK(r.explanation.prior_decides[0].name == "joint/c/offset");
  CHECK(r.explanation.prior_decides[0].sigma == Approx(0.01).epsilon(0.01));
  REQUIRE(r.explanation.weak.size() == 1);  // the data alone: the same as without a prior
  CHECK(r.explanation.weak[0].reason == "same_axis");
  CHECK(std::isnan(r.explanation.weak[0].sigma));
  CHECK(r.explanation.weak[0].sigma_with_priors == Approx(0.01).epsilon(0.05));
}

}  // namespace explain_test
