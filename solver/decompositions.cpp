#include "decompositions.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "aligned.h"
#include "kernels.h"

namespace kincal {
namespace {

constexpr double kRank = 1e-9;  // singular value of a block with unit columns, relative

template <class Svd>
SingularValues parts_of(const Svd& svd) {
  SingularValues out;
  out.values = svd.singularValues();
  if (svd.computeU()) out.u = svd.matrixU();
  if (svd.computeV()) out.v = svd.matrixV();
  return out;
}

}  // namespace

SymmetricEigen symmetric_eigen(const MatrixXd& matrix) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(matrix);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

UpTo12 least_eigenvector(const Eigen::Ref<const MatrixXd>& matrix) {
  using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 12, 12>;
  return Eigen::SelfAdjointEigenSolver<Small>(Small(matrix)).eigenvectors().col(0);
}

SingularValues singular_values(const MatrixXd& matrix, unsigned parts) {
  return parts_of(Eigen::JacobiSVD<MatrixXd>(matrix, parts));
}

struct RepeatedSvd::Parts {
  MatrixXd matrix;
  Eigen::JacobiSVD<MatrixXd> svd;
};
RepeatedSvd::RepeatedSvd() : parts_(new Parts) {}
RepeatedSvd::~RepeatedSvd() = default;
void RepeatedSvd::compute(const Eigen::Ref<const MatrixXd>& matrix, unsigned parts) {
  parts_->matrix = matrix;
  parts_->svd.compute(parts_->matrix, parts);
}
const VectorXd& RepeatedSvd::values() const { return parts_->svd.singularValues(); }
const MatrixXd& RepeatedSvd::u() const { return parts_->svd.matrixU(); }
const MatrixXd& RepeatedSvd::v() const { return parts_->svd.matrixV(); }

VectorXd least_squares(const MatrixXd& a, const VectorXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

bool least_squares(const MatrixXd& a, const VectorXd& b, double threshold, VectorXd& x) {
  Eigen::ColPivHouseholderQR<MatrixXd> qr(a);
  qr.setThreshold(threshold);
  if (qr.rank() < a.cols()) return false;
  x = qr.solve(b);
  return true;
}

VectorXd shortest_least_squares(const MatrixXd& a, const VectorXd& b, long* rank) {
  const Eigen::JacobiSVD<MatrixXd> svd(a, Eigen::ComputeThinU | Eigen::ComputeThinV);
  if (rank) *rank = svd.rank();
  return svd.solve(b);
}

MatrixXd gram(const MatrixXd& a) {
  const auto rows = static_cast<int>(a.rows()), columns = static_cast<int>(a.cols());
  MatrixXd padding, out(columns, columns);
  if (rows != padded(rows)) {
    padding.resize(padded(rows), columns);
    padding.topRows(rows) = a;
    padding.bottomRows(padded(rows) - rows).setZero();
  }
  kernels().gram(rows == padded(rows) ? a.data() : padding.data(), padded(rows), padded(rows),
                 columns, out.data(), columns);
  return out;
}

struct Cholesky::Parts {
  int n, ld;
  AlignedNumbers factor;  // its diagonal is inverted
  bool good;
};
Cholesky::Cholesky(const MatrixXd& a) : parts_(new Parts) {
  Parts& p = *parts_;
  p.n = static_cast<int>(a.rows());
  p.ld = padded(p.n) + kSlack;
  p.factor.assign(static_cast<size_t>(p.ld) * p.n + kSlack, 0.0);
  for (int j = 0; j < p.n; ++j)
    std::copy_n(a.data() + static_cast<size_t>(j) * p.n + j, p.n - j,
                p.factor.data() + static_cast<size_t>(j) * p.ld + j);
  p.good = kernels().cholesky(p.factor.data(), p.n, p.ld);
}
Cholesky::~Cholesky() = default;
bool Cholesky::good() const { return parts_->good; }
VectorXd Cholesky::diagonal() const {
  VectorXd out(parts_->n);
  for (int i = 0; i < parts_->n; ++i)
    out(i) = 1 / parts_->factor[static_cast<size_t>(i) * (parts_->ld + 1)];
  return out;
}
VectorXd Cholesky::solve(const VectorXd& b) const {
  const Parts& p = *parts_;
  VectorXd out = VectorXd::Zero(p.n + kSlack);
  out.head(p.n) = b;
  kernels().solve_lower(p.factor.data(), p.n, p.ld, out.data());
  kernels().solve_lower_transposed(p.factor.data(), p.n, p.ld, out.data());
  return out.head(p.n);
}
MatrixXd Cholesky::inverse_factor() const {
  constexpr int kWidth = 32;  // of columns at a time: above them the inverse is 0
  const Parts& p = *parts_;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> out;
  out.setZero(p.n, padded(p.n) + kSlack);
  for (int k = 0; k < p.n; k += kWidth) {
    const int width = std::min(kWidth, p.n - k);
    for (int i = k; i < k + width; ++i) out(i, i) = 1;
    kernels().solve_rows(p.factor.data() + static_cast<size_t>(k) * (p.ld + 1), p.n - k, p.ld,
                         &out(k, k), width, out.cols());
  }
  return out.leftCols(p.n);
}

struct Lu::Parts {
  Eigen::PartialPivLU<MatrixXd> lu;
};
Lu::Lu(const MatrixXd& a) : parts_(new Parts{Eigen::PartialPivLU<MatrixXd>(a)}) {}
Lu::~Lu() = default;
MatrixXd Lu::solve(const MatrixXd& b) const { return parts_->lu.solve(b); }
MatrixXd Lu::solve_transposed(const MatrixXd& b) const { return parts_->lu.transpose().solve(b); }
double Lu::log_determinant() const {
  return parts_->lu.matrixLU().diagonal().cwiseAbs().array().log().sum();
}

MatrixXd solve_symmetric(const MatrixXd& a, const MatrixXd& b) { return a.ldlt().solve(b); }

MatrixXd inverse_of_symmetric(const MatrixXd& a) {
  return solve_symmetric(a, MatrixXd::Identity(a.rows(), a.cols()));
}

namespace {
constexpr double kSmallestPivotOfRoot = 1e-4;  // of a correlation matrix: far above rounding
}

MatrixXd root_of_covariance(const MatrixXd& c) {
  const VectorXd scale = c.diagonal().cwiseMax(0.0).cwiseSqrt();
  const VectorXd inverse = scale.unaryExpr([](double s) { return s > 0 ? 1 / s : 0.0; });
  const MatrixXd scaled = inverse.asDiagonal() * c * inverse.asDiagonal();
  const Eigen::LLT<MatrixXd> triangle(scaled);  // (a tenth of the time, where it has full rank)
  if (triangle.info() == Eigen::Success &&
      triangle.matrixLLT().diagonal().minCoeff() > kSmallestPivotOfRoot)
    return scale.asDiagonal() * MatrixXd(triangle.matrixL());
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(scaled);
  return scale.asDiagonal() * eigen.eigenvectors() *
         eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
}

// Column after column by back substitution.
bool inverse_of_triangle(const MatrixXd& r, double limit, MatrixXd& inverse) {
  const Eigen::Index n = r.cols();
  inverse.setIdentity(n, n);
  double squared = 0;
  for (Eigen::Index j = 0; j < n; ++j) {
    double* const x = inverse.col(j).data();
    for (Eigen::Index i = j; i >= 0; --i) {
      const double* const column = r.col(i).data();
      x[i] /= column[i];
      for (Eigen::Index k = 0; k < i; ++k) x[k] -= x[i] * column[k];
    }
    squared += r.col(j).head(j + 1).squaredNorm();
  }
  return std::sqrt(squared) * inverse.norm() < limit;  // NaN and infinity are not
}

MatrixXd triangle_of(const MatrixXd& rows) {
  return Eigen::HouseholderQR<MatrixXd>(rows)
      .matrixQR()
      .topRows(rows.cols())
      .triangularView<Eigen::Upper>();
}

struct Elimination::Parts {
  Eigen::ColPivHouseholderQR<MatrixXd> qr;
};

namespace {

void scale_to_unit_columns(MatrixXd& block) {
  for (Eigen::Index i = 0; i < block.cols(); ++i) {
    const double norm = block.col(i).norm();
    if (norm > 0) block.col(i) /= norm;
  }
}

}  // namespace

Elimination::Elimination(MatrixXd block) : parts_(new Parts) {
  scale_to_unit_columns(block);
  parts_->qr.setThreshold(kRank);
  parts_->qr.compute(block);
}

Elimination::~Elimination() = default;
long Elimination::rank() const { return parts_->qr.rank(); }

// Only the first rank() reflections: what is beyond them is determined by nothing here and must not
// eat shared information.
void Elimination::rotate(MatrixXd& rows) const {
  rows.applyOnTheLeft(parts_->qr.householderQ().setLength(rank()).adjoint());
}
void Elimination::rotate(VectorXd& column) const {
  column.applyOnTheLeft(parts_->qr.householderQ().setLength(rank()).adjoint());
}

MatrixXd Elimination::basis() const {
  MatrixXd out = MatrixXd::Identity(parts_->qr.rows(), rank());
  out.applyOnTheLeft(parts_->qr.householderQ().setLength(rank()));
  return out;
}

bool is_of_full_rank(const MatrixXd& triangle) {
  MatrixXd scaled = triangle.triangularView<Eigen::Upper>(), inverse;
  scale_to_unit_columns(scaled);
  return inverse_of_triangle(scaled, 1 / kRank, inverse);
}

// A = Q R by reflections, and Q = A R^-1, which is orthonormal to |R| |R^-1| times rounding.
MatrixXd range_of(const MatrixXd& block) {
  constexpr double kAccurate = 1e6;
  const int rows = padded(static_cast<int>(std::max(block.rows(), block.cols()))),
            columns = static_cast<int>(block.cols());
  MatrixXd scaled = block;
  scale_to_unit_columns(scaled);
  MatrixXd r = MatrixXd::Zero(rows, columns), inverse;
  r.topRows(block.rows()) = scaled;
  kernels().triangularise(r.data(), rows, columns, columns, rows);
  if (!inverse_of_triangle(r, kAccurate, inverse)) return Elimination(block).basis();
  return scaled * inverse;
}

}  // namespace kincal
