#include "linear_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../../solver/decompositions.h"
#include "../../solver/kernels.h"

namespace kincal {
namespace {

const double kFactorSpread = std::log(3.0);  // of u: a stated sigma is a guess
const double kLeastLogFactor = std::log(kLeastFactor);
constexpr double kLongestStep = 1.5;     // in u
constexpr double kSettledGain = 0.01;    // of log evidence: odds of one percent
constexpr double kLeastCurvature = 0.1;  // of F, to step by
constexpr int kMostSteps = 50;
constexpr double kSameMode = 0.7;  // in u: from so near the same one is found

/// The log determinant of S^-1 L L' S^-1, by the diagonals of L and S.
double log_determinant(const VectorXd& factor, const VectorXd& scale) {
  return 2 * (factor.array().log().sum() - scale.array().log().sum());
}

/// A group at some factors u, without its private unknowns.
struct EliminatedGroup {
  const LinearModel::Group* group = nullptr;
  MatrixXd left;           // [J r] over s_k; then zeros, as the kernels want them
  MatrixXd basis;          // U, orthonormal, of the private columns over s_k
  double log_private = 0;  // log determinant of their block of H

  EliminatedGroup(const LinearModel::Group& of, const VectorXd& u) : group(&of) {
    const Eigen::Index p = of.private_size;
    MatrixXd rows = of.rows;
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
      if (of.kind[i] >= 0) rows.row(i) *= std::exp(-u(of.kind[i]));
    left = MatrixXd::Zero(padded(static_cast<int>(rows.rows())) + kSlack, rows.cols() - p);
    auto used = left.topRows(rows.rows());
    used = rows.rightCols(rows.cols() - p);
    if (p == 0) return;
    const MatrixXd block = rows.leftCols(p);
    const VectorXd scale = block.colwise().norm().cwiseInverse();
    log_private = log_determinant(
        Cholesky(scale.asDiagonal() * (block.transpose() * block) * scale.asDiagonal()).diagonal(),
        scale);
    basis = range_of(block);
    used -= basis * (basis.transpose() * used).eval();
  }
};

/// Factorises the lower triangle of `a`, with kSlack rows behind; false: it is not positive
/// definite. The diagonal is inverted then.
bool factorise(MatrixXd& a) {
  return kernels().cholesky(a.data(), static_cast<int>(a.cols()), static_cast<int>(a.rows()));
}
/// Replaces right' by L^-1 right', of such a factor L, strip by strip; `right` has kSlack rows more
/// than it uses.
void solve_transposed(const MatrixXd& factor, MatrixXd& right) {
  const Eigen::Index n = factor.cols(), ld = factor.rows();
  const int rows = static_cast<int>(right.rows()) - kSlack, stride = static_cast<int>(right.rows());
  MatrixXd product(right.rows(), std::max<Eigen::Index>(0, n - kStrip));
  for (Eigen::Index first = 0; first < n; first += kStrip) {
    const Eigen::Index strip = std::min<Eigen::Index>(kStrip, n - first), next = first + strip;
    kernels().solve_rows(factor.data() + first * (ld + 1), static_cast<int>(strip),
                         static_cast<int>(ld), right.col(first).data(), rows, stride);
    if (next == n) break;
    kernels().multiply(factor.data() + next + first * ld, 1, ld, static_cast<int>(n - next),
                       static_cast<int>(strip), right.col(first).data(), stride, rows,
                       product.data(), stride);
    right.rightCols(n - next) -= product.leftCols(n - next);
  }
}

/// Log evidence for given factors, with its slope by u and the average information A.
struct AtFactors {
  double log = std::numeric_limits<double>::quiet_NaN();
  VectorXd step, slope, fitted;
  MatrixXd information;
};

/// H and g, with the groups that they are summed from.
struct Summed {
  MatrixXd h;  // its lower triangle, with kSlack rows behind
  VectorXd g;
  double log_private = 0;
  std::vector<EliminatedGroup> groups;
};

Summed sum_up(const LinearModel& model, const VectorXd& u) {
  const Eigen::Index n = model.pull.size();
  Summed out{MatrixXd::Zero(n + kSlack, n), model.pull, 0, {}};
  MatrixXd& h = out.h;
  VectorXd& g = out.g;
  h.topRows(n) = model.prior;
  for (const LinearModel::Group& of : model.groups) {
    const EliminatedGroup& group = out.groups.emplace_back(of, u);
    out.log_private += group.log_private;
    const auto m = static_cast<Eigen::Index>(of.columns.size());
    MatrixXd gram(m + 1, m + 1);
    kernels().gram(group.left.data(), static_cast<int>(group.left.rows()) - kSlack,
                   group.left.rows(), static_cast<int>(m + 1), gram.data(),
                   static_cast<int>(m + 1));
    for (Eigen::Index i = 0; i < m; ++i) {
      g(of.columns[i]) += gram(m, i);
      for (Eigen::Index j = i; j < m; ++j) {
        const auto [low, high] = std::minmax(of.columns[i], of.columns[j]);
        h(high, low) += gram(j, i);
      }
    }
  }
  return out;
}

AtFactors evaluate(const LinearModel& model, const VectorXd& u) {
  AtFactors out;
  const Eigen::Index factors = u.size(), n = model.pull.size();
  auto [h, g, log_private, groups] = sum_up(model, u);
  if (n > 0 && !(h.diagonal().minCoeff() > 0)) return out;
  const VectorXd scale = h.diagonal().cwiseSqrt().cwiseInverse();
  h.topRows(n) = scale.asDiagonal() * h.topRows(n) * scale.asDiagonal();
  if (!factorise(h) || !std::isfinite(log_private)) return out;
  VectorXd solved = VectorXd::Zero(n + kSlack);
  solved.head(n) = -scale.cwiseProduct(g);
  kernels().solve_lower(h.data(), static_cast<int>(n), static_cast<int>(h.rows()), solved.data());
  kernels().solve_lower_transposed(h.data(), static_cast<int>(n), static_cast<int>(h.rows()),
                                   solved.data());
  out.step = scale.cwiseProduct(solved.head(n));
  double cost =
      model.prior_cost + 2 * model.pull.dot(out.step) + out.step.dot(model.prior * out.step);
  out.fitted = VectorXd::Zero(factors);
  out.information = MatrixXd::Zero(factors, factors);
  VectorXd squares = VectorXd::Zero(factors);
  MatrixXd pulls = MatrixXd::Zero(n, factors);
  for (const EliminatedGroup& group : groups) {
    const std::vector<int>& columns = group.group->columns;
    const auto m = static_cast<Eigen::Index>(columns.size());
    VectorXd at(m + 1);
    MatrixXd through = MatrixXd::Zero(group.left.rows(), n);  // J, then L^-1 S J'
    for (Eigen::Index i = 0; i < m; ++i) {
      at(i) = out.step(columns[i]);
      through.col(columns[i]) = scale(columns[i]) * group.left.col(i);
    }
    solve_transposed(h, through);
    at(m) = 1;
    const VectorXd e = group.left.topRows(group.group->rows.rows()) * at;
    cost += e.squaredNorm();
    MatrixXd pulled = MatrixXd::Zero(group.basis.cols(), factors);
    for (Eigen::Index i = 0; i < e.size(); ++i) {
      const int k = group.group->kind[i];
      if (k < 0) continue;
      squares(k) += e(i) * e(i);
      out.fitted(k) += through.row(i).squaredNorm();
      for (Eigen::Index j = 0; j < m; ++j) pulls(columns[j], k) += e(i) * group.left(i, j);
      if (group.basis.cols() == 0) continue;
      out.fitted(k) += group.basis.row(i).squaredNorm();
      pulled.col(k) += e(i) * group.basis.row(i).transpose();
    }
    out.information -= 2 * pulled.transpose() * pulled;
  }
  const double spread = 1 / (kFactorSpread * kFactorSpread);
  out.slope = squares - model.numbers + out.fitted - spread * u;
  MatrixXd pulled = MatrixXd::Zero(padded(static_cast<int>(factors)) + kSlack, n);
  pulled.topRows(factors) = (scale.asDiagonal() * pulls).transpose();
  solve_transposed(h, pulled);
  out.information -= 2 * (pulled * pulled.transpose()).topLeftCorner(factors, factors);
  out.information.diagonal() += 2 * squares + VectorXd::Constant(factors, spread);
  out.log = model.log_private_prior - model.width.array().log().sum() - model.numbers.dot(u) -
            spread * u.squaredNorm() / 2 - cost / 2 - log_private / 2 -
            log_determinant(h.diagonal().cwiseInverse(), scale) / 2;
  return out;
}

/// The evidence of the mode of F that lies uphill of u.
LinearEvidence evidence_from(const LinearModel& model, VectorXd u) {
  const Eigen::Index factors = u.size();
  LinearEvidence out;
  out.log = std::numeric_limits<double>::quiet_NaN();
  VectorXd best = u, move = VectorXd::Zero(factors);
  double highest = -std::numeric_limits<double>::infinity();
  for (int round = 0; round < kMostSteps; ++round) {
    const AtFactors at = evaluate(model, u);
    const bool higher = at.log > highest - kSettledGain;
    if (!higher) {  // too far; NaN is no way either
      move /= 4;
      u = (best + move).cwiseMax(kLeastLogFactor);
      continue;
    }
    const bool settled = at.log - highest < kSettledGain;
    best = u;
    highest = std::max(highest, at.log);
    // Factors at their least stay there if that is downhill.
    MatrixXd a = at.information;
    VectorXd slope = at.slope;
    for (Eigen::Index k = 0; k < factors; ++k) {
      if (u(k) > kLeastLogFactor || slope(k) > 0) continue;
      slope(k) = 0;
      a.row(k).setZero();
      a.col(k).setZero();
      a(k, k) = 1 / (kFactorSpread * kFactorSpread);
    }
    SymmetricEigen e{VectorXd(0), MatrixXd(0, 0)};
    if (factors > 0) e = symmetric_eigen(a);
    const VectorXd size = e.values.cwiseMax(kLeastCurvature);
    move = e.vectors * (e.vectors.transpose() * slope).cwiseQuotient(size);
    out.log = at.log - static_cast<double>(factors) * std::log(kFactorSpread) -
              size.array().log().sum() / 2;
    out.factor = u.array().exp();
    out.fitted = at.fitted;
    out.step = at.step;
    if (settled || slope.dot(move) < kSettledGain) break;
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
  if (factors > 0 && std::abs(common) > kSameMode)
    starts.push_back(VectorXd::Constant(factors, common));
  if (start.size() == factors) starts.push_back(start.array().log());
  LinearEvidence out;
  out.log = std::numeric_limits<double>::quiet_NaN();
  for (const VectorXd& u : starts) {
    LinearEvidence one = evidence_from(model, u);
    if (!(one.log <= out.log) && std::isfinite(one.log)) out = std::move(one);
  }
  return out;
}

double log_evidence_at(const LinearModel& model, const VectorXd& factor) {
  return evaluate(model, factor.array().log()).log;
}

MatrixXd covariance_at(const LinearModel& model, const VectorXd& factor) {
  const MatrixXd lower = sum_up(model, factor.array().log()).h.topRows(model.pull.size());
  const MatrixXd h = lower.selfadjointView<Eigen::Lower>();
  if (!(h.diagonal().minCoeff() > 0)) return {};
  const VectorXd scale = h.diagonal().cwiseSqrt().cwiseInverse();
  const Cholesky root(scale.asDiagonal() * h * scale.asDiagonal());
  return root.good() ? gram(root.inverse_factor() * scale.asDiagonal()) : MatrixXd();
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
