// models/monitor/monitor: samples of a calibrated robot, one at a time.
//
// An arm of two joints with noisy readings, five marks on it, a tracker and a camera that see them;
// samples by the independent forward model. Proves: innovations have the covariance that they are
// compared with, the calibration's own uncertainty in it (100 calibrations of six samples each; far
// from it without); a robot that stays as it was raises no alarm, and its noise factors are 1;
// where all noise is twice the stated one they are 2, and nothing has moved; noise that differs
// from sample to sample causes no outlier, and outliers and changes are found in it; a mount that
// moves is named, with its size and its sample, also where only some samples are outliers; one
// outlier is left out, several that nothing explains are no drift; wrong samples are refused and
// change nothing; a monitor that is saved and loaded goes on to the last bit, and a damaged state
// is refused; each sample has its own conditions (approach); what a window of samples recalibrates
// is the truth within its sigmas (50 robots), a window that does not show it says so. Does not
// prove: rates of false alarms (drift_watch_test.cpp) and robots of many sensors
// (program/monitor_test.py).
#include "../../../models/monitor/monitor.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "../../../models/calibration/calibration.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/transforms.h"
#include "../../fixtures/two_joints.h"

namespace monitor_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;

namespace {

Rig arm() {
  Rig rig;
  add_two_joints(rig, 0.0005);
  finish_tree(rig.tree);
  add_marks_and_tracker(rig);
  add_eye(rig);
  Step all;
  all.name = "all";
  all.sensors = {0, 1};
  all.free = {"sensor/*/pose", "joint/elbow/offset"};
  rig.steps = {all};
  return rig;
}

/// The arm as it really is: sensors some millimetres and milliradians off, the elbow by 20 mrad.
Rig real_arm() {
  Rig truth = arm();
  truth.joints[joint_index(truth, "elbow")].offset = 0.02;
  for (Sensor& s : truth.sensors)
    s.link_T_sensor =
        s.link_T_sensor * exp_se3((Vector6d() << 4e-3, -3e-3, 2e-3, 0.01, -5e-3, 8e-3).finished());
  return truth;
}

std::vector<Sample> logged(const Rig& truth, int count, Random& random) {
  std::vector<Sample> out;
  for (int n = 0; n < count; ++n) {
    const TruePosture p = random_posture(truth, random, 0.5, true);
    out.push_back(make_sample(truth, p, "s" + std::to_string(n)));
    for (const int sensor : {0, 1}) REQUIRE(add_view(out.back(), truth, sensor, 0, p, &random));
  }
  return out;
}

CalibratedState calibrated(std::vector<Sample> samples) {
  Calibration calibration(make_recording(arm(), std::move(samples)));
  const Solution& solution = calibration.solve();
  REQUIRE(solution.status == Status::converged);
  return {solution.rig(), solution.values.shared, solution.columns, solution.covariance, {}, {}};
}

std::string name_of(const Monitor& monitor, const Moved& moved) {
  return monitor.groups()[moved.group].name;
}

}  // namespace

TEST_CASE("monitor: innovations have the covariance that they are compared with") {
  double chi2 = 0, dof = 0, by_sensor = 0, of_sensor = 0, exactly = 0;
  int likely = 0, sensors = 0;
  for (unsigned long seed = 0; seed < 100; ++seed) {
    Random random(500 + seed);
    const Rig truth = real_arm();
    CalibratedState state = calibrated(logged(truth, 6, random));
    const Sample sample = logged(truth, 1, random)[0];
    const Innovation innovation = Monitor(state).add(sample);
    chi2 += innovation.chi2;
    dof += innovation.dof;
    for (const SensorInnovation& s : innovation.sensors) {
      by_sensor += s.chi2;
      of_sensor += s.dof;
      likely += s.probability < 0.5;
      ++sensors;
    }
    state.covariance.setZero();
    exactly += Monitor(state).add(sample).chi2;
  }
  REQUIRE(dof == 100 * 25);  // 15 coordinates and 10 pixels, no unknown of their own but errors
  CHECK(std::abs(chi2 / dof - 1) < 4 * std::sqrt(2 / dof));
  CHECK(std::abs(by_sensor / of_sensor - 1) < 4 * std::sqrt(2 / of_sensor));
  CHECK(exactly / dof > 1 + 5 * std::sqrt(2 / dof));
  REQUIRE(sensors == 200);
  CHECK(likely > 55);  // noise that differs from sample to sample is possible at the first
  CHECK(likely < 130);
}

TEST_CASE("monitor: a robot that stays as it was") {
  Random random(1);
  const Rig truth = real_arm();
  Monitor monitor(calibrated(logged(truth, 30, random)));
  for (const Sample& sample : logged(truth, 300, random)) {
    const Innovation innovation = monitor.add(sample);
    CHECK(innovation.state == SampleState::fits);
    CHECK_FALSE(innovation.alarm);
  }
  CHECK(monitor.samples() == 300);
  CHECK(monitor.outliers() == 0);
  for (const NoiseSeen& n : monitor.noise()) CHECK(std::abs(n.factor - 1) < 0.15);
  // The estimate is nearer to the truth than it says by no more than chance, and better than the
  // calibration's.
  CHECK(monitor.noise().size() == 4);  // two sensors, two joints
}

TEST_CASE("monitor: all noise twice the stated one is no drift") {
  Random random(2);
  Rig truth = real_arm();
  CalibratedState state = calibrated(logged(truth, 30, random));
  for (JointSettings& j : truth.joints) j.sigma *= 2;
  for (Sensor& s : truth.sensors)
    for (double& sigma : s.sigma) sigma *= 2;
  std::vector<Sample> samples = logged(truth, 300, random);
  Monitor monitor(std::move(state));
  for (Sample& sample : samples) {
    for (View& view : sample.views) view.sigma = monitor.rig().sensors[view.sensor].sigma;
    CHECK_FALSE(monitor.add(sample).alarm);
  }
  for (const NoiseSeen& n : monitor.noise()) CHECK(std::abs(n.factor - 2) < 0.35);
}

TEST_CASE("monitor: noise that differs from sample to sample") {
  for (unsigned long seed = 0; seed < 5; ++seed) {
    Random random(800 + seed);
    Rig truth = real_arm();
    Monitor monitor(calibrated(logged(truth, 30, random)));
    const auto next = [&] {  // sigmas of sensors off by a third
      Rig noisy = truth;
      for (Sensor& s : noisy.sensors) {
        const double factor = std::exp(0.3 * random.normal());
        for (double& sigma : s.sigma) sigma *= factor;
      }
      Sample out = logged(noisy, 1, random)[0];
      for (View& view : out.views) view.sigma = truth.sensors[view.sensor].sigma;
      return out;
    };
    for (int n = 0; n < 300; ++n) {
      const Innovation innovation = monitor.add(next());
      CHECK(innovation.state == SampleState::fits);
      CHECK_FALSE(innovation.alarm);
    }
    Sample wrong = next();
    wrong.views[1].z[3] += 40;  // px
    CHECK(monitor.add(wrong).state == SampleState::outlier);
    truth.sensors[0].link_T_sensor =
        truth.sensors[0].link_T_sensor * exp_se3((Vector6d() << 0, 0, 0, 0, 0.003, 0).finished());
    bool alarm = false;
    for (int n = 0; n < 6; ++n) alarm = monitor.add(next()).alarm;
    REQUIRE(alarm);
    CHECK(name_of(monitor, monitor.moved()[0]) == "sensor/tracker/pose");
  }
}

TEST_CASE("monitor: a mount that moves") {
  Random random(3);
  Rig truth = real_arm();
  Monitor monitor(calibrated(logged(truth, 30, random)));
  for (const Sample& sample : logged(truth, 50, random)) REQUIRE_FALSE(monitor.add(sample).alarm);
  const Vector6d change = (Vector6d() << 0.001, 0, 0, 0, 0.003, 0).finished();
  truth.sensors[0].link_T_sensor = truth.sensors[0].link_T_sensor * exp_se3(change);
  int delay = 0;
  bool alarm = false;
  for (const Sample& sample : logged(truth, 20, random)) {
    delay += !alarm;
    alarm = monitor.add(sample).alarm;
  }
  REQUIRE(alarm);
  CHECK(delay <= 4);
  const std::vector<Moved> moved = monitor.moved();
  CHECK(name_of(monitor, moved[0]) == "sensor/tracker/pose");
  CHECK(moved[0].probability > 0.95);
  CHECK(std::abs(moved[0].since - 50) <= 1);
  for (int i = 0; i < 6; ++i)
    CHECK(std::abs(moved[0].change(i) - change(i)) < 4 * moved[0].sigma(i));
  CHECK(moved[0].sigma(4) < 0.0003);
  // Accepted, it is what the robot is.
  monitor.restart(true);
  for (const Sample& sample : logged(truth, 100, random)) {
    const Innovation innovation = monitor.add(sample);
    CHECK(innovation.state == SampleState::fits);
    CHECK_FALSE(innovation.alarm);
  }
  const int ry = monitor.groups()[moved[0].group].columns[4];
  CHECK(std::abs(monitor.difference()(ry) - 0.003) < 5 * std::sqrt(monitor.covariance()(ry, ry)));
}

TEST_CASE("monitor: after an alarm nothing is forgotten") {
  // A change of which some samples are outliers and some are not: those that fit are no other
  // start, and neither the estimate nor the noise learns from them.
  for (unsigned long seed = 0; seed < 10; ++seed) {
    Random random(700 + seed);
    Rig truth = real_arm();
    Monitor monitor(calibrated(logged(truth, 30, random)));
    for (const Sample& sample : logged(truth, 50, random)) monitor.add(sample);
    const Vector6d change = (Vector6d() << 0, 0, 0, 0, 0.0012, 0).finished();
    truth.sensors[0].link_T_sensor = truth.sensors[0].link_T_sensor * exp_se3(change);
    int outliers = 0, fits = 0, alarms = 0;
    for (const Sample& sample : logged(truth, 60, random)) {
      const Innovation innovation = monitor.add(sample);
      outliers += innovation.state == SampleState::outlier;
      fits += innovation.state == SampleState::fits;
      alarms += innovation.alarm;
      CHECK_FALSE(innovation.unexplained);
    }
    CHECK(outliers > 0);
    CHECK(fits > 2);
    REQUIRE(alarms > 50);
    const Moved moved = monitor.moved().front();
    CHECK(name_of(monitor, moved) == "sensor/tracker/pose");
    CHECK(std::abs(moved.since - 50) <= 8);
    CHECK(std::abs(moved.change(4) - change(4)) < 4 * moved.sigma(4));
    // Noise may differ from sample to sample, so that some of the change counts as noise before the
    // alarm.
    for (const NoiseSeen& n : monitor.noise()) CHECK(std::abs(n.factor - 1) < 0.4);
  }
}

TEST_CASE("monitor: outliers") {
  Random random(4);
  const Rig truth = real_arm();
  const CalibratedState state = calibrated(logged(truth, 30, random));
  std::vector<Sample> samples = logged(truth, 60, random);
  samples[20].views[1].z[3] += 40;  // px
  // Two in a row that contradict each other.
  for (size_t i = 0; i < samples[40].views[0].z.size(); ++i)
    for (const int n : {40, 41}) samples[n].views[0].z[i] += 0.05 * random.normal();
  Monitor monitor(state);
  for (int n = 0; n < 60; ++n) {
    const Innovation innovation = monitor.add(samples[n]);
    const bool wrong = n == 20 || n == 40 || n == 41;
    CHECK((innovation.state == SampleState::outlier) == wrong);
    CHECK_FALSE(innovation.alarm);
    CHECK(innovation.unexplained == (n == 41));
    if (n == 20) CHECK(innovation.sensors[1].probability < 1e-6);  // the camera
  }
  CHECK(monitor.outliers() == 3);
}

TEST_CASE("monitor: samples that are not the rig's are refused and change nothing") {
  Random random(5);
  const Rig truth = real_arm();
  const CalibratedState state = calibrated(logged(truth, 30, random));
  const std::vector<Sample> samples = logged(truth, 3, random);
  Monitor one(state), other(state);
  const auto refused = [&](const char* why, auto change) {
    Sample wrong = samples[0];
    change(wrong);
    CHECK_THROWS_WITH(one.add(wrong), Contains(why));
  };
  refused("readings: one for every joint", [](Sample& s) { s.readings.pop_back(); });
  refused("readings: 'elbow' has none", [](Sample& s) { s.readings[1] = NAN; });
  refused("noise: one for every joint", [](Sample& s) { s.noise = {1}; });
  refused("views[1].sensor: the rig has no such sensor", [](Sample& s) { s.views[1].sensor = 2; });
  refused("views[0].target: the rig has no such target", [](Sample& s) { s.views[0].target = -1; });
  refused("views[0].ids: the target has no such point",
          [](Sample& s) { s.views[0].ids.own()[0] = 9; });
  refused("views[0].z: a number is not finite", [](Sample& s) { s.views[0].z[2] = INFINITY; });
  refused("views[1].z: 10 numbers are expected", [](Sample& s) { s.views[1].z.pop_back(); });
  CHECK(one.samples() == 0);
  for (const Sample& sample : samples) CHECK(one.add(sample).chi2 == other.add(sample).chi2);
  CalibratedState wrong = state;
  wrong.covariance.resize(2, 2);
  CHECK_THROWS_WITH(Monitor(wrong), Contains("covariance: a row and a column for every column"));
  wrong = state;
  wrong.values.conservativeResize(3);
  CHECK_THROWS_WITH(Monitor(wrong), Contains("values: as many are expected"));
}

TEST_CASE("monitor: saved and loaded it goes on to the last bit") {
  Random random(6);
  const Rig truth = real_arm();
  const CalibratedState state = calibrated(logged(truth, 30, random));
  std::vector<Sample> samples = logged(truth, 30, random);
  for (const int n : {9, 15, 16})  // one outlier waits when it is saved
    for (double& z : samples[n].views[0].z) z += 0.02;
  Monitor one(state), other(state);
  for (int n = 0; n < 10; ++n) one.add(samples[n]);
  const std::string bytes = one.save();
  other.load(bytes);
  CHECK(other.save() == bytes);
  for (int n = 10; n < 30; ++n) {
    const Innovation a = one.add(samples[n]), b = other.add(samples[n]);
    CHECK(a.chi2 == b.chi2);
    CHECK(a.log_odds == b.log_odds);
    CHECK(a.state == b.state);
  }
  CHECK(one.save() == other.save());
  CHECK(one.outliers() == 3);

  const std::string now = other.save();
  const auto refused = [&](const char* why, const std::string& wrong) {
    CHECK_THROWS_WITH(other.load(wrong), Contains(why));
    CHECK(other.save() == now);
  };
  refused("it is not that of a monitor", "");
  refused("it is not that of a monitor", "something else");
  refused("it is truncated", bytes.substr(0, 30));
  refused("it is truncated", bytes.substr(0, bytes.size() - 1));
  refused("it is too long", bytes + "x");
  std::string wrong = bytes;
  wrong[200] ^= 1;
  refused("its checksum is wrong", wrong);
  wrong = bytes;
  wrong[8] = 9;
  refused("another version", wrong);
  CalibratedState elsewhere = state;
  elsewhere.values(0) += 1e-3;
  CHECK_THROWS_WITH(Monitor(elsewhere).load(bytes), Contains("it belongs to another calibration"));
  MonitorOptions options;
  options.samples_between_alarms = 500;
  CHECK_THROWS_WITH(Monitor(state, options).load(bytes), Contains("or to other options"));
}

TEST_CASE("monitor: each sample has its own conditions, and a prepared form changes nothing") {
  Rig rig = arm();
  rig.joints[joint_index(rig, "elbow")].terms.backlash = 0.002;
  CalibratedState state{rig, ParameterTable(rig).initial, {}, {}, {}, {}};
  state.columns = components_of(freed(ParameterTable(rig), {"sensor/*/pose"}));
  const auto n = static_cast<Eigen::Index>(state.columns.size());
  state.covariance = 1e-8 * MatrixXd::Identity(n, n);
  Random random(23);
  std::vector<Sample> samples = logged(arm(), 2, random);
  for (const double side : {1.0, -1.0})
    samples[side > 0 ? 0 : 1].conditions.approach.assign(rig.joints.size(), side);
  Monitor prepared(state), fresh(state), wrong(state);
  prepared.prepare(samples[0]);
  CHECK(prepared.save() == fresh.save());
  const double chi2 = fresh.add(samples[1]).chi2;
  CHECK(prepared.add(samples[1]).chi2 == chi2);
  samples[1].conditions = samples[0].conditions;
  CHECK(std::abs(wrong.add(samples[1]).chi2 - chi2) > 1);
}

TEST_CASE("monitor: recalibration by a window") {
  const Vector6d change = (Vector6d() << 0.05, -0.02, 0.01, 0.02, 0.03, -0.01).finished();
  double squares = 0;
  for (unsigned long seed = 0; seed < 50; ++seed) {
    Random random(900 + seed);
    Rig truth = real_arm();
    const Monitor monitor(calibrated(logged(truth, 30, random)));
    truth.sensors[0].link_T_sensor = truth.sensors[0].link_T_sensor * exp_se3(change);
    std::vector<Sample> window = logged(truth, 10, random);
    for (double& z : window[3].views[0].z) z += 0.05 * random.normal();
    size_t tracker = 0;
    while (monitor.groups()[tracker].name != "sensor/tracker/pose") ++tracker;
    const Recalibration done = monitor.recalibrated(window, {static_cast<int>(tracker)});
    CHECK(done.samples == 9);
    const std::vector<int>& columns = monitor.groups()[tracker].columns;
    for (const int c : columns) CHECK_FALSE(done.undetermined[c]);
    const Pose found =
        get_pose(done.state.values, monitor.table().all[monitor.table().sensor_pose[0]].start);
    const Vector6d off = log_se3(inverse(truth.sensors[0].link_T_sensor) * found);
    const Matrix6d covariance = done.state.covariance(columns, columns);
    squares += fixture::dense::weighted_square(off, covariance);
    if (seed > 0) continue;
    // It is a calibration, which can be watched, and knows what the first one did not.
    Monitor next(done.state);
    for (const Sample& sample : logged(truth, 50, random)) {
      const Innovation innovation = next.add(sample);
      CHECK(innovation.state == SampleState::fits);
      CHECK_FALSE(innovation.alarm);
    }
  }
  CHECK(std::abs(squares / 300 - 1) < 4 * std::sqrt(2.0 / 300));

  // Nothing is determined by no sample.
  Random random(7);
  const Rig truth = real_arm();
  const Monitor monitor(calibrated(logged(truth, 30, random)));
  std::vector<int> all;
  for (int g = 0; g < static_cast<int>(monitor.groups().size()); ++g) all.push_back(g);
  const Recalibration done = monitor.recalibrated({}, all);
  CHECK(done.samples == 0);
  CHECK(done.change.norm() == 0);
  for (const DriftGroup& group : monitor.groups())
    for (const int c : group.columns) CHECK(done.undetermined[c]);
  CHECK_THROWS_WITH(monitor.recalibrated({}, {99}), Contains("groups: there is no such group"));
}

}  // namespace monitor_test
