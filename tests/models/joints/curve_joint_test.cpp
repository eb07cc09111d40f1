// models/joints/curve_joint.h, and that estimation takes a curve's values where they count.
//
// Proves: derivatives are those of position(); a turn further the error is the same; the numbers
// that do not count in a piece of the range have no part in the position, those that do are four;
// with the values of a function the curve is that function; every derivative of an Estimation
// whose samples touch other numbers each, column by column, one of them of a scanning joint. Does
// not prove: derivatives of frames; what it is good for (tests/program/curves_test.py).
#include "../../../models/joints/curve_joint.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/joints/joint_models.h"
#include "../../fixtures/open_recording.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/stacked.h"
#include "../../fixtures/study.h"

namespace curve_joint_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

std::vector<double> random_numbers(Random& random) {
  std::vector<double> own = {random.uniform(-0.3, 0.3), random.uniform(0.8, 1.2)};
  while (own.size() < 2 + CurveJoint::kValues) own.push_back(random.uniform(-0.01, 0.01));
  return own;
}

/// The nasty robot with a curve in a joint that others follow and in one that turns alone.
struct Curved : OpenRecording {
  Values values;

  Curved() : OpenRecording(make_rig()) {
    std::vector<TruePosture> postures;
    samples = nasty_samples(rig, 4, 43, &postures);
    Random random(3);
    values.shared = table.initial;
    for (const char* joint : {"elbow", "turn"}) {
      const Parameter& curve = table.all[parameter(joint)];
      for (int c = 0; c < curve.size(); ++c)
        values.shared(curve.start + c) = random.uniform(-0.01, 0.01);
    }
    for (size_t s = 0; s < samples.size(); ++s)
      for (const auto& [target, board] : postures[s].boards)
        values.targets[{static_cast<int>(s), target}] = to_pose(board);
  }
  int parameter(const std::string& joint) const {
    return table.select("joint/" + joint + "/curve").at(0).parameter;
  }
  static Rig make_rig() {
    Rig rig = nasty_robot();
    for (const char* joint : {"elbow", "turn"})
      rig.joints[joint_index(rig, joint)].model = find_joint_model(joint_models(), "curve");
    return rig;
  }
};

}  // namespace

TEST_CASE("curve joint: derivatives, period, and which values count where") {
  Random random(1);
  const CurveJoint model;
  for (int n = 0; n < 40; ++n) {
    std::vector<double> own = random_numbers(random);
    const double q = random.uniform(-9, 9), h = 1e-6;
    const auto error = [&](double reading) {
      return model.position(reading, own.data()) - own[1] * reading;
    };
    CHECK(error(q + 2 * kPi) == Approx(error(q)).margin(1e-12));
    CHECK(model.by_reading(q, own.data()) ==
          Approx((model.position(q + h, own.data()) - model.position(q - h, own.data())) / (2 * h))
              .epsilon(1e-7));
    int counting = 0;
    double sum = 0;
    for (int k = 0; k < model.size(); ++k) {
      std::vector<double> moved = own;
      moved[k] += 1;
      const double by = model.position(q, moved.data()) - model.position(q, own.data());
      CHECK(model.by_own(k, q, own.data()) == Approx(by).margin(1e-12));
      if (!model.depends(k, model.piece(q))) CHECK(by == 0);
      if (k >= 2) counting += model.depends(k, model.piece(q)), sum += by;
    }
    CHECK(counting == 4);
    CHECK(sum == Approx(1));
    CHECK(model.reading(model.position(q, own.data()), own.data()) == Approx(q).margin(1e-12));
  }
  CHECK(model.piece(std::nan("")) == 0);

  std::vector<double> own = {0.01, 1};  // a slow wave's values
  for (int k = 0; k < CurveJoint::kValues; ++k)
    own.push_back(0.002 * std::sin(3 * (2 * kPi * k / CurveJoint::kValues)));
  for (double q = -4; q < 4; q += 0.1)
    CHECK(model.position(q, own.data()) - q - 0.01 ==
          Approx(0.002 * std::sin(3 * q)).margin(0.002 * 0.007));
}

TEST_CASE("curve joint: its values are one parameter of many components") {
  const Curved s;
  const Parameter& curve = s.table.all[s.parameter("elbow")];
  CHECK(curve.size() == CurveJoint::kValues);
  CHECK(curve.component_name(5) == "joint/elbow/curve.5");
  CHECK(curve.units[5] == "rad");
  CHECK(curve.start == s.table.all[s.table.joint_offset[joint_index(s.rig, "elbow")]].start + 2);
  CHECK(s.table.select("joint/elbow/curve.95").at(0).components == std::vector<int>{95});
}

TEST_CASE("curve joint: every derivative of an estimation") {
  const Curved s;
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = all_sensors(s.rig);
  setup.free = freed(s.table, {"joint/elbow/*", "joint/turn/curve", "joint/shoulder/offset"});
  Estimation problem(s, s.training(), setup);
  problem.set_workers(1);
  const VectorXd state = problem.pack(s.values);
  problem.renew(state);
  problem.prepare(state);
  const Stacked analytic = stack(problem, state);
  const MatrixXd numeric = stacked_differences(problem, state, 1e-4);
  int touched = 0;
  for (Eigen::Index k = 0; k < analytic.j.cols(); ++k) {
    INFO("column " << k);
    CHECK((analytic.j.col(k) - numeric.col(k)).norm() <= 1e-6 * numeric.col(k).norm() + 1e-7);
    touched += k >= analytic.privates && numeric.col(k).norm() > 0;
  }
  CHECK(touched > 10);
  CHECK(touched < 2 * CurveJoint::kValues);  // most angles were not visited
}

}  // namespace curve_joint_test
