// models/automatic: the automatic path as a whole, on simulated robots.
//
// Proves, on an arm with a camera in its hand that looks at a board on its base, with noise of
// readings and pixels from the independent forward model: a board of another size and joints'
// offsets are found, and what is right is put back exactly; errors of frames relative to the base
// and of the board as the camera sees it stay within three predicted sigmas at fresh postures; a
// robot that is as drawn stays so to the last bit; joints that no measurement sees count in them;
// one or two samples never give a calibration; what is fixed is in no step; it can be cancelled
// wherever it is; the order of samples does not matter; the error that more samples would lower is
// the one that the covariance predicts; lengths of another robot are unusual, and a first length
// that nothing measures is covered by the predicted error then. Does not prove: that predictions
// are right on average (too few robots: that was measured over hundreds of them), nor anything of
// robots with other sensors.
#include "../../../models/automatic/automatic.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>

#include "../../../models/analysis/frames.h"
#include "../../../models/analysis/noise_levels.h"
#include "../../../models/design/design.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"

namespace automatic_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

constexpr int kJoints = 6;
const Vector3d kMountShift{6e-3, -4e-3, 5e-3}, kMountTurn{0.02, -0.015, 0.01};

/// base -a1(z)- -a2(y)- -a3(y)- -a4(x)- -a5(y)- -a6(x)- hand with a camera that looks down at a
/// board on the base.
Rig drawn() {
  Rig rig;
  const std::string parent = add_arm(rig, 1e-4);
  add_camera(rig, "eye", parent, at({0.03, 0, -0.05}, {kPi, 0, 0}));
  add_grid(rig, "board", 5, 6, 0.04, "base", at({0.4, -0.1, 0.05}));
  return rig;
}

/// The same with the mounts elsewhere, as any robot's are.
Rig built() {
  Rig rig = drawn();
  Vector6d xi;
  xi << kMountShift, kMountTurn;
  rig.sensors[0].link_T_sensor = rig.sensors[0].link_T_sensor * exp_se3(xi);
  rig.targets[0].link_T_target = rig.targets[0].link_T_target * exp_se3(-xi);
  return rig;
}
Rig with_large_board() {
  Rig rig = built();
  rig.targets[0].square *= 1.02;
  return rig;
}
Rig with_offsets(unsigned long seed, double size = 0.01) {
  Rig rig = built();
  Random random(seed);
  for (int j = 0; j < kJoints; ++j) rig.joints[j].offset = size * random.normal();
  return rig;
}

TruePosture looking(const Rig& truth, Random& random, bool noise) {
  for (int tries = 0; tries < 1000; ++tries) {
    const TruePosture p = random_posture(truth, random, 0.45, noise);
    if (see(truth, 0, 0, p)) return p;
  }
  throw std::logic_error("nothing to be seen");
}

std::vector<Sample> logged(const Rig& truth, int count, unsigned long seed) {
  Random random(seed);
  std::vector<Sample> out;
  for (int n = 0; n < count; ++n) {
    const TruePosture p = looking(truth, random, true);
    out.push_back(make_sample(truth, p, "s" + std::to_string(n)));
    if (!add_view(out.back(), truth, 0, 0, p, &random)) throw std::logic_error("not seen");
  }
  return out;
}

AutomaticCalibration calibrated(const Rig& truth, int count, unsigned long seed,
                                const AutomaticOptions& options = {}) {
  return calibrate_automatically(Recording(drawn(), logged(truth, count, seed)), options);
}

const AutomaticGroup& group(const AutomaticCalibration& found, const std::string& name) {
  for (const AutomaticGroup& g : found.groups)
    if (g.name == name) return g;
  FAIL("no group " << name);
  return found.groups[0];
}

std::string described(const AutomaticCalibration& found) {
  std::string out;
  for (const AutomaticGroup& g : found.groups)
    out += g.name + ": factor " + std::to_string(g.factor) + ", gamma " + std::to_string(g.gamma) +
           " of " + std::to_string(g.numbers.size()) + ", gain " + std::to_string(g.gain) +
           (g.held ? ", held\n" : "\n");
  return out;
}

/// Root mean squares over fresh postures.
struct Told {
  double actual = 0, predicted = 0;
};

/// The position of a frame relative to the base.
Told of_frame(const Solution& solution, const Rig& truth, const std::string& name) {
  const Unknowns unknowns = last_unknowns(linearise(solution));
  const Rig& rig = solution.rig();
  const Frame frame = find_frame(rig, solution.table(), name).value();
  const ParameterTable table(truth);
  Random random(99);
  constexpr int kPostures = 50;
  Told out;
  for (int n = 0; n < kPostures; ++n) {
    const TruePosture p = looking(truth, random, false);
    const Pose found =
        base_T_frame(rig, solution.table(), solution.values.shared, frame, p.readings);
    const Pose actual =
        to_pose(name == "sensor/eye" ? root_T_sensor(truth, 0, p) : root_T_target(truth, 0, p));
    const MatrixXd j =
        frame_derivative(rig, solution.table(), solution.values.shared, unknowns, frame, p.readings)
            .by_unknowns.topRows(3);
    out.actual += (found.translation - actual.translation).squaredNorm() / kPostures;
    out.predicted += (j * unknowns.covariance * j.transpose()).trace() / kPostures;
  }
  return {std::sqrt(out.actual), std::sqrt(out.predicted)};
}

/// The board's corners in the camera.
Told of_corners(const Solution& solution, const Rig& truth) {
  const Unknowns unknowns = last_unknowns(linearise(solution));
  const ParameterTable& table = solution.table();
  const VectorXd& values = solution.values.shared;
  const Rig now = with_values(solution.rig(), table, values);
  const Frame eye = *find_frame(solution.rig(), table, "sensor/eye"),
              board = *find_frame(solution.rig(), table, "target/board");
  const Component square{table.target_square[0], 0};
  Random random(98);
  constexpr int kPostures = 50;
  const std::vector<int> corners = {0, 5, 24, 29};
  Told out;
  for (int n = 0; n < kPostures; ++n) {
    const TruePosture p = looking(truth, random, false);
    const MatrixXd
        by_eye =
            frame_derivative(solution.rig(), table, values, unknowns, eye, p.readings).by_unknowns,
        by_board = frame_derivative(solution.rig(), table, values, unknowns, board, p.readings)
                       .by_unknowns;
    const Isometry3d s = root_T_sensor(now, 0, p), t = root_T_target(now, 0, p);
    for (const int corner : corners) {
      const Vector3d arm = t.linear() * target_point(now.targets[0], corner),
                     apart = t.translation() + arm - s.translation();
      MatrixXd j = by_board.topRows(3) - cross_matrix(arm) * by_board.bottomRows(3) -
                   by_eye.topRows(3) + cross_matrix(apart) * by_eye.bottomRows(3);
      for (size_t c = 0; c < unknowns.columns.size(); ++c)
        if (unknowns.columns[c] == square)
          j.col(static_cast<Eigen::Index>(c)) += t.linear() * now.targets[0].layout.col(corner);
      const double share = 1.0 / (kPostures * static_cast<double>(corners.size()));
      out.predicted += share * (j * unknowns.covariance * j.transpose()).trace();
      out.actual +=
          share * (s.inverse() * (t * target_point(now.targets[0], corner)) -
                   sensor_T_target(truth, 0, 0, p) * target_point(truth.targets[0], corner))
                      .squaredNorm();
    }
  }
  return {std::sqrt(out.actual), std::sqrt(out.predicted)};
}

void check_errors(const AutomaticCalibration& found, const Rig& truth) {
  for (const char* frame : {"sensor/eye", "target/board"}) {
    const Told told = of_frame(found.solution, truth, frame);
    INFO(frame << ": off by " << told.actual * 1e3 << " mm, predicted " << told.predicted * 1e3);
    CHECK(told.actual < 3 * told.predicted);
    CHECK(told.predicted < 0.02);
  }
  const Told told = of_corners(found.solution, truth);
  INFO("corners off by " << told.actual * 1e3 << " mm, predicted " << told.predicted * 1e3);
  CHECK(told.actual < 3 * told.predicted);
  CHECK(told.predicted < 0.003);
}

/// Checks that numbers of groups that are held are as drawn to the last bit.
void check_held(const AutomaticCalibration& found) {
  const Solution& s = found.solution;
  for (const Parameter& p : s.table().all) {
    if (p.kind == ParameterKind::sensor_pose || p.kind == ParameterKind::target_pose) continue;
    bool held = true;
    for (const AutomaticGroup& g : found.groups)
      for (const AutomaticNumber& n : g.numbers)
        for (int c = 0; c < p.size(); ++c) held = held && (n.held || n.name != p.component_name(c));
    if (!held) continue;
    INFO(p.name);
    const int size = p.pose ? 12 : p.size();
    CHECK(s.values.shared.segment(p.start, size) == s.table().initial.segment(p.start, size));
  }
  for (const AutomaticGroup& g : found.groups)
    for (const AutomaticNumber& n : g.numbers) {
      INFO(n.name);
      CHECK((n.held || !g.held));
      if (n.held) CHECK(n.value == 0);
      CHECK(n.sigma > 0);
    }
}

}  // namespace

TEST_CASE("automatic: more data lower the error that is predicted") {
  const AutomaticCalibration found = calibrated(built(), 20, 5);
  const Solution& solution = found.solution;
  REQUIRE(solution.prediction);
  const Linearisation at = linearise(solution);
  const std::optional<MoreData> more = more_data(at, *solution.data);
  REQUIRE(more);
  const Unknowns unknowns = last_unknowns(at);
  CalibratedRobot robot{&solution.rig(), &solution.table(), solution.values.shared, unknowns};
  const DesignGoal goal = sight_goal(robot, solution.samples());  // not more than it takes
  const double predicted = (goal.weight * unknowns.covariance).trace();
  // Each sample is judged without its own information, of what was estimated: here by inverting
  // the normal matrix of the others.
  robot.unknowns->columns = solution.columns;
  MatrixXd all = known_before(robot, solution.setup);
  const std::vector<SampleRows> rows =
      sample_rows(robot, solution.setup, solution.samples(), solution.values.targets, {});
  add_information(rows, all);
  double hidden = 0;
  for (size_t i = 0; i < rows.size(); ++i) {
    REQUIRE(solution.samples()[i].views.size() == 1);
    MatrixXd own = MatrixXd::Zero(all.rows(), all.cols());
    add_information({rows[i]}, own);
    const DesignGoal here = sight_goal(robot, {solution.samples()[i]});
    hidden += (here.weight * (fixture::dense::inverse(all - own) - fixture::dense::inverse(all)))
                  .trace() /
              static_cast<double>(rows.size());
  }
  CHECK(hidden > 0.001 * predicted);  // (beyond rounding: most of the error is in held lengths)
  CHECK(more->now == Approx(std::sqrt(predicted + hidden)).epsilon(1e-6));
  CHECK(more->thrice < more->now);
  CHECK(more->thrice > more->now / 3);
}

TEST_CASE("automatic: a board of another size is found, and the arm stays as drawn") {
  for (const unsigned long seed : {1, 2, 3}) {
    const Rig truth = with_large_board();
    const AutomaticCalibration found = calibrated(truth, 25, seed);
    INFO("seed " << seed << "\n" << described(found));
    REQUIRE(found.solution.status == Status::converged);
    for (const AutomaticGroup& g : found.groups) {
      INFO(g.name);
      CHECK(g.held == (g.name != "sizes"));
    }
    const AutomaticNumber& square = group(found, "sizes").numbers.at(0);
    CHECK(std::abs(square.value - 0.02 * 0.04) < 3 * square.sigma);
    CHECK(square.sigma < 0.002 * 0.04);
    check_held(found);
    check_errors(found, truth);
  }
}

TEST_CASE("automatic: noise that nobody states is found, a tenth to ten times the guess") {
  for (const double sensor : {0.1, 1.0, 10.0})
    for (const double joints : {0.1, 10.0}) {
      Rig guessed = drawn();
      std::vector<Sample> samples = logged(with_offsets(1), 25, 40);
      guessed.sensors[0].sigma = guessed.sensors[0].noise_guess = {0.2 / sensor, 0.2 / sensor};
      for (Sample& s : samples)
        for (View& v : s.views) v.sigma = guessed.sensors[0].sigma;
      for (JointSettings& joint : guessed.joints)
        joint.sigma = joint.noise_guess = joint.sigma / joints;
      const AutomaticCalibration found =
          calibrate_automatically(Recording(guessed, samples), AutomaticOptions());
      INFO("noise " << sensor << " and " << joints << " times the guess\n" << described(found));
      REQUIRE(found.solution.status == Status::converged);
      CHECK(found.solution.chi2_per_dof() == Approx(1).margin(0.1));
      CHECK(found.solution.rig().sensors[0].sigma[0] == Approx(0.2).epsilon(0.05));
      for (const NoiseLevel& level : noise_levels(linearise(found.solution))) {
        INFO(level.of << " " << level.used << " of " << level.guess);
        REQUIRE(level.guess > 0);
        CHECK(level.seen == Approx(level.used).epsilon(0.2));  // at rest, but for what was held
        const auto [low, high] = level.interval();
        const double truth = level.joint < 0 ? 0.2 : 1e-4;
        CHECK(low <= truth);
        CHECK(truth <= high);
      }
    }
}

TEST_CASE("automatic: a gear that is off is found where nobody states the noise of its joint") {
  // With the noise that a fit without gears finds, it is no larger than chance.
  for (const int joint : {1, 2}) {
    Rig truth = drawn(), guessed = drawn();
    truth.joints[joint].scale = 0.985;
    for (JointSettings& j : guessed.joints) j.noise_guess = j.sigma;
    const AutomaticCalibration found =
        calibrate_automatically(Recording(guessed, logged(truth, 25, 40)), AutomaticOptions());
    INFO("joint " << joint << "\n" << described(found));
    REQUIRE(found.solution.status == Status::converged);
    const std::string name = truth.tree.joints[joint].name;
    const double scale = found.solution["joint/" + name + "/scale"].value[0];
    CHECK(scale == Approx(0.985).margin(0.001));
    CHECK(found.solution.rig().joints[joint].sigma < 10 * truth.joints[joint].sigma);
  }
}

TEST_CASE("automatic: offsets are found, and the board keeps its size") {
  for (const unsigned long seed : {1, 2, 3}) {
    const Rig truth = with_offsets(seed);
    const AutomaticCalibration found = calibrated(truth, 25, 10 + seed);
    INFO("seed " << seed << "\n" << described(found));
    REQUIRE(found.solution.status == Status::converged);
    for (const AutomaticGroup& g : found.groups) {
      INFO(g.name);
      CHECK(g.held == (g.name != "offsets"));
    }
    CHECK(group(found, "offsets").factor > 0.5);
    CHECK(group(found, "offsets").factor < 5);
    for (const AutomaticNumber& n : group(found, "offsets").numbers) {
      INFO(n.name << " " << n.value << " +- " << n.sigma);
      const int joint = n.name[7] - '1';
      CHECK(std::abs(n.value - truth.joints[joint].offset) < 3.5 * n.sigma);
      if (joint >= 1 && joint <= 4) CHECK_FALSE(n.held);  // the others are the mounts', too
    }
    check_held(found);
    check_errors(found, truth);
  }
}

TEST_CASE("automatic: a robot that is as drawn stays so") {
  for (const unsigned long seed : {1, 2, 3}) {
    const AutomaticCalibration found = calibrated(built(), 25, 20 + seed);
    INFO("seed " << seed << "\n" << described(found));
    REQUIRE(found.solution.status == Status::converged);
    REQUIRE_FALSE(found.groups.empty());
    for (const AutomaticGroup& g : found.groups) {
      INFO(g.name);
      CHECK(g.held);
      for (const AutomaticNumber& n : g.numbers) CHECK(n.held);
    }
    check_held(found);
    check_errors(found, built());
    CHECK(nominal_values(found.solution).empty());
    for (const Component& c : found.solution.columns) {
      const ParameterKind kind = found.solution.table().all[c.parameter].kind;
      CHECK((kind == ParameterKind::sensor_pose || kind == ParameterKind::target_pose));
    }
  }
}

TEST_CASE("automatic: a drawing of another robot is unusual, and errors are predicted that large") {
  for (const unsigned long seed : {1, 2, 3}) {
    Rig truth = built();
    truth.tree.joints[0].parent_T_joint.translation.z() += 0.06;  // nothing measures it
    truth.tree.joints[2].parent_T_joint.translation.z() -= 0.012;
    truth.tree.joints[3].parent_T_joint.translation.x() += 0.014;
    const AutomaticCalibration found = calibrated(truth, 25, seed);
    INFO("seed " << seed << "\n" << described(found));
    REQUIRE(found.solution.status == Status::converged);
    CHECK(group(found, "lengths/a1..a6").factor < 9);
    CHECK(group(found, "lengths/a1..a6").widest > 9);
    for (const char* frame : {"sensor/eye", "target/board"}) {
      const Told told = of_frame(found.solution, truth, frame);
      INFO(frame << ": off by " << told.actual * 1e3 << " mm, predicted " << told.predicted * 1e3);
      CHECK(told.actual > 0.05);
      CHECK(told.actual < 3 * told.predicted);
    }
    const Told told = of_corners(found.solution, truth);
    CHECK(told.actual < 3 * told.predicted);
  }
  const AutomaticCalibration machined = calibrated(built(), 25, 4);
  for (const AutomaticGroup& g : machined.groups) CHECK(g.widest == g.factor);
}

TEST_CASE("automatic: joints that no measurement sees count in frames relative to the base") {
  const auto on_waist = [](Rig rig, double offset) {
    rig.tree.links.push_back("ground");
    Joint waist;
    waist.name = "waist";
    waist.type = JointType::revolute;
    waist.parent = link_index(rig, "ground");
    waist.child = link_index(rig, "base");
    waist.axis = {0, 0, 1};
    waist.parent_T_joint = at({0, 0, 0.5});
    rig.tree.joints.push_back(waist);
    rig.joints.push_back({1e-4, offset, 1});
    rig.base = waist.parent;
    finish_tree(rig.tree);
    return rig;
  };
  // All of one size: that the width of those which are seen is that of the others is an assumption.
  Rig arm = built();
  for (int j = 0; j < kJoints; ++j) arm.joints[j].offset = j % 2 ? -0.008 : 0.008;
  const Rig truth = on_waist(arm, 0.008);
  const AutomaticCalibration found =
      calibrate_automatically(Recording(on_waist(drawn(), 0), logged(truth, 25, 81)), {});
  INFO(described(found));
  REQUIRE(found.solution.status == Status::converged);
  const AutomaticGroup& offsets = group(found, "offsets");
  REQUIRE(offsets.unseen.size() == 1);
  const AutomaticNumber& waist = offsets.unseen[0];
  CHECK(waist.name == "joint/waist/offset");
  CHECK(waist.value == 0);
  CHECK(waist.held);
  CHECK(waist.width == Approx(offsets.factor * 0.005));  // as far off as the others
  CHECK(waist.sigma >= waist.width);                     // and what wider ones may be
  CHECK(waist.sigma < 3 * waist.width);
  CHECK_FALSE(offsets.held);
  check_errors(found, truth);
  CHECK(of_frame(found.solution, truth, "target/board").predicted > 0.4 * waist.width);
  // What carries the arm is not estimated, and moves nothing that is seen.
  const ParameterTable& table = found.solution.table();
  const int start = table.all[table.joint_offset[joint_index(truth, "waist")]].start;
  CHECK(found.solution.values.shared(start) == 0);
}

TEST_CASE("automatic: one or two samples are no calibration") {
  for (const bool given : {true, false})
    for (const int count : {1, 2})
      for (unsigned long seed = 31; seed < 36; ++seed) {
        INFO("given poses " << given << ", " << count << " samples, seed " << seed);
        Rig rig = drawn();
        if (!given) {
          rig.sensors[0].pose_given = rig.targets[0].pose_given = false;
          rig.sensors[0].link_T_sensor = rig.targets[0].link_T_target = {};
        }
        const Rig truth = with_offsets(seed);
        const AutomaticCalibration found =
            calibrate_automatically(Recording(rig, logged(truth, count, seed)), {});
        CHECK(found.solution.status == Status::unobservable);
        CHECK_FALSE(found.solution.unobservable.empty());
      }
}

TEST_CASE("automatic: a few samples place the camera or say that they do not") {
  // Offsets as large as the widths that the path begins with.
  int robots = 0, base_beyond = 0, corners_beyond = 0;
  for (const int count : {3, 4, 6})
    for (unsigned long seed = 100; seed < 140; ++seed) {
      const Rig truth = with_offsets(seed, 0.005);
      const AutomaticCalibration found = calibrated(truth, count, seed);
      if (count == 6) CHECK(found.solution.status == Status::converged);
      if (found.solution.status != Status::converged) continue;
      bool beyond = false;
      for (const char* frame : {"sensor/eye", "target/board"}) {
        const Told told = of_frame(found.solution, truth, frame);
        beyond = beyond || !(told.actual < 3 * told.predicted);
      }
      base_beyond += beyond;
      const Told told = of_corners(found.solution, truth);
      corners_beyond += !(told.actual < 3 * told.predicted);
      ++robots;
    }
  INFO(robots << " robots, frames relative to the base beyond " << base_beyond << ", corners "
              << corners_beyond);
  CHECK(robots >= 80);
  CHECK(base_beyond <= 0.02 * robots);
  CHECK(corners_beyond <= 0.01 * robots);
}

TEST_CASE("automatic: what is fixed is in no step") {
  Rig truth = with_offsets(2);
  truth.joints[2].offset = 0;
  Vector6d xi;
  xi << 6e-3, -4e-3, 0, kMountTurn;
  truth.sensors[0].link_T_sensor = drawn().sensors[0].link_T_sensor * exp_se3(xi);
  AutomaticOptions options;
  options.fix = {"sensor/eye/pose.z", "joint/a3/offset", "sensor/eye/intrinsics"};
  const AutomaticCalibration found = calibrated(truth, 25, 51, options);
  REQUIRE(found.solution.status == Status::converged);
  const ParameterEstimate& eye = found.solution["sensor/eye/pose"];
  CHECK(eye.value[2] == 0);
  CHECK_FALSE(eye.freed[2]);
  CHECK(eye.freed[0]);
  CHECK(std::abs(eye.value[0] - 6e-3) < 4e-3);
  const ParameterTable& table = found.solution.table();
  for (const std::string name : {"joint/a3/offset", "sensor/eye/intrinsics"}) {
    INFO(name);
    CHECK_THROWS_AS(found.solution[name], std::out_of_range);
    const Parameter& p = table.all[table.find(name, "")[0].parameter];
    CHECK(found.solution.values.shared.segment(p.start, p.size()) ==
          table.initial.segment(p.start, p.size()));
  }
  for (const AutomaticGroup& g : found.groups)
    for (const AutomaticNumber& n : g.numbers) {
      CHECK(n.name != "joint/a3/offset");
      CHECK(n.name.rfind("sensor/eye/intrinsics", 0) != 0);
    }
  for (const Step& step : automatic_steps(Recording(drawn(), logged(truth, 25, 51)), options)) {
    INFO(step.name);
    for (const std::string& name : step.free)
      for (const std::string& fixed : options.fix) CHECK(name.rfind(fixed, 0) != 0);
    CHECK(std::count(step.free.begin(), step.free.end(), "sensor/eye/pose") == 0);
    CHECK(std::count(step.free.begin(), step.free.end(), "sensor/eye/pose.x") == 1);
  }
}

TEST_CASE("automatic: it can be cancelled wherever it is") {
  const Recording recording(drawn(), logged(with_offsets(3), 12, 61));
  std::vector<std::string> calls;
  AutomaticOptions options;
  options.progress = Progress([&](const Progress::News& news) {
    calls.push_back(news.what);
    return true;
  });
  REQUIRE(calibrate_automatically(recording, options).solution.status == Status::converged);
  for (const char* step : {"mounts", "widths", "everything"})
    CHECK(std::count(calls.begin(), calls.end(), step) > 0);
  for (size_t last = 0; last < calls.size(); ++last) {
    INFO("at call " << last << " of " << calls.size() << ", " << calls[last]);
    size_t count = 0;
    options.progress = Progress([&](const Progress::News&) { return count++ < last; });
    const AutomaticCalibration found = calibrate_automatically(recording, options);
    CHECK(found.solution.status == Status::cancelled);
    CHECK(found.groups.empty());
    CHECK(count == last + 1);  // it is not asked again
  }
}

TEST_CASE("automatic: the order of samples does not matter") {
  std::vector<Sample> samples = logged(with_offsets(4), 15, 71);
  const AutomaticCalibration one = calibrate_automatically(Recording(drawn(), samples), {});
  std::reverse(samples.begin(), samples.end());
  std::rotate(samples.begin(), samples.begin() + 4, samples.end());
  const AutomaticCalibration other = calibrate_automatically(Recording(drawn(), samples), {});
  REQUIRE(one.solution.status == Status::converged);
  REQUIRE(other.solution.status == Status::converged);
  REQUIRE(one.groups.size() == other.groups.size());
  for (size_t g = 0; g < one.groups.size(); ++g) {
    INFO(one.groups[g].name);
    CHECK(one.groups[g].held == other.groups[g].held);
    CHECK(one.groups[g].factor == Approx(other.groups[g].factor).epsilon(1e-6));
    CHECK(one.groups[g].gain == Approx(other.groups[g].gain).epsilon(1e-6).margin(1e-6));
  }
  REQUIRE(one.solution.parameters.size() == other.solution.parameters.size());
  for (const ParameterEstimate& expected : one.solution.parameters) {
    INFO(expected.name);
    const ParameterEstimate& found = other.solution[expected.name];
    for (size_t c = 0; c < expected.value.size(); ++c) {
      CHECK(std::abs(found.value[c] - expected.value[c]) <= 1e-6 * expected.sigma[c]);
      CHECK(found.sigma[c] == Approx(expected.sigma[c]).epsilon(1e-5));
    }
  }
}

}  // namespace automatic_test
