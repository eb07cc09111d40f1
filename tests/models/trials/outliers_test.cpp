// models/trials/outliers.h and models/fitting/robust.h: gross outliers.
//
// Proves: noise_ratios of sensors are the standard deviation of Gaussian residuals, whatever a
// minority does; the bound of chi2 lies above its quantile at 1e-9 (by the incomplete gamma
// function in closed form) and not far above; gross outliers are found and named in every noise
// mode, points, a view, a sample that cannot even start, and what is left is calibrated as if they
// had never been; held-out samples are left alone; joints that are noisier than stated cost no
// right sample, do not hide a wrong one, and are named. The program's tests
// (program/outliers_test.py) prove figures. Does not prove: behaviour at outliers of less than
// seven sigmas, nor how one sample is judged (consensus_test.cpp).
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/fitting/robust.h"
#include "../../../models/trials/outliers.h"
#include "../../fixtures/example.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/study.h"

namespace outliers_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

/// P(chi2 > x) for an even number of degrees of freedom n: exp(-x/2) sum_{k < n/2} (x/2)^k / k!
double chi2_tail(double x, int n) {
  double term = std::exp(-x / 2), sum = 0;
  for (int k = 0; k < n / 2; ++k) {
    sum += term;
    term *= x / 2 / (k + 1);
  }
  return sum;
}

}  // namespace

TEST_CASE("outliers: noise_ratios of sensors and the bound of chi2") {
  Rig rig;
  rig.sensors.resize(2);
  rig.sensors[0].model = rig.sensors[1].model = Laboratory(1, 2).rig.sensors[0].model;
  Random random(1);
  View view, other;
  view.sensor = 0;
  other.sensor = 1;
  std::vector<ViewResiduals> residuals(2);
  residuals[0].view = &view;
  residuals[0].whitened = 2.5 * random_matrix(random, 20000, 1);
  residuals[1].view = &other;
  residuals[1].whitened = random_matrix(random, 20000, 1);
  residuals[1].whitened.head(6000).array() += 1e4;  // 30 %
  const std::vector<double> noise_ratios = robust_noise_ratios(rig, residuals);
  CHECK(noise_ratios[0] == Approx(2.5).epsilon(0.03));
  CHECK(noise_ratios[1] > 1);
  CHECK(noise_ratios[1] < 1.8);
  for (int n : {2, 6, 20, 100, 400}) {
    CHECK(chi2_tail(chi2_bound(n), n) < 1e-9);
    CHECK(chi2_tail(chi2_bound(n), n) > 1e-12);
  }
}

TEST_CASE("outliers: found and taken out in every noise mode, as if they had never been") {
  for (NoiseMode noise :
       {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none}) {
    Laboratory lab(3);
    const std::vector<size_t> two = lab.seen_twice();
    REQUIRE(two.size() > 8);
    // Points of one view, a view numbered from the other corner, readings of another posture, a
    // held-out sample that is wrong as well.
    View& points = lab.first_camera(two[0]);
    points.z[0] += 20;
    points.z[5] -= 30;
    View& flipped = lab.first_camera(two[1]);
    turn_round(flipped);
    Sample& wrong = lab.samples[two[2]];
    for (double& reading : wrong.readings)
      if (std::isfinite(reading)) reading = -reading - 0.3;
    Sample& held_out = lab.samples[two[3]];
    held_out.train = false;
    held_out.readings = wrong.readings;

    CalibrationOptions options;
    options.noise = noise;
    const std::optional<Cleaned> clean =
        calibrate_without_outliers(make_recording(lab.rig, lab.samples), options);
    REQUIRE(clean);
    std::vector<std::string> named;
    for (const Rejected& r : clean->rejected) {
      std::string name = r.sample + " " + r.sensor;
      for (int id : r.ids) name += " " + std::to_string(id);
      named.push_back(name);
      CHECK(!r.reason.empty());
      CHECK((r.sensor.empty() == r.target.empty()));
    }
    const auto id = [&](const View& v, size_t i) {
      return std::to_string(v.ids.empty() ? static_cast<int>(i) : v.ids[i]);
    };
    std::vector<std::string> expected = {
        lab.samples[two[0]].id + " " + lab.rig.sensors[points.sensor].name + " " + id(points, 0) +
            " " + id(points, 2),
        lab.samples[two[1]].id + " " + lab.rig.sensors[flipped.sensor].name, wrong.id + " "};
    std::sort(named.begin(), named.end());
    std::sort(expected.begin(), expected.end());
    CHECK(named == expected);

    // The same without them, by hand.
    std::vector<int> kept;
    std::vector<double> kept_z;
    for (size_t i = 0; 2 * i < points.z.size(); ++i)
      if (i != 0 && i != 2) {
        kept.push_back(points.ids.empty() ? static_cast<int>(i) : points.ids[i]);
        kept_z.insert(kept_z.end(), {points.z[2 * i], points.z[2 * i + 1]});
      }
    points.ids = kept;
    points.z = kept_z;
    lab.samples[two[1]].views.erase(lab.samples[two[1]].views.begin() +
                                    (&flipped - lab.samples[two[1]].views.data()));
    lab.samples.erase(lab.samples.begin() + static_cast<std::ptrdiff_t>(two[2]));
    const Solution by_hand = solution_of(lab.rig, lab.samples, options);
    CHECK(clean->solution.chi2 == by_hand.chi2);
    CHECK(clean->solution.values.shared == by_hand.values.shared);
    CHECK(clean->solution.samples().size() == lab.samples.size());
  }
}

TEST_CASE("outliers: a sample that cannot start stays out, and none at all is an error") {
  Laboratory lab(5);
  const std::vector<size_t> two = lab.seen_twice();
  View& view = lab.first_camera(two[0]);
  for (double& z : view.z) z = 1e9;  // no direction
  const std::optional<Cleaned> clean =
      calibrate_without_outliers(make_recording(lab.rig, lab.samples), {});
  REQUIRE(clean);
  REQUIRE(clean->rejected.size() == 1);
  CHECK(clean->rejected[0].sample == lab.samples[two[0]].id);
}

TEST_CASE("outliers: joints noisier than stated cost no right sample and are named") {
  Rig truth;
  add_link(truth, "base");
  add_joint(truth, JointType::revolute, "turn", "base", "upper", {0, 0, 1}, at({0, 0, 0.4}));
  add_joint(truth, JointType::revolute, "lift", "upper", "fore", {0, 1, 0}, at({0.5, 0, 0}));
  add_joint(truth, JointType::revolute, "roll", "fore", "hand", {1, 0, 0}, at({0.3, 0, 0}));
  finish_tree(truth.tree);
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.4, 0, 0, 0, 0.4, 0, 0.05, 0;
  add_points(truth, "reflectors", points, "hand", at({0.1, 0, 0.02}));
  add_tracker(truth, "tracker", "base", at({2, 0.3, 0.5}, {0, 0, 2}), Vector3d::Constant(1e-4));
  Step step;
  step.name = "all";
  step.sensors = {0};
  step.free = {"sensor/tracker/pose", "joint/lift/offset"};
  truth.steps = {step};
  for (JointSettings& joint : truth.joints) joint.sigma = 1e-3;
  for (double factor : {1.0, 3.0, 5.0, 20.0})
    for (bool wrong : {false, true}) {
      Random random(9);
      std::vector<Sample> samples;
      for (int n = 0; n < 50; ++n) {
        const TruePosture p = random_posture(truth, random, 1, true);
        samples.push_back(make_sample(truth, p, "s" + std::to_string(n)));
        REQUIRE(add_view(samples.back(), truth, 0, 0, p, &random));
      }
      if (wrong)
        for (size_t i : {4, 17, 30}) samples[i].readings[i % 3] += 0.1;
      Rig stated = truth;
      for (JointSettings& joint : stated.joints) joint.sigma = 1e-3 / factor;
      StudyOptions options;
      options.reject = true;
      options.loops = false;
      const Report report = *study(make_recording(stated, samples), options);
      INFO("joints " << factor << " times as noisy as stated" << (wrong ? ", some wrong" : ""));
      CHECK(report.no_consensus.empty());
      std::vector<std::string> out;
      for (const Rejected& r : report.rejected) out.push_back(r.sample);
      CHECK(out ==
            (wrong ? std::vector<std::string>{"s4", "s17", "s30"} : std::vector<std::string>()));
      CHECK(report.solution.rig().joints[0].sigma == stated.joints[0].sigma);
      std::string named;
      for (const Notice& w : report.warnings)
        if (w.kind == NoticeKind::joint_noise) named += sentences(w);
      CHECK(named.empty() == (factor < 2));
      INFO(named);
      for (const char* joint : {"'turn'", "'lift'", "'roll'"})
        CHECK((factor != 5 || named.find(joint) != std::string::npos));
    }
}

}  // namespace outliers_test
