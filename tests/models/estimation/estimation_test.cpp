// models/estimation/estimation.h: one minimisation as the solver's Problem, on the nasty robot of
// fixtures/forward_model.h.
//
// Proves, for every sensor, noise mode and loss: residuals equal the fixture's independent forward
// model; whitening equals the covariance of the formats' table built by hand (own noise, plus the
// joints' noise of a view in `marginal`, its blocks in `point`); every column of the explicit rows
// (shared and private, through mimic joints, common ancestors, scanning joints and joints that
// stand still) agrees entry by entry with central differences along retract(); the Gram matrices of
// linearise() and square_root() and the reduced system of the solver equal those of the explicit
// rows; cost and chi2 equal sums by hand; partly freed poses stay on their surface; priors are what
// the formats say; samples that are laid out together and taken one at a time are the problems that
// they are alone. Does not prove: that sensors' formulas are right
// (models/sensors/sensors_test.cpp), nor that a minimum is found (solver/solver_test.cpp).
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <catch2/catch.hpp>
#include <memory>
#include <numeric>
#include <set>

#include "../../../models/rig/parameters.h"
#include "../../../solver/levenberg_marquardt.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/open_recording.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/stacked.h"
#include "../../fixtures/transforms.h"

namespace estimation_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

const std::vector<NoiseMode> kModes = {NoiseMode::latent, NoiseMode::marginal, NoiseMode::point,
                                       NoiseMode::none};
const char* mode_name(NoiseMode m) {
  return m == NoiseMode::latent     ? "latent"
         : m == NoiseMode::marginal ? "marginal"
         : m == NoiseMode::point    ? "point"
                                    : "none";
}
const std::vector<LossKind> kLosses = {LossKind::none, LossKind::huber, LossKind::soft_l1,
                                       LossKind::cauchy, LossKind::tukey};

/// The rig as somebody has it, samples of a robot that is a little different, and values that are
/// different again.
struct Scene : OpenRecording {
  Values values;

  Scene(int count, unsigned long seed, const Rig& truth = nasty_robot())
      : OpenRecording(make_rig(seed, truth)) {
    Random random(seed);
    std::vector<TruePosture> postures;
    samples = nasty_samples(truth, count, seed + 1, &postures);
    values.shared = ParameterTable(moved(truth, {"*"}, random, 0.004, 0.01, 3, 0.004)).initial;
    for (size_t s = 0; s < samples.size(); ++s) {
      for (const auto& [target, board] : postures[s].boards)
        values.targets[{static_cast<int>(s), target}] =
            to_pose(board * exponential(random.twist(0.01, 0.02)));
      for (size_t j = 0; j < rig.joints.size(); ++j)
        if (rig.tree.joints[j].has_reading() && rig.joints[j].sigma > 0)
          values.errors[{static_cast<int>(s), static_cast<int>(j)}] =
              rig.joints[j].sigma * random.normal();
    }
  }

  /// What every sensor sees, in `mode`, with all of `free` that has an influence.
  std::unique_ptr<Estimation> problem(NoiseMode mode, const std::vector<int>& sensors,
                                      const std::vector<Freed>& free, const Loss& loss = {},
                                      const std::vector<Prior>& priors = {}) const {
    EstimationSetup setup;
    setup.noise = mode;
    setup.loss = loss;
    setup.sensors = sensors;
    Estimation all(*this, training(), setup);
    const std::vector<char> used = all.influencing();
    for (const Freed& f : free)
      if (used[f.parameter] || std::any_of(priors.begin(), priors.end(), [&](const Prior& p) {
            return p.parameter == f.parameter;
          }))
        setup.free.push_back(f);
    setup.priors = priors;
    return std::make_unique<Estimation>(*this, training(), setup);
  }

  /// Everything, whole.
  std::vector<Freed> whole() const { return freed(table, {"*"}); }
  /// Everything, but of each pose only some components, differently many.
  std::vector<Freed> partly() const {
    std::vector<Freed> out;
    int mask = 5;
    for (Freed f : whole()) {
      if (table.all[f.parameter].pose) {
        mask = mask % 62 + 7;
        if (mask > 62) mask -= 61;
        f.components.clear();
        for (int c = 0; c < 6; ++c)
          if (mask >> c & 1) f.components.push_back(c);
      }
      out.push_back(f);
    }
    return out;
  }

 private:
  static Rig make_rig(unsigned long seed, const Rig& truth) {
    Random random(seed + 77);
    return moved(truth, {"*"}, random, 0.01, 0.03, 4, 0.005);
  }
};

const Scene& scene() {
  static const Scene s(7, 5);
  return s;
}

/// The true posture that values mean for one sample.
TruePosture posture_at(const Scene& s, const Values& values, int sample, NoiseMode mode) {
  TruePosture p;
  p.readings = s.samples[sample].readings;
  p.errors.assign(p.readings.size(), 0);
  if (mode == NoiseMode::latent)
    for (const auto& [key, e] : values.errors)
      if (key.first == sample) p.errors[key.second] = e;
  for (const auto& [key, pose] : values.targets)
    if (key.first == sample) p.boards[key.second] = isometry(pose);
  return p;
}

/// Covariance of a view's residuals by the formats' table.
MatrixXd covariance_by_hand(const Rig& rig, const View& view, const TruePosture& posture,
                            NoiseMode mode) {
  const bool point = mode == NoiseMode::point;
  MatrixXd c = own_covariance(rig, view, posture, point);
  if (mode == NoiseMode::latent || mode == NoiseMode::none) return c;
  const MatrixXd q = reading_noise(rig, view, posture, point);
  const MatrixXd joints = q * q.transpose();
  if (mode == NoiseMode::marginal) return c + joints;
  const std::string& type = rig.sensors[view.sensor].type;
  const Eigen::Index b = type == "camera" ? 2 : type == "pose" ? 6 : 3;
  for (Eigen::Index i = 0; i < c.rows(); i += b) c.block(i, i, b, b) += joints.block(i, i, b, b);
  return c;
}

/// Residuals a block that a loss acts on.
Eigen::Index block_rows(const Rig& rig, const ViewResiduals& v, NoiseMode mode) {
  if (mode == NoiseMode::marginal) return v.raw.size();
  const std::string& type = rig.sensors[v.view->sensor].type;
  if (type == "camera") return 2;
  return type == "pose" || (type == "chain" && mode != NoiseMode::point) ? 6 : 3;
}

/// The formats' table of losses: c^2 rho(s / c^2).
double rho(const Loss& loss, double s) {
  const double c2 = loss.scale * loss.scale, z = s / c2;
  switch (loss.kind) {
    case LossKind::none:
      return s;
    case LossKind::huber:
      return c2 * (z <= 1 ? z : 2 * std::sqrt(z) - 1);
    case LossKind::soft_l1:
      return c2 * 2 * (std::sqrt(1 + z) - 1);
    case LossKind::cauchy:
      return c2 * std::log(1 + z);
    case LossKind::tukey:
      return c2 * (z <= 1 ? (1 - std::pow(1 - z, 3)) / 3 : 1.0 / 3);
  }
  return 0;
}

/// Largest entry of a - b by the geometric mean of the diagonals `scale`.
double scaled_difference(const MatrixXd& a, const MatrixXd& b, const VectorXd& scale) {
  double worst = 0;
  for (Eigen::Index i = 0; i < a.rows(); ++i)
    for (Eigen::Index j = 0; j < a.cols(); ++j) {
      const double d = std::abs(a(i, j) - b(i, j)), s = std::sqrt(scale(i) * scale(j));
      worst = std::max(worst, s > 0 ? d / s : d > 0 ? 1e300 : 0);
      if (!(d >= 0)) return 1e300;
    }
  return worst;
}

MatrixXd symmetric(const MatrixXd& lower) { return lower.selfadjointView<Eigen::Lower>(); }

/// Raw residuals of all views, as one vector, as the noise mode whitens them: in `point` those of
/// chains are the fixture's, a target point at a time (residuals() reports what the sensor itself
/// measures, in every mode).
VectorXd raw_of(const Scene& s, const Estimation& problem, const VectorXd& state) {
  std::vector<ViewResiduals> views = problem.residuals(state);
  const NoiseMode mode = problem.setup().noise;
  if (mode == NoiseMode::point) {
    Values values;
    values.shared = s.values.shared;
    problem.unpack(state, values);
    const Rig rig = with_values(s.rig, s.table, values.shared);
    for (ViewResiduals& v : views)
      if (rig.sensors[v.view->sensor].type == "chain")
        v.raw = residual(rig, *v.view, posture_at(s, values, v.sample, mode), true);
  }
  Eigen::Index n = 0;
  for (const ViewResiduals& v : views) n += v.raw.size();
  VectorXd out(n);
  n = 0;
  for (const ViewResiduals& v : views) {
    out.segment(n, v.raw.size()) = v.raw;
    n += v.raw.size();
  }
  return out;
}

/// Explicit rows of all groups with the same private column in the same place: [privates | shared |
/// r], rows as the views stand in residuals(), without the rows of joint errors' priors.
struct Sheet {
  MatrixXd analytic, numeric, raw;
};

/// Central differences of the residual column of explicit_rows and of the raw residuals. The
/// privates of all groups are moved at once.
Sheet differentiate(const Scene& scene, Estimation& problem, const VectorXd& state,
                    std::vector<int>& group_rows) {
  const int shared = problem.shared_size();
  int privates = 0, total_privates = 0;
  for (const GroupShape& g : problem.groups()) {
    privates = std::max(privates, g.private_size);
    total_privates += g.private_size;
  }
  const auto residual_column = [&](const VectorXd& x) {
    problem.prepare(x);
    std::vector<VectorXd> parts;
    Eigen::Index n = 0;
    for (size_t g = 0; g < problem.groups().size(); ++g) {
      MatrixXd rows;
      REQUIRE(problem.explicit_rows(static_cast<int>(g), x, rows));
      parts.push_back(rows.rightCols(1));
      n += rows.rows();
    }
    VectorXd out(n);
    n = 0;
    for (const VectorXd& p : parts) {
      out.segment(n, p.size()) = p;
      n += p.size();
    }
    return out;
  };
  problem.prepare(state);
  const Eigen::Index n = residual_column(state).size(),
                     raw_n = raw_of(scene, problem, state).size();
  Sheet s;
  s.analytic = MatrixXd::Zero(n, privates + shared);
  s.numeric = s.analytic;
  s.raw = MatrixXd::Zero(raw_n, privates + shared);
  Eigen::Index row = 0;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    MatrixXd rows;
    REQUIRE(problem.explicit_rows(static_cast<int>(g), state, rows));
    s.analytic.block(row, 0, rows.rows(), shape.private_size) = rows.leftCols(shape.private_size);
    for (size_t c = 0; c < shape.columns.size(); ++c)
      s.analytic.block(row, privates + shape.columns[c], rows.rows(), 1) =
          rows.col(shape.private_size + static_cast<int>(c));
    group_rows.push_back(static_cast<int>(rows.rows()));
    row += rows.rows();
  }
  for (int k = 0; k < privates + shared; ++k) {
    const auto moved_state = [&](double h) {
      VectorXd step = VectorXd::Zero(shared), own = VectorXd::Zero(total_privates), out;
      if (k >= privates) step(k - privates) = h;
      int start = 0;
      for (const GroupShape& g : problem.groups()) {
        if (k < g.private_size) own(start + k) = h;
        start += g.private_size;
      }
      problem.retract(state, step, own, out);
      return out;
    };
    s.numeric.col(k) = derivative([&](double h) { return residual_column(moved_state(h)); }, 1e-3);
    s.raw.col(k) =
        derivative([&](double h) { return raw_of(scene, problem, moved_state(h)); }, 1e-3);
  }
  problem.prepare(state);
  return s;
}

/// (a) and (e): derivatives and whitening of every view of a problem.
void check_views(const Scene& s, Estimation& problem, NoiseMode mode) {
  VectorXd state = problem.pack(s.values);
  problem.renew(state);
  std::vector<int> group_rows;
  const Sheet sheet = differentiate(s, problem, state, group_rows);
  Values values;
  values.shared = s.values.shared;
  problem.unpack(state, values);
  const Rig rig = with_values(s.rig, s.table, values.shared);
  const std::vector<ViewResiduals> views = problem.residuals(state);
  Eigen::Index raw_row = 0, row = 0;
  int group = 0, group_end = group_rows[0];
  for (const ViewResiduals& v : views) {
    while (problem.sample_of(group) !=
           v.sample) {  // behind the views of a group stand its joint errors
      row = group_end;
      group_end += group_rows[++group];
    }
    const Eigen::Index n = v.whitened.size();
    const std::string what = std::string(mode_name(mode)) + ", " +
                             rig.sensors[v.view->sensor].name + " sees " +
                             rig.targets[v.view->target].name + " in " + s.samples[v.sample].id;
    INFO(what);
    const TruePosture posture = posture_at(s, values, v.sample, mode);
    const VectorXd by_hand = residual(rig, *v.view, posture, mode == NoiseMode::point);
    REQUIRE(by_hand.size() == n);
    const VectorXd measured = residual(rig, *v.view, posture);
    REQUIRE(v.raw.size() == measured.size());
    CHECK((measured - v.raw).cwiseAbs().maxCoeff() < 1e-12 * (1000 + v.raw.cwiseAbs().maxCoeff()));

    // Derivatives, entry by entry.
    const double r_scale = v.whitened.cwiseAbs().maxCoeff();
    double worst = 0;
    std::string worst_name;
    for (Eigen::Index k = 0; k < sheet.analytic.cols(); ++k) {
      const auto a = sheet.analytic.col(k).segment(row, n),
                 b = sheet.numeric.col(k).segment(row, n);
      const double scale = b.cwiseAbs().maxCoeff(),
                   wrong = (a - b).cwiseAbs().maxCoeff() / (1e-7 * scale + 1e-11 * r_scale + 1e-9);
      if (!(wrong <= worst)) {
        worst = wrong;
        const Eigen::Index shared = k - (sheet.analytic.cols() - problem.shared_size());
        worst_name = shared >= 0 ? problem.column_name(static_cast<int>(shared))
                                 : "private " + std::to_string(k);
      }
    }
    INFO("worst column: " << worst_name);
    CHECK(worst < 1);

    // Whitening: the rows' products are those with the inverse of the covariance.
    const MatrixXd c = covariance_by_hand(rig, *v.view, posture, mode);
    MatrixXd raw(n, sheet.raw.cols() + 1), whitened(n, sheet.raw.cols() + 1);
    raw << sheet.raw.middleRows(raw_row, n), by_hand;
    whitened << sheet.analytic.middleRows(row, n), v.whitened;
    const MatrixXd expected = raw.transpose() * fixture::dense::ldlt_solve(c, raw);
    // The residual column of the explicit rows may stand in other axes than `whitened`: it is
    // compared by its products.
    MatrixXd r_column;
    REQUIRE(problem.explicit_rows(group, state, r_column));
    whitened.rightCols(1) =
        r_column.rightCols(1).middleRows(row - (group_end - group_rows[group]), n);
    CHECK(std::abs(v.whitened.squaredNorm() - expected(expected.rows() - 1, expected.rows() - 1)) <
          1e-7 * expected(expected.rows() - 1, expected.rows() - 1));
    CHECK(scaled_difference(whitened.transpose() * whitened, expected,
                            expected.diagonal().array() + 1e-6) < 2e-6);
    raw_row += n;
    row += n;
  }
}

/// The reduced system by the book: H = J'J, S = C - Q' P^-1 Q, s = b - Q' P^-1 a, one group after
/// the other.
void schur_by_hand(const Estimation& problem, const Stacked& stacked, MatrixXd& matrix,
                   VectorXd& gradient, VectorXd& scale) {
  const MatrixXd shared = stacked.j.rightCols(problem.shared_size());
  matrix = shared.transpose() * shared;
  gradient = shared.transpose() * stacked.r;
  scale = matrix.diagonal();
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const int size = problem.groups()[g].private_size;
    if (!size) continue;
    const MatrixXd own = stacked.j.middleCols(stacked.private_start[g], size);
    const MatrixXd p = own.transpose() * own, q = own.transpose() * shared;
    const VectorXd a = own.transpose() * stacked.r;
    const VectorXd d = p.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd scaled = d.asDiagonal() * p * d.asDiagonal();
    REQUIRE(fixture::dense::is_positive(scaled));
    const MatrixXd solved = d.asDiagonal() * fixture::dense::llt_solve(scaled, d.asDiagonal() * q);
    matrix -= q.transpose() * solved;
    gradient -= solved.transpose() * a;
  }
}

struct Worst {
  double gram = 0, root = 0, rows_gram = 0, cost = 0, reduced = 0, gradient = 0;
};

/// (b), (c), (d), (f) of a problem.
void check_algebra(const Scene& s, Estimation& problem, const VectorXd& state, Worst& worst) {
  const EstimationSetup& setup = problem.setup();
  problem.set_workers(2);
  problem.prepare(state);

  // Costs by hand, sample by sample.
  std::map<int, Cost> by_hand;
  for (const ViewResiduals& v : problem.residuals(state)) {
    const Eigen::Index b = block_rows(s.rig, v, setup.noise);
    Cost& c = by_hand[v.sample];
    for (Eigen::Index i = 0; i < v.whitened.size(); i += b) {
      const double squared = v.whitened.segment(i, b).squaredNorm();
      c.chi2 += squared;
      c.doubled += rho(setup.loss, squared);
    }
  }
  Values values;
  values.shared = s.values.shared;
  problem.unpack(state, values);
  for (const auto& [key, e] : values.errors) {
    const double squared = std::pow(e / s.rig.joints[key.second].sigma, 2);
    if (setup.noise != NoiseMode::latent) continue;
    by_hand[key.first].chi2 += squared;
    by_hand[key.first].doubled += squared;
  }

  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    const int n = shape.size() + 1, group = static_cast<int>(g), sample = problem.sample_of(group);
    MatrixXd rows, root, gram = MatrixXd::Zero(n, n);
    REQUIRE(problem.explicit_rows(group, state, rows));
    REQUIRE(rows.cols() == n);
    CHECK(rows.rows() == shape.rows);
    CHECK(std::is_sorted(shape.columns.begin(), shape.columns.end()));
    Cost linearised, evaluated;
    REQUIRE(add_equations(problem, group, state, 1, gram, linearised));
    REQUIRE(problem.square_root(group, state, 0, root));
    REQUIRE(problem.evaluate(group, state, 1, evaluated));
    const MatrixXd expected = rows.transpose() * rows;
    const VectorXd scale = expected.diagonal();
    MatrixXd equations = expected;  // without r'r
    equations(n - 1, n - 1) = 0;
    worst.gram = std::max(worst.gram, scaled_difference(symmetric(gram), equations, scale));
    worst.root = std::max(worst.root, scaled_difference(root.transpose() * root, expected, scale));
    if (sample < 0) continue;
    const Cost& hand = by_hand.at(sample);
    for (const Cost& c : {linearised, evaluated})
      worst.cost = std::max(
          {worst.cost, std::abs(c.chi2 / hand.chi2 - 1), std::abs(c.doubled / hand.doubled - 1)});
    // linearise() adds: a second call doubles.
    Cost again;
    REQUIRE(add_equations(problem, group, state, 0, gram, again));
    worst.gram = std::max(worst.gram, scaled_difference(symmetric(gram), 2 * equations, scale));
  }

  const Stacked stacked = stack(problem, state);
  MatrixXd expected;
  VectorXd expected_gradient, scale;
  schur_by_hand(problem, stacked, expected, expected_gradient, scale);
  const double length = stacked.r.norm();
  for (const LinearSolver choice : {LinearSolver::dense, LinearSolver::cholmod}) {
    SolverOptions options;
    options.linear_solver = choice;
    LevenbergMarquardt solver(problem, options);
    MatrixXd matrix;
    VectorXd gradient;
    solver.reduced(state, matrix, gradient);
    REQUIRE(matrix.rows() == expected.rows());
    REQUIRE(gradient.size() == expected.rows());
    for (Eigen::Index i = 0; i < scale.size(); ++i)
      if (scale(i) == 0)
        matrix(i, i) = 0;  // without any influence (tukey): what stands on the diagonal there is
                           // the solver's affair
    worst.reduced = std::max(worst.reduced, scaled_difference(matrix, expected, scale));
    for (Eigen::Index i = 0; i < gradient.size(); ++i) {
      const double d = std::abs(gradient(i) - expected_gradient(i)),
                   unit = std::sqrt(scale(i)) * length;
      worst.gradient = std::max(worst.gradient, unit > 0 ? d / unit : d > 0 ? 1e300 : 0);
    }
  }
}

/// Relative to the diagonal, so to the size of J's columns. J = L M rounds where L and M are large
/// and their product is small (a small target far away: pixels move by f / d for a lever arm's
/// translation and back for its rotation), so the Gram matrix of one sample's least visible columns
/// may be off by 1e-10 of themselves; the sum over samples, the reduced system, is held to 2e-12.
void report(const Worst& w) {
  INFO("gram " << w.gram << ", root " << w.root << ", cost " << w.cost << ", reduced " << w.reduced
               << ", gradient " << w.gradient);
  CHECK(w.gram < 2e-9);
  CHECK(w.root < 1e-12);
  CHECK(w.cost < 2e-12);
  CHECK(w.reduced < 2e-12);
  CHECK(w.gradient < 1e-12);
}

/// A scale beyond which some blocks lie: half of them; for tukey, which gives those no weight, at
/// most a quarter of what shows a target.
double middling(const Scene& s, const Estimation& problem, const VectorXd& state, LossKind kind) {
  std::map<std::pair<int, int>, std::vector<double>> norms;
  for (const ViewResiduals& v : problem.residuals(state)) {
    const Eigen::Index b = block_rows(s.rig, v, problem.setup().noise);
    std::vector<double>& of =
        norms[kind == LossKind::tukey ? std::make_pair(v.sample, v.view->target)
                                      : std::make_pair(0, 0)];
    for (Eigen::Index i = 0; i < v.whitened.size(); i += b)
      of.push_back(v.whitened.segment(i, b).norm());
  }
  double scale = 0;
  for (auto& [key, of] : norms) {
    std::sort(of.begin(), of.end());
    scale = std::max(scale,
                     1.1 * of[kind == LossKind::tukey ? (of.size() * 3 - 1) / 4 : of.size() / 2]);
  }
  return scale;
}

}  // namespace

TEST_CASE("estimation: residuals, whitening and every derivative, everything freed whole") {
  const Scene s(4, 5);
  for (const NoiseMode mode : kModes) {
    const auto problem = s.problem(mode, all_sensors(s.rig), s.whole());
    problem->set_workers(1);
    check_views(s, *problem, mode);
  }
}

TEST_CASE("estimation: residuals and derivatives where joints stand still, as their leaders do") {
  const Scene s(4, 6, standing_robot());
  for (const NoiseMode mode : kModes)
    for (const bool whole : {true, false}) {
      const auto problem = s.problem(mode, all_sensors(s.rig),
                                     whole ? s.whole() : freed(s.table, {"joint/*/scale"}));
      problem->set_workers(1);
      check_views(s, *problem, mode);
      const std::vector<char> used = problem->influencing();
      for (const char* leader : {"floor", "eye", "flange"})
        CHECK(s.table.joint_offset[joint_index(s.rig, leader)] == -1);
      CHECK(used[s.table.joint_offset[joint_index(s.rig, "elbow")]]);
    }
}

TEST_CASE("estimation: residuals, whitening and every derivative, poses freed in part") {
  const Scene s(3, 8);
  for (const NoiseMode mode : kModes) {
    const auto problem = s.problem(mode, all_sensors(s.rig), s.partly());
    problem->set_workers(1);
    check_views(s, *problem, mode);
  }
}

TEST_CASE(
    "estimation: Gram matrices, costs and the reduced system equal the explicit rows', every "
    "sensor, mode and loss") {
  const Scene& s = scene();
  std::vector<std::vector<int>> choices = {all_sensors(s.rig)};
  for (const int sensor : all_sensors(s.rig)) choices.push_back({sensor});
  for (size_t choice = 0; choice < choices.size(); ++choice)
    for (const NoiseMode mode : kModes)
      for (const LossKind kind : kLosses) {
        if (choice == 0 && kind != LossKind::cauchy) continue;
        const std::vector<int>& sensors = choices[choice];
        const std::vector<Freed> free =
            (choice + static_cast<size_t>(kind)) % 2 ? s.whole() : s.partly();
        Loss loss;
        {
          const auto plain = s.problem(mode, sensors, free);
          VectorXd state = plain->pack(s.values);
          plain->renew(state);
          plain->prepare(state);
          loss = {kind, middling(s, *plain, state, kind)};
        }
        const auto problem = s.problem(mode, sensors, free, loss);
        const VectorXd state = problem->pack(s.values);
        problem->set_workers(2);
        problem->renew(state);
        INFO((choice ? s.rig.sensors[sensors[0]].name : "all sensors")
             << ", " << mode_name(mode) << ", loss " << static_cast<int>(kind));
        Worst worst;
        check_algebra(s, *problem, state, worst);
        report(worst);
      }
}

TEST_CASE(
    "estimation: a loss acts on a whole view in mode marginal, also where no joint's noise reaches "
    "the view") {
  Random random(31);
  Rig rig;
  add_link(rig, "base");
  add_tracker(rig, "tracker", "base", Pose(), {0.001, 0.001, 0.001});
  const int target = add_points(
      rig, "marks", (Eigen::Matrix3Xd(3, 4) << 0, 1, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1).finished());
  finish_tree(rig.tree);
  TruePosture posture = empty_posture(rig);
  posture.boards[target] = isometry(random.pose(1, 1));
  std::vector<Sample> samples = {make_sample(rig, posture, "a")};
  REQUIRE(add_view(samples[0], rig, 0, target, posture, &random));
  const Recording recording(rig, samples);
  EstimationSetup setup;
  setup.sensors = {0};
  setup.noise = NoiseMode::marginal;
  setup.loss = {LossKind::cauchy, 1};
  Estimation problem(recording, {0}, setup);
  problem.set_workers(1);
  Values values;
  values.shared = recording.table.initial;
  values.targets[{0, target}] = to_pose(posture.boards[target]);
  const VectorXd state = problem.pack(values);
  problem.renew(state);
  Cost cost;
  REQUIRE(problem.evaluate(0, state, 0, cost));
  CHECK(cost.doubled == Approx(std::log(1 + cost.chi2)).epsilon(1e-12));
}

TEST_CASE("estimation: what influences a view is what moves its residuals") {
  // Every parameter is moved at random by the fixture's own model: a residual moves if and only if
  // influencing() says so. `square` and `points` do not count for poses and chains.
  const Scene s(3, 21);
  Random random(22);
  for (const int sensor : all_sensors(s.rig)) {
    const std::string& type = s.rig.sensors[sensor].type;
    const auto problem = s.problem(NoiseMode::latent, {sensor}, {});
    const std::vector<char> claimed = problem->influencing();
    REQUIRE(claimed.size() == s.table.all.size());
    const Rig here = with_values(s.rig, s.table, s.values.shared);
    for (size_t p = 0; p < s.table.all.size(); ++p) {
      const std::string& name = s.table.all[p].name;
      const Rig other = moved(here, {name}, random, 0.01, 0.02, 5, 0.02);
      bool moves = false;
      for (size_t k = 0; k < s.samples.size() && !moves; ++k)
        for (const View& v : s.samples[k].views) {
          if (v.sensor != sensor) continue;
          const TruePosture posture =
              posture_at(s, s.values, static_cast<int>(k), NoiseMode::latent);
          moves |=
              (residual(other, v, posture) - residual(here, v, posture)).cwiseAbs().maxCoeff() >
              1e-9;
        }
      INFO(s.rig.sensors[sensor].name << ": " << name);
      if (type == "pose" || type == "chain")
        if (name.find("/square") != std::string::npos || name.find("/points") != std::string::npos)
          CHECK_FALSE(moves);
      CHECK(static_cast<bool>(claimed[p]) == moves);
    }
  }
}

TEST_CASE("estimation: groups, names and states") {
  const Scene& s = scene();
  const std::vector<Freed> free = freed(s.table, {"joint/pan/offset", "joint/eye/origin.rz",
                                                  "sensor/bc5/pose", "target/marks/points.1.y"});
  const int prior = s.table.joint_offset[joint_index(s.rig, "pan")];
  const auto problem =
      s.problem(NoiseMode::latent, {sensor_index(s.rig, "bc5"), sensor_index(s.rig, "depth")}, free,
                {}, {{prior, 0, 0.1}});
  REQUIRE(problem->shared_size() == 9);
  CHECK_FALSE(problem->empty());
  std::set<std::string> names;
  for (int c = 0; c < problem->shared_size(); ++c) {
    names.insert(problem->column_name(c));
    const auto [parameter, component] = problem->columns()[c];
    CHECK(problem->column_name(c) == s.table.all[parameter].component_name(component));
  }
  CHECK(names == std::set<std::string>{
                     "joint/pan/offset", "joint/eye/origin.rz", "sensor/bc5/pose.x",
                     "sensor/bc5/pose.y", "sensor/bc5/pose.z", "sensor/bc5/pose.rx",
                     "sensor/bc5/pose.ry", "sensor/bc5/pose.rz", "target/marks/points.1.y"});
  // One group a sample, and one of priors.
  REQUIRE(problem->groups().size() == s.samples.size() + 1);
  for (size_t g = 0; g < s.samples.size(); ++g) {
    CHECK(problem->sample_of(static_cast<int>(g)) == static_cast<int>(g));
    // Two boards, and the errors of the joints between these sensors and targets:
    // lift turn pan tilt shoulder elbow slide wrist, but not nod scan wobble idle.
    CHECK(problem->groups()[g].private_size == 12 + 8);
  }
  CHECK(problem->sample_of(static_cast<int>(s.samples.size())) == -1);
  CHECK(problem->groups().back().private_size == 0);

  // pack and unpack: there and back, and all errors are there.
  VectorXd state = problem->pack(s.values);
  Values back;
  back.shared = s.values.shared;
  problem->unpack(state, back);
  CHECK((back.shared - s.values.shared).cwiseAbs().maxCoeff() < 1e-15);
  for (const auto& [key, pose] : back.targets) {
    CHECK((pose.rotation - s.values.targets.at(key).rotation).norm() < 1e-15);
    CHECK((pose.translation - s.values.targets.at(key).translation).norm() < 1e-15);
  }
  CHECK(back.targets.size() == 2 * s.samples.size());
  CHECK(back.errors.size() == 8 * s.samples.size());
  for (const auto& [key, e] : back.errors) CHECK(e == s.values.errors.at(key));
  // What is missing stands at the identity and 0.
  Values nothing;
  nothing.shared = s.values.shared;
  VectorXd bare = problem->pack(nothing);
  problem->unpack(bare, nothing);
  for (const auto& [key, pose] : nothing.targets)
    CHECK((pose.rotation.isIdentity(0) && pose.translation.isZero(0)));
  for (const auto& [key, e] : nothing.errors) CHECK(e == 0);
}

TEST_CASE("estimation: views of one target, samples left out, readings that nobody needs") {
  const Scene& s = scene();
  EstimationSetup setup;
  setup.sensors = all_sensors(s.rig);
  setup.only_target = target_index(s.rig, "probe");
  Estimation problem(s, {4, 2}, setup);
  problem.set_workers(1);
  REQUIRE(problem.groups().size() == 2);
  std::set<int> groups = {problem.sample_of(0), problem.sample_of(1)};
  CHECK(groups == std::set<int>{2, 4});
  const VectorXd state = problem.pack(s.values);
  problem.renew(state);
  problem.prepare(state);
  std::set<int> samples;
  for (const ViewResiduals& v : problem.residuals(state)) {
    CHECK(v.view->target == setup.only_target);
    samples.insert(v.sample);
  }
  CHECK(samples == groups);

  // A laser needs no reading of its own scanning joint, nobody one of joints that are not on a way.
  OpenRecording fewer = s;
  for (Sample& sample : fewer.samples)
    for (const char* joint : {"scan", "idle", "pan", "tilt"})
      sample.readings[joint_index(s.rig, joint)] = std::nan("");
  EstimationSetup laser;
  laser.sensors = {sensor_index(s.rig, "laser")};
  Estimation without(fewer, s.training(), laser), with(s, s.training(), laser);
  without.set_workers(1);
  with.set_workers(1);
  const VectorXd x = without.pack(s.values);
  without.renew(x);
  with.renew(x);
  const auto a = without.residuals(x), b = with.residuals(x);
  REQUIRE(a.size() == b.size());
  for (size_t i = 0; i < a.size(); ++i) CHECK(a[i].raw == b[i].raw);

  // Nothing that the sensors see: no group.
  EstimationSetup none;
  none.sensors = {};
  CHECK(Estimation(s, s.training(), none).empty());
}

TEST_CASE(
    "estimation: a joint that follows a scanning one on the laser's way is refused, and a floating "
    "one") {
  Rig rig;
  add_link(rig, "base");
  add_joint(rig, JointType::revolute, "scan", "base", "scan", {0, 1, 0}, at({0, 0, 1}));
  add_mimic(rig, JointType::revolute, "follow", "scan", "follow", {0, 1, 0}, at({0.1, 0, 0}),
            "scan", 0.5, 0);
  add_joint(rig, JointType::floating, "float", "base", "away", {0, 1, 0}, at({1, 0, 0}));
  add_laser(rig, "laser", "follow", Pose(), "scan", {0.001, 0.001, 0.001});
  add_tracker(rig, "tracker", "away", Pose(), {1, 1, 1});
  add_grid(rig, "board", 2, 2, 0.1);
  finish_tree(rig.tree);
  for (const int sensor : {0, 1}) {
    Sample sample = make_sample(rig, empty_posture(rig), "a");
    View v;
    v.sensor = sensor;
    v.target = 0;
    v.ids = {0};
    v.z = {0, 0, 1};
    v.sigma = rig.sensors[sensor].sigma;
    sample.views = {v};
    const Recording recording(rig, {sample});
    EstimationSetup setup;
    setup.sensors = {sensor};
    CHECK_THROWS_AS(Estimation(recording, {0}, setup), std::invalid_argument);
  }
}

TEST_CASE("estimation: covariances are held until they are renewed") {
  const Scene& s = scene();
  const int laser = sensor_index(s.rig, "laser"), pin = sensor_index(s.rig, "pin"),
            grip = sensor_index(s.rig, "grip");
  const struct {
    int sensor;
    NoiseMode mode;
    bool renews;
    std::vector<std::string> free = {"joint/scan/scale", "joint/nod/origin", "joint/elbow/offset",
                                     "joint/wrist/origin"};
  } cases[] = {{laser, NoiseMode::none, true},
               {laser, NoiseMode::latent, true},
               {laser, NoiseMode::none, false, {"joint/nod/origin"}},   // behind the joint
               {laser, NoiseMode::latent, true, {"joint/nod/origin"}},  // errors of `wobble`
               {laser, NoiseMode::none, true, {"joint/wobble/origin"}},
               {laser, NoiseMode::none, true, {"sensor/laser/pose"}},
               {pin, NoiseMode::none, false},
               {pin, NoiseMode::latent, false},
               {pin, NoiseMode::marginal, true},
               {pin, NoiseMode::point, true},
               {grip, NoiseMode::latent, false}};
  for (const auto& c : cases) {
    INFO(s.rig.sensors[c.sensor].name << ", " << mode_name(c.mode));
    const auto problem = s.problem(c.mode, {c.sensor}, freed(s.table, c.free));
    problem->set_workers(1);
    const VectorXd state = problem->pack(s.values);
    CHECK(problem->renew(state) == c.renews);
    const auto chi2 = [&](const VectorXd& x) {
      Cost cost, sum;
      for (size_t g = 0; g < problem->groups().size(); ++g) {
        REQUIRE(problem->evaluate(static_cast<int>(g), x, 0, cost));
        sum.chi2 += cost.chi2;
      }
      return sum.chi2;
    };
    int privates = 0;
    for (const GroupShape& g : problem->groups()) privates += g.private_size;
    VectorXd moved;
    problem->retract(state, VectorXd::Constant(problem->shared_size(), 0.02),
                     VectorXd::Constant(privates, 0.01), moved);
    const double before = chi2(state), there = chi2(moved);
    problem->prepare(moved);
    CHECK(chi2(state) == before);
    CHECK(problem->renew(moved) == c.renews);
    CHECK((chi2(moved) == Approx(there).epsilon(1e-13)) == !c.renews);
    problem->renew(state);
    CHECK(chi2(state) == Approx(before).epsilon(1e-13));
  }
}

TEST_CASE("estimation: poses move on their surfaces") {
  // Wholly freed: T exp(increment). Partly: T0 exp(xi) with T0 the rig's, held components of xi as
  // they were; to first order T moves by exactly the freed components' increments.
  const Scene s(2, 33);
  for (const bool whole : {true, false}) {
    const std::vector<Freed> free = whole ? s.whole() : s.partly();
    const auto problem = s.problem(NoiseMode::none, all_sensors(s.rig), free);
    problem->set_workers(1);
    Random random(34);
    VectorXd state = problem->pack(s.values), step(problem->shared_size());
    int privates = 0;
    for (const GroupShape& g : problem->groups()) privates += g.private_size;
    VectorXd own = VectorXd::Zero(privates);
    for (int round = 0; round < 3; ++round) {
      for (Eigen::Index i = 0; i < step.size(); ++i) step(i) = random.uniform(-0.3, 0.3);
      for (Eigen::Index i = 0; i < own.size(); ++i) own(i) = random.uniform(-0.1, 0.1);
      problem->prepare(state);
      VectorXd next;
      problem->retract(state, step, own, next);
      Values before, after;
      before.shared = after.shared = s.values.shared;
      problem->unpack(state, before);
      problem->unpack(next, after);
      for (size_t p = 0; p < s.table.all.size(); ++p) {
        const Parameter& parameter = s.table.all[p];
        INFO(parameter.name << ", round " << round << (whole ? ", whole" : ", in part"));
        Vector6d delta = Vector6d::Zero();
        std::vector<char> is_free(parameter.size(), 0);
        for (int c = 0; c < problem->shared_size(); ++c) {
          const auto [index, component] = problem->columns()[c];
          if (index != static_cast<int>(p)) continue;
          is_free[component] = 1;
          if (parameter.pose)
            delta(component) = step(c);
          else
            CHECK(after.shared(parameter.start + component) ==
                  Approx(before.shared(parameter.start + component) + step(c)).margin(1e-15));
        }
        if (!parameter.pose) continue;
        const Isometry3d t0 = isometry(get_pose(s.table.initial, parameter.start)),
                         a = isometry(get_pose(before.shared, parameter.start)),
                         b = isometry(get_pose(after.shared, parameter.start));
        if (std::count(is_free.begin(), is_free.end(), 1) == 6) {
          CHECK((b.matrix() - (a * exponential(delta)).matrix()).norm() < 1e-12);
          continue;
        }
        const Vector6d xi_a = log_se3(to_pose(t0.inverse() * a)),
                       xi_b = log_se3(to_pose(t0.inverse() * b));
        for (int c = 0; c < 6; ++c)
          CHECK(std::abs(xi_b(c) - xi_a(c) - (is_free[c] ? delta(c) : 0)) < 1e-11);
      }
      Eigen::Index at = 0;
      for (size_t g = 0; g < problem->groups().size(); ++g) {
        if (problem->sample_of(static_cast<int>(g)) < 0) continue;
        for (const auto& [key, pose] : before.targets) {
          if (key.first != problem->sample_of(static_cast<int>(g))) continue;
          const Isometry3d expected = isometry(pose) * exponential(own.segment<6>(at));
          CHECK((isometry(after.targets.at(key)).matrix() - expected.matrix()).norm() < 1e-12);
          at += 6;
        }
      }
      CHECK(at == privates);
      state = next;
    }
  }
}

TEST_CASE("estimation: priors are Gaussians around the rig's values") {
  const Scene s(2, 41);
  Random random(42);
  const std::vector<Freed> free =
      freed(s.table, {"joint/pan/offset", "joint/eye/origin", "joint/tilt/origin.x",
                      "joint/tilt/origin.ry", "sensor/bc5/intrinsics", "target/board/square"});
  std::vector<Prior> priors;
  double sigma = 0.01;
  for (const Freed& f : free)
    for (const int c : f.components)
      if (s.table.all[f.parameter].name != "sensor/bc5/intrinsics" || c < 2)
        priors.push_back({f.parameter, c, sigma += 0.003});
  for (const LossKind loss : {LossKind::none, LossKind::cauchy}) {  // losses never act on priors
    const auto problem =
        s.problem(NoiseMode::latent, {sensor_index(s.rig, "bc5"), sensor_index(s.rig, "depth")},
                  free, {loss, 0.1}, priors);
    problem->set_workers(1);
    const VectorXd state = problem->pack(s.values);
    problem->renew(state);
    problem->prepare(state);
    const int group = static_cast<int>(problem->groups().size()) - 1;
    REQUIRE(problem->sample_of(group) == -1);
    const GroupShape& shape = problem->groups()[group];
    CHECK(shape.rows == static_cast<int>(priors.size()));
    MatrixXd rows;
    REQUIRE(problem->explicit_rows(group, state, rows));
    REQUIRE(rows.rows() == static_cast<int>(priors.size()));

    // Residuals by hand, each found among the rows.
    std::vector<double> expected,
        found(rows.col(rows.cols() - 1).data(), rows.col(rows.cols() - 1).data() + rows.rows());
    double sum = 0;
    for (const Prior& p : priors) {
      const Parameter& parameter = s.table.all[p.parameter];
      double value = s.values.shared(parameter.start + p.component) -
                     s.table.initial(parameter.start + p.component);
      if (parameter.pose)
        value = log_se3(to_pose(isometry(get_pose(s.table.initial, parameter.start)).inverse() *
                                isometry(get_pose(s.values.shared, parameter.start))))(p.component);
      expected.push_back(value / p.sigma);
      sum += expected.back() * expected.back();
    }
    Cost cost;
    REQUIRE(problem->evaluate(group, state, 0, cost));
    CHECK(cost.chi2 == Approx(sum).epsilon(1e-9));
    CHECK(cost.doubled == Approx(sum).epsilon(1e-9));
    std::sort(expected.begin(), expected.end());
    std::sort(found.begin(), found.end());
    for (size_t i = 0; i < expected.size(); ++i)
      CHECK(std::abs(expected[i] - found[i]) < 1e-9 * (1 + std::abs(expected[i])));

    // Their derivatives, whole and partly freed poses alike.
    int privates = 0;
    for (const GroupShape& g : problem->groups()) privates += g.private_size;
    for (size_t c = 0; c < shape.columns.size(); ++c) {
      const auto column = [&](double h) {
        VectorXd step = VectorXd::Zero(problem->shared_size()), next;
        step(shape.columns[c]) = h;
        problem->retract(state, step, VectorXd::Zero(privates), next);
        problem->prepare(next);
        MatrixXd there;
        REQUIRE(problem->explicit_rows(group, next, there));
        return VectorXd(there.rightCols(1));
      };
      const VectorXd numeric = derivative(column, 1e-3);
      INFO(problem->column_name(shape.columns[c]));
      CHECK((numeric - rows.col(static_cast<Eigen::Index>(c))).cwiseAbs().maxCoeff() <=
            1e-8 * numeric.cwiseAbs().maxCoeff());
    }
    problem->prepare(state);
    MatrixXd gram = MatrixXd::Zero(rows.cols(), rows.cols()), root;
    REQUIRE(add_equations(*problem, group, state, 0, gram, cost));
    REQUIRE(problem->square_root(group, state, 0, root));
    const VectorXd scale = (rows.transpose() * rows).diagonal();
    MatrixXd equations = rows.transpose() * rows;
    equations(equations.rows() - 1, equations.cols() - 1) = 0;  // r'r stays out
    CHECK(scaled_difference(symmetric(gram), equations, scale) < 1e-13);
    CHECK(scaled_difference(root.transpose() * root, rows.transpose() * rows, scale) < 1e-13);
  }
}

TEST_CASE("estimation: a view's own sigma counts, not its sensor's") {
  Scene s(2, 51);
  const int mocap = sensor_index(s.rig, "mocap");
  for (Sample& sample : s.samples)
    for (View& v : sample.views)
      if (v.sensor == mocap)
        for (double& sigma : v.sigma.own()) sigma *= 3;
  const auto problem = s.problem(NoiseMode::latent, {mocap}, {});
  problem->set_workers(1);
  const VectorXd state = problem->pack(s.values);
  problem->renew(state);
  for (const ViewResiduals& v : problem->residuals(state))
    for (int k = 0; k < 6; ++k)
      CHECK(v.whitened(k) == Approx(v.raw(k) / (k < 3 ? 0.003 : 0.006)).epsilon(1e-12));
}

TEST_CASE("estimation: a sample's own sigmas of readings count, not the joints'") {
  // Each sample's rows, Gram matrix and cost are those of a rig that states these sigmas.
  Scene own(3, 52);
  const double factors[] = {0.3, 1, 4, 2.5};
  std::vector<Scene> stated;
  for (int k = 0; k < 3; ++k) {
    stated.emplace_back(3, 52);
    if (k == 1) continue;  // the middle one has the rig's
    own.samples[k].noise.assign(own.rig.joints.size(), 1);
    for (size_t j = 0; j < own.rig.joints.size(); ++j) {
      own.samples[k].noise[j] = factors[(j + static_cast<size_t>(k)) % 4];
      stated[k].rig.joints[j].sigma *= own.samples[k].noise[j];
    }
  }
  std::vector<int> sensors(own.rig.sensors.size());
  std::iota(sensors.begin(), sensors.end(), 0);
  for (const NoiseMode mode : kModes) {
    const auto problem = own.problem(mode, sensors, own.whole());
    problem->set_workers(1);
    const VectorXd state = problem->pack(own.values);
    problem->renew(state);
    problem->prepare(state);
    int compared = 0;
    for (int k = 0; k < 3; ++k) {
      const auto expected = stated[k].problem(mode, sensors, stated[k].whole());
      expected->set_workers(1);
      expected->renew(state);
      expected->prepare(state);
      REQUIRE(expected->groups().size() == problem->groups().size());
      for (int g = 0; g < static_cast<int>(problem->groups().size()); ++g) {
        if (problem->sample_of(g) != k) continue;
        ++compared;
        INFO(mode_name(mode) << ", sample " << k);
        MatrixXd rows, expected_rows;
        REQUIRE(problem->explicit_rows(g, state, rows));
        REQUIRE(expected->explicit_rows(g, state, expected_rows));
        const VectorXd scale = (expected_rows.transpose() * expected_rows).diagonal();
        CHECK(rows == expected_rows);
        Cost cost, expected_cost;
        REQUIRE(problem->evaluate(g, state, 0, cost));
        REQUIRE(expected->evaluate(g, state, 0, expected_cost));
        CHECK(cost.chi2 == Approx(expected_cost.chi2).epsilon(1e-13));
        MatrixXd gram = MatrixXd::Zero(rows.cols(), rows.cols()), root;
        REQUIRE(add_equations(*problem, g, state, 0, gram, cost));
        REQUIRE(problem->square_root(g, state, 0, root));
        MatrixXd equations = expected_rows.transpose() * expected_rows;
        CHECK(scaled_difference(root.transpose() * root, equations, scale) < 1e-13);
        equations(equations.rows() - 1, equations.cols() - 1) = 0;  // r'r stays out
        // one sample's J = L M rounds, see `report`: 2e-13 with avx2 and baseline
        CHECK(scaled_difference(symmetric(gram), equations, scale) < 2e-9);
      }
    }
    CHECK(compared >= 3);
  }
}

TEST_CASE("samples apart: each is the problem that it is alone, bit by bit") {
  for (NoiseMode mode : kModes) {
    Scene s(7, 5);  // its own: readings change below
    EstimationSetup setup;
    setup.noise = mode;
    setup.sensors = indices(s.rig.sensors.size());
    const auto alone = [&](int sample) {
      return std::make_unique<Estimation>(s, std::vector<int>{sample}, setup);
    };
    EstimationSetup laid_out = setup;
    laid_out.apart = true;
    Estimation apart(s, s.training(), laid_out);
    REQUIRE(apart.sample_count() == static_cast<int>(s.training().size()));
    const auto compare = [&](const Values& values) {
      for (int i = 0; i < apart.sample_count(); ++i) {
        apart.take_alone(i);
        const int sample = apart.sample_of(0);
        INFO(mode_name(mode) << ", sample " << sample);
        REQUIRE(sample == s.training()[i]);
        const auto one = alone(sample);
        REQUIRE(apart.groups().size() == 1);
        REQUIRE(apart.groups()[0].private_size == one->groups()[0].private_size);
        VectorXd state = one->pack(values);
        REQUIRE(apart.pack(values) == state);
        VectorXd solved = state;
        SolverOptions options;
        options.max_iterations = 3;
        LevenbergMarquardt(*one, options).solve(state);
        const SolveSummary summary = LevenbergMarquardt(apart, options).solve(solved);
        CHECK(summary.iterations > 0);
        CHECK(solved == state);
        const std::vector<ViewResiduals> a = apart.residuals(solved), b = one->residuals(state);
        REQUIRE(a.size() == b.size());
        for (size_t v = 0; v < a.size(); ++v) {
          CHECK(a[v].view == b[v].view);
          CHECK(a[v].whitened == b[v].whitened);
        }
      }
    };
    const auto walk_first = [&](const Values& values) {  // what is compared next was walked last
      apart.take_alone(0);
      const VectorXd state = apart.pack(values);
      apart.renew(state);
      Cost cost;
      REQUIRE(apart.evaluate(0, state, 0, cost));
    };
    compare(s.values);
    walk_first(s.values);
    Values other = s.values;
    for (const Parameter& p : s.table.all)
      if (p.kind == ParameterKind::joint_offset) other.shared(p.start) += 0.01;
    compare(other);
    walk_first(other);
    for (Sample& sample : s.samples)
      for (double& reading : sample.readings) reading += 0.01;
    apart.reload();
    compare(other);
  }
}

TEST_CASE("samples apart share nothing that is estimated") {
  const Scene& s = scene();
  EstimationSetup setup;
  setup.sensors = indices(s.rig.sensors.size());
  setup.apart = true;
  setup.free = s.whole();
  CHECK_THROWS_AS(Estimation(s, s.training(), setup), std::logic_error);
}

}  // namespace estimation_test
