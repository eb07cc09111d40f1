// models/rig/folds.h: which targets are placements of one thing, and what is never held out.
//
// Proves: targets on one rigid body, also over fixed joints, are placements; targets on different
// bodies are not, whether steps free their poses or there are no steps yet, nor is one that is all
// that a sensor sees of the body, nor one whose size or points a step frees: these are dealt by
// sample. Neither a joint's nor a sensor's nor a target's only samples are held out; those of one
// posture are held out together. Does not
// prove: how blocks are dealt and judged (validation_test.cpp).
#include "../../../models/rig/folds.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <set>

#include "../../fixtures/rigs.h"

namespace folds_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// A camera on a post of the base, a table on it by a fixed joint, two arms of one joint each.
Rig two_arms() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::fixed, "post_joint", "base", "post", {1, 0, 0}, at({0, 0, 1}));
  add_joint(rig, JointType::fixed, "table_joint", "base", "table", {1, 0, 0}, at({1, 0, 0}));
  add_joint(rig, JointType::revolute, "left", "base", "left_hand", {0, 0, 1}, at({0, 1, 0}), 1e-3);
  add_joint(rig, JointType::revolute, "right", "base", "right_hand", {0, 0, 1}, at({0, -1, 0}),
            1e-3);
  finish_tree(rig.tree);
  add_tracker(rig, "eye", "post", at({0, 0, 0.1}), {1e-3, 1e-3, 1e-3});
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = {"target/*/pose", "joint/*/offset"};
  rig.steps = {step};
  return rig;
}

/// A target of three points on a link.
int place(Rig& rig, const std::string& name, const std::string& link) {
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.1, 0, 0, 0, 0.1, 0, 0.02, 0;
  return add_points(rig, name, points, link);
}

/// A sample in which a sensor sees a target; what it measured plays no role.
Sample sample_of(int sensor, int target, int number) {
  Sample out;
  out.id = "s" + std::to_string(target) + "_" + std::to_string(number);
  View view;
  view.sensor = sensor;
  view.target = target;
  out.views = {view};
  return out;
}

std::vector<Sample> samples_of(const Rig& rig, int each) {
  std::vector<Sample> out;
  for (size_t t = 0; t < rig.targets.size(); ++t)
    for (int n = 0; n < each; ++n) out.push_back(sample_of(0, static_cast<int>(t), n));
  return out;
}

/// The targets of the training samples without one fold.
std::set<int> left_without(const Folds& folds, const std::vector<Sample>& samples, int fold) {
  std::set<int> out;
  for (size_t i = 0; i < samples.size(); ++i)
    if (folds.of[i] != fold) out.insert(samples[i].views[0].target);
  return out;
}

}  // namespace

TEST_CASE("folds: boards in two hands are no placements of one board") {
  Rig rig = two_arms();
  place(rig, "in_left", "left_hand");
  place(rig, "in_right", "right_hand");
  const std::vector<Sample> samples = samples_of(rig, 10);
  for (bool steps : {true, false}) {
    if (!steps) rig.steps.clear();
    const Folds folds = deal_folds(rig, samples, 4);
    CHECK(!folds.by_target());
    for (int f = 0; f < 4; ++f) CHECK(left_without(folds, samples, f).size() == 2);
  }
}

TEST_CASE("folds: a board in a hand and one on a wall are no placements of one board") {
  Rig rig = two_arms();
  place(rig, "hand", "left_hand");
  place(rig, "wall", "base");
  const std::vector<Sample> samples = samples_of(rig, 10);
  CHECK(!deal_folds(rig, samples, 2).by_target());
}

TEST_CASE("folds: targets on one rigid body are placements, those beside them are not") {
  Rig rig = two_arms();
  place(rig, "on_base", "base");
  place(rig, "on_table", "table");  // fixed to the base
  place(rig, "on_table_too", "table");
  place(rig, "in_left", "left_hand");
  const std::vector<Sample> samples = samples_of(rig, 6);
  const Folds folds = deal_folds(rig, samples, 3);
  CHECK(folds.by_target());
  for (size_t i = 0; i < samples.size(); ++i) {
    const int target = samples[i].views[0].target;
    CHECK((folds.blocks.target[folds.blocks.of[i]] != 0) == (target < 3));
    if (target < 3) CHECK(folds.of[i] == folds.of[6 * static_cast<size_t>(target)]);
  }
}

TEST_CASE("folds: all that a sensor sees of a body is no placement") {
  Rig rig = two_arms();
  place(rig, "a", "base");
  place(rig, "b", "base");
  place(rig, "c", "base");
  add_tracker(rig, "second", "left_hand", at({0, 0, 0}), {1e-3, 1e-3, 1e-3});
  rig.steps[0].sensors = {0, 1};
  std::vector<Sample> samples = samples_of(rig, 4);
  for (int n = 4; n < 8; ++n) samples.push_back(sample_of(1, 0, n));
  const Folds folds = deal_folds(rig, samples, 2);
  for (size_t i = 0; i < samples.size(); ++i)
    CHECK((folds.blocks.target[folds.blocks.of[i]] != 0) == (samples[i].views[0].target != 0));
  for (int f = 0; f < 2; ++f) {
    bool seen = false;
    for (size_t i = 0; i < samples.size(); ++i)
      seen = seen || (samples[i].views[0].sensor == 1 && folds.of[i] != f);
    CHECK(seen);
  }
}

TEST_CASE("folds: a target whose points a step frees is dealt by sample") {
  Rig rig = two_arms();
  for (const char* name : {"a", "b", "c"}) place(rig, name, "base");
  const std::vector<Sample> samples = samples_of(rig, 5);
  CHECK(deal_folds(rig, samples, 3).by_target());
  rig.steps[0].free.push_back("target/*/points");
  const Folds folds = deal_folds(rig, samples, 3);
  CHECK(!folds.by_target());
  for (int f = 0; f < 3; ++f) CHECK(left_without(folds, samples, f).size() == 3);
}

TEST_CASE("folds: a joint's only samples are never held out") {
  // A second tracker, on the left hand, sees the tip of a finger on it.
  Rig rig = two_arms();
  place(rig, "in_right", "right_hand");
  place(rig, "on_base", "base");
  add_tracker(rig, "second", "left_hand", at({0, 0, 0}), {1e-3, 1e-3, 1e-3});
  add_joint(rig, JointType::revolute, "tilt", "left_hand", "finger", {1, 0, 0}, at({0, 0, 0.1}));
  finish_tree(rig.tree);
  rig.steps[0].sensors = {0, 1};
  place(rig, "tip", "finger");
  std::vector<Sample> samples;
  for (int n = 0; n < 12; ++n) samples.push_back(sample_of(0, n % 2, n));
  samples.push_back(sample_of(1, 2, 12));  // the joint `tilt`, by the second tracker
  samples.push_back(sample_of(1, 2, 13));
  samples.push_back(sample_of(0, 0, 14));
  // Two of `tilt` are dealt to two folds; one of it alone stays.
  CHECK(deal_folds(rig, samples, 3).held_out(-1).empty());
  samples.erase(samples.end() - 2);
  CHECK(deal_folds(rig, samples, 3).held_out(-1) == std::vector<std::string>{"s2_12"});
  // The same where other samples show the tracker and the target: the tracker another one, an eye
  // on the finger itself the target.
  add_tracker(rig, "near", "finger", at({0, 0, 0}), {1e-3, 1e-3, 1e-3});
  rig.steps[0].sensors = {0, 1, 2};
  place(rig, "on_hand", "left_hand");
  for (int n = 20; n < 26; ++n) {
    samples.push_back(sample_of(1, 3, n));
    samples.push_back(sample_of(2, 2, n));
  }
  CHECK(deal_folds(rig, samples, 3).held_out(-1) == std::vector<std::string>{"s2_12"});
}

TEST_CASE("folds: samples of one posture are held out together") {
  Rig rig = two_arms();
  place(rig, "in_left", "left_hand");
  std::vector<Sample> samples = samples_of(rig, 12);
  const double sigma = 1e-4;
  for (JointSettings& joint : rig.joints) joint.sigma = sigma;
  for (size_t i = 0; i < samples.size(); ++i) {  // three of each posture, scattered by their noise
    const size_t posture = i % 4, time = i / 4;
    samples[i].readings.assign(
        rig.joints.size(), 0.1 * static_cast<double>(posture) + sigma * static_cast<double>(time));
  }
  const Blocks blocks = make_blocks(rig, samples);
  CHECK(blocks.names.size() == 4);
  for (size_t i = 0; i < samples.size(); ++i) CHECK(blocks.of[i] == blocks.of[i % 4]);
  for (size_t i = 8; i < samples.size(); ++i)  // further apart than noise
    for (double& reading : samples[i].readings) reading += 20 * sigma;
  CHECK(make_blocks(rig, samples).names.size() == 8);
  for (Sample& sample : samples) sample.readings[0] = std::nan("");  // lacking in all alike
  CHECK(make_blocks(rig, samples).names.size() == 8);
}

}  // namespace folds_test
