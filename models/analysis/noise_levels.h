// The noise of every sensor and joint in the data: variance components at a solution.
//
// Rows of the whitened problem fall into groups g, one per kind of noise: a part of a sensor
// (translation and rotation of a chain; joint, bearing and range of a laser; else the sensor), the
// errors of a joint (latent mode: rows d / sigma), and the priors, whose sigmas count as correct.
// Let A be the Jacobian of the whole problem, shared and private unknowns, H = A (A'A)^-1 A' the
// projection onto its columns and R = 1 - H. At the solution the residuals are r = R e, e the noise
// in sigmas. If group g's true variance is f_g times the assumed one,
//     E[q_g] = sum_j S_gj f_j,    q_g = |r_g|^2,    S_gj = tr(R_gj R_jg)
// (Helmert's variance components).
// The factors f solve S f = q; seen sigma = assumed * sqrt(f_g). Since R R = R, a row of S sums to
// the redundancy of the group,
//     sum_j S_gj = tr R_gg = sum_i (1 - h_ii),
// so where all f are alike f_g = q_g / redundancy_g: Foerstner's simplified estimator. It is not
// sufficient here: a joint's rows have small redundancies, and a camera's noise in them would be
// attributed to the joint. With N_g = A_g' A_g, C = (A'A)^-1
//     S_gj = [g = j] (n_g - 2 tr H_gg) + tr(N_g C N_j C).
// Everything depends on Gram matrices of groups alone, so rows may be compressed within a group
// (Estimation::noise_rows). Per sample let U be an orthonormal basis of its private columns' range
// in row space (thin Q), B = (1 - U U') J_shared T with T T' the shared unknowns' covariance. Then
// H = U U' (within the sample) + B B', and with rows U_g, B_g of a group
//     tr H_gg = |U_g|^2 + |B_g|^2,
//     tr(H_gj H_jg) = sum over samples of <U_g'U_g, U_j'U_j> + 2 <U_g'B_g, U_j'B_j>,
//                     plus <sum B_g'B_g, sum B_j'B_j>.
// Uncertainty: Cov q ~ 2 F S F, F = diag(q_g / redundancy_g), hence Cov f = 2 S^-1 F S F S^-1, and
// that of sigma relative to itself is sqrt(Cov f_gg) / (2 f_g). For a single group with
// much redundancy it is 1 / sqrt(2 redundancy). A group with a redundancy below 5 or below 2 % of
// its rows, or with an uncertainty above a half, cannot be estimated: it is fixed at f = 1 while
// the others are estimated. (The most uncertain one first, then the rest again.)
//
// Noise without a stated sigma is estimated with a prior, and so is stated noise that may be wrong,
// with the stated sigma as guess. Data that determine it poorly leave it near the guess; a joint
// whose noise is not determined gets that of the others.
// With u_g = ln(sigma_g / guess_g), at the present sigmas (f = 1) the restricted likelihood has
//     d L / d u_g = q_g - redundancy_g,   information 2 S_gj;
// the prior is u ~ N(0, K), K = ln(4)^2 [g, j of one kind] + ln(2)^2 [g = j]: the guess may be ten
// times off, and joints of one kind (turning, sliding; translations, rotations of poses) differ by
// a factor of two. A step of scoring is
//     d = (W^1/2 2 S W^1/2 + 2 diag(redundancy - S) + K^-1)^-1 (q - redundancy - K^-1 u),
// with f = q_g / redundancy_g and W = diag of (f - 1) / ln f where f > 1, which makes the step of a
// single level correct, 1/2 ln f, at any distance. The redundancy of noise that is small beside
// other noise falls with its variance, hence the second term: without it a step is far too long.
// `seen` is the sigma after one further step,
// its uncertainty the posterior's, sqrt((2 S + K^-1)^-1_gg). Levels with one common factor are one
// such level: q, the redundancy and S are summed over them.
//
// With a loss rows contain the roots of its weights w, n_g = sum w, and q_g is divided by its value
// for normal noise of the assumed size, b = E[w(s) s] / (m E[w(s)]), s chi-squared of the
// block's m residuals. A loss whose scale comes from the data has its scale in units of the actual
// noise, not of the assumed one: b is then that of normal noise of this size.
//
// Helmert 1907; Foerstner, "Ein Verfahren zur Schaetzung von Varianz- und Kovarianzkomponenten",
// Allg. Vermessungs-Nachrichten 86 (1979); Koch, "Parameter Estimation and Hypothesis Testing in
// Linear Models" (1999), section 3.6.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/progress.h"
#include "linearisation.h"

namespace kincal {

/// The share of a kind of noise that the data must show, of its variance; with less it cannot be
/// estimated, and nothing is said of it.
constexpr double kLeastShare = 0.02;

/// A NoiseLevel is the noise of one part of a sensor or of one joint.
struct NoiseLevel {
  std::string of;               // "sensor/NAME" or "joint/NAME"
  std::string part, unit;       // part: "" if it has one only
  int sensor = -1, joint = -1;  // index; -1: not of a sensor, joint
  int first = 0, count = 0;     // of a sensor's sigmas
  double assumed = 0;           // the rig's sigma (several: their root mean square)
  double guess = 0;             // initial guess of a sigma that is not stated; 0: it is stated
  double used = 0;         // the sigma of this result: `assumed`, unless the noise was estimated
  double seen = 0;         // NaN: cannot be estimated
  double uncertainty = 0;  // standard deviation of `seen`, relative to it; NaN as `seen`
  double redundancy = 0;   // effective number of its rows after fitting
  long rows = 0;           // whitened residuals
  int own_views = 0;  // training views with sigmas of their own: multiply these by seen / assumed

  /// Returns the 95 % interval of the true sigma of a noise without a stated value: normal in the
  /// variance below the estimate, where the noise may be zero, and normal in the logarithm above.
  std::pair<double, double> interval() const;
  /// True if seen and assumed differ by more than 20 % and by more than 3 standard deviations.
  bool differs() const;
};

/// Stated sigmas that may be wrong.
struct DoubtedNoise {
  std::optional<double> factor;  // one of all, now; none: they have none
  const Rig* stated = nullptr;   // with sigmas of which each has a factor of its own; null: none
};

/// NoiseLevels are those of a solution's sensors and joints.
struct NoiseLevels : std::vector<NoiseLevel> {
  /// Returns one line for each level that differs from the assumed one.
  std::string text() const;
};
NoiseLevels noise_levels(const Linearisation& at);
/// Returns the same from given residuals at the solution (Estimation::residuals()). @throws
/// Cancelled
NoiseLevels noise_levels(const Linearisation& at, const std::vector<ViewResiduals>& views,
                         const Progress& progress = {});
/// Returns the noise levels at a solution, with the problem prepared there (Problem::prepare) and
/// covariances as last renewed. `covariance` is that of the shared unknowns at the solution
/// (observe()). In modes marginal and point only sensors without noisy joints can be estimated.
/// Stated sigmas that may be wrong are estimated by scoring, as those that are not stated.
std::vector<NoiseLevel> noise_levels(Estimation& problem, const Rig& rig, const VectorXd& state,
                                     const MatrixXd& covariance, const DoubtedNoise& doubted = {});

/// Returns the sigma of a level in a rig; of a part of a sensor, its first.
double first_sigma(const Rig& rig, const NoiseLevel& level);

/// Returns, for each joint, the ratio of the noise of its readings to the noise that the rig
/// states; 1 if there are too few samples. The fit is in mode latent and may contain gross
/// outliers: the estimate is a median, so a minority of wrong readings has little effect. Each
/// error is divided by 1 - h_ii, because the fit absorbs the rest of it.
std::vector<double> robust_joint_ratios(const Estimation& problem, const Rig& rig,
                                        const VectorXd& state);

/// Multiplies the sigmas that could be estimated by seen / assumed, in the rig and in all views,
/// including views with their own sigmas or covariances.
void scale_noise(Rig& rig, std::vector<Sample>& samples, const std::vector<NoiseLevel>& levels);
Recording scale_noise(const Recording& recording, const std::vector<NoiseLevel>& levels);

}  // namespace kincal
