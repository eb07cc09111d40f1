// Widths of priors learned from the data: maximum of evidence times hyperprior (empirical Bayes;
// MacKay, "Bayesian Interpolation", Neural Computation 4, 1992), at a fixed linearisation.
//
// Model. Twice the cost of the data about the present values x0 of n unknowns (private ones
// eliminated) is  c + 2 g'd + d'N d  for a step d. A member i of group k counts from its nominal
// value and has the prior  x_i ~ N(0, t_i^2), t_i = f_k s_i, with its starting width s_i and the
// group's one unknown factor f_k = exp(u_k), u_k ~ N(0, (ln 3)^2). With P = diag(1 / t_i^2),
// H = N + P, C = H^-1 the posterior is
//     d = -C (g + P x0),   x = x0 + d,   covariance C,
//     log evidence = -1/2 [c + x0'P x0 - (g + P x0)'C (g + P x0)] - 1/2 log|H| - sum log t_i + ..,
// and with gamma_k = sum_i (1 - C_ii / t_i^2), the number of members that the data determine,
//     d/du_k (log evidence + log hyperprior) = sum_i x_i^2 / t_i^2 - gamma_k - u_k / (ln 3)^2.
// A round steps by that over  2 max(sum_i x_i^2 / t_i^2, gamma_k) + 1 / (ln 3)^2, at most 1.5. A
// group of which the data say nothing keeps its start; one that is exact shrinks to what the data
// can resolve, and its width says how well that is known. (No width is shrunk because gamma is
// small: what has no evidence would be taken as exact.)
//
// Gain of a group k: by how much its log evidence exceeds that with x_i = 0 for all its members,
// everything else as it is. That is the ratio of prior and posterior densities there (Savage and
// Dickey):  gain = 1/2 log|C_kk| - sum log t_i + 1/2 x_k' C_kk^-1 x_k.
//
// Holding. Numbers h of a group are put to their nominal values if there is no evidence for that
// they are off, and the others a estimated with h = 0. If they are off all the same, both are wrong
// by  m = (C_ah C_hh^-1 x_h, x_h)  in the mean and by C about that, second moment C + m m'; if they
// are not, by the posterior given h = 0, covariance C_0 = C - C_:h C_hh^-1 C_h:. Beforehand the
// odds are one to four for nominal numbers: robots and lenses are hardly ever as drawn. Then the
// second moment is
//     C_0 + P (C - C_0 + m m'),   P = 1 / (1 + exp(-gain) / (4 a)),
// where a is the evidence averaged over all widths, u ~ N(0, (ln 10)^2), over that at the best: a
// group whose best widths are a twentieth of what is usual was less likely beforehand.
// (Averaged with ln 3, errors a twentieth of the usual ones were taken for none: as large as the
// noise, they were beyond three times the predicted in 27 % of draws.)
// (Two to one, as it was, left 4.8 % of 563 numbers that were held so beyond three sigmas, of
// robots of which all numbers are off; one to four 1.1 %. Of robots that are as drawn predicted
// errors are a quarter larger for it.)
// Several groups are held one after the other, each given those before. Of what the data do not
// tell (below a tenth) P = 1: single numbers of a group that is kept, and groups as a whole.
//
// Other widths. The best are not the only possible ones, above all of small groups. With widths f
// times the best H loses d = 1 - 1 / f^2 of the group's priors. In the eigenvectors of
// P^1/2 C_kk P^1/2, eigenvalues e (the share of a direction that is prior), y = V' P^1/2 x_k:
//     log evidence changes by  sum (-1/2 log(1 - d e) + 1/2 d y^2 / (1 - d e)) - n log f,
//     C by  G diag(d / (1 - d e)) G',   x by  G (d y / (1 - d e)),   G = C_:k P^1/2 V
// (Woodbury). Over a grid of f, weighed by evidence and hyperprior, the second moment takes up the
// mean of x's changes to wider widths, and of each direction's variance 1 / (1 - d e), which is
// that of a mixture of normal errors, with longer tails than one, as much as it takes for no
// more than 0.27 % of errors to be beyond three sigmas, as of normal ones.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Odds beforehand that a group's numbers are nominal: robots and lenses are hardly ever as drawn.
constexpr double kNominal = 0.25;
// The gain of log evidence from which a group is kept.
constexpr double kEvidence = 3;

struct WidthProblem {
  MatrixXd normal;         // N, n x n
  VectorXd gradient;       // g
  VectorXd at;             // x0, by unknown; what has no prior counts from anywhere
  VectorXd start;          // s_i; 0: no prior
  std::vector<int> group;  // by unknown; -1: none, or a prior of its own that stays
  int groups = 0;
  std::vector<char> known = {};  // by group: its factor stays; beyond the end: it is learned

  bool learns(int k) const { return k >= static_cast<int>(known.size()) || !known[k]; }
};

struct Posterior {
  bool defined = false;        // false: H is not positive definite, nothing else is set
  VectorXd value;              // x; of unknowns without a prior the step
  VectorXd variance;           // C's diagonal
  double log_determinant = 0;  // of C
  MatrixXd covariance;         // C
};
/// Returns the posterior at these factors, one per group; without the covariance unless it is
/// requested. It allocates.
Posterior posterior(const WidthProblem& problem, const VectorXd& factor, bool covariance);

struct Widths {
  bool defined = false;
  int rounds = 0;
  VectorXd factor;  // by group
  VectorXd gamma;   // by group
  Posterior posterior;
};
/// Learns the factors, from `factor` on, in at most `rounds` rounds.
Widths learn_widths(const WidthProblem& problem, VectorXd factor, int rounds);

/// Returns the gain of a group.
double evidence_gain(const WidthProblem& problem, const Widths& widths, int group);
/// Returns the log evidence for these factors, up to what does not depend on them; NaN where it is
/// not defined.
double log_evidence(const WidthProblem& problem, const VectorXd& factor);

/// The groups and components fixed for lack of evidence.
struct Selection {
  std::vector<char> held;   // by unknown
  std::vector<char> whole;  // by group
  VectorXd gain;            // by group: when it was held, or at the end
  VectorXd probability;     // by group: that it is off, if it was held whole
  VectorXd inflation;       // by group: variance of what the data do not tell, over the best
                            // width squared
  MatrixXd second_moment;   // of the errors of all unknowns
};
/// Fixes groups whose gain is below 3, the smallest first, testing the rest again each time (except
/// groups whose width is known). Of the other groups it fixes the components to whose variance the
/// data contribute less than a tenth (1 - C_ii / t_i^2).
Selection hold(const WidthProblem& problem, const Widths& widths);

}  // namespace kincal
