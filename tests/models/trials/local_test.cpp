// models/trials/local.h: offsets around one posture.
//
// Proves: with an error a sin(q) planted in a joint's reading, the offsets at a posture are a
// sin(q0) within their sigmas, for offsets of all joints, and errors of fresh samples near it go
// down to the noise; the radius is where the gain of a constant ends (one joint, known in closed
// form); the estimate is that of a plain weighted least-squares fit with numeric derivatives; on
// data without such an error no gain is claimed, over 100 seeds; nothing depends on the order of
// samples; joints that the data do not determine stay, and what no sample within
// the bandwidth depends on is unknown; too few samples, joints that turn without
// end, and split `test` are treated as documented. Does not prove: that real robots have such
// errors, nor that sigma holds for errors that vary faster than samples are dense.
#include "../../../models/trials/local.h"

#include <Eigen/Cholesky>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "../../../models/rig/parameters.h"
#include "../../../models/simulation/simulation.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/transforms.h"

namespace local_test {

using namespace kincal;

namespace {

constexpr double kSigma = 5e-5;  // m, rad

/// An arm of six joints with three reflectors in its hand that a tracker sees; the last joint turns
/// without end.
Rig arm() {
  Rig rig;
  fixture::add_link(rig, "base");
  const std::vector<Pose> origins = {fixture::at({0, 0, 0.3}),
                                     fixture::at({0, 0, 0}, {-kPi / 2, 0, 0}),
                                     fixture::at({0.4, 0, 0}),
                                     fixture::at({0.05, 0, 0}, {-kPi / 2, 0, 0}),
                                     fixture::at({0, 0, 0.35}, {kPi / 2, 0, 0}),
                                     fixture::at({0, 0, 0}, {-kPi / 2, 0, 0})};
  std::string parent = "base";
  for (int i = 0; i < 6; ++i) {
    const std::string link = "l" + std::to_string(i + 1);
    fixture::add_joint(rig, i < 5 ? JointType::revolute : JointType::continuous,
                       "j" + std::to_string(i + 1), parent, link, Vector3d::UnitZ(), origins[i],
                       kSigma);
    parent = link;
  }
  finish_tree(rig.tree);
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.05, 0, 0, 0, 0.05, 0, 0, 0.02;
  fixture::add_points(rig, "reflectors", points, "l6", fixture::at({0.03, 0.02, 0.1}));
  fixture::add_tracker(rig, "tracker", "base", fixture::at({1, 0.2, 0.1}, {0, 0, 1}),
                       Vector3d::Constant(kSigma));
  return rig;
}

const std::vector<double> kCentre = {0.3, -0.8, 1.2, 0.2, 0.9, -0.4};

LocalPosture centre(const std::vector<int>& joints = {0, 1, 2, 3, 4, 5}) {
  LocalPosture out;
  for (int j : joints) out[j] = kCentre[j];
  return out;
}

/// Samples within `spread` of the centre (`also`: in other joints than the third), whose third
/// reading r has the position r + a sin r.
std::vector<Sample> samples_near(const Rig& rig, int count, unsigned long seed, double spread,
                                 double a, double also = -1) {
  fixture::Random random(seed);
  SimulationOptions options;
  options.seed = seed;
  options.samples = count;
  for (int i = 0; i < count; ++i) {
    Posture posture;
    posture.id = "p" + std::to_string(i);
    for (int j = 0; j < 6; ++j) {
      const double s = j == 2 || also < 0 ? spread : also;
      posture.readings.push_back(kCentre[j] + random.uniform(-s, s));
    }
    options.postures.push_back(posture);
  }
  const ParameterTable table(rig);
  std::vector<Sample> samples = simulate(rig, table, table.initial, options).samples;
  for (Sample& s : samples) {
    const double position = s.readings[2];
    for (int i = 0; i < 50; ++i) s.readings[2] = position - a * std::sin(s.readings[2]);
  }
  return samples;
}

LocalOptions within(double distance, NoiseMode noise = NoiseMode::latent) {
  LocalOptions options;
  options.within = distance;
  options.noise = noise;
  return options;
}

/// rms over fresh samples, readings exact, m.
double rms(const Rig& rig, const std::vector<Sample>& samples) {
  return evaluate(Recording(rig, samples), NoiseMode::none, {}).sensors.at(0).train.rms;
}

}  // namespace

TEST_CASE(
    "local: offsets are the planted error at the posture, within their sigmas, and lower the error "
    "of fresh samples") {
  const Rig rig = arm();
  constexpr double a = 0.003;
  for (const double spread : {0.1, 0.3, 0.8}) {
    double squares = 0, largest = 0, before = 0, after = 0;
    for (unsigned long seed = 1; seed <= 10; ++seed) {
      const LocalCalibration local =
          calibrate_locally(rig, samples_near(rig, 40, seed, spread, a), centre(), within(1));
      INFO("spread " << spread << ", seed " << seed);
      REQUIRE(local.enough);
      REQUIRE(local.gain);
      REQUIRE(local.offsets.size() == 6);
      CHECK(local.radius > 0.9 * spread);
      CHECK(local.radius <= spread + 0.01);
      CHECK(local.chi2 < 0.5 * local.chi2_before);
      REQUIRE(local.sensors.size() == 1);
      CHECK(local.sensors[0].train.points == 3 * local.samples);
      CHECK(local.sensors[0].train.rms_as_read < 0.5 * local.sensors[0].train.rms_before);
      Rig corrected = rig;
      for (const LocalOffset& o : local.offsets) {
        const double z = (o.offset - (o.joint == 2 ? a * std::sin(kCentre[2]) : 0)) / o.sigma;
        squares += z * z / 60;
        largest = std::max(largest, std::abs(z));
        CHECK(o.determined);
        CHECK(o.sigma < 0.3 * a);
        CHECK(o.variation <= o.sigma);
        corrected.joints[o.joint].offset += o.offset;
      }
      const std::vector<Sample> fresh = samples_near(rig, 40, 1000 + seed, 0.5 * spread, a);
      before += rms(rig, fresh) / 10;
      after += rms(corrected, fresh) / 10;
    }
    INFO("spread " << spread << ": rms z " << std::sqrt(squares) << ", largest " << largest
                   << ", fresh " << before << " -> " << after);
    CHECK(std::sqrt(squares) < 1.1);
    CHECK(std::sqrt(squares) > 0.3);
    CHECK(largest < 4);
    CHECK(after < 0.2 * before);
  }
}

TEST_CASE("local: the radius is where a constant offset stops to help") {
  // Of a pair of samples at q0 - d and q0 + d a constant c = a sin q0 gains
  // 2 c a (sin(q0 - d) + sin(q0 + d)) - 2 c^2 = 2 c^2 (2 cos d - 1): until d = pi/3.
  const Rig rig = arm();
  int good = 0;
  for (unsigned long seed = 1; seed <= 10; ++seed) {
    const LocalCalibration local =
        calibrate_locally(rig, samples_near(rig, 300, seed, 2, 0.003, 0.5), centre({2}), within(2));
    INFO("seed " << seed << ": radius " << local.radius << ", bandwidth " << local.bandwidth
                 << ", offset " << local.offsets.at(0).offset << ", significance "
                 << local.significance);
    REQUIRE(local.gain);
    REQUIRE(local.offsets.size() == 1);
    CHECK(local.ends);
    CHECK(local.radius == Approx(kPi / 3).margin(0.25));
    good += std::abs(local.radius - kPi / 3) < 0.12;
    CHECK(std::abs(local.offsets[0].offset - 0.003 * std::sin(kCentre[2])) <
          3 * local.offsets[0].sigma);
  }
  CHECK(good >= 7);
}

TEST_CASE("local: no gain is claimed where there is none") {
  const Rig rig = arm();
  int claims = 0;
  for (unsigned long seed = 1; seed <= 100; ++seed) {
    const double spread = seed % 2 ? 0.3 : 0.9;
    const LocalCalibration local = calibrate_locally(
        rig, samples_near(rig, seed % 4 < 2 ? 12 : 40, seed, spread, 0), centre(), within(1));
    REQUIRE(local.enough);
    claims += local.gain;
    if (local.gain) continue;
    for (const LocalOffset& o : local.offsets) {
      CHECK(o.offset == 0);
      CHECK(std::isnan(o.sigma));
    }
    CHECK(local.samples > 0);
  }
  CHECK(claims == 0);
}

TEST_CASE("local: a larger noise than stated is no local error") {
  const Rig rig = arm();
  Rig noisy = rig;
  for (JointSettings& j : noisy.joints) j.sigma *= 4;
  noisy.sensors[0].sigma = {4 * kSigma, 4 * kSigma, 4 * kSigma};
  for (unsigned long seed = 1; seed <= 30; ++seed) {
    std::vector<Sample> samples = samples_near(noisy, 30, seed, 0.4, 0);
    for (Sample& sample : samples) sample.views[0].sigma = rig.sensors[0].sigma;
    const LocalCalibration local = calibrate_locally(rig, samples, centre(), within(1));
    CHECK_FALSE(local.gain);
    CHECK(local.noise == Approx(4).epsilon(0.35));
  }
}

TEST_CASE("local: the estimate is that of a plain weighted fit") {
  // Mode none: residuals by the fixture's forward model, derivatives by differences, all of it as
  // one stacked system.
  const Rig rig = arm();
  const std::vector<Sample> samples = samples_near(rig, 30, 7, 0.3, 0.004);
  const LocalCalibration local =
      calibrate_locally(rig, samples, centre(), within(1, NoiseMode::none));
  REQUIRE(local.gain);
  VectorXd offsets(6);
  for (int j = 0; j < 6; ++j) offsets(j) = local.offsets.at(j).offset;
  MatrixXd a = MatrixXd::Identity(6, 6) * std::pow(local.noise / local.prior, 2);
  VectorXd g = -a * offsets;  // gradient of the penalised sum at the estimate, to be 0
  for (const Sample& s : samples) {
    double distance = 0;
    for (int j = 0; j < 6; ++j) distance = std::max(distance, std::abs(s.readings[j] - kCentre[j]));
    const double x = distance / local.bandwidth, w = x < 1 ? std::pow(1 - x * x, 2) : 0;
    const auto residual = [&](const VectorXd& d) {
      fixture::TruePosture posture = fixture::empty_posture(rig);
      posture.readings = s.readings;
      for (int j = 0; j < 6; ++j) posture.errors[j] = d(j);
      return VectorXd(fixture::residual(rig, s.views.at(0), posture) / kSigma);
    };
    MatrixXd jacobian(9, 6);
    for (int j = 0; j < 6; ++j) {
      const VectorXd step = 1e-6 * VectorXd::Unit(6, j);
      jacobian.col(j) = (residual(offsets + step) - residual(offsets - step)) / 2e-6;
    }
    a += w * jacobian.transpose() * jacobian;
    g -= w * jacobian.transpose() * residual(offsets);
  }
  const VectorXd step = fixture::dense::llt_solve(a, g);
  const MatrixXd inverse = fixture::dense::inverse(a);
  for (int j = 0; j < 6; ++j) CHECK(std::abs(step(j)) < 1e-3 * std::sqrt(inverse(j, j)));
}

TEST_CASE("local: no outcome depends on the order of samples") {
  const Rig rig = arm();
  std::vector<Sample> samples = samples_near(rig, 30, 3, 0.4, 0.002);
  const LocalCalibration one = calibrate_locally(rig, samples, centre(), within(1));
  std::reverse(samples.begin(), samples.end());
  std::swap(samples[3], samples[20]);
  const LocalCalibration other = calibrate_locally(rig, samples, centre(), within(1));
  REQUIRE(one.gain);
  CHECK(one.radius == other.radius);
  CHECK(one.bandwidth == other.bandwidth);
  for (size_t j = 0; j < one.offsets.size(); ++j) {
    CHECK(one.offsets[j].offset == other.offsets[j].offset);
    CHECK(one.offsets[j].sigma == other.offsets[j].sigma);
  }
}

TEST_CASE("local: what the data do not determine stays") {
  // One point on the axis of the last joint: its offset moves nothing.
  Rig rig = arm();
  rig.targets[0].points = Eigen::Vector3d(0, 0, 0.1);
  rig.targets[0].link_T_target = {};
  const LocalCalibration local =
      calibrate_locally(rig, samples_near(rig, 40, 5, 0.3, 0.004), centre(), within(1));
  REQUIRE(local.gain);
  for (const LocalOffset& o : local.offsets) {
    INFO("joint " << o.joint);
    CHECK(o.joint != 5);
  }
  // Almost on it: 0.1 mm aside, so that a mrad moves the point by a five hundredth of its noise.
  rig.targets[0].points = Eigen::Vector3d(0.0001, 0, 0.1);
  const LocalCalibration almost =
      calibrate_locally(rig, samples_near(rig, 40, 5, 0.3, 0.004), centre(), within(1));
  REQUIRE(almost.gain);
  REQUIRE(almost.offsets.size() == 6);
  CHECK_FALSE(almost.offsets[5].determined);
  CHECK(std::abs(almost.offsets[5].offset) < 1e-4);
  CHECK(almost.offsets[5].sigma > 0.9 * almost.prior);
  CHECK(almost.offsets[2].determined);
}

TEST_CASE("local: what no sample near reaches is unknown") {
  // A second arm, of one joint, that is far from the posture whenever it is seen. Beyond the
  // bandwidth nothing tells of it: no offset, no sigma, and the first arm's are as without it.
  Rig rig = arm();
  fixture::add_joint(rig, JointType::revolute, "other", "base", "other_hand", Vector3d::UnitZ(),
                     fixture::at({0, 0.5, 0.3}), kSigma);
  finish_tree(rig.tree);
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 0.05, 0, 0, 0, 0.05, 0, 0, 0.02;
  fixture::add_points(rig, "others", points, "other_hand", fixture::at({0.3, 0, 0}));
  const int other = fixture::joint_index(rig, "other");
  const Rig plain = arm();
  for (const double a : {0.02, 0.0}) {  // with a gain, that ends soon, and without
    std::vector<Sample> samples = samples_near(plain, 40, 1, 0.05, a);
    for (Sample& s : samples_near(plain, 40, 2, 0.9, -a)) {
      s.id += "_far";
      samples.push_back(s);
    }
    for (Sample& s : samples) s.readings.push_back(0);
    for (int i = 0; i < 12; ++i) {
      fixture::TruePosture p = fixture::empty_posture(rig);
      for (int j = 0; j < 6; ++j) p.readings[j] = kCentre[j];
      p.readings[other] = 0.95;
      Sample s = fixture::make_sample(rig, p, "other_" + std::to_string(i));
      fixture::Random random(100 + i);
      REQUIRE(fixture::add_view(s, rig, 0, 1, p, &random));
      samples.push_back(s);
    }
    LocalPosture posture = centre();
    posture[other] = 0;
    const LocalCalibration local = calibrate_locally(rig, samples, posture, within(1));
    INFO("bandwidth " << local.bandwidth);
    REQUIRE(local.enough);
    REQUIRE(local.offsets.size() == 7);
    CHECK(local.gain == (a > 0));
    for (const LocalOffset& o : local.offsets) {
      INFO("joint " << o.joint);
      const bool reached = o.joint != other || local.bandwidth > 0.95;
      CHECK(std::isfinite(o.offset) == reached);
      CHECK(std::isfinite(o.sigma) == (reached && local.gain));
      CHECK(std::isfinite(o.variation) == (reached && local.gain));
      CHECK((reached || !o.determined));
    }
    if (a == 0) continue;
    CHECK(local.bandwidth < 0.95);
    CHECK(local.offsets[2].offset ==
          Approx(a * std::sin(kCentre[2])).margin(4 * local.offsets[2].sigma));
  }
}

TEST_CASE("local: which samples take part") {
  const Rig rig = arm();
  std::vector<Sample> samples = samples_near(rig, 20, 9, 0.3, 0.003);
  SECTION("too few") {
    samples.resize(7);
    const LocalCalibration local = calibrate_locally(rig, samples, centre(), within(1));
    CHECK_FALSE(local.enough);
    CHECK(local.near == 7);
    CHECK(local.distances.size() == 7);
    CHECK_FALSE(calibrate_locally(rig, samples_near(rig, 20, 9, 0.3, 0.003), centre(), within(0.01))
                    .enough);
  }
  SECTION("without a reading") {
    for (int i = 0; i < 5; ++i) samples[i].readings[1] = std::numeric_limits<double>::quiet_NaN();
    for (int i = 0; i < 5; ++i) samples[i].views.clear();
    CHECK(calibrate_locally(rig, samples, centre(), within(1)).near == 15);
    for (Sample& s : samples) s.readings[1] = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_WITH(calibrate_locally(rig, samples, centre(), within(1)), Catch::Contains("j2"));
  }
  SECTION("a joint without end is as near after a turn") {
    const LocalCalibration plain = calibrate_locally(rig, samples, centre(), within(1));
    for (Sample& s : samples) s.readings[5] += 2 * kPi;
    const LocalCalibration turned = calibrate_locally(rig, samples, centre(), within(1));
    REQUIRE(plain.gain);
    REQUIRE(turned.gain);
    CHECK(turned.offsets[2].offset == Approx(plain.offsets[2].offset).epsilon(1e-6));
    for (Sample& s : samples) s.readings[0] += 2 * kPi;
    CHECK_FALSE(calibrate_locally(rig, samples, centre(), within(1)).enough);
  }
  SECTION("held out ones are judged only") {
    const LocalCalibration plain = calibrate_locally(rig, samples, centre(), within(1));
    std::vector<Sample> more = samples;
    for (Sample s : samples_near(rig, 10, 77, 0.2, 0.003)) {
      s.id += "_held_out";
      s.train = false;
      more.push_back(s);
    }
    const LocalCalibration local = calibrate_locally(rig, more, centre(), within(1));
    REQUIRE(local.gain);
    CHECK(local.offsets[2].offset == plain.offsets[2].offset);
    CHECK(local.sensors[0].test.points == 30);
    CHECK(local.sensors[0].test.rms_as_read < 0.3 * local.sensors[0].test.rms_before);
    CHECK(plain.sensors[0].test.points == 0);
  }
}

TEST_CASE("local: a pose that the rig leaves open is estimated, never the identity") {
  const Rig rig = arm();
  const std::vector<Sample> samples = samples_near(rig, 40, 3, 0.3, 0);
  Rig open = rig;
  open.sensors[0].link_T_sensor = Pose();
  open.sensors[0].pose_given = false;
  const LocalCalibration given = calibrate_locally(rig, samples, centre(), within(1)),
                         found = calibrate_locally(open, samples, centre(), within(1));
  CHECK(given.open.empty());
  CHECK(found.open == std::vector<std::string>{"sensor/tracker/pose"});
  REQUIRE(found.sensors.size() == 1);
  CHECK(found.sensors[0].train.rms_before < 1.5 * given.sensors[0].train.rms_before);
  // A rig whose steps hold the absent pose means the identity by it.
  Step step;
  step.name = "offsets";
  step.sensors = {0};
  step.free = {"joint/*/offset"};
  open.steps = {step};
  CHECK(calibrate_locally(open, samples, centre(), within(1)).open.empty());
}

}  // namespace local_test
