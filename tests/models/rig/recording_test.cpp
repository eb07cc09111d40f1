// models/rig/recording.h: what recordings share.
//
// Proves: another rig brings its own table and no other samples, other samples no other rig or
// table, copies nothing new; what is shared lives as long as one of them, also by a problem made of
// one that is gone. Does not prove what it saves.
#include "../../../models/rig/recording.h"

#include <catch2/catch.hpp>
#include <memory>
#include <optional>
#include <type_traits>

#include "../../../models/estimation/estimation.h"
#include "../../fixtures/problem.h"

namespace recording_test {

using namespace kincal;
using namespace kincal::fixture;

TEST_CASE("recording: what another one is made with is its own, the rest is shared") {
  const Setting s = nasty(3, 5, true, {"sensor/pin/pose"}, 0.01);
  const Recording first(s.rig, s.samples);
  Rig larger = s.rig;
  add_camera(larger, "more", "torso", Pose());
  const Recording other_rig = first.with_rig(larger);
  CHECK(&other_rig.samples == &first.samples);
  CHECK(&other_rig.rig != &first.rig);
  CHECK(other_rig.rig.sensors.size() == first.rig.sensors.size() + 1);
  CHECK(other_rig.table.all.size() > first.table.all.size());
  const Recording other_samples = first.with_samples({s.samples[1]});
  CHECK(&other_samples.rig == &first.rig);
  CHECK(&other_samples.table == &first.table);
  CHECK(other_samples.samples.size() == 1);
  const Recording copy = first;
  const std::shared_ptr<const Recording> shared = make_recording(first);
  for (const Recording* same : {&copy, shared.get()}) {
    CHECK(&same->rig == &first.rig);
    CHECK(&same->table == &first.table);
    CHECK(&same->samples == &first.samples);
  }
  CHECK_FALSE(std::is_copy_assignable_v<Recording>);
}

TEST_CASE("recording: what is shared lives as long as who shares it") {
  Setting s = nasty(3, 5, true, {"sensor/pin/pose"}, 0.01);
  s.make({"pin"}, {"sensor/pin/pose"});
  std::optional<Recording> first(std::in_place, s.rig, s.samples);
  const Recording kept = *first;
  EstimationSetup setup;
  setup.sensors = {sensor_index(s.rig, "pin")};
  setup.free = freed(first->table, {"sensor/pin/pose"});
  auto expected = std::make_unique<Estimation>(*first, first->training(), setup);
  const VectorXd state = expected->pack(s.values);
  Cost cost, again;
  REQUIRE(expected->evaluate(0, state, 0, cost));
  auto problem =
      std::make_unique<Estimation>(first->with_samples(s.samples), kept.training(), setup);
  expected.reset();
  first.reset();
  REQUIRE(problem->evaluate(0, state, 0, again));
  CHECK(again.doubled == cost.doubled);
  CHECK(kept.rig.sensors.size() == s.rig.sensors.size());
  CHECK(kept.samples[2].readings[1] == s.samples[2].readings[1]);
}

}  // namespace recording_test
