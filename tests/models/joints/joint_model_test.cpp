// models/joints/joint_model.h, and that everything else takes a joint's position from its model.
//
// Proves, for the linear model and a quadratic one of the tests' own: derivatives are those of
// position(), reading() inverts it and says NaN where nothing does. On the nasty robot with bends
// in a joint that others follow, in a prismatic one and in scanning ones, the fixture's independent
// forward model being bent the same way: the numbers are parameters with names; residuals,
// whitening and every derivative of an Estimation, entry by entry; derivatives of frames; what a
// simulation logs. A Calibration finds a planted bend, with an honest sigma, and does not fit
// without it. The rig's initial values go before the model's; names are found in a list of models.
// Does not prove: what files do with a model (tests/io/results/joint_model_test.cpp), nor anything
// of a model's use to real gears.
#include "../../../models/joints/joint_models.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>

#include "../../../models/analysis/frames.h"
#include "../../../models/rig/scales.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/open_recording.h"
#include "../../fixtures/quadratic_joint.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/stacked.h"
#include "../../fixtures/study.h"
#include "../../fixtures/transforms.h"

namespace joint_model_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

const std::map<std::string, double> kBends = {
    {"elbow", 0.05}, {"slide", -0.08}, {"scan", 0.06}, {"turn", -0.03}};

/// The nasty robot with bends; its rig starts at half of them, the values have them.
struct Bent : OpenRecording {
  std::vector<TruePosture> postures;
  Values values;

  explicit Bent(int count) : OpenRecording(make_rig()) {
    samples = nasty_samples(rig, count, 41, &postures);
    values.shared = table.initial;
    for (const auto& [joint, bend] : kBends) values.shared(start(joint)) = bend;
    for (size_t s = 0; s < samples.size(); ++s) {
      for (const auto& [joint, bend] : kBends) postures[s].bends[joint_index(rig, joint)] = bend;
      for (const auto& [target, board] : postures[s].boards)
        values.targets[{static_cast<int>(s), target}] = to_pose(board);
      for (size_t j = 0; j < rig.joints.size(); ++j)
        if (postures[s].errors[j] != 0)
          values.errors[{static_cast<int>(s), static_cast<int>(j)}] = postures[s].errors[j];
    }
  }
  int bend(const std::string& joint) const {
    return table.select("joint/" + joint + "/bend").at(0).parameter;
  }
  int start(const std::string& joint) const { return table.all[bend(joint)].start; }

 private:
  static Rig make_rig() {
    Rig rig = nasty_robot();
    for (const auto& [joint, bend] : kBends) bend_joint(rig, joint, bend / 2);
    return rig;
  }
};

}  // namespace

TEST_CASE("joint models: derivatives, and readings at positions") {
  Random random(1);
  const QuadraticJoint quadratic(0);
  for (const JointModel* model : {linear_joint().get(), static_cast<const JointModel*>(&quadratic)})
    for (int n = 0; n < 50; ++n) {
      std::vector<double> own = {random.uniform(-0.3, 0.3),
                                 random.uniform(0.8, 1.2) * (n % 2 ? 1 : -1),
                                 random.uniform(-0.1, 0.1)};
      own.resize(model->size());
      CHECK(model->size() == 2 + static_cast<int>(model->extra_parameters().size()));
      const double q = random.uniform(-2, 2);
      const auto at = [&](double reading) {
        return VectorXd::Constant(1, model->position(reading, own.data()));
      };
      CHECK(model->by_reading(q, own.data()) ==
            Approx(derivative([&](double h) { return VectorXd(at(q + h)); }, 1e-2)(0))
                .epsilon(1e-11));
      for (int k = 0; k < model->size(); ++k) {
        const auto moved = [&](double h) {
          std::vector<double> there = own;
          there[k] += h;
          return VectorXd(VectorXd::Constant(1, model->position(q, there.data())));
        };
        CHECK(model->by_own(k, q, own.data()) == Approx(derivative(moved, 1e-2)(0)).margin(1e-11));
      }
      CHECK(model->reading(model->position(q, own.data()), own.data()) == Approx(q).margin(1e-14));
    }
  const double own[] = {0, 1, 0.25};  // nothing below -1
  CHECK(quadratic.reading(-0.99, own) == Approx(-1.8).epsilon(1e-12));
  CHECK(std::isnan(quadratic.reading(-1.5, own)));
}

TEST_CASE("joint models: their numbers are parameters, one after the other from the offset on") {
  const Bent s(1);
  for (const auto& [joint, bend] : kBends) {
    const int j = joint_index(s.rig, joint);
    const Parameter& p = s.table.all[s.bend(joint)];
    CHECK(s.bend(joint) == s.table.joint_offset[j] + 2);
    CHECK(p.start == s.table.all[s.table.joint_offset[j]].start + 2);
    CHECK((p.kind == ParameterKind::joint_shape && p.owner == j && p.size() == 1));
    CHECK(s.table.initial(p.start) == bend / 2);
  }
  CHECK(s.table.select("joint/*/bend").size() == kBends.size());
}

TEST_CASE("joint models: by name, and the rig's numbers before the model's") {
  CHECK(find_joint_model(joint_models(), "linear") == linear_joint());
  CHECK_FALSE(find_joint_model(joint_models(), ""));
  const JointModels mine = {linear_joint(), std::make_shared<QuadraticJoint>(0.5)};
  CHECK(find_joint_model(mine, "quadratic") == mine[1]);
  Rig rig = nasty_robot();
  JointSettings& elbow = rig.joints[joint_index(rig, "elbow")];
  elbow.model = mine[1];
  const auto initial = [&](double& usual) {
    const ParameterTable table(rig);
    const Component bend = {table.select("joint/elbow/bend").at(0).parameter, 0};
    usual = scales(table, bend, table.initial).usual;
    CHECK(scales(table, bend, table.initial).width == usual);
    CHECK(scales(table, bend, table.initial).yardstick == 0.01);
    return table.initial(table.all[bend.parameter].start);
  };
  double usual;
  CHECK(initial(usual) == 0.5);
  CHECK(usual == 0.05);
  elbow.further = {0.25};
  CHECK(initial(usual) == 0.25);
}

TEST_CASE("joint models: residuals, whitening and every derivative of a robot with bends") {
  const Bent s(3);
  for (const NoiseMode mode : {NoiseMode::latent, NoiseMode::marginal}) {
    EstimationSetup setup;
    setup.noise = mode;
    setup.sensors = all_sensors(s.rig);
    setup.free = freed(s.table, {"joint/*/bend", "joint/elbow/*", "joint/scan/*", "joint/slide/*",
                                 "joint/turn/*", "joint/shoulder/offset", "joint/wrist/origin",
                                 "sensor/laser/pose", "sensor/bc8/pose"});
    Estimation problem(s, s.training(), setup);
    problem.set_workers(1);
    const VectorXd state = problem.pack(s.values);
    problem.renew(state);
    problem.prepare(state);
    const Stacked analytic = stack(problem, state);
    const MatrixXd numeric = stacked_differences(problem, state, 1e-3);
    const std::vector<ViewResiduals> views = problem.residuals(state);
    Eigen::Index row = 0;
    size_t next = 0;
    std::map<std::string, int> bent;  // views that depend on a bend
    for (size_t g = 0; g < problem.groups().size(); ++g) {
      const int sample = problem.sample_of(static_cast<int>(g));
      const Eigen::Index end = row + problem.groups()[g].rows;
      for (; next < views.size() && views[next].sample == sample; ++next) {
        const ViewResiduals& v = views[next];
        INFO("mode " << static_cast<int>(mode) << ": " << s.rig.sensors[v.view->sensor].name
                     << " sees " << s.rig.targets[v.view->target].name << " in "
                     << s.samples[sample].id);
        const Eigen::Index n = v.whitened.size();
        for (Eigen::Index k = 0; k < numeric.cols(); ++k) {
          const VectorXd a = analytic.j.col(k).segment(row, n), b = numeric.col(k).segment(row, n);
          const Eigen::Index shared = k - analytic.privates;
          INFO((shared < 0 ? "private " + std::to_string(k)
                           : problem.column_name(static_cast<int>(shared))));
          CHECK((a - b).cwiseAbs().maxCoeff() <
                1e-7 * b.cwiseAbs().maxCoeff() + 1e-11 * v.whitened.cwiseAbs().maxCoeff() + 1e-9);
          if (shared < 0) continue;
          const std::string& name = s.table.all[problem.columns()[shared].parameter].name;
          if (name.find("/bend") != std::string::npos) bent[name] += b.norm() > 1e-3;
        }
        TruePosture posture = s.postures[sample];
        if (mode != NoiseMode::latent) posture.errors.assign(posture.errors.size(), 0);
        const VectorXd by_hand = residual(s.rig, *v.view, posture);
        CHECK((v.raw - by_hand).cwiseAbs().maxCoeff() <
              1e-12 * (1000 + by_hand.cwiseAbs().maxCoeff()));
        MatrixXd c = own_covariance(s.rig, *v.view, posture);
        const MatrixXd readings = reading_noise(s.rig, *v.view, posture);
        if (mode == NoiseMode::marginal) c += readings * readings.transpose();
        CHECK(v.whitened.squaredNorm() ==
              Approx(fixture::dense::weighted_square(by_hand, c)).epsilon(1e-7));
        row += n;
      }
      // What is left are the priors of joint errors.
      CHECK((analytic.j - numeric).middleRows(row, end - row).cwiseAbs().sum() <=
            1e-6 * static_cast<double>(end - row));
      row = end;
    }
    REQUIRE(next == views.size());
    CHECK(bent.size() == kBends.size());
    for (const auto& [name, count] : bent) CHECK(count >= 3);
  }
}

TEST_CASE("joint models: frames move with the numbers and with the readings") {
  const Bent s(1);
  const int elbow = joint_index(s.rig, "elbow");
  TruePosture posture = s.postures[0];
  posture.errors.assign(posture.errors.size(), 0);
  constexpr double h = 1e-5;
  Unknowns unknowns;
  for (int k = 0; k < 3; ++k) unknowns.columns.push_back({s.table.joint_offset[elbow] + k, 0});
  for (const char* name : {"nail", "tool"}) {
    const Frame frame = *find_frame(s.rig, s.table, name);
    const auto base_T = [&](const Rig& rig, const TruePosture& p) {
      return Isometry3d(root_T_link(rig, rig.base, p).inverse() * root_T_link(rig, frame.link, p));
    };
    const auto difference = [&](const Isometry3d& up, const Isometry3d& down) {
      Vector6d out;
      out << (up.translation() - down.translation()) / (2 * h),
          rotation_vector(up.linear() * down.linear().transpose()) / (2 * h);
      return out;
    };
    const FrameDerivative d =
        frame_derivative(s.rig, s.table, s.values.shared, unknowns, frame, posture.readings);
    for (int k = 0; k < 3; ++k) {
      const auto moved = [&](double step) {
        Rig rig = s.rig;
        TruePosture p = posture;
        (k == 0   ? rig.joints[elbow].offset
         : k == 1 ? rig.joints[elbow].scale
                  : p.bends[elbow]) += step;
        return base_T(rig, p);
      };
      CHECK((d.by_unknowns.col(k) - difference(moved(h), moved(-h))).norm() < 1e-8);
    }
    Matrix6d by_readings = Matrix6d::Zero();
    for (size_t j = 0; j < s.rig.joints.size(); ++j) {
      if (!s.rig.tree.joints[j].has_reading()) continue;
      TruePosture up = posture, down = posture;
      up.readings[j] += h;
      down.readings[j] -= h;
      const Vector6d motion =
          s.rig.joints[j].sigma * difference(base_T(s.rig, up), base_T(s.rig, down));
      by_readings += motion * motion.transpose();
    }
    CHECK((d.by_readings * d.by_readings.transpose() - by_readings).norm() <
          1e-8 * by_readings.norm() + 1e-14);
  }
}

namespace {

/// base -shoulder- upper -elbow- fore -wrist- tool with marks that a tracker sees; base -scan- head
/// with a laser before a wall.
Rig arm() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "shoulder", "base", "upper", {0, 0, 1},
            at({0.1, 0, 0.3}, {0.1, 0, 0}), 0.0005);
  add_joint(rig, JointType::revolute, "elbow", "upper", "fore", {0, 1, 0.1}, at({0.4, 0, 0}),
            0.0005);
  add_joint(rig, JointType::revolute, "wrist", "fore", "tool", {1, 0, 0},
            at({0.3, 0, 0.02}, {0, 0.2, 0}), 0.0005);
  add_joint(rig, JointType::revolute, "scan", "base", "head", {0, 1, 0}, at({0, 0.2, 0.6}));
  finish_tree(rig.tree);
  for (Joint& joint : rig.tree.joints) joint.lower = -1.2, joint.upper = 1.2;
  add_tracker(rig, "tracker", "base", at({1.5, 0.8, 1}, {0.2, 0.3, 2}), {0.0005, 0.0005, 0.0005});
  add_laser(rig, "laser", "head", at({0.03, 0, 0.05}, {0.05, 0, 0.1}), "scan",
            {0.0005, 0.0005, 0.002});
  add_points(
      rig, "marks",
      (Eigen::Matrix3Xd(3, 4) << 0.1, 0, 0.05, -0.05, 0, 0.1, -0.1, 0.05, 0, 0.02, 0.08, -0.06)
          .finished(),
      "tool");
  add_grid(rig, "wall", 3, 4, 0.1, "base", at({1.5, 0.1, 0.4}, {-1.6, 0, -1.5}));
  bend_joint(rig, "elbow", 0);
  bend_joint(rig, "scan", 0);
  return rig;
}

}  // namespace

TEST_CASE("joint models: a simulated encoder says what the model says") {
  Rig rig = arm();
  for (JointSettings& joint : rig.joints) joint.sigma = 0;
  for (Sensor& sensor : rig.sensors) std::fill(sensor.sigma.begin(), sensor.sigma.end(), 0.0);
  const ParameterTable table(rig);
  VectorXd truth = table.initial;
  TruePosture posture = empty_posture(rig);
  for (const char* joint : {"elbow", "scan"}) {
    posture.bends[joint_index(rig, joint)] = 0.06;
    truth(table.all[table.joint_offset[joint_index(rig, joint)]].start + 2) = 0.06;
  }
  SimulationOptions options;
  options.samples = 20;
  int views[2] = {0, 0};
  for (const Sample& sample : simulate(rig, table, truth, options).samples)
    for (const View& view : sample.views) {
      posture.readings = sample.readings;
      ++views[view.sensor];
      CHECK(residual(rig, view, posture).cwiseAbs().maxCoeff() < 1e-12);
    }
  CHECK((views[0] >= 5 && views[1] >= 5));
}

TEST_CASE("joint models: a calibration finds a planted bend, and does not fit without it") {
  const std::map<std::string, double> planted = {
      {"joint/elbow/offset", 0.02}, {"joint/elbow/scale", 1.01}, {"joint/elbow/bend", 0.04}};
  const Rig rig = arm();
  Rig truth = rig;
  const int elbow = joint_index(rig, "elbow");
  truth.joints[elbow].offset = 0.02;
  truth.joints[elbow].scale = 1.01;
  for (const bool noise : {false, true})
    for (const bool free_bend : {true, false}) {
      INFO((noise ? "noise" : "exact") << ", bend " << (free_bend ? "free" : "held"));
      Random random(5);
      std::vector<Sample> samples;
      for (int k = 0; k < 40; ++k) {
        TruePosture p = random_posture(truth, random, 1.2, noise);
        p.bends[elbow] = 0.04;
        samples.push_back(make_sample(truth, p, "s" + std::to_string(k)));
        samples.back().train = k % 4 != 3;
        REQUIRE(add_view(samples.back(), truth, 0, 0, p, noise ? &random : nullptr));
      }
      Rig given = rig;
      Step step;
      step.name = "all";
      step.sensors = {0};
      step.free = {"joint/elbow/offset", "joint/elbow/scale", "sensor/tracker/pose"};
      if (free_bend) step.free.push_back("joint/elbow/bend");
      given.steps = {step};
      const Solution result = solution_of(given, samples);
      CHECK(result.status == Status::converged);
      const double misfit = result.chi2 / static_cast<double>(result.dof);
      if (!free_bend) {
        CHECK(misfit > 5);
        continue;
      }
      CHECK((noise ? std::abs(misfit - 1) < 0.3 : misfit < 1e-12));
      CHECK(residuals_of(result).sensors[0].test.rms < (noise ? 0.003 : 1e-9));
      size_t found = 0;
      for (const ParameterEstimate& p : result.parameters) {
        const auto it = planted.find(p.name);
        if (it == planted.end()) continue;
        ++found;
        INFO(p.name << " " << p.value[0] << " +- " << p.sigma[0]);
        CHECK((p.sigma[0] > 1e-6 && p.sigma[0] < 2e-3));
        CHECK(std::abs(p.value[0] - it->second) < (noise ? 4 * p.sigma[0] : 1e-9));
      }
      CHECK(found == planted.size());
    }
}

}  // namespace joint_model_test
