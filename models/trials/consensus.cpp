#include "consensus.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "../fitting/fit.h"
#include "../fitting/robust.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kJointSigmas = 6;  // a joint error beyond this is no noise
constexpr size_t kTriedViews = 10;  // of a sample: so many are left out in turn

int blocks_of(const Rig& rig, const View& v) {
  const Sensor& sensor = rig.sensors[v.sensor];
  return sensor.model->blocks(v.ids.empty() ? rig.targets[v.target].count()
                                            : static_cast<int>(v.ids.size()));
}

/// The view without some points.
View without(const Rig& rig, const View& view, const std::vector<char>& out) {
  const int numbers = rig.sensors[view.sensor].model->measurement_size();
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

}  // namespace

SampleVerdict nothing_rejected(const Rig& rig, const Sample& sample) {
  SampleVerdict out;
  out.view.assign(sample.views.size(), 0);
  out.view_reason.resize(sample.views.size());
  for (const View& v : sample.views) out.point.push_back(std::vector<char>(blocks_of(rig, v), 0));
  return out;
}

Sample without_rejected(const Rig& rig, const Sample& sample, const SampleVerdict& verdict) {
  Sample out = sample;
  out.views.clear();
  for (size_t v = 0; v < sample.views.size(); ++v) {
    if (verdict.view[v]) continue;
    const std::vector<char>& point = verdict.point[v];
    const bool some = std::count(point.begin(), point.end(), 1) > 0;
    out.views.push_back(some ? without(rig, sample.views[v], point) : sample.views[v]);
  }
  return out;
}

namespace {

/// A sample by itself at held shared parameters.
struct SampleFit {
  bool defined = false;
  VectorXd residuals;                               // whitened, view after view
  std::vector<std::pair<const View*, int>> blocks;  // of each residual block: view, block in it
  std::vector<int> rows;                            // and its rows
  std::vector<std::pair<int, double>> joints;       // joint, error in sigmas
};

EstimationSetup setup_of(ReferenceFit& reference) {
  EstimationSetup setup;
  setup.noise = NoiseMode::latent;
  setup.sensors = reference.sensors;
  return setup;
}

/// The sample's residuals and joint errors after a Newton step of the shared parameters as well,
/// whose estimate and covariance the others gave:  least |r + J_p p + J_s W y|^2 + |y|^2,  or with
/// Cauchy's weights and a scale that falls (robust.h). rows: [J_p J_s r].
void take_part(ReferenceFit& reference, const GroupShape& shape, const MatrixXd& rows, bool robust,
               SampleFit& fit) {
  const Eigen::Index k = shape.private_size, m = static_cast<Eigen::Index>(shape.columns.size()),
                     n = reference.root.cols(), total = fit.residuals.size();
  MatrixXd root(m, n);
  for (Eigen::Index i = 0; i < m; ++i) root.row(i) = reference.root.row(shape.columns[i]);
  MatrixXd a = MatrixXd::Zero(rows.rows() + n, k + n);
  a.topLeftCorner(rows.rows(), k) = rows.leftCols(k);
  a.topRightCorner(rows.rows(), n) = rows.middleCols(k, m) * root;
  a.bottomRightCorner(n, n).setIdentity();
  VectorXd right = VectorXd::Zero(a.rows());
  right.head(rows.rows()) = rows.col(rows.cols() - 1);
  VectorXd left = right, weight = VectorXd::Ones(a.rows());
  double scale = std::numeric_limits<double>::infinity();
  for (int round = 0; round < (robust ? 30 : 1); ++round) {
    left = right - a * least_squares(MatrixXd(weight.asDiagonal() * a),
                                     VectorXd(weight.cwiseProduct(right)));
    Eigen::Index at = 0;
    std::vector<double> sizes;
    for (size_t b = 0; b < fit.rows.size(); at += fit.rows[b++])
      sizes.push_back(left.segment(at, fit.rows[b]).norm() /
                      reference.noise_ratios[fit.blocks[b].first->sensor]);
    scale = std::max(1.0, std::min(scale / 2, *std::max_element(sizes.begin(), sizes.end())));
    at = 0;
    for (size_t b = 0; b < fit.rows.size(); at += fit.rows[b++])
      weight.segment(at, fit.rows[b]).setConstant(1 / std::hypot(1.0, sizes[b] / (3 * scale)));
  }
  fit.residuals = left.head(total);
  for (size_t j = 0; j < fit.joints.size(); ++j)
    fit.joints[j].second = left(total + static_cast<Eigen::Index>(j));
}

/// Targets and joint errors estimated, graduated from the starts of the targets or by plain least
/// squares. `taking_part`: what one Newton step of the free shared parameters as well would leave.
SampleFit fit_sample(ReferenceFit& reference, const Sample& sample, Values& values, bool robust,
                     bool taking_part) {
  SampleFit out;
  const Recording one = reference.given.with_samples({sample});
  EstimationSetup setup = setup_of(reference);
  if (robust) setup.loss = {LossKind::cauchy, 3, true};
  FitOptions options;
  options.start_loss = Loss{LossKind::soft_l1, 3};
  options.leave_out_undefined = true;
  options.noise_ratios = &reference.noise_ratios;
  values.shared = reference.shared;
  Fit fitted = fit(one, {0}, setup, values, options);
  if (!fitted.defined()) return out;
  out.defined = true;
  Estimation& problem = *fitted.problem;
  if (problem.groups().empty()) return out;  // nothing of it is judged
  values = std::move(fitted.values);
  problem.renew(fitted.state);
  const std::vector<ViewResiduals> residuals = problem.residuals(fitted.state);
  Eigen::Index total = 0;
  for (const ViewResiduals& r : residuals) total += r.whitened.size();
  out.residuals.resize(total);
  total = 0;
  for (const ViewResiduals& r : residuals) {
    out.residuals.segment(total, r.whitened.size()) = r.whitened;
    total += r.whitened.size();
    const int count = blocks_of(reference.given.rig, *r.view);
    for (int b = 0; b < count; ++b) {
      out.blocks.push_back({&sample.views[r.view - one.samples[0].views.data()], b});
      out.rows.push_back(static_cast<int>(r.whitened.size()) / count);
    }
  }
  for (const auto& e : values.errors)
    out.joints.push_back(
        {e.first.second, e.second / joint_sigma(one.rig, one.samples[0], e.first.second)});
  if (!taking_part || reference.root.size() == 0) return out;

  setup.free = reference.free;
  setup.loss = Loss();
  Estimation together(one, {0}, setup);
  MatrixXd rows;
  const VectorXd at = together.pack(values);
  together.renew(at);
  if (together.explicit_rows(0, at, rows))
    take_part(reference, together.groups()[0], rows, robust, out);
  return out;
}

/// Blocks beyond the bound, by view and block of the sample that was fitted; false: none.
bool outlying(ReferenceFit& reference, const Sample& sample, const SampleFit& fit,
              std::vector<std::vector<char>>& flags) {
  bool any = false;
  flags.assign(sample.views.size(), {});
  for (size_t v = 0; v < sample.views.size(); ++v)
    flags[v].assign(blocks_of(reference.given.rig, sample.views[v]), 0);
  Eigen::Index at = 0;
  for (size_t b = 0; b < fit.blocks.size(); ++b) {
    const View* view = fit.blocks[b].first;
    const double squared = fit.residuals.segment(at, fit.rows[b]).squaredNorm() /
                           std::pow(reference.noise_ratios[view->sensor], 2);
    at += fit.rows[b];
    if (squared <= chi2_bound(fit.rows[b])) continue;
    flags[view - sample.views.data()][fit.blocks[b].second] = 1;
    any = true;
  }
  return any;
}

const std::pair<int, double>* wrong_joint(const SampleFit& fit) {
  const std::pair<int, double>* worst = nullptr;
  for (const auto& j : fit.joints)
    if (std::abs(j.second) > kJointSigmas &&
        (!worst || std::abs(j.second) > std::abs(worst->second)))
      worst = &j;
  return worst;
}

/// The rms of each view's residuals against what is usual of its sensor.
std::map<const View*, double> view_misfits(const ReferenceFit& reference, const SampleFit& fit) {
  std::map<const View*, std::pair<double, int>> views;
  Eigen::Index at = 0;
  for (size_t b = 0; b < fit.rows.size(); at += fit.rows[b++]) {
    std::pair<double, int>& v = views[fit.blocks[b].first];
    v.first += fit.residuals.segment(at, fit.rows[b]).squaredNorm();
    v.second += fit.rows[b];
  }
  std::map<const View*, double> out;
  for (const auto& v : views)
    out[v.first] =
        std::sqrt(v.second.first / v.second.second) / reference.noise_ratios[v.first->sensor];
  return out;
}

/// The views to leave out in turn: all of few, of many those that miss most. Each costs fits of
/// all the others: the work for a sample must not grow with the square of its views.
std::vector<size_t> views_to_try(const ReferenceFit& reference, const Sample& sample,
                                 const SampleFit& fit) {
  std::vector<size_t> out(sample.views.size());
  for (size_t v = 0; v < out.size(); ++v) out[v] = v;
  if (out.size() <= kTriedViews) return out;
  std::map<const View*, double> misfit = view_misfits(reference, fit);
  std::stable_sort(out.begin(), out.end(), [&](size_t a, size_t b) {
    return misfit[&sample.views[a]] > misfit[&sample.views[b]];
  });
  out.resize(kTriedViews);
  return out;
}

/// How a sample misses, for people: its worst view against what is usual, or its worst joint error.
std::string misfit_text(ReferenceFit& reference, const SampleFit& fit) {
  if (!fit.defined) return "a point lies behind a camera";
  double largest = 0;
  for (const auto& v : view_misfits(reference, fit)) largest = std::max(largest, v.second);
  const auto* joint = wrong_joint(fit);
  if (joint && std::abs(joint->second) > largest)
    return text("it would take an error of %.3g sigmas in joint '", joint->second) +
           reference.given.rig.tree.joints[joint->first].name + "'";
  return text("residuals %.3g times the usual", largest);
}

/// True if two views predict each other, so that one can be proved wrong: one of a mounted target,
/// or two of one free target.
bool is_redundant(const Rig& rig, const std::vector<View>& views) {
  std::map<int, int> seen;
  for (const View& v : views)
    if (rig.targets[v.target].link >= 0 || ++seen[v.target] >= 2) return true;
  return false;
}

enum class Fits { yes, but_for_points, no };

/// Whether a sample fits, with or without at most a third of each view's blocks; these in `out` (by
/// view and block). `plain`: the sample as it is, by plain least squares.
Fits fits(ReferenceFit& reference, const Sample& sample, const Values& start, bool taking_part,
          std::vector<std::vector<char>>& out, SampleFit& plain) {
  Values values = start;
  plain = fit_sample(reference, sample, values, false, taking_part);
  if (plain.defined && !outlying(reference, sample, plain, out) && !wrong_joint(plain))
    return Fits::yes;
  values = start;
  const SampleFit robust = fit_sample(reference, sample, values, true, taking_part);
  if (!robust.defined) return Fits::no;
  outlying(reference, sample, robust, out);
  const auto too_many = [](const std::vector<char>& view) {
    return 3 * std::count(view.begin(), view.end(), 1) > static_cast<long>(view.size());
  };
  for (int round = 0; round < 3; ++round) {  // what is left must fit by plain least squares
    if (std::any_of(out.begin(), out.end(), too_many)) return Fits::no;
    SampleVerdict points = nothing_rejected(reference.given.rig, sample);
    points.point = out;
    const Sample rest = without_rejected(reference.given.rig, sample, points);
    Values values_without_points = values;
    const SampleFit check = fit_sample(reference, rest, values_without_points, false, taking_part);
    std::vector<std::vector<char>> more;
    if (!check.defined) return Fits::no;
    if (!outlying(reference, rest, check, more))
      return wrong_joint(check) ? Fits::no : Fits::but_for_points;
    for (size_t v = 0; v < out.size(); ++v) {
      size_t b = 0;
      for (char& p : out[v])
        if (!p) p = more[v][b++];
    }
  }
  return Fits::no;
}

}  // namespace

SampleVerdict judge_sample(ReferenceFit& reference, const Sample& sample,
                           const SampleVerdict& before, const Values& start) {
  SampleVerdict verdict = nothing_rejected(reference.given.rig, sample);
  const bool took_part = before.took_part();
  std::vector<std::vector<char>> points;
  SampleFit plain;
  if (fits(reference, sample, start, !took_part, points, plain) != Fits::no) {
    if (plain.defined && std::any_of(points.begin(), points.end(), [](const auto& v) {
          return std::count(v.begin(), v.end(), 1) > 0;
        }))
      verdict.point = points;
    return verdict;
  }
  // Without which views does it?
  const size_t n = sample.views.size();
  const auto explains = [&](const std::vector<char>& out) {
    Sample rest = sample;
    rest.views.clear();
    for (size_t v = 0; v < n; ++v)
      if (!out[v]) rest.views.push_back(sample.views[v]);
    std::vector<std::vector<char>> found;
    SampleFit ignored;
    if (!is_redundant(reference.given.rig, rest.views) ||
        fits(reference, rest, Values(), !took_part, found, ignored) == Fits::no)
      return false;
    verdict.view = out;
    for (size_t v = 0, r = 0; v < n; ++v)
      if (!out[v]) verdict.point[v] = found[r++];
    return true;
  };
  const auto is_chain = [&](size_t v) {
    return reference.given.rig.sensors[sample.views[v].sensor].model->measurement_kind() ==
           MeasurementKind::chain;
  };
  int explanations = 0, chains = 0;
  for (const size_t v : views_to_try(reference, sample, plain)) {
    if (n == 1 || explanations > 1) break;  // two explanations are none
    reference.progress.check();
    std::vector<char> out(n, 0);
    out[v] = 1;
    if (explains(out)) ++explanations, chains += is_chain(v);
  }
  if (explanations == 0 && n > 4) {  // several: those that the graduated fit gave up
    std::vector<char> out(n, 0);
    for (size_t v = 0; v < n; ++v) {
      out[v] = 3 * std::count(points[v].begin(), points[v].end(), 1) >
               static_cast<long>(points[v].size());
      chains += out[v] && is_chain(v);
    }
    if (2 * std::count(out.begin(), out.end(), 1) < static_cast<long>(n) && explains(out))
      explanations = 1;
  }
  for (size_t v = 0; v < n; ++v)
    if (verdict.view[v])
      verdict.view_reason[v] =
          "does not belong to the sample's other views (" + misfit_text(reference, plain) + ")";
  if (explanations == 1 && chains == 0) return verdict;
  verdict.out = true;
  verdict.reason = "its joint readings and its views do not belong together (" +
                   misfit_text(reference, plain) + ")";
  return verdict;
}

}  // namespace kincal
