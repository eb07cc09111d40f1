// models/analysis/{frames,held_out}.h, models/rig/folds.h, models/trials/cross_validation.h and
// models/report/requirements.h: predicted errors of frames, folds, intervals, cross-validation,
// tolerances.
//
// Proves: a frame's pose and its derivative by offsets, scales, origins (whole, and in part away
// from their start), mimic joints, poses of sensors and targets and noise of readings equal
// differences of an independent forward model, on a robot with every kind of joint; the predicted
// sigma equals the scatter of parameters drawn from the covariance and really moved, and the error
// against the truth over simulated robots; a direction that nothing determines is reported for the
// frames it moves and for no others. Folds do not depend on the order of the samples, have a K-th
// each, keep whole placements together and leave the fit something of every sensor; intervals cover
// as often as they say, also for few blocks of unlike size; cross-validation is what calibrations
// by hand give; tolerances take the split that they should. Does not prove: that folds are the best
// ones, or that intervals hold for blocks that depend on one another.
#include "../../../models/report/validation.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <catch2/catch.hpp>
#include <numeric>
#include <set>

#include "../../../models/estimation/estimation.h"
#include "../../../models/rig/parameters.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"
#include "../../fixtures/transforms.h"

namespace validation_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;

namespace {

Eigen::Matrix3Xd corners() {
  Eigen::Matrix3Xd p(3, 3);
  p << 0, 0.1, 0, 0, 0, 0.1, 0, 0.02, 0;
  return p;
}

/// A three-joint arm that a tracker on the ground watches: three reflectors on the tool.
Rig tracked_arm() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "turn", "base", "turret", {0, 0, 1}, at({0, 0, 0.4}), 0.0003);
  add_joint(rig, JointType::revolute, "lift", "turret", "upper", {0, 1, 0}, at({0.1, 0, 0.1}),
            0.0004);
  add_joint(rig, JointType::revolute, "bend", "upper", "fore", {0, 1, 0}, at({0.5, 0, 0}), 0.0005);
  add_joint(rig, JointType::fixed, "flange", "fore", "tool", {1, 0, 0},
            at({0.4, 0.05, 0}, {0, 0.3, 0}));
  add_joint(rig, JointType::fixed, "stand", "base", "stand", {1, 0, 0}, at({0, 1, 0}));
  finish_tree(rig.tree);
  for (Joint& j : rig.tree.joints) j.lower = -1.5, j.upper = 1.5;
  add_tracker(rig, "tracker", "base", at({2, 0.3, 0.5}, {0, 0, 2}), {0.0005, 0.0005, 0.0005});
  add_points(rig, "reflectors", corners(), "tool", at({0.05, 0, 0.02}));
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = {"sensor/tracker/pose", "joint/lift/offset",   "joint/bend/offset",
               "joint/bend/scale",    "joint/bend/origin.x", "joint/flange/origin.x"};
  rig.steps.push_back(step);
  return rig;
}

std::vector<Sample> simulated(const Rig& rig, const VectorXd& truth, int count, unsigned seed) {
  SimulationOptions options;
  options.seed = seed;
  options.samples = count;
  return simulate(rig, ParameterTable(rig), truth, options).samples;
}

VectorXd some_truth(const Rig& rig) {
  const ParameterTable table(rig);
  return draw_truth(table,
                    {{"sensor/tracker/pose", 0.02},
                     {"joint/*/offset", 0.02},
                     {"joint/bend/scale", 0.01},
                     {"joint/bend/origin.x", 0.005},
                     {"joint/flange/origin.x", 0.003},
                     {"joint/turn/offset", 0}},
                    7);
}

/// A hand with a 3-D camera, and blocks of three points put down at several places, one in a
/// sample.
Rig placed_blocks(int places) {
  Rig rig = tracked_arm();
  rig.sensors.clear();
  rig.targets.clear();
  add_tracker(rig, "eye", "tool", at({0, 0, 0.1}), {0.0005, 0.0005, 0.0005});
  for (int i = 0; i < places; ++i)
    add_points(rig, "place_" + std::to_string(i), corners(), "base",
               at({0.3 + 0.1 * i, -0.4 + 0.2 * i, 0.1}));
  rig.steps[0].free = {"target/*/pose", "joint/lift/offset", "joint/bend/offset"};
  rig.steps[0].sensors = {0};
  return rig;
}

std::vector<Sample> placed_samples(const Rig& rig, int each) {
  std::vector<Sample> out;
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    SimulationOptions options;
    options.seed = 20 + t;
    options.samples = each;
    options.pairs = {{0, static_cast<int>(t)}};
    for (Sample& s :
         simulate(rig, ParameterTable(rig), ParameterTable(rig).initial, options).samples) {
      s.id = rig.targets[t].name + "-" + s.id;
      out.push_back(s);
    }
  }
  return out;
}

Isometry3d base_T(const Rig& rig, const Frame& frame, const TruePosture& posture) {
  const Isometry3d base = root_T_link(rig, rig.base, posture),
                   link = root_T_link(rig, frame.link, posture);
  Isometry3d own = Isometry3d::Identity();
  for (const Sensor& s : rig.sensors)
    if (frame.name == "sensor/" + s.name) own = isometry(s.link_T_sensor);
  for (const Target& t : rig.targets)
    if (frame.name == "target/" + t.name) own = isometry(t.link_T_target);
  return base.inverse() * link * own;
}

std::vector<Sample> shuffled(std::vector<Sample> samples, unsigned long seed) {
  Random random(seed);
  for (size_t i = samples.size(); i > 1; --i)
    std::swap(samples[i - 1],
              samples[static_cast<size_t>(random.uniform(0, static_cast<double>(i)))]);
  return samples;
}

}  // namespace

TEST_CASE("frames: pose and derivative against an independent forward model", "[validation]") {
  const Rig rig = nasty_robot();
  const ParameterTable table(rig);
  Random random(3);
  // Away from the start in every component; origins of some joints freed in part.
  const std::vector<std::string> names = {
      "joint/*/offset",        "joint/*/scale",        "joint/pan/origin",
      "joint/floor/origin",    "joint/elbow/origin.x", "joint/elbow/origin.rz",
      "joint/elbow/origin.ry", "joint/nail/origin.y",  "joint/nail/origin.rx",
      "joint/lift/origin",     "joint/pole/origin",    "joint/flange/origin",
      "sensor/*/pose",         "target/marks/pose.z",  "target/marks/pose.rx",
      "target/wall/pose"};
  const std::vector<Freed> free = freed(table, names);
  Unknowns unknowns;
  std::map<int, Vector6d> xi;
  VectorXd values = table.initial;
  for (const Freed& f : free) {
    const Parameter& p = table.all[f.parameter];
    for (int c : f.components) unknowns.columns.push_back({f.parameter, c});
    if (!p.pose) {
      for (int c = 0; c < p.size(); ++c) values(p.start + c) += 0.02 * random.normal();
      continue;
    }
    xi[f.parameter] = random.twist(0.1, 0.4);
    for (int c = 0; c < 6; ++c)
      if (!std::count(f.components.begin(), f.components.end(), c)) xi[f.parameter](c) = 0;
    set_pose(values, p.start,
             to_pose(isometry(get_pose(table.initial, p.start)) * exponential(xi[f.parameter])));
    if (!f.whole(p)) unknowns.charts[f.parameter] = right_jacobian_se3(xi[f.parameter]);
  }
  const auto moved_by = [&](size_t column, double step) {
    const auto [parameter, component] = unknowns.columns[column];
    const Parameter& p = table.all[parameter];
    VectorXd out = values;
    if (!p.pose) {
      out(p.start + component) += step;
    } else if (unknowns.charts.count(parameter)) {
      Vector6d moved = xi[parameter];
      moved(component) += step;
      set_pose(out, p.start,
               to_pose(isometry(get_pose(table.initial, p.start)) * exponential(moved)));
    } else {
      set_pose(out, p.start,
               to_pose(isometry(get_pose(values, p.start)) *
                       exponential(step * Vector6d::Unit(component))));
    }
    return with_values(rig, table, out);
  };
  constexpr double h = 1e-5;
  for (const char* name : {"nail", "tool", "ground", "pole", "torso", "sensor/tracker",
                           "sensor/bc8", "sensor/grip", "target/marks", "target/wall"}) {
    const std::optional<Frame> frame = find_frame(rig, table, name);
    REQUIRE(frame);
    for (int n = 0; n < 3; ++n) {
      const TruePosture posture = random_posture(rig, random, 1.5, false);
      const Rig now = with_values(rig, table, values);
      const Isometry3d expected = base_T(now, *frame, posture);
      CHECK((isometry(base_T_frame(rig, table, values, *frame, posture.readings)).matrix() -
             expected.matrix())
                .norm() < 1e-12);
      const FrameDerivative d =
          frame_derivative(rig, table, values, unknowns, *frame, posture.readings);
      const auto difference = [&](const Isometry3d& up, const Isometry3d& down) {
        Vector6d out;
        out << (up.translation() - down.translation()) / (2 * h),
            rotation_vector(up.linear() * down.linear().transpose()) / (2 * h);
        return out;
      };
      for (size_t c = 0; c < unknowns.columns.size(); ++c) {
        const Vector6d numeric = difference(base_T(moved_by(c, h), *frame, posture),
                                            base_T(moved_by(c, -h), *frame, posture));
        INFO(name << " by " << table.name(unknowns.columns[c]));
        CHECK((d.by_unknowns.col(static_cast<Eigen::Index>(c)) - numeric).norm() < 1e-8);
      }
      // Noise of the readings: the sum over joints of the squared motion by one sigma.
      Matrix6d by_readings = Matrix6d::Zero();
      for (size_t j = 0; j < rig.joints.size(); ++j) {
        if (!rig.tree.joints[j].has_reading()) continue;
        TruePosture up = posture, down = posture;
        up.readings[j] += h;
        down.readings[j] -= h;
        const Vector6d motion =
            rig.joints[j].sigma * difference(base_T(now, *frame, up), base_T(now, *frame, down));
        by_readings += motion * motion.transpose();
      }
      CHECK((d.by_readings * d.by_readings.transpose() - by_readings).norm() < 1e-12);
    }
  }
  CHECK(!find_frame(rig, table, "nobody"));
  CHECK(!find_frame(rig, table, "target/board"));  // free: it has no place of its own
}

TEST_CASE("frames: random postures are within limits and the same for a seed", "[validation]") {
  Rig rig = nasty_robot();
  rig.tree.joints[joint_index(rig, "shoulder")].lower = 0.2;
  rig.tree.joints[joint_index(rig, "shoulder")].upper = 0.7;
  const std::vector<Readings> a = random_postures(rig, 500, 4), b = random_postures(rig, 500, 4),
                              c = random_postures(rig, 500, 5);
  double low = 9, high = -9;
  long same = 0, different = 0;
  for (size_t i = 0; i < a.size(); ++i)
    for (size_t j = 0; j < a[i].size(); ++j) {
      if (!rig.tree.joints[j].has_reading()) {
        CHECK(std::isnan(a[i][j]));
        continue;
      }
      same += a[i][j] == b[i][j];
      different += a[i][j] != c[i][j];
      CHECK(std::abs(a[i][j]) <= (rig.tree.joints[j].type == JointType::prismatic ? 0.5 : kPi));
      if (rig.tree.joints[j].name == "shoulder")
        low = std::min(low, a[i][j]), high = std::max(high, a[i][j]);
    }
  CHECK(same == different);
  CHECK(same > 4000);
  CHECK(low >= 0.2);
  CHECK(low < 0.22);
  CHECK(high <= 0.7);
  CHECK(high > 0.68);
}

TEST_CASE("frames: predicted sigma against parameters drawn from the covariance and really moved",
          "[validation]") {
  const Rig rig = tracked_arm();
  const Solution result = solution_of(rig, simulated(rig, some_truth(rig), 25, 11));
  REQUIRE(result.status == Status::converged);
  const ParameterTable& table = result.table();
  const Frame frame = *find_frame(rig, table, "tool");
  const FrameReport report = report_frame(result, last_unknowns(linearise(result)), frame);
  REQUIRE(report.workspaces.size() == 2);
  CHECK(report.workspaces[0].workspace == "samples");
  CHECK(report.workspaces[0].postures == 25);
  CHECK(report.workspaces[1].postures == 1000);
  CHECK(report.held.empty());
  CHECK(report.base == "base");

  Estimation problem(*result.recording, result.training(), result.setup);
  const VectorXd state = problem.pack(result.values);
  const fixture::dense::Spectrum eigen = fixture::dense::spectrum(result.covariance);
  const MatrixXd root = eigen.vectors * eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal();
  Random random(5);
  double position = 0, rotation = 0, position_read = 0, rotation_read = 0;
  constexpr int kDraws = 1500;
  for (int n = 0; n < kDraws; ++n) {
    VectorXd z(root.cols()), moved;
    for (Eigen::Index i = 0; i < z.size(); ++i) z(i) = random.normal();
    problem.retract(state, root * z, VectorXd::Zero(state.size()), moved);
    Values drawn = result.values;
    problem.unpack(moved, drawn);
    const Rig now = with_values(rig, table, result.values.shared),
              then = with_values(rig, table, drawn.shared);
    for (const Sample& s : result.samples()) {
      TruePosture posture = empty_posture(rig), read = posture;
      posture.readings = read.readings = s.readings;
      for (size_t j = 0; j < rig.joints.size(); ++j)
        read.errors[j] = rig.joints[j].sigma * random.normal();
      const Isometry3d is = base_T(now, frame, posture), was = base_T(then, frame, posture),
                       both = base_T(then, frame, read);
      position += (is.translation() - was.translation()).squaredNorm();
      rotation += rotation_vector(is.linear().transpose() * was.linear()).squaredNorm();
      position_read += (is.translation() - both.translation()).squaredNorm();
      rotation_read += rotation_vector(is.linear().transpose() * both.linear()).squaredNorm();
    }
  }
  const double n = kDraws * 25.0;
  const FrameSigma& sigma = report.workspaces[0];
  CHECK(sigma.position.rms == Approx(std::sqrt(position / n)).epsilon(0.03));
  CHECK(sigma.rotation.rms == Approx(std::sqrt(rotation / n)).epsilon(0.03));
  CHECK(sigma.position_with_readings.rms == Approx(std::sqrt(position_read / n)).epsilon(0.03));
  CHECK(sigma.rotation_with_readings.rms == Approx(std::sqrt(rotation_read / n)).epsilon(0.03));
  CHECK(sigma.position.median <= sigma.position.worst);
  CHECK(sigma.position.rms <= sigma.position.worst);
}

TEST_CASE("frames: predicted sigma against the truth over simulated robots", "[validation]") {
  const Rig rig = tracked_arm();
  const VectorXd truth = some_truth(rig);
  const ParameterTable table(rig);
  const Rig real = with_values(rig, table, truth);
  const Frame frame = *find_frame(rig, table, "tool");
  const std::vector<Readings> postures = random_postures(rig, 40, 9);
  double error = 0, predicted = 0;
  long n = 0;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    const Solution result = solution_of(rig, simulated(rig, truth, 15, seed));
    REQUIRE(result.status == Status::converged);
    const Unknowns unknowns = last_unknowns(linearise(result));
    const Rig estimated = with_values(rig, result.table(), result.values.shared);
    for (const Readings& readings : postures) {
      TruePosture posture = empty_posture(rig);
      posture.readings = readings;
      error += (base_T(estimated, frame, posture).translation() -
                base_T(real, frame, posture).translation())
                   .squaredNorm();
      const FrameDerivative d =
          frame_derivative(rig, table, result.values.shared, unknowns, frame, readings);
      predicted += (d.by_unknowns * unknowns.covariance * d.by_unknowns.transpose())
                       .diagonal()
                       .head<3>()
                       .sum();
      ++n;
    }
  }
  INFO("actual " << 1e3 * std::sqrt(error / n) << " mm, predicted "
                 << 1e3 * std::sqrt(predicted / n) << " mm");
  CHECK(std::sqrt(error / predicted) > 0.85);  // 60 draws of half a dozen numbers: 6 % of scatter
  CHECK(std::sqrt(error / predicted) < 1.15);
}

TEST_CASE("frames: a direction that nothing determines is reported where it moves the frame",
          "[validation]") {
  Rig rig = tracked_arm();
  rig.steps[0].free.push_back("joint/turn/offset");  // with the tracker's pose: turns everything
  const Solution result = solution_of(rig, simulated(rig, some_truth(rig), 20, 3));
  REQUIRE(result.status == Status::unobservable);
  REQUIRE(result.unobservable.size() == 1);
  const auto report_of = [](const Solution& solution, const char* name) {
    return report_frame(solution, last_unknowns(linearise(solution)),
                        *find_frame(solution.rig(), solution.table(), name));
  };
  const auto report = [&](const char* name) { return report_of(result, name); };
  const FrameReport tool = report("tool");
  CHECK(std::isnan(tool.workspaces[0].position.rms));
  CHECK(std::isnan(tool.workspaces[0].rotation.worst));
  CHECK(std::isnan(tool.workspaces[0].position_with_readings.rms));
  const FrameReport turret = report("turret");  // its origin lies on the axis
  CHECK(turret.workspaces[0].position.rms == Approx(0).margin(1e-12));
  CHECK(std::isnan(turret.workspaces[0].rotation.rms));
  CHECK(report("stand").workspaces[0].rotation.rms == 0);

  // A free number that no measurement depends on (the whole stand's place) harms its own frame
  // only.
  Rig other = tracked_arm();
  other.steps[0].free.push_back("joint/stand/origin.x");
  const Solution dead = solution_of(other, simulated(other, some_truth(other), 20, 3));
  REQUIRE(dead.status == Status::unobservable);
  CHECK(std::isnan(report_of(dead, "stand").workspaces[0].position.rms));
  CHECK(report_of(dead, "stand").workspaces[0].rotation.rms == 0);
  CHECK(report_of(dead, "tool").workspaces[0].position.rms > 1e-6);
}

TEST_CASE("frames: a direction that nothing determines leaves what it does not touch",
          "[validation]") {
  // Two arms, each with a tracker of its own. The place of the second is not told from the zero of
  // its first joint: that is nothing to the first arm, though both are estimated together.
  Rig rig = tracked_arm();
  add_joint(rig, JointType::revolute, "turn_2", "base", "turret_2", {0, 0, 1}, at({0, -1, 0.4}),
            0.0003);
  add_joint(rig, JointType::revolute, "lift_2", "turret_2", "tool_2", {0, 1, 0}, at({0.1, 0, 0.1}),
            0.0004);
  finish_tree(rig.tree);
  for (Joint& j : rig.tree.joints) j.lower = -1.5, j.upper = 1.5;
  add_tracker(rig, "tracker_2", "base", at({2, -0.7, 0.5}, {0, 0, 2}), {0.0005, 0.0005, 0.0005});
  add_points(rig, "reflectors_2", corners(), "tool_2", at({0.05, 0, 0.02}));
  rig.steps[0].sensors = {0, 1};
  for (const char* name : {"sensor/tracker_2/pose", "joint/lift_2/offset"})
    rig.steps[0].free.push_back(name);
  SimulationOptions options;
  options.seed = 3;
  options.samples = 20;
  options.pairs = {{0, 0}, {1, 1}};
  const std::vector<Sample> samples =
      simulate(rig, ParameterTable(rig), some_truth(rig), options).samples;
  const Solution known = solution_of(rig, samples);
  REQUIRE(known.status == Status::converged);
  rig.steps[0].free.push_back("joint/turn_2/offset");
  const Solution open = solution_of(rig, samples);
  REQUIRE(open.status == Status::unobservable);

  const auto sigma_of = [](const Solution& solution, const char* name) {
    return report_frame(solution, last_unknowns(linearise(solution)),
                        *find_frame(solution.rig(), solution.table(), name))
        .workspaces[0];
  };
  for (const char* name : {"tool", "sensor/tracker", "target/reflectors"}) {
    INFO(name);
    CHECK(sigma_of(open, name).position.rms ==
          Approx(sigma_of(known, name).position.rms).epsilon(1e-3));
    CHECK(sigma_of(open, name).rotation.rms ==
          Approx(sigma_of(known, name).rotation.rms).epsilon(1e-3));
  }
  for (const char* name : {"tool_2", "sensor/tracker_2"})
    CHECK(std::isnan(sigma_of(open, name).rotation.rms));
  const std::map<int, Matrix3d> covariances =
      position_covariances(open, last_unknowns(linearise(open)));
  CHECK(covariances.count(open.table().target_pose[0]) == 1);
  CHECK(covariances.count(open.table().sensor_pose[0]) == 1);
  CHECK(covariances.count(open.table().sensor_pose[1]) == 0);
}

TEST_CASE("frames: what the last step holds is taken as exact and named", "[validation]") {
  Rig rig = tracked_arm();
  Step last = rig.steps[0];
  last.name = "last";
  last.free = {"sensor/tracker/pose", "joint/lift/offset"};
  rig.steps.push_back(last);
  const Solution result = solution_of(rig, simulated(rig, some_truth(rig), 20, 3));
  const FrameReport report = report_frame(result, last_unknowns(linearise(result)),
                                          *find_frame(rig, result.table(), "fore"));
  CHECK(report.held ==
        std::vector<std::string>{"joint/bend/offset", "joint/bend/scale", "joint/bend/origin.x"});
}

TEST_CASE("folds: a K-th each, whatever the order, and something of every sensor stays",
          "[validation]") {
  Rig rig = tracked_arm();
  add_tracker(rig, "rare", "base", at({2, -0.3, 0.5}), {0.0005, 0.0005, 0.0005});
  rig.steps[0].sensors = {0, 1};
  rig.steps[0].free.push_back("sensor/rare/pose");
  std::vector<Sample> samples = simulated(tracked_arm(), some_truth(tracked_arm()), 43, 2);
  for (int i : {4, 17, 30}) {
    View rare = samples[i].views[0];
    rare.sensor = 1;
    samples[i].views.push_back(rare);
  }
  samples[5].train = false;
  const Folds folds = deal_folds(rig, samples, 5);
  CHECK(!folds.by_target());
  CHECK(folds.of[5] == -1);
  std::vector<int> count(5, 0);
  for (int f : folds.of)
    if (f >= 0) ++count[f];
  for (int c : count) CHECK((c == 8 || c == 9));
  CHECK(std::accumulate(count.begin(), count.end(), 0) == 42);
  CHECK((std::set<int>{folds.of[4], folds.of[17], folds.of[30]}.size() ==
         3));  // the rare ones are spread
  CHECK(folds.held_out(-1).empty());

  for (unsigned long seed : {1, 2, 3}) {
    const std::vector<Sample> other = shuffled(samples, seed);
    const Folds again = deal_folds(rig, other, 5);
    for (size_t i = 0; i < other.size(); ++i) {
      const auto at = std::find_if(samples.begin(), samples.end(),
                                   [&](const Sample& s) { return s.id == other[i].id; });
      CHECK(again.of[i] == folds.of[at - samples.begin()]);
    }
    for (int f = 0; f < 5; ++f) CHECK(again.held_out(f) == folds.held_out(f));
  }

  // The only sample of a sensor is never held out.
  samples[4].views.pop_back();
  samples[17].views.pop_back();
  const Folds lonely = deal_folds(rig, samples, 5);
  CHECK(lonely.of[30] == -1);
  CHECK(lonely.held_out(-1) == std::vector<std::string>{samples[30].id});

  CHECK_THROWS_WITH(deal_folds(rig, samples, 60), Contains("60 folds of 41 training samples"));
}

TEST_CASE("folds: placements are held out whole", "[validation]") {
  const Rig rig = placed_blocks(5);
  std::vector<Sample> samples = placed_samples(rig, 6);
  for (size_t i = 0; i < 6; ++i)
    samples[i].train = false;  // the first placement is held out by the file
  const Folds folds = deal_folds(rig, samples, 4);
  CHECK(folds.by_target());
  for (int f = 0; f < 4; ++f) REQUIRE(folds.held_out(f).size() == 1);
  for (size_t i = 6; i < samples.size(); ++i) {
    CHECK(folds.of[i] == folds.of[6 * (i / 6)]);
    CHECK(folds.held_out(folds.of[i])[0] == rig.targets[samples[i].views[0].target].name);
  }
  CHECK_THROWS_WITH(deal_folds(rig, samples, 5),
                    Contains("5 folds of 4 parts") && Contains("place_1") && Contains("place_4"));

  // Known places, and several places in one sample, are nothing to hold out whole.
  Rig known = rig;
  known.steps[0].free = {"joint/lift/offset", "joint/bend/offset"};
  CHECK(!deal_folds(known, samples, 5).by_target());
  std::vector<Sample> together = samples;
  together[7].views.push_back(together[20].views[0]);
  CHECK(!deal_folds(rig, together, 5).by_target());
}

TEST_CASE("intervals cover as often as they say", "[validation]") {
  // The formula, by hand: two parts of the logarithm's jackknife, t = 4.3027 (2 degrees of
  // freedom).
  const Interval three = rms_interval({1, 2, 4}, {1, 1, 1});
  const double theta[] = {std::log(3.0), std::log(2.5), std::log(1.5)},
               mean = (theta[0] + theta[1] + theta[2]) / 3;
  double e = 0;
  for (double t : theta) e += (t - mean) * (t - mean) * 2 / 3;
  CHECK(three.low ==
        Approx(std::sqrt(7.0 / 3) * std::exp(-4.30265 * std::sqrt(e) / 2)).epsilon(1e-5));
  CHECK(three.high ==
        Approx(std::sqrt(7.0 / 3) * std::exp(4.30265 * std::sqrt(e) / 2)).epsilon(1e-5));
  CHECK(std::isnan(rms_interval({1, 2}, {1, 1}).low));
  CHECK(std::isnan(rms_interval({0, 2, 0}, {1, 1, 1}).low));
  CHECK(rms_interval({0, 0, 0}, {1, 1, 1}).high == 0);

  // Blocks of 3 to 12 points; each block has an error of its own besides that of its points, as
  // samples with noisy joints have.
  Random random(17);
  for (int blocks : {5, 8, 20, 100}) {
    long covered = 0;
    constexpr int kTrials = 4000;
    for (int n = 0; n < kTrials; ++n) {
      std::vector<double> squares;
      std::vector<long> points;
      for (int b = 0; b < blocks; ++b) {
        const long count = 3 + static_cast<long>(random.uniform(0, 10));
        const Vector3d own(random.normal(), random.normal(), random.normal());
        double squared = 0;
        for (long k = 0; k < count; ++k)
          for (int i = 0; i < 3; ++i) squared += std::pow(own(i) + random.normal(), 2);
        squares.push_back(squared);
        points.push_back(count);
      }
      const Interval i = rms_interval(squares, points);
      covered += i.low <= std::sqrt(6.0) && std::sqrt(6.0) <= i.high;  // 3 components of variance 2
    }
    INFO(blocks << " blocks: " << 100.0 * covered / kTrials << " %");
    CHECK(covered > 0.90 * kTrials);
    CHECK(covered < 0.97 * kTrials);
  }
}

TEST_CASE("cross-validation is what calibrations by hand give", "[validation]") {
  const Rig rig = placed_blocks(5);
  for (bool by_target : {true, false}) {
    Rig here = rig;
    if (!by_target) here.steps[0].free = {"sensor/eye/pose", "joint/lift/offset"};
    std::vector<Sample> samples = placed_samples(rig, 6);
    for (size_t i = 0; i < samples.size(); i += 5) samples[i].train = false;  // takes no part
    if (by_target)
      for (size_t i = 0; i < samples.size(); ++i) samples[i].train = i >= 6;
    const Solution result = solution_of(here, samples);
    const Residuals whole = residuals_of(result);
    const CrossValidation cross = *cross_validate(result.recording, {}, 4);
    CHECK(cross.by_target == by_target);
    REQUIRE(cross.folds.size() == 4);
    REQUIRE(cross.sensors.size() == 1);
    double squared = 0, read = 0;
    long points = 0;
    const Folds folds = deal_folds(here, samples, 4);
    for (int f = 0; f < 4; ++f) {
      CHECK(cross.folds[f].converged);
      CHECK(cross.folds[f].determined);
      std::vector<Sample> split;
      for (size_t i = 0; i < samples.size(); ++i)
        if (samples[i].train) {
          split.push_back(samples[i]);
          split.back().train = folds.of[i] != f;
        }
      const Solution one = solution_of(here, split);
      CHECK(one.steps[0].held_out.size() == (by_target ? 1 : 0));
      const SplitStatistics test = residuals_of(one).sensors[0].test;
      squared += test.rms * test.rms * test.points;
      read += test.rms_as_read * test.rms_as_read * test.points;
      points += test.points;
    }
    const HeldOutError& e = cross.sensors[0];
    CHECK(e.points == points);
    CHECK(e.points == 3 * static_cast<long>(result.training().size()));
    CHECK(e.missing == 0);
    CHECK(e.blocks == (by_target ? 4 : static_cast<long>(result.training().size())));
    CHECK(e.by_target == by_target);
    CHECK(e.rms == Approx(std::sqrt(squared / points)).epsilon(1e-12));
    CHECK(e.rms_as_read == Approx(std::sqrt(read / points)).epsilon(1e-12));
    CHECK(e.of_rms.low < e.rms);
    CHECK(e.of_rms.high > e.rms);

    // The result's own test split, with intervals.
    const std::vector<HeldOutError> test = held_out_errors(result, whole);
    REQUIRE(test.size() == 1);
    CHECK(test[0].points == whole.sensors[0].test.points);
    CHECK(test[0].rms == Approx(whole.sensors[0].test.rms).epsilon(1e-12));
    CHECK(test[0].rms_as_read == Approx(whole.sensors[0].test.rms_as_read).epsilon(1e-12));

    // Nothing of it depends on the order of the samples.
    const CrossValidation again =
        *cross_validate(make_recording(here, shuffled(samples, 8)), {}, 4);
    CHECK(again.sensors[0].rms_as_read == Approx(e.rms_as_read).epsilon(1e-6));
    for (int f = 0; f < 4; ++f) CHECK(again.folds[f].held_out == cross.folds[f].held_out);

    CalibrationOptions cancel;
    int calls = 0;
    cancel.progress = Progress([&](const Progress::News&) { return ++calls < 8; });
    CHECK(!cross_validate(result.recording, cancel, 4));
  }
}

TEST_CASE("tolerances are judged on data that the fit did not see", "[validation]") {
  Validation validation;
  std::vector<SensorResult> sensors;
  const auto judged = [&](const Requirement& requirement) {
    return judge_requirement(requirement, validation, sensors, 1.2);
  };
  SensorResult sensor;
  sensor.name = "tracker";
  sensor.unit = "m";
  sensor.train.rms_as_read = 0.0001;
  sensors.push_back(sensor);
  Requirement r;
  r.text = "sensor/tracker<0.2mm";
  r.name = "tracker";
  r.limit = 0.0002;
  r.unit = "mm";
  r.factor = 1e-3;
  CHECK(judged(r).from == "train");
  CHECK(judged(r).met);
  CHECK_THAT(judgement_text(judged(r)),
             Contains("sensor/tracker<0.2mm: 0.1 mm") && Contains("training"));
  HeldOutError e;
  e.sensor = "tracker";
  e.points = 10;
  e.rms_as_read = 0.0003;
  validation.cross_validation.emplace();
  validation.cross_validation->sensors = {e};
  CHECK(judged(r).from == "cross_validation");
  CHECK(!judged(r).met);
  e.rms_as_read = 0.00019;
  validation.test = {e};
  CHECK(judged(r).from == "test");
  CHECK(judged(r).met);
  validation.test[0].missing = 1;  // a view that cannot even be evaluated is no success
  CHECK(!judged(r).met);
  CHECK_THAT(judgement_text(judged(r)), Contains("1 held-out views cannot be evaluated"));

  Requirement chi2;
  chi2.text = "chi2/dof<1.5";
  chi2.quantity = Requirement::Quantity::chi2_per_dof;
  chi2.limit = 1.5;
  CHECK(judged(chi2).measured == Approx(1.2));
  CHECK(judged(chi2).met);
  Requirement frame;
  frame.text = "frame/tool<1mm";
  frame.quantity = Requirement::Quantity::frame;
  frame.name = "tool";
  frame.limit = 1e-3;
  frame.factor = 1e-3;
  frame.unit = "mm";
  FrameReport report;
  report.frame = "tool";
  report.workspaces.push_back(
      {"samples", 3, {0.0005, 0.0005, 0.0005}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}});
  validation.frames.push_back(report);
  CHECK(judged(frame).met);
  validation.frames[0].workspaces[0].position = {std::nan(""), std::nan(""), std::nan("")};
  CHECK(!judged(frame).met);
  CHECK_THAT(judgement_text(judged(frame)), Contains("unknown") && Contains("do not determine"));
  validation.requirements = {judged(chi2), judged(frame)};
  CHECK(!validation.met());
}

TEST_CASE("held-out placements that the rig gives no pose for are started from their samples") {
  Rig rig = placed_blocks(3);
  std::vector<Sample> samples = placed_samples(rig, 8);
  for (Sample& s : samples) s.train = s.id.rfind("place_1", 0) != 0;
  // Far from the identity, and turned by half a turn: no iteration finds it from there.
  rig.targets[1].link_T_target = at({0.4, -0.2, 0.1});
  const Report given = study_of(rig, samples);
  for (Target& t : rig.targets) t.link_T_target = Pose(), t.pose_given = false;
  const Report absent = study_of(rig, samples);
  REQUIRE(given.validation.test.size() == 1);
  REQUIRE(absent.validation.test.size() == 1);
  CHECK(absent.validation.test[0].missing == 0);
  CHECK(absent.validation.test[0].points == given.validation.test[0].points);
  CHECK(absent.validation.test[0].rms == Approx(given.validation.test[0].rms).epsilon(1e-4));
}

TEST_CASE("held-out placements are estimated where a free of the caller names them") {
  Rig rig = placed_blocks(3);
  std::vector<Sample> samples = placed_samples(rig, 8);
  for (Sample& s : samples) s.train = s.id.rfind("place_1", 0) != 0;
  rig.targets[1].link_T_target = at({0.45, -0.25, 0.12}, {0.05, 0, 0.1});
  const Report in_step = study_of(rig, samples);
  rig.steps[0].free = {"target/place_0/pose", "target/place_2/pose", "joint/lift/offset",
                       "joint/bend/offset"};
  CalibrationOptions options;
  options.free = {"target/place_1/pose"};
  const Report by_caller = study_of(rig, samples, options);
  CHECK(by_caller.validation.test[0].rms == in_step.validation.test[0].rms);
  for (const Notice& w : by_caller.warnings) CHECK(w.kind != NoticeKind::no_effect);
  CHECK(by_caller.solution.steps[0].held_out == in_step.solution.steps[0].held_out);
}

TEST_CASE("evaluate: a pose that the rig leaves open is estimated in each split") {
  Rig rig = placed_blocks(3);
  std::vector<Sample> samples = placed_samples(rig, 8);
  for (Sample& s : samples) s.train = s.id.rfind("place_1", 0) != 0;
  const Evaluation given = evaluate(Recording(rig, samples), NoiseMode::none, {"target/*/pose"});
  CHECK(given.open.empty());
  for (Target& t : rig.targets) t.link_T_target = Pose(), t.pose_given = false;
  const Evaluation open = evaluate(Recording(rig, samples), NoiseMode::none, {});
  CHECK(open.converged);
  CHECK(open.open.size() == 3);
  CHECK(open.chi2 == Approx(given.chi2).epsilon(1e-6));
  CHECK(open.dof == given.dof);
}

}  // namespace validation_test
