// A fleet as a family: which of its robots differ from the others.
//
// Model. The data of robot i give k_i equations for its n components x_i, without any prior,
// R_i x_i = z_i + e, e ~ N(0, 1) (`Evidence`): R'R is their information, its inverse, where there
// is one, the covariance C_i of their estimate. The robots of a healthy fleet are made alike but
// for tolerances,
//     x_i ~ N(mean, S),   so that   z_i ~ N(R_i mean, M_i),   M_i = 1 + R_i S R_i'.
// The distance of a robot is d_i^2 = (z_i - R_i mean)' M_i^-1 (z_i - R_i mean): Mahalanobis' with
// the covariance S + C_i. It is also defined if the data do not determine some directions of x_i:
// these do not count.
//
// Mean and S are those of the greatest restricted likelihood, by EM (Dempster, Laird, Rubin 1977):
// with the posterior of x_i, mean + S R'M^-1 (z - R mean) and covariance S - S R'M^-1 R S,
//     S <- mean over robots of (posterior deviation)(..)' + covariance
//          + G H^-1 G',   G = S R'M^-1 R,   H = sum of R'M^-1 R (the mean is estimated, too).
// m robots determine S only in part. It is shrunk twice in each round: variances towards a common
// one of all components, in units of their usual errors (with the weight of kCommon robots); and
// off-diagonal elements by n / (n + m), towards independent components.
//
// Robustness. Distant robots take no part in mean and S. The first S is diagonal, from medians and
// quartiles. With it, and then with S of the remaining robots, robots whose distance is exceeded by
// only 0.1 % of healthy ones are left out, until these no longer change.
//
// Judgement. A robot must not judge itself: its distance is computed without its own part of mean
// and S. With k equations d^2 is chi-squared, except for the error of S; t is the standard normal
// number that is exceeded equally often. If S is uncertain, t is shifted and scaled, equally for
// all healthy robots; their median and lower quantile give the amounts (the empirical null of
// Efron, JASA 99, 2004), with more weight the more robots there are. The result has a Student
// distribution with 4 + m / 5 degrees of freedom (found on simulated fleets of 8 to 1,000 robots,
// because shift and scale are uncertain, too). Its tail is p: a share of `level` of healthy robots
// has p below `level`.
//
// Components. If only component c of the robot were wrong, its deviation would be
//     off = s / q,   s = (R'M^-1 (z - R mean))_c,  q = (R'M^-1 R)_cc,   sigma 1 / sqrt(q):
// sigma is the scatter for a healthy robot. Components that the data cannot distinguish have equal
// results: among those as good as the best, the first one of the fleet's components leads.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// An Evidence is the information of one result's data on the components of the fleet: rows x =
/// seen, whitened.
struct Evidence {
  MatrixXd rows;
  VectorXd seen;
};
/// Makes Evidence of normal equations N (x - at) = pull that have no priors. Directions whose sigma
/// exceeds `scale` (the largest possible error of each component) are left out: they have no useful
/// information, and the linearisation does not hold over this distance.
Evidence evidence(const MatrixXd& normal, const VectorXd& pull, const VectorXd& at,
                  const VectorXd& scale);

struct OffNumber {
  int number = -1;
  double off = 0, sigma = 0;  // from the family's mean, if it alone were wrong

  double in_sigmas() const { return std::abs(off) / sigma; }
};

/// A FamilyMember is the judgement of one robot.
struct FamilyMember {
  double distance = 0;             // d^2
  int equations = 0;               // k
  double p = 1;                    // share of healthy robots with an equal or larger distance
  bool left_out = false;           // left out of mean and covariance
  std::vector<OffNumber> numbers;  // those with any equation, most sigmas first
};

struct Family {
  bool judged = false;  // false: there are too few robots; nothing else is set
  VectorXd mean;
  MatrixXd covariance;  // S
  std::vector<FamilyMember> members;
};

constexpr int kFewestRobots = 8;
constexpr double kAsWell =
    0.98;  // share of the most sigmas from which a component explains as well as the best

/// Judges robots by each other. `scale` has the usual error of each component. With fewer than
/// kFewestRobots nothing is judged.
Family judge_family(const std::vector<Evidence>& robots, const VectorXd& scale);

}  // namespace kincal
