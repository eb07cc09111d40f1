// solver/decompositions.h: dense algebra behind plain functions; and eliminate() of
// solver/observability.h.
//
// Proves: each function does what its definition says, on random matrices of several shapes,
// rank-deficient ones where that is allowed: factors multiplied give the matrix back and are
// orthogonal; residuals of least squares are orthogonal to the columns, the shortest solution is
// orthogonal to the null space; eliminated columns have nothing left and what is left keeps its
// Gram matrix. Does not prove: which of several right answers is given (signs of vectors, order of
// pivots), nor anything about speed.
#include "../../solver/decompositions.h"

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <catch2/catch.hpp>
#include <vector>

#include "../../solver/observability.h"
#include "../fixtures/dense.h"
#include "../fixtures/random.h"

namespace decompositions_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

using Shape = std::pair<Eigen::Index, Eigen::Index>;

double largest(const MatrixXd& m) { return m.size() ? m.cwiseAbs().maxCoeff() : 0; }

MatrixXd with_rank(Random& random, Eigen::Index rows, Eigen::Index columns, Eigen::Index rank) {
  return random_matrix(random, rows, rank) * random_matrix(random, rank, columns);
}
MatrixXd positive(Random& random, Eigen::Index n) {
  const MatrixXd a = random_matrix(random, n, n);
  return a * a.transpose() + MatrixXd::Identity(n, n);
}

/// U diag(values) V' = m with orthonormal columns in U and V, values descending and not negative.
template <class Parts>
void check_singular(const Parts& s, const MatrixXd& m) {
  const Eigen::Index n = s.values.size();
  CHECK(largest(MatrixXd(s.u.leftCols(n)) * VectorXd(s.values).asDiagonal() *
                    MatrixXd(s.v.leftCols(n)).transpose() -
                m) < 1e-13 * m.norm());
  CHECK(largest(s.u.transpose() * s.u - MatrixXd::Identity(s.u.cols(), s.u.cols())) < 1e-13);
  CHECK(largest(s.v.transpose() * s.v - MatrixXd::Identity(s.v.cols(), s.v.cols())) < 1e-13);
  for (Eigen::Index i = 0; i < n; ++i)
    CHECK((s.values(i) >= 0 && (i == 0 || s.values(i) <= s.values(i - 1))));
}

}  // namespace

TEST_CASE("decompositions: eigenvalues of symmetric matrices, of which the lower triangle counts") {
  Random random(1);
  for (const Eigen::Index n : {1, 2, 5, 12}) {
    const MatrixXd m = random_matrix(random, n, n), a = m.selfadjointView<Eigen::Lower>();
    const SymmetricEigen eigen = symmetric_eigen(m);
    CHECK(largest(a * eigen.vectors - eigen.vectors * eigen.values.asDiagonal()) <
          1e-13 * a.norm());
    CHECK(largest(eigen.vectors.transpose() * eigen.vectors - MatrixXd::Identity(n, n)) < 1e-13);
    for (Eigen::Index i = 1; i < n; ++i) CHECK(eigen.values(i) >= eigen.values(i - 1));
  }
}

TEST_CASE("decompositions: singular values") {
  Random random(2);
  for (const auto& [rows, columns] : std::vector<Shape>{{1, 1}, {4, 4}, {9, 3}, {3, 9}}) {
    const MatrixXd m = random_matrix(random, rows, columns);
    const SingularValues thin = singular_values(m, Eigen::ComputeThinU | Eigen::ComputeThinV),
                         full = singular_values(m, Eigen::ComputeFullU | Eigen::ComputeFullV),
                         bare = singular_values(m);
    check_singular(thin, m);
    check_singular(full, m);
    CHECK(
        (thin.u.cols() == bare.values.size() && full.u.cols() == rows && full.v.cols() == columns));
    CHECK((bare.u.size() == 0 && bare.v.size() == 0));
    CHECK(largest(bare.values - full.values) < 1e-13);
  }
  const MatrixXd sixty = random_matrix(random, 60, 60);
  check_singular(singular_values(sixty, Eigen::ComputeFullU | Eigen::ComputeFullV), sixty);
  const MatrixXd nine = with_rank(random, 9, 9, 6);
  check_singular(singular_values(nine, Eigen::ComputeFullU | Eigen::ComputeFullV), nine);
  CHECK(singular_values(nine).values(6) < 1e-12);
}

TEST_CASE("decompositions: singular values of which many are the same, as where there are gauges") {
  Random random(12);
  const auto orthogonal = [&](Eigen::Index n) {
    return fixture::dense::orthogonal(random_matrix(random, n, n));
  };
  for (int n = 20; n < 60; ++n) {
    VectorXd values = VectorXd::Ones(n);
    for (int i = n / 2; i < n; ++i) values(i) = i % 3 == 0 ? 1e-15 : 0;
    const MatrixXd m = orthogonal(n) * values.asDiagonal() * orthogonal(n);
    const SingularValues full = singular_values(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    check_singular(full, m);
    CHECK(largest(full.values - values) < 1e-13);
    // Orthonormal columns of which some rows are taken away.
    MatrixXd part = orthogonal(n).leftCols(n / 2);
    part.bottomRows(n / 4).setZero();
    check_singular(singular_values(part, Eigen::ComputeThinU | Eigen::ComputeThinV), part);
  }
}

TEST_CASE("decompositions: least squares") {
  Random random(3);
  for (const auto& [rows, columns] : std::vector<Shape>{{3, 3}, {12, 5}, {30, 1}}) {
    const MatrixXd a = random_matrix(random, rows, columns);
    const VectorXd b = random_matrix(random, rows, 1), x = least_squares(a, b);
    CHECK(largest(a.transpose() * (a * x - b)) < 1e-12);
    VectorXd checked;
    REQUIRE(least_squares(a, b, 1e-9, checked));
    CHECK(largest(checked - x) < 1e-12);
  }
  // Not of full rank: the plain one solves with some unknowns at 0, the checked one refuses and
  // leaves x alone, the shortest is shortest.
  const MatrixXd a = with_rank(random, 12, 6, 4);
  const VectorXd b = random_matrix(random, 12, 1), plain = least_squares(a, b),
                 shortest = shortest_least_squares(a, b);
  CHECK(largest(a.transpose() * (a * plain - b)) < 1e-11);
  CHECK((plain.array() == 0).count() == 2);
  CHECK(largest(a.transpose() * (a * shortest - b)) < 1e-11);
  const MatrixXd null = fixture::dense::kernel(a, 1e-9);
  REQUIRE(null.cols() == 2);
  CHECK(largest(null.transpose() * shortest) < 1e-12);
  VectorXd x = VectorXd::Constant(2, 7);
  CHECK_FALSE(least_squares(a, b, 1e-9, x));
  CHECK(x == VectorXd::Constant(2, 7));
}

TEST_CASE("decompositions: the shortest least squares are the pseudo-inverse") {
  Random random(4);
  for (const Eigen::Index rank : {2, 5}) {
    const MatrixXd a = with_rank(random, 5, 5, rank);
    MatrixXd p(5, 5);
    long found = 0;
    for (Eigen::Index i = 0; i < 5; ++i)
      p.col(i) = shortest_least_squares(a, VectorXd::Unit(5, i), &found);
    CHECK(found == rank);
    const double bound = 1e-12 * p.norm() * a.norm();  // Penrose's four equations
    CHECK(largest(a * p * a - a) < bound * a.norm());
    CHECK(largest(p * a * p - p) < bound * p.norm());
    CHECK(largest((a * p).transpose() - a * p) < bound);
    CHECK(largest((p * a).transpose() - p * a) < bound);
  }
}

TEST_CASE("decompositions: symmetric systems and inverses") {
  Random random(5);
  for (const Eigen::Index n : {1, 3, 8, 50, 77}) {  // (columns of inverses come 32 at a time)
    const MatrixXd a = positive(random, n), b = random_matrix(random, n, 4);
    const Cholesky cholesky(a);
    REQUIRE(cholesky.good());
    CHECK(largest(a * cholesky.solve(b.col(0)) - b.col(0)) < 1e-12);
    const MatrixXd root = cholesky.inverse_factor();
    CHECK(largest(root * a * root.transpose() - MatrixXd::Identity(n, n)) < 1e-12);
    CHECK(root.isLowerTriangular(0));
    // The product of the first k squares of L's diagonal is the leading minor.
    double product = 1;
    for (Eigen::Index k = 0; k < n; ++k) {
      product *= std::pow(cholesky.diagonal()(k), 2);
      CHECK(product == Approx(a.topLeftCorner(k + 1, k + 1).determinant()).epsilon(1e-10));
    }
    MatrixXd indefinite = a;
    indefinite(n - 1, n - 1) = -1;
    CHECK_FALSE(Cholesky(indefinite).good());
    CHECK(largest(a * solve_symmetric(a, b) - b) < 1e-12);
    CHECK(largest(a * inverse_of_symmetric(a) - MatrixXd::Identity(n, n)) < 1e-12);
    CHECK(largest(indefinite * inverse_of_symmetric(indefinite) - MatrixXd::Identity(n, n)) <
          1e-12);
  }
}

TEST_CASE("decompositions: Gram matrices of any size") {
  Random random(7);
  for (const Eigen::Index rows : {0, 1, 8, 13, 40})
    for (const Eigen::Index columns : {1, 5, 16, 61}) {
      const MatrixXd a = random_matrix(random, rows, columns);
      CHECK(largest(gram(a) - a.transpose() * a) < 1e-12);
    }
}

TEST_CASE("decompositions: roots keep the Gram matrix") {
  Random random(6);
  // Units that differ by 1e8, one that is held (0), and a rank that is not full.
  const MatrixXd l = with_rank(random, 5, 3, 3);
  VectorXd unit(5);
  unit << 1, 1e-8, 1e3, 0, 1e-4;
  const MatrixXd c = unit.asDiagonal() * (l * l.transpose()) * unit.asDiagonal(),
                 w = root_of_covariance(c), back = w * w.transpose();
  for (Eigen::Index i = 0; i < 5; ++i)
    for (Eigen::Index j = 0; j < 5; ++j)
      CHECK(std::abs(back(i, j) - c(i, j)) <= 1e-13 * std::sqrt(c(i, i) * c(j, j)));
  CHECK(largest(root_of_covariance(-1e-20 * MatrixXd::Identity(2, 2))) == 0);
}

TEST_CASE(
    "decompositions: elimination takes out what a block determines, by rank, and nothing else") {
  Random random(7);
  for (const Eigen::Index rank : {4, 2, 0}) {
    INFO("rank " << rank);
    MatrixXd block = with_rank(random, 15, 4, rank);
    if (rank == 4) block.col(2) *= 1e-7;  // units do not matter
    MatrixXd others = random_matrix(random, 15, 6);
    VectorXd right = others.col(5);
    const MatrixXd before = others, block_before = block;
    const Elimination elimination(block);
    REQUIRE(elimination.rank() == rank);
    const MatrixXd q = elimination.basis();
    REQUIRE(q.cols() == rank);
    CHECK(largest(q.transpose() * q - MatrixXd::Identity(rank, rank)) < 1e-13);
    CHECK(largest(block - q * (q.transpose() * block)) < 1e-13 * (1 + largest(block)));
    elimination.rotate(others);
    elimination.rotate(right);
    elimination.rotate(block);
    CHECK(largest(right - others.col(5)) < 1e-13);
    CHECK(largest(others.transpose() * others - before.transpose() * before) < 1e-12);
    const Eigen::Index left = 15 - rank;
    CHECK(largest(block.bottomRows(left)) < 1e-13 * (1 + largest(block_before)));
    // What is left of the others: their parts orthogonal to the block.
    const MatrixXd rest = before - q * (q.transpose() * before), rows = others.bottomRows(left);
    CHECK(largest(rows.transpose() * rows - rest.transpose() * rest) < 1e-12);
  }
}

TEST_CASE("eliminate: what is left of the shared columns, by rank of the private ones") {
  Random random(8);
  for (const Shape shape : {Shape{40, 9}, Shape{12, 9}, Shape{5, 9}, Shape{3, 1}})
    for (const Eigen::Index missing : {0, 1, 4}) {
      const auto [count, k] = shape;
      const Eigen::Index most = std::min(count, k),
                         full = std::max<Eigen::Index>(most - missing, 0);
      INFO(count << " rows, " << k << " private columns of rank " << full);
      MatrixXd rows(count, k + 7);
      rows << with_rank(random, count, k, full), random_matrix(random, count, 7);
      rows.col(0) *= 1e-7;
      const MatrixXd q = Elimination(rows.leftCols(k)).basis(), shared = rows.rightCols(7),
                     rest = shared - q * (q.transpose() * shared);
      long rank = 3;
      const MatrixXd left = eliminate(rows, static_cast<int>(k), rank);
      CHECK(rank == 3 + full);
      // The rows beyond the undetermined private unknowns: a triangle where there are more of them
      // than columns (it was all of them before; their Gram matrix, which is all that counts, is
      // held against the plain projection below).
      CHECK(left.rows() == k - full + std::min<Eigen::Index>(std::max(count, k) - k, 7));
      CHECK(largest(left.transpose() * left - rest.transpose() * rest) < 1e-12);
    }
}

}  // namespace decompositions_test
