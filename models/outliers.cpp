#include "outliers.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

#include "robust.h"
#include "starts.h"

namespace kincal {
namespace {

constexpr double kJointSigmas = 6;  // a joint error beyond this is no noise
constexpr int kRounds = 8;

/// What of a sample is out: the sample, views, points of views.
struct Verdict {
  bool out = false;
  std::vector<char> view;                // by view
  std::vector<std::vector<char>> point;  // by view and block; of views that are out as well
  std::string reason;                    // of the sample
  std::vector<std::string> view_reason;

  bool operator==(const Verdict& o) const { return out == o.out && (out || (view == o.view && point == o.point)); }
  bool clean() const {
    if (out) return false;
    for (size_t v = 0; v < view.size(); ++v)
      if (view[v] || std::count(point[v].begin(), point[v].end(), 1)) return false;
    return true;
  }
};

int blocks_of(const Rig& rig, const View& v) {
  const Sensor& sensor = rig.sensors[v.sensor];
  return sensor.model->blocks(v.ids.empty() ? rig.targets[v.target].count() : static_cast<int>(v.ids.size()));
}

Verdict all_in(const Rig& rig, const Sample& sample) {
  Verdict out;
  out.view.assign(sample.views.size(), 0);
  out.view_reason.resize(sample.views.size());
  for (const View& v : sample.views) out.point.push_back(std::vector<char>(blocks_of(rig, v), 0));
  return out;
}

/// The view without some points.
View without(const Rig& rig, const View& view, const std::vector<char>& out) {
  const int numbers = rig.sensors[view.sensor].model->numbers();
  View v = view;
  v.ids.clear();
  v.z.clear();
  v.covariance.clear();
  for (size_t b = 0; b < out.size(); ++b) {
    if (out[b]) continue;
    v.ids.push_back(view.ids.empty() ? static_cast<int>(b) : view.ids[b]);
    v.z.insert(v.z.end(), view.z.begin() + b * numbers, view.z.begin() + (b + 1) * numbers);
    if (!view.covariance.empty()) v.covariance.push_back(view.covariance[b]);
  }
  return v;
}

/// What the verdict leaves of a sample; `views`: with the views that are out, without their outlying points.
Sample left_of(const Rig& rig, const Sample& sample, const Verdict& verdict, bool views = false) {
  Sample out = sample;
  out.views.clear();
  for (size_t v = 0; v < sample.views.size(); ++v) {
    if (verdict.view[v] && !views) continue;
    const std::vector<char>& point = verdict.point[v];
    const bool some = !verdict.view[v] && std::count(point.begin(), point.end(), 1);
    out.views.push_back(some ? without(rig, sample.views[v], point) : sample.views[v]);
  }
  return out;
}

/// What samples are judged by.
struct Bench {
  const Rig& rig;
  const ParameterTable& table;
  std::vector<int> sensors;  // of the last step
  VectorXd shared;
  std::vector<double> levels;
  // Of the parameters that the last step freed: covariance = root root', columns in their order. Empty: not known (yet).
  std::vector<Freed> free;
  MatrixXd root;
};

/// A sample by itself at held shared parameters.
struct Alone {
  bool defined = false;
  VectorXd residuals;                                  // whitened, view after view
  std::vector<std::pair<const View*, int>> blocks;     // of each residual block: view, block in it
  std::vector<int> rows;                               // and its rows
  std::vector<std::pair<int, double>> joints;          // joint, error in sigmas
};

EstimationSetup setup_of(const Bench& bench) {
  EstimationSetup setup;
  setup.noise = NoiseMode::latent;
  setup.sensors = bench.sensors;
  return setup;
}

/// The sample's residuals and joint errors after a Newton step of the shared parameters as well, whose estimate and covariance the others
/// gave:  least |r + J_p p + J_s W y|^2 + |y|^2,  or with Cauchy's weights and a scale that falls (robust.h). rows: [J_p J_s r].
void take_part(const Bench& bench, const GroupShape& shape, const MatrixXd& rows, bool robust, Alone& fit) {
  const Eigen::Index k = shape.private_size, m = static_cast<Eigen::Index>(shape.columns.size()), n = bench.root.cols(),
                     total = fit.residuals.size();
  MatrixXd root(m, n);
  for (Eigen::Index i = 0; i < m; ++i) root.row(i) = bench.root.row(shape.columns[i]);
  MatrixXd a = MatrixXd::Zero(rows.rows() + n, k + n);
  a.topLeftCorner(rows.rows(), k) = rows.leftCols(k);
  a.topRightCorner(rows.rows(), n) = rows.middleCols(k, m) * root;
  a.bottomRightCorner(n, n).setIdentity();
  VectorXd right = VectorXd::Zero(a.rows());
  right.head(rows.rows()) = rows.col(rows.cols() - 1);
  VectorXd left = right, weight = VectorXd::Ones(a.rows());
  double scale = std::numeric_limits<double>::infinity();
  for (int round = 0; round < (robust ? 30 : 1); ++round) {
    left = right - a * (weight.asDiagonal() * a).colPivHouseholderQr().solve(weight.cwiseProduct(right));
    Eigen::Index at = 0;
    std::vector<double> sizes;
    for (size_t b = 0; b < fit.rows.size(); at += fit.rows[b++])
      sizes.push_back(left.segment(at, fit.rows[b]).norm() / bench.levels[fit.blocks[b].first->sensor]);
    scale = std::max(1.0, std::min(scale / 2, *std::max_element(sizes.begin(), sizes.end())));
    at = 0;
    for (size_t b = 0; b < fit.rows.size(); at += fit.rows[b++])
      weight.segment(at, fit.rows[b]).setConstant(1 / std::hypot(1.0, sizes[b] / (3 * scale)));
  }
  fit.residuals = left.head(total);
  for (size_t j = 0; j < fit.joints.size(); ++j) fit.joints[j].second = left(total + static_cast<Eigen::Index>(j));
}

/// Targets and joint errors estimated, graduated from the starts of the targets or by plain least squares. `taking_part`: what one Newton
/// step of the free shared parameters as well would leave.
Alone fit_alone(const Bench& bench, const Sample& sample, Values& values, bool robust, bool taking_part) {
  Alone out;
  const std::vector<Sample> one = {sample};
  EstimationSetup setup = setup_of(bench);
  if (robust) setup.loss = {LossKind::cauchy, 3, true};
  Estimation problem(bench.rig, bench.table, one, {0}, setup);
  if (problem.groups().empty()) return out;
  values.shared = bench.shared;
  VectorXd state;
  const auto solve = [&] {
    state = problem.pack(values);
    problem.renew(state);
    Cost cost;
    if (!problem.evaluate(0, state, 0, cost) || !std::isfinite(cost.twice)) return false;
    if (robust) solve_graduated(problem, bench.rig, SolverOptions(), state, &bench.levels);
    return LevenbergMarquardt(problem, SolverOptions()).solve(state).outcome != Outcome::undefined_start;
  };
  try {
    start_targets(bench.rig, bench.table, one, {0}, bench.sensors, {LossKind::soft_l1, 3}, values);
    if (!solve()) return out;
  } catch (const std::runtime_error&) {
    return out;
  }
  problem.unpack(state, values);
  problem.renew(state);
  out.defined = true;
  const std::vector<ViewResiduals> residuals = problem.residuals(state);
  Eigen::Index total = 0;
  for (const ViewResiduals& r : residuals) total += r.whitened.size();
  out.residuals.resize(total);
  total = 0;
  for (const ViewResiduals& r : residuals) {
    out.residuals.segment(total, r.whitened.size()) = r.whitened;
    total += r.whitened.size();
    const int count = blocks_of(bench.rig, *r.view);
    for (int b = 0; b < count; ++b) {
      out.blocks.push_back({&sample.views[r.view - one[0].views.data()], b});
      out.rows.push_back(static_cast<int>(r.whitened.size()) / count);
    }
  }
  for (const auto& e : values.errors) out.joints.push_back({e.first.second, e.second / bench.rig.joints[e.first.second].sigma});
  if (!taking_part || bench.root.size() == 0) return out;

  setup.free = bench.free;
  setup.loss = Loss();
  Estimation together(bench.rig, bench.table, one, {0}, setup);
  MatrixXd rows;
  const VectorXd at = together.pack(values);
  together.renew(at);
  if (together.explicit_rows(0, at, rows)) take_part(bench, together.groups()[0], rows, robust, out);
  return out;
}

/// Blocks beyond the bound, by view (of `sample`, by its address) and block; the largest ratio of a block to its sensor's level.
bool outlying(const Bench& bench, const Sample& sample, const Alone& fit, std::vector<std::vector<char>>& flags, double& worst) {
  bool any = false;
  flags.assign(sample.views.size(), {});
  for (size_t v = 0; v < sample.views.size(); ++v) flags[v].assign(blocks_of(bench.rig, sample.views[v]), 0);
  Eigen::Index at = 0;
  worst = 0;
  for (size_t b = 0; b < fit.blocks.size(); ++b) {
    const View* view = fit.blocks[b].first;
    const double squared = fit.residuals.segment(at, fit.rows[b]).squaredNorm() / std::pow(bench.levels[view->sensor], 2);
    at += fit.rows[b];
    worst = std::max(worst, std::sqrt(squared / fit.rows[b]));
    if (squared <= chi2_bound(fit.rows[b])) continue;
    flags[view - sample.views.data()][fit.blocks[b].second] = 1;
    any = true;
  }
  return any;
}

const std::pair<int, double>* wrong_joint(const Alone& fit) {
  const std::pair<int, double>* worst = nullptr;
  for (const auto& j : fit.joints)
    if (std::abs(j.second) > kJointSigmas && (!worst || std::abs(j.second) > std::abs(worst->second))) worst = &j;
  return worst;
}

std::string text(const char* format, double a, double b = 0) {
  char buffer[200];
  std::snprintf(buffer, sizeof buffer, format, a, b);
  return buffer;
}

/// Root mean square of a view's raw residuals against what is usual: not needed to decide, only to say.
std::string size_of(const Bench& bench, const Alone& fit, const View& view) {
  double squared = 0;
  int rows = 0;
  Eigen::Index at = 0;
  for (size_t b = 0; b < fit.blocks.size(); ++b) {
    if (fit.blocks[b].first == &view) squared += fit.residuals.segment(at, fit.rows[b]).squaredNorm(), rows += fit.rows[b];
    at += fit.rows[b];
  }
  return text("%.3g times the usual residual", std::sqrt(squared / std::max(rows, 1)) / bench.levels[view.sensor]);
}

/// Whether views of the sample that are not out hang together: one of a mounted target, or two of one free target.
bool hangs_together(const Rig& rig, const Sample& sample, const std::vector<char>& out) {
  std::map<int, int> seen;
  for (size_t v = 0; v < sample.views.size(); ++v) {
    if (out[v]) continue;
    const int target = sample.views[v].target;
    if (rig.targets[target].link >= 0 || ++seen[target] >= 2) return true;
  }
  return false;
}

/// Verdict on a sample. `before`: that of the fit that gave the bench's values. `targets`: where they stand in it.
Verdict judge_sample(const Bench& bench, const Sample& sample, const Verdict& before, bool may_return, const Values& start) {
  const Rig& rig = bench.rig;
  Verdict verdict = all_in(rig, sample);
  std::vector<std::vector<char>> flags;
  double worst = 0;
  const bool took_part = !before.out && std::count(before.view.begin(), before.view.end(), 1) == 0;
  if (!took_part && !may_return) return before;

  // As it is.
  Values plain = start;
  const Alone all = fit_alone(bench, sample, plain, false, !took_part);
  if (all.defined && !outlying(bench, sample, all, flags, worst) && !wrong_joint(all)) return verdict;

  // Graduated: what does not fit shows.
  Values values = start;
  Alone fit = fit_alone(bench, sample, values, true, !took_part);
  const auto sample_out = [&](const std::string& why) {
    verdict.out = true;
    verdict.reason = why;
    return verdict;
  };
  if (!fit.defined) return sample_out("at every pose of its targets a point lies behind a camera");
  outlying(bench, sample, fit, verdict.point, worst);
  for (int round = 0;; ++round) {
    int out = 0, chains = 0;
    for (size_t v = 0; v < sample.views.size(); ++v) {
      const std::vector<char>& point = verdict.point[v];
      const auto n = std::count(point.begin(), point.end(), 1);
      if (verdict.view[v] || 3 * n > static_cast<long>(point.size())) {
        if (!verdict.view[v]) verdict.view_reason[v] = size_of(bench, fit, sample.views[v]) + ", while the sample's other views agree";
        verdict.view[v] = 1;
        ++out;
        chains += rig.sensors[sample.views[v].sensor].model->sight() == Sight::chain;
      }
    }
    const int views = static_cast<int>(sample.views.size());
    if (out > 0 && (chains > 0 || 2 * out > views || !hangs_together(rig, sample, verdict.view))) {
      double largest = 0;
      std::string size;
      for (size_t v = 0; v < sample.views.size(); ++v)
        if (verdict.view[v] && all.defined) {
          const double one = std::atof(size_of(bench, all, sample.views[v]).c_str());
          if (one > largest) largest = one, size = size_of(bench, all, sample.views[v]);
        }
      return sample_out("its joint readings and its views do not belong together (" +
                        (all.defined ? size : std::string("a point lies behind a camera")) + ")");
    }
    // What is left must fit by itself.
    Sample rest = left_of(rig, sample, verdict);
    // Outlying views stay in the values' reach: targets that nothing sees any more need no pose.
    Values again = values;
    const Alone check = fit_alone(bench, rest, again, false, !took_part);
    if (!check.defined || round == 3) return sample_out("no majority of its points agrees");
    std::vector<std::vector<char>> more;
    const bool any = outlying(bench, rest, check, more, worst);
    if (!any) {
      if (const auto* joint = wrong_joint(check))
        return sample_out("the reading of joint '" + rig.tree.joints[joint->first].name + text("' is off by %.3g of its sigmas", joint->second));
      return verdict;
    }
    size_t r = 0;  // flags of the rest, back into the sample's
    for (size_t v = 0; v < sample.views.size(); ++v) {
      if (verdict.view[v]) continue;
      size_t b = 0;
      for (char& p : verdict.point[v])
        if (!p) p = more[r][b++];
      ++r;
    }
  }
}

std::vector<Sample> left_of_all(const Calibration& calibration, const std::vector<Verdict>& verdicts) {
  std::vector<Sample> out;
  for (size_t i = 0; i < verdicts.size(); ++i)
    if (!verdicts[i].out)
      out.push_back(verdicts[i].clean() ? calibration.samples()[i] : left_of(calibration.rig(), calibration.samples()[i], verdicts[i]));
  return out;
}

void describe(const Calibration& calibration, const std::vector<Verdict>& verdicts, std::vector<Rejected>& out) {
  const Rig& rig = calibration.rig();
  for (size_t i = 0; i < verdicts.size(); ++i) {
    const Sample& sample = calibration.samples()[i];
    const Verdict& verdict = verdicts[i];
    if (verdict.out) out.push_back({sample.id, "", "", {}, verdict.reason});
    for (size_t v = 0; !verdict.out && v < sample.views.size(); ++v) {
      const View& view = sample.views[v];
      Rejected r{sample.id, rig.sensors[view.sensor].name, rig.targets[view.target].name, {}, verdict.view_reason[v]};
      for (size_t b = 0; !verdict.view[v] && b < verdict.point[v].size(); ++b)
        if (verdict.point[v][b]) r.ids.push_back(view.ids.empty() ? static_cast<int>(b) : view.ids[b]);
      if (!r.ids.empty()) r.reason = "far from where the view's other points put " + std::string(r.ids.size() == 1 ? "it" : "them");
      if (verdict.view[v] || !r.ids.empty()) out.push_back(r);
    }
  }
}

/// Root of a covariance, C = W W', whose diagonal may span many orders.
MatrixXd root_of(const MatrixXd& c) {
  const VectorXd scale = c.diagonal().cwiseMax(0.0).cwiseSqrt();
  const VectorXd inverse = scale.unaryExpr([](double s) { return s > 0 ? 1 / s : 0.0; });
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(inverse.asDiagonal() * c * inverse.asDiagonal());
  return scale.asDiagonal() * eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
}

}  // namespace

std::optional<Cleaned> calibrate_without_outliers(const Calibration& calibration, const CalibrationOptions& options) {
  const Rig& rig = calibration.rig();
  const std::vector<Sample>& samples = calibration.samples();
  std::vector<Verdict> verdicts;
  for (const Sample& s : samples) verdicts.push_back(all_in(rig, s));
  std::vector<char> returned(samples.size(), 0);

  CalibrationOptions quick = options;
  quick.judge = false;
  quick.robust = true;
  quick.noise = NoiseMode::latent;
  Calibration copy = calibration;
  std::optional<CalibrationResult> fit = copy.run(quick);
  if (!fit) return std::nullopt;
  quick.robust = false;
  quick.noise = options.noise;
  const Values start = fit->values;  // of all samples that could start
  Bench bench{rig, copy.table(), fit->setup.sensors, fit->values.shared, fit->setup.levels, {}, {}};
  const std::vector<int> training = calibration.training();
  bool settled = false;
  for (int round = 0; round < kRounds && !settled; ++round) {
    std::vector<Verdict> now = verdicts;
    size_t out = 0;
    for (int i : training) {
      Values mine;
      for (const auto& t : start.targets)
        if (t.first.first == i) mine.targets[{0, t.first.second}] = t.second;
      now[i] = judge_sample(bench, samples[i], verdicts[i], !returned[i], mine);
      if (round > 0 && (verdicts[i].out || std::count(verdicts[i].view.begin(), verdicts[i].view.end(), 1)) && !(now[i] == verdicts[i]))
        returned[i] = 1;
      out += now[i].out;
    }
    if (2 * out > training.size()) {
      Cleaned plain{calibration, {}};
      fit = plain.calibration.run(options);
      if (!fit) return std::nullopt;
      plain.result = std::move(*fit);
      plain.result.warnings.push_back({"no_consensus", "--reject: " + std::to_string(out) + " of " + std::to_string(training.size()) +
                                                           " samples do not fit the others: nothing was taken out"});
      return plain;
    }
    settled = round > 0 && now == verdicts;
    verdicts = now;
    if (settled) break;
    Calibration left(rig, left_of_all(calibration, verdicts));
    fit = left.run(quick);
    if (!fit) return std::nullopt;
    Estimation problem(left.rig(), left.table(), left.samples(), left.training(), fit->setup);
    const VectorXd state = problem.pack(fit->values);
    problem.renew(state);
    bench.levels = robust_levels(rig, problem.residuals(state));
    bench.shared = fit->values.shared;
    bench.free = fit->setup.free;
    bench.root = std::sqrt(std::max(1.0, fit->dof > 0 ? fit->chi2 / fit->dof : 1.0)) * root_of(fit->covariance);
  }
  Cleaned clean{Calibration(rig, left_of_all(calibration, verdicts)), {}};
  fit = clean.calibration.run(options);
  if (!fit) return std::nullopt;
  clean.result = std::move(*fit);
  describe(calibration, verdicts, clean.result.rejected);
  return clean;
}

std::vector<Warning> misfits(const Calibration&, const CalibrationResult&) { return {}; }

}  // namespace kincal
