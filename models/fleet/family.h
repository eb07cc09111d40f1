// A fleet as a family: which of its robots are unlike the others.
//
// Model. What the data of robot i say of its n numbers x_i, without any prior, are k_i equations
// R_i x_i = z_i + e, e ~ N(0, 1) (`Evidence`): R'R is their information, its inverse, where there
// is one, the covariance C_i of their estimate. The robots of a healthy fleet are made alike but
// for tolerances,
//     x_i ~ N(mean, S),   so that   z_i ~ N(R_i mean, M_i),   M_i = 1 + R_i S R_i'.
// The distance of a robot is d_i^2 = (z_i - R_i mean)' M_i^-1 (z_i - R_i mean): Mahalanobis' with
// the covariance S + C_i, and defined also where the data leave directions of x_i open: nothing is
// said of these, and nothing counts.
//
// Mean and S are those of the greatest restricted likelihood, by EM (Dempster, Laird, Rubin 1977):
// with the posterior of x_i, mean + S R'M^-1 (z - R mean) and covariance S - S R'M^-1 R S,
//     S <- mean over robots of (posterior deviation)(..)' + covariance
//          + G H^-1 G',   G = S R'M^-1 R,   H = sum of R'M^-1 R (the mean is estimated, too).
// Of m robots, no more can be told of S than m allow. It is shrunk twice in each round: variances
// towards those that all numbers have in common, in units of how far such numbers are usually off
// (kCommon robots' worth); and what is beside the diagonal by n / (n + m), towards numbers that are
// independent of each other.
//
// Robust. Robots that are far out take no part in mean and S. The first S is diagonal, from medians
// and quartiles; with it, and then with S of those that are left, distances are judged and robots
// beyond 0.1 % of what is healthy left out, until these are the same ones.
//
// Weighed. A robot must not judge itself: its distance is taken with its own part of mean and S
// taken out again. With k equations d^2 is chi-squared but for what S lacks; t is the standard
// normal number that is exceeded as often. Where S is uncertain, t is shifted and scaled, of all
// healthy robots alike: their median and lower quantile say by how much (the empirical null of
// Efron, JASA 99, 2004), the more the more robots there are. What is left is as a Student number of
// 4 + m / 5 degrees of freedom (found on simulated fleets of 8 to 1,000 robots: shift and scale are
// uncertain, too), whose tail is p: of healthy robots a share of `level` has p below `level`.
//
// Which numbers. If number c of the robot alone were off, it would be by
//     off = s / q,   s = (R'M^-1 (z - R mean))_c,  q = (R'M^-1 R)_cc,   sigma 1 / sqrt(q):
// sigma is what a healthy robot's would scatter by. Numbers that the data cannot tell apart come
// out alike: of those as good as the best the one that stands first among the fleet's numbers
// leads.
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
/// Returns the evidence of normal equations N (x - at) = pull, those of the data alone. Directions
/// whose sigma is beyond `scale` (by number: how far it may be off at all) are left out: nothing
/// that is worth knowing is said of them, and no equation is linear so far away.
Evidence evidence(const MatrixXd& normal, const VectorXd& pull, const VectorXd& at,
                  const VectorXd& scale);

struct OffNumber {
  int number = -1;
  double off = 0, sigma = 0;  // from the family's mean, if it alone were off

  double in_sigmas() const { return std::abs(off) / sigma; }
};

/// A FamilyMember is a robot as the family judges it.
struct FamilyMember {
  double distance = 0;             // d^2
  int equations = 0;               // k
  double p = 1;                    // so many of healthy robots are as far out or farther
  bool left_out = false;           // of mean and covariance
  std::vector<OffNumber> numbers;  // those with any equation, most sigmas first
};

struct Family {
  bool judged = false;  // false: there are too few robots; nothing else is set
  VectorXd mean;
  MatrixXd covariance;  // S
  std::vector<FamilyMember> members;
};

constexpr int kFewestRobots = 8;
constexpr double kAsWell = 0.98;  // of the most sigmas: such a number explains as well as the best

/// Judges robots by each other. `scale` has how far each number may usually be off; with fewer than
/// kFewestRobots nothing is judged.
Family judge_family(const std::vector<Evidence>& robots, const VectorXd& scale);

}  // namespace kincal
