#include "reduced_system.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <new>

#ifdef KINCAL_CHOLMOD
#include <cholmod.h>
#else
#include <Eigen/SparseCholesky>
#endif

namespace kincal {

#ifdef KINCAL_CHOLMOD
struct ReducedSystem::Sparse {
  cholmod_common common;
  cholmod_sparse matrix{};
  cholmod_factor* factor = nullptr;
  cholmod_dense *x = nullptr, *y = nullptr, *e = nullptr;

  Sparse(int n, std::vector<int>& start, std::vector<int>& row) {
    cholmod_start(&common);
    common.print = 0;
    common.supernodal = CHOLMOD_SIMPLICIAL;
    common.final_ll = 1;
    common.nmethods = 1;
    common.method[0].ordering = CHOLMOD_AMD;
    common.postorder = 1;
    common.quick_return_if_not_posdef = 1;
    matrix.nrow = matrix.ncol = n;
    matrix.nzmax = row.size();
    matrix.p = start.data();
    matrix.i = row.data();
    matrix.stype = -1;
    matrix.itype = CHOLMOD_INT;
    matrix.xtype = CHOLMOD_PATTERN;  // no numbers yet
    matrix.dtype = CHOLMOD_DOUBLE;
    matrix.sorted = matrix.packed = 1;
    factor = cholmod_analyze(&matrix, &common);
    if (!factor) throw std::bad_alloc();
    matrix.xtype = CHOLMOD_REAL;
  }
  ~Sparse() {
    cholmod_free_dense(&x, &common);
    cholmod_free_dense(&y, &common);
    cholmod_free_dense(&e, &common);
    cholmod_free_factor(&factor, &common);
    cholmod_finish(&common);
  }
  bool compute(const double* values) {
    matrix.x = const_cast<double*>(values);  // read only
    return cholmod_factorize(&matrix, factor, &common) && common.status == CHOLMOD_OK && factor->minor == factor->n;
  }
  void solve(VectorXd& b) {
    cholmod_dense right{};
    right.nrow = right.d = right.nzmax = static_cast<size_t>(b.size());
    right.ncol = 1;
    right.x = b.data();
    right.xtype = CHOLMOD_REAL;
    right.dtype = CHOLMOD_DOUBLE;
    cholmod_solve2(CHOLMOD_A, factor, &right, nullptr, &x, nullptr, &y, &e, &common);
    std::copy_n(static_cast<double*>(x->x), b.size(), b.data());
  }
};
#else
struct ReducedSystem::Sparse {
  Eigen::SparseMatrix<double> matrix;
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> factor;

  Sparse(int n, std::vector<int>& start, std::vector<int>& row) {
    const std::vector<double> ones(row.size(), 1);
    matrix = Eigen::Map<const Eigen::SparseMatrix<double>>(n, n, static_cast<int>(row.size()), start.data(), row.data(), ones.data());
    factor.analyzePattern(matrix);
  }
  bool compute(const double* values) {
    std::copy_n(values, matrix.nonZeros(), matrix.valuePtr());
    factor.factorize(matrix);
    return factor.info() == Eigen::Success;
  }
  void solve(VectorXd& b) { b = factor.solve(b).eval(); }
};
#endif

ReducedSystem::ReducedSystem(int n, const std::vector<GroupShape>& groups, LinearSolver choice) : n_(n), groups_(&groups) {
  dense_ = choice == LinearSolver::dense || n == 0 || (choice == LinearSolver::automatic && n <= 400);
  if (dense_) {
    factor_.resize(n, n);
    return;
  }
  std::vector<std::vector<int>> below(n);  // pattern, column by column
  for (int i = 0; i < n; ++i) below[i].push_back(i);
  for (const GroupShape& g : groups)
    for (size_t j = 0; j < g.columns.size(); ++j) {
      std::vector<int>& column = below[g.columns[j]];
      column.insert(column.end(), g.columns.begin() + j, g.columns.end());
      if (column.size() > 4 * static_cast<size_t>(n)) {
        std::sort(column.begin(), column.end());
        column.erase(std::unique(column.begin(), column.end()), column.end());
      }
    }
  column_start_.push_back(0);
  for (std::vector<int>& column : below) {
    std::sort(column.begin(), column.end());
    column.erase(std::unique(column.begin(), column.end()), column.end());
    row_of_.insert(row_of_.end(), column.begin(), column.end());
    column_start_.push_back(static_cast<int>(row_of_.size()));
  }
  if (choice == LinearSolver::automatic && row_of_.size() > 0.3 * n * (n + 1.0) / 2) {
    dense_ = true;
    factor_.resize(n, n);
    return;
  }
  for (const GroupShape& g : groups) {
    std::vector<int> places;
    for (size_t j = 0; j < g.columns.size(); ++j)
      for (size_t i = j; i < g.columns.size(); ++i) {
        const auto begin = row_of_.begin() + column_start_[g.columns[j]], end = row_of_.begin() + column_start_[g.columns[j] + 1];
        places.push_back(static_cast<int>(std::lower_bound(begin, end, g.columns[i]) - row_of_.begin()));
      }
    places_.push_back(std::move(places));
  }
  sparse_ = std::make_unique<Sparse>(n, column_start_, row_of_);
}

ReducedSystem::~ReducedSystem() = default;

MatrixXd ReducedSystem::full(const double* values) const {
  MatrixXd m = MatrixXd::Zero(n_, n_);
  for (int j = 0; j < n_; ++j)
    if (dense_)
      m.col(j).tail(n_ - j) = Eigen::Map<const MatrixXd>(values, n_, n_).col(j).tail(n_ - j);
    else
      for (int k = column_start_[j]; k < column_start_[j + 1]; ++k) m(row_of_[k], j) = values[k];
  return m.selfadjointView<Eigen::Lower>();
}

bool ReducedSystem::factor(const double* values) {
  if (!dense_) return sparse_->compute(values);
  factor_ = Eigen::Map<const MatrixXd>(values, n_, n_);
  Eigen::Ref<MatrixXd> in_place(factor_);
  return Eigen::LLT<Eigen::Ref<MatrixXd>>(in_place).info() == Eigen::Success;
}

void ReducedSystem::solve(VectorXd& b) {
  if (!dense_) return sparse_->solve(b);
  factor_.triangularView<Eigen::Lower>().solveInPlace(b);
  factor_.triangularView<Eigen::Lower>().adjoint().solveInPlace(b);
}

}  // namespace kincal
