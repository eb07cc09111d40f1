// models/evidence/linear_model: the evidence of linear models with unknown noise.
//
// Proves, against brute force: with known noise the evidence is that of the normal distribution of
// the data; with one or two unknown noise factors, with and without private unknowns, it is its
// integral over a grid of factors (and of the unknown itself) to 1e-3; more unknowns are gained as
// models that have them from the start have it. By drawing data from models with and without one
// more unknown: of what is called 99 % sure so much is right, and probabilities add up to what
// happens, with noise as stated, 0.3 and 3 times as large, and drawn from its prior. Data without
// noise speak for nothing. Does not prove: anything of what is not linear.
#include "../../../models/evidence/linear_model.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "../../../models/evidence/evidence.h"
#include "../../../models/rig/random_stream.h"
#include "../../fixtures/dense.h"

namespace linear_model_test {

using namespace kincal;

namespace {

const double kSpreadOfFactors = std::log(3.0);

MatrixXd drawn(RandomStream& draws, Eigen::Index rows, Eigen::Index columns) {
  MatrixXd out(rows, columns);
  for (Eigen::Index i = 0; i < rows; ++i)
    for (Eigen::Index j = 0; j < columns; ++j) out(i, j) = draws.normal();
  return out;
}

/// A model of groups of rows of two kinds: `first` of kind 0, `second` of kind 1, each group with
/// private unknowns that have priors of 1 among their rows.
struct Toy {
  int groups = 8, first = 6, second = 5, private_size = 2, shared = 2;
  VectorXd width;  // of the shared unknowns
  LinearModel model;
  MatrixXd all;  // every row [private of all groups, shared]
  VectorXd r;
  std::vector<int> kind;

  /// Draws data with the unknowns drawn from their priors, but `absent` (0), and noise factors s.
  void draw(RandomStream& draws, const std::vector<double>& s, int absent = -1) {
    const Eigen::Index rows = first + second + private_size, n = groups * private_size + shared;
    all = MatrixXd::Zero(groups * rows, n);
    r.resize(all.rows());
    kind.clear();
    model = {};
    VectorXd x(shared);
    for (int i = 0; i < shared; ++i) x(i) = i == absent ? 0 : width(i) * draws.normal();
    model.numbers = VectorXd::Zero(static_cast<Eigen::Index>(s.size()));
    for (int g = 0; g < groups; ++g) {
      LinearModel::Group group;
      group.private_size = private_size;
      for (int i = 0; i < shared; ++i) group.columns.push_back(i);
      group.rows = MatrixXd::Zero(rows, private_size + shared + 1);
      const MatrixXd j = drawn(draws, first + second, private_size + shared);
      VectorXd unknowns(private_size + shared);
      unknowns << drawn(draws, private_size, 1), x;
      group.rows.topLeftCorner(first + second, private_size + shared) = j;
      group.rows.bottomLeftCorner(private_size, private_size).setIdentity();
      for (int i = 0; i < rows; ++i) {
        const int k = i < first ? 0 : i < first + second ? 1 % static_cast<int>(s.size()) : -1;
        group.kind.push_back(k);
        if (k < 0) continue;
        model.numbers(k) += 1;
        group.rows(i, private_size + shared) = -j.row(i).dot(unknowns) + s[k] * draws.normal();
      }
      all.block(g * rows, g * private_size, rows, private_size) = group.rows.leftCols(private_size);
      all.block(g * rows, groups * private_size, rows, shared) =
          group.rows.middleCols(private_size, shared);
      r.segment(g * rows, rows) = group.rows.rightCols(1);
      kind.insert(kind.end(), group.kind.begin(), group.kind.end());
      model.groups.push_back(group);
    }
    model.width = width;
    model.prior = width.cwiseAbs2().cwiseInverse().asDiagonal();
    model.pull = VectorXd::Zero(shared);
  }

  /// Log density of the data for given factors, without (2 pi)^(n/2): normal, with the covariance
  /// that the unknowns' priors make. (The rows of private priors are not data.)
  double log_density(const VectorXd& u) const {
    std::vector<Eigen::Index> data;
    for (size_t i = 0; i < kind.size(); ++i)
      if (kind[i] >= 0) data.push_back(static_cast<Eigen::Index>(i));
    const auto n = static_cast<Eigen::Index>(data.size());
    VectorXd prior = VectorXd::Ones(all.cols());
    prior.tail(shared) = width.cwiseAbs2();
    MatrixXd j(n, all.cols()), covariance = MatrixXd::Zero(n, n);
    VectorXd z(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      j.row(i) = all.row(data[i]);
      z(i) = r(data[i]);
      covariance(i, i) = std::exp(2 * u(kind[data[i]]));
    }
    covariance += j * prior.asDiagonal() * j.transpose();
    return -0.5 * z.dot(fixture::dense::llt_solve(covariance, z).col(0)) -
           fixture::dense::lower(covariance).diagonal().array().log().sum();
  }
};

/// The log of the sum of exp over a grid, times the volume of a cell.
class GridSum {
 public:
  void add(double log) { logs_.push_back(log); }
  double log(double cell) const {
    const double most = *std::max_element(logs_.begin(), logs_.end());
    double sum = 0;
    for (const double l : logs_) sum += std::exp(l - most);
    return most + std::log(sum * cell);
  }

 private:
  std::vector<double> logs_;
};

double log_prior_of(double u) {
  return -u * u / (2 * kSpreadOfFactors * kSpreadOfFactors) - std::log(kSpreadOfFactors) -
         0.5 * std::log(2 * std::acos(-1.0));
}

}  // namespace

TEST_CASE("evidence: with known noise it is the density of the data") {
  RandomStream draws(1);
  Toy toy;
  toy.width = (VectorXd(2) << 0.7, 3).finished();
  toy.draw(draws, {1});
  for (LinearModel::Group& g : toy.model.groups) g.kind.assign(g.kind.size(), -1);
  toy.model.numbers = VectorXd(0);
  CHECK(evidence(toy.model).log == Approx(toy.log_density(VectorXd::Zero(1))).epsilon(1e-10));
}

TEST_CASE("evidence: one unknown and one noise factor, summed over a grid of both") {
  RandomStream draws(2);
  for (const double factor : {0.4, 1.0, 2.5}) {
    constexpr int kRows = 150;
    const VectorXd a = drawn(draws, kRows, 1);
    const double x = 0.8, width = 1.5;
    LinearModel model;
    model.width = VectorXd::Constant(1, width);
    model.prior = MatrixXd::Constant(1, 1, 1 / (width * width));
    model.pull = VectorXd::Zero(1);
    model.numbers = VectorXd::Constant(1, kRows);
    MatrixXd rows(kRows, 2);
    rows << a, x * a + factor * drawn(draws, kRows, 1);
    model.groups.push_back({0, {0}, rows, std::vector<int>(kRows, 0)});
    const double aa = a.squaredNorm(), ar = a.dot(rows.col(1)), rr = rows.col(1).squaredNorm();
    GridSum sum;
    constexpr double kStep = 0.03, kStepX = 0.01;
    for (double u = -2; u < 2; u += kStep)
      for (double d = -3; d < 3; d += kStepX)
        sum.add(
            log_prior_of(u) - kRows * u - 0.5 * (rr + 2 * d * ar + d * d * aa) * std::exp(-2 * u) -
            0.5 * d * d / (width * width) - std::log(width) - 0.5 * std::log(2 * std::acos(-1.0)));
    const LinearEvidence found = evidence(model);
    CHECK(found.log == Approx(sum.log(kStep * kStepX)).margin(2e-3));
    CHECK(found.factor(0) == Approx(factor).epsilon(0.2));
    CHECK(found.fitted(0) == Approx(1).epsilon(0.05));
  }
}

TEST_CASE("evidence: two noise factors and private unknowns, summed over a grid of factors") {
  RandomStream draws(3);
  Toy toy;
  toy.width = (VectorXd(2) << 0.7, 3).finished();
  toy.groups = 12;
  for (const double factor : {0.5, 1.0, 2.0}) {
    toy.draw(draws, {factor, 1});
    GridSum sum;
    constexpr double kStep = 0.1;
    VectorXd u(2);
    for (u(0) = -1.6; u(0) < 1.6; u(0) += kStep)
      for (u(1) = -1.2; u(1) < 1.2; u(1) += kStep)
        sum.add(toy.log_density(u) + log_prior_of(u(0)) + log_prior_of(u(1)));
    const double brute = sum.log(kStep * kStep);
    INFO(factor << ": " << evidence(toy.model).log << " and " << brute);
    // (The average information stands for the second derivative: the rest is Laplace's error.)
    CHECK(evidence(toy.model).log == Approx(brute).margin(0.04));
    Toy without = toy;
    without.model = with_unknowns(toy.model, {1}, MatrixXd(2, 0), VectorXd(0));
    without.width(0) = 1e-9;
    GridSum less;
    for (u(0) = -1.6; u(0) < 1.6; u(0) += kStep)
      for (u(1) = -1.2; u(1) < 1.2; u(1) += kStep)
        less.add(without.log_density(u) + log_prior_of(u(0)) + log_prior_of(u(1)));
    INFO("without: " << evidence(without.model).log << " and " << less.log(kStep * kStep));
    CHECK(evidence(toy.model).log - evidence(without.model).log ==
          Approx(brute - less.log(kStep * kStep)).margin(0.04));
  }
}

TEST_CASE("evidence: more unknowns, one by one and together") {
  RandomStream draws(4);
  Toy toy;
  toy.shared = 4;
  toy.width = (VectorXd(4) << 0.7, 3, 0.4, 0.9).finished();
  toy.draw(draws, {1.4, 0.8});
  const LinearModel two = with_unknowns(toy.model, {0, 1}, MatrixXd(4, 0), VectorXd(0));
  const MatrixXd directions = MatrixXd::Identity(4, 4).rightCols(2);
  const LinearModel four = with_unknowns(toy.model, {0, 1}, directions, toy.width.tail(2));
  CHECK(evidence(four).log == Approx(evidence(toy.model).log).epsilon(1e-9));
  CHECK(evidence(four, evidence(two).factor).log ==
        Approx(evidence(toy.model).log).margin(1e-6));  // wherever the factors start
  // One direction in both: as a model with that one column.
  const MatrixXd both = directions * VectorXd(Eigen::Vector2d(0.5, -2));
  LinearModel column = two;
  for (size_t g = 0; g < column.groups.size(); ++g) {
    LinearModel::Group& group = column.groups[g];
    const MatrixXd& rows = toy.model.groups[g].rows;
    const Eigen::Index p = group.private_size;
    MatrixXd more(rows.rows(), rows.cols() - 1);
    more << rows.leftCols(p + 2), 0.5 * rows.col(p + 2) - 2 * rows.col(p + 3), rows.rightCols(1);
    group.rows = more;
    group.columns = {0, 1, 2};
  }
  column.width = (VectorXd(3) << 0.7, 3, 0.3).finished();
  column.prior = column.width.cwiseAbs2().cwiseInverse().asDiagonal();
  column.pull = VectorXd::Zero(3);
  CHECK(evidence(with_unknowns(toy.model, {0, 1}, both, VectorXd::Constant(1, 0.3))).log ==
        Approx(evidence(column).log).epsilon(1e-9));
}

TEST_CASE("evidence: probabilities are those of what happens") {
  RandomStream draws(5);
  Toy toy;
  toy.groups = 10;
  toy.width = (VectorXd(2) << 0.8, 3).finished();
  for (const double stated : {1.0, 0.3, 3.0, 0.0}) {  // 0: factors drawn from their prior
    double off = 0, variance = 0, sure_wrong = 0, expected_wrong = 0;
    int sure = 0;
    const auto factor = [&] {
      return stated > 0 ? stated : std::exp(kSpreadOfFactors * draws.normal());
    };
    for (int n = 0; n < 200; ++n) {
      const bool there = draws.uniform() < 0.5;
      toy.draw(draws, {factor(), factor()}, there ? -1 : 0);
      const LinearModel as_it_is = with_unknowns(toy.model, {1}, MatrixXd(2, 0), VectorXd(0));
      const double p =
          posterior({{evidence(as_it_is).log, 0, 0}, {evidence(toy.model).log, 0, 1}}).of_kind[1];
      off += there - p;
      variance += p * (1 - p);
      if (std::max(p, 1 - p) < 0.99) continue;
      ++sure;
      sure_wrong += (p > 0.5) != there;
      expected_wrong += std::min(p, 1 - p);
    }
    INFO("noise " << stated << ": " << off << " +- " << std::sqrt(variance) << "; " << sure
                  << " sure, wrong " << sure_wrong << " of " << expected_wrong << " expected");
    CHECK(std::abs(off) < 3 * std::sqrt(variance));
    CHECK(sure >= 10);
    CHECK(sure_wrong <= expected_wrong + 3 * std::sqrt(expected_wrong) + 1);
  }
}

TEST_CASE("evidence: data without noise") {
  RandomStream draws(6);
  Toy toy;
  toy.private_size = 0;
  toy.width = (VectorXd(2) << 0.25, 3).finished();
  toy.draw(draws, {1e-9}, 0);  // what is left of rounding
  const LinearModel as_it_is = with_unknowns(toy.model, {1}, MatrixXd(2, 0), VectorXd(0));
  CHECK(evidence(toy.model).log < evidence(as_it_is).log);
  toy.draw(draws, {1e-9});
  const LinearModel without = with_unknowns(toy.model, {1}, MatrixXd(2, 0), VectorXd(0));
  CHECK(evidence(toy.model).log > evidence(without).log + 10);
}

TEST_CASE("evidence: probabilities of alternatives and of their kinds") {
  const ModelProbabilities p =
      posterior({{-1000, 0, 0}, {-1000 + std::log(3.0), -std::log(2.0), 1}, {-1001, 0, 1}});
  const double sum = 1 + 1.5 + std::exp(-1.0);
  CHECK(p.of_model[0] == Approx(1 / sum));
  CHECK(p.of_model[1] == Approx(1.5 / sum));
  CHECK(p.of_kind.at(1) == Approx((1.5 + std::exp(-1.0)) / sum));
}

}  // namespace linear_model_test
