// models/rig/scales.h.
// Proves: every kind of parameter has scales, they are positive and in order, and shares count from
// what they should.
// Does not prove: that the sizes are right. Those of the automatic path are judged by
// benchmarks/automatic.py, those of the doctor by benchmarks/mistakes.py.
#include "../../../models/rig/scales.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "../../../models/rig/numbers.h"
#include "../../fixtures/quadratic_joint.h"
#include "../../fixtures/rigs.h"

namespace scales_test {

using namespace kincal;
using K = ParameterKind;

namespace {

void check_order(const Scales& s) {
  for (const double size :
       {s.width, s.usual, s.yardstick, s.loose, s.open, s.least, s.mistaken, s.reported, s.far})
    CHECK(size > 0);
  CHECK(std::isfinite(s.yardstick));
  CHECK(s.yardstick <= s.loose);
  CHECK(s.loose <= s.open);
  for (const double size : {s.least, s.mistaken, s.reported})
    CHECK((size <= s.far || !std::isfinite(size)));
}

}  // namespace

TEST_CASE("scales: every component has them, positive and in order") {
  Rig rig = fixture::nasty_robot();
  for (size_t j = 0; j < rig.joints.size(); ++j)
    if (rig.tree.joints[j].drives() && rig.tree.joints[j].axis_of_pose == PoseAxis::none)
      rig.joints[j].model = std::make_shared<fixture::QuadraticJoint>(0.5);
  const ParameterTable table(rig);
  std::set<K> kinds;
  for (int p = 0; p < static_cast<int>(table.all.size()); ++p)
    for (int c = 0; c < table.all[p].size(); ++c) {
      INFO(table.all[p].component_name(c));
      const Scales s = scales(table, {p, c}, table.initial);
      kinds.insert(table.all[p].kind);
      const bool is_zero = !table.all[p].pose && table.initial(table.all[p].start + c) == 0;
      if (!is_zero) check_order(s);  // shares of 0 are 0
      CHECK((s.usual > 0 && s.yardstick > 0));
      CHECK(std::isfinite(s.usual));
      if (table.all[p].kind != K::distortion) CHECK((s.width <= s.usual || s.width == kInfinity));
    }
  CHECK(kinds.size() == 11);  // all but own_number, warp and print, which this robot does not have
}

TEST_CASE("scales: every kind has a row for every unit that it may have") {
  for (const auto& [kind, units] :
       std::map<K, std::vector<std::string>>{{K::joint_offset, {"m", "rad"}},
                                             {K::joint_scale, {""}},
                                             {K::joint_shape, {"m", "rad", "", "1/rad"}},
                                             {K::joint_origin, {"m", "rad"}},
                                             {K::sensor_pose, {"m", "rad"}},
                                             {K::intrinsics, {"px"}},
                                             {K::distortion, {"", "rad"}},
                                             {K::range_scale, {""}},
                                             {K::range_offset, {"m"}},
                                             {K::baseline, {"m"}},
                                             {K::own_number, {"m", "rad", "px", "", "s"}},
                                             {K::target_pose, {"m", "rad"}},
                                             {K::square, {"m"}},
                                             {K::warp, {"m"}},
                                             {K::print, {""}},
                                             {K::points, {"m"}}})
    for (const std::string& unit : units) {
      INFO(static_cast<int>(kind) << " " << unit);
      const Scales s = scales(kind, unit);
      check_order(s);
      CHECK((s.usual <= s.far || kind == K::joint_shape));  // of that the model says it
    }
  CHECK(pose_scales("px").yardstick == kInfinity);
}

TEST_CASE("scales: mounts are judged alike, whatever carries them") {
  for (const char* unit : {"m", "rad"})
    for (const K kind : {K::target_pose, K::joint_origin}) {
      const Scales s = scales(kind, unit), mount = pose_scales(unit);
      CHECK(s.usual == mount.usual);
      CHECK(s.yardstick == mount.yardstick);
      CHECK(s.loose == mount.loose);
      CHECK(s.open == mount.open);
      CHECK(s.reported == mount.reported);
      CHECK(s.far == mount.far);
    }
}

TEST_CASE("scales: shares count from the value, of a lens from fx; joint models have their own") {
  Rig rig = fixture::nasty_robot();
  const int elbow = fixture::joint_index(rig, "elbow");
  rig.joints[elbow].scale = -2e-4;  // rad a count
  rig.joints[elbow].model = std::make_shared<fixture::QuadraticJoint>(0.5);
  const ParameterTable table(rig);
  const auto of = [&](const std::string& name) {
    const Freed f = table.select(name).at(0);
    return scales(table, {f.parameter, f.components[0]}, table.initial);
  };
  CHECK(of("joint/elbow/scale").width == Approx(2e-7));
  CHECK(of("joint/elbow/scale").yardstick == Approx(2e-6));
  CHECK(of("joint/elbow/bend").usual == 0.05);
  CHECK(of("joint/elbow/bend").width == 0.05);
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const int p = table.index_of(K::intrinsics, static_cast<int>(s));
    if (p < 0) continue;
    const double fx = table.initial(table.all[p].start);
    for (int c = 0; c < 4; ++c)
      CHECK(scales(table, {p, c}, table.initial).yardstick == Approx(0.01 * fx));
  }
}

}  // namespace scales_test
