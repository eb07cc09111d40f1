#include "noise_levels.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../../solver/decompositions.h"
#include "../rig/numbers.h"

namespace kincal {
namespace {

constexpr double kLeastRedundancy = 5, kLeastShare = 0.02, kMostUncertain = 0.5;
constexpr double kLeastFactor = 1e-4;  // of a variance

/// E[w(s) s] / (m E[w(s)]) for s chi-squared with m degrees of freedom, by Simpson's rule over x = sqrt(s).
double consistency(const Loss& loss, int m) {
  if (loss.kind == LossKind::none) return 1;
  constexpr int kSteps = 2000;
  const double end = std::sqrt(m) + 10;
  double weighted = 0, weights = 0;
  for (int i = 1; i < kSteps; ++i) {
    const double x = end * i / kSteps, density = std::exp((m - 1) * std::log(x) - x * x / 2 + m / 2.0) * (i % 2 ? 4 : 2);
    double slope;
    loss(x * x, slope);
    weighted += density * slope * x * x;
    weights += density * slope;
  }
  return weighted / (m * weights);
}

bool has_noisy_joint(const Rig& rig, const View& view) {
  const Sensor& sensor = rig.sensors[view.sensor];
  const int to = rig.targets[view.target].link >= 0 ? rig.targets[view.target].link : rig.base;
  for (const PathStep& step : find_path(rig.tree, sensor.link, to)) {
    if (!rig.tree.joints[step.joint].moves() || step.joint == sensor.scanning_joint) continue;
    if (rig.joints[driver(rig.tree, step.joint).joint].sigma > 0) return true;
  }
  return false;
}

/// What is summed up over a group of rows; the last group is that of the priors.
struct Sums {
  double squares = 0;    // q, weighted
  double weights = 0;    // n
  double projected = 0;  // tr H
  MatrixXd shared;       // sum of B'B
  bool mixed = false;    // its rows hold other noise as well
};

}  // namespace

bool NoiseLevel::differs() const {
  return std::isfinite(seen) && std::abs(seen / assumed - 1) > 0.2 && std::abs(seen - assumed) > 3 * uncertainty * seen;
}

std::vector<NoiseLevel> noise_levels(Estimation& problem, const Rig& rig, const VectorXd& state, const MatrixXd& covariance) {
  const EstimationSetup& setup = problem.setup();
  const bool own_noise_only = setup.noise == NoiseMode::latent || setup.noise == NoiseMode::none;
  std::vector<NoiseLevel> levels;
  std::vector<int> of_sensor(rig.sensors.size(), -1), of_joint(rig.joints.size(), -1);
  std::vector<Sums> sums;
  std::vector<double> expected;  // b
  for (int s : setup.sensors) {
    const Sensor& sensor = rig.sensors[s];
    of_sensor[s] = static_cast<int>(levels.size());
    const SensorModel* point_form = setup.noise == NoiseMode::point ? sensor.model->point_form() : nullptr;
    for (const NoisePart& part : (point_form ? *point_form : *sensor.model).noise_parts()) {
      NoiseLevel level;
      level.of = "sensor/" + sensor.name;
      level.part = part.name;
      level.unit = part.unit;
      if (level.part == "joint" && rig.tree.joints[sensor.scanning_joint].type == JointType::prismatic) level.unit = "m";
      level.sensor = s;
      level.first = part.first;
      level.count = part.count;
      double squared = 0;
      for (int i = 0; i < part.count; ++i) squared += sensor.sigma[part.first + i] * sensor.sigma[part.first + i];
      level.assumed = std::sqrt(squared / part.count);
      levels.push_back(level);
      expected.push_back(consistency(setup.loss, sensor.model->rows()));
    }
  }
  if (setup.noise == NoiseMode::latent)
    for (size_t j = 0; j < rig.joints.size(); ++j) {
      if (!rig.tree.joints[j].has_reading() || !(rig.joints[j].sigma > 0)) continue;
      of_joint[j] = static_cast<int>(levels.size());
      NoiseLevel level;
      level.of = "joint/" + rig.tree.joints[j].name;
      level.unit = rig.tree.joints[j].type == JointType::prismatic ? "m" : "rad";
      level.joint = static_cast<int>(j);
      level.assumed = rig.joints[j].sigma;
      levels.push_back(level);
      expected.push_back(1);
    }

  // A root of the shared covariance; unobservable directions have none.
  const int n = problem.shared_size(), groups = static_cast<int>(levels.size()) + 1;
  MatrixXd root(n, n);
  if (n > 0) {
    root = root_of_covariance(covariance);
  }

  // Weights of the residuals.
  sums.resize(groups);
  for (Sums& s : sums) s.shared = MatrixXd::Zero(n, n);
  for (const ViewResiduals& r : problem.residuals(state)) {
    const Sensor& sensor = rig.sensors[r.view->sensor];
    const std::vector<NoisePart> parts = sensor.model->noise_parts();
    const int first = of_sensor[r.view->sensor];
    const bool split = own_noise_only && parts.size() > 1;
    const Eigen::Index block = setup.noise == NoiseMode::marginal                              ? r.whitened.size()
                               : setup.noise == NoiseMode::point && sensor.model->point_form() ? 3
                                                                                               : sensor.model->rows();
    for (Eigen::Index at = 0; at < r.whitened.size(); at += block) {
      double slope;
      setup.loss(r.whitened.segment(at, block).squaredNorm(), slope);
      for (size_t p = 0; p < (split ? parts.size() : 1); ++p) {
        const long count = split ? parts[p].count : static_cast<long>(block);
        sums[first + p].weights += slope * count;
        levels[first + p].rows += count;
      }
    }
    const bool mixed = !own_noise_only && (parts.size() > 1 || has_noisy_joint(rig, *r.view));
    const bool own = !r.view->covariance.empty() || r.view->sigma != sensor.sigma;
    for (int g = first; g < groups - 1 && levels[g].sensor == r.view->sensor; ++g) {
      sums[g].mixed = sums[g].mixed || mixed;
      levels[g].own_views += own;
    }
  }

  // S: per sample the small Gram matrices of what it has, then the shared part.
  MatrixXd s = MatrixXd::Zero(groups, groups), rows;
  std::vector<NoiseRows> whose;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    problem.noise_rows(static_cast<int>(g), state, rows, whose);
    const int k = shape.private_size, m = static_cast<int>(shape.columns.size());
    MatrixXd t(m, n);
    for (int i = 0; i < m; ++i) t.row(i) = root.row(shape.columns[i]);
    MatrixXd b = rows.middleCols(k, m) * t, u(rows.rows(), 0);
    if (k > 0) {
      u = Elimination(rows.leftCols(k)).basis();
      b -= u * (u.transpose() * b);
    }
    // Rows of one level together.
    std::map<int, std::pair<MatrixXd, MatrixXd>> grams;  // level -> U'U, U'B
    for (const NoiseRows& w : whose) {
      const int level = w.view ? of_sensor[w.view->sensor] + w.part : w.joint >= 0 ? of_joint[w.joint] : groups - 1;
      const auto ug = u.middleRows(w.first, w.count);
      const auto bg = b.middleRows(w.first, w.count);
      Sums& sum = sums[level];
      sum.squares += rows.col(k + m).segment(w.first, w.count).squaredNorm();
      sum.projected += ug.squaredNorm() + bg.squaredNorm();
      sum.shared.selfadjointView<Eigen::Lower>().rankUpdate(bg.transpose());
      if (!w.view) sum.weights += w.count;
      if (w.joint >= 0) ++levels[level].rows;
      const auto placed = grams.try_emplace(level);
      if (placed.second) placed.first->second = {MatrixXd::Zero(u.cols(), u.cols()), MatrixXd::Zero(u.cols(), n)};
      placed.first->second.first.noalias() += ug.transpose() * ug;
      placed.first->second.second.noalias() += ug.transpose() * bg;
    }
    for (const auto& a : grams)
      for (const auto& c : grams)
        s(a.first, c.first) += a.second.first.cwiseProduct(c.second.first).sum() + 2 * a.second.second.cwiseProduct(c.second.second).sum();
  }
  for (Sums& sum : sums) sum.shared.triangularView<Eigen::StrictlyUpper>() = sum.shared.transpose();
  for (int a = 0; a < groups; ++a)
    for (int c = 0; c < groups; ++c) s(a, c) += sums[a].shared.cwiseProduct(sums[c].shared).sum();
  VectorXd q(groups), redundancy(groups), spread(groups);
  for (int g = 0; g < groups; ++g) {
    s(g, g) += sums[g].weights - 2 * sums[g].projected;
    q(g) = sums[g].squares / (g + 1 < groups ? expected[g] : 1.0);
    redundancy(g) = std::max(0.0, sums[g].weights - sums[g].projected);
    spread(g) = redundancy(g) > 0 ? q(g) / redundancy(g) : 1;
  }

  // Solve for what can be told; the most uncertain one leaves until all that are left are certain enough.
  std::vector<int> active;
  for (int g = 0; g + 1 < groups; ++g)
    if (levels[g].rows > 0 && !sums[g].mixed && redundancy(g) >= kLeastRedundancy && redundancy(g) >= kLeastShare * levels[g].rows)
      active.push_back(g);
  VectorXd factor = VectorXd::Ones(groups), uncertainty = VectorXd::Constant(groups, kNan);
  while (!active.empty()) {
    const int a = static_cast<int>(active.size());
    MatrixXd part(a, a), noise(a, a);
    VectorXd right(a);
    factor.setOnes();
    for (int i = 0; i < a; ++i) factor(active[i]) = 0;
    for (int i = 0; i < a; ++i) {
      right(i) = q(active[i]) - s.row(active[i]).dot(factor);
      for (int j = 0; j < a; ++j) {
        part(i, j) = s(active[i], active[j]);
        noise(i, j) = 2 * spread(active[i]) * part(i, j) * spread(active[j]);
      }
    }
    // The least f >= 0 by Gauss and Seidel, from Foerstner's.
    VectorXd f(a);
    for (int i = 0; i < a; ++i) f(i) = spread(active[i]);
    for (int sweep = 0; sweep < 2000; ++sweep) {
      double change = 0;
      for (int i = 0; i < a; ++i) {
        const double next = std::max(kLeastFactor, f(i) + (right(i) - part.row(i).dot(f)) / part(i, i));
        change = std::max(change, std::abs(next - f(i)));
        f(i) = next;
      }
      if (change < 1e-12) break;
    }
    const MatrixXd inverse = solve_symmetric(part, MatrixXd::Identity(a, a));
    const VectorXd variance = (inverse * noise * inverse.transpose()).diagonal();
    int worst = 0;
    VectorXd relative(a);
    for (int i = 0; i < a; ++i) {
      relative(i) = variance(i) >= 0 ? std::sqrt(variance(i)) / (2 * f(i)) : std::numeric_limits<double>::infinity();
      if (!(relative(i) <= relative(worst))) worst = i;
    }
    for (int i = 0; i < a; ++i) {
      factor(active[i]) = f(i);
      uncertainty(active[i]) = relative(i);
    }
    if (relative(worst) <= kMostUncertain) break;
    factor(active[worst]) = 1;
    uncertainty(active[worst]) = kNan;
    active.erase(active.begin() + worst);
  }
  std::vector<NoiseLevel> out;
  for (int g = 0; g + 1 < groups; ++g) {
    if (levels[g].rows == 0) continue;
    NoiseLevel& level = levels[g];
    level.used = level.assumed;
    level.redundancy = redundancy(g);
    level.uncertainty = uncertainty(g);
    level.seen = std::isfinite(uncertainty(g)) ? level.assumed * std::sqrt(factor(g)) : kNan;
    out.push_back(std::move(level));
  }
  return out;
}

std::vector<NoiseLevel> noise_levels(const Linearisation& at) {
  return noise_levels(at.problem(), at.solution.rig(), at.state(), at.observability().covariance);
}

void scale_noise(Rig& rig, std::vector<Sample>& samples, const std::vector<NoiseLevel>& levels) {
  for (const NoiseLevel& level : levels) {
    if (!std::isfinite(level.seen)) continue;
    const double factor = level.seen / level.assumed;
    if (level.joint >= 0) {
      rig.joints[level.joint].sigma *= factor;
      continue;
    }
    const auto scale = [&](std::vector<double>& sigma) {
      for (int i = 0; i < level.count; ++i) sigma[level.first + i] *= factor;
    };
    scale(rig.sensors[level.sensor].sigma);
    for (Sample& sample : samples)
      for (View& view : sample.views) {
        if (view.sensor != level.sensor) continue;
        if (!view.sigma.empty()) scale(view.sigma);
        for (Matrix3d& covariance : view.covariance) covariance *= factor * factor;
      }
  }
}

}  // namespace kincal
