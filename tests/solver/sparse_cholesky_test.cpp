// solver/sparse_cholesky: against Eigen's dense Cholesky on random patterns of runs of random sizes
// (trees, rings, grids, several pieces, all coupled with all), in random orders of elimination,
// many times with one analysis; what is not positive definite is refused. Does not prove: speed, or
// that an order is a good one.
#include <Eigen/Cholesky>
#include <algorithm>
#include <catch2/catch.hpp>
#include <random>

#include "../../solver/sparse_cholesky.h"
#include "../fixtures/dense.h"

namespace sparse_cholesky_test {

using namespace kincal;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// A matrix in the form of the reduced system: the lower triangle in compressed columns.
struct Pattern {
  std::vector<int> first{0};
  std::vector<SparseBlock> blocks;
  std::vector<std::ptrdiff_t> start;
  std::vector<std::vector<int>> below;  // by run, itself first
  size_t storage = 0;

  Pattern(const std::vector<int>& sizes, const std::vector<std::pair<int, int>>& couples) {
    const int runs = static_cast<int>(sizes.size());
    for (const int size : sizes) first.push_back(first.back() + size);
    below.resize(runs);
    for (int r = 0; r < runs; ++r) below[r].push_back(r);
    for (const auto& [a, b] : couples)
      if (a != b) below[std::min(a, b)].push_back(std::max(a, b));
    for (int b = 0; b < runs; ++b) {
      std::sort(below[b].begin(), below[b].end());
      below[b].erase(std::unique(below[b].begin(), below[b].end()), below[b].end());
      int rows = 0;
      for (const int a : below[b]) {
        blocks.push_back({a, b, rows});
        rows += sizes[a];
      }
      for (int q = 0; q < sizes[b]; ++q) {
        start.push_back(static_cast<std::ptrdiff_t>(storage) - q);
        storage += static_cast<size_t>(rows - q);
      }
    }
  }
  std::vector<double> values(const MatrixXd& m) const {
    std::vector<double> out(storage, 0.0);
    for (const SparseBlock& b : blocks)
      for (int q = 0; q < first[b.column + 1] - first[b.column]; ++q)
        for (int i = b.row == b.column ? q : 0; i < first[b.row + 1] - first[b.row]; ++i)
          out[static_cast<size_t>(start[first[b.column] + q] + b.place + i)] =
              m(first[b.row] + i, first[b.column] + q);
    return out;
  }
  /// Positive definite, with numbers where the pattern has them.
  MatrixXd draw(std::mt19937& engine) const {
    std::normal_distribution<double> normal;
    const int n = first.back();
    MatrixXd m = MatrixXd::Zero(n, n);
    for (const SparseBlock& b : blocks)
      for (int j = first[b.column]; j < first[b.column + 1]; ++j)
        for (int i = first[b.row]; i < first[b.row + 1]; ++i) m(i, j) = m(j, i) = normal(engine);
    for (int i = 0; i < n; ++i) m(i, i) = m.row(i).cwiseAbs().sum() + 0.1;
    return m;
  }
};

void compare(const Pattern& pattern, std::mt19937& engine) {
  std::vector<int> order(pattern.below.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  std::shuffle(order.begin(), order.end(), engine);
  SparseCholesky sparse(pattern.first, pattern.blocks, pattern.start, order);
  for (int again = 0; again < 3; ++again) {
    const MatrixXd m = pattern.draw(engine);
    REQUIRE(sparse.factor(pattern.values(m).data()));
    const VectorXd b = VectorXd::LinSpaced(m.rows(), -1, 2);
    VectorXd x = b;
    sparse.solve(x.data());
    CHECK((x - fixture::dense::llt_solve(m, b)).norm() < 1e-12 * x.norm());
  }
}

std::vector<int> sizes(int runs, int largest, std::mt19937& engine) {
  std::vector<int> out(runs);
  for (int& size : out) size = std::uniform_int_distribution<int>(1, largest)(engine);
  return out;
}

}  // namespace

TEST_CASE("sparse Cholesky: agrees with a dense one on any pattern") {
  std::mt19937 engine(1);
  for (const int runs : {1, 2, 3, 7, 30})
    for (const int largest : {1, 9, 40}) {
      std::vector<std::pair<int, int>> ring, tree, all, pieces;
      for (int r = 0; r < runs; ++r) {
        ring.push_back({r, (r + 1) % runs});
        if (r > 0) tree.push_back({r, static_cast<int>(engine() % static_cast<unsigned>(r))});
        for (int q = 0; q < r; ++q) all.push_back({q, r});
        if (r > 2) pieces.push_back({r, r - 3});
      }
      std::vector<std::pair<int, int>> random;
      for (int k = 0; k < 2 * runs; ++k)
        random.push_back({static_cast<int>(engine() % static_cast<unsigned>(runs)),
                          static_cast<int>(engine() % static_cast<unsigned>(runs))});
      for (const auto& couples : {ring, tree, all, pieces, random, {}}) {
        CAPTURE(runs, largest, couples.size());
        compare(Pattern(sizes(runs, largest, engine), couples), engine);
      }
    }
}

TEST_CASE("sparse Cholesky: a grid, as of cameras over a field") {
  std::mt19937 engine(2);
  std::vector<std::pair<int, int>> couples;
  const auto at = [](int x, int y) { return 12 * y + x; };
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 12; ++x) {
      if (x > 0) couples.push_back({at(x, y), at(x - 1, y)});
      if (y > 0) couples.push_back({at(x, y), at(x, y - 1)});
      if (x > 0 && y > 0) couples.push_back({at(x, y), at(x - 1, y - 1)});
    }
  compare(Pattern(std::vector<int>(144, 9), couples), engine);
}

TEST_CASE("sparse Cholesky: what is not positive definite is refused, what is not a number too") {
  std::mt19937 engine(3);
  const Pattern pattern({5, 20, 3, 17}, {{0, 1}, {1, 2}, {2, 3}});
  SparseCholesky sparse(pattern.first, pattern.blocks, pattern.start, {0, 1, 2, 3});
  const MatrixXd good = pattern.draw(engine);
  for (int i = 0; i < good.rows(); ++i)
    for (const double bad : {-1.0, 0.0, std::numeric_limits<double>::quiet_NaN()}) {
      MatrixXd m = good;
      m(i, i) = bad;
      CHECK_FALSE(sparse.factor(pattern.values(m).data()));
    }
  CHECK(sparse.factor(pattern.values(good).data()));
}

}  // namespace sparse_cholesky_test
