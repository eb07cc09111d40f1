#include "family.h"

#include <algorithm>
#include <cmath>

#include "../../solver/decompositions.h"
#include "../rig/distributions.h"
#include "../rig/numbers.h"

namespace kincal {
namespace {

constexpr double kCommon = 4;      // robots' worth of what all numbers have in common
constexpr double kFarOut = 0.001;  // p
constexpr int kFamilyRounds = 5, kIterations = 100;
constexpr double kAtRest = 1e-3;                     // change of a variance, relative
constexpr double kNullRobots = 20;                   // robots' worth of the null as it is in theory
constexpr double kFreedom = 4, kFreedomShare = 0.2;  // degrees of freedom of t, and a robot's

/// A robot with mean and covariance of a family: factors of what is in the header.
struct Weighed {
  MatrixXd reach, turn;  // L^-1 R S and L^-1 R, M = L L'
  VectorXd left;         // L^-1 (z - R mean)
};

Weighed judge(const Evidence& robot, const VectorXd& mean, const MatrixXd& covariance) {
  Weighed out;
  const MatrixXd reach = robot.rows * covariance;
  MatrixXd total = reach * robot.rows.transpose();
  total.diagonal().array() += 1;
  const MatrixXd root = Cholesky(total).inverse_factor();
  out.reach = root * reach;
  out.turn = root * robot.rows;
  out.left = root * (robot.seen - robot.rows * mean);
  return out;
}

/// FamilySums of EM over the robots that take part.
struct FamilySums {
  MatrixXd moment, information;  // of S; H
  VectorXd pull;                 // sum of R'M^-1 z, from the mean on
  double count = 0;

  explicit FamilySums(Eigen::Index n)
      : moment(MatrixXd::Zero(n, n)), information(MatrixXd::Zero(n, n)), pull(VectorXd::Zero(n)) {}
};

/// Adds `sign` times a robot's part, without that of the mean's uncertainty.
void add(const Weighed& robot, const MatrixXd& covariance, double sign, FamilySums& sums) {
  const VectorXd off = robot.reach.transpose() * robot.left;
  sums.moment += sign * (covariance + off * off.transpose());
  sums.moment.noalias() -= sign * (robot.reach.transpose() * robot.reach);
  sums.information.noalias() += sign * (robot.turn.transpose() * robot.turn);
  sums.pull += sign * (robot.turn.transpose() * robot.left);
  sums.count += sign;
}

/// H^-1; what no robot tells of is known to ten times its scale.
MatrixXd mean_covariance(const FamilySums& sums, const VectorXd& scale) {
  MatrixXd information = sums.information;
  information.diagonal() += (10 * scale).cwiseAbs2().cwiseInverse();
  const MatrixXd root = Cholesky(information).inverse_factor();
  return root.transpose() * root;
}

/// S from a mean of moments over so many robots.
MatrixXd shrunk(MatrixXd moment, double count, const VectorXd& scale) {
  const auto n = static_cast<double>(moment.rows());
  std::vector<double> ratio(moment.rows());
  for (Eigen::Index c = 0; c < moment.rows(); ++c) ratio[c] = moment(c, c) / (scale(c) * scale(c));
  const double common = median(ratio), share = kCommon / (kCommon + count);
  const VectorXd variance = (1 - share) * moment.diagonal() + share * common * scale.cwiseAbs2();
  moment *= count / (n + count);
  moment.diagonal() = variance;
  return moment;
}

/// Takes what the null is shifted and scaled by out of all t.
void standardise(std::vector<double>& t) {
  std::vector<double> sorted = t;
  std::sort(sorted.begin(), sorted.end());
  const auto quantile = [&](double share) {
    const double place = share * static_cast<double>(sorted.size() - 1);
    const auto low = static_cast<size_t>(place);
    const double rest = place - static_cast<double>(low);
    return rest > 0 ? sorted[low] + rest * (sorted[low + 1] - sorted[low]) : sorted[low];
  };
  const double middle = quantile(0.5), spread = middle - quantile(0.1587);
  const auto m = static_cast<double>(t.size());
  const double known = m / (m + kNullRobots);
  const double shift = known * middle, factor = std::exp(known * std::log(std::max(spread, 1e-3)));
  for (double& one : t) one = (one - shift) / factor;
}

/// The first mean and covariance: medians and quartiles of what single robots look like.
void start(const std::vector<Evidence>& robots, const VectorXd& scale, VectorXd& mean,
           MatrixXd& covariance) {
  const Eigen::Index n = scale.size();
  mean.setZero(n);
  covariance = scale.cwiseAbs2().asDiagonal();
  MatrixXd off(n, robots.size());
  for (size_t i = 0; i < robots.size(); ++i) {
    const Weighed one = judge(robots[i], mean, covariance);
    off.col(static_cast<Eigen::Index>(i)) = one.reach.transpose() * one.left;
  }
  for (Eigen::Index c = 0; c < n; ++c) {
    std::vector<double> all(off.cols());
    for (Eigen::Index i = 0; i < off.cols(); ++i) all[i] = off(c, i);
    mean(c) = median(all);
    for (double& one : all) one = std::abs(one - mean(c));
    covariance(c, c) = std::pow(1.4826 * median(all), 2) + 1e-12 * scale(c) * scale(c);
  }
  covariance = shrunk(covariance, static_cast<double>(robots.size()), scale);
}

/// EM over the robots that are not left out, from a mean and covariance on; its last sums.
FamilySums learn(const std::vector<Evidence>& robots, const std::vector<char>& out,
                 const VectorXd& scale, VectorXd& mean, MatrixXd& covariance) {
  const Eigen::Index n = scale.size();
  FamilySums sums(n);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    sums = FamilySums(n);
    std::vector<MatrixXd> tells;
    for (size_t i = 0; i < robots.size(); ++i) {
      if (out[i]) continue;
      const Weighed one = judge(robots[i], mean, covariance);
      add(one, covariance, 1, sums);
      tells.push_back(one.reach.transpose() * one.turn);
    }
    const MatrixXd h = mean_covariance(sums, scale);
    for (const MatrixXd& g : tells) sums.moment.noalias() += g * h * g.transpose();
    mean += h * sums.pull;
    const MatrixXd next = shrunk(sums.moment / sums.count, sums.count, scale);
    const double change =
        ((next.diagonal() - covariance.diagonal()).array() / covariance.diagonal().array())
            .abs()
            .maxCoeff();
    covariance = next;
    if (change < kAtRest) break;
  }
  return sums;
}

/// Of those that explain as well as the best the number that stands first leads.
void lead_with_first(std::vector<OffNumber>& numbers) {
  size_t first = 0;
  for (size_t k = 1;
       k < numbers.size() && numbers[k].in_sigmas() > kAsWell * numbers[0].in_sigmas(); ++k)
    if (numbers[k].number < numbers[first].number) first = k;
  const auto begin = numbers.begin(), found = begin + static_cast<std::ptrdiff_t>(first);
  std::rotate(begin, found, found + (numbers.empty() ? 0 : 1));
}

}  // namespace

Evidence evidence(const MatrixXd& normal, const VectorXd& pull, const VectorXd& at,
                  const VectorXd& scale) {
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * normal * scale.asDiagonal());
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < eigen.values.size(); ++i)
    if (eigen.values(i) > 1) kept.push_back(i);
  Evidence out;
  out.rows.resize(static_cast<Eigen::Index>(kept.size()), normal.rows());
  out.seen.resize(out.rows.rows());
  const VectorXd scaled = scale.cwiseProduct(pull);
  for (Eigen::Index k = 0; k < out.rows.rows(); ++k) {
    const double root = std::sqrt(eigen.values(kept[k]));
    const VectorXd direction = eigen.vectors.col(kept[k]);
    out.rows.row(k) = root * direction.cwiseQuotient(scale).transpose();
    out.seen(k) = direction.dot(scaled) / root + out.rows.row(k).dot(at);
  }
  return out;
}

Family judge_family(const std::vector<Evidence>& robots, const VectorXd& scale) {
  Family family;
  if (robots.size() < kFewestRobots) return family;
  family.judged = true;
  family.members.resize(robots.size());
  start(robots, scale, family.mean, family.covariance);
  std::vector<char> out(robots.size(), 0);
  std::vector<double> t(robots.size());
  const auto distance = [&](const Weighed& one, size_t i) {
    family.members[i].distance = one.left.squaredNorm();
    family.members[i].equations = static_cast<int>(one.left.size());
    t[i] = one.left.size() == 0
               ? 0
               : chi2_deviate(family.members[i].distance, static_cast<double>(one.left.size()));
  };
  const double freedom = kFreedom + kFreedomShare * static_cast<double>(robots.size());
  const auto tail = [&](double one) { return student_tail(one, freedom); };
  const auto leave_out = [&] {
    standardise(t);
    std::vector<char> next(robots.size());
    for (size_t i = 0; i < robots.size(); ++i) next[i] = tail(t[i]) < kFarOut;
    const bool same = next == out;
    out = next;
    return !same;
  };
  for (size_t i = 0; i < robots.size(); ++i)
    distance(judge(robots[i], family.mean, family.covariance), i);
  leave_out();
  for (int round = 0; round < kFamilyRounds; ++round) {
    const FamilySums sums = learn(robots, out, scale, family.mean, family.covariance);
    for (size_t i = 0; i < robots.size(); ++i) {
      VectorXd mean = family.mean;
      MatrixXd covariance = family.covariance;
      if (!out[i]) {  // without its own part
        const Weighed own = judge(robots[i], mean, covariance);
        FamilySums others = sums;
        others.pull.setZero();  // at the mean of all
        add(own, covariance, -1, others);
        mean += mean_covariance(others, scale) * others.pull;
        covariance = shrunk(others.moment / others.count, others.count, scale);
      }
      const Weighed one = judge(robots[i], mean, covariance);
      distance(one, i);
      FamilyMember& member = family.members[i];
      member.numbers.clear();
      const VectorXd s = one.turn.transpose() * one.left;
      for (Eigen::Index c = 0; c < scale.size(); ++c) {
        const double q = one.turn.col(c).squaredNorm();
        if (q * scale(c) * scale(c) > 1)
          member.numbers.push_back({static_cast<int>(c), s(c) / q, 1 / std::sqrt(q)});
      }
      std::stable_sort(
          member.numbers.begin(), member.numbers.end(),
          [](const OffNumber& a, const OffNumber& b) { return a.in_sigmas() > b.in_sigmas(); });
      lead_with_first(member.numbers);
    }
    if (!leave_out()) break;
  }
  for (size_t i = 0; i < robots.size(); ++i) {
    family.members[i].p = tail(t[i]);
    family.members[i].left_out = out[i];
  }
  return family;
}

}  // namespace kincal
