// models/report/baselines: simpler calibrations beside the automatic path's, and the paired
// interval behind it (analysis/held_out.h).
//
// Proves: the interval of a ratio of two root mean squares is that of a jackknife written out here,
// holds the true ratio as often as it says, and does not grow with what makes a block hard for
// both; of an arm with wrong offsets the rig as it is, the mounts alone and the whole calibration
// get better in this order, on held-out samples and cross-validated, without a warning; held-out
// sums are those of a calibration of the mounts by hand; where the rig gives no pose there is
// nothing to judge as it is; readings that are wrong in training alone make the calibration worse
// than its mounts, and the warning says so. Does not prove: how often the warning comes by chance
// on real robots.
#include "../../../models/report/baselines.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/report/warnings.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"

namespace baselines_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// A tracker beside the base that sees a reflector body on an arm's hand.
Rig arm_before_tracker(bool poses) {
  Rig rig;
  add_link(rig, "base");
  const std::vector<Vector3d> axes = {{0, 0, 1}, {0, 1, 0}, {0, 1, 0}, {1, 0, 0}, {0, 1, 0}},
                              places = {
                                  {0, 0, 0.2}, {0, 0, 0.1}, {0, 0, 0.4}, {0.3, 0, 0}, {0.1, 0, 0}};
  std::string parent = "base";
  for (size_t j = 0; j < axes.size(); ++j) {
    const std::string name = "a" + std::to_string(j + 1);
    add_joint(rig, JointType::revolute, name, parent, name + "_link", axes[j], at(places[j]), 1e-4);
    parent = name + "_link";
  }
  finish_tree(rig.tree);
  add_mocap(rig, "tracker", "base", at({1.5, 0.2, 0.5}, {0, 0.1, 3}), 2e-4, 5e-4);
  add_points(rig, "body", Eigen::Matrix3Xd::Zero(3, 1), parent, at({0.05, 0.02, 0.1}));
  rig.sensors[0].pose_given = rig.targets[0].pose_given = poses;
  return rig;
}

Rig with_wrong_offsets(double size) {
  Rig rig = arm_before_tracker(true);
  const double signs[] = {0, -1, 1, -1, 0};
  for (size_t j = 0; j < rig.joints.size(); ++j) rig.joints[j].offset = size * signs[j];
  return rig;
}

/// Training samples of one robot and held-out ones of another.
std::vector<Sample> of_two(const Rig& training, const Rig& held_out, int count, int others) {
  Random random(4);
  std::vector<Sample> out;
  for (int n = 0; n < count + others; ++n) {
    const Rig& truth = n < count ? training : held_out;
    const TruePosture p = random_posture(truth, random, 0.9, true);
    out.push_back(make_sample(truth, p, "s" + std::to_string(n)));
    REQUIRE(add_view(out.back(), truth, 0, 0, p, &random));
    out.back().train = n < count;
  }
  return out;
}

Report studied(const Rig& rig, std::vector<Sample> samples, int folds = 0) {
  StudyOptions options;
  options.loops = false;
  options.cross_validate = folds;
  return *study(make_recording(rig, std::move(samples)), options);
}

bool warns(const Notices& all) {
  return std::any_of(all.begin(), all.end(),
                     [](const Notice& w) { return w.kind == NoticeKind::held_out; });
}

double rms_of(const Residuals& residuals, bool rotation) {
  double sum = 0;
  for (const ViewResiduals& r : residuals.as_read)
    sum += (rotation ? r.raw.tail<3>() : r.raw.head<3>()).squaredNorm();
  return std::sqrt(sum / static_cast<double>(residuals.as_read.size()));
}

}  // namespace

TEST_CASE("the interval of a ratio is a paired jackknife over blocks") {
  const std::vector<double> a = {4, 1, 9, 2, 6}, b = {1, 0.5, 2, 1, 1.5};
  std::vector<double> theta;
  double mean = 0, variance = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    theta.push_back(std::log((22 - a[i]) / (6 - b[i])));
    mean += theta.back() / 5;
  }
  for (double t : theta) variance += (t - mean) * (t - mean);
  const double ratio = std::sqrt(22.0 / 6), t4 = 2.776445,
               factor = std::exp(t4 * std::sqrt(variance * 4 / 5) / 2);
  const Interval found = rms_ratio_interval(a, b);
  CHECK(found.low == Approx(ratio / factor).epsilon(1e-3));
  CHECK(found.high == Approx(ratio * factor).epsilon(1e-3));
  // Blocks that are hard for both say nothing against a fixed ratio; one without errors nothing.
  std::vector<double> four_times;
  for (double x : a) four_times.push_back(4 * x);
  CHECK(rms_ratio_interval(four_times, a).low == Approx(2));
  CHECK(rms_ratio_interval(four_times, a).high == Approx(2));
  CHECK(std::isnan(rms_ratio_interval({1, 2}, {2, 3}).low));
  CHECK(std::isnan(rms_ratio_interval({0, 0, 0}, {0, 0, 0}).low));
}

TEST_CASE("the interval of a ratio holds the true one as often as it says") {
  Random random(1);
  constexpr int kDraws = 2000, kBlocks = 12, kPoints = 20;
  int outside = 0;
  for (int n = 0; n < kDraws; ++n) {
    std::vector<double> a(kBlocks, 0), b(kBlocks, 0);
    for (int i = 0; i < kBlocks; ++i) {
      const double hard = std::exp(random.normal());
      for (int p = 0; p < kPoints; ++p) {
        const double x = random.normal(), y = random.normal();
        a[i] += hard * x * x;
        b[i] += hard * y * y;
      }
    }
    const Interval found = rms_ratio_interval(a, b);
    outside += !(found.low < 1 && found.high > 1);
  }
  CHECK(outside < 0.1 * kDraws);
  CHECK(outside > 0.02 * kDraws);
}

TEST_CASE("wrong offsets: mounts alone are better than the rig, everything better than these") {
  const Rig truth = with_wrong_offsets(0.01);
  const std::vector<Sample> samples = of_two(truth, truth, 24, 12);
  const Report report = studied(arm_before_tracker(true), samples);
  REQUIRE(report.validation.baselines);
  const Baselines& found = *report.validation.baselines;
  CHECK(!found.cross_validated);
  CHECK(found.rig);
  REQUIRE(found.rows.size() == 2);
  CHECK(found.rows[0].unit == "m");
  CHECK(found.rows[1].unit == "rad");
  // By hand: the mounts alone.
  Rig by_hand = arm_before_tracker(true);
  by_hand.steps = {report.solution.rig().steps[0]};
  const Solution mounts = solution_of(by_hand, samples);
  const Residuals of_mounts = held_out_as_read(mounts, mounts.values.shared),
                  of_rig = held_out_as_read(mounts, mounts.initial);
  for (const Baseline& row : found.rows) {
    const bool rotation = row.unit == "rad";
    CHECK(row.points == 12);
    CHECK(row.blocks == 12);
    CHECK(row.rig > 1.2 * row.mounts);
    CHECK(row.mounts > 2 * row.automatic);
    CHECK(row.of_ratio.high < 1);
    CHECK(row.mounts == Approx(rms_of(of_mounts, rotation)).epsilon(1e-4));
    CHECK(row.rig == Approx(rms_of(of_rig, rotation)).epsilon(1e-9));
    const HeldOutError& test = report.validation.test[0];
    CHECK(row.automatic == Approx(rotation ? test.rotation_as_read : test.rms_as_read));
  }
  CHECK(!warns(report.warnings));
}

TEST_CASE("cross-validated, and of a rig that gives no pose") {
  const Rig truth = with_wrong_offsets(0.01);
  const Report report = studied(arm_before_tracker(false), of_two(truth, truth, 24, 0), 3);
  REQUIRE(report.validation.baselines);
  const Baselines& found = *report.validation.baselines;
  CHECK(found.cross_validated);
  CHECK(!found.rig);
  REQUIRE(found.rows.size() == 2);
  const HeldOutError& cross = report.validation.cross_validation->sensors[0];
  CHECK(found.rows[0].points == cross.points);
  CHECK(found.rows[0].automatic == Approx(cross.rms_as_read));
  CHECK(found.rows[0].mounts > 2 * found.rows[0].automatic);
  CHECK(std::isnan(found.rows[0].rig));
  CHECK(!warns(report.warnings));
  CHECK(!studied(arm_before_tracker(true), of_two(truth, truth, 24, 0)).validation.baselines);
}

TEST_CASE("an arm that is as drawn is no worse for what was free") {
  const Rig truth = arm_before_tracker(true);
  CHECK(!warns(studied(truth, of_two(truth, truth, 24, 12)).warnings));
}

TEST_CASE("readings that are wrong in training alone: worse than the mounts, and said so") {
  const Report report = studied(arm_before_tracker(true),
                                of_two(with_wrong_offsets(0.03), arm_before_tracker(true), 24, 60));
  const Baselines& found = *report.validation.baselines;
  REQUIRE(!found.rows.empty());
  CHECK(std::any_of(found.rows.begin(), found.rows.end(),
                    [](const Baseline& b) { return b.worse(); }));
  REQUIRE(warns(report.warnings));
  for (const Notice& w : report.warnings)
    if (w.kind == NoticeKind::held_out) {
      CHECK(sentences(w).find("sensor 'tracker'") != std::string::npos);
      CHECK(sentences(w).find("Too many parameters are estimated") != std::string::npos);
    }
}

}  // namespace baselines_test
