#include "widths.h"

#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../rig/distributions.h"

namespace kincal {
namespace {

const double kAnyWidth = std::log(10.0);                    // of widths that robots have at all
constexpr double kLargestStep = 1.5, kSmallestStep = 1e-4;  // in u
constexpr double kLargestWidth = 2;  // of the widths that are weighed, in spreads of the hyperprior
constexpr int kGrid = 8;             // of them, to either side
constexpr double kSmallestPivot = 1e-6;  // of H's factor, scaled: above rounding
constexpr double kCovered =
    2;  // sigmas: k = 2 of JCGM 100. (1,200 robots: 0.27 % of errors of frames
        // are beyond three predicted, none of points; of normal ones 0.27 %)
const double kBeyond = 2 * normal_tail(kCovered);
constexpr double kSmallestDirection = 1e-7;  // of the largest: the root of rounding, 1e-15, is 3e-8
constexpr double kResolved = 1e-3;           // share that is prior; below it only the mean counts
constexpr double kDetermined = 0.1;          // share that the data determine, to keep a component

/// 1 / t_i^2; 0: no prior.
VectorXd precision(const WidthProblem& p, const VectorXd& factor) {
  VectorXd out = VectorXd::Zero(p.start.size());
  for (Eigen::Index i = 0; i < out.size(); ++i) {
    if (p.start(i) == 0) continue;
    const double t = p.start(i) * (p.group[i] < 0 ? 1 : factor(p.group[i]));
    out(i) = 1 / (t * t);
  }
  return out;
}

/// Rows and columns of a symmetric matrix.
MatrixXd block(const MatrixXd& m, const std::vector<int>& rows, const std::vector<int>& columns) {
  MatrixXd out(rows.size(), columns.size());
  for (size_t i = 0; i < rows.size(); ++i)
    for (size_t j = 0; j < columns.size(); ++j)
      out(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = m(rows[i], columns[j]);
  return out;
}
VectorXd block(const VectorXd& v, const std::vector<int>& rows) {
  VectorXd out(rows.size());
  for (size_t i = 0; i < rows.size(); ++i) out(static_cast<Eigen::Index>(i)) = v(rows[i]);
  return out;
}

/// A covariance of some numbers, scaled to unit diagonal and factorised.
struct Scaled {
  VectorXd scale;
  Cholesky factor;
  explicit Scaled(const MatrixXd& c)
      : scale(c.diagonal().cwiseSqrt().cwiseInverse()),
        factor(scale.asDiagonal() * c * scale.asDiagonal()) {}
  MatrixXd solve(const MatrixXd& b) const {
    MatrixXd out(b.rows(), b.cols());
    for (Eigen::Index j = 0; j < b.cols(); ++j)
      out.col(j) = scale.cwiseProduct(factor.solve(scale.cwiseProduct(b.col(j))));
    return out;
  }
  double log_determinant() const {
    return 2 * (factor.diagonal().array().log().sum() - scale.array().log().sum());
  }
};

/// Puts numbers to 0: values and covariance of the others given that. Returns by what the values
/// moved.
VectorXd condition(const std::vector<int>& on, VectorXd& value, MatrixXd& covariance) {
  const Scaled chh(block(covariance, on, on));
  std::vector<int> all(value.size());
  for (size_t i = 0; i < all.size(); ++i) all[i] = static_cast<int>(i);
  const MatrixXd ch = block(covariance, all, on);
  VectorXd moved = -ch * chh.solve(block(value, on));
  covariance -= ch * chh.solve(ch.transpose());
  for (int i : on) {
    moved(i) = -value(i);
    covariance.row(i).setZero();
    covariance.col(i).setZero();
  }
  value += moved;
  return moved;
}

std::vector<int> members_of(const WidthProblem& p, int group) {
  std::vector<int> out;
  for (size_t i = 0; i < p.group.size(); ++i)
    if (p.group[i] == group) out.push_back(static_cast<int>(i));
  return out;
}

/// The problem of the unknowns that have a prior, the others eliminated: what the widths are
/// learned from. The problem itself where these are not determined.
WidthProblem without_open(const WidthProblem& p) {
  std::vector<int> open, kept;
  for (int i = 0; i < p.start.size(); ++i) (p.start(i) == 0 ? open : kept).push_back(i);
  if (open.empty() || kept.empty()) return p;
  const MatrixXd n = block(p.normal, open, open);
  if (!(n.diagonal().minCoeff() > 0)) return p;
  const Scaled factorised(n);
  if (!factorised.factor.good() || !(factorised.factor.diagonal().minCoeff() > kSmallestPivot))
    return p;
  const MatrixXd follows = factorised.solve(block(p.normal, open, kept));
  WidthProblem out;
  out.normal = block(p.normal, kept, kept) - block(p.normal, kept, open) * follows;
  out.gradient = block(p.gradient, kept) - follows.transpose() * block(p.gradient, open);
  out.at = block(p.at, kept);
  out.start = block(p.start, kept);
  for (const int i : kept) out.group.push_back(p.group[i]);
  out.groups = p.groups;
  out.known = p.known;
  out.alike = p.alike;
  return out;
}

/// K^-1, by group.
MatrixXd hyperprior_precision(const WidthProblem& p) {
  const auto kind = [&](int k) {
    return k < static_cast<int>(p.alike.size()) && p.learns(k) ? p.alike[k] : -1;
  };
  MatrixXd out = MatrixXd::Zero(p.groups, p.groups);
  for (int k = 0; k < p.groups; ++k) {
    std::vector<int> alike;
    for (int j = 0; j < p.groups; ++j)
      if (j == k || (kind(k) >= 0 && kind(j) == kind(k))) alike.push_back(j);
    // K is (ln 3)^2 / 2 (1 + 11') among them.
    for (const int j : alike)
      out(k, j) = 2 / (kWidthSpread * kWidthSpread) *
                  ((j == k ? 1 : 0) - 1 / (1 + static_cast<double>(alike.size())));
  }
  return out;
}

/// By group: the sum of x_i^2 / t_i^2.
VectorXd squares_of(const WidthProblem& p, const VectorXd& value, const VectorXd& precision) {
  VectorXd out = VectorXd::Zero(p.groups);
  for (Eigen::Index i = 0; i < precision.size(); ++i)
    if (p.group[i] >= 0) out(p.group[i]) += value(i) * value(i) * precision(i);
  return out;
}

/// A, by group.
VectorXd curvature(const VectorXd& squares, const VectorXd& gamma) {
  return 2 * squares.cwiseMax(gamma);
}

}  // namespace

Posterior posterior(const WidthProblem& p, const VectorXd& factor, bool covariance) {
  Posterior out;
  const VectorXd prior = precision(p, factor), b = p.gradient + prior.cwiseProduct(p.at);
  MatrixXd h = p.normal;
  h.diagonal() += prior;
  if (!(h.diagonal().minCoeff() > 0)) return out;
  const VectorXd scale = h.diagonal().cwiseSqrt().cwiseInverse();
  const Cholesky factorised(scale.asDiagonal() * h * scale.asDiagonal());
  if (!factorised.good() || !(factorised.diagonal().minCoeff() > kSmallestPivot)) return out;
  const MatrixXd root = factorised.inverse_factor() * scale.asDiagonal();  // C = root' root
  out.defined = root.allFinite();
  out.value = -(root.transpose() * (root * b));
  for (Eigen::Index i = 0; i < prior.size(); ++i)
    if (prior(i) > 0) out.value(i) += p.at(i);
  out.variance = root.colwise().squaredNorm();
  out.log_determinant = 2 * (scale.array().log().sum() - factorised.diagonal().array().log().sum());
  if (covariance) out.covariance = gram(root);
  return out;
}

Widths learn_widths(const WidthProblem& p, VectorXd factor, int rounds) {
  Widths out;
  out.gamma.setZero(p.groups);
  const WidthProblem members = without_open(p);
  const MatrixXd hyperprior = hyperprior_precision(p);
  for (;; ++out.rounds) {
    out.factor = factor;
    const Posterior at = posterior(members, factor, false);
    if (!at.defined) return out;
    const VectorXd prior = precision(members, factor);
    const VectorXd squares = squares_of(members, at.value, prior);
    out.gamma.setZero();
    for (Eigen::Index i = 0; i < prior.size(); ++i)
      if (members.group[i] >= 0) out.gamma(members.group[i]) += 1 - at.variance(i) * prior(i);
    VectorXd slope = squares - out.gamma - hyperprior * factor.array().log().matrix();
    for (int k = 0; k < p.groups; ++k)
      if (!p.learns(k)) slope(k) = 0;  // (which is alike with none)
    MatrixXd h = hyperprior;
    h.diagonal() += curvature(squares, out.gamma);
    const VectorXd step =
        VectorXd(solve_symmetric(h, slope)).cwiseMax(-kLargestStep).cwiseMin(kLargestStep);
    factor = factor.cwiseProduct(step.array().exp().matrix());
    const double largest = p.groups > 0 ? step.cwiseAbs().maxCoeff() : 0;
    if (largest < kSmallestStep || out.rounds >= rounds) break;
  }
  out.posterior = posterior(p, out.factor, true);
  out.defined = out.posterior.defined;
  return out;
}

double log_evidence(const WidthProblem& p, const VectorXd& factor) {
  const Posterior at = posterior(p, factor, false);
  if (!at.defined) return std::nan("");
  const VectorXd prior = precision(p, factor);
  VectorXd step = at.value;
  double log_priors = 0, from_priors = 0;
  for (Eigen::Index i = 0; i < prior.size(); ++i) {
    if (prior(i) == 0) continue;
    step(i) -= p.at(i);
    log_priors += std::log(prior(i));
    from_priors += prior(i) * at.value(i) * at.value(i);
  }
  return 0.5 * (log_priors + at.log_determinant - from_priors - step.dot(p.normal * step)) -
         p.gradient.dot(step);
}

double log_hyperprior(const WidthProblem& p, const VectorXd& factor) {
  const VectorXd u = factor.array().log();
  return -0.5 * u.dot(hyperprior_precision(p) * u);
}

double covering_variance(const VectorXd& variance, const VectorXd& weight) {
  double low = std::sqrt(variance.minCoeff()), high = std::sqrt(variance.maxCoeff());
  for (int i = 0; i < 40; ++i) {
    const double s = 0.5 * (low + high);
    double beyond = 0;
    for (Eigen::Index j = 0; j < variance.size(); ++j)
      if (variance(j) > 0)
        beyond += weight(j) * 2 * normal_tail(kCovered * s / std::sqrt(variance(j)));
    (beyond > kBeyond * weight.sum() ? low : high) = s;
  }
  return high * high;
}

MatrixXd covering(const MatrixXd& own, const MatrixXd& other, double probability) {
  // In the principal directions of one relative to their sum, scaled: own a, other 1 - a.
  const VectorXd scale =
      (own + other).diagonal().unaryExpr([](double v) { return v > 0 ? 1 / std::sqrt(v) : 0.0; });
  const SymmetricEigen sum =
      symmetric_eigen(scale.asDiagonal() * (own + other) * scale.asDiagonal());
  const VectorXd root = sum.values.cwiseMax(0).cwiseSqrt();
  const VectorXd inverse = root.unaryExpr(
      [&](double v) { return v > kSmallestDirection * root.maxCoeff() ? 1 / v : 0.0; });
  const MatrixXd whiten = inverse.asDiagonal() * sum.vectors.transpose() * scale.asDiagonal();
  const SymmetricEigen e = symmetric_eigen(whiten * own * whiten.transpose());
  VectorXd weight(2), s(e.values.size());
  weight << 1 - probability, probability;
  for (Eigen::Index i = 0; i < s.size(); ++i) {
    const double a = std::clamp(e.values(i), 0.0, 1.0);
    s(i) = std::sqrt(covering_variance(Eigen::Vector2d(a, 1 - a), weight));
  }
  const VectorXd unscale = scale.unaryExpr([](double v) { return v > 0 ? 1 / v : 0.0; });
  return gram((unscale.asDiagonal() * sum.vectors * root.asDiagonal() * e.vectors * s.asDiagonal())
                  .transpose());
}

void cover_change(const VectorXd& moved, double probability, MatrixXd& covariance) {
  MatrixXd other = covariance;
  other.topLeftCorner(moved.size(), moved.size()) += moved * moved.transpose();
  covariance = covering(covariance, other, probability);
}

/// The hyperprior of each group's u, given the evidence of the others: normal.
struct ByOthers {
  VectorXd mean, variance;
};

ByOthers by_others(const WidthProblem& p, const Widths& widths) {
  const MatrixXd hyperprior = hyperprior_precision(p);
  const VectorXd u = widths.factor.array().log(),
                 squares = squares_of(p, widths.posterior.value, precision(p, widths.factor)),
                 a = curvature(squares, widths.gamma),
                 pull = a.cwiseProduct(u) + squares - widths.gamma;
  ByOthers out{VectorXd(p.groups), VectorXd(p.groups)};
  for (int k = 0; k < p.groups; ++k) {
    MatrixXd h = hyperprior;
    h.diagonal() += a;
    h(k, k) -= a(k);
    const VectorXd row = solve_symmetric(h, MatrixXd(VectorXd::Unit(p.groups, k)));
    out.variance(k) = row(k);
    out.mean(k) = row.dot(pull) - row(k) * pull(k);
  }
  return out;
}

/// What the widths of one group may be besides the best, weighed by evidence and hyperprior (see
/// the header).
struct OtherWidths {
  MatrixXd second_moment;  // that wider ones add
  double inflation = 1;    // of the squared width of what the data do not tell
  double average = 1;      // of the evidence over all widths (kAnyWidth), against that at the best
};

OtherWidths other_widths(const WidthProblem& p, const Widths& widths, const ByOthers& expected,
                         int group) {
  OtherWidths out;
  const MatrixXd& c = widths.posterior.covariance;
  out.second_moment = MatrixXd::Zero(c.rows(), c.cols());
  if (!p.learns(group)) return out;
  const std::vector<int> members = members_of(p, group);
  std::vector<int> all(p.group.size());
  for (size_t i = 0; i < all.size(); ++i) all[i] = static_cast<int>(i);
  const VectorXd root = block(precision(p, widths.factor), members).cwiseSqrt();
  // In units of the best widths: the shares of the group's directions that are prior.
  SymmetricEigen e{VectorXd(0), MatrixXd(0, 0)};
  if (!members.empty())
    e = symmetric_eigen(root.asDiagonal() * block(c, members, members) * root.asDiagonal());
  const VectorXd prior = e.values.cwiseMin(1.0),
                 y = e.vectors.transpose() *
                     root.cwiseProduct(block(widths.posterior.value, members)),
                 square = y.cwiseAbs2();
  // With widths f times the best H loses d = 1 - 1 / f^2 of each direction's prior.
  const VectorXd by = VectorXd::LinSpaced(2 * kGrid + 1, -kLargestWidth * kWidthSpread,
                                          kLargestWidth * kWidthSpread),
                 f2 = (2 * by).array().exp(), d = 1 - f2.array().inverse();
  const double best = std::log(widths.factor(group));
  // The log evidence with widths exp(b) times the best, against that.
  const double share = p.is_apart(group) ? kNominal / (1 + kNominal) : 0;
  const VectorXd nominal = (-square.array() / (2 * prior.array())).exp() / prior.array().sqrt();
  const auto log_evidence = [&](double b) {
    const double gone = 1 - std::exp(-2 * b);
    const Eigen::ArrayXd left = 1 - gone * prior.array(),
                         own = (gone * square.array() / (2 * left) - b).exp() / left.sqrt();
    return ((1 - share) * own + share * nominal.array()).log().sum();
  };
  VectorXd weight(by.size());  // 1 at the best widths
  const double from = best - expected.mean(group);
  for (Eigen::Index i = 0; i < by.size(); ++i)
    weight(i) =
        std::exp(log_evidence(by(i)) - by(i) * (2 * from + by(i)) / (2 * expected.variance(group)));
  const VectorXd u = VectorXd::LinSpaced(8 * kGrid + 1, -4 * kAnyWidth, 4 * kAnyWidth);
  VectorXd wide = (-u.array().square() / (2 * kAnyWidth * kAnyWidth)).exp();
  wide /= wide.sum();
  out.average = 0;
  for (Eigen::Index i = 0; i < u.size(); ++i)
    out.average += wide(i) * std::exp(log_evidence(u(i) - best));
  out.inflation = std::max(1.0, covering_variance(f2, weight));
  const MatrixXd gain = block(c, all, members) * root.asDiagonal() * e.vectors;
  const VectorXd wider = weight.array() * (d.array() > 0).cast<double>() / weight.sum();
  MatrixXd moment = MatrixXd::Zero(prior.size(), prior.size());
  for (Eigen::Index k = 0; k < prior.size(); ++k) {
    const VectorXd variance = (1 - prior(k) * d.array()).inverse();  // over that at the best
    const double mean = (wider.array() * (variance.array() - 1)).sum();
    const double bound = covering_variance(variance, weight) - 1;
    moment(k, k) = prior(k) > kResolved ? std::max(mean, bound) / prior(k)
                                        : (wider.array() * d.array() * variance.array()).sum();
  }
  for (Eigen::Index i = 0; i < by.size(); ++i) {
    const VectorXd moved = d(i) * y.array() / (1 - d(i) * prior.array());
    moment += wider(i) * moved * moved.transpose();
  }
  out.second_moment = gain * moment * gain.transpose();
  return out;
}

/// The gain of a group with these members, of which value, covariance and 1 / t_i^2 are given.
double gain_of(const std::vector<int>& members, const VectorXd& value, const MatrixXd& covariance,
               const VectorXd& prior) {
  const Scaled ckk(block(covariance, members, members));
  const VectorXd x = block(value, members);
  return 0.5 * (ckk.log_determinant() + block(prior, members).array().log().sum() +
                x.dot(ckk.solve(x).col(0)));
}

double evidence_gain(const WidthProblem& p, const Widths& widths, int group) {
  return gain_of(members_of(p, group), widths.posterior.value, widths.posterior.covariance,
                 precision(p, widths.factor));
}

Selection hold(const WidthProblem& p, const Widths& widths) {
  Selection out;
  out.held.assign(p.start.size(), 0);
  out.whole.assign(p.groups, 0);
  out.gain.setZero(p.groups);
  out.probability.setOnes(p.groups);
  VectorXd value = widths.posterior.value;
  MatrixXd c = widths.posterior.covariance;
  MatrixXd added = MatrixXd::Zero(c.rows(), c.cols());
  const auto put_to_0 = [&](const std::vector<int>& numbers, double probability) {
    for (int i : numbers) out.held[i] = 1;
    MatrixXd before = c;
    const VectorXd moved = condition(numbers, value, c);
    added += probability * (before - c + moved * moved.transpose());
  };
  const VectorXd prior = precision(p, widths.factor);
  std::vector<OtherWidths> others;
  const ByOthers expected = by_others(p, widths);
  for (int k = 0; k < p.groups; ++k) others.push_back(other_widths(p, widths, expected, k));
  const auto told = [&](int k) {
    return widths.gamma(k) >= kDetermined * static_cast<double>(members_of(p, k).size());
  };
  for (;;) {
    int least = -1;
    for (int k = 0; k < p.groups; ++k) {
      if (out.whole[k]) continue;
      out.gain(k) = gain_of(members_of(p, k), value, c, prior);
      if (p.learns(k) && (least < 0 || out.gain(k) < out.gain(least))) least = k;
    }
    if (least < 0 || !(out.gain(least) < kEvidence)) break;
    out.whole[least] = 1;
    if (told(least) && !p.is_apart(least))
      out.probability(least) =
          1 / (1 + kNominal * std::exp(-out.gain(least)) / others[least].average);
    put_to_0(members_of(p, least), out.probability(least));
  }
  out.inflation.setOnes(p.groups);
  for (int k = 0; k < p.groups; ++k) {
    out.inflation(k) = others[k].inflation;
    added += out.probability(k) * others[k].second_moment;
  }
  std::vector<int> blind;
  for (int i = 0; i < prior.size(); ++i)
    if (p.group[i] >= 0 && !out.held[i] && 1 - c(i, i) * prior(i) < kDetermined) blind.push_back(i);
  if (!blind.empty()) put_to_0(blind, 1);
  out.second_moment = c + added;
  return out;
}

}  // namespace kincal
