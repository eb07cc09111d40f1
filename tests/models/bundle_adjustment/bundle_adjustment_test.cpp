// models/bundle_adjustment/bundle_adjustment.h against the formulas of its head written down a
// second time, with plain loops and dense algebra.
//
// Proves: cost; every entry of the rows of square_root() by central differences along retract();
// linearise() after prepare_range(), anywhere in a range, writes the normal equations of these
// rows, with one camera a block and with blocks of several cameras, and recompute_rows() what it
// says; evaluate_range() sums; infinite residuals are undefined; wrong arguments are refused by
// name; unpack() goes back; points and cameras without observations do no harm; exact data lead to
// a cost of nothing, noisy ones to the minimum of a dense Gauss-Newton; dense and CHOLMOD agree,
// also where cameras see exactly the same points; any number of threads gives the same bits. Does
// not prove: speed, nor problems of benchmark size; instruction sets other than the one in use
// (CMakeLists.txt repeats these tests).
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <limits>
#include <set>

#include "../../../models/bundle_adjustment/bundle_adjustment.h"
#include "../../../solver/kernels.h"
#include "../../../solver/levenberg_marquardt.h"
#include "../../fixtures/dense.h"
#include "../../fixtures/forward_model.h"
#include "../../fixtures/random.h"
#include "../../fixtures/rigs.h"
#include "../../fixtures/samples.h"
#include "../../fixtures/transforms.h"

namespace bundle_adjustment_test {

using namespace kincal;
using namespace kincal::fixture;

namespace {

using Vector9d = Eigen::Matrix<double, 9, 1>;

/// The head's formulas. `camera`: rotation vector, translation, f, k1, k2.
Vector2d predicted(const double* camera, const double* point) {
  const Vector3d w(camera[0], camera[1], camera[2]);
  const double angle = w.norm();
  const Matrix3d r = angle > 0 ? Eigen::AngleAxisd(angle, w / angle).toRotationMatrix()
                               : Matrix3d(Matrix3d::Identity());
  const Vector3d p =
      r * Vector3d(point[0], point[1], point[2]) + Vector3d(camera[3], camera[4], camera[5]);
  const Vector2d q = -p.head<2>() / p.z();
  const double s = q.squaredNorm();
  return camera[6] * (1 + camera[7] * s + camera[8] * s * s) * q;
}

double plain_cost(const BundleAdjustmentData& d) {  // twice the cost
  double sum = 0;
  for (size_t i = 0; i < d.camera_of.size(); ++i)
    sum += (predicted(&d.cameras[9 * d.camera_of[i]], &d.points[3 * d.point_of[i]]) -
            Vector2d(d.pixels[2 * i], d.pixels[2 * i + 1]))
               .squaredNorm();
  return sum;
}

/// Cameras around a cloud of points, exact pixels, observations in random order. `sees(camera,
/// point)` chooses.
template <class Sees>
BundleAdjustmentData make(int cameras, int points, unsigned long seed, const Sees& sees) {
  Random random(seed);
  BundleAdjustmentData d;
  for (int c = 0; c < cameras; ++c) {
    const Matrix3d r = random.rotation(3);
    const Vector3d w = rotation_vector(r);
    d.cameras.insert(d.cameras.end(),
                     {w.x(), w.y(), w.z(), random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5),
                      random.uniform(-7, -5), random.uniform(400, 600), random.uniform(-0.1, 0.1),
                      random.uniform(-0.02, 0.02)});
  }
  for (int p = 0; p < points; ++p) {
    const Vector3d at = random.vector(1.2);
    d.points.insert(d.points.end(), {at.x(), at.y(), at.z()});
  }
  std::vector<std::pair<int, int>> seen;
  for (int c = 0; c < cameras; ++c)
    for (int p = 0; p < points; ++p)
      if (sees(c, p)) seen.push_back({c, p});
  for (size_t i = seen.size(); i > 1; --i)
    std::swap(seen[i - 1], seen[static_cast<size_t>(random.uniform() * static_cast<double>(i))]);
  for (const auto& [c, p] : seen) {
    d.camera_of.push_back(c);
    d.point_of.push_back(p);
    const Vector2d pixel = predicted(&d.cameras[9 * c], &d.points[3 * p]);
    d.pixels.insert(d.pixels.end(), {pixel.x(), pixel.y()});
  }
  return d;
}
BundleAdjustmentData everything_seen(int cameras, int points, unsigned long seed) {
  return make(cameras, points, seed, [](int, int) { return true; });
}

BundleAdjustmentData noisy(BundleAdjustmentData d, double pixel, double start, unsigned long seed) {
  Random random(seed);
  const double size[9] = {0.01, 0.01, 0.01, 0.05, 0.05, 0.05, 10, 0.01, 0.003};
  for (double& p : d.pixels) p += pixel * random.normal();
  for (size_t i = 0; i < d.cameras.size(); ++i)
    d.cameras[i] += start * size[i % 9] * random.normal();
  for (double& p : d.points) p += start * 0.05 * random.normal();
  return d;
}

VectorXd random_vector(Eigen::Index n, double size, Random& random) {
  VectorXd v(n);
  for (Eigen::Index i = 0; i < n; ++i) v(i) = random.uniform(-size, size);
  return v;
}

Cost total(const BundleAdjustment& problem, const VectorXd& state) {
  Cost sum, one;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    REQUIRE(problem.evaluate(static_cast<int>(g), state, 0, one));
    sum.doubled += one.doubled;
    sum.chi2 += one.chi2;
  }
  return sum;
}

/// [J_point J_cameras r] of a group by central differences along retract(), observation after
/// observation.
MatrixXd numeric_rows(const BundleAdjustment& problem, const BundleAdjustmentData& d, int group,
                      const VectorXd& state) {
  const GroupShape& shape = problem.groups()[group];
  std::vector<size_t> seen;  // of this point, by camera
  for (size_t i = 0; i < d.camera_of.size(); ++i)
    if (d.point_of[i] == group) seen.push_back(i);
  std::sort(seen.begin(), seen.end(),
            [&](size_t a, size_t b) { return d.camera_of[a] < d.camera_of[b]; });
  const auto residuals = [&](const VectorXd& x) {
    std::vector<double> cameras, points;
    problem.unpack(x, cameras, points);
    VectorXd r(2 * static_cast<Eigen::Index>(seen.size()));
    for (size_t k = 0; k < seen.size(); ++k)
      r.segment<2>(2 * static_cast<Eigen::Index>(k)) =
          predicted(&cameras[9 * d.camera_of[seen[k]]], &points[3 * group]) -
          Vector2d(d.pixels[2 * seen[k]], d.pixels[2 * seen[k] + 1]);
    return r;
  };
  MatrixXd rows(2 * static_cast<Eigen::Index>(seen.size()), shape.size() + 1);
  const int points = static_cast<int>(problem.groups().size());
  for (int c = 0; c < shape.size(); ++c)
    rows.col(c) = derivative(
        [&](double h) {
          VectorXd shared = VectorXd::Zero(problem.shared_size()), own = VectorXd::Zero(3 * points),
                   moved;
          (c < 3 ? own(3 * group + c) : shared(shape.columns[c - 3])) = h;
          problem.retract(state, shared, own, moved);
          return residuals(moved);
        },
        1e-3);
  rows.rightCols(1) = residuals(state);
  return rows;
}

/// The normal equations of one group as linearise() writes them, the cameras' blocks of `block`
/// cameras each on the diagonal: [private touched r], lower triangle; entries between cameras of
/// different blocks are not there.
MatrixXd light_equations(const BundleAdjustment& problem, int group, const VectorXd& state,
                         int block, Cost& cost) {
  const GroupShape& shape = problem.groups()[group];
  const int n = problem.shared_size(), m = static_cast<int>(shape.columns.size()),
            size = shape.size(), stride = 3 + padded(m + 1);
  std::vector<double> rows(3 * static_cast<size_t>(stride) + kSlack, 0.0);
  std::vector<std::ptrdiff_t> origin(n);
  std::ptrdiff_t storage = 0;
  for (int first = 0; first < n; first += 9 * block) {
    const int width = std::min(9 * block, n - first);
    for (int q = 0; q < width; ++q, storage += width) origin[first + q] = storage - first;
  }
  std::vector<double> shared(static_cast<size_t>(storage) + kSlack, 0.0);
  VectorXd gradient = VectorXd::Zero(n + kSlack);
  REQUIRE(problem.linearise(
      group, state, 0,
      {rows.data(), stride, shared.data(), origin.data(), shape.columns.data(), gradient.data()},
      cost));
  MatrixXd gram = MatrixXd::Zero(size + 1, size + 1);
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) gram(j, i) = rows[static_cast<size_t>(i) * stride + j];
    for (int j = 3; j <= size; ++j) gram(j, i) = rows[static_cast<size_t>(i) * stride + j];
  }
  std::set<int> touched(shape.columns.begin(), shape.columns.end());
  for (int a = 0; a < m; ++a) {
    const int ca = shape.columns[a];
    gram(size, 3 + a) = gradient(ca);
    for (int b = a; b < m && shape.columns[b] / 9 == ca / 9; ++b)
      gram(3 + b, 3 + a) = shared[origin[ca] + shape.columns[b]];
  }
  for (int c = 0; c < n; ++c)  // nobody else's numbers
    if (!touched.count(c)) {
      CHECK(gradient(c) == 0);
      CHECK(shared[origin[c] + c] == 0);
    }
  return gram;
}

}  // namespace

TEST_CASE("bundle adjustment: cost, derivatives, equations, condensation") {
  Random random(801);
  for (const int cameras : {1, 2, 3, 7, 8, 11}) {
    const auto d =
        noisy(make(cameras, 70, 802 + cameras,
                   [&](int c, int p) { return c == p % cameras || (c * 7 + p * 3) % 5 < 3; }),
              2, 1, 803);
    BundleAdjustment problem(d);
    problem.set_workers(1);
    CHECK(problem.shared_size() == 9 * cameras);
    REQUIRE(problem.groups().size() == 70);
    VectorXd state = problem.initial(), moved;
    INFO(cameras << " cameras");
    CHECK(total(problem, state).doubled == Approx(plain_cost(d)).epsilon(1e-12));
    problem.retract(state, random_vector(9 * cameras, 0.01, random),
                    random_vector(210, 0.05, random), moved);
    state = moved;
    BundleAdjustmentData there = d;
    problem.unpack(state, there.cameras, there.points);
    CHECK(total(problem, state).doubled == Approx(plain_cost(there)).epsilon(1e-12));
    CHECK(total(problem, state).chi2 == Approx(plain_cost(there)).epsilon(1e-12));
    problem.prepare(state);
    CHECK_FALSE(problem.renew(state));

    // Sums of ranges, added to what is there.
    for (const auto& [first, last] :
         std::vector<std::pair<int, int>>{{0, 70}, {0, 1}, {3, 3}, {17, 41}, {69, 70}}) {
      Cost sum, one, range;
      range.doubled = range.chi2 = 5;
      for (int g = first; g < last; ++g) {
        REQUIRE(problem.evaluate(g, state, 0, one));
        sum.doubled += one.doubled;
        sum.chi2 += one.chi2;
      }
      REQUIRE(problem.evaluate_range(first, last, state, 0, range));
      CHECK(range.doubled == Approx(sum.doubled + 5).epsilon(1e-12));
      CHECK(range.chi2 == Approx(sum.chi2 + 5).epsilon(1e-12));
    }

    const VectorXd step = random_vector(9 * cameras + kSlack, 1, random);
    for (const auto& [first, last] :
         std::vector<std::pair<int, int>>{{0, 64}, {64, 70}, {5, 6}, {6, 70}}) {
      for (int g = first; g < last; g += 1 + (last - first) / 9) {
        INFO("range " << first << " to " << last << ", point " << g);
        const GroupShape& shape = problem.groups()[g];
        const MatrixXd numeric = numeric_rows(problem, d, g, state);
        MatrixXd rows;
        REQUIRE(problem.square_root(g, state, 0, rows));
        CHECK(shape.rows == numeric.rows());
        REQUIRE((rows.rows() == numeric.rows() && rows.cols() == numeric.cols()));
        CHECK((rows.rightCols(1) - numeric.rightCols(1)).cwiseAbs().maxCoeff() < 1e-9);
        for (Eigen::Index c = 0; c < shape.size(); ++c)
          CHECK((rows.col(c) - numeric.col(c)).cwiseAbs().maxCoeff() <=
                1e-8 * numeric.col(c).cwiseAbs().maxCoeff() + 1e-9);

        for (const int block : {1, 2, 3}) {
          problem.prepare_range(first, last, state, 0);
          Cost cost, evaluated;
          const MatrixXd gram = light_equations(problem, g, state, block, cost),
                         expected = rows.transpose() * rows;
          REQUIRE(problem.evaluate(g, state, 0, evaluated));
          CHECK(cost.doubled == Approx(evaluated.doubled).epsilon(1e-13));
          CHECK(cost.chi2 == Approx(evaluated.chi2).epsilon(1e-13));
          const VectorXd scale = expected.diagonal().cwiseSqrt();
          double worst = 0;
          for (int j = 0; j < shape.size(); ++j)
            for (int i = j; i <= shape.size(); ++i) {
              if (j >= 3 && i < shape.size() && (i - 3) / 9 != (j - 3) / 9)
                continue;  // met through the point only
              worst = std::max(
                  worst, std::abs(gram(i, j) - expected(i, j)) / (scale(i) * scale(j) + 1e-300));
            }
          CHECK(worst < 1e-13);
        }

        problem.prepare_range(first, last, state, 0);
        // Of the whole range; the group's rows are among them.
        std::vector<double> range(15 * static_cast<size_t>(last - first) + kSlack, 7.0);
        problem.recompute_rows(first, last, state, step, 0, range.data());
        const double* condensed = range.data() + 15 * static_cast<size_t>(g - first);
        VectorXd touched(shape.columns.size());
        for (size_t c = 0; c < shape.columns.size(); ++c)
          touched(static_cast<Eigen::Index>(c)) = step(shape.columns[c]);
        const MatrixXd x = rows.leftCols(3), q = rows.middleCols(3, touched.size());
        const VectorXd r = rows.rightCols(1), moving = q * touched;
        const double size =
            (x.norm() + r.norm() + moving.norm()) * (x.norm() + r.norm() + moving.norm());
        for (int i = 0; i < 3; ++i) {
          for (int j = i; j < 3; ++j)
            CHECK(std::abs(condensed[5 * i + j] - x.col(i).dot(x.col(j))) < 1e-13 * size);
          CHECK(std::abs(condensed[5 * i + 3] - x.col(i).dot(r)) < 1e-13 * size);
          CHECK(std::abs(condensed[5 * i + 4] - x.col(i).dot(r + moving)) < 1e-13 * size);
        }
      }
    }
  }
}

TEST_CASE("bundle adjustment: packs of every fill") {
  for (int seen = 0; seen <= 20; ++seen) {
    const auto d =
        noisy(make(24, 1, 811 + seen, [&](int c, int) { return c % 24 < seen; }), 3, 1, 812);
    BundleAdjustment problem(d);
    problem.set_workers(1);
    Cost cost;
    REQUIRE(problem.evaluate(0, problem.initial(), 0, cost));
    CHECK(cost.doubled == Approx(plain_cost(d)).epsilon(1e-12).margin(1e-300));
    MatrixXd rows;
    REQUIRE(problem.square_root(0, problem.initial(), 0, rows));
    CHECK(rows.rows() == 2 * seen);
    CHECK(rows.cols() == 4 + 9 * seen);
    if (seen > 0) CHECK(rows.rightCols(1).squaredNorm() == Approx(cost.doubled).epsilon(1e-12));
  }
}

TEST_CASE("bundle adjustment: what is infinitely far away is undefined") {
  for (const int bad : {0, 3, 12}) {
    auto d = everything_seen(5, 13, 821);
    // The point stands in the plane of camera 2's centre: without rotation and translation, at z =
    // 0 exactly.
    for (int k = 0; k < 6; ++k) d.cameras[18 + k] = 0;
    for (int p = 0; p < 13; ++p) d.points[3 * p + 2] -= 4;  // the others before it
    d.points[3 * bad + 2] = 0;
    BundleAdjustment problem(d);
    problem.set_workers(2);
    const VectorXd state = problem.initial();
    Cost cost;
    for (int g = 0; g < 13; ++g) CHECK(problem.evaluate(g, state, 1, cost) == (g != bad));
    CHECK_FALSE(problem.evaluate_range(0, 13, state, 0, cost));
    MatrixXd rows;
    CHECK_FALSE(problem.square_root(bad, state, 0, rows));
    CHECK(problem.square_root((bad + 1) % 13, state, 0, rows));
    LevenbergMarquardt solver(problem, {});
    VectorXd x = state;
    const SolveSummary& summary = solver.solve(x);
    CHECK(summary.outcome == Outcome::undefined_start);
    CHECK(summary.undefined_group == bad);
    CHECK(x == state);

    VectorXd nan = BundleAdjustment(everything_seen(5, 13, 821)).initial();
    nan(16 * 5 + 4 * bad) = std::numeric_limits<double>::quiet_NaN();
    CHECK_FALSE(problem.evaluate(bad, nan, 0, cost));
  }
}

TEST_CASE("bundle adjustment: wrong arguments are refused by name") {
  const auto good = everything_seen(3, 4, 831);
  REQUIRE_NOTHROW(BundleAdjustment(good));
  const auto refused = [](const BundleAdjustmentData& d, const std::vector<std::string>& words) {
    try {
      BundleAdjustment problem(d);
      FAIL("not refused");
    } catch (const std::invalid_argument& e) {
      for (const std::string& word : words) {
        INFO(e.what());
        CHECK(std::string(e.what()).find(word) != std::string::npos);
      }
    }
  };
  auto d = good;
  d.camera_of[5] = 3;
  refused(d, {"observation 5", "camera 3"});
  d = good;
  d.camera_of[2] = -1;
  refused(d, {"observation 2", "camera -1"});
  d = good;
  d.point_of[11] = 4;
  refused(d, {"observation 11", "point 4"});
  d = good;
  d.point_of[0] = -7;
  refused(d, {"observation 0", "point -7"});
  d = good;
  d.cameras.pop_back();
  refused(d, {"9 numbers a camera"});
  d = good;
  d.points.push_back(1);
  refused(d, {"3 a point"});
  d = good;
  d.pixels.pop_back();
  refused(d, {"2 pixels an observation"});
  d = good;
  d.point_of.push_back(0);
  refused(d, {"one point"});
  d = good;
  d.camera_of.push_back(2);
  d.point_of.push_back(1);
  d.pixels.insert(d.pixels.end(), {1, 2});
  refused(d, {"camera 2", "point 1", "twice"});
}

TEST_CASE("bundle adjustment: unpack is the way back") {
  const auto d = everything_seen(6, 9, 841);
  const BundleAdjustment problem(d);
  std::vector<double> cameras(3, 7.0), points;
  problem.unpack(problem.initial(), cameras, points);
  REQUIRE((cameras.size() == d.cameras.size() && points.size() == d.points.size()));
  for (size_t i = 0; i < cameras.size(); ++i)
    CHECK(cameras[i] == Approx(d.cameras[i]).epsilon(1e-12).margin(1e-13));
  CHECK(points == d.points);
}

TEST_CASE("bundle adjustment: points and cameras that nobody observes stay where they are") {
  for (const LinearSolver choice :
       {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod}) {
    const auto d = noisy(make(6, 30, 851,
                              [](int c, int p) {
                                return c != 1 && c != 4 && c != 5 && p != 0 && p != 13 && p != 29;
                              }),
                         1, 1, 852);
    BundleAdjustment problem(d);
    SolverOptions options;
    options.linear_solver = choice;
    LevenbergMarquardt solver(problem, options);
    VectorXd state = problem.initial();
    const VectorXd before = state;
    const SolveSummary& summary = solver.solve(state);
    CHECK(summary.outcome == Outcome::converged);
    CHECK(summary.cost.doubled < summary.history.front().first);
    for (const int c : {1, 4, 5})
      CHECK((state - before).segment(16 * c, 15).cwiseAbs().maxCoeff() < 1e-15);
    for (const int p : {0, 13, 29}) CHECK((state - before).segment(16 * 6 + 4 * p, 3).isZero(0));
  }
  // Nothing at all.
  BundleAdjustmentData nothing;
  BundleAdjustment empty(nothing);
  CHECK(empty.shared_size() == 0);
  CHECK(empty.groups().empty());
  LevenbergMarquardt solver(empty, {});
  VectorXd state = empty.initial();
  CHECK(solver.solve(state).outcome == Outcome::converged);
}

TEST_CASE("bundle adjustment: exact data lead to a cost of nothing, dense and CHOLMOD") {
  for (const LinearSolver choice :
       {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod}) {
    const auto d = noisy(make(8, 60, 861, [](int c, int p) { return (c + p) % 8 < 5; }), 0, 1, 862);
    REQUIRE(plain_cost(d) > 1000);
    BundleAdjustment problem(d);
    SolverOptions options;
    options.linear_solver = choice;
    LevenbergMarquardt solver(problem, options);
    CHECK(std::string(solver.linear_solver()) == (choice == LinearSolver::dense    ? "dense"
                                                  : choice == LinearSolver::sparse ? "sparse"
                                                                                   : "cholmod"));
    VectorXd state = problem.initial();
    const SolveSummary& summary = solver.solve(state);
    INFO(summary.iterations << " iterations");
    CHECK(summary.outcome == Outcome::converged);
    CHECK(summary.cost.doubled < 1e-12);
    BundleAdjustmentData there = d;
    problem.unpack(state, there.cameras, there.points);
    CHECK(plain_cost(there) < 1e-12);
  }
}

namespace {

/// Minimum by dense, lightly damped Gauss-Newton from numeric derivatives of the formulas of the
/// head: 1/2 of what it returns is the cost.
double dense_minimum(BundleAdjustmentData d) {
  const Eigen::Index n = static_cast<Eigen::Index>(d.cameras.size() + d.points.size()),
                     m = static_cast<Eigen::Index>(d.pixels.size());
  double best = plain_cost(d), lambda = 1e-4;
  for (int iteration = 0; iteration < 200; ++iteration) {
    MatrixXd j = MatrixXd::Zero(m, n);
    VectorXd r(m);
    for (size_t i = 0; i < d.camera_of.size(); ++i) {
      double* camera = &d.cameras[9 * d.camera_of[i]];
      double* point = &d.points[3 * d.point_of[i]];
      const Eigen::Index row = 2 * static_cast<Eigen::Index>(i);
      r.segment<2>(row) = predicted(camera, point) - Vector2d(d.pixels[2 * i], d.pixels[2 * i + 1]);
      for (int k = 0; k < 12; ++k) {
        double& x = k < 9 ? camera[k] : point[k - 9];
        const double old = x;
        const VectorXd by = derivative(
            [&](double h) {
              x = old + h;
              return VectorXd(predicted(camera, point));
            },
            1e-3);
        x = old;
        j.block<2, 1>(row, k < 9 ? 9 * d.camera_of[i] + k
                                 : static_cast<Eigen::Index>(d.cameras.size()) + 3 * d.point_of[i] +
                                       k - 9) = by;
      }
    }
    const VectorXd scale = j.colwise().squaredNorm();
    for (bool better = false; !better;) {
      MatrixXd h = j.transpose() * j;
      h.diagonal() += lambda * scale;
      const VectorXd step = fixture::dense::ldlt_solve(h, -(j.transpose() * r));
      BundleAdjustmentData next = d;
      for (size_t k = 0; k < d.cameras.size(); ++k)
        next.cameras[k] += step(static_cast<Eigen::Index>(k));
      for (size_t k = 0; k < d.points.size(); ++k)
        next.points[k] += step(static_cast<Eigen::Index>(d.cameras.size() + k));
      const double cost = plain_cost(next);
      better = cost < best;
      if (!better) {
        lambda *= 10;
        if (lambda > 1e3) return best;
        continue;
      }
      const bool last = best - cost < 1e-13 * best;
      best = cost;
      d = next;
      lambda = std::max(lambda / 10, 1e-9);
      if (last) return best;
    }
  }
  return best;
}

}  // namespace

TEST_CASE("bundle adjustment: noisy data, the minimum of a dense solver") {
  for (const unsigned long seed : {871u, 872u, 873u}) {
    const auto d = noisy(everything_seen(4, 30, seed), 1, 0.5, seed + 10);
    const double expected = dense_minimum(d);
    CHECK(expected < 2 * 240);
    std::vector<double> costs;
    for (const LinearSolver choice :
         {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod}) {
      BundleAdjustment problem(d);
      SolverOptions options;
      options.linear_solver = choice;
      LevenbergMarquardt solver(problem, options);
      VectorXd state = problem.initial();
      const SolveSummary& summary = solver.solve(state);
      INFO("seed " << seed << ", " << summary.iterations << " iterations");
      CHECK(summary.outcome == Outcome::converged);
      CHECK(summary.cost.doubled == Approx(expected).epsilon(1e-8));
      BundleAdjustmentData there = d;
      problem.unpack(state, there.cameras, there.points);
      CHECK(plain_cost(there) == Approx(summary.cost.doubled).epsilon(1e-10));
      costs.push_back(summary.cost.doubled);
    }
    CHECK(costs[0] == Approx(costs[1]).epsilon(1e-9));
  }
}

TEST_CASE(
    "bundle adjustment: dense and CHOLMOD reduced systems are those of the whole Jacobian, also "
    "where cameras share all points") {
  struct {
    const char* what;
    bool (*sees)(int, int);
  } const cases[] = {
      {"cameras in a band", [](int c, int p) { return (p + 12 - c) % 12 < 4; }},
      {"pairs that see exactly the same", [](int c, int p) { return (p % 6 + 6 - c / 2) % 6 < 2; }},
      {"one pair, the others apart",
       [](int c, int p) { return c < 2 ? p % 3 == 0 : (p + c) % 4 < 2; }},
      {"all the same", [](int, int) { return true; }},
      {"one camera without points among them",
       [](int c, int p) { return c != 5 && (p * c) % 3 != 1; }}};
  for (const auto& c : cases) {
    INFO(c.what);
    const auto d = noisy(make(12, 150, 881, c.sees), 1, 0.5, 882);
    // By hand: Schur complement of the whole J'J.
    BundleAdjustment problem(d);
    problem.set_workers(1);
    const VectorXd start = problem.initial();
    MatrixXd expected = MatrixXd::Zero(108, 108);
    VectorXd expected_gradient = VectorXd::Zero(108);
    MatrixXd rows;
    for (int g = 0; g < 150; ++g) {
      if (problem.groups()[g].rows < 4) continue;
      REQUIRE(problem.square_root(g, start, 0, rows));
      const auto& columns = problem.groups()[g].columns;
      const MatrixXd gram = rows.transpose() * rows;
      const Eigen::Index m = static_cast<Eigen::Index>(columns.size());
      const MatrixXd rest =
          gram.bottomRightCorner(m + 1, m + 1) -
          gram.bottomLeftCorner(m + 1, 3) *
              gram.topLeftCorner<3, 3>().ldlt().solve(gram.topRightCorner(3, m + 1));
      for (Eigen::Index a = 0; a < m; ++a) {
        expected_gradient(columns[a]) += rest(a, m);
        for (Eigen::Index b = 0; b < m; ++b) expected(columns[a], columns[b]) += rest(a, b);
      }
    }
    const VectorXd scale = expected.diagonal().cwiseMax(1e-300).cwiseSqrt();
    VectorXd found[2];
    double cost[2];
    for (const int k : {0, 1}) {
      SolverOptions options;
      options.linear_solver = k ? LinearSolver::cholmod : LinearSolver::dense;
      LevenbergMarquardt solver(problem, options);
      MatrixXd matrix;
      VectorXd gradient;
      solver.reduced(start, matrix, gradient);
      REQUIRE(matrix.rows() == 108);
      double worst = 0;
      for (int i = 0; i < 108; ++i)
        for (int j = 0; j < 108; ++j) {
          if (expected(i, i) == 0) continue;  // unobserved: 1 on its diagonal
          worst = std::max(worst, std::abs(matrix(i, j) - expected(i, j)) / (scale(i) * scale(j)));
        }
      CHECK(worst < 1e-7);  // the elimination loses digits: parts are far larger than what is left
      found[k] = start;
      const SolveSummary& summary = solver.solve(found[k]);
      CHECK(summary.outcome == Outcome::converged);
      cost[k] = summary.cost.doubled;
    }
    CHECK(cost[0] == Approx(cost[1]).epsilon(1e-9));
  }
}

TEST_CASE("bundle adjustment: the same bits with any number of threads") {
  for (const bool pairs : {false, true})
    for (const LinearSolver choice :
         {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod}) {
      const auto d = noisy(make(20, 900, 891,
                                [&](int c, int p) {
                                  return pairs ? (p % 10 + 10 - c / 2) % 10 < 2
                                               : (p + 20 - c) % 20 < 3 + p % 4;
                                }),
                           1, 1, 892);
      VectorXd first;
      std::vector<std::pair<double, double>> history;
      for (const int threads : {1, 2, 3, 2, 5}) {
        BundleAdjustment problem(d);
        SolverOptions options;
        options.threads = threads;
        options.linear_solver = choice;
        options.max_iterations = 12;
        LevenbergMarquardt solver(problem, options);
        for (int again = 0; again < 2; ++again) {
          VectorXd state = problem.initial();
          const SolveSummary& summary = solver.solve(state);
          if (first.size() == 0) {
            first = state;
            history = summary.history;
            continue;
          }
          INFO(threads << " threads, " << (pairs ? "pairs" : "band") << ", solve " << again);
          REQUIRE(state.size() == first.size());
          CHECK(std::memcmp(state.data(), first.data(),
                            sizeof(double) * static_cast<size_t>(state.size())) == 0);
          CHECK(summary.history == history);
        }
      }
    }
}

TEST_CASE("bundle adjustment: points whose depth nobody knows do no harm") {
  // Every fourth point is seen by one camera only: it fits exactly, whatever its depth. The rest
  // must come out as without them.
  const auto full =
      noisy(make(5, 40, 895, [](int c, int p) { return p % 4 == 0 ? c == p / 4 % 5 : true; }), 1,
            0.3, 896);
  BundleAdjustmentData without = full;
  without.camera_of.clear();
  without.point_of.clear();
  without.pixels.clear();
  for (size_t i = 0; i < full.camera_of.size(); ++i) {
    if (full.point_of[i] % 4 == 0) continue;
    without.camera_of.push_back(full.camera_of[i]);
    without.point_of.push_back(full.point_of[i]);
    without.pixels.insert(without.pixels.end(), {full.pixels[2 * i], full.pixels[2 * i + 1]});
  }
  for (const LinearSolver choice :
       {LinearSolver::dense, LinearSolver::sparse, LinearSolver::cholmod}) {
    double cost[2];
    for (const int k : {0, 1}) {
      BundleAdjustment problem(k ? without : full);
      SolverOptions options;
      options.linear_solver = choice;
      LevenbergMarquardt solver(problem, options);
      VectorXd state = problem.initial();
      const SolveSummary& summary = solver.solve(state);
      INFO((k ? "without" : "with") << ", " << summary.iterations << " iterations");
      CHECK(summary.outcome == Outcome::converged);
      cost[k] = summary.cost.doubled;
    }
    CHECK(cost[0] == Approx(cost[1]).epsilon(1e-7));
  }
}

}  // namespace bundle_adjustment_test
