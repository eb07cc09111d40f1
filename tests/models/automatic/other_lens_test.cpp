// models/automatic/other_lens: a camera that may have another lens than the rig names.
//
// Proves: which lens a camera may have instead; coefficients of the other lens give the same pixels
// where both lenses can (to 0.01 px), and everything else keeps its value; on an arm with a camera
// in its hand, a lens with tangential terms that the rig calls Kannala and Brandt's is named and
// its tilt within what is predicted, and the right lens is not doubted. Does not prove: how often
// right lenses are doubted (measured with 20 robots).
#include "../../../models/automatic/other_lens.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/automatic/automatic.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"

namespace other_lens_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

const std::vector<double> kTangential = {-0.09, 0.06, 0.002, -0.0015, 0},
                          kRadial = {-0.09, 0.06, 0, 0, 0}, kFisheye = {0.3, 0.1, 0.04, 0.02};

/// An arm of six axes with a camera that looks down at a board on the base.
Rig arm(Lens lens, const std::vector<double>& distortion) {
  Rig rig;
  const std::string parent = add_arm(rig, 5e-5);
  add_camera(rig, "eye", parent, at({0.03, 0, -0.05}, {kPi, 0, 0}), lens, distortion, 0, 0.1);
  add_grid(rig, "board", 5, 6, 0.04, "base", at({0.4, -0.1, 0.05}));
  return rig;
}

std::vector<Sample> logged(const Rig& truth, int count, unsigned long seed, double range) {
  Random random(seed);
  std::vector<Sample> out;
  for (int tries = 0; static_cast<int>(out.size()) < count && tries < 10000; ++tries) {
    const TruePosture p = random_posture(truth, random, range, true);
    if (!see(truth, 0, 0, p)) continue;
    out.push_back(make_sample(truth, p, "s" + std::to_string(tries)));
    add_view(out.back(), truth, 0, 0, p, &random);
  }
  return out;
}

/// The pixels of the views of a recording at the rig's readings, one after the other.
std::vector<double> pixels(const Recording& recording, const VectorXd& values) {
  const Rig rig = with_values(recording.rig, recording.table, values);
  std::vector<double> out;
  for (const Sample& sample : recording.samples) {
    TruePosture p;
    p.readings = sample.readings;
    p.errors.assign(sample.readings.size(), 0.0);
    const View view = see(rig, 0, 0, p).value();
    out.insert(out.end(), view.z.begin(), view.z.end());
  }
  return out;
}

}  // namespace

TEST_CASE("other lens: which a camera may have instead") {
  const auto other = [](Lens lens, int count) {
    return other_lens(arm(lens, std::vector<double>(count, 0.1)).sensors[0]);
  };
  CHECK(other(Lens::brown_conrady, 5) == Lens::kannala_brandt);
  CHECK(other(Lens::brown_conrady, 8) == Lens::kannala_brandt);
  CHECK(other(Lens::kannala_brandt, 4) == Lens::brown_conrady);
  CHECK_FALSE(other(Lens::pinhole, 0));
  CHECK_FALSE(other(Lens::unified, 5));
}

TEST_CASE("other lens: its coefficients give the same pixels") {
  for (const auto& [lens, distortion] :
       {std::pair{Lens::brown_conrady, kRadial}, {Lens::kannala_brandt, kFisheye}}) {
    const Rig rig = arm(lens, distortion);
    const Recording recording(rig, logged(rig, 10, 3, 0.1));
    VectorXd values = recording.table.initial;
    const std::vector<double> before = pixels(recording, values);
    const std::shared_ptr<const Recording> other = with_other_lens(recording, 0, values);
    REQUIRE(values.size() == other->table.initial.size());
    const std::vector<double> after = pixels(*other, values);
    REQUIRE(after.size() == before.size());
    for (size_t i = 0; i < before.size(); ++i) CHECK(after[i] == Approx(before[i]).margin(0.01));
    for (const Parameter& p : recording.table.all) {
      if (p.kind == ParameterKind::distortion) continue;
      const int size = p.pose ? 12 : p.size();
      const Parameter& q = other->table.all[&p - recording.table.all.data()];
      CHECK(values.segment(q.start, size) == recording.table.initial.segment(p.start, size));
    }
  }
}

TEST_CASE("other lens: the one that a camera has is named") {
  for (const Lens named : {Lens::kannala_brandt, Lens::brown_conrady}) {
    const Rig truth = arm(Lens::brown_conrady, kTangential);
    Rig rig = arm(named, std::vector<double>(named == Lens::brown_conrady ? 5 : 4, 0.0));
    const Recording recording(rig, logged(truth, 20, 5, 0.45));
    const AutomaticCalibration found = calibrate_automatically(recording, {});
    REQUIRE(found.solution.usable());
    const auto told = told_models(found.other_models, NoticeKind::intrinsics);
    const ParameterTable& table = found.solution.table();
    const Vector6d off =
        log_se3(inverse(truth.sensors[0].link_T_sensor) *
                get_pose(found.solution.values.shared, table.all[table.sensor_pose[0]].start));
    const Prediction& prediction = *found.solution.prediction;
    for (size_t i = 0; i < prediction.columns.size(); ++i)
      if (const Component& c = prediction.columns[i];
          c.parameter == table.sensor_pose[0] && (c.index == 3 || c.index == 4)) {
        const auto k = static_cast<Eigen::Index>(i);
        CHECK(std::abs(off(c.index)) < 3 * std::sqrt(prediction.covariance(k, k)));
      }
    REQUIRE(told.size() == (named == Lens::brown_conrady ? 0 : 1));
    if (!told.empty()) CHECK(told[0]->where == Subjects{Subject::sensor("eye")});
  }
}

}  // namespace other_lens_test
