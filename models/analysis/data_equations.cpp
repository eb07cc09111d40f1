#include "data_equations.h"

#include "../estimation/estimation.h"

namespace kincal {

DataEquations data_equations(const Linearisation& at) {
  if (at.solution.data) return *at.solution.data;
  Estimation& problem = at.problem();
  problem.prepare(at.state());
  MatrixXd scratch;
  const auto n = static_cast<Eigen::Index>(problem.columns().size());
  DataEquations out{problem.columns(), MatrixXd::Zero(n, n), VectorXd::Zero(n)};
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    if (static_cast<int>(g) == problem.prior_group()) continue;
    const std::vector<int>& columns = problem.groups()[g].columns;
    const auto m = static_cast<Eigen::Index>(columns.size());
    const MatrixXd& rows = at.reduced_rows(g, scratch);
    const MatrixXd gram = rows.transpose() * rows;
    for (Eigen::Index i = 0; i < m; ++i) {
      out.pull(columns[i]) -= gram(i, m);
      for (Eigen::Index j = 0; j < m; ++j) out.normal(columns[i], columns[j]) += gram(i, j);
    }
  }
  return out;
}

}  // namespace kincal
