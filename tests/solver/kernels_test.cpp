// The dense kernels against Eigen, for every instruction set that this processor has and all small
// sizes; what they may not touch stays untouched. Not proved: speed, and sets that this processor
// lacks.
#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <string>
#include <vector>

#include "../../solver/kernels.h"
#include "../fixtures/dense.h"

namespace kernels_test {

using namespace kincal;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

MatrixXd random(std::mt19937& engine, Eigen::Index rows, Eigen::Index columns) {
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, columns, [&] { return normal(engine); });
}

/// rows + kSlack, the slack filled with NaN.
MatrixXd with_slack(const MatrixXd& m) {
  MatrixXd out = MatrixXd::Constant(m.rows() + kSlack, m.cols() + 1, std::nan(""));
  out.topLeftCorner(m.rows(), m.cols()) = m;
  return out;
}

std::vector<const Kernels*> sets() {
  int count;
  const Kernels* const* all = all_kernels(count);
  return {all, all + count};
}

}  // namespace

TEST_CASE("kernels: the plainest set is the one that every processor of this kind has") {
#ifdef __aarch64__
  CHECK(std::string(sets()[0]->name) == "neon");
#else
  CHECK(std::string(sets()[0]->name) == "baseline");
#endif
  CHECK(sets()[instruction_set()] == &kernels());
}

TEST_CASE("kernels: gram") {
  std::mt19937 engine(1);
  for (const Kernels* k : sets())
    for (int w = 1; w <= 21; ++w)
      for (int rows : {8, 16, 96}) {
        const MatrixXd l = random(engine, rows + 3, w);
        MatrixXd g = MatrixXd::Constant(w + 2, w, 7);
        k->gram(l.data(), rows, l.rows(), w, g.data(), static_cast<int>(g.rows()));
        const MatrixXd expected = l.topRows(rows).transpose() * l.topRows(rows);
        INFO(k->name << " " << w << " " << rows);
        CHECK((g.topRows(w) - expected).cwiseAbs().maxCoeff() < 1e-12 * rows);
        CHECK(g.bottomRows(2) == MatrixXd::Constant(2, w, 7));
      }
}

TEST_CASE("kernels: gram of columns that have one half of the rows each") {
  std::mt19937 engine(11);
  for (const Kernels* k : sets())
    for (int w = 4; w <= 21; ++w)
      for (int at = 0; at + 4 <= w; ++at)
        for (int rows : {8, 16, 48, 96}) {
          MatrixXd l = random(engine, rows + 3, w);
          l.block(rows / 2, at, rows - rows / 2, 2).setZero();
          l.block(0, at + 2, rows / 2, 2).setZero();
          MatrixXd g = MatrixXd::Constant(w + 2, w, 7);
          k->gram_of_halves(l.data(), rows, l.rows(), w, at, g.data(), static_cast<int>(g.rows()));
          const MatrixXd expected = l.topRows(rows).transpose() * l.topRows(rows);
          INFO(k->name << " " << w << " " << at << " " << rows);
          REQUIRE((g.topRows(w) - expected).cwiseAbs().maxCoeff() < 1e-12 * rows);
          REQUIRE(g.bottomRows(2) == MatrixXd::Constant(2, w, 7));
        }
}

TEST_CASE("kernels: subtract_product, cholesky and its solutions") {
  std::mt19937 engine(2);
  for (const Kernels* k : sets())
    for (int n : {1, 2, 3, 5, 6, 7, 8, 9, 15, 16, 17, 23, 24, 31, 33, 64, 65, 116, 131}) {
      INFO(k->name << " " << n);
      const int depth = 1 + n % 13;
      const MatrixXd a = random(engine, n, depth), c = random(engine, n, n);
      const MatrixXd slack_a = with_slack(a);
      MatrixXd slack_c = with_slack(c);
      k->subtract_product(slack_c.data(), n, static_cast<int>(slack_c.rows()), slack_a.data(),
                          depth, slack_a.rows());
      const MatrixXd expected = c - a * a.transpose();
      CHECK((MatrixXd(slack_c.topLeftCorner(n, n).triangularView<Eigen::Lower>()) -
             MatrixXd(expected.triangularView<Eigen::Lower>()))
                .cwiseAbs()
                .maxCoeff() < 1e-13 * depth);

      const MatrixXd root = random(engine, n + 5, n), spd = root.transpose() * root;
      MatrixXd factor = with_slack(spd);
      REQUIRE(k->cholesky(factor.data(), n, static_cast<int>(factor.rows())));
      const MatrixXd l = fixture::dense::lower(spd);
      for (int j = 0; j < n; ++j) {
        CHECK(1 / factor(j, j) == Approx(l(j, j)).epsilon(1e-10));
        for (int i = j + 1; i < n; ++i)
          REQUIRE(factor(i, j) == Approx(l(i, j)).epsilon(1e-9).margin(1e-9));
      }
      const VectorXd b = random(engine, n, 1);
      VectorXd x(n + kSlack);
      x << b, VectorXd::Constant(kSlack, std::nan(""));
      k->solve_lower(factor.data(), n, static_cast<int>(factor.rows()), x.data());
      CHECK((l.triangularView<Eigen::Lower>() * x.head(n) - b).norm() < 1e-9 * b.norm());
      k->solve_lower_transposed(factor.data(), n, static_cast<int>(factor.rows()), x.data());
      CHECK((spd * x.head(n) - b).norm() <
            1e-7 * (1 + spd.norm() * x.head(n).norm()) * 1e-6 + 1e-9 * b.norm());

      for (int width : {1, 7, 8, 9, 40}) {
        RowMajor rows = RowMajor::Constant(n + 1, padded(width) + 8, 3);
        const MatrixXd right = random(engine, n, width);
        rows.topLeftCorner(n, width) = right;
        k->solve_rows(factor.data(), n, static_cast<int>(factor.rows()), rows.data(), width,
                      rows.cols());
        CHECK((l.triangularView<Eigen::Lower>() * MatrixXd(rows.topLeftCorner(n, width)) - right)
                  .norm() < 1e-9 * right.norm());
        CHECK(rows.rightCols(8) == RowMajor::Constant(n + 1, 8, 3));
        CHECK(rows.bottomRows(1) == RowMajor::Constant(1, rows.cols(), 3));
      }
      MatrixXd indefinite = with_slack(spd - 2 * spd(n - 1, n - 1) * MatrixXd::Identity(n, n));
      CHECK_FALSE(k->cholesky(indefinite.data(), n, static_cast<int>(indefinite.rows())));
      indefinite.setConstant(std::nan(""));
      CHECK_FALSE(k->cholesky(indefinite.data(), n, static_cast<int>(indefinite.rows())));
    }
}

TEST_CASE("kernels: multiply") {
  std::mt19937 engine(9);
  for (const Kernels* k : sets())
    for (int rows : {1, 3, 4, 9})
      for (int depth : {1, 2, 6, 17})
        for (int columns : {1, 7, 8, 30}) {
          INFO(k->name << " " << rows << " x " << depth << " x " << columns);
          const MatrixXd f = random(engine, rows, depth), transposed = f.transpose();
          const MatrixXd g = with_slack(random(engine, columns, depth));  // column r: row r
          MatrixXd out(columns + kSlack, rows);
          const MatrixXd expected = g.topLeftCorner(columns, depth) * transposed;
          const int ld = columns + kSlack;
          k->multiply(f.data(), 1, rows, rows, depth, g.data(), ld, columns, out.data(), ld);
          CHECK((out.topRows(columns) - expected).cwiseAbs().maxCoeff() < 1e-13 * depth);
          k->multiply(transposed.data(), depth, 1, rows, depth, g.data(), ld, columns, out.data(),
                      ld);
          CHECK((out.topRows(columns) - expected).cwiseAbs().maxCoeff() < 1e-13 * depth);
        }
}

TEST_CASE("kernels: add_and_weigh") {
  std::mt19937 engine(23);
  for (const Kernels* k : sets())
    for (const int n : {1, 2, 6, 11}) {
      INFO(k->name << " " << n);
      constexpr int lanes = 16;
      const int triangle = n * (n + 1) / 2;
      const MatrixXd more = random(engine, triangle + n, 1);
      MatrixXd entries(lanes, triangle + n);
      const VectorXd width = random(engine, n, 1).cwiseAbs();
      VectorXd form(lanes), inverse(lanes), expected_form(lanes), expected_inverse(lanes);
      for (int s = 0; s < lanes; ++s) {
        const MatrixXd root = random(engine, n, n + 1);
        const MatrixXd a = root * root.transpose();
        const VectorXd b = random(engine, n, 1);
        for (int i = 0; i < n; ++i) {
          for (int c = 0; c <= i; ++c)
            entries(s, i * (i + 1) / 2 + c) = a(i, c) - more(i * (i + 1) / 2 + c);
          entries(s, triangle + i) = b(i) - more(triangle + i);
        }
        MatrixXd weighed = width.asDiagonal() * a * width.asDiagonal();
        weighed.diagonal().array() += 1;
        const VectorXd right = width.cwiseProduct(b);
        expected_form(s) = fixture::dense::weighted_square(right, weighed);
        expected_inverse(s) = 1 / std::exp(fixture::dense::log_determinant(weighed));
      }
      const MatrixXd sums = entries.rowwise() + more.transpose().row(0);
      std::vector<double> work(8 * (triangle + 2 * n));
      k->add_and_weigh(entries.data(), more.data(), width.data(), n, lanes, work.data(),
                       form.data(), inverse.data());
      CHECK(entries == sums);
      CHECK((form - expected_form).cwiseQuotient(expected_form).cwiseAbs().maxCoeff() < 1e-9);
      CHECK((inverse - expected_inverse).cwiseQuotient(expected_inverse).cwiseAbs().maxCoeff() <
            1e-9);
    }
}

TEST_CASE("kernels: triangularise") {
  std::mt19937 engine(8);
  for (const Kernels* k : sets())
    for (int columns = 1; columns <= 21; ++columns)
      for (int rows : {8, 16, 24, 96}) {
        INFO(k->name << " " << rows << " x " << columns);
        MatrixXd a = random(engine, rows + 3, columns);
        if (columns > 4) a.col(3).setZero();         // a number that is held
        if (columns > 6) a.col(5) = 1e8 * a.col(1);  // a rank that is not full
        const MatrixXd gram = a.topRows(rows).transpose() * a.topRows(rows),
                       below = a.bottomRows(3);
        const MatrixXd whole = a;
        for (int first : {columns, columns / 2}) {
          a = whole;
          k->triangularise(a.data(), rows, columns, first, a.rows());
          MatrixXd r = a.topRows(rows);
          r.leftCols(first) = r.leftCols(first).triangularView<Eigen::Upper>().toDenseMatrix();
          const MatrixXd error = r.transpose() * r - gram;
          for (int i = 0; i < columns; ++i)
            for (int j = 0; j < columns; ++j)
              REQUIRE(std::abs(error(i, j)) <= 1e-13 * std::sqrt(gram(i, i) * gram(j, j)));
          CHECK(a.bottomRows(3) == below);
        }
      }
  // Nothing is squared: what is left of a column that is nearly another's keeps its digits.
  for (const Kernels* k : sets()) {
    MatrixXd a = MatrixXd::Zero(16, 2);
    a.col(0).head(9).setOnes();
    a.col(1) = a.col(0);
    a(4, 1) += 1e-10;
    k->triangularise(a.data(), 16, 2, 2, 16);
    CHECK(std::abs(a(1, 1)) == Approx(1e-10 * std::sqrt(8.0 / 9)).epsilon(1e-5));
  }
}

TEST_CASE("kernels: subtract_block and add") {
  std::mt19937 engine(3);
  for (const Kernels* k : sets())
    for (int depth : {1, 3, 6, 20})
      for (int rows : {1, 6, 8, 9, 17})
        for (int columns : {1, 2, 9}) {
          INFO(k->name << " " << depth << " " << rows << " " << columns);
          const int stride = rows + columns + 3;
          const RowMajor ab = random(engine, depth, stride);
          MatrixXd d = random(engine, rows + 2, columns);
          const MatrixXd before = d;
          std::vector<std::ptrdiff_t> step;
          for (int q = 0; q < columns; ++q) step.push_back(q * d.rows());
          k->subtract_block(d.data(), step.data(), ab.data(), rows, ab.data() + rows, columns,
                            depth, stride);
          const MatrixXd expected =
              before.topRows(rows) - ab.leftCols(rows).transpose() * ab.middleCols(rows, columns);
          CHECK((d.topRows(rows) - expected).cwiseAbs().maxCoeff() < 1e-12);
          CHECK(d.bottomRows(2) == before.bottomRows(2));
        }
  for (const Kernels* k : sets())
    for (int n : {0, 1, 7, 8, 19}) {
      const VectorXd a = random(engine, n + 1, 1), b = random(engine, n + 1, 1);
      VectorXd sum = a;
      k->add(sum.data(), b.data(), n);
      CHECK(sum.head(n) == a.head(n) + b.head(n));
      CHECK(sum(n) == a(n));
    }
}

TEST_CASE("kernels: expand") {
  std::mt19937 engine(4);
  for (const Kernels* k : sets())
    for (int depth : {6, 14})
      for (int own : {0, 1, 9})
        for (int columns : {0, 1, 6, 8, 22, 35}) {
          INFO(k->name << " " << depth << " " << own << " " << columns);
          const int width = depth + own + 1;
          const MatrixXd root = random(engine, 40, width), m = random(engine, depth, columns);
          const MatrixXd g = root.transpose() * root;
          const int ldp = padded(columns) + 8, ldx = padded(width) + 8;
          RowMajor product = RowMajor::Constant(columns + 1, ldx, 5),
                   out = RowMajor::Constant(columns + 1, ldp, 5);
          RowMajor m_rows = RowMajor::Constant(depth, ldp, std::nan(""));
          m_rows.leftCols(columns) = m;
          MatrixXd padded_g = MatrixXd::Constant(padded(width), width, std::nan(""));
          padded_g.topRows(width) = g;
          k->expand(padded_g.data(), padded(width), width, m_rows.data(), ldp, depth, columns,
                    product.data(), ldx, out.data(), ldp);
          const MatrixXd expected = m.transpose() * g.topRows(depth),
                         block = expected.leftCols(depth) * m;
          CHECK((product.topLeftCorner(columns, width) - expected).norm() <=
                1e-12 * expected.norm());
          for (int i = 0; i < columns; ++i)
            for (int j = i; j < columns; ++j)
              REQUIRE(out(i, j) == Approx(block(i, j)).epsilon(1e-11).margin(1e-11));
          CHECK(product.bottomRows(1) == RowMajor::Constant(1, ldx, 5));
          CHECK(product.rightCols(8) == RowMajor::Constant(columns + 1, 8, 5));
          CHECK(out.bottomRows(1) == RowMajor::Constant(1, ldp, 5));
          CHECK(out.rightCols(8) == RowMajor::Constant(columns + 1, 8, 5));
        }
}

TEST_CASE("kernels: add_rows") {
  std::mt19937 engine(10);
  for (const Kernels* k : sets())
    for (int n : {1, 7, 8, 13, 24, 27})
      for (bool upper : {false, true}) {
        INFO(k->name << " " << n << " " << upper);
        const int rows = upper ? n : n % 5 + 2, width = padded(n);
        const MatrixXd a = random(engine, rows, n), b = random(engine, rows, n);
        RowMajor to = RowMajor::Constant(rows + 1, width + 8, 3),
                 from = RowMajor::Constant(rows, width + 16, std::nan(""));
        to.topLeftCorner(rows, n) = a;
        from.topLeftCorner(rows, n) = b;
        k->add_rows(to.data(), width + 8, from.data(), width + 16, rows, n, upper);
        for (int i = 0; i < rows; ++i)
          for (int j = upper ? i : 0; j < n; ++j) REQUIRE(to(i, j) == a(i, j) + b(i, j));
        CHECK(to.bottomRows(1) == RowMajor::Constant(1, width + 8, 3));
        CHECK(to.rightCols(8) == RowMajor::Constant(rows + 1, 8, 3));
      }
}

TEST_CASE("kernels: subtract_products_9x9") {
  std::mt19937 engine(5);
  for (const Kernels* k : sets())
    for (int runs = 0; runs <= 11; ++runs) {
      INFO(k->name << " " << runs);
      const int all = 14, pairs = runs * (runs + 1) / 2, stride = padded(9 * runs + 1) + 3;
      const RowMajor b = random(engine, 3, stride);
      std::vector<int> first, block(pairs);
      for (int i = 0; i < runs; ++i) first.push_back(9 * (i + (i > 3)));
      for (int i = 0; i < pairs; ++i) block[i] = i + i / 5;  // some blocks are others'
      std::shuffle(block.begin(), block.end(), engine);
      const VectorXd blocks = random(engine, kBlockStorage9x9 * (pairs + pairs / 5 + 1), 1),
                     gradient = random(engine, 9 * all + 8, 1);
      VectorXd to = blocks, g = gradient, expected = blocks, expected_g = gradient;
      k->subtract_products_9x9(to.data(), block.data(), first.data(), runs, b.data(), stride,
                               g.data());
      for (int i = 0, pair = 0; i < runs; ++i) {
        const MatrixXd bi = b.middleCols(9 * i, 9);
        expected_g.segment(first[i], 9) -= bi.transpose() * b.col(9 * runs);
        for (int j = 0; j <= i; ++j, ++pair) {
          const MatrixXd product = bi.transpose() * b.middleCols(9 * j, 9);
          double* at = expected.data() + kBlockStorage9x9 * block[pair];
          for (int q = 0; q < 9; ++q) {
            for (int r = 0; r < 8; ++r) at[8 * q + r] -= product(r, q);
            at[72 + q] -= product(8, q);
          }
        }
      }
      CHECK((to - expected).cwiseAbs().maxCoeff() < 1e-13);
      CHECK((g - expected_g).cwiseAbs().maxCoeff() < 1e-13);
    }
}

}  // namespace kernels_test
