// Proves: levels of sensors are the standard deviation of Gaussian residuals, whatever a minority does; the bound of chi2 lies above its
// quantile at 1e-9 (by the incomplete gamma function in closed form) and not far above; influences equal least squares without the group,
// groups that alone determine something included; gross outliers are found and named in every noise mode, points, a view, a sample that
// cannot even start, and what is left is calibrated as if they had never been; held-out samples are left alone; views and samples that
// stick out of a plain fit are named. The program's tests (outliers_test.py) prove figures. It does not prove behaviour at outliers of
// less than seven sigmas.
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "../../../io/rig/rig_file.h"
#include "../../../io/rig/simulation_file.h"
#include "../../../models/analysis/leverage.h"
#include "../../../models/analysis/misfits.h"
#include "../../../models/fitting/robust.h"
#include "../../../models/simulation/simulation.h"
#include "../../../models/trials/outliers.h"

using namespace kincal;

namespace {

const std::string kExample = std::string(KINCAL_SOURCE_DIR) + "/examples/pr2/";

double normal(std::mt19937_64& engine) {
  const auto uniform = [&] { return (static_cast<double>(engine() >> 11) + 0.5) * 0x1p-53; };
  const double radius = std::sqrt(-2 * std::log(uniform()));
  return radius * std::cos(2 * M_PI * uniform());
}

MatrixXd random_matrix(std::mt19937_64& engine, int rows, int columns) {
  MatrixXd m(rows, columns);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) m(i, j) = normal(engine);
  return m;
}

/// P(chi2 > x) for an even number of degrees of freedom n: exp(-x/2) sum_{k < n/2} (x/2)^k / k!
double chi2_tail(double x, int n) {
  double term = std::exp(-x / 2), sum = 0;
  for (int k = 0; k < n / 2; ++k) {
    sum += term;
    term *= x / 2 / (k + 1);
  }
  return sum;
}

struct Laboratory {
  Rig rig = read_rig(kExample + "rig.yaml").rig;
  std::vector<Sample> samples;

  explicit Laboratory(int seed, int count = 48) {
    const ParameterTable table(rig);
    SimulationOptions options;
    options.postures = read_postures(kExample + "postures.jsonl", rig);
    options.samples = count;
    options.seed = static_cast<std::uint64_t>(seed);
    samples = simulate(rig, table, read_truth(kExample + "truth_values.json", table), options).samples;
  }
  bool camera(const View& v) const { return rig.sensors[v.sensor].type == "camera"; }
  /// Indices of samples with at least two camera views.
  std::vector<size_t> seen_twice() const {
    std::vector<size_t> out;
    for (size_t i = 0; i < samples.size(); ++i)
      if (std::count_if(samples[i].views.begin(), samples[i].views.end(), [&](const View& v) { return camera(v); }) >= 2) out.push_back(i);
    return out;
  }
  View& first_camera(size_t sample) {
    for (View& v : samples[sample].views)
      if (camera(v)) return v;
    FAIL("no camera");
    return samples[0].views[0];
  }
};

CalibrationResult run(const Rig& rig, const std::vector<Sample>& samples, NoiseMode noise) {
  CalibrationOptions options;
  options.noise = noise;
  return *Calibration(rig, samples).run(options);
}

}  // namespace

TEST_CASE("outliers: levels of sensors and the bound of chi2") {
  Rig rig;
  rig.sensors.resize(2);
  rig.sensors[0].model = rig.sensors[1].model = Laboratory(1, 2).rig.sensors[0].model;
  std::mt19937_64 engine(1);
  View view, other;
  view.sensor = 0;
  other.sensor = 1;
  std::vector<ViewResiduals> residuals(2);
  residuals[0].view = &view;
  residuals[0].whitened = 2.5 * random_matrix(engine, 20000, 1);
  residuals[1].view = &other;
  residuals[1].whitened = random_matrix(engine, 20000, 1);
  residuals[1].whitened.head(6000).array() += 1e4;  // 30 %
  const std::vector<double> levels = robust_levels(rig, residuals);
  CHECK(levels[0] == Approx(2.5).epsilon(0.03));
  CHECK(levels[1] > 1);
  CHECK(levels[1] < 1.8);
  for (int n : {2, 6, 20, 100, 400}) {
    CHECK(chi2_tail(chi2_bound(n), n) < 1e-9);
    CHECK(chi2_tail(chi2_bound(n), n) > 1e-12);
  }
}

TEST_CASE("outliers: influences equal least squares without the group") {
  std::mt19937_64 engine(2);
  const int n = 5;
  std::vector<GroupShape> groups;
  std::vector<MatrixXd> left;
  MatrixXd all(0, n + 1);
  for (int g = 0; g < 6; ++g) {
    GroupShape shape;
    for (int c = g % 2; c < n; ++c)
      if (c != 3 || g == 4) shape.columns.push_back(c);  // only group 4 knows column 3
    const int m = static_cast<int>(shape.columns.size());
    left.push_back(random_matrix(engine, 4, m + 1));
    MatrixXd wide = MatrixXd::Zero(4, n + 1);
    for (int i = 0; i < m; ++i) wide.col(shape.columns[i]) = left[g].col(i);
    wide.col(n) = left[g].col(m);
    all.conservativeResize(all.rows() + 4, n + 1);
    all.bottomRows(4) = wide;
    groups.push_back(shape);
  }
  // At the solution: subtract it.
  const VectorXd x = all.leftCols(n).colPivHouseholderQr().solve(all.col(n));
  all.col(n) -= all.leftCols(n) * x;
  for (size_t g = 0; g < groups.size(); ++g) left[g].col(left[g].cols() - 1) = all.col(n).segment(4 * static_cast<Eigen::Index>(g), 4);
  Observability observability;
  observability.covariance = (all.leftCols(n).transpose() * all.leftCols(n)).inverse();
  observability.root = observability.covariance.llt().matrixL();
  const std::vector<Influence> found = influences(groups, left, observability, 0);
  CHECK(std::is_sorted(found.begin(), found.end(),
                       [](const Influence& a, const Influence& b) { return std::abs(a.sigmas) > std::abs(b.sigmas); }));
  int finite = 0;
  for (const Influence& f : found) {
    if (f.group == 4) {
      CHECK((f.column == 3) == std::isinf(f.sigmas));
      if (f.column == 3) continue;
    }
    MatrixXd others = all;
    others.middleRows(4 * f.group, 4).setZero();
    const VectorXd moved = -others.leftCols(n).completeOrthogonalDecomposition().solve(others.col(n));
    CHECK(f.sigmas == Approx(moved(f.column) / std::sqrt(observability.covariance(f.column, f.column))).margin(1e-9));
    ++finite;
  }
  CHECK(finite == 6 * n - 1);
  CHECK(influences(groups, left, observability, 1e9).size() == 1);  // the infinite one
}

TEST_CASE("outliers: found and taken out in every noise mode, as if they had never been") {
  for (NoiseMode noise : {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point, NoiseMode::none}) {
    Laboratory lab(3);
    const std::vector<size_t> two = lab.seen_twice();
    REQUIRE(two.size() > 8);
    // Points of one view, a view numbered from the other corner, readings of another posture, a held-out sample that is wrong as well.
    View& points = lab.first_camera(two[0]);
    points.z[0] += 20;
    points.z[5] -= 30;
    View& flipped = lab.first_camera(two[1]);
    const std::vector<double> z = flipped.z;
    for (size_t i = 0; i < z.size(); i += 2) flipped.z[i] = z[z.size() - 2 - i], flipped.z[i + 1] = z[z.size() - 1 - i];
    Sample& wrong = lab.samples[two[2]];
    for (double& reading : wrong.readings)
      if (std::isfinite(reading)) reading = -reading - 0.3;
    Sample& held_out = lab.samples[two[3]];
    held_out.train = false;
    held_out.readings = wrong.readings;

    CalibrationOptions options;
    options.noise = noise;
    const std::optional<Cleaned> clean = calibrate_without_outliers(Calibration(lab.rig, lab.samples), options);
    REQUIRE(clean);
    std::vector<std::string> named;
    for (const Rejected& r : clean->result.rejected) {
      std::string name = r.sample + " " + r.sensor;
      for (int id : r.ids) name += " " + std::to_string(id);
      named.push_back(name);
      CHECK(!r.reason.empty());
      CHECK((r.sensor.empty() == r.target.empty()));
    }
    const auto id = [&](const View& v, size_t i) { return std::to_string(v.ids.empty() ? static_cast<int>(i) : v.ids[i]); };
    std::vector<std::string> expected = {
        lab.samples[two[0]].id + " " + lab.rig.sensors[points.sensor].name + " " + id(points, 0) + " " + id(points, 2),
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
    lab.samples[two[1]].views.erase(lab.samples[two[1]].views.begin() + (&flipped - lab.samples[two[1]].views.data()));
    lab.samples.erase(lab.samples.begin() + static_cast<std::ptrdiff_t>(two[2]));
    const CalibrationResult by_hand = run(lab.rig, lab.samples, noise);
    CHECK(clean->result.chi2 == by_hand.chi2);
    CHECK(clean->result.values.shared == by_hand.values.shared);
    CHECK(clean->calibration.samples().size() == lab.samples.size());
  }
}

TEST_CASE("outliers: what sticks out of a plain fit is named, and nothing else") {
  Laboratory lab(4);
  const std::vector<size_t> two = lab.seen_twice();
  const auto warnings = [&] {
    std::vector<Warning> out;
    for (const Warning& w : run(lab.rig, lab.samples, NoiseMode::latent).warnings)
      if (w.id.rfind("outlier", 0) == 0) out.push_back(w);
    return out;
  };
  CHECK(warnings().empty());
  View& view = lab.first_camera(two[0]);
  for (size_t i = 0; i < view.z.size(); ++i) view.z[i] += (i % 4 < 2 ? 3 : -3);  // corners that jitter by 3 px
  std::vector<Warning> found = warnings();
  REQUIRE(found.size() == 1);
  CHECK(found[0].id == "outlier_view");
  CHECK(found[0].text.find("'" + lab.samples[two[0]].id + "' " + lab.rig.sensors[view.sensor].name) != std::string::npos);
  CHECK(found[0].text.rfind("1 view ", 0) == 0);
  for (double& sigma : view.sigma) sigma *= 20;  // said so: nothing wrong
  CHECK(warnings().empty());
}

TEST_CASE("outliers: a sample that cannot start stays out, and none at all is an error") {
  Laboratory lab(5);
  const std::vector<size_t> two = lab.seen_twice();
  View& view = lab.first_camera(two[0]);
  for (double& z : view.z) z = 1e9;  // no direction
  const std::optional<Cleaned> clean = calibrate_without_outliers(Calibration(lab.rig, lab.samples), CalibrationOptions());
  REQUIRE(clean);
  REQUIRE(clean->result.rejected.size() == 1);
  CHECK(clean->result.rejected[0].sample == lab.samples[two[0]].id);
}
