// Dense decompositions behind plain functions. Eigen instantiates each of them anew in every source
// that names it, several seconds a time; here each is compiled once. They allocate where they do
// not say otherwise.
#pragma once

#include <Eigen/Core>
#include <memory>

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// SymmetricEigen has the eigenvalues, ascending, and eigenvectors of a symmetric matrix, of which
/// the lower triangle counts.
struct SymmetricEigen {
  VectorXd values;
  MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(const MatrixXd& matrix);
/// Returns the eigenvector of the smallest eigenvalue, of a matrix of at most 12 rows. Allocates
/// nothing.
using UpTo12 = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 12, 1>;
UpTo12 least_eigenvector(const Eigen::Ref<const MatrixXd>& matrix);

/// SingularValues has the singular values, descending, and what `parts` asks for
/// (Eigen::ComputeFullU, ComputeThinV, ...; 0: the values only). They come by Jacobi's method: the
/// divide-and-conquer one of Eigen 3.4 is faster from some 50 columns on, but where several values
/// are the same (gauges: several zeros) it reads beside its arrays, and one in ten comes out as
/// NaN.
struct SingularValues {
  VectorXd values;
  MatrixXd u, v;
};
SingularValues singular_values(const MatrixXd& matrix, unsigned parts = 0);

/// The same again and again, in the same memory: only the first matrix of a size allocates.
class RepeatedSvd {
 public:
  RepeatedSvd();
  ~RepeatedSvd();
  void compute(const Eigen::Ref<const MatrixXd>& matrix, unsigned parts);
  const VectorXd& values() const;
  const MatrixXd& u() const;
  const MatrixXd& v() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Returns x of the least |a x - b|^2, by QR with column pivoting; where the rank is not full the
/// columns that come last get 0.
VectorXd least_squares(const MatrixXd& a, const VectorXd& b);
/// Finds the same; returns false, x unchanged, where a pivot is at most `threshold` of the largest.
bool least_squares(const MatrixXd& a, const VectorXd& b, double threshold, VectorXd& x);
/// Returns the shortest of all x with the least |a x - b|^2, by singular values; `rank` gets that
/// of a.
VectorXd shortest_least_squares(const MatrixXd& a, const VectorXd& b, long* rank = nullptr);

/// Returns A'A, by the vectorised kernels (kernels.h).
MatrixXd gram(const MatrixXd& a);

/// A Cholesky holds the factorisation L L' of a symmetric matrix, by the vectorised kernels.
class Cholesky {
 public:
  explicit Cholesky(const MatrixXd& a);
  ~Cholesky();
  /// Returns whether the matrix is positive definite; if not, nothing else is defined.
  bool good() const;
  VectorXd diagonal() const;  // of L
  VectorXd solve(const VectorXd& b) const;
  MatrixXd inverse_factor() const;  // L^-1

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};
/// An Lu holds the factorisation of a square matrix, with row pivots.
class Lu {
 public:
  explicit Lu(const MatrixXd& a);
  ~Lu();
  MatrixXd solve(const MatrixXd& b) const;
  MatrixXd solve_transposed(const MatrixXd& b) const;  // a' x = b
  double log_determinant() const;                      // of |a|

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};
/// Returns x of a x = b for symmetric a, by L D L' with pivoting.
MatrixXd solve_symmetric(const MatrixXd& a, const MatrixXd& b);
/// Returns a^-1 for symmetric a, likewise.
MatrixXd inverse_of_symmetric(const MatrixXd& a);

/// Returns W with W W' = c for a covariance whose diagonal may span many orders; what is negative
/// by rounding counts as 0.
MatrixXd root_of_covariance(const MatrixXd& c);

/// Returns the upper triangle R of Q R = rows; there are no fewer rows than columns.
MatrixXd triangle_of(const MatrixXd& rows);
/// Finds the inverse of an upper triangle (what is below its diagonal is not read) whose condition
/// is certainly below `limit`: largest over least singular value <= |r| |r^-1| (Frobenius). False
/// where it is not, or may not be; `inverse` is scratch then.
bool inverse_of_triangle(const MatrixXd& r, double limit, MatrixXd& inverse);

/// An Elimination is what is left of rows when the unknowns of some columns are eliminated: an
/// orthogonal factorisation with column pivoting, by rank (columns scaled to unit length, singular
/// values above 1e-9 of the largest), so that a block which its rows do not determine loses only
/// what it has.
class Elimination {
 public:
  /// Factorises `block`, the columns of the unknowns to eliminate.
  explicit Elimination(MatrixXd block);
  ~Elimination();
  long rank() const;
  /// Replaces rows by Q' rows, of which the first rank() are what determines the eliminated
  /// unknowns and the others what is left.
  void rotate(MatrixXd& rows) const;
  void rotate(VectorXd& column) const;
  /// Returns an orthonormal basis of the block's range: rows x rank().
  MatrixXd basis() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Returns whether an upper triangle is certainly of full rank for an Elimination.
bool is_of_full_rank(const MatrixXd& triangle);
/// Returns an orthonormal basis of a block's range, of the rank that its Elimination finds, to
/// 1e-9.
MatrixXd range_of(const MatrixXd& block);

}  // namespace kincal
