#include "observability.h"

#include <algorithm>
#include <cmath>

#include "decompositions.h"

namespace kincal {
namespace {

constexpr double kDeadColumn = 1e-14;  // squared norm left by the elimination, relative
constexpr double kNullEigenvalue = 1e-9;

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

/// R with R'R = S, at least one row: the remainders of all groups, stacked and compressed whenever
/// the stack is full. Counts rows and private rank; `squared_norm`: of the columns before the
/// elimination.
MatrixXd triangle_of(const Problem& problem, const VectorXd& state, Observability& out,
                     VectorXd& squared_norm, std::vector<MatrixXd>* reduced_rows) {
  const int n = problem.shared_size();
  MatrixXd stack = MatrixXd::Zero(std::max(3 * n, 64), n), rows;
  squared_norm.setZero(n);
  Eigen::Index used = 0;
  const auto compress = [&] {
    if (used <= n) return;
    Eigen::Ref<MatrixXd> filled(stack.topRows(used));
    triangularise(filled);
    for (int i = 0; i < n; ++i) stack.col(i).segment(i + 1, used - i - 1).setZero();
    used = n;
  };
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    problem.square_root(static_cast<int>(g), state, 0, rows);
    const int k = shape.private_size, m = static_cast<int>(shape.columns.size());
    out.rows += shape.rows;
    for (int i = 0; i < m; ++i) squared_norm(shape.columns[i]) += rows.col(k + i).squaredNorm();
    const MatrixXd left = eliminate(rows, k, out.rank);
    if (reduced_rows) reduced_rows->push_back(left);
    for (Eigen::Index r = 0; r < left.rows() && m > 0; ++r) {
      if (used == stack.rows()) compress();
      stack.row(used).setZero();
      for (int i = 0; i < m; ++i) stack(used, shape.columns[i]) = left(r, i);
      ++used;
    }
  }
  compress();
  MatrixXd r = stack.topRows(std::max<Eigen::Index>(used, 1));
  if (used == 0) r.setZero();
  return r;
}

void add_null(Observability& out, const VectorXd& direction) {
  out.null_space.conservativeResize(Eigen::NoChange, out.null_space.cols() + 1);
  out.null_space.rightCols<1>() = direction;
}

/// The directions among the right singular vectors `null` that are orthogonal to the dead columns
/// (scale 0).
void add_gauges(const MatrixXd& vectors, const std::vector<int>& null, int gauges,
                const VectorXd& scale, Observability& out) {
  const Eigen::Index n = scale.size();
  MatrixXd space(n, null.size());
  for (size_t j = 0; j < null.size(); ++j) space.col(j) = vectors.col(null[j]);
  for (int i = 0; i < n; ++i)
    if (scale(i) == 0) space.row(i).setZero();
  MatrixXd basis = singular_values(space, Eigen::ComputeThinU).u.leftCols(gauges);
  separate(basis);
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
  const Eigen::Index m = rows.cols() - private_size;
  if (private_size == 0) return rows;
  const Elimination own(rows.leftCols(private_size));
  rank += own.rank();
  MatrixXd shared = rows.middleCols(private_size, m);
  own.rotate(shared);
  return shared.bottomRows(shared.rows() - own.rank());
}

Observability observe(Problem& problem, const VectorXd& state,
                      std::vector<MatrixXd>* reduced_rows) {
  const int n = problem.shared_size();
  Observability out;
  problem.prepare(state);
  VectorXd squared_norm;
  MatrixXd r = triangle_of(problem, state, out, squared_norm, reduced_rows);
  out.covariance.setZero(n, n);
  out.root.setZero(n, n);
  out.unobservable.assign(n, 0);
  out.null_space.setZero(n, 0);
  if (n == 0) return out;
  VectorXd scale(n);  // 1 / column norm; 0: dead
  int alive = 0;
  for (int i = 0; i < n; ++i) {
    const double norm = r.col(i).norm();
    const bool dead = norm * norm <= kDeadColumn * squared_norm(i) || norm == 0;
    scale(i) = dead ? 0 : 1 / norm;
    alive += !dead;
    r.col(i) *= scale(i);
    if (dead) {
      out.unobservable[i] = 1;
      out.directions.push_back({{i, 1.0}});
      add_null(out, VectorXd::Unit(n, i));
    }
  }
  const SingularValues svd = singular_values(r, Eigen::ComputeFullV);
  VectorXd eigenvalue = VectorXd::Zero(n);
  eigenvalue.head(svd.values.size()) = svd.values.cwiseAbs2();
  std::vector<int> null;  // right singular vectors without information, those of dead columns aside
  for (int i = 0; i < n; ++i) {
    const VectorXd v = svd.v.col(i);
    if (eigenvalue(i) > kNullEigenvalue * eigenvalue(0)) {
      const VectorXd scaled = v.cwiseProduct(scale);
      out.covariance.noalias() += scaled / eigenvalue(i) * scaled.transpose();
      out.root.col(i) = scaled / svd.values(i);
      ++out.rank;
    } else {
      null.push_back(i);
    }
  }
  // The null space of the scaled columns contains a unit vector for every dead one; what is
  // orthogonal to these are gauges.
  const int gauges = static_cast<int>(null.size()) - (n - alive);
  if (gauges > 0) add_gauges(svd.v, null, gauges, scale, out);
  return out;
}

}  // namespace kincal
