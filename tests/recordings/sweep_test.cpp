// Proves of sweeps and clouds, on simulated ones whose truth comes from the rig's geometry alone:
// corners of a large board come out without bias, each as well as the view's sigma says, in every
// coordinate, with noise, coarse intensities, a tilt that is fast or read with noise, dark squares
// that seem farther, and the board oblique, far and near (where its straight lines are curves of
// bearing and tilt: no bias of a quarter of a sigma, in no column or row); a reflector too; ids,
// readings and times are those of the beams; up and down are cut apart; what cannot be found has
// its reason; the mount of a laser beside a camera, calibrated from sweeps, is off by as much as
// its covariance says. Does not prove: that real lasers are as the simulated one (its spot is a
// Gaussian, its ranges on an edge are means).
#include "../../io/recordings/sweep.h"

#include <random>

#include "../../io/document/error.h"
#include "../../models/calibration/calibration.h"
#include "../../models/rig/recording.h"
#include "../../models/sensors/cameras.h"
#include "../../models/sensors/sensors.h"
#include "../fixtures/dense.h"
#include "../fixtures/sweeps.h"
#include "catch2/catch.hpp"

namespace sweep_test {

using namespace fixtures;

namespace {

/// Errors of points in each of three coordinates.
struct Errors {
  Vector3d sum = Vector3d::Zero(), squares = sum, in_sigmas = sum;
  int count = 0;

  void add(const Vector3d& e, const Vector3d& sigma) {
    sum += e;
    squares += e.cwiseAbs2();
    in_sigmas += e.cwiseQuotient(sigma).cwiseAbs2();
    ++count;
  }
  Vector3d bias() const { return sum / count; }
  Vector3d rms() const { return (squares / count).cwiseSqrt(); }
  Vector3d nees() const { return in_sigmas / count; }
};

Vector3d number(const BeamView& found, size_t i) {
  return Vector3d(found.view.z[3 * i], found.view.z[3 * i + 1], found.view.z[3 * i + 2]);
}

Errors errors_of_sweeps(const LaserBench& bench, int seeds, size_t least) {
  Errors out;
  for (int seed = 1; seed <= seeds; ++seed) {
    const BeamView found = find_in_sweep(bench.rig, 0, 0, bench.sweep(seed));
    INFO(found.words());
    REQUIRE(found.view.ids.size() >= least);
    const Vector3d sigma(found.view.sigma[0], found.view.sigma[1], found.view.sigma[2]);
    for (size_t i = 0; i < found.view.ids.size(); ++i)
      out.add(number(found, i) - bench.truth(found.view.ids[i]), sigma);
  }
  return out;
}

/// A cloud of a lidar in the base, at the origin of the laser's tilt: rings, or beams anywhere; in
/// no order.
Cloud cloud_of(const LaserBench& bench, std::uint64_t seed, bool rings, double ahead) {
  Cloud out;
  RandomStream draws(seed);
  const LaserScene scene = bench.scene(seed);
  std::vector<Vector3d> points;
  std::vector<double> intensities;
  for (int i = 0; i < 128; ++i)
    for (int k = 0; k < 512; ++k) {
      double azimuth = ahead - 0.8 + 1.6 * k / 512, elevation = -0.39 + 0.78 * i / 127;
      if (!rings)
        azimuth = ahead + draws.uniform(-0.8, 0.8), elevation = draws.uniform(-0.39, 0.39);
      Pose beam;
      beam.rotation = rotation_about(Vector3d::UnitZ(), azimuth) *
                      rotation_about(Vector3d::UnitY(), -elevation);
      const Beam seen = shoot(scene, beam, bench.look, draws);
      points.push_back(beam.rotation.col(0) * seen.range);
      intensities.push_back(seen.intensity);
    }
  std::vector<size_t> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937(1));
  for (const size_t i : order)
    out.points.push_back(points[i]), out.intensities.push_back(intensities[i]);
  return out;
}

/// A round bright patch on a dull sheet.
LaserBench reflector_bench() {
  LaserBench out("  spot: {type: points, points: [[0, 0, 0]], mount: free}");
  out.print = Print{[](double x, double y) { return x * x + y * y < 0.05 * 0.05 ? 3. : 0.4; },
                    cv::Rect2d(-0.2, -0.2, 0.4, 0.4)};
  return out;
}

}  // namespace

TEST_CASE("sweep: corners have no bias, and errors as large as the sigmas say") {
  struct Row {
    std::string name;
    double distance, yaw, pitch, roll;
    std::function<void(LaserBench&)> change;
    Vector3d rms;        // mrad, mrad, mm: at most
    double least, most;  // of the mean of (error / sigma)^2 in each coordinate
  };
  const std::vector<Row> rows = {
      {"3 m", 3, 0, 0, 0, [](LaserBench&) {}, {0.1, 0.1, 2}, 0.6, 1.5},
      {"oblique", 3, 0.7, 0.35, 0.1, [](LaserBench&) {}, {0.12, 0.12, 2.5}, 0.4, 1.5},
      {"5 m", 5, -0.3, 0.2, 0, [](LaserBench&) {}, {0.2, 0.2, 4}, 0.6, 1.5},
      {"fast", 3, 0.2, 0.1, 0, [](LaserBench& b) { b.speed = 0.3; }, {0.5, 0.2, 3.5}, 0.5, 1.6},
      {"noisy",
       3,
       0.2,
       0.1,
       0,
       [](LaserBench& b) { b.look.range_noise = 0.02, b.look.intensity_noise = 200; },
       {0.3, 0.3, 5},
       0.5,
       1.5},
      {"coarse steps",
       3,
       0.2,
       0.1,
       0,
       [](LaserBench& b) { b.look.step = 200, b.look.intensity_noise = 20; },
       {0.2, 0.25, 2},
       0.4,
       1.6},
      {"dark and bright four steps apart",
       3,
       0,
       0,
       0,
       [](LaserBench& b) { b.look.step = 400; },
       {0.2, 0.3, 2},
       0.4,
       1.6},
      {"dark squares 2 cm farther",
       3,
       0.2,
       0.1,
       0,
       [](LaserBench& b) { b.look.ink_range = 0.02; },
       {0.1, 0.1, 2},
       0.5,
       1.5},
      // Corners of a row share the noise of the joint's readings, so that each alone is better.
      {"readings of the joint with 0.2 mrad",
       3,
       0.2,
       0.1,
       0,
       [](LaserBench& b) { b.tilt_noise = 2e-4; },
       {0.15, 0.1, 2},
       0.1,
       1.5},
  };
  for (const Row& row : rows) {
    LaserBench bench(kLargeBoard);
    bench.place(row.distance, row.yaw, row.pitch, row.roll);
    row.change(bench);
    const Errors errors = errors_of_sweeps(bench, 3, 40);
    INFO(row.name << ": bias " << 1e3 * errors.bias().transpose() << ", rms "
                  << 1e3 * errors.rms().transpose() << " mrad, mrad, mm; (error / sigma)^2 "
                  << errors.nees().transpose());
    for (int k = 0; k < 3; ++k) {
      CHECK(std::abs(errors.bias()(k)) < 0.35 * errors.rms()(k));
      CHECK(1e3 * errors.rms()(k) < row.rms(k));
      CHECK(errors.nees()(k) > row.least);
      CHECK(errors.nees()(k) < row.most);
    }
  }
}

TEST_CASE(
    "sweep: near boards, whose lines are curves of bearing and tilt, are as wide as they are") {
  struct Row {
    std::string name;
    double yaw, pitch, roll;
  };
  for (const Row& row : {Row{"facing", 0, 0, 0}, Row{"oblique", 0.5, 0.3, 0.1}}) {
    LaserBench bench("  board: {type: chessboard, rows: 4, columns: 5, square: 0.11, mount: free}");
    bench.from = -0.45, bench.to = 0.45;
    bench.place(1, row.yaw, row.pitch, row.roll);
    const double sigma = 1e-3 * 0.09;  // of a corner's bearing and tilt, in such sweeps with noise
    bench.look.range_noise = bench.look.intensity_noise = 0;  // the bias alone
    bench.look.increment *= 0.4, bench.speed = 0.03;          // by beams close together
    Errors all, columns[5], rows[4];
    for (int seed = 1; seed <= 3; ++seed) {
      const BeamView found = find_in_sweep(bench.rig, 0, 0, bench.sweep(seed));
      INFO(row.name << ": " << found.words());
      REQUIRE(found.view.ids.size() >= 16);
      for (size_t i = 0; i < found.view.ids.size(); ++i) {
        const int id = found.view.ids[i];
        const Vector3d e = number(found, i) - bench.truth(id);
        for (Errors* of : {&all, &columns[id % 5], &rows[id / 5]}) of->add(e, Vector3d::Ones());
      }
    }
    INFO(row.name << ": bias " << 1e3 * all.bias().transpose() << ", of the first and last column "
                  << 1e3 * columns[0].bias().transpose() << "; "
                  << 1e3 * columns[4].bias().transpose() << " mrad, mrad, mm");
    CHECK(all.bias().head<2>().cwiseAbs().maxCoeff() < sigma / 20);
    for (const Errors& column : columns) CHECK(std::abs(column.bias()(1)) < sigma / 4);
    for (const Errors& line : rows) CHECK(std::abs(line.bias()(0)) < sigma / 4);
    CHECK(std::abs(columns[0].bias()(1) - columns[4].bias()(1)) < sigma / 5);
    CHECK(std::abs(all.bias()(2)) < 1e-4);
  }
}

TEST_CASE("sweep: a recording is cut into ways, and both ways find the board") {
  LaserBench bench(kLargeBoard);
  bench.place(3, 0.2, 0.1, 0);
  const Sweep up = bench.sweep(1);
  std::swap(bench.from, bench.to);
  Sweep both = up, down = bench.sweep(2);
  const double later = up.tilt.back().time + 0.5;
  for (double t = up.tilt.back().time + 0.01; t < later; t += 0.01)  // it rests in between
    both.tilt.push_back({t, up.tilt.back().reading});
  for (TiltReading r : down.tilt) both.tilt.push_back({r.time + later, r.reading});
  for (LaserScan scan : down.scans) scan.time += later, both.scans.push_back(scan);
  const std::vector<Sweep> ways = one_way_sweeps(both);
  REQUIRE(ways.size() == 2);
  for (const Sweep& way : ways) {
    const BeamView found = find_in_sweep(bench.rig, 0, 0, way);
    REQUIRE(found.view.ids.size() == 42);
    for (size_t i = 0; i < 42; ++i) {
      CHECK((number(found, i) - bench.truth(static_cast<int>(i))).head<2>().norm() < 6e-4);
      // When the joint was there.
      const double before = found.times[i] - 0.05, after = found.times[i] + 0.05;
      double low = 1e9, high = -1e9;
      for (const TiltReading& r : way.tilt)
        if (r.time > before && r.time < after)
          low = std::min(low, r.reading), high = std::max(high, r.reading);
      CHECK(found.view.z[3 * i] > low - 1e-3);
      CHECK(found.view.z[3 * i] < high + 1e-3);
    }
  }
}

TEST_CASE("sweep: a corner that is hidden is left out, and said") {
  LaserBench bench(kLargeBoard);
  bench.place(3, 0.2, 0.1, 0);
  Sweep sweep = bench.sweep(1);
  const Vector3d hidden = bench.truth(0);
  for (LaserScan& scan : sweep.scans) {  // no range, as of a hole
    for (size_t i = 0; i < scan.ranges.size(); ++i)
      if (std::abs(scan.angle_min + static_cast<double>(i) * scan.angle_increment - hidden(1)) <
          0.015)
        if (std::abs(bench.reading(scan.time) - hidden(0)) < 0.015) scan.ranges[i] = 0;
  }
  const BeamView found = find_in_sweep(bench.rig, 0, 0, sweep);
  REQUIRE(found.view.ids.size() == 41);
  CHECK(found.view.ids[0] == 1);
  CHECK(found.words().find("1 corners are hidden, or have no range") != std::string::npos);
}

TEST_CASE("sweep: too few beams on a square are no corners") {
  LaserBench bench(kLargeBoard);
  bench.place(3, 0.2, 0.1, 0);
  bench.look.increment *= 2;
  bench.speed = 0.3;
  const BeamView found = find_in_sweep(bench.rig, 0, 0, bench.sweep(1));
  CHECK(found.view.ids.empty());
  CHECK(found.reason.find("too few beams") != std::string::npos);
}

TEST_CASE("sweep: a laser's mount is calibrated to what its covariance says") {
  constexpr int kSeeds = 5;
  Sensor camera;
  camera.name = "eye", camera.type = "camera", camera.link = 0;
  camera.model = make_camera(Lens::pinhole, 0);
  camera.parameters = camera_parameters(Lens::pinhole, {600, 600, 319.5, 239.5}, {}, 0);
  camera.sigma = {0.1, 0.1};
  camera.image_width = 640, camera.image_height = 480;
  camera.pose_given = true;
  camera.link_T_sensor.rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  camera.link_T_sensor.translation = Vector3d(0.1, 0.05, 1.35);
  double nees = 0, chi2 = 0, dof = 0;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    LaserBench bench(kLargeBoard);
    bench.tilt_noise = 5e-5;
    bench.speed = 0.15;
    RandomStream draws(1000 + seed);
    RigFile rig = bench.rig;  // as designed: it does not know where the laser is
    rig.rig.sensors = {bench.rig.rig.sensors[0], camera};
    Sensor& laser = rig.rig.sensors[0];
    laser.link_T_sensor = laser.link_T_sensor * draws.error({0.01, 0.01, 0.01, 0.01, 0.01, 0.01});
    laser.pose_given = true;
    Step step;
    step.name = "all";
    step.sensors = {0, 1};
    step.free = {"sensor/laser/pose"};
    step.free_where = {""};
    rig.rig.steps = {step};
    std::vector<Sample> samples;
    for (int k = 0; k < 8; ++k) {
      bench.place(draws.uniform(2, 3.2), draws.uniform(-0.6, 0.6), draws.uniform(-0.4, 0.4),
                  draws.uniform(-0.3, 0.3), draws.uniform(-0.1, 0.1));
      Sample sample;
      sample.id = std::to_string(k);
      sample.readings.assign(rig.rig.joints.size(), kNan);
      const BeamView found = find_in_sweep(rig, 0, 0, bench.sweep(1000 * seed + k));
      INFO(found.words());
      REQUIRE(found.view.ids.size() == 42);
      View seen;
      seen.sensor = 1, seen.target = 0, seen.sigma = {0.1, 0.1};
      const Eigen::Matrix3Xd points = target_points(rig.rig.targets[0]);
      for (int i = 0; i < points.cols(); ++i) {
        const Vector3d p =
            inverse(camera.link_T_sensor) * (bench.base_T_target * Vector3d(points.col(i)));
        seen.ids.push_back(i);
        seen.z.push_back(600 * p.x() / p.z() + 319.5 + 0.1 * draws.normal());
        seen.z.push_back(600 * p.y() / p.z() + 239.5 + 0.1 * draws.normal());
      }
      sample.views = {found.view, seen};
      samples.push_back(sample);
    }
    Calibration calibration(make_recording(rig.rig, samples), {});
    const Solution& solution = calibration.solve();
    REQUIRE(solution.status == Status::converged);
    const Vector6d error = log_se3(inverse(bench.rig.rig.sensors[0].link_T_sensor) *
                                   *solution["sensor/laser/pose"].pose);
    nees += fixture::dense::weighted_square(error, solution.covariance);
    chi2 += solution.chi2, dof += static_cast<double>(solution.dof);
  }
  INFO("NEES/dof " << nees / (6 * kSeeds) << ", chi2/dof " << chi2 / dof);
  CHECK(nees / (6 * kSeeds) > 0.45);  // 99 % of 30 numbers: 0.46 to 1.79
  CHECK(nees / (6 * kSeeds) < 1.79);
  CHECK(chi2 / dof > 0.8);
  CHECK(chi2 / dof < 1.1);
}

TEST_CASE("sweep: a part of a larger chessboard is not a smaller one") {
  for (const double yaw : {0., 0.5})
    for (const char* rows : {"rows: 4, columns: 5", "rows: 6, columns: 5"}) {
      const std::string small = std::string("  small: {type: chessboard, ") + rows +
                                ", square: 0.0245, mount: free}\n" + kLargeBoard;
      LaserBench bench(small);
      const Target& large = bench.rig.rig.targets[1];
      bench.print = print_of(image_target(bench.rig, large));
      bench.rig.rig.targets[0].square = large.square;  // how the print lies
      bench.place(2.5, yaw, 0.1, 0);
      const Sweep sweep = bench.sweep(1);
      const BeamView found = find_in_sweep(bench.rig, 0, 0, sweep);
      INFO(rows << ": " << found.words());
      CHECK(found.view.ids.empty());
      CHECK(find_in_sweep(bench.rig, 0, 1, sweep).view.ids.size() == 42);
    }
}

TEST_CASE("sweep: what cannot be found has its reason") {
  LaserBench bench(kLargeBoard);
  bench.place(3, 0.2, 0.1, 0);
  const auto reason = [&](const Sweep& sweep) {
    const BeamView found = find_in_sweep(bench.rig, 0, 0, sweep);
    CHECK(found.view.ids.empty());
    return found.reason;
  };
  const Sweep whole = bench.sweep(1);
  Sweep dark = whole, few = whole, still = whole;
  for (LaserScan& scan : dark.scans) scan.intensities.clear();
  CHECK(reason(dark) == "the scans have no intensities: switch them on in the driver");
  few.scans.resize(3);
  CHECK(reason(few).find("only 3 scans") != std::string::npos);
  for (TiltReading& r : still.tilt) r.time += 1000;
  CHECK(reason(still) == "no beam has a range, an intensity and a reading of its joint");
  bench.place(3, 0, 0, 0, 5);  // above what the sweep sees
  CHECK(reason(bench.sweep(1)).find("no chessboard of 6 x 7") != std::string::npos);
  const LaserBench points("  three: {type: points, points: [[0, 0, 0], [1, 0, 0]], mount: free}");
  CHECK_THROWS_WITH(find_in_sweep(points.rig, 0, 0, whole),
                    Catch::Contains("target 'three' (points) is not found in what a laser sees"));
}

TEST_CASE("sweep: a reflector is found where its middle is") {
  for (const double yaw : {0., 0.5}) {
    LaserBench bench = reflector_bench();
    bench.place(3, yaw, 0.2, 0);
    const Errors errors = errors_of_sweeps(bench, 4, 1);
    INFO(1e3 * errors.bias().transpose() << "; " << errors.nees().transpose());
    CHECK((1e3 * errors.rms().head<2>()).maxCoeff() < 0.3);
    CHECK(1e3 * errors.rms()(2) < 2);
    CHECK(errors.nees().maxCoeff() < 3);  // of four
  }
}

TEST_CASE("cloud: a board's corners, wherever it stands, in beams of any order") {
  for (const bool rings : {true, false})
    for (const double ahead : {0., kPi}) {  // before the lidar, and where azimuths begin and end
      LaserBench bench(kLargeBoard);
      bench.place(2.4, 0.4, 0.2, 0.1);
      bench.base_T_target.translation.z() -= 1.2;
      Pose turn;
      turn.rotation = rotation_about(Vector3d::UnitZ(), ahead);
      bench.base_T_target = turn * bench.base_T_target;
      const Eigen::Matrix3Xd points = target_points(bench.rig.rig.targets[0]);
      double sum = 0, worst = 0, n = 0;
      for (int seed = 1; seed <= 2; ++seed) {
        const BeamView found = find_in_cloud(bench.rig, 1, 0, cloud_of(bench, seed, rings, ahead));
        INFO(found.words());
        REQUIRE(found.view.ids.size() == 42);
        for (size_t i = 0; i < 42; ++i, n += 3) {
          const Vector3d e =
              number(found, i) - bench.base_T_target * Vector3d(points.col(static_cast<int>(i)));
          sum += e.dot(found.view.covariance[i].inverse() * e);
          worst = std::max(worst, e.norm());
        }
      }
      CHECK(worst < 0.015);
      CHECK(sum / n > 0.6);
      CHECK(sum / n < 1.8);
    }
}

TEST_CASE("cloud: a reflector") {
  LaserBench bench = reflector_bench();
  bench.place(2, 0.4, 0.2, 0);
  bench.base_T_target.translation.z() -= 1.2;
  for (const bool rings : {true, false}) {
    const BeamView found = find_in_cloud(bench.rig, 1, 0, cloud_of(bench, 1, rings, 0));
    INFO(found.words());
    REQUIRE(found.view.ids.size() == 1);
    const Vector3d e = number(found, 0) - bench.base_T_target.translation;
    CHECK(e.norm() < 0.004);
    CHECK(e.dot(found.view.covariance[0].inverse() * e) < 16);
  }
  Cloud dark = cloud_of(bench, 1, true, 0);
  dark.intensities.clear();
  CHECK(find_in_cloud(bench.rig, 1, 0, dark).reason == "the cloud has no intensities");
}

}  // namespace sweep_test
