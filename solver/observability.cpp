#include "observability.h"

#include <algorithm>
#include <cmath>

#include "decompositions.h"
#include "kernels.h"

namespace kincal {
namespace {

constexpr double kDeadColumn = 1e-14;  // squared norm left by the elimination, relative
constexpr double kNullEigenvalue = 1e-9;
constexpr double kHeld = 1e-13;  // singular value of priors above which they are no rounding
constexpr Eigen::Index kKept = 32 * 1024 * 1024 / sizeof(double);  // numbers of reduced rows

/// Reduced echelon form of the columns of `basis` with complete pivoting, each scaled to unit
/// length.
void separate(MatrixXd& basis) {
  const Eigen::Index k = basis.cols();
  for (Eigen::Index step = 0; step < k; ++step) {
    Eigen::Index row, column;
    basis.rightCols(k - step).cwiseAbs().maxCoeff(&row, &column);
    basis.col(step).swap(basis.col(step + column));
    basis.col(step) /= basis(row, step);
    for (Eigen::Index j = 0; j < k; ++j)
      if (j != step) basis.col(j) -= basis(row, j) * basis.col(step).eval();
  }
  for (Eigen::Index j = 0; j < k; ++j) basis.col(j).normalize();
}

/// What all groups say of the shared unknowns when their own are eliminated.
struct Remainder {
  MatrixXd data;          // R with R'R = S of all groups but the priors', at least one row
  MatrixXd priors;        // the rows of that group
  VectorXd squared_norm;  // of the data's columns before the elimination
};

/// The remainders of all groups, stacked and compressed whenever the stack is full. Counts rows and
/// private rank.
Remainder remainder_of(const Problem& problem, const VectorXd& state, Observability& out,
                       std::vector<MatrixXd>* kept, const Progress& progress) {
  const int n = problem.shared_size();
  Remainder to;
  to.priors.setZero(0, n);
  to.squared_norm.setZero(n);
  MatrixXd stack = MatrixXd::Zero(padded(std::max(3 * n, 512)), n), rows;
  Eigen::Index used = 0, numbers = 0;
  const auto keep = [&](MatrixXd& left) {
    numbers += left.size();
    if (kept && numbers <= kKept) kept->push_back(std::move(left));
  };
  const auto compress = [&] {
    if (used <= n) return;
    const int filled = padded(static_cast<int>(used));
    stack.middleRows(used, filled - used).setZero();
    kernels().triangularise(stack.data(), filled, n, n, stack.rows());
    for (int i = 0; i < n; ++i) stack.col(i).segment(i + 1, used - i - 1).setZero();
    used = n;
  };
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    if (g % kGroupsTold == 0)
      progress.share(static_cast<double>(g), static_cast<double>(problem.groups().size()));
    problem.square_root(static_cast<int>(g), state, 0, rows);
    const int k = shape.private_size, m = static_cast<int>(shape.columns.size());
    out.rows += shape.rows;
    if (static_cast<int>(g) == problem.prior_group()) {
      out.prior_rows = shape.rows;
      out.prior_chi2 = rows.col(m).squaredNorm();
      to.priors.setZero(rows.rows(), n);
      for (int i = 0; i < m; ++i) to.priors.col(shape.columns[i]) = rows.col(i);
      keep(rows);
      continue;
    }
    for (int i = 0; i < m; ++i) to.squared_norm(shape.columns[i]) += rows.col(k + i).squaredNorm();
    MatrixXd left = eliminate(std::move(rows), k, out.rank);
    for (Eigen::Index r = 0, taken; r < left.rows() && m > 0; r += taken, used += taken) {
      if (used == stack.rows()) compress();
      taken = std::min(left.rows() - r, stack.rows() - used);
      stack.middleRows(used, taken).setZero();
      for (int i = 0; i < m; ++i)
        stack.col(shape.columns[i]).segment(used, taken) = left.col(i).segment(r, taken);
    }
    keep(left);
  }
  progress.share(1);
  compress();
  to.data = stack.topRows(std::max<Eigen::Index>(used, 1));
  if (used == 0) to.data.setZero();
  return to;
}

/// 1 / norm of each column of data and priors together; 0: dead. Of what is rounding in the data
/// nothing is left.
VectorXd unit_scale(Remainder& left) {
  VectorXd scale(left.data.cols());
  for (Eigen::Index i = 0; i < scale.size(); ++i) {
    const double data = left.data.col(i).norm();
    if (data * data <= kDeadColumn * left.squared_norm(i)) left.data.col(i).setZero();
    const double norm = std::hypot(left.data.col(i).norm(), left.priors.col(i).norm());
    scale(i) = norm == 0 ? 0 : 1 / norm;
  }
  return scale;
}

/// Adds a direction to the covariance: a unit vector of the scaled columns and its singular value.
void add_determined(const VectorXd& v, double value, const VectorXd& scale, Eigen::Index place,
                    Observability& out) {
  const VectorXd scaled = v.cwiseProduct(scale);
  out.covariance.noalias() += scaled / (value * value) * scaled.transpose();
  out.root.col(place) = scaled / value;
  ++out.rank;
}

/// Adds those of the candidates (orthonormal columns) that the priors hold to the covariance, from
/// `place` of the root on; returns the others. `r`: data and priors, columns scaled.
MatrixXd hold_by_priors(const MatrixXd& candidates, const MatrixXd& r, const Remainder& left,
                        const VectorXd& scale, double largest, Observability& out) {
  const Eigen::Index k = candidates.cols(), p = left.priors.rows();
  if (k == 0 || p == 0) return candidates;
  const SingularValues said = singular_values(r.bottomRows(p) * candidates, Eigen::ComputeFullV);
  const MatrixXd turned = candidates * said.v;
  const VectorXd before = left.squared_norm.cwiseSqrt().cwiseProduct(scale);
  const auto limit = [&](Eigen::Index j) {
    return kHeld * std::max(largest, before.cwiseProduct(turned.col(j)).norm());
  };
  Eigen::Index held = 0;
  while (held < said.values.size() && said.values(held) > limit(held)) ++held;
  if (held == 0) return candidates;
  const SingularValues own = singular_values(r * turned.leftCols(held), Eigen::ComputeThinV);
  const MatrixXd directions = turned.leftCols(held) * own.v;
  const Eigen::Index place = scale.size() - k;
  for (Eigen::Index j = 0; j < held; ++j)
    add_determined(directions.col(j), own.values(j), scale, place + j, out);
  return turned.rightCols(k - held);
}

/// Where the data alone certainly determine every direction no singular values are needed: of the
/// triangle R of data and priors, columns scaled, (R D)^-1 gives the root of the covariance. True:
/// that was so.
bool determine_all(const Remainder& left, const VectorXd& scale, Observability& out) {
  const Eigen::Index n = scale.size(), data = left.data.rows(), p = left.priors.rows();
  if (data + p < n) return false;
  const int rows = padded(static_cast<int>(data + p)), columns = static_cast<int>(n);
  MatrixXd r = MatrixXd::Zero(rows, n), inverse;
  r.topRows(data) = left.data * scale.asDiagonal();
  r.middleRows(data, p) = left.priors * scale.asDiagonal();
  kernels().triangularise(r.data(), rows, columns, columns, rows);
  if (!inverse_of_triangle(r, 1 / std::sqrt(kNullEigenvalue), inverse)) return false;
  out.root = scale.asDiagonal() * inverse;
  out.covariance.noalias() = out.root * out.root.transpose();
  out.rank += n;
  out.decided_by_priors = (left.priors * out.root).squaredNorm();
  return true;
}

void add_null(Observability& out, const VectorXd& direction) {
  out.null_space.conservativeResize(Eigen::NoChange, out.null_space.cols() + 1);
  out.null_space.rightCols<1>() = direction;
}

/// The directions of `space` (orthonormal columns) that are orthogonal to the dead columns (scale
/// 0).
void add_gauges(MatrixXd space, int gauges, const VectorXd& scale, Observability& out) {
  const Eigen::Index n = scale.size();
  for (int i = 0; i < n; ++i)
    if (scale(i) == 0) space.row(i).setZero();
  MatrixXd basis = singular_values(space, Eigen::ComputeThinU).u.leftCols(gauges);
  separate(basis);
  // What is rounding in the rows turns a direction by that much towards the determined ones.
  const double turned = kHeld / std::sqrt(kNullEigenvalue);
  basis = (basis.array().abs() > turned).select(basis, 0.0);
  for (int j = 0; j < gauges; ++j) {
    Eigen::Index largest;
    basis.col(j).cwiseAbs().maxCoeff(&largest);
    std::vector<std::pair<int, double>> direction;
    for (int i = 0; i < n; ++i) {
      if (std::abs(basis(i, j)) > 1e-3) out.unobservable[i] = 1;
      if (std::abs(basis(i, j)) > 0.02)
        direction.push_back({i, basis(i, j) * scale(i) / (basis(largest, j) * scale(largest))});
    }
    out.directions.push_back(std::move(direction));
    add_null(out, basis.col(j).cwiseProduct(scale) / (basis(largest, j) * scale(largest)));
  }
}

}  // namespace

MatrixXd eliminate(MatrixXd rows, int private_size, long& rank) {
  if (private_size == 0) return rows;
  const Eigen::Index k = private_size, m = rows.cols() - k, count = std::max(rows.rows(), k);
  const int filled = padded(static_cast<int>(count)), columns = static_cast<int>(k + m);
  const bool shrinks = count > k + m;  // the others become a triangle as well
  rows.conservativeResizeLike(MatrixXd::Zero(filled, k + m));
  kernels().triangularise(rows.data(), filled, columns, shrinks ? columns : private_size, filled);
  const auto others = [&](Eigen::Index first) {  // below the private rows, from row `first` of left
    MatrixXd left = MatrixXd::Zero(first + (shrinks ? m : count - k), m);
    if (shrinks)
      left.bottomRows(m) = rows.block(k, k, m, m).triangularView<Eigen::Upper>();
    else
      left.bottomRows(count - k) = rows.block(k, k, count - k, m);
    return left;
  };
  if (is_of_full_rank(rows.topLeftCorner(k, k))) {
    rank += k;
    return others(0);
  }
  const Elimination own(rows.topLeftCorner(k, k).triangularView<Eigen::Upper>());
  rank += own.rank();
  MatrixXd left = others(k - own.rank());
  if (own.rank() < k) {  // what the private unknowns leave undetermined tells of the others
    MatrixXd upper = rows.topRightCorner(k, m);
    own.rotate(upper);
    left.topRows(k - own.rank()) = upper.bottomRows(k - own.rank());
  }
  return left;
}

MatrixXd reduced_rows(const Problem& problem, const VectorXd& state, size_t group) {
  MatrixXd rows;
  long rank = 0;
  problem.square_root(static_cast<int>(group), state, 0, rows);
  return eliminate(std::move(rows), problem.groups()[group].private_size, rank);
}

Observability observe(Problem& problem, const VectorXd& state, std::vector<MatrixXd>* kept,
                      const Progress& progress) {
  const int n = problem.shared_size();
  Observability out;
  problem.prepare(state);
  Remainder left = remainder_of(problem, state, out, kept, progress);
  out.covariance.setZero(n, n);
  out.root.setZero(n, n);
  out.unobservable.assign(n, 0);
  out.null_space.setZero(n, 0);
  if (n == 0) return out;
  const VectorXd scale = unit_scale(left);
  if (determine_all(left, scale, out)) return out;
  int dead = 0;
  for (int i = 0; i < n; ++i)
    if (scale(i) == 0) {
      ++dead;
      out.unobservable[i] = 1;
      out.directions.push_back({{i, 1.0}});
      add_null(out, VectorXd::Unit(n, i));
    }
  MatrixXd r(left.data.rows() + left.priors.rows(), n);
  r.topRows(left.data.rows()) = left.data * scale.asDiagonal();
  r.bottomRows(left.priors.rows()) = left.priors * scale.asDiagonal();
  const SingularValues svd = singular_values(r, Eigen::ComputeFullV);
  VectorXd eigenvalue = VectorXd::Zero(n);
  eigenvalue.head(svd.values.size()) = svd.values.cwiseAbs2();
  int determined = 0;
  while (determined < n && eigenvalue(determined) > kNullEigenvalue * eigenvalue(0)) {
    add_determined(svd.v.col(determined), svd.values(determined), scale, determined, out);
    ++determined;
  }
  const MatrixXd space =
      hold_by_priors(svd.v.rightCols(n - determined), r, left, scale, svd.values(0), out);
  // It contains a unit vector for every dead column; what is orthogonal to these are gauges.
  const int gauges = static_cast<int>(space.cols()) - dead;
  if (gauges > 0) add_gauges(space, gauges, scale, out);
  out.decided_by_priors = (left.priors * out.root).squaredNorm();
  return out;
}

}  // namespace kincal
