// solver/reduced_system.h: where numbers stand, elimination into it and factorisation, dense and
// CHOLMOD, against plain dense matrices.
//
// Proves, for random groups over runs of different sizes (groups that share runs, that have no
// privates, that touch nothing; columns that nobody touches; runs of 9 throughout): add(),
// subtract() with and without an array of diagonal blocks, origin(), diagonal_origin(),
// add_diagonal_blocks(), accumulate(), clear() and add_to_diagonal() mean the same matrix; nothing
// is written behind the arrays; the solution is that of a plain Cholesky; an indefinite matrix is
// refused and does no harm to the next; what `automatic` chooses; a pool factors to the same bits
// as one thread. Does not prove: anything about time or fill.
#include <Eigen/Cholesky>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <set>

#include "../../solver/kernels.h"
#include "../../solver/reduced_system.h"
#include "../../solver/threads.h"
#include "../fixtures/dense.h"
#include "../fixtures/random.h"

namespace reduced_system_test {

using namespace kincal;
using namespace kincal::fixture;
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

namespace {

constexpr double kGuard = 777.25;

struct Structure {
  int n = 0;
  std::vector<GroupShape> groups;
  std::vector<int>
      run_first;  // by column: first column of the columns around it that the same groups touch
  std::vector<int> run_size;
};

/// `sizes`: blocks of columns that groups touch as a whole; blocks may turn out to have the same
/// groups, so that runs are longer.
Structure make(const std::vector<int>& sizes, int groups, int most, int depth, Random& random) {
  Structure s;
  std::vector<int> start;
  for (const int size : sizes) {
    start.push_back(s.n);
    s.n += size;
  }
  const int blocks = static_cast<int>(sizes.size());
  for (int g = 0; g < groups; ++g) {
    GroupShape shape;
    shape.private_size = random.uniform() < 0.2 ? 0 : depth;
    std::set<int> touched;
    const int count = static_cast<int>(random.uniform() * (most + 1));
    const int first = static_cast<int>(random.uniform() * blocks);
    for (int k = 0; k < count; ++k)
      touched.insert((first + static_cast<int>(random.uniform() * 2 * most)) % blocks);
    if (g % 5 == 4) s.groups.push_back(s.groups[g - 1]);  // sees exactly what the one before sees
    if (g % 5 == 4) continue;
    for (const int b : touched)
      for (int q = 0; q < sizes[b]; ++q) shape.columns.push_back(start[b] + q);
    shape.rows = 10;
    s.groups.push_back(shape);
  }
  std::vector<std::vector<int>> touching(s.n);
  for (int g = 0; g < groups; ++g)
    for (const int c : s.groups[g].columns) touching[c].push_back(g);
  for (int c = 0; c < s.n; ++c)
    s.run_first.push_back(c > 0 && touching[c] == touching[c - 1] ? s.run_first[c - 1] : c);
  for (int c = 0; c < s.n; ++c)
    s.run_size.push_back(
        static_cast<int>(std::count(s.run_first.begin(), s.run_first.end(), s.run_first[c])));
  return s;
}

struct Array {
  std::vector<double> all;
  size_t size;
  explicit Array(size_t n) : all(n + 16, kGuard), size(n) { std::fill_n(all.begin(), n, 0.0); }
  double* data() { return all.data(); }
  bool untouched() const {
    return std::all_of(all.begin() + static_cast<std::ptrdiff_t>(size), all.end(),
                       [](double x) { return x == kGuard; });
  }
};

double difference(const MatrixXd& a, const MatrixXd& b) {
  return a.size() ? (a - b).cwiseAbs().maxCoeff() : 0;
}

void check(const Structure& s, int depth, bool light, Random& random) {
  const int n = s.n;
  MatrixXd expected = MatrixXd::Zero(n, n), eliminated = expected;
  VectorXd expected_gradient = VectorXd::Zero(n);
  std::vector<MatrixXd> c, b;
  for (const GroupShape& g : s.groups) {
    const Eigen::Index m = static_cast<Eigen::Index>(g.columns.size());
    const MatrixXd root = MatrixXd::NullaryExpr(m + 2, m, [&] { return random.normal(); });
    c.push_back(root.transpose() * root);
    b.push_back(MatrixXd::NullaryExpr(g.private_size ? depth : 0, m + 1,
                                      [&] { return 0.3 * random.normal(); }));
    const MatrixXd away = b.back().transpose() * b.back();
    for (Eigen::Index i = 0; i < m; ++i) {
      expected_gradient(g.columns[i]) -= away(i, m);
      for (Eigen::Index j = 0; j < m; ++j) {
        expected(g.columns[i], g.columns[j]) += c.back()(i, j);
        eliminated(g.columns[i], g.columns[j]) -= away(i, j);
      }
    }
  }
  VectorXd solution[2];
  for (const LinearSolver choice : {LinearSolver::dense, LinearSolver::cholmod}) {
    INFO((choice == LinearSolver::dense ? "dense" : "cholmod")
         << ", " << n << " columns, depth " << depth << ", light " << light);
    ReducedSystem system(n, s.groups, choice, {light});
    CHECK(system.dense() == (choice == LinearSolver::dense || n == 0));
    CHECK(std::string(system.name()) == (system.dense() ? "dense" : "cholmod"));
    Array values(system.storage()), other(system.storage()),
        in_blocks(system.in_blocks() ? system.block_storage() : 0), gradient(n);

    // C.
    for (size_t g = 0; g < s.groups.size(); ++g) {
      const std::vector<int>& columns = s.groups[g].columns;
      const int m = static_cast<int>(columns.size()), ld = m + 3;
      if (system.dense()) {
        for (int j = 0; j < m; ++j)
          for (int i = j; i < m; ++i)
            values.data()[system.origin()[columns[j]] + columns[i]] += c[g](i, j);
        continue;
      }
      MatrixXd block = MatrixXd::Constant(ld, m + 1, std::nan(""));
      for (int j = 0; j < m; ++j)
        for (int i = j; i < m; ++i) block(i, j) = c[g](i, j);  // the lower triangle only
      if (!system.in_blocks()) system.add(static_cast<int>(g), block.data(), ld, values.data());
    }
    if (!system.dense() && system.in_blocks()) expected.setZero();  // there is no add() then
    CHECK(difference(system.full(values.data()), expected) < 1e-11);

    // Minus B'B.
    for (size_t g = 0; g < s.groups.size(); ++g) {
      if (b[g].rows() == 0) continue;
      const int m = static_cast<int>(s.groups[g].columns.size()), stride = padded(m + 1) + 8;
      RowMatrix rows = RowMatrix::Constant(depth + 1, stride, 3.5);
      rows.topLeftCorner(depth, m + 1) = b[g];
      if (system.in_blocks())
        system.subtract_blocks(static_cast<int>(g), rows.data(), stride, in_blocks.data(),
                               gradient.data());
      else
        system.subtract(static_cast<int>(g), rows.data(), depth, stride, other.data(),
                        gradient.data());
    }
    if (system.in_blocks()) {  // of two shares, in parts; what is there is overwritten
      std::vector<double> half(in_blocks.data(), in_blocks.data() + system.block_storage());
      for (double& v : half) v *= 0.5;
      const double* const sums[] = {half.data(), half.data()};
      for (size_t i = 0; !system.dense() && i < system.storage() - kSlack; ++i)
        other.data()[i] = std::nan("");
      for (int part = 0; part < 3; ++part) system.put_blocks(other.data(), sums, 2, {part, 3});
    }
    CHECK(difference(system.full(other.data()), eliminated) < 1e-11);
    for (int i = 0; i < n; ++i) CHECK(std::abs(gradient.data()[i] - expected_gradient(i)) < 1e-11);
    system.accumulate(values.data(), other.data());
    CHECK(difference(system.full(values.data()), expected + eliminated) < 1e-11);
    const double lift =
        !system.dense() && system.in_blocks() ? 100 : 0.5;  // without C the rest is negative
    for (int i = 0; i < n; ++i) system.add_to_diagonal(values.data(), i, lift + i);
    MatrixXd whole = expected + eliminated;
    for (int i = 0; i < n; ++i) whole(i, i) += lift + i;
    CHECK(difference(system.full(values.data()), whole) < 1e-10);

    // Entries of one run by origin() and diagonal_origin().
    Array single(system.storage()), blocks(system.diagonal_storage());
    MatrixXd entries = MatrixXd::Zero(n, n);
    std::set<std::ptrdiff_t> places, block_places;
    size_t squares = 0;
    for (int j = 0; j < n; ++j) {
      squares += s.run_size[j];
      for (int i = j; i < s.run_first[j] + s.run_size[j]; ++i) {
        entries(i, j) = entries(j, i) = 1 + i + 1000 * j;
        const std::ptrdiff_t at = system.origin()[j] + i,
                             in_block = system.diagonal_origin()[j] + i;
        REQUIRE((at >= 0 && at < static_cast<std::ptrdiff_t>(system.storage())));
        REQUIRE(
            (in_block >= 0 && in_block < static_cast<std::ptrdiff_t>(system.diagonal_storage())));
        places.insert(at);
        block_places.insert(in_block);
        single.data()[at] = 1 + i + 1000 * j;
        blocks.data()[in_block] = 1 + i + 1000 * j;
      }
    }
    CHECK(system.diagonal_storage() == squares);
    CHECK(places.size() == block_places.size());
    CHECK(difference(system.full(single.data()), entries) == 0);
    system.clear(single.data());
    CHECK(difference(system.full(single.data()), MatrixXd::Zero(n, n)) == 0);
    system.add_diagonal_blocks(single.data(), blocks.data());
    CHECK(difference(system.full(single.data()), entries) == 0);

    // Factors: one that is refused, then twice one that is not.
    ThreadPool alone(1);
    if (n > 0) {
      std::vector<double> indefinite = values.all;
      system.add_to_diagonal(indefinite.data(), n / 2, -whole(n / 2, n / 2) - 1);
      CHECK_FALSE(system.factor(indefinite.data(), alone));
    }
    const VectorXd right = VectorXd::NullaryExpr(n, [&] { return random.normal(); });
    REQUIRE((n == 0 || fixture::dense::is_positive(whole)));
    for (int again = 0; again < 2; ++again) {
      std::vector<double> factored = values.all;
      REQUIRE(system.factor(factored.data(), alone));
      std::vector<double> x(right.data(), right.data() + n);
      x.resize(n + kSlack, 0.0);
      system.solve(factored.data(), x.data());
      const VectorXd found = Eigen::Map<VectorXd>(x.data(), n);
      if (n > 0)
        CHECK((whole * found - right).norm() <
              1e-10 * (right.norm() + whole.norm() * found.norm()) * 1e-3 + 1e-12 * right.norm());
      if (n > 0)
        CHECK((found - fixture::dense::llt_solve(whole, right)).norm() < 1e-9 * found.norm());
    }
    CHECK(values.untouched());
    CHECK(other.untouched());
    CHECK(in_blocks.untouched());
    CHECK(gradient.untouched());
  }
}

}  // namespace

TEST_CASE("reduced system: random groups over runs of different sizes") {
  Random random(951);
  for (int trial = 0; trial < 60; ++trial) {
    INFO("trial " << trial);
    std::vector<int> sizes;
    const int blocks = 1 + static_cast<int>(random.uniform() * 12);
    for (int k = 0; k < blocks; ++k)
      sizes.push_back(1 + static_cast<int>(random.uniform() * (trial % 3 == 0 ? 3 : 14)));
    const int depth = trial % 4 == 0 ? 3 : 1 + static_cast<int>(random.uniform() * 17);
    const Structure s =
        make(sizes, 1 + static_cast<int>(random.uniform() * 25), 1 + trial % 7, depth, random);
    check(s, depth, false, random);
    check(s, depth, true, random);
  }
}

TEST_CASE("reduced system: cameras of nine numbers") {
  Random random(952);
  for (const int cameras : {1, 2, 5, 14})
    for (const int groups : {1, 3, 40}) {
      INFO(cameras << " cameras, " << groups << " groups");
      const Structure s = make(std::vector<int>(cameras, 9), groups, 5, 3, random);
      check(s, 3, true, random);
      check(s, 3, false, random);
      // Every camera alone: no two of them have the same points.
      Structure apart = s;
      for (int k = 0; k < cameras; ++k) {
        GroupShape one;
        one.private_size = 3;
        one.rows = 4;
        for (int q = 0; q < 9; ++q) one.columns.push_back(9 * k + q);
        apart.groups.push_back(one);
      }
      apart.run_first.clear();
      for (int i = 0; i < 9 * cameras; ++i) apart.run_first.push_back(9 * (i / 9));
      apart.run_size.assign(9 * cameras, 9);
      check(apart, 3, true, random);
      check(apart, 3, false, random);
    }
}

TEST_CASE("reduced system: nothing, nobody, and one column") {
  Random random(953);
  Structure s;
  check(s, 3, true, random);
  s.groups.push_back({3, {}, 4});
  check(s, 3, false, random);
  Structure untouched;
  untouched.n = 7;
  untouched.groups.push_back({3, {}, 4});
  untouched.run_first.assign(7, 0);
  untouched.run_size.assign(7, 7);
  check(untouched, 3, true, random);
  check(untouched, 2, false, random);
  Structure one;
  one.n = 1;
  one.groups.push_back({5, {0}, 9});
  one.run_first = {0};
  one.run_size = {1};
  check(one, 5, true, random);
}

TEST_CASE(
    "reduced system: automatic is dense up to 400 unknowns or with more than 30 % of the entries") {
  const auto banded = [](int runs, int width, int size) {
    std::vector<GroupShape> groups;
    for (int r = 0; r + width <= runs; ++r) {
      GroupShape g;
      g.private_size = 3;
      g.rows = 10;
      for (int c = r * size; c < (r + width) * size; ++c) g.columns.push_back(c);
      groups.push_back(g);
    }
    return groups;
  };
  const auto small = banded(40, 2, 10);
  CHECK(ReducedSystem(400, small, LinearSolver::automatic).dense());
  const auto large = banded(41, 2, 10);
  CHECK_FALSE(ReducedSystem(410, large, LinearSolver::automatic).dense());
  const auto full = banded(41, 20, 10);
  CHECK(ReducedSystem(410, full, LinearSolver::automatic).dense());
  CHECK(ReducedSystem(410, large, LinearSolver::dense).dense());
  CHECK_FALSE(ReducedSystem(400, small, LinearSolver::cholmod).dense());
  // Priors of all unknowns couple nothing.
  auto with_priors = large;
  with_priors.push_back({});
  for (int c = 0; c < 410; ++c) with_priors.back().columns.push_back(c);
  CHECK(ReducedSystem(410, with_priors, LinearSolver::automatic).dense());
  CHECK_FALSE(ReducedSystem(410, with_priors, LinearSolver::automatic,
                            {false, static_cast<int>(large.size())})
                  .dense());
}

TEST_CASE("reduced system: a crew factors a large dense system to the same bits") {
  Random random(41);
  for (const int n : {301, 336, 441}) {
    const RowMatrix a = RowMatrix::NullaryExpr(n, n + 20, [&] { return random.normal(); });
    const MatrixXd whole = a * a.transpose();
    GroupShape group;
    for (int c = 0; c < n; ++c) group.columns.push_back(c);
    group.rows = n;
    const std::vector<GroupShape> groups = {group};
    ReducedSystem system(n, groups, LinearSolver::dense);
    std::vector<double> values(system.storage(), 0.0);
    for (int j = 0; j < n; ++j)
      for (int i = j; i < n; ++i) values[system.origin()[j] + i] = whole(i, j);
    ThreadPool alone(1);
    std::vector<double> expected = values;
    REQUIRE(system.factor(expected.data(), alone));
    for (const int threads : {2, 3, 7}) {
      ThreadPool pool(threads);
      std::vector<double> factored = values, indefinite = values;
      system.add_to_diagonal(indefinite.data(), n - 60, -whole(n - 60, n - 60) - 1);
      CHECK_FALSE(system.factor(indefinite.data(), pool));
      REQUIRE(system.factor(factored.data(), pool));
      bool same = true;
      for (int j = 0; j < n; ++j)
        for (int i = j; i < n; ++i)
          same = same && factored[system.origin()[j] + i] == expected[system.origin()[j] + i];
      CHECK(same);
    }
  }
}

}  // namespace reduced_system_test
