// models/evidence/evidence: which of several models the data of a robot prefer.
//
// Proves, on an arm with a camera in its hand that looks at a board on its base, logged by the
// independent forward model with noise of readings and pixels: a wrong gear, a wrong square, a
// wrong link length and a robot as stated are told from each other by the evidence of fits, and by
// scores at the fit of the robot as it is, wherever a mistake is large beside what the data tell; a
// score is the difference of the evidence of fits where the step is small; noise of pixels and
// readings that is not as stated is found; a bent board speaks for its bend, but not with thousands
// of nats; a
// trend of readings has the evidence of the parameter that makes it; probabilities of a wrong gear
// add up to how often it is. Does not prove: anything of
// other sensors.
#include "../../../models/evidence/evidence.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>

#include "../../../models/calibration/calibration.h"
#include "../../../models/estimation/estimation.h"
#include "../../../models/rig/targets.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"

namespace evidence_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

constexpr int kJoints = 6;
constexpr double kReadings = 1e-4;  // rad

/// base -a1(z)- -a2(y)- -a3(y)- -a4(x)- -a5(y)- -a6(x)- hand with a camera that looks down at a
/// board on the base. Mounts and offsets are estimated.
Rig arm() {
  Rig rig;
  const std::string parent = add_arm(rig, kReadings);
  add_camera(rig, "eye", parent, at({0.03, 0, -0.05}, {kPi, 0, 0}));
  add_grid(rig, "board", 5, 6, 0.04, "base", at({0.4, -0.1, 0.05}));
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = {"sensor/eye/pose", "target/board/pose", "joint/*/offset"};
  PriorSetting offsets;
  offsets.pattern = "joint/*/offset";
  offsets.translation = offsets.rotation = 5e-3;
  step.priors = {offsets};
  rig.steps = {step};
  return rig;
}

/// A number that could be wrong, how far such numbers usually are, and a robot with it wrong.
struct Mistake {
  const char* parameter;
  double width;
  std::function<void(Rig&)> make;
};

const std::vector<Mistake> kMistakes = {
    {"joint/a2/scale", 0.01, [](Rig& rig) { rig.joints[1].scale *= 1.01; }},
    {"joint/a3/scale", 0.01, [](Rig& rig) { rig.joints[2].scale *= 1.01; }},
    {"target/board/square", 0.002, [](Rig& rig) { rig.targets[0].square *= 1.02; }},
    {"joint/a3/origin.z", 0.005,
     [](Rig& rig) { rig.tree.joints[2].parent_T_joint.translation.z() += 0.006; }},
    {"joint/a4/origin.x", 0.005,
     [](Rig& rig) { rig.tree.joints[3].parent_T_joint.translation.x() += 0.006; }}};

/// A robot like that with offsets of its own.
Rig built(unsigned long seed) {
  Rig rig = arm();
  Random random(seed);
  for (int j = 0; j < kJoints; ++j) rig.joints[j].offset = 3e-3 * random.normal();
  return rig;
}

std::vector<Sample> logged(const Rig& truth, int count, unsigned long seed) {
  Random random(seed);
  std::vector<Sample> out;
  while (static_cast<int>(out.size()) < count) {
    const TruePosture p = random_posture(truth, random, 0.45, true);
    Sample sample = make_sample(truth, p, "s" + std::to_string(out.size()));
    if (see(truth, 0, 0, p) && add_view(sample, truth, 0, 0, p, &random))
      out.push_back(std::move(sample));
  }
  return out;
}

/// The robot as stated, with one more number free if `mistake` is there.
Rig stated(const Mistake* mistake) {
  Rig rig = arm();
  if (!mistake) return rig;
  Step& step = rig.steps[0];
  step.free.push_back(mistake->parameter);
  PriorSetting prior;
  prior.pattern = mistake->parameter;
  prior.translation = prior.rotation = mistake->width;
  step.priors.push_back(prior);
  return rig;
}

Linearisation fitted(const Rig& rig, const std::vector<Sample>& samples) {
  const Solution solution = calibrate(make_recording(rig, samples), {});
  REQUIRE(solution.usable());
  return linearise(solution);
}

FreeDirection direction_of(const ParameterTable& table, const std::string& name, double width) {
  const Freed freed = table.find(name, "test").front();
  return {{{{freed.parameter, freed.components.front()}, 1.0}}, width};
}

/// Scores of all mistakes at a fit without them.
std::vector<double> scores_of(const Linearisation& at) {
  std::vector<std::vector<FreeDirection>> groups;
  for (const Mistake& m : kMistakes)
    groups.push_back({direction_of(at.solution.table(), m.parameter, m.width)});
  return scores(at, groups);
}

const char* name_of(int mistake) {
  return mistake < 0 ? "as it is" : kMistakes[static_cast<size_t>(mistake)].parameter;
}

int best_of(const std::vector<double>& gains) {
  const auto best = std::max_element(gains.begin(), gains.end());
  return *best > 0 ? static_cast<int>(best - gains.begin()) : -1;
}

}  // namespace

TEST_CASE("evidence: mistakes of a robot are told from each other") {
  const int count = static_cast<int>(kMistakes.size());
  std::printf("%-22s", "log odds against as it is");
  for (int a = 0; a < count; ++a) std::printf(" %20s", name_of(a));
  std::printf("\n");
  for (int truth = -1; truth < count; ++truth) {
    Rig robot = built(3);
    if (truth >= 0) kMistakes[truth].make(robot);
    const std::vector<Sample> samples = logged(robot, 24, 7);
    const Linearisation as_it_is = fitted(stated(nullptr), samples);
    const double none = evidence(as_it_is).log;
    const std::vector<double> gains = scores_of(as_it_is);
    std::vector<double> fits;
    for (const Mistake& m : kMistakes)
      fits.push_back(evidence(fitted(stated(&m), samples)).log - none);
    std::printf("%-22s", name_of(truth));
    for (int a = 0; a < count; ++a) std::printf("    %8.1f (%7.1f)", fits[a], gains[a]);
    std::printf("\n");
    CHECK(best_of(fits) == truth);
    CHECK(best_of(gains) == truth);
    for (int a = 0; a < count; ++a) {
      INFO(name_of(truth) << ": " << name_of(a) << " " << fits[a] << ", score " << gains[a]);
      // Of two wrong models each is judged at one of several modes of its noise factors.
      if (truth < 0 || a == truth)
        CHECK(std::abs(fits[a] - gains[a]) < std::max(0.1, 0.01 * fits[a]));
      if (a == truth)
        CHECK(fits[a] > 10);
      else if (truth >= 0)
        CHECK(fits[truth] - fits[a] > 5);
      else
        CHECK(fits[a] < 0);
    }
  }
}

TEST_CASE("evidence: a view's rows are split by what a motion of the target changes") {
  Rig rig = arm();
  rig.steps[0].free.push_back("sensor/eye/intrinsics");
  const Linearisation at = fitted(rig, logged(built(8), 6, 3));
  const std::vector<Component>& columns = at.problem().columns();
  const std::vector<ViewResiduals> views = at.problem().residuals(at.state());
  MatrixXd rows;
  std::vector<NoiseRows> noise;
  for (size_t g = 0; g < views.size(); ++g) {
    REQUIRE(at.problem().noise_rows(static_cast<int>(g), at.state(), rows, noise));
    const NoiseRows& view = noise[0];
    CHECK(view.residuals == views[g].whitened.size());
    CHECK(view.motion == 6);
    CHECK(rows.col(rows.cols() - 1).segment(view.first, view.count).squaredNorm() ==
          Approx(views[g].whitened.squaredNorm()));
    const Eigen::Index first = at.problem().groups()[g].private_size;
    for (size_t c = 0; c < columns.size(); ++c) {  // a sample touches all columns here
      const auto rest = rows.col(first + static_cast<Eigen::Index>(c))
                            .segment(view.first + view.motion, view.count - view.motion);
      const bool moves =
          at.solution.table().all[columns[c].parameter].kind != ParameterKind::intrinsics;
      CHECK((rest.norm() < 1e-6) == moves);
    }
  }
}

TEST_CASE("evidence: noise that is not as stated is found, and right robots stay right") {
  for (const double factor : {0.3, 1.0, 3.0}) {
    Rig robot = built(4);
    robot.sensors[0].sigma = {factor * 0.2, factor * 0.2};
    for (int j = 0; j < kJoints; ++j) robot.joints[j].sigma = factor * kReadings;
    std::vector<Sample> samples = logged(robot, 40, 11);
    for (Sample& sample : samples) sample.views[0].sigma = arm().sensors[0].sigma;
    const Linearisation at = fitted(arm(), samples);
    const ModelEvidence found = evidence(at);
    for (size_t k = 0; k < found.kinds.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      const double left = found.numbers(i) - found.fitted(i);
      INFO(factor << ": kind " << k << " of sensor " << found.kinds[k].sensor << ", joint "
                  << found.kinds[k].joint << ": " << found.factor(i) << ", " << left << " of "
                  << found.numbers(i));
      if (left > 20) CHECK(std::abs(std::log(found.factor(i) / factor)) < 3 / std::sqrt(2 * left));
    }
    // What is not there gains more than x nats in at most exp(-x) of cases: the ratio of densities
    // has the mean 1. Of three times five scores.
    const std::vector<double> gains = scores_of(at);
    CHECK(*std::max_element(gains.begin(), gains.end()) < std::log(3 * 5 / 0.01));
  }
}

TEST_CASE("evidence: parts of the data have unknowns of their own and the same noise") {
  const Linearisation one = fitted(arm(), logged(built(4), 20, 11)),
                      other = fitted(arm(), logged(built(5), 30, 12));
  const auto data = [](const Linearisation& at) -> FittedData {
    static std::map<const Linearisation*, std::vector<int>> samples;
    return {*at.solution.recording, samples[&at] = at.solution.training(), at.problem().setup(),
            at.solution.values};
  };
  const ModelEvidence together = evidence({data(one), data(other)});
  REQUIRE(together.kinds.size() == evidence(one).kinds.size());
  for (Eigen::Index k = 0; k < together.numbers.size(); ++k)
    CHECK(together.numbers(k) == Approx(evidence(one).numbers(k) + evidence(other).numbers(k)));
  // Of known noise parts are independent.
  ModelEvidence noise = together;
  noise.factor.setOnes();
  CHECK(log_evidence_at({data(one), data(other)}, noise) ==
        Approx(log_evidence_at({data(one)}, noise) + log_evidence_at({data(other)}, noise)));
  // The noise that is found is the likeliest that they have in common (its prior counts once).
  const double highest = log_evidence_at({data(one), data(other)}, together);
  for (Eigen::Index k = 0; k < together.factor.size(); ++k)
    for (const double by : {0.9, 1.1}) {
      noise.factor = together.factor;
      noise.factor(k) *= by;
      CHECK(log_evidence_at({data(one), data(other)}, noise) < highest + 0.02);
    }
  // With noise of their own they are explained no worse but for the price of another factor each.
  CHECK(evidence(one).log + evidence(other).log < together.log + 10);
}

TEST_CASE("evidence: of what is called sure of robots so much is right") {
  const Mistake gear = {"joint/a2/scale", 0.002, nullptr};
  Random random(6);
  double off = 0, variance = 0;
  int wrong = 0, sure = 0;
  for (unsigned long n = 0; n < 30; ++n) {
    Rig robot = built(100 + n);
    const bool there = n % 2 == 0;
    if (there) robot.joints[1].scale += gear.width * random.normal();
    const Linearisation at = fitted(arm(), logged(robot, 20, 200 + n));
    const double gain = scores(
                     at, {{direction_of(at.solution.table(), gear.parameter, gear.width)}})[0],
                 p = posterior({{0, 0, 0}, {gain, 0, 1}}).of_kind[1];
    off += there - p;
    variance += p * (1 - p);
    sure += std::max(p, 1 - p) > 0.99;
    wrong += std::max(p, 1 - p) > 0.99 && (p > 0.5) != there;
  }
  std::printf("gears: %.2f +- %.2f off, %d sure, %d of them wrong\n", off, std::sqrt(variance),
              sure, wrong);
  CHECK(std::abs(off) < 3 * std::sqrt(variance));
  CHECK(sure > 0);
  CHECK(wrong == 0);
}

TEST_CASE("evidence: a trend of readings is as likely as the parameter that makes it") {
  Rig rig = arm();
  rig.steps[0].free = {"sensor/eye/pose", "target/board/pose"};
  rig.steps[0].priors.clear();
  Rig robot = rig;
  robot.joints[1].offset = 2e-3;
  robot.joints[2].scale = 1.004;
  const std::vector<Sample> samples = logged(robot, 24, 11);
  const Linearisation at = fitted(rig, samples);
  const ParameterTable& table = at.solution.table();
  const char* const kNames[] = {"joint/a2/offset", "joint/a3/scale"};
  const VectorXd width = VectorXd::Constant(1, 4e-3);
  for (const int joint : {1, 2}) {
    const std::vector<double> as_parameter =
        scores(at, {{direction_of(table, kNames[joint - 1], width(0))}});
    ReadingTrend trend{{joint}, {}};
    for (const Sample& s : samples)
      trend.at.push_back(MatrixXd::Constant(1, 1, joint == 1 ? 1 : s.readings[joint]));
    const std::vector<WeighedTrend> found = weigh_trend(at, trend, {width, 1e-6 * width});
    INFO(kNames[joint - 1]);
    CHECK(as_parameter[0] > 5);
    CHECK(found[0].gain == Approx(as_parameter[0]).margin(0.05));
    CHECK(found[0].wider.diagonal().minCoeff() > 0);
    CHECK(found[1].wider.norm() < 0.01 * found[0].wider.norm());
    CHECK(found[1].gain == Approx(0).margin(0.05));  // too small to matter
  }
}

TEST_CASE("evidence: a bent board") {
  Rig robot = built(5), flat = arm();
  Target& board = robot.targets[0];
  board.grid = false;  // the forward model bends no grids
  board.points = board.square * board.layout;
  board.points.row(2) += 1e-3 * warp_shapes(board.layout).row(0);
  flat.targets[0].bulge = warp_shapes(board.layout);
  const std::vector<Sample> samples = logged(robot, 40, 13);
  const Linearisation at = fitted(flat, samples);
  const ParameterTable& table = at.solution.table();
  const double bent = scores(at, {{direction_of(table, "target/board/warp.x", 1e-3),
                                   direction_of(table, "target/board/warp.y", 1e-3)}})[0];
  std::vector<double> others = scores_of(at);
  const double without_noise_factors = (at.solution.chi2 - at.solution.dof_data) / 2;
  std::printf("bent board: %.0f nats; corners by themselves: %.0f\n", bent, without_noise_factors);
  CHECK(bent > 10);
  CHECK(bent < 1000);
  CHECK(*std::max_element(others.begin(), others.end()) < 5);
}

}  // namespace evidence_test
