// Variance components against the whole of R = 1 - J (J'J)^-1 J' written out; and what scaling them
// does. That they find planted sigmas in simulations is in trust_words_test.py. Not proven here:
// the uncertainties (there, roughly). Besides: a loss whose scale comes from the data does not bend
// what is seen; the robust ratios of joints find planted noise, whatever a minority does.
#include "../../../models/analysis/noise_levels.h"

#include <Eigen/LU>
#include <Eigen/QR>
#include <catch2/catch.hpp>

#include "../../../solver/levenberg_marquardt.h"
#include "../../../solver/observability.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/problem.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/stacked.h"
#include "../../fixtures/study.h"

namespace noise_levels_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

VectorXd solved(Setting& s) {
  VectorXd state = s.start();
  const SolveSummary summary = LevenbergMarquardt(*s.problem, SolverOptions()).solve(state);
  REQUIRE(summary.outcome == Outcome::converged);
  s.problem->renew(state);
  return state;
}

/// Which level every row of the stacked problem belongs to; by the order that explicit_rows() has:
/// views, then joints.
std::vector<int> owners(const Setting& s, const std::vector<NoiseLevel>& levels,
                        const VectorXd& state) {
  const auto level = [&](int sensor, int joint, int row) {
    for (size_t l = 0; l < levels.size(); ++l)
      if (levels[l].sensor == sensor && levels[l].joint == joint &&
          (levels[l].first == 0
               ? row < levels[l].count || levels[l].part.empty()
               : row >= levels[l].first && row < levels[l].first + levels[l].count))
        return static_cast<int>(l);
    throw std::logic_error("a row of nobody");
  };
  std::vector<int> out;
  MatrixXd rows;
  std::vector<NoiseRows> whose;
  for (size_t g = 0; g < s.problem->groups().size(); ++g) {
    for (const View& view : s.samples[s.problem->sample_of(static_cast<int>(g))].views) {
      const SensorModel& model = *s.rig.sensors[view.sensor].model;
      const int count =
          view.ids.empty() ? s.rig.targets[view.target].count() : static_cast<int>(view.ids.size());
      for (int b = 0; b < model.blocks(count); ++b)
        for (int i = 0; i < model.rows(); ++i) out.push_back(level(view.sensor, -1, i));
    }
    s.problem->noise_rows(static_cast<int>(g), state, rows, whose);
    for (const NoiseRows& w : whose)
      if (w.joint >= 0) out.push_back(level(-1, w.joint, 0));
  }
  return out;
}

/// The same robot and samples, all sigmas times a factor.
Setting scaled(const Setting& s, std::vector<NoiseLevel> levels, double factor) {
  Setting out;
  out.rig = s.rig;
  out.samples = s.samples;
  out.boards = s.boards;
  for (NoiseLevel& level : levels) level.seen = factor * level.assumed;
  scale_noise(out.rig, out.samples, levels);
  std::vector<std::string> sensors;
  for (const Sensor& sensor : out.rig.sensors) sensors.push_back(sensor.name);
  out.make(sensors, kDetermined);
  return out;
}

}  // namespace

TEST_CASE("noise levels: Helmert's equations, written out") {
  const LossKind kind = GENERATE(LossKind::none, LossKind::huber);
  Setting s = nasty_in(NoiseMode::latent, Loss{kind, 2.0}, 14, 5, 0.002);
  const VectorXd state = solved(s);
  const MatrixXd covariance = observe(*s.problem, state).covariance;
  const std::vector<NoiseLevel> levels = noise_levels(*s.problem, s.rig, state, covariance);
  const Stacked all = stack(*s.problem, state);
  const std::vector<int> owner = owners(s, levels, state);
  REQUIRE(owner.size() == static_cast<size_t>(all.r.size()));

  // Weights of rows: residuals with and without the loss.
  VectorXd weight = VectorXd::Ones(all.r.size());
  Eigen::Index at = 0;
  size_t next = 0;
  const std::vector<ViewResiduals> views = s.problem->residuals(state);
  for (size_t g = 0; g < s.problem->groups().size(); ++g) {
    Eigen::Index row = at;
    for (; next < views.size() && views[next].sample == s.problem->sample_of(static_cast<int>(g));
         ++next)
      for (Eigen::Index i = 0; i < views[next].whitened.size(); ++i, ++row)
        weight(row) = std::pow(all.r(row) / views[next].whitened(i), 2);
    at += s.problem->groups()[g].rows;
  }
  const MatrixXd q = fixture::dense::basis(all.j);
  const MatrixXd h = q * q.transpose();
  const int n = static_cast<int>(levels.size());
  MatrixXd helmert = MatrixXd::Zero(n, n);
  VectorXd squares = VectorXd::Zero(n), redundancy = VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < h.rows(); ++i) {
    squares(owner[i]) += all.r(i) * all.r(i);
    redundancy(owner[i]) += weight(i) - h(i, i);
    helmert(owner[i], owner[i]) += weight(i) - 2 * h(i, i);
    for (Eigen::Index k = 0; k < h.cols(); ++k) helmert(owner[i], owner[k]) += h(i, k) * h(i, k);
  }
  CHECK((helmert.rowwise().sum() - redundancy).cwiseAbs().maxCoeff() <
        1e-6 * redundancy.maxCoeff());  // R R = R
  long rows = 0;
  std::vector<int> told;
  for (int l = 0; l < n; ++l) {
    INFO(levels[l].of << " " << levels[l].part);
    CHECK(levels[l].redundancy == Approx(redundancy(l)).epsilon(1e-6).margin(1e-6));
    CHECK(std::isfinite(levels[l].seen) == std::isfinite(levels[l].uncertainty));
    if (std::isfinite(levels[l].seen)) told.push_back(l);
    if (levels[l].redundancy < 5) CHECK(!std::isfinite(levels[l].seen));
    rows += levels[l].rows;
  }
  CHECK(rows == all.r.size());
  REQUIRE(told.size() >= 8);
  if (kind != LossKind::none) return;  // q is corrected for the loss there
  // The rest is held at what is assumed.
  const int m = static_cast<int>(told.size());
  MatrixXd part(m, m);
  VectorXd right(m), factors(m);
  for (int a = 0; a < m; ++a) {
    right(a) = squares(told[a]);
    for (int l = 0; l < n; ++l)
      if (!std::isfinite(levels[l].seen)) right(a) -= helmert(told[a], l);
    for (int b = 0; b < m; ++b) part(a, b) = helmert(told[a], told[b]);
    factors(a) = std::pow(levels[told[a]].seen / levels[told[a]].assumed, 2);
  }
  CHECK((part * factors - right).cwiseAbs().maxCoeff() < 1e-6 * right.cwiseAbs().maxCoeff());
  for (int a = 0; a < m; ++a) CHECK(levels[told[a]].uncertainty <= 0.5);
}

TEST_CASE("noise levels: a scaled rig sees the same noise") {
  Setting s = nasty_in(NoiseMode::latent, Loss(), 14, 6, 0.002);
  const VectorXd state = solved(s);
  std::vector<NoiseLevel> levels =
      noise_levels(*s.problem, s.rig, state, observe(*s.problem, state).covariance);
  // All sigmas three times as large: nothing else changes, so a third of that is seen.
  Setting wide = scaled(s, levels, 3);
  CHECK(wide.rig.joints[joint_index(s.rig, "elbow")].sigma ==
        3 * s.rig.joints[joint_index(s.rig, "elbow")].sigma);
  CHECK(wide.rig.sensors[sensor_index(s.rig, "laser")].sigma[2] ==
        3 * s.rig.sensors[sensor_index(s.rig, "laser")].sigma[2]);
  CHECK(wide.samples[0].views[0].sigma[0] == 3 * s.samples[0].views[0].sigma[0]);
  const VectorXd wide_state = solved(wide);
  const std::vector<NoiseLevel> again = noise_levels(*wide.problem, wide.rig, wide_state,
                                                     observe(*wide.problem, wide_state).covariance);
  REQUIRE(again.size() == levels.size());
  for (size_t l = 0; l < levels.size(); ++l) {
    INFO(levels[l].of << " " << levels[l].part);
    CHECK(again[l].assumed == Approx(3 * levels[l].assumed));
    CHECK(again[l].redundancy == Approx(levels[l].redundancy).epsilon(1e-4).margin(1e-4));
    if (std::isfinite(levels[l].seen)) CHECK(again[l].seen == Approx(levels[l].seen).epsilon(1e-3));
  }
}

TEST_CASE("noise levels: one factor of all stated sigmas ends where chi2 is the redundancy") {
  Setting s = nasty_in(NoiseMode::latent, Loss(), 14, 6, 0.002);
  const VectorXd state = solved(s);
  const std::vector<NoiseLevel> first =
      noise_levels(*s.problem, s.rig, state, observe(*s.problem, state).covariance);
  // All sigmas are stated four times too large. (The minimum stays, so chi2 falls by 16.)
  const double stated = 4;
  double factor = stated, by = 0;
  for (int round = 0; round < 40 && std::abs(by - 1) > 1e-6; ++round) {
    Setting now = scaled(s, first, factor);
    const VectorXd at = solved(now);
    const std::vector<NoiseLevel> levels =
        noise_levels(*now.problem, now.rig, at, observe(*now.problem, at).covariance,
                     DoubtedNoise{factor / stated, nullptr});
    by = levels[0].seen / levels[0].assumed;
    for (const NoiseLevel& level : levels) CHECK(level.seen == Approx(by * level.assumed));
    factor *= by;
  }
  Setting now = scaled(s, first, factor);
  const VectorXd at = solved(now);
  double squares = 0, redundancy = 0;
  for (const ViewResiduals& r : now.problem->residuals(at)) squares += r.whitened.squaredNorm();
  for (const NoiseLevel& l :
       noise_levels(*now.problem, now.rig, at, observe(*now.problem, at).covariance))
    redundancy += l.redundancy;
  MatrixXd rows;
  std::vector<NoiseRows> whose;
  for (size_t g = 0; g < now.problem->groups().size(); ++g) {  // and the joints' errors
    now.problem->noise_rows(static_cast<int>(g), at, rows, whose);
    for (const NoiseRows& w : whose)
      if (w.joint >= 0)
        squares += rows.col(rows.cols() - 1).segment(w.first, w.count).squaredNorm();
  }
  // The prior of a guess (a factor of four) draws by less than a hundredth of that.
  CHECK(squares / redundancy == Approx(1).epsilon(0.01));
}

TEST_CASE("noise levels: stated sigmas that may be wrong are estimated as guesses are") {
  // Few samples: joints have small redundancies, which Helmert's equations leave aside.
  Setting s = nasty_in(NoiseMode::latent, Loss(), 4, 6, 0.002);
  const VectorXd state = solved(s);
  const MatrixXd covariance = observe(*s.problem, state).covariance;
  const Rig stated = s.rig;
  const std::vector<NoiseLevel> doubted =
      noise_levels(*s.problem, s.rig, state, covariance, DoubtedNoise{{}, &stated});
  Rig guessed = stated;
  for (Sensor& sensor : guessed.sensors) sensor.noise_guess = sensor.sigma;
  for (JointSettings& joint : guessed.joints) joint.noise_guess = joint.sigma;
  const std::vector<NoiseLevel> levels = noise_levels(*s.problem, guessed, state, covariance);
  REQUIRE(levels.size() == doubted.size());
  int small = 0;
  for (size_t l = 0; l < levels.size(); ++l) {
    INFO(levels[l].of << " " << levels[l].part);
    CHECK(doubted[l].guess == 0);
    CHECK(doubted[l].seen == Approx(levels[l].seen));  // finite: not NaN
    CHECK(doubted[l].uncertainty == Approx(levels[l].uncertainty));
    small += doubted[l].redundancy < 5;
  }
  CHECK(small >= 3);
}

TEST_CASE("noise levels: the minimum is the same whatever all sigmas are, and known as one") {
  Setting s = nasty_in(NoiseMode::latent, Loss(), 14, 6, 0.002);
  const VectorXd state = solved(s);
  const MatrixXd covariance = observe(*s.problem, state).covariance;
  const std::vector<NoiseLevel> levels = noise_levels(*s.problem, s.rig, state, covariance);
  for (double factor : {1e-3, 1e-5, 1e-7}) {
    INFO("sigmas times " << factor);
    Setting other = scaled(s, levels, factor);
    const VectorXd found = solved(other);  // or it says so: not_converged
    for (Eigen::Index i = 0; i < covariance.rows(); ++i)
      CHECK(std::abs(found(i) - state(i)) < 1e-4 * std::sqrt(covariance(i, i)));
    const MatrixXd other_covariance = observe(*other.problem, found).covariance;
    CHECK((other_covariance / (factor * factor) - covariance).norm() < 1e-3 * covariance.norm());
  }
}

TEST_CASE("noise levels: views with sigmas of their own") {
  const Rig rig = nasty_robot();
  std::vector<Sample> samples = nasty_samples(rig, 2, 3);
  int depth = 0;
  for (const Sample& s : samples)
    for (const View& v : s.views) depth += !v.covariance.empty();
  REQUIRE(depth > 0);
  NoiseLevel level;
  level.sensor = sensor_index(rig, "depth");
  level.count = 3;
  level.assumed = 0.002;
  level.seen = 0.003;
  Rig scaled = rig;
  std::vector<Sample> with = samples;
  scale_noise(scaled, with, {level});
  for (size_t i = 0; i < samples.size(); ++i)
    for (size_t v = 0; v < samples[i].views.size(); ++v)
      for (size_t p = 0; p < samples[i].views[v].covariance.size(); ++p)
        CHECK(with[i].views[v].covariance[p].isApprox(2.25 * samples[i].views[v].covariance[p]));
  CHECK(scaled.sensors[level.sensor].sigma[0] == Approx(1.5 * rig.sensors[level.sensor].sigma[0]));
  level.seen = std::nan("");
  Rig same = rig;
  scale_noise(same, with, {level});
  CHECK(same.sensors[level.sensor].sigma == rig.sensors[level.sensor].sigma);
}

namespace {

/// An arm of two joints with three reflectors, and a tracker that is to be placed.
Rig watched_arm(double joint_sigma, double tracker_sigma) {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "turn", "base", "upper", {0, 0, 1}, at({0, 0, 0.4}),
            joint_sigma);
  add_joint(rig, JointType::revolute, "bend", "upper", "fore", {0, 1, 0}, at({0.5, 0, 0}),
            joint_sigma);
  finish_tree(rig.tree);
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.1, 0, 0, 0, 0.1, 0, 0.02, 0;
  add_points(rig, "reflectors", points, "fore", at({0.4, 0, 0.02}));
  add_tracker(rig, "tracker", "base", at({2, 0.3, 0.5}, {0, 0, 2}),
              Vector3d::Constant(tracker_sigma));
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = {"sensor/tracker/pose"};
  rig.steps = {step};
  return rig;
}

/// Samples of `truth` as `stated` would read them.
std::vector<Sample> watched(const Rig& truth, const Rig& stated, int count) {
  Random random(5);
  std::vector<Sample> out;
  for (int n = 0; n < count; ++n) {
    const TruePosture p = random_posture(truth, random, 1, true);
    out.push_back(make_sample(truth, p, "s" + std::to_string(n)));
    REQUIRE(add_view(out.back(), truth, 0, 0, p, &random));
    out.back().views[0].sigma = stated.sensors[0].sigma;
  }
  return out;
}

}  // namespace

TEST_CASE("noise levels: a loss whose scale comes from the data sees the noise that is there") {
  const Rig truth = watched_arm(0, 1e-3);
  for (double factor : {0.2, 1.0, 5.0})  // of the stated sigma
    for (LossKind kind : {LossKind::huber, LossKind::cauchy}) {
      Rig stated = watched_arm(0, factor * 1e-3);
      stated.steps[0].loss = Loss{kind, 2, true};
      const Solution result = solution_of(stated, watched(truth, stated, 60));
      const NoiseLevels levels = noise_levels(linearise(result));
      INFO("stated " << factor << " of what is there");
      REQUIRE(levels.size() == 1);
      CHECK(levels[0].seen == Approx(1e-3).epsilon(0.08));
    }
}

TEST_CASE("noise levels: the robust ratios of joints") {
  for (double factor : {1.0, 4.0}) {
    const Rig truth = watched_arm(factor * 1e-3, 3e-4), stated = watched_arm(1e-3, 3e-4);
    std::vector<Sample> samples = watched(truth, stated, 80);
    for (size_t i = 0; i < samples.size(); i += 5) samples[i].readings[1] += 0.5;
    StepVariations robust;
    robust.robust = true;
    for (bool right : {true, false}) {
      const Rig& rig = right ? truth : stated;
      const Solution result = calibrate(make_recording(rig, samples), {}, robust);
      const std::vector<double> ratios =
          robust_joint_ratios(*result.last->problem, rig, result.last->state);
      INFO(factor << " times as noisy as stated" << (right ? ", which is told" : ""));
      for (double ratio : ratios) CHECK(ratio == Approx(right ? 1 : factor).epsilon(0.4));
    }
    samples.resize(7);
    const Solution few = calibrate(make_recording(stated, samples), {}, robust);
    CHECK(robust_joint_ratios(*few.last->problem, stated, few.last->state) ==
          std::vector<double>(2, 1.0));
  }
}

}  // namespace noise_levels_test
