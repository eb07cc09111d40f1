// models/report/stages: the held-out errors of a calibration before and after each further model.
//
// Proves, on sums made by hand: root mean squares and ratios are those of the points that every
// stage judged; the interval is the paired one of analysis/held_out.h by block, or by sample where
// there are fewer than three blocks; of a sensor of poses there are rows of rotations; each row
// names the groups that the one before lacks. Does not prove: that the sums are those of the stages
// (tests/program/curves_test.py, bending_test.py).
#include "../../../models/report/stages.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../fixtures/rigs.h"

namespace stages_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

Rig rig_of_two_sensors() {
  Rig rig;
  add_link(rig, "base");
  finish_tree(rig.tree);
  add_tracker(rig, "tracker", "base", {}, {1e-4, 1e-4, 1e-4});
  add_mocap(rig, "poses", "base", {}, 1e-4, 1e-4);
  return rig;
}

/// Sums of a sensor in samples 0, 1, ...: two points each.
void add(int sensor, const std::vector<double>& squares, double rotation, HeldOutSums& to) {
  for (size_t i = 0; i < squares.size(); ++i) {
    BlockSums& sums = to.all[{sensor, static_cast<int>(i)}];
    sums.points = 2;
    sums.as_read = squares[i];
    sums.rotation_as_read = rotation * squares[i];
  }
}

}  // namespace

TEST_CASE("each stage is compared with the one before, on the points of all") {
  const Rig rig = rig_of_two_sensors();
  const Blocks blocks{{0, 1, 2, 3}, {"a", "b", "c", "d"}, {0, 0, 0, 0}};
  std::vector<HeldOutSums> sums(3);
  const std::vector<double> rigid = {4, 9, 6, 100}, bent = {3, 8, 5, 100}, curved = {0.3, 0.4, 0.2};
  add(0, rigid, 0, sums[0]);
  add(0, bent, 0, sums[1]);
  add(0, curved, 0, sums[2]);
  for (HeldOutSums& one : sums) add(1, {1, 2, 3}, 4, one);
  const std::vector<Stage> stages = {{{}, nullptr}, {{"compliance"}, nullptr}};
  const std::vector<StageError> rows =
      compare_stages(rig, blocks, stages, {"compliance", "curve/a", "curve/b"}, sums);
  REQUIRE(rows.size() == 9);
  const double squares[] = {19, 16, 0.9};
  for (size_t s = 0; s < 3; ++s) {
    CHECK(rows[s].sensor == "tracker");
    CHECK(rows[s].points == 6);  // the fourth sample is not judged by the last stage
    CHECK(rows[s].blocks == 3);
    CHECK(rows[s].rms == Approx(std::sqrt(squares[s] / 6)));
  }
  CHECK(std::isnan(rows[0].ratio));
  CHECK(rows[1].ratio == Approx(std::sqrt(16.0 / 19)));
  const Interval paired = rms_ratio_interval(curved, {3, 8, 5});
  CHECK(rows[2].of_ratio.low == paired.low);
  CHECK(rows[2].of_ratio.high == paired.high);
  CHECK(rows[0].added.empty());
  CHECK(rows[1].added == std::vector<std::string>{"compliance"});
  CHECK(rows[2].added == std::vector<std::string>{"curve/a", "curve/b"});
  CHECK(rows[3].unit == "m");
  CHECK(rows[6].unit == "rad");
  CHECK(rows[6].rms == Approx(2 * rows[3].rms));
  CHECK(rows[7].ratio == 1);
}

TEST_CASE("with fewer than three blocks the samples are compared; without data there are no rows") {
  const Rig rig = rig_of_two_sensors();
  const Blocks blocks{{0, 0, 1, 1}, {"first", "second"}, {1, 1}};
  std::vector<HeldOutSums> sums(2);
  add(0, {4, 9, 6, 5}, 0, sums[0]);
  add(0, {1, 2, 1, 2}, 0, sums[1]);
  const std::vector<StageError> rows =
      compare_stages(rig, blocks, {{{}, nullptr}}, {"loads"}, sums);
  REQUIRE(rows.size() == 2);
  CHECK(rows[1].blocks == 4);
  CHECK(!rows[1].by_target);
  CHECK(rows[1].of_ratio.low == rms_ratio_interval({1, 2, 1, 2}, {4, 9, 6, 5}).low);
}

}  // namespace stages_test
