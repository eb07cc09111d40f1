// models/analysis/joint_curves: error curves of joints with their standard deviations.
//
// Proves: of a joint with a quadratic term the curve and its sigma are those written out here, with
// the mean over the training samples at zero; of a joint whose model is `curve` values that no
// sample depends on and no step estimated are not determined, and only where they count; of a
// turning joint with wider limits one turn is drawn; a linear joint, and a curve that is fixed at
// zero, have none. Does not prove: that the sigmas are right (tests/program/curves_test.py has a
// simulated robot).
#include "../../../models/analysis/joint_curves.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/joints/joint_models.h"
#include "../../fixtures/quadratic_joint.h"
#include "../../fixtures/two_joints.h"

namespace joint_curves_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

Rig arm() {
  Rig rig;
  add_two_joints(rig, 1e-4);
  finish_tree(rig.tree);
  add_marks_and_tracker(rig);
  return rig;
}

/// A solution at the rig's values with these readings of the elbow; the last sample is held out.
Solution solution_at(Rig rig, const std::vector<double>& readings) {
  const int elbow = joint_index(rig, "elbow");
  std::vector<Sample> samples;
  for (const double q : readings) {
    samples.emplace_back();
    samples.back().readings.assign(rig.tree.joints.size(), 0);
    samples.back().readings[elbow] = q;
  }
  samples.back().train = false;
  Solution out;
  out.recording = make_recording(std::move(rig), std::move(samples));
  out.initial = out.values.shared = out.table().initial;
  return out;
}

}  // namespace

TEST_CASE("a quadratic term, and its sigma") {
  const bool backlash = GENERATE(false, true);  // which is no term of the curve
  Rig rig = arm();
  if (backlash) rig.joints[joint_index(rig, "elbow")].terms.backlash = 0.001;
  rig.tree.joints[joint_index(rig, "elbow")].lower = -1;
  rig.tree.joints[joint_index(rig, "elbow")].upper = 1.5;
  bend_joint(rig, "elbow", 0.01);
  Solution solution = solution_at(rig, {-0.5, 0.1, 0.7, 2});
  const int offset = solution.table().joint_offset[joint_index(rig, "elbow")];
  solution.columns = {{offset, 0}, {offset + 2, 0}};
  solution.covariance.resize(2, 2);
  solution.covariance << 1, 0.5, 0.5, 9e-6;
  if (backlash) {
    solution.columns.push_back({offset + 3, 0});
    solution.covariance.conservativeResizeLike(MatrixXd::Identity(3, 3));
  }
  const std::vector<JointCurve> curves = joint_curves(solution);
  REQUIRE(curves.size() == 1);
  const JointCurve& curve = curves[0];
  CHECK(curve.reading.front() == -1);
  CHECK(curve.reading.back() == 1.5);
  const double mean = (0.25 + 0.01 + 0.49) / 3;
  for (size_t i = 0; i < curve.reading.size(); ++i) {
    const double term = curve.reading[i] * curve.reading[i] - mean;
    CHECK(curve.error[i] == Approx(0.01 * term).margin(1e-15));
    CHECK(curve.sigma[i] == Approx(3e-3 * std::abs(term)).margin(1e-15));
  }
  const double a = 0.25 - mean, b = 0.01 - mean, c = 0.49 - mean;
  CHECK(curve.rms == Approx(0.01 * std::sqrt((a * a + b * b + c * c) / 3)));
}

TEST_CASE("a curve where no sample was") {
  Rig rig = arm();
  const int elbow = joint_index(rig, "elbow");
  rig.tree.joints[elbow].lower = -7;
  rig.tree.joints[elbow].upper = 7;
  rig.joints[elbow].model = find_joint_model(joint_models(), "curve");
  Solution solution = solution_at(rig, {0.01, 0.02, 0.2, 3});
  CHECK(joint_curves(solution).empty());
  const int curve = solution.table().joint_offset[elbow] + 2;
  const int count = solution.table().all[curve].size();
  for (int k = 0; k < 6; ++k) solution.columns.push_back({curve, k});  // readings up to 0.2
  solution.columns.push_back({curve, count - 1});
  solution.covariance = 4e-8 * MatrixXd::Identity(7, 7);
  solution.values.shared(solution.table().all[curve].start) = 1e-3;
  const std::vector<JointCurve> curves = joint_curves(solution);
  REQUIRE(curves.size() == 1);
  const JointCurve& found = curves[0];
  CHECK(found.reading.back() - found.reading.front() == Approx(2 * kPi));
  for (size_t i = 0; i < found.reading.size(); ++i) {
    const double q = found.reading[i], piece = 2 * kPi / count;
    if (q > 0 && q < 3 * piece) {
      CHECK(found.sigma[i] > 0);
      CHECK(found.sigma[i] < 4e-4);
    }
    if (q < -3 * piece || q > 8 * piece) CHECK(std::isnan(found.sigma[i]));
  }
  solution.prediction = Prediction{solution.columns, 4 * solution.covariance};
  const std::vector<JointCurve> predicted = joint_curves(solution);
  const size_t at =
      std::upper_bound(found.reading.begin(), found.reading.end(), 0.05) - found.reading.begin();
  CHECK(predicted[0].sigma[at] == Approx(2 * found.sigma[at]));
}

}  // namespace joint_curves_test
