// models/verify: figures of accuracy and repeatability, their limits, and the decision.
//
// Robots whose errors are random smooth functions of six joints, measured by an instrument with
// Gaussian noise; views made by hand. Proves: figures are those of ISO 9283 where these can be
// computed by hand; a rigid motion changes no distance, and refitting the base takes it out; robots
// near their tolerance pass wrongly, and fail wrongly, in at most 2.5 % of the cases, by positions,
// refitted positions, distances and rotations, with 5 (not refitted), 12, 30 and 100 postures; so
// do robots exactly at it in at most 4 %; the same where the tolerance is on the largest error;
// where the instrument is as large as the tolerance neither is proved; as many postures as are said
// to be needed prove it. Does not prove: errors of real robots, whose postures may not be spread as
// those of their use are.
#include "../../../models/verify/verification.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>

#include "../../../models/rig/random_stream.h"

namespace verification_test {

using namespace kincal;

namespace {

constexpr int kJoints = 6, kFeatures = 14;

/// A SmoothRobot errs by a smooth function of its joints.
struct SmoothRobot {
  explicit SmoothRobot(RandomStream& draws) {
    for (int f = 0; f < kFeatures; ++f) {
      for (int j = 0; j < kJoints; ++j) waves[f][j] = draws.index(4) == 0 ? draws.index(3) : 0;
      phases[f] = draws.uniform(0, 2 * kPi);
      amplitudes[f] = draws.normals() * std::exp(0.5 * draws.normal());
    }
  }
  Vector3d error(const double* q) const {
    Vector3d out{0, 0, 0};
    for (int f = 0; f < kFeatures; ++f) {
      double angle = phases[f];
      for (int j = 0; j < kJoints; ++j) angle += waves[f][j] * q[j];
      out += amplitudes[f] * std::cos(angle);
    }
    return size * out;
  }
  double waves[kFeatures][kJoints], phases[kFeatures];
  Vector3d amplitudes[kFeatures];
  double size = 1;
};

/// Views of random postures, with noise of this sigma along each axis.
std::vector<VerifiedView> measured(const SmoothRobot& robot, int postures, double sigma,
                                   RandomStream& draws) {
  std::vector<VerifiedView> out;
  for (int i = 0; i < postures; ++i) {
    double q[kJoints];
    for (double& angle : q) angle = draws.uniform(-kPi, kPi);
    VerifiedView view;
    view.posture = i;
    view.predicted = Vector3d(std::cos(q[0]) * (0.6 + 0.3 * std::cos(q[1])),
                              std::sin(q[0]) * (0.6 + 0.3 * std::cos(q[1])),
                              0.4 + 0.3 * std::sin(q[1]) + 0.1 * std::sin(q[2]));
    view.measured = view.predicted + robot.error(q) + sigma * draws.normals();
    view.noise = sigma * sigma * Matrix3d::Identity();
    view.turned = true;
    view.predicted_rotation = exp_so3(Vector3d(q[3], q[4], q[5]));
    const Vector3d turn = robot.error(q) + sigma * draws.normals();
    view.measured_rotation = view.predicted_rotation * exp_so3(turn);
    view.rotation_noise = view.noise;
    out.push_back(view);
  }
  return out;
}

using Figure = std::function<AccuracyFigure(std::vector<VerifiedView>)>;
const Figure kPositions = [](const std::vector<VerifiedView>& views) {
  return position_accuracy(views);
};
const Figure kRefitted = [](std::vector<VerifiedView> views) {
  refit_base(views);
  return position_accuracy(views, 6);
};
const Figure kRotations = [](const std::vector<VerifiedView>& views) {
  return rotation_accuracy(views);
};
const Figure kDistances = [](const std::vector<VerifiedView>& views) {
  return distance_accuracy(views);
};

struct Decisions {
  int above = 0, below = 0, passed_above = 0, failed_below = 0, open = 0;

  void add(bool is_above, Conformity answer) {
    ++(is_above ? above : below);
    passed_above += is_above && answer == Conformity::pass;
    failed_below += !is_above && answer == Conformity::fail;
    open += answer == Conformity::not_provable;
  }
};
/// Decides on robots whose tolerance is their true figure times exp(+-spread).
Decisions decide(const Figure& figure, int robots, int postures, double spread) {
  Decisions out;
  for (int r = 0; r < robots; ++r) {
    RandomStream draws(7, static_cast<std::uint64_t>(1000 * postures + r));
    SmoothRobot robot(draws);
    robot.size = 1e-4;
    const double truth = figure(measured(robot, 1000, 0, draws)).rms,
                 sigma = truth * draws.uniform(0.05, 0.4),
                 tolerance = truth * std::exp(draws.uniform(-spread, spread));
    out.add(truth > tolerance,
            conformity(figure(measured(robot, postures, sigma, draws)), tolerance));
  }
  return out;
}

/// Decides on robots whose tolerance is the true largest error of the measured postures times
/// exp(+-spread).
Decisions decide_largest(const Figure& figure, int robots, int postures, double spread) {
  Decisions out;
  for (int r = 0; r < robots; ++r) {
    RandomStream draws(8, static_cast<std::uint64_t>(1000 * postures + r));
    SmoothRobot robot(draws);
    robot.size = 1e-4;
    std::vector<VerifiedView> views = measured(robot, postures, 0, draws);
    const double truth = figure(views).max, sigma = truth * draws.uniform(0.02, 0.3),
                 tolerance = truth * std::exp(draws.uniform(-spread, spread));
    for (VerifiedView& view : views) {
      view.measured += sigma * draws.normals();
      view.measured_rotation = view.measured_rotation * exp_so3(sigma * draws.normals());
      view.noise = view.rotation_noise = sigma * sigma * Matrix3d::Identity();
    }
    out.add(truth > tolerance, conformity(figure(views), tolerance, true));
  }
  return out;
}

/// Checks the rates of wrong decisions near the tolerance, and of those at it.
void check_largest(const Figure& figure, int robots) {
  for (const int postures : {5, 60})
    for (const double spread : {0.3, 1e-6}) {
      const Decisions found = decide_largest(figure, robots, postures, spread);
      CAPTURE(postures, spread, found.above, found.below, found.passed_above, found.failed_below,
              found.open);
      CHECK(found.passed_above <= 0.025 * found.above);
      CHECK(found.failed_below <= 0.025 * found.below);
      if (spread > 0.1) CHECK(found.open < robots);
    }
}

/// Checks the rates of wrong decisions near the tolerance, and of those at it.
void check_decisions(const Figure& figure, int robots,
                     const std::vector<int>& sizes = {12, 30, 100}) {
  for (const int postures : sizes) {
    const Decisions near = decide(figure, robots, postures, 0.3);
    CAPTURE(postures, near.above, near.below, near.passed_above, near.failed_below, near.open);
    CHECK(near.passed_above <= 0.025 * near.above);
    CHECK(near.failed_below <= 0.025 * near.below);
    if (postures > 5) CHECK(near.open < robots);  // five prove no more than a factor of two
    const Decisions at = decide(figure, robots, postures, 1e-6);
    CAPTURE(at.above, at.below, at.passed_above, at.failed_below);
    CHECK(at.passed_above <= 0.04 * at.above);
    CHECK(at.failed_below <= 0.04 * at.below);
  }
}

/// Views of the corners of a cube of 1 m, without errors.
std::vector<VerifiedView> corners(double sigma) {
  std::vector<VerifiedView> out;
  for (int i = 0; i < 8; ++i) {
    VerifiedView view;
    view.posture = i;
    view.predicted = view.measured = Vector3d(i & 1, (i >> 1) & 1, (i >> 2) & 1);
    view.noise = sigma * sigma * Matrix3d::Identity();
    out.push_back(view);
  }
  return out;
}

}  // namespace

TEST_CASE("verify: robots near their tolerance, by positions") { check_decisions(kPositions, 150); }
TEST_CASE("verify: robots near their tolerance, refitted", "[slow]") {
  check_decisions(kRefitted, 150);
}
TEST_CASE("verify: robots near their tolerance, by distances", "[slow]") {
  check_decisions(kDistances, 150);
}
TEST_CASE("verify: robots near their tolerance, by rotations", "[slow]") {
  check_decisions(kRotations, 400);
}
TEST_CASE("verify: robots near their tolerance, five postures", "[slow]") {
  check_decisions(kPositions, 150, {5});
  check_decisions(kDistances, 150, {5});
}
TEST_CASE("verify: robots near their tolerance, by the largest error", "[slow]") {
  for (const Figure& figure : {kPositions, kRotations, kDistances}) check_largest(figure, 400);
}
TEST_CASE("verify: 1000 robots near their tolerance", "[.]") {  // with -s it says the rates
  for (const Figure& figure : {kPositions, kRefitted, kDistances, kRotations})
    check_decisions(figure, 1000);
  check_decisions(kPositions, 1000, {5});
  check_decisions(kDistances, 1000, {5});
  for (const Figure& figure : {kPositions, kRotations, kDistances}) check_largest(figure, 1000);
}

TEST_CASE("verify: figures by hand") {
  std::vector<VerifiedView> views = corners(1e-4);
  for (size_t i = 0; i < views.size(); ++i) views[i].measured.x() += i % 2 ? 5e-4 : -3e-4;
  const AccuracyFigure position = position_accuracy(views);
  CHECK(position.seen == Approx(std::sqrt(17e-8)));
  CHECK(position.instrument == Approx(std::sqrt(3e-8)));
  CHECK(position.rms == Approx(std::sqrt(14e-8)));
  CHECK(position.max == Approx(5e-4));
  CHECK(position.lower < position.rms);
  CHECK(position.upper > position.rms);
  CHECK(position.freedom < 8);  // errors along one axis: one square a posture, and few postures

  // A rigid motion changes no distance, and refitting takes it out.
  views = corners(1e-5);
  const Pose motion{exp_so3(Vector3d(0.1, -0.2, 0.3)), Vector3d(1, 2, 3)};
  for (VerifiedView& view : views) view.measured = motion * view.measured;
  CHECK(distance_accuracy(views).seen < 1e-12);
  CHECK(position_accuracy(views).seen > 1);
  CHECK((refit_base(views).translation - motion.translation).norm() < 1e-12);
  CHECK(position_accuracy(views, 6).seen < 1e-12);

  // x is 1 % too long: of 28 distances 4 are along x, 8 across a face with x, 4 through the cube.
  views = corners(1e-5);
  for (VerifiedView& view : views) view.measured.x() *= 1.01;
  const double face = std::sqrt(1.0201 + 1) - std::sqrt(2.0),
               space = std::sqrt(1.0201 + 2) - std::sqrt(3.0);
  const AccuracyFigure distance = distance_accuracy(views);
  CHECK(distance.seen == Approx(std::sqrt((4 * 1e-4 + 8 * face * face + 4 * space * space) / 28)));
  CHECK(distance.instrument == Approx(std::sqrt(2.0) * 1e-5));
  CHECK(distance.max == Approx(0.01));
}

TEST_CASE("verify: the largest error by hand") {
  // Without noise it is what is seen; with noise its upper limit is 2.05 sigmas above: Student's k
  // = 2 with 50 degrees of freedom.
  std::vector<VerifiedView> views = corners(0);
  views[3].measured.x() += 1e-3;
  AccuracyFigure figure = position_accuracy(views);
  CHECK(figure.max == Approx(1e-3));
  CHECK(figure.max_lower == Approx(1e-3));
  CHECK(figure.max_upper == Approx(1e-3));
  views = corners(1e-4);
  views[3].measured.x() += 1e-3;
  figure = position_accuracy(views);
  CHECK(figure.max_upper == Approx(1e-3 + 2.05e-4).epsilon(0.001));
  // One of 8 may be too long by 2.76 sigmas (2.3 % / 8), 3.0 of Student's; a tenth for the sides.
  CHECK(figure.max_lower < 1e-3 - 2.76e-4);
  CHECK(figure.max_lower > 1e-3 - 3.3e-4);
  CHECK(conformity(figure, 1.3e-3, true) == Conformity::pass);
  CHECK(conformity(figure, 1.1e-3, true) == Conformity::not_provable);
  CHECK(conformity(figure, 0.6e-3, true) == Conformity::fail);
  CHECK(share_below_largest(100) == Approx(std::pow(0.02275, 0.01)).epsilon(0.001));
  // Noise alone proves no error.
  CHECK(position_accuracy(corners(1e-4)).max_lower == 0);
}

TEST_CASE("verify: errors smaller than the stated noise") {
  std::vector<VerifiedView> views = corners(1e-3);
  for (size_t i = 0; i < views.size(); ++i) views[i].measured.x() += i % 2 ? 5e-4 : -3e-4;
  const AccuracyFigure figure = position_accuracy(views);
  CHECK(figure.rms == 0);
  CHECK(figure.lower == 0);
  CHECK(figure.upper > figure.seen);  // nothing is taken out of it
}

TEST_CASE("verify: noise that nobody states") {
  std::vector<VerifiedView> views = corners(1e-4);
  for (size_t i = 0; i < views.size(); ++i) views[i].measured.x() += i % 2 ? 5e-4 : -3e-4;
  const AccuracyFigure known = position_accuracy(views);
  for (VerifiedView& view : views) view.noise_known = false;
  const AccuracyFigure open = position_accuracy(barycentres(views));
  CHECK(open.rms == Approx(open.seen));
  CHECK(open.upper > known.upper);
  CHECK(open.lower == Approx(known.lower));
  CHECK_FALSE(distance_accuracy(views).noise_known);
}

TEST_CASE("verify: postures that repeat") {
  // One posture from two ways, about (3e-4, 2e-4, 0) and (3e-4, -2e-4, 0).
  std::vector<VerifiedView> views;
  for (const double y : {1e-4, 3e-4, -1e-4, -3e-4}) {
    VerifiedView view;
    view.approach = y > 0;
    view.measured = Vector3d(3e-4, y, 0);
    view.turned = true;
    view.measured_rotation = exp_so3(Vector3d(0, 0, 10 * y));
    views.push_back(view);
  }
  const std::vector<RepeatedPosture> all = repeated_postures(views);
  REQUIRE(all.size() == 1);
  CHECK(all[0].count == 4);
  CHECK(all[0].ap == Approx(3e-4));
  CHECK(all[0].rp == Approx(2e-4 + 3 * std::sqrt(4e-8 / 3)));  // distances 1, 3, 1, 3 times 1e-4
  CHECK(all[0].vap == Approx(4e-4));
  CHECK(all[0].rp_rotation.z() == Approx(3 * std::sqrt(20e-6 / 3)));
  const Scatter seen = scatter(views);
  CHECK(seen.freedom == 3);
  CHECK(seen.sigma == Approx(std::sqrt(20e-8 / 3)));
  CHECK_FALSE(seen.less);
  for (VerifiedView& view : views) view.noise = 1e-4 * Matrix3d::Identity();  // sigma 10 mm
  CHECK(scatter(views).less);
  CHECK(barycentres(views)[0].noise(0, 0) == Approx(0.25e-4));
}

TEST_CASE("verify: how many postures it takes") {
  RandomStream draws(3);
  SmoothRobot robot(draws);
  robot.size = 1e-4;
  const AccuracyFigure figure = position_accuracy(measured(robot, 20, 1e-5, draws));
  const double tolerance = 1.1 * figure.rms;
  REQUIRE(conformity(figure, tolerance) == Conformity::not_provable);
  const long needed = postures_needed(figure, tolerance);
  CHECK(needed > 20);
  CHECK(needed < 1000);
  const AccuracyFigure more =
      position_accuracy(measured(robot, static_cast<int>(2 * needed), 1e-5, draws));
  CHECK(conformity(more, 1.1 * more.rms) == Conformity::pass);
  CHECK(conformity(more, 0.8 * more.rms) == Conformity::fail);
  // An instrument whose noise is as large as the tolerance: no number of postures is enough.
  robot.size = 1e-5;
  AccuracyFigure blind = position_accuracy(measured(robot, 400, 1e-3, draws));
  const double half = 0.5 * blind.instrument;
  CHECK(conformity(blind, half) == Conformity::not_provable);
  blind.seen = 1.05 * blind.instrument;
  blind.rms = std::sqrt(blind.seen * blind.seen - blind.instrument * blind.instrument);
  CHECK(postures_needed(blind, half) == -1);
}

}  // namespace verification_test
