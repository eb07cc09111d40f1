// models/monitor/moving_groups: what of a robot may move.
//
// Proves: mounts and offsets are groups; an estimated origin of a joint is one only where it stands
// for a mount that is not estimated itself. Not proved: what a monitor makes of them
// (monitor_test.cpp).
#include "../../../models/monitor/moving_groups.h"

#include <algorithm>
#include <catch2/catch.hpp>

#include "../../../models/rig/selection.h"
#include "../../fixtures/rigs.h"

namespace moving_groups_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// Names of the groups where these parameters were estimated.
std::vector<std::string> groups(const Rig& rig, const std::vector<std::string>& names) {
  const ParameterTable table(rig);
  std::vector<Freed> freed;
  for (const std::string& name : names) merge(freed, table.select(name));
  std::vector<std::string> out;
  for (const auto& group : moving_groups(rig, table, components_of(freed)))
    out.push_back(group.first);
  return out;
}

bool has(const std::vector<std::string>& names, const std::string& name) {
  return std::count(names.begin(), names.end(), name) > 0;
}

}  // namespace

TEST_CASE("moving groups: an estimated origin is one where it stands for a mount") {
  Rig rig;
  const std::string hand = add_arm(rig, 1e-4);
  add_joint(rig, JointType::fixed, "bracket", hand, "head", Vector3d::UnitZ(), Pose());
  finish_tree(rig.tree);
  rig.joints.resize(rig.tree.joints.size());
  add_camera(rig, "camera", "head", Pose());
  add_points(rig, "ball", Vector3d::Zero(), "base");
  const std::vector<std::string> lengths = {"joint/*/origin", "joint/*/offset"};
  std::vector<std::string> all = lengths;
  all.insert(all.end(), {"sensor/camera/pose", "target/ball/pose"});
  const std::vector<std::string> with_mounts = groups(rig, all), without = groups(rig, lengths);
  for (const auto& names : {with_mounts, without}) {
    CHECK(has(names, "joint/a1/offset"));
    CHECK(has(names, "target/ball/pose"));
    CHECK(has(names, "sensor/camera/intrinsics"));
    CHECK_FALSE(has(names, "joint/a1/origin"));
    CHECK_FALSE(has(names, "joint/a6/origin"));
  }
  CHECK(has(with_mounts, "sensor/camera/pose"));
  CHECK_FALSE(has(with_mounts, "joint/bracket/origin"));
  CHECK(has(without, "joint/bracket/origin"));
  CHECK_FALSE(has(without, "sensor/camera/pose"));
}

}  // namespace moving_groups_test
