// models/analysis/gauges: what no posture tells.
//
// Proves, on small arms: of parallel axes the heights at both ends are one gauge and nothing else
// is; the component that is fixed is of a pose that the rig gives; an arm with other axes has none;
// far from the robot's size (a board of 25 m, tens of metres away) none appears by rounding; where
// things only slide, three; the body that everything measured stands behind is not the base where
// a joint in between moves all of it. Does not prove: that a calibration with one fixed is right
// (newcomer_test.py).
#include "../../../models/analysis/gauges.h"

#include <catch2/catch.hpp>
#include <set>

#include "../../fixtures/rigs.h"

namespace gauges_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// A row of joints about (or along) these axes, a camera behind the last, a board on `stand`.
Recording recorded(const std::vector<Vector3d>& axes, JointType type, double far = 1,
                   bool torso = false) {
  Rig rig;
  add_link(rig, "base");
  std::string parent = "base";
  if (torso) {
    add_joint(rig, JointType::revolute, "torso", "base", "stand", Vector3d::UnitY(), at({0, 0, 1}));
    parent = "stand";
  }
  const std::string stand = parent;
  for (size_t j = 0; j < axes.size(); ++j) {
    const std::string name = "a" + std::to_string(j + 1);
    add_joint(rig, type, name, parent, name + "_link", axes[j], at({0.3, 0.02, 0.1}));
    parent = name + "_link";
  }
  finish_tree(rig.tree);
  add_camera(rig, "eye", parent, at({0.03, 0.01, -0.05 * far}, {3.1, 0.1, 0}));
  add_grid(rig, "board", 5, 6, 0.04, stand, at({0.5, -0.1, -0.4 * far}, {0.1, 0.2, 0.3}));
  Sample sample;
  sample.readings.assign(rig.tree.joints.size(), 0.1);
  View view;
  view.sensor = view.target = 0;
  view.ids = std::vector<int>{0};
  view.z = {100, 100};
  view.sigma = rig.sensors[0].sigma;
  sample.views = {view};
  return Recording(std::move(rig), {sample});
}

std::vector<Gauge> gauges_of(const Recording& recording) {
  std::vector<Freed> poses;
  merge(poses, recording.table.select("sensor/eye/pose"));
  merge(poses, recording.table.select("target/board/pose"));
  return find_gauges(recording, recording.table.initial, poses);
}

const Vector3d kX = Vector3d::UnitX(), kY = Vector3d::UnitY(), kZ = Vector3d::UnitZ();

}  // namespace

TEST_CASE("gauges: of parallel axes the heights at both ends are one") {
  Recording recording = recorded({kZ, kZ, kZ}, JointType::revolute);
  const std::vector<Gauge> both = gauges_of(recording);
  REQUIRE(both.size() == 1);
  CHECK(both[0].given);
  CHECK(recording.table.name(both[0].fixed) == "target/board/pose.z");
  std::set<std::string> with;
  for (const Component& c : both[0].with) with.insert(recording.table.name(c));
  CHECK(with.count("sensor/eye/pose.z") == 1);
  for (const std::string& name : with) CHECK(name.find("pose.r") == std::string::npos);
  Rig rig = recording.rig;
  rig.targets[0].pose_given = false;
  const Recording open = recording.with_rig(rig);
  const std::vector<Gauge> one = gauges_of(open);
  REQUIRE(one.size() == 1);
  CHECK(open.table.name(one[0].fixed) == "sensor/eye/pose.z");
}

TEST_CASE("gauges: none of other axes, near and far; three where all slides") {
  for (const double far : {1.0, 500.0}) {
    CHECK(gauges_of(recorded({kZ, kY, kX, kY}, JointType::revolute, far)).empty());
    CHECK(gauges_of(recorded({kZ, kZ, kZ}, JointType::revolute, far)).size() == 1);
  }
  CHECK(gauges_of(recorded({kX, kY, kZ}, JointType::prismatic)).size() >= 3);
}

TEST_CASE("gauges: a joint that never moved is no joint") {
  const Recording recording = recorded({kZ, kZ, kY}, JointType::revolute);
  std::vector<Sample> samples(4, recording.samples[0]);
  for (size_t i = 0; i < samples.size(); ++i)
    for (size_t j = 0; j < 3; ++j)
      samples[i].readings[j] = 0.1 + 0.2 * static_cast<double>(i * (j + 1));
  CHECK(gauges_of(recording.with_samples(samples)).empty());
  for (Sample& sample : samples) sample.readings[2] = 0.3;
  CHECK(gauges_of(recording.with_samples(samples)).size() == 1);
}

TEST_CASE("gauges: the common pose of two cameras that see free boards only") {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "pan", "base", "head", kZ, at({0.1, 0.2, 0.9}));
  add_joint(rig, JointType::fixed, "mount", "head", "frame", kZ,
            at({0.03, -0.02, 0.07}, {0, 1, 0}));
  finish_tree(rig.tree);
  add_camera(rig, "left", "frame", at({0.013, 0.07, 0.021}, {0.1, 0.2, 0.3}));
  add_camera(rig, "right", "frame", at({-0.017, -0.05, 0.011}, {-0.2, 0.1, 0.4}));
  add_grid(rig, "board", 5, 6, 0.04, "", Pose());
  Sample sample;
  sample.readings.assign(rig.tree.joints.size(), 0.1);
  for (const int camera : {0, 1}) {
    View view;
    view.sensor = camera;
    view.target = 0;
    view.ids = std::vector<int>{0};
    view.z = {100, 100};
    view.sigma = rig.sensors[camera].sigma;
    sample.views.push_back(view);
  }
  const Recording recording(std::move(rig), {sample});
  const auto gauges = [&](const std::vector<std::string>& names) {
    std::vector<Freed> poses;
    for (const std::string& name : names) merge(poses, recording.table.select(name));
    return find_gauges(recording, recording.table.initial, poses);
  };
  SECTION("one of the poses is fixed whole") {
    const std::vector<Gauge> both = gauges({"sensor/left/pose", "sensor/right/pose"});
    REQUIRE(both.size() == 6);
    for (const Gauge& g : both) CHECK(g.fixed.parameter == both[0].fixed.parameter);
    CHECK(gauges({"sensor/left/pose"}).empty());
  }
  SECTION("what carries both moves nothing, but for rounding") {
    const std::vector<Gauge> carrier = gauges({"joint/mount/origin"});
    CHECK(carrier.size() == 6);
    for (const Gauge& g : carrier) CHECK(g.with.empty());
    CHECK(gauges({"joint/mount/origin", "sensor/right/pose"}).size() == 6);
  }
}

TEST_CASE("gauges: what everything measured stands behind") {
  const Recording plain = recorded({kZ, kY}, JointType::revolute),
                  torso = recorded({kZ, kY}, JointType::revolute, 1, true);
  CHECK(common_body(plain.rig) == plain.rig.base);
  CHECK(torso.rig.tree.links[common_body(torso.rig)] == "stand");
}

}  // namespace gauges_test
