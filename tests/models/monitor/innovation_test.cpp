// models/monitor/innovation: the equations of one sample against what is expected of them.
//
// Proves, for random equations with few and with many rows, with and without private unknowns that
// nothing determines: chi2, its degrees of freedom, the innovation of each sensor (also where
// nothing else tells of some of its directions, or all its columns are exact) and what a sample
// tells of each kind of noise equal those of dense inverses in long double to 1e-9; the reduced
// equations have the products of the dense ones to 1e-9, and no more rows than columns. Does not
// prove: that the equations of a robot's samples are such (monitor_test.cpp).
#include "../../../models/monitor/innovation.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

namespace innovation_test {

using namespace kincal;

namespace {

using Long = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
using LongVector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;

constexpr int kColumns = 9, kPrivates = 4, kSensors = 3;

enum class Privates { determined, one_unseen, two_alike, of_one_sensor, last_exact };

/// Equations with their parts as matrices.
struct Setting {
  Equations equations;
  MatrixXd a, j;  // j: of the columns that are touched
  VectorXd r, f;
  std::vector<double> variance;
  std::vector<DriftWatch> watch;  // one
};

Setting setting(unsigned seed, int rows_of_sensor, Privates privates) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto draw = [&](int rows, int columns, double size) {
    MatrixXd out(rows, columns);
    for (int c = 0; c < columns; ++c)
      for (int i = 0; i < rows; ++i) out(i, c) = size * normal(random);
    return out;
  };
  Setting out;
  const int m = kSensors * rows_of_sensor + 1;
  out.a = draw(m, kPrivates, 100);
  out.j = draw(m, kColumns, 1);
  out.r = draw(m, 1, 2);
  if (privates == Privates::one_unseen) out.a.col(2).setZero();
  if (privates == Privates::two_alike) out.a.col(3) = 2 * out.a.col(0);
  if (privates == Privates::last_exact) out.j.bottomRows(rows_of_sensor + 1).setZero();
  if (privates == Privates::of_one_sensor) {
    out.a.topRows(rows_of_sensor).rightCols(1) *= 100;
    out.a.bottomRows(m - rows_of_sensor).rightCols(1).setZero();
  }
  Equations& e = out.equations;
  e.count = m;
  e.private_size = kPrivates;
  e.stride = m + 3;
  e.rows.assign(static_cast<size_t>(e.stride) * (kPrivates + kColumns + 1), NAN);
  for (int c = 0; c < kColumns; ++c) e.columns.push_back(2 * c);
  MatrixXd all(m, kPrivates + kColumns + 1);
  all << out.a, out.j, out.r;
  for (int c = 0; c < all.cols(); ++c) std::copy_n(all.col(c).data(), m, e.column(c));
  for (int s = 0; s < kSensors; ++s) {
    e.sensors.push_back({s, s * rows_of_sensor, rows_of_sensor});
    for (int i = 0; i < rows_of_sensor; ++i) e.kind.push_back(1 + s);
  }
  e.kind.push_back(0);  // a joint's
  e.rest.assign(kSensors + 1, {0, 0});
  e.rest[2] = {5, 4};
  out.variance = {1.5, 0.8, 1, 2};
  out.f.resize(m);
  for (int i = 0; i < m; ++i) out.f(i) = out.variance[e.kind[i]];
  // Some columns are exact; others have a mean after a first sample.
  MatrixXd root = draw(2 * kColumns, 2 * kColumns, 0.3);
  for (const int exact : {0, 5, 6, 12}) root.row(exact).setZero();
  out.watch.emplace_back(root * root.transpose(), std::vector<DriftGroup>(), 100, 2 * kColumns);
  out.watch[0].look(draw(3, 2 * kColumns, 1), draw(3, 1, 1));
  out.watch[0].take(true, 0);
  return out;
}

/// Those of A that something determines, for the dense reference.
Long determined(const Setting& s, Privates privates) {
  if (privates == Privates::two_alike) return s.a.leftCols(3).cast<long double>();
  if (privates != Privates::one_unseen) return s.a.cast<long double>();
  MatrixXd out(s.a.rows(), 3);
  out << s.a.leftCols(2), s.a.col(3);
  return out.cast<long double>();
}

/// V^-1 - V^-1 A (A' V^-1 A)^-1 A' V^-1.
Long without(const Long& a, const Long& v) {
  const Long inverse = v.inverse(), weighted = inverse * a;
  return inverse - weighted * (a.transpose() * weighted).inverse() * weighted.transpose();
}

double relative(long double a, long double b) {
  return static_cast<double>(std::abs(a - b) / std::max<long double>(std::abs(b), 1e-3));
}

}  // namespace

TEST_CASE("innovations: against dense inverses") {
  for (const Privates privates : {Privates::determined, Privates::one_unseen, Privates::two_alike,
                                  Privates::of_one_sensor, Privates::last_exact})
    for (const int rows : {3, 5, 20}) {
      INFO("privates " << static_cast<int>(privates) << ", " << rows << " rows of a sensor");
      Setting s = setting(7 + rows, rows, privates);
      const Equations& e = s.equations;
      const Long j = s.j.cast<long double>(), a = s.a.cast<long double>();
      const Long known =
          MatrixXd(s.watch[0].covariance()(e.columns, e.columns)).cast<long double>();
      const LongVector v = (s.r + s.j * s.watch[0].mean()(e.columns)).cast<long double>();
      Long t = j * known * j.transpose();
      t.diagonal() += s.f.cast<long double>();
      const LongVector root = s.f.cast<long double>().cwiseSqrt();
      const Long h =
          root.asDiagonal() * Long((t + a * a.transpose()).inverse()) * root.asDiagonal();
      const LongVector u = h * v.cwiseQuotient(root);
      const Long of_a = determined(s, privates);

      Innovations innovations;
      innovations.expect(e, s.variance, s.watch[0]);
      CHECK(innovations.dof() == e.count - of_a.cols());
      CHECK(relative(innovations.chi2(), v.dot(without(of_a, t) * v)) < 1e-9);
      REQUIRE(innovations.sensors().size() == kSensors);
      for (int k = 0; k < kSensors; ++k) {
        const Eigen::SelfAdjointEigenSolver<Long> inverse(h.block(k * rows, k * rows, rows, rows));
        const LongVector along = inverse.eigenvectors().transpose() * u.segment(k * rows, rows);
        long double chi2 = 0;
        int dof = 0;
        for (int i = 0; i < rows; ++i) {
          if (inverse.eigenvalues()(i) <= 1e-3) continue;
          chi2 += along(i) * along(i) / inverse.eigenvalues()(i);
          ++dof;
        }
        if (privates == Privates::of_one_sensor && k == 0) REQUIRE(dof < rows);
        CHECK(innovations.sensors()[k].dof == dof);
        CHECK(relative(innovations.sensors()[k].chi2, chi2) < 1e-9);
      }
      std::vector<long double> squares(kSensors + 1, 0), residuals(kSensors + 1, 0);
      for (int i = 0; i < e.count; ++i) {
        const long double own = h(i, i);
        squares[e.kind[i]] += s.f(i) * (own * own + u(i) * u(i) - own);
        residuals[e.kind[i]] += own * own;
      }
      squares[2] += 5;
      residuals[2] += 4;
      for (int k = 0; k <= kSensors; ++k) {
        CHECK(relative(innovations.noise()[k].squares, squares[k]) < 1e-9);
        CHECK(relative(innovations.noise()[k].residuals, residuals[k]) < 1e-9);
      }
    }
}

TEST_CASE("innovations: reduced equations have the products of the dense ones") {
  for (const Privates privates : {Privates::determined, Privates::one_unseen, Privates::two_alike})
    for (const int rows : {3, 5, 20}) {
      INFO("privates " << static_cast<int>(privates) << ", " << rows << " rows of a sensor");
      Setting s = setting(40 + rows, rows, privates);
      const Long of_a = determined(s, privates);
      const Long n = without(of_a, Long(s.f.cast<long double>().asDiagonal()));
      Innovations innovations;
      CHECK(innovations.reduce(s.equations, s.variance) == s.equations.count - of_a.cols());
      const MatrixXd j = innovations.j();
      const VectorXd y = innovations.y();
      CHECK(j.rows() <= kColumns + 1);
      CHECK(y.size() == j.rows());
      const MatrixXd products =
          (s.j.transpose().cast<long double>() * n * s.j.cast<long double>()).cast<double>();
      const VectorXd pull =
          -(s.j.transpose().cast<long double>() * n * s.r.cast<long double>()).cast<double>();
      CHECK((j.transpose() * j - products).norm() < 1e-9 * products.norm());
      CHECK((j.transpose() * y - pull).norm() < 1e-9 * pull.norm());
      const LongVector r = s.r.cast<long double>();
      CHECK(relative(y.squaredNorm(), r.dot(n * r)) < 1e-9);
    }
}

}  // namespace innovation_test
