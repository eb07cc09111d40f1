#include "linear_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../../solver/decompositions.h"

namespace kincal {
namespace {

const double kFactorSpread = std::log(3.0);  // of u: a stated sigma is a guess
// Sensors are hardly ever 27 times better than stated; data without noise are, and then what is
// left of rounding is no evidence.
const double kLeastLogFactor = -3 * kFactorSpread;
constexpr double kLongestStep = 1.5;     // in u
constexpr double kSettledGain = 1e-7;    // of log evidence
constexpr double kLeastCurvature = 0.1;  // of F, to step by
constexpr int kMostSteps = 50;

double log_determinant(const Cholesky& factorised, const VectorXd& scale) {
  return 2 * (factorised.diagonal().array().log().sum() - scale.array().log().sum());
}

/// What is left when private unknowns are eliminated, at factors u.
struct ReducedData {
  std::vector<MatrixXd> gram;  // of [J r] over s_k, by kind; the last: noise that is known
  VectorXd spent;              // numbers of each kind that private unknowns take
  double log_private = 0;      // log determinant of their block of H
  MatrixXd curvature;          // what they add to A
};

/// What is known of the shared unknowns from the round before: where the minimum is, and a root of
/// their covariance, root'root.
struct SharedState {
  VectorXd step;
  MatrixXd root;
};

/// Adds one group. With U an orthonormal basis of its private columns, rows over s_k, B what these
/// leave of the shared ones times root', and e its residuals at the minimum, the private unknowns'
/// part of A is  2 [k = l] |U_k|^2 - 2 |U_k U_l'|^2 - 4 <U_k'B_k, U_l'B_l> - 4 e_k'U_k U_l'e_l.
void add_group(const LinearModel::Group& group, const VectorXd& u, const SharedState& shared,
               ReducedData& to) {
  const auto factors = u.size();
  const Eigen::Index p = group.private_size, m = group.rows.cols() - p;
  MatrixXd rows = group.rows;
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    if (group.kind[i] >= 0) rows.row(i) *= std::exp(-u(group.kind[i]));
  MatrixXd left = rows.rightCols(m);
  MatrixXd basis(rows.rows(), 0);
  if (p > 0) {
    const MatrixXd block = rows.leftCols(p);
    const VectorXd scale = block.colwise().norm().cwiseInverse();
    to.log_private += log_determinant(
        Cholesky(scale.asDiagonal() * (block.transpose() * block) * scale.asDiagonal()), scale);
    basis = range_of(block);
    left -= basis * (basis.transpose() * left);
  }
  VectorXd at(m);
  MatrixXd root(shared.root.rows(), m - 1);
  for (Eigen::Index i = 0; i + 1 < m; ++i) {
    at(i) = shared.step(group.columns[i]);
    root.col(i) = shared.root.col(group.columns[i]);
  }
  at(m - 1) = 1;
  // Rows of each kind together.
  std::vector<std::vector<Eigen::Index>> of_kind(factors + 1);
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    of_kind[group.kind[i] < 0 ? factors : group.kind[i]].push_back(i);
  std::vector<Eigen::Index> present;
  std::vector<MatrixXd> within(factors), across(factors);
  std::vector<VectorXd> pulled(factors);
  for (Eigen::Index k = 0; k <= factors; ++k) {
    if (of_kind[k].empty()) continue;
    const auto count = static_cast<Eigen::Index>(of_kind[k].size());
    MatrixXd own(count, m), of_basis(count, basis.cols());
    for (Eigen::Index i = 0; i < count; ++i) {
      own.row(i) = left.row(of_kind[k][i]);
      of_basis.row(i) = basis.row(of_kind[k][i]);
    }
    const MatrixXd gram = own.transpose() * own;
    for (Eigen::Index i = 0; i < m; ++i)
      for (Eigen::Index j = 0; j < m; ++j)
        to.gram[k](i + 1 < m ? group.columns[i] : to.gram[k].rows() - 1,
                   j + 1 < m ? group.columns[j] : to.gram[k].rows() - 1) += gram(i, j);
    if (k == factors || p == 0) continue;
    to.spent(k) += of_basis.squaredNorm();
    to.curvature(k, k) += 2 * of_basis.squaredNorm();
    within[k] = of_basis.transpose() * of_basis;
    across[k] = of_basis.transpose() * own.leftCols(m - 1) * root.transpose();
    pulled[k] = of_basis.transpose() * (own * at);
    present.push_back(k);
  }
  for (const Eigen::Index k : present)
    for (const Eigen::Index l : present)
      to.curvature(k, l) -= 2 * within[k].cwiseProduct(within[l]).sum() +
                            4 * across[k].cwiseProduct(across[l]).sum() +
                            4 * pulled[k].dot(pulled[l]);
}

ReducedData reduce(const LinearModel& model, const VectorXd& u, const SharedState& shared) {
  const Eigen::Index factors = u.size(), n = model.pull.size();
  ReducedData out{std::vector<MatrixXd>(factors + 1, MatrixXd::Zero(n + 1, n + 1)),
                  VectorXd::Zero(factors), 0, MatrixXd::Zero(factors, factors)};
  for (const LinearModel::Group& group : model.groups) add_group(group, u, shared, out);
  return out;
}

/// Log evidence for given factors, with its slope by u and minus its second derivative A.
struct AtFactors {
  double log = std::numeric_limits<double>::quiet_NaN();
  SharedState shared;
  VectorXd slope, fitted;
  MatrixXd curvature;
};

AtFactors evaluate(const LinearModel& model, const ReducedData& data, const VectorXd& u) {
  AtFactors out;
  const Eigen::Index factors = u.size(), n = model.pull.size();
  MatrixXd h = model.prior;
  VectorXd g = model.pull;
  for (const MatrixXd& gram : data.gram) {
    h += gram.topLeftCorner(n, n);
    g += gram.col(n).head(n);
  }
  if (n > 0 && !(h.diagonal().minCoeff() > 0)) return out;
  const VectorXd scale = h.diagonal().cwiseSqrt().cwiseInverse();
  const Cholesky factorised(scale.asDiagonal() * h * scale.asDiagonal());
  if (!factorised.good() || !std::isfinite(data.log_private)) return out;
  out.shared.root = factorised.inverse_factor() * scale.asDiagonal();
  const MatrixXd c = out.shared.root.transpose() * out.shared.root;
  const VectorXd step = -c * g;
  out.shared.step = step;
  VectorXd at(n + 1);
  at << step, 1;
  double cost = model.prior_cost + 2 * model.pull.dot(step) + step.dot(model.prior * step) +
                at.dot(data.gram[factors] * at);
  const double spread = 1 / (kFactorSpread * kFactorSpread);
  out.fitted = data.spent;
  out.slope.resize(factors);
  out.curvature = data.curvature;
  std::vector<MatrixXd> through;
  MatrixXd pulls(n, factors);
  for (Eigen::Index k = 0; k < factors; ++k) {
    const VectorXd pull = data.gram[k] * at;
    const double squares = at.dot(pull);
    cost += squares;
    through.push_back(c * data.gram[k].topLeftCorner(n, n));
    const double fitted = through.back().trace();
    out.fitted(k) += fitted;
    out.slope(k) = squares - model.numbers(k) + out.fitted(k) - u(k) * spread;
    out.curvature(k, k) += 2 * (fitted + squares) + spread;
    pulls.col(k) = pull.head(n);
    for (Eigen::Index l = 0; l <= k; ++l) {
      const double shared = 2 * through[k].cwiseProduct(through[l].transpose()).sum() +
                            4 * pulls.col(k).dot(c * pulls.col(l));
      out.curvature(k, l) -= shared;
      if (l < k) out.curvature(l, k) -= shared;
    }
  }
  out.log = model.log_private_prior - model.width.array().log().sum() - model.numbers.dot(u) -
            spread * u.squaredNorm() / 2 - cost / 2 - data.log_private / 2 -
            log_determinant(factorised, scale) / 2;
  return out;
}

/// The evidence of the mode of F that lies uphill of u.
LinearEvidence evidence_from(const LinearModel& model, VectorXd u) {
  const Eigen::Index factors = u.size(), n = model.pull.size();
  SharedState shared{VectorXd::Zero(n), MatrixXd(0, n)};
  LinearEvidence out;
  out.log = std::numeric_limits<double>::quiet_NaN();
  VectorXd best = u, move = VectorXd::Zero(factors);
  double highest = -std::numeric_limits<double>::infinity();
  for (int round = 0; round < kMostSteps; ++round) {
    const AtFactors at = evaluate(model, reduce(model, u, shared), u);
    const bool higher = at.log > highest - kSettledGain;
    if (!higher) {  // too far; NaN is no way either
      move /= 4;
      u = (best + move).cwiseMax(kLeastLogFactor);
      continue;
    }
    best = u;
    highest = at.log;
    shared = at.shared;
    // Factors at their least stay there if that is downhill.
    MatrixXd a = at.curvature;
    VectorXd slope = at.slope;
    for (Eigen::Index k = 0; k < factors; ++k) {
      if (u(k) > kLeastLogFactor || slope(k) > 0) continue;
      slope(k) = 0;
      a.row(k).setZero();
      a.col(k).setZero();
      a(k, k) = 1 / (kFactorSpread * kFactorSpread);
    }
    // Newton's step; where F is not concave along an eigenvector of A, uphill all the same.
    SymmetricEigen e{VectorXd(0), MatrixXd(0, 0)};
    if (factors > 0) e = symmetric_eigen(a);
    const VectorXd size = e.values.cwiseAbs().cwiseMax(kLeastCurvature);
    move = e.vectors * (e.vectors.transpose() * slope).cwiseQuotient(size);
    if (!(e.values.array() <= 0).any()) {
      out.log = at.log - static_cast<double>(factors) * std::log(kFactorSpread) -
                e.values.array().log().sum() / 2;
      out.factor = u.array().exp();
      out.fitted = at.fitted;
      out.step = shared.step;
      if (round > 0 && slope.dot(move) < kSettledGain) break;  // A is that of this round's root
    }
    const double longest = factors > 0 ? move.cwiseAbs().maxCoeff() : 0;
    if (longest > kLongestStep) move *= kLongestStep / longest;
    u = (u + move).cwiseMax(kLeastLogFactor);
  }
  return out;
}

}  // namespace

LinearEvidence evidence(const LinearModel& model, const VectorXd& start) {
  // Residuals that no noise explains may be put down to one sensor or another, to one joint or
  // another: F may have several modes. The highest is looked for.
  const Eigen::Index factors = model.numbers.size();
  double squares = 0;
  for (const LinearModel::Group& group : model.groups)
    squares += group.rows.rightCols(1).squaredNorm();
  const double common = std::max(kLeastLogFactor, std::log(squares / model.numbers.sum()) / 2);
  std::vector<VectorXd> starts = {VectorXd::Zero(factors)};
  if (factors > 0) starts.push_back(VectorXd::Constant(factors, common));
  if (start.size() == factors) starts.push_back(start.array().log());
  LinearEvidence out;
  out.log = std::numeric_limits<double>::quiet_NaN();
  for (const VectorXd& u : starts) {
    LinearEvidence one = evidence_from(model, u);
    if (!(one.log <= out.log) && std::isfinite(one.log)) out = std::move(one);
  }
  return out;
}

LinearModel with_unknowns(const LinearModel& model, const std::vector<int>& kept,
                          const MatrixXd& directions, const VectorXd& width) {
  const auto n = static_cast<Eigen::Index>(kept.size()), more = width.size(), all = n + more;
  LinearModel out;
  out.numbers = model.numbers;
  out.prior_cost = model.prior_cost;
  out.log_private_prior = model.log_private_prior;
  out.prior = MatrixXd::Zero(all, all);
  out.prior.diagonal().tail(more) = width.cwiseAbs2().cwiseInverse();
  out.pull = VectorXd::Zero(all);
  out.width.resize(all);
  out.width.tail(more) = width;
  std::vector<int> place(model.width.size(), -1);
  for (Eigen::Index i = 0; i < n; ++i) {
    place[kept[i]] = static_cast<int>(i);
    out.width(i) = model.width(kept[i]);
    out.pull(i) = model.pull(kept[i]);
    for (Eigen::Index j = 0; j < n; ++j) out.prior(i, j) = model.prior(kept[i], kept[j]);
  }
  for (const LinearModel::Group& group : model.groups) {
    LinearModel::Group to{group.private_size, {}, MatrixXd(group.rows.rows(), 0), group.kind};
    const Eigen::Index p = group.private_size;
    to.rows.resize(Eigen::NoChange, p + all + 1);
    to.rows.leftCols(p) = group.rows.leftCols(p);
    Eigen::Index used = p;
    MatrixXd moved = MatrixXd::Zero(group.rows.rows(), more);
    for (size_t i = 0; i < group.columns.size(); ++i) {
      const int column = group.columns[i];
      const VectorXd rows = group.rows.col(p + static_cast<Eigen::Index>(i));
      if (more > 0) moved += rows * directions.row(column);
      if (place[column] < 0) continue;
      to.columns.push_back(place[column]);
      to.rows.col(used++) = rows;
    }
    for (Eigen::Index g = 0; g < more; ++g) {
      if (moved.col(g).isZero(0)) continue;
      to.columns.push_back(static_cast<int>(n + g));
      to.rows.col(used++) = moved.col(g);
    }
    to.rows.col(used++) = group.rows.rightCols(1);
    to.rows.conservativeResize(Eigen::NoChange, used);
    out.groups.push_back(std::move(to));
  }
  return out;
}

}  // namespace kincal
