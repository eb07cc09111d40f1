// models/trials/restarts.h: the same steps from other starting values.
//
// Proves: an arm of two links that a tracker follows has two minima, elbow up and elbow down. Where
// the elbow hardly moves they are equally good, and the warning says so; where it does, the wrong
// one is worse, restarts from there say that a better one exists and in which joints, restarts from
// the right one are no reason for a warning; the result stays that of the rig's own start. On the
// example all restarts end alike. Moves are of the priors' size where there are some. The same
// starts every time; progress can cancel; starts that cannot be evaluated are halved, and counted
// as failed if that does not help. A loss whose scale comes from the data keeps the result's
// scales, so that all ends of one minimum have one cost. Does not prove: that there is no other
// minimum where none was found.
#include "../../../models/trials/restarts.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "../../../io/rig/rig_file.h"
#include "../../../io/rig/samples_file.h"
#include "../../../models/report/warnings.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"
#include "../../fixtures/transforms.h"

namespace restarts_test {

using namespace kincal;
using namespace kincal::fixture;
using Catch::Matchers::Contains;

namespace {

/// base -shoulder(z)- upper -elbow(z)- fore, half a metre each; a reflector at the end, a tracker
/// on the base.
Rig arm() {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "shoulder", "base", "upper", {0, 0, 1}, at({0, 0, 0.2}));
  add_joint(rig, JointType::revolute, "elbow", "upper", "fore", {0, 0, 1}, at({0.5, 0, 0}));
  finish_tree(rig.tree);
  add_tracker(rig, "tracker", "base", at({1, -1, 0.3}, {0.2, 0.1, 1}), {1e-5, 1e-5, 1e-5});
  add_points(rig, "reflector", Eigen::Vector3d(0.5, 0, 0), "fore");
  Step step;
  step.name = "offsets";
  step.sensors = {0};
  step.free = {"joint/*/offset"};
  rig.steps = {step};
  return rig;
}

/// The elbow stands at +0.04 rad when it reads 0, and reads up to `range`.
std::vector<Sample> follow(const Rig& nominal, double range) {
  Rig truth = nominal;
  truth.joints[1].offset = 0.04;
  Random random(4);
  std::vector<Sample> out;
  for (int n = 0; n < 12; ++n) {
    TruePosture p = empty_posture(truth);
    p.readings[0] = random.uniform(-1, 1);
    p.readings[1] = range * random.uniform(-1, 1);
    out.push_back(make_sample(truth, p, "s" + std::to_string(n)));
    REQUIRE(add_view(out.back(), truth, 0, 0, p, &random));
  }
  return out;
}

/// A solution with its restarts, and what is said of them.
struct Restarted : Solution {
  Restarts restarts;
  std::string warning;  // of id "minima"
};

Restarted restarted(const Rig& rig, const std::vector<Sample>& samples, int count) {
  Report report;
  report.solution = solution_of(rig, samples);
  const std::vector<double> before = report.solution.parameters[0].value;
  report.restarts = restarts(report.solution, {}, count);
  CHECK(report.solution.parameters[0].value == before);
  REQUIRE(report.restarts);
  const Restarts& r = *report.restarts;
  CHECK(r.count == count);
  CHECK(r.minima[0].cost == report.solution.cost);
  CHECK(r.minima[0].differs.empty());
  int ended = r.failed;
  for (size_t i = 0; i < r.minima.size(); ++i) {
    ended += r.minima[i].count;
    CHECK((i == 0 || r.minima[i].count > 0));
    CHECK((i < 2 || r.minima[i - 1].cost <= r.minima[i].cost));
  }
  CHECK(ended == count);
  std::string said;
  for (const Notice& w : warnings(report))
    if (w.kind == NoticeKind::minima) said += sentences(w);
  return {report.solution, r, said};
}

}  // namespace

TEST_CASE("restarts: two minima that are equally good", "[restarts]") {
  Rig rig = arm();
  rig.joints[1].offset = 0.03;
  const Restarted result = restarted(rig, follow(rig, 0), 30);
  CHECK(result.parameters[1].value[0] == Approx(0.04).margin(1e-3));
  const Restarts& r = result.restarts;
  REQUIRE(r.minima.size() == 2);
  CHECK(r.failed == 0);
  CHECK(r.minima[0].count >= 5);
  CHECK(r.minima[1].count >= 5);
  CHECK(r.minima[1].cost == Approx(r.minima[0].cost).epsilon(1e-6));
  // The mirrored elbow: from 0.04 to -0.04, in the sigmas of the result; the shoulder pays half of
  // it back.
  REQUIRE(r.minima[1].differs.size() == 2);
  for (const auto& d : r.minima[1].differs) {
    const bool elbow = d.first == "joint/elbow/offset";
    CAPTURE(d.first);
    CHECK((elbow || d.first == "joint/shoulder/offset"));
    const double mirrored = -2 * result.parameters[1].value[0];
    CHECK(d.second == Approx((elbow ? mirrored : -mirrored / 2) / result.parameters[elbow].sigma[0])
                          .epsilon(1e-3));
  }
  CHECK_THAT(result.warning, Contains("with the same cost as this result") &&
                                 Contains("joint/elbow/offset") && Contains("of 30"));
}

TEST_CASE(
    "restarts: from the wrong minimum the better one is found and named, from the right one there "
    "is no warning",
    "[restarts]") {
  Rig rig = arm();
  const std::vector<Sample> samples = follow(rig, 0.01);
  rig.joints[1].offset = 0.03;
  const Restarted right = restarted(rig, samples, 30);
  CHECK(right.parameters[1].value[0] == Approx(0.04).margin(1e-3));
  REQUIRE(right.restarts.minima.size() == 2);
  CHECK(right.restarts.minima[1].cost > 2 * right.restarts.minima[0].cost);
  CHECK(right.warning.empty());

  rig.joints[1].offset = -0.05;
  const Restarted wrong = restarted(rig, samples, 30);
  CHECK(wrong.status == Status::converged);
  CHECK(wrong.parameters[1].value[0] < -0.02);
  REQUIRE(wrong.restarts.minima.size() == 2);
  CHECK(wrong.restarts.minima[0].cost == Approx(right.restarts.minima[1].cost).epsilon(1e-6));
  CHECK(wrong.restarts.minima[1].cost == Approx(right.cost).epsilon(1e-6));
  CHECK_THAT(wrong.warning, Contains("better minimum") && Contains("joint/elbow/offset"));
}

TEST_CASE("restarts: a loss whose scale comes from the data keeps the scales of the result",
          "[restarts]") {
  // A tracker five times noisier than stated, and a loss that counts in its real noise.
  const Rig nominal = arm();
  Rig noisy = nominal;
  noisy.sensors[0].sigma = {5e-5, 5e-5, 5e-5};
  std::vector<Sample> samples = follow(noisy, 1);
  for (Sample& s : samples)
    for (View& v : s.views) v.sigma = nominal.sensors[0].sigma;
  for (LossKind kind : {LossKind::cauchy, LossKind::huber}) {
    Rig rig = nominal;
    rig.steps[0].loss = Loss{kind, 2, true};
    const Restarted result = restarted(rig, samples, 10);
    CHECK(result.setup.noise_ratios[0] > 3);
    CHECK(result.restarts.minima.size() == 1);
    CHECK(result.restarts.minima[0].count == 10);
    CHECK(result.warning.empty());
  }
}

TEST_CASE("restarts: all alike on the example", "[restarts]") {
  const std::string folder = std::string(KINCAL_SOURCE_DIR) + "/examples/pr2/";
  const Rig rig = read_rig(folder + "rig.yaml").rig;
  const Restarted result = restarted(rig, read_samples(folder + "samples.jsonl", rig), 8);
  CHECK(result.restarts.minima.size() == 1);
  CHECK(result.restarts.minima[0].count == 8);
  CHECK(result.warning.empty());
}

TEST_CASE("restarts: moved as far as priors say, the same way every time", "[restarts]") {
  Rig rig = arm();
  rig.joints[0].scale = 1;
  std::vector<Sample> samples = follow(rig, 0.01);
  rig.joints[1].offset = 0.03;
  PriorSetting prior;
  prior.pattern = "joint/*/offset";
  prior.translation = 1e-3;
  rig.steps[0].priors = {prior};
  // With priors of 1 mrad no start is near the other elbow 0.07 rad away.
  const Restarted near = restarted(rig, samples, 30);
  CHECK(near.restarts.minima.size() == 1);
  rig.steps[0].priors[0].translation = 0.5;
  const Restarted far = restarted(rig, samples, 30), again = restarted(rig, samples, 30);
  REQUIRE(far.restarts.minima.size() >= 2);
  REQUIRE(again.restarts.minima.size() == far.restarts.minima.size());
  for (size_t i = 0; i < far.restarts.minima.size(); ++i) {
    CHECK(again.restarts.minima[i].count == far.restarts.minima[i].count);
    CHECK(again.restarts.minima[i].cost == far.restarts.minima[i].cost);
    CHECK(again.restarts.minima[i].differs == far.restarts.minima[i].differs);
  }
}

TEST_CASE("restarts: cancelled, starts that cannot be evaluated", "[restarts]") {
  Rig rig = arm();
  const std::vector<Sample> samples = follow(rig, 0.01);
  const Solution result = solution_of(rig, samples);
  CalibrationOptions options;
  std::string last;
  options.progress = Progress([&](const Progress::News& news) {
    last = news.what;
    return news.what.rfind("restart 3: ", 0) != 0;
  });
  CHECK_FALSE(restarts(result, options, 5));
  CHECK(last == "restart 3: starting values");

  // A camera 0.12 m before a board: with the pose off by 5 cm and 5 degrees some starts have points
  // behind it, and all are moved nearer until they have not. A prior of 50 m leaves no start that
  // can be evaluated at all, most of the time.
  Rig near;
  add_link(near, "base");
  add_joint(near, JointType::fixed, "mount", "base", "eye", {0, 0, 1}, at({0, 0, 0}));
  finish_tree(near.tree);
  add_camera(near, "camera", "eye", at({0, 0, 0}));
  add_grid(near, "board", 3, 4, 0.03, "base", at({-0.045, -0.03, 0.12}));
  Sample s = make_sample(near, empty_posture(near), "only");
  REQUIRE(add_view(s, near, 0, 0, empty_posture(near)));
  Step step;
  step.name = "camera";
  step.sensors = {0};
  step.free = {"sensor/camera/pose"};
  near.steps = {step};
  const Restarted halved = restarted(near, {s}, 20);
  CHECK(halved.restarts.failed == 0);
  PriorSetting wide;
  wide.pattern = "sensor/camera/pose";
  wide.translation = wide.rotation = 50;
  near.steps[0].priors = {wide};
  const Restarted failing = restarted(near, {s}, 20);
  CHECK(failing.restarts.failed > 0);
}

}  // namespace restarts_test
