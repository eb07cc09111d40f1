// Widths of priors learned from the data: maximum of evidence times hyperprior (empirical Bayes;
// MacKay, "Bayesian Interpolation", Neural Computation 4, 1992), at a fixed linearisation.
//
// Model. Twice the cost of the data about the present values x0 of n unknowns (private ones
// eliminated) is  c + 2 g'd + d'N d  for a step d. A member i of group k counts from its nominal
// value and has the prior  x_i ~ N(0, t_i^2), t_i = f_k s_i, with its starting width s_i and the
// group's one unknown factor f_k = exp(u_k), u ~ N(0, K): K_kk = (ln 3)^2, and half of that between
// groups that are alike (lengths of a robot's arms: they were made in the same way). With
// P = diag(1 / t_i^2), H = N + P, C = H^-1 the posterior is
//     d = -C (g + P x0),   x = x0 + d,   covariance C,
//     log evidence = -1/2 [c + x0'P x0 - (g + P x0)'C (g + P x0)] - 1/2 log|H| - sum log t_i + ..,
// and with gamma_k = sum_i (1 - C_ii / t_i^2), the number of members that the data determine,
//     d/du_k (log evidence + log hyperprior) = sum_i x_i^2 / t_i^2 - gamma_k - (K^-1 u)_k.
// A round solves  (A + K^-1) step = that,  A = diag 2 max(sum_i x_i^2 / t_i^2, gamma_k),  each step
// at most 1.5. A group that the data do not determine keeps its start, or follows those that are
// alike; an exact one shrinks to the resolution of the data, and its width states this resolution.
// (No width shrinks because gamma is small: otherwise parameters without evidence would count as
// exact.)
//
// Gain of a group k: the excess of its log evidence over that with x_i = 0 for all its members and
// everything else unchanged. That is the ratio of prior and posterior densities there (Savage and
// Dickey):  gain = 1/2 log|C_kk| - sum log t_i + 1/2 x_k' C_kk^-1 x_k.
//
// Fixing. Components h of a group are reset to their nominal values if there is no evidence of
// error, and the others a are estimated with h = 0. If h are wrong nevertheless, both have the mean
// error  m = (C_ah C_hh^-1 x_h, x_h)  with covariance C: second moment C + m m'. If they are right,
// the covariance is that of the posterior given h = 0, C_0 = C - C_:h C_hh^-1 C_h:. The prior odds
// of nominal values are one to four: robots and lenses hardly ever match the drawing. Then the
// second moment is
//     C_0 + P (C - C_0 + m m'),   P = 1 / (1 + exp(-gain) / (4 a)),
// where a is the evidence averaged over all widths, u ~ N(0, (ln 10)^2), over that at the best: a
// group whose best widths are a twentieth of the usual ones was less likely a priori.
// (Averaged with ln 3, errors a twentieth of the usual size counted as none: as large as the noise,
// they exceeded three times the predicted error in 27 % of draws.)
// (With odds of two to one, 4.8 % of 563 fixed components were beyond three sigmas, for robots with
// errors in all components; with one to four 1.1 %. For robots that match the drawing, predicted
// errors are a quarter larger with the latter.)
// Members that are set one by one, as zeros of joints are: that one is nominal says nothing of the
// others. P is 1, and a direction that the data determine counts in the evidence of widths as
// (1 - p) e + p e_0, p = 1/5 of the same odds, e_0 its evidence at the nominal value.
// Several groups are fixed one after the other, each given the earlier ones. P = 1 for components
// that the data do not determine (share below a tenth): single ones of a kept group, and whole
// groups.
//
// Other widths. The best widths are not the only possible ones, especially for small groups. With
// widths f times the best, H loses d = 1 - 1 / f^2 of the group's priors. In the eigenvectors of
// P^1/2 C_kk P^1/2, eigenvalues e (the share of a direction that is prior), y = V' P^1/2 x_k:
//     log evidence changes by  sum (-1/2 log(1 - d e) + 1/2 d y^2 / (1 - d e)) - n log f,
//     C by  G diag(d / (1 - d e)) G',   x by  G (d y / (1 - d e)),   G = C_:k P^1/2 V
// (Woodbury). Over a grid of f, weighted by evidence and hyperprior (of u_k given the evidence of
// the other groups, which is normal in u with precision A), the second moment includes the
// mean of x's changes to wider widths. Each direction's variance 1 / (1 - d e) belongs to a mixture
// of normal errors, with longer tails than one.
//
// Mixtures are stated as the variance that covers them: no more errors are beyond two sigmas than
// of normal ones (4.55 %, k = 2 of JCGM 100). Second moments follow the tails: an alternative of
// 50 mm and 2 % made 7 mm of 1 mm in a length that no measurement depends on. (With 0.27 % beyond
// three sigmas, parameters without evidence counted as 4.7 usual errors.) Of another lens, length
// or robot (other_models.h, other_robot.h) the mixture is covered in each principal direction of
// one covariance relative to the other.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Prior odds that a group's values are nominal: robots and lenses hardly ever match the drawing.
constexpr double kNominal = 0.25;
// The gain of log evidence from which a group is kept.
constexpr double kEvidence = 3;
// The spread of log factors of widths: their hyperprior's standard deviation.
const double kWidthSpread = std::log(3.0);

struct WidthProblem {
  MatrixXd normal;         // N, n x n
  VectorXd gradient;       // g
  VectorXd at;             // x0, by unknown; arbitrary for unknowns without a prior
  VectorXd start;          // s_i; 0: no prior
  std::vector<int> group;  // by unknown; -1: none, or a fixed prior of its own
  int groups = 0;
  std::vector<char> known = {};  // by group: its factor is fixed; beyond the end: it is learned
  std::vector<int> alike = {};   // by group: alike with those of the same value; -1 or beyond the
                                 // end: with none

  std::vector<char> apart = {};  // by group: its members are set one by one; beyond the end: not

  bool is_apart(int k) const { return k < static_cast<int>(apart.size()) && apart[k]; }
  bool learns(int k) const { return k >= static_cast<int>(known.size()) || !known[k]; }
};

struct Posterior {
  bool defined = false;        // false: H is not positive definite, and nothing else is set
  VectorXd value;              // x; for unknowns without a prior the step
  VectorXd variance;           // C's diagonal
  double log_determinant = 0;  // of C
  MatrixXd covariance;         // C
};
/// Returns the posterior at these factors, one per group; with the covariance only on request. It
/// allocates.
Posterior posterior(const WidthProblem& problem, const VectorXd& factor, bool covariance);

struct Widths {
  bool defined = false;
  int rounds = 0;
  VectorXd factor;  // by group
  VectorXd gamma;   // by group
  Posterior posterior;
};
/// Learns the factors, starting from `factor`, in at most `rounds` rounds.
Widths learn_widths(const WidthProblem& problem, VectorXd factor, int rounds);

/// Returns the gain of a group.
double evidence_gain(const WidthProblem& problem, const Widths& widths, int group);
/// Returns the log evidence at these factors, up to a constant; NaN if it is not defined.
double log_evidence(const WidthProblem& problem, const VectorXd& factor);
/// Returns the log hyperprior of these factors, up to a constant.
double log_hyperprior(const WidthProblem& problem, const VectorXd& factor);

/// Returns the variance of a predicted error that is normal with one of these variances, by weight:
/// no more of such errors are beyond two sigmas than of normal ones (4.55 %, k = 2 of JCGM 100).
double covering_variance(const VectorXd& variance, const VectorXd& weight);
/// Returns the covariance of predicted errors with second moment `other` at this probability, else
/// `own`: it covers so in each principal direction of one relative to the other. It allocates.
MatrixXd covering(const MatrixXd& own, const MatrixXd& other, double probability);
/// The same for an alternative in which the first unknowns are changed by `moved`.
void cover_change(const VectorXd& moved, double probability, MatrixXd& covariance);

/// The groups and components fixed for lack of evidence.
struct Selection {
  std::vector<char> held;   // by unknown
  std::vector<char> whole;  // by group
  VectorXd gain;            // by group: when it was fixed, or at the end
  VectorXd probability;     // by group: that it is wrong, if it was fixed as a whole
  VectorXd inflation;       // by group: variance of undetermined components, over the best
                            // width squared
  MatrixXd second_moment;   // of the errors of all unknowns
};
/// Fixes groups whose gain is below 3, the smallest first, testing the rest again each time (except
/// groups whose width is known). In the other groups it fixes the components to whose variance the
/// data contribute less than a tenth (1 - C_ii / t_i^2).
Selection hold(const WidthProblem& problem, const Widths& widths);

}  // namespace kincal
