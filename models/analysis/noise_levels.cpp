#include "noise_levels.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "../../kinematics/floating.h"
#include "../../solver/decompositions.h"
#include "../../solver/kernels.h"
#include "../estimation/estimation.h"
#include "../rig/configuration.h"
#include "../rig/numbers.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kLeastRedundancy = 5, kMostUncertain = 0.5;
constexpr double kLeastFactor = 1e-4;        // of a variance
constexpr int kWaiting = 32;                 // rows summed at once: fast, changes no result
const double kGuessSpread = std::log(4.0);   // of a guess, in its logarithm
const double kJointsDiffer = std::log(2.0);  // noise of joints of one kind, in its logarithm

/// E[w(s) s] / (m E[w(s)]) for s chi-squared with m degrees of freedom, by Simpson's rule over x =
/// sqrt(s).
double consistency(const Loss& loss, int m) {
  if (loss.kind == LossKind::none) return 1;
  constexpr int kSteps = 2000;
  const double end = std::sqrt(m) + 10;
  double weighted = 0, weights = 0;
  for (int i = 1; i < kSteps; ++i) {
    const double x = end * i / kSteps,
                 density = std::exp((m - 1) * std::log(x) - x * x / 2 + m / 2.0) * (i % 2 ? 4 : 2);
    double slope;
    loss(x * x, slope);
    weighted += density * slope * x * x;
    weights += density * slope;
  }
  return weighted / (m * weights);
}

bool has_noisy_joint(const Rig& rig, const View& view) {
  const Target& target = rig.targets[view.target];
  const Sensor& sensor = rig.sensors[view.sensor];
  const std::vector<int> joints = joints_between(
      rig, sensor.link, target.link < 0 ? rig.base : target.link, sensor.scanning_joint);
  return std::any_of(joints.begin(), joints.end(), [&](int j) { return rig.joints[j].sigma > 0; });
}

/// Sums over the rows of one kind of noise.
struct RowSums {
  double squares = 0;    // weighted
  double weights = 0;    // n
  double projected = 0;  // tr H
  bool mixed = false;    // its rows hold other noise as well
  double expected = 1;   // b
};

/// The kinds of noise of a problem, one group of rows each.
struct NoiseKinds {
  std::vector<NoiseLevel> levels;
  std::vector<int> of_sensor, of_joint;  // index of the (first) level; -1: none
  std::vector<RowSums> sums;             // by level; the last ones are the priors'
  int shared_size = 0, ld = 0;
  MatrixXd shared;  // by level a column: minus the sum of B'B, the lower triangle, `ld` x size
  std::vector<MatrixXd> waiting;  // by level: rows of B that are not in it yet, each in a column
  std::vector<int> waits;         // by level: how many

  int count() const { return static_cast<int>(sums.size()); }
  bool is_priors(int kind) const { return kind + 1 == count(); }
  int of(const NoiseRows& rows) const {
    return rows.view         ? of_sensor[rows.view->sensor] + rows.part
           : rows.joint >= 0 ? of_joint[rows.joint]
                             : count() - 1;
  }
};

void add_sensors(const EstimationSetup& setup, const Rig& rig, NoiseKinds& kinds) {
  for (int s : setup.sensors) {
    const Sensor& sensor = rig.sensors[s];
    kinds.of_sensor[s] = static_cast<int>(kinds.levels.size());
    const SensorModel* point_form =
        setup.noise == NoiseMode::point ? sensor.model->point_form() : nullptr;
    for (const NoisePart& part : (point_form ? *point_form : *sensor.model).noise_parts()) {
      NoiseLevel level;
      level.of = "sensor/" + sensor.name;
      level.part = part.name;
      level.unit = part.unit;
      if (level.part == "joint" &&
          rig.tree.joints[sensor.scanning_joint].type == JointType::prismatic)
        level.unit = "m";
      level.sensor = s;
      level.first = part.first;
      level.count = part.count;
      double squared = 0;
      for (int i = 0; i < part.count; ++i)
        squared += sensor.sigma[part.first + i] * sensor.sigma[part.first + i];
      level.assumed = std::sqrt(squared / part.count);
      if (!sensor.noise_guess.empty())  // all numbers of a part have the same factor
        level.guess = level.assumed * sensor.noise_guess[part.first] / sensor.sigma[part.first];
      kinds.levels.push_back(level);
      kinds.sums.emplace_back();
      kinds.sums.back().expected = consistency(setup.loss, sensor.model->rows());
    }
  }
}

void add_joints(const Rig& rig, NoiseKinds& kinds) {
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    const Joint& joint = rig.tree.joints[j];
    if (!joint.drives() || !(rig.joints[j].sigma > 0)) continue;
    const int first = same_noise(rig.tree, static_cast<int>(j)).front();
    if (first != static_cast<int>(j)) {
      kinds.of_joint[j] = kinds.of_joint[first];
      continue;
    }
    kinds.of_joint[j] = static_cast<int>(kinds.levels.size());
    NoiseLevel level;
    level.of = "joint/" + read_name(rig.tree, first);
    if (joint.floating >= 0)
      level.part = joint.type == JointType::prismatic ? "translation" : "rotation";
    level.unit = rig.tree.joints[j].type == JointType::prismatic ? "m" : "rad";
    level.joint = static_cast<int>(j);
    level.assumed = rig.joints[j].sigma;
    level.guess = rig.joints[j].noise_guess;
    kinds.levels.push_back(level);
    kinds.sums.emplace_back();
  }
}

NoiseKinds find_kinds(const EstimationSetup& setup, const Rig& rig, int shared_size) {
  NoiseKinds out;
  out.of_sensor.assign(rig.sensors.size(), -1);
  out.of_joint.assign(rig.joints.size(), -1);
  add_sensors(setup, rig, out);
  if (setup.noise == NoiseMode::latent) add_joints(rig, out);
  out.sums.emplace_back();
  out.shared_size = shared_size;
  out.ld = padded(shared_size) + kSlack;
  out.shared.setZero(static_cast<Eigen::Index>(out.ld) * shared_size, out.count());
  out.waiting.assign(out.count(), MatrixXd(out.ld, kWaiting));
  out.waits.assign(out.count(), 0);
  return out;
}

/// Counts and weighs the residuals of all views, and finds those whose rows hold other noise as
/// well.
void add_residuals(const EstimationSetup& setup, const Rig& rig,
                   const std::vector<ViewResiduals>& views, NoiseKinds& kinds) {
  const bool own_noise_only = setup.noise == NoiseMode::latent || setup.noise == NoiseMode::none;
  for (const ViewResiduals& r : views) {
    const Sensor& sensor = rig.sensors[r.view->sensor];
    const std::vector<NoisePart> parts = sensor.model->noise_parts();
    const int first = kinds.of_sensor[r.view->sensor];
    const bool split = own_noise_only && parts.size() > 1;
    Loss loss = setup.loss;  // as the rows were weighed with it
    if (!setup.noise_ratios.empty()) loss.scale *= setup.noise_ratios[r.view->sensor];
    const Eigen::Index block = setup.noise == NoiseMode::marginal ? r.whitened.size()
                               : setup.noise == NoiseMode::point && sensor.model->point_form()
                                   ? 3
                                   : sensor.model->rows();
    for (Eigen::Index at = 0; at < r.whitened.size(); at += block) {
      double slope;
      loss(r.whitened.segment(at, block).squaredNorm(), slope);
      for (size_t p = 0; p < (split ? parts.size() : 1); ++p) {
        const long count = split ? parts[p].count : static_cast<long>(block);
        kinds.sums[first + p].weights += slope * count;
        kinds.levels[first + p].rows += count;
      }
    }
    const bool mixed = !own_noise_only && (parts.size() > 1 || has_noisy_joint(rig, *r.view));
    const bool own = !r.view->covariance.empty() || r.view->sigma != sensor.sigma;
    for (int g = first; !kinds.is_priors(g) && kinds.levels[g].sensor == r.view->sensor; ++g) {
      kinds.sums[g].mixed = kinds.sums[g].mixed || mixed;
      kinds.levels[g].own_views += own;
      if (own || kinds.sums[g].mixed) kinds.levels[g].guess = 0;
    }
  }
}

/// The rows of one group of the problem: U and B of the header, row i in column i (zeros below to a
/// multiple of 8), its residuals, and which rows are which kind of noise.
struct ProjectedRows {
  MatrixXd u, b;
  std::vector<NoiseRows> kinds;
  VectorXd residuals;
};

/// Eliminates the private unknowns of one group; `root` is T of the header, `ld` as of NoiseKinds.
ProjectedRows project(const Estimation& problem, int group, const VectorXd& state,
                      const MatrixXd& root, int ld) {
  ProjectedRows out;
  MatrixXd rows;
  const GroupShape& shape = problem.groups()[group];
  problem.noise_rows(group, state, rows, out.kinds);
  const int k = shape.private_size, m = static_cast<int>(shape.columns.size()),
            n = static_cast<int>(root.cols()), count = static_cast<int>(rows.rows());
  MatrixXd t(ld, m);  // row i of T in column i
  t.bottomRows(ld - n).setZero();
  for (int i = 0; i < m; ++i) t.col(i).head(n) = root.row(shape.columns[i]).transpose();
  out.b.setZero(ld, count);
  for (const NoiseRows& w : out.kinds)  // a joint's error is private: its rows depend on no other
    if (w.joint < 0)
      kernels().multiply(&rows(w.first, k), 1, count, w.count, m, t.data(), ld, n,
                         out.b.col(w.first).data(), ld);
  out.b.bottomRows(ld - n).setZero();  // (scratch of the kernel)
  out.u.resize(0, count);
  if (k > 0) {
    const MatrixXd u = range_of(rows.leftCols(k));
    const int rank = static_cast<int>(u.cols());
    MatrixXd within(ld, rank), taken(ld, count);
    within.bottomRows(ld - n).setZero();
    kernels().multiply(u.data(), count, 1, rank, count, out.b.data(), ld, n, within.data(), ld);
    kernels().multiply(u.data(), 1, count, count, rank, within.data(), ld, n, taken.data(), ld);
    out.b.topRows(n) -= taken.topRows(n);
    out.u.setZero(padded(rank), count);
    out.u.topRows(rank) = u.transpose();
  }
  out.residuals = rows.col(k + m);
  return out;
}

/// Adds the waiting rows of one kind to `shared`.
void add_waiting(int kind, NoiseKinds& kinds) {
  kernels().subtract_product(kinds.shared.col(kind).data(), kinds.shared_size, kinds.ld,
                             kinds.waiting[kind].data(), std::exchange(kinds.waits[kind], 0),
                             kinds.ld);
}

/// Adds one group of the problem to the sums, and what it has for itself to S: with P = U U' and Q
/// = B B', between its rows, <U_g'U_g, U_j'U_j> is the sum of all P(i, l)^2, i a row of g, l one of
/// j, and <U_g'B_g, U_j'B_j> that of all P(i, l) Q(i, l).
void add_group(const ProjectedRows& rows, NoiseKinds& kinds, MatrixXd& s) {
  const Eigen::Index count = rows.residuals.size();
  const MatrixXd p = gram(rows.u), q = gram(rows.b);
  VectorXd of_column(count);
  for (const NoiseRows& w : rows.kinds) {
    const int kind = kinds.of(w);
    RowSums& sum = kinds.sums[kind];
    sum.squares += rows.residuals.segment(w.first, w.count).squaredNorm();
    sum.projected += (p + q).diagonal().segment(w.first, w.count).sum();
    for (int i = w.first; i < w.first + w.count; ++i) {
      if (kinds.waits[kind] == kWaiting) add_waiting(kind, kinds);
      kinds.waiting[kind].col(kinds.waits[kind]++) = rows.b.col(i);
    }
    if (!w.view) sum.weights += w.count;
    if (w.joint >= 0) ++kinds.levels[kind].rows;
    const auto pw = p.middleCols(w.first, w.count), qw = q.middleCols(w.first, w.count);
    of_column.noalias() = (pw.array() * (pw + 2 * qw).array()).rowwise().sum().matrix();
    for (const NoiseRows& v : rows.kinds)
      s(kinds.of(v), kind) += of_column.segment(v.first, v.count).sum();
  }
}

/// What Helmert's equations S f = q are made of, by kind of noise.
struct RowsLeft {
  MatrixXd s;
  VectorXd q, redundancy, spread;  // spread: Foerstner's f
};

RowsLeft find_rows_left(const Estimation& problem, const VectorXd& state,
                        const MatrixXd& covariance, NoiseKinds& kinds, const Progress& progress) {
  const int groups = kinds.count();
  // A root of the shared covariance; unobservable directions have none.
  MatrixXd root(problem.shared_size(), problem.shared_size());
  if (problem.shared_size() > 0) root = root_of_covariance(covariance);
  RowsLeft out{MatrixXd::Zero(groups, groups), VectorXd(groups), VectorXd(groups),
               VectorXd(groups)};
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    if (g % kGroupsTold == 0)
      progress.share(static_cast<double>(g), static_cast<double>(problem.groups().size()));
    add_group(project(problem, static_cast<int>(g), state, root, kinds.ld), kinds, out.s);
  }
  for (int kind = 0; kind < groups; ++kind) add_waiting(kind, kinds);
  // The product of two symmetric matrices: what is below the diagonal counts twice.
  for (int g = 0; g < groups; ++g) {
    Eigen::Map<MatrixXd> sum(kinds.shared.col(g).data(), kinds.ld, kinds.shared_size);
    for (int i = 0; i < kinds.shared_size; ++i) {
      sum.col(i).head(i).setZero();
      sum.col(i).tail(kinds.ld - i - 1) *= std::sqrt(2.0);
    }
  }
  out.s += gram(kinds.shared);
  for (int g = 0; g < groups; ++g) {
    const RowSums& sum = kinds.sums[g];
    out.s(g, g) += sum.weights - 2 * sum.projected;
    out.q(g) = sum.squares / sum.expected;
    out.redundancy(g) = std::max(0.0, sum.weights - sum.projected);
    out.spread(g) = out.redundancy(g) > 0 ? out.q(g) / out.redundancy(g) : 1;
  }
  return out;
}

/// Factors of the variances and the standard deviations of the sigmas, relative to them.
struct Factors {
  VectorXd factor, uncertainty;
};

/// The least f >= 0 with S f = q, by Gauss and Seidel, from `f` on.
VectorXd solve_factors(const MatrixXd& s, const VectorXd& q, VectorXd f) {
  for (int sweep = 0; sweep < 2000; ++sweep) {
    double change = 0;
    for (Eigen::Index i = 0; i < f.size(); ++i) {
      const double next = std::max(kLeastFactor, f(i) + (q(i) - s.row(i).dot(f)) / s(i, i));
      change = std::max(change, std::abs(next - f(i)));
      f(i) = next;
    }
    if (change < 1e-12) break;
  }
  return f;
}

/// Solves for the active kinds; the factors of the others are held at 1.
Factors solve_active(const RowsLeft& left, const std::vector<int>& active) {
  const int a = static_cast<int>(active.size());
  VectorXd held = VectorXd::Ones(left.q.size());
  for (int i = 0; i < a; ++i) held(active[i]) = 0;
  MatrixXd part(a, a), noise(a, a);
  VectorXd right(a), start(a);
  for (int i = 0; i < a; ++i) {
    right(i) = left.q(active[i]) - left.s.row(active[i]).dot(held);
    start(i) = left.spread(active[i]);
    for (int j = 0; j < a; ++j) {
      part(i, j) = left.s(active[i], active[j]);
      noise(i, j) = 2 * left.spread(active[i]) * part(i, j) * left.spread(active[j]);
    }
  }
  Factors out{solve_factors(part, right, start), VectorXd(a)};
  const MatrixXd inverse = solve_symmetric(part, MatrixXd::Identity(a, a));
  const VectorXd variance = (inverse * noise * inverse.transpose()).diagonal();
  for (int i = 0; i < a; ++i)
    out.uncertainty(i) =
        variance(i) >= 0 ? std::sqrt(variance(i)) / (2 * out.factor(i)) : kInfinity;
  return out;
}

/// The factors of all kinds; those that cannot be estimated have factor 1 and uncertainty NaN. Of
/// the kinds solved for, the most uncertain one leaves until all that are left are certain enough.
Factors find_factors(const NoiseKinds& kinds, const RowsLeft& left) {
  const int groups = kinds.count();
  std::vector<int> active;
  for (int g = 0; !kinds.is_priors(g); ++g)
    if (kinds.levels[g].rows > 0 && !kinds.sums[g].mixed &&
        left.redundancy(g) >= kLeastRedundancy &&
        left.redundancy(g) >= kLeastShare * kinds.levels[g].rows)
      active.push_back(g);
  Factors out{VectorXd::Ones(groups), VectorXd::Constant(groups, kNan)};
  while (!active.empty()) {
    const Factors now = solve_active(left, active);
    const int a = static_cast<int>(active.size());
    int worst = 0;
    for (int i = 0; i < a; ++i)
      if (!(now.uncertainty(i) <= now.uncertainty(worst))) worst = i;
    if (now.uncertainty(worst) <= kMostUncertain) {
      for (int i = 0; i < a; ++i) {
        out.factor(active[i]) = now.factor(i);
        out.uncertainty(active[i]) = now.uncertainty(i);
      }
      break;
    }
    active.erase(active.begin() + worst);
  }
  return out;
}

/// Kinds of noise with one unknown factor, and the factor's logarithm now, from its guess.
struct UnknownFactor {
  std::vector<int> kinds;
  double now = 0;
};

/// A factor for each kind without a stated value, and for stated ones that may be wrong.
std::vector<UnknownFactor> unknown_factors(const NoiseKinds& kinds, const Rig& rig,
                                           const DoubtedNoise& doubted) {
  std::vector<UnknownFactor> out;
  UnknownFactor all_stated{{}, std::log(doubted.factor.value_or(1))};
  for (int g = 0; !kinds.is_priors(g); ++g) {
    const NoiseLevel& level = kinds.levels[g];
    if (level.guess > 0)
      out.push_back({{g}, std::log(level.assumed / level.guess)});
    else if (kinds.sums[g].mixed)
      continue;
    else if (doubted.stated)
      out.push_back({{g}, std::log(first_sigma(rig, level) / first_sigma(*doubted.stated, level))});
    else
      all_stated.kinds.push_back(g);
  }
  if (doubted.factor && !all_stated.kinds.empty()) out.push_back(std::move(all_stated));
  return out;
}

/// Levels whose guesses may be off alike.
bool are_alike(const NoiseLevel& a, const NoiseLevel& b) {
  return a.joint >= 0 && b.joint >= 0 && a.unit == b.unit && a.part == b.part &&
         (a.guess > 0) == (b.guess > 0);
}

/// Covariance of the guesses' errors, of their logarithms.
MatrixXd guess_covariance(const NoiseKinds& kinds, const std::vector<UnknownFactor>& factors) {
  const auto n = static_cast<Eigen::Index>(factors.size());
  MatrixXd out = MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j)
      if (const NoiseLevel& a = kinds.levels[factors[i].kinds[0]],
          &b = kinds.levels[factors[j].kinds[0]];
          i == j || are_alike(a, b))
        out(i, j) = kGuessSpread * kGuessSpread + (i == j ? kJointsDiffer * kJointsDiffer : 0);
  return out;
}

/// A step of scoring for unknown factors, from the present sigmas on: `seen` and `uncertainty` of
/// these levels.
void estimate_factors(NoiseKinds& kinds, const RowsLeft& left,
                      const std::vector<UnknownFactor>& factors) {
  if (factors.empty()) return;
  const auto n = static_cast<Eigen::Index>(factors.size());
  const MatrixXd prior =
      solve_symmetric(guess_covariance(kinds, factors), MatrixXd::Identity(n, n));
  MatrixXd sum = MatrixXd::Zero(left.q.size(), n);  // of the kinds of each factor
  VectorXd now(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    now(i) = factors[i].now;
    for (const int g : factors[i].kinds) sum(g, i) = 1;
  }
  const VectorXd q = sum.transpose() * left.q, redundancy = sum.transpose() * left.redundancy;
  const MatrixXd information = 2 * sum.transpose() * left.s * sum;
  VectorXd slope(n), hidden(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double spread = redundancy(i) > 0 ? q(i) / redundancy(i) : 1;
    const double f = std::min(spread, 1 / kLeastFactor);
    slope(i) = f > 1 + 1e-6 ? std::sqrt((f - 1) / std::log(f)) : 1;
    hidden(i) = 2 * std::max(0.0, redundancy(i) - information(i, i) / 2);
  }
  MatrixXd step = slope.asDiagonal() * information * slope.asDiagonal();
  step.diagonal() += hidden;
  const VectorXd d = solve_symmetric(step + prior, q - redundancy - prior * now);
  const MatrixXd covariance = solve_symmetric(information + prior, MatrixXd::Identity(n, n));
  for (Eigen::Index i = 0; i < n; ++i)
    for (const int g : factors[i].kinds) {
      kinds.levels[g].seen = kinds.levels[g].assumed * std::exp(d(i));
      kinds.levels[g].uncertainty = std::sqrt(covariance(i, i));
    }
}

}  // namespace

std::pair<double, double> NoiseLevel::interval() const {
  return {used * std::sqrt(std::max(0.0, 1 - 4 * uncertainty)), used * std::exp(2 * uncertainty)};
}

bool NoiseLevel::differs() const {
  return std::isfinite(seen) && std::abs(seen / assumed - 1) > 0.2 &&
         std::abs(seen - assumed) > 3 * uncertainty * seen;
}

namespace {

/// The kinds of noise of a problem, with the residuals of its views.
NoiseKinds kinds_in(const Estimation& problem, const Rig& rig,
                    const std::vector<ViewResiduals>& views) {
  NoiseKinds out = find_kinds(problem.setup(), rig, problem.shared_size());
  add_residuals(problem.setup(), rig, views, out);
  return out;
}

std::vector<NoiseLevel> levels_of(const Estimation& problem, const VectorXd& state,
                                  const MatrixXd& covariance, NoiseKinds kinds,
                                  const std::vector<UnknownFactor>& unknown,
                                  const Progress& progress) {
  const RowsLeft left = find_rows_left(problem, state, covariance, kinds, progress);
  const Factors factors = find_factors(kinds, left);
  std::vector<NoiseLevel> out;
  for (int g = 0; !kinds.is_priors(g); ++g) {
    NoiseLevel& level = kinds.levels[g];
    if (level.rows == 0) continue;
    level.used = level.assumed;
    level.redundancy = left.redundancy(g);
    level.uncertainty = factors.uncertainty(g);
    level.seen =
        std::isfinite(factors.uncertainty(g)) ? level.assumed * std::sqrt(factors.factor(g)) : kNan;
  }
  estimate_factors(kinds, left, unknown);
  for (const NoiseLevel& level : kinds.levels)
    if (level.rows > 0) out.push_back(level);
  return out;
}

}  // namespace

std::vector<NoiseLevel> noise_levels(Estimation& problem, const Rig& rig, const VectorXd& state,
                                     const MatrixXd& covariance, const DoubtedNoise& doubted) {
  NoiseKinds kinds = kinds_in(problem, rig, problem.residuals(state));
  const std::vector<UnknownFactor> unknown = unknown_factors(kinds, rig, doubted);
  return levels_of(problem, state, covariance, std::move(kinds), unknown, {});
}

double first_sigma(const Rig& rig, const NoiseLevel& level) {
  return level.joint >= 0 ? rig.joints[level.joint].sigma
                          : rig.sensors[level.sensor].sigma[level.first];
}

std::vector<double> robust_joint_ratios(const Estimation& problem, const Rig& rig,
                                        const VectorXd& state) {
  constexpr size_t kLeastSamples = 8;
  std::vector<std::vector<double>> sizes(rig.joints.size());
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const int k = problem.groups()[g].private_size;
    MatrixXd rows;
    std::vector<NoiseRows> kinds;
    if (k == 0 || !problem.noise_rows(static_cast<int>(g), state, rows, kinds)) continue;
    const MatrixXd own = range_of(rows.leftCols(k));
    for (const NoiseRows& w : kinds)
      for (int i = w.first; w.joint >= 0 && i < w.first + w.count; ++i) {
        const double left = 1 - own.row(i).squaredNorm();
        if (left >= kLeastShare)
          sizes[w.joint].push_back(std::abs(rows(i, rows.cols() - 1)) / std::sqrt(left));
      }
  }
  std::vector<double> out(rig.joints.size(), 1.0);
  for (size_t j = 0; j < sizes.size(); ++j)
    if (sizes[j].size() >= kLeastSamples) out[j] = 1.4826 * median(std::move(sizes[j]));
  return out;
}

NoiseLevels noise_levels(const Linearisation& at, const std::vector<ViewResiduals>& views,
                         const Progress& progress) {
  const Rig& rig = at.solution.rig();
  NoiseKinds kinds = kinds_in(at.problem(), rig, views);
  const std::vector<UnknownFactor> unknown = unknown_factors(kinds, rig, {});
  return {levels_of(at.problem(), at.state(), at.observability().covariance, std::move(kinds),
                    unknown, progress)};
}
NoiseLevels noise_levels(const Linearisation& at) {
  return noise_levels(at, at.problem().residuals(at.state()));
}

std::string NoiseLevels::text() const {
  std::string out;
  for (const NoiseLevel& l : *this)
    if (l.differs())
      out += l.of + (l.part.empty() ? "" : " (" + l.part + ")") +
             kincal::text(": seen %.3g ", l.seen) + l.unit +
             kincal::text(", assumed %.3g\n", l.assumed);
  return out;
}

void scale_noise(Rig& rig, std::vector<Sample>& samples, const std::vector<NoiseLevel>& levels) {
  for (const NoiseLevel& level : levels) {
    if (!std::isfinite(level.seen)) continue;
    const double factor = level.seen / level.assumed;
    if (level.joint >= 0) {
      for (int j : same_noise(rig.tree, level.joint)) rig.joints[j].sigma *= factor;
      continue;
    }
    const auto scale = [&](std::vector<double>& sigma) {
      for (int i = 0; i < level.count; ++i) sigma[level.first + i] *= factor;
    };
    scale(rig.sensors[level.sensor].sigma);
    for (Sample& sample : samples)
      for (View& view : sample.views) {
        if (view.sensor != level.sensor) continue;
        if (!view.sigma.empty()) scale(view.sigma.own());
        for (Matrix3d& covariance : view.covariance) covariance *= factor * factor;
      }
  }
}

Recording scale_noise(const Recording& recording, const std::vector<NoiseLevel>& levels) {
  const bool of_sensors = std::any_of(levels.begin(), levels.end(), [](const NoiseLevel& level) {
    return level.joint < 0 && std::isfinite(level.seen);
  });
  Rig rig = recording.rig;
  std::vector<Sample> samples;
  if (of_sensors) samples = recording.samples;
  scale_noise(rig, samples, levels);
  return of_sensors ? Recording(std::move(rig), std::move(samples))
                    : recording.with_rig(std::move(rig));
}

}  // namespace kincal
