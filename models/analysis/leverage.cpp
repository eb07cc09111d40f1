#include "leverage.h"

#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../../solver/kernels.h"
#include "../estimation/estimation.h"

namespace kincal {

std::vector<Influence> influences(const std::vector<GroupShape>& groups,
                                  const ReducedRows& reduced_rows,
                                  const Observability& observability, double least) {
  constexpr double kAlone = 1e-7;  // of the information on a direction that the other groups have
                                   // at least, else it is determined by one
  const MatrixXd& w = observability.root;
  const Eigen::Index n = w.cols();
  const int ld = padded(static_cast<int>(n)) + kSlack;
  MatrixXd moves,
      touched = MatrixXd::Zero(ld, n);  // B; W by the rows that a group touches: transposed
  std::vector<Influence> out;
  for (size_t g = 0; g < groups.size(); ++g) {
    const std::vector<int>& columns = groups[g].columns;
    const Eigen::Index m = static_cast<Eigen::Index>(columns.size());
    if (m == 0) continue;
    const MatrixXd& reduced = reduced_rows(g);
    const int rows = static_cast<int>(reduced.rows());
    if (rows == 0) continue;
    for (Eigen::Index i = 0; i < m; ++i) touched.col(i).head(n) = w.row(columns[i]).transpose();
    moves.setZero(ld, rows);
    kernels().multiply(reduced.data(), 1, rows, rows, static_cast<int>(m), touched.data(), ld,
                       static_cast<int>(n), moves.data(), ld);
    const VectorXd right = moves.topRows(n) * reduced.col(m);
    // |(I - B'B)^-1| <= 1 / (1 - |B|^2): most of many groups move nothing by that much.
    const double squared = moves.topRows(n).squaredNorm();
    if (squared < 1 - kAlone && right.norm() <= least * (1 - squared)) continue;
    MatrixXd rest = MatrixXd::Zero(ld, n);
    rest.topRows(n).setIdentity();
    kernels().subtract_product(rest.data(), static_cast<int>(n), ld, moves.data(), rows, ld);
    rest.conservativeResize(n, Eigen::NoChange);
    rest.triangularView<Eigen::StrictlyUpper>() = rest.transpose();
    VectorXd moved = VectorXd::Zero(n);
    MatrixXd lost(n, 0);
    const Cholesky cholesky(rest);
    if (cholesky.good() && cholesky.diagonal().minCoeff() > 1e-3) {
      moved = cholesky.solve(right);
    } else {
      const SymmetricEigen eigen = symmetric_eigen(rest);
      Eigen::Index none = 0;
      while (none < n && eigen.values(none) < kAlone) ++none;
      lost = w * eigen.vectors.leftCols(none);
      const auto kept = eigen.vectors.rightCols(n - none);
      moved = kept * (kept.transpose() * right).cwiseQuotient(eigen.values.tail(n - none));
    }
    const VectorXd delta = w * moved;
    for (Eigen::Index c = 0; c < w.rows(); ++c) {
      const double sigma = w.row(c).norm();
      if (sigma == 0) continue;
      const bool undetermined = lost.cols() > 0 && lost.row(c).norm() > 1e-3 * sigma;
      const double sigmas =
          undetermined ? std::numeric_limits<double>::infinity() : delta(c) / sigma;
      if (std::abs(sigmas) > least)
        out.push_back({static_cast<int>(g), static_cast<int>(c), sigmas});
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const Influence& a, const Influence& b) {
    return std::abs(a.sigmas) > std::abs(b.sigmas);
  });
  return out;
}

std::vector<Leverage> leverage(const Linearisation& at, const Progress& progress) {
  std::vector<Leverage> out;
  Estimation& problem = at.problem();
  problem.prepare(at.state());
  MatrixXd scratch;
  const double groups = static_cast<double>(problem.groups().size());
  const auto rows = [&](size_t g) -> const MatrixXd& {
    if (g % kGroupsTold == 0) progress.share(static_cast<double>(g), groups);
    return at.reduced_rows(g, scratch);
  };
  for (const Influence& f : influences(problem.groups(), rows, at.observability()))
    if (problem.sample_of(f.group) >= 0)
      out.push_back({at.solution.samples()[problem.sample_of(f.group)].id,
                     problem.column_name(f.column), f.sigmas});
  return out;
}

}  // namespace kincal
