// Model evidence: the log marginal likelihood of a fit, its gain by more parameters, and the
// resulting probabilities of alternative models.
//
// Model. The residuals of kind k, whitened by the stated sigmas, are  r_k + J_k d + s_k e,
// e ~ N(0, 1), for a step d of all unknowns, shared and private, from the fit on. s_k = exp(u_k) is
// the unknown factor of the noise over the stated one, u_k ~ N(0, (ln 3)^2). Unknowns have normal
// priors with precision P. With H = sum_k J_k'J_k / s_k^2 + P and the least cost Q at the step
// -H^-1 g
//     log p(z | u) = -sum_k n_k u_k - Q / 2 - 1/2 log|H| - sum_i log t_i
// (t_i: widths of the priors; (2 pi)^(n/2) is the same for all models of the data and left out),
// and Laplace's method integrates over u at the mode of log p(z | u) - u'u / (2 (ln 3)^2): with A
// the average information there (minus the second derivative and its expectation, in the mean), log
// p(z) is the mode's value - 1/2 log|(ln 3)^2 A|. Where a problem is linear only the integral over
// u is approximate, by 1 / (6 n_k).
//
// Numbers n_k. An orthogonal transformation splits a view into the part of its residuals that a
// motion of the target changes, and the rest, the relative positions of its points, of m numbers.
// Each part has a factor of its own. The error of a rigid view is at most six numbers; a bent board
// or lens appears in every point of the rest, which is weighted by min(1, 6 / m): also as six
// numbers. An error of a joint reading (mode latent) is one number.
//
// Priors. Priors of the fit count as stated. So that models with different unknowns can be
// compared, unknowns without one have the width reference_width(): unknowns that two models have
// in common cancel, and a further unknown costs log(t / sigma), its Occam factor. This prior does
// not change the estimate: only its density counts.
//
// The residuals of a wrong model may be attributed to one kind of noise or another: log p(z | u)
// has several modes, and the highest one found counts. Evidence of two wrong models may therefore
// be wrong by some nats.
//
// More parameters are judged at the same linearisation, with the unknowns of the fit, without
// another fit; this is exact if the problem is linear. Losses are not modelled: fit without.
// docs/mathematics.md#evidence derives all this. MacKay, Neural Computation 4 (1992); Tierney and
// Kadane, JASA 81 (1986); Patterson and Thompson, Biometrika 58 (1971).
#pragma once

#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "../analysis/linearisation.h"
#include "../notices/notice.h"

namespace kincal {

/// A NoiseKind is a kind of noise with a factor of its own: a part of a sensor's noise
/// (SensorModel::noise_parts), separately for the target's pose and for the rest of its views, or
/// the readings of a joint.
struct NoiseKind {
  int sensor = -1, part = 0;
  bool rest = false;
  int joint = -1;
  bool operator<(const NoiseKind& o) const {
    return std::tie(sensor, part, rest, joint) < std::tie(o.sensor, o.part, o.rest, o.joint);
  }
};

/// A ModelEvidence is the log marginal likelihood of a model, with the noise factors over which it
/// was integrated.
struct ModelEvidence {
  double log = 0;                // NaN: H is not positive definite
  std::vector<NoiseKind> kinds;  // empty for a linear model without sensors
  VectorXd factor;               // s_k at the mode, by kind
  VectorXd numbers;              // n_k
  VectorXd fitted;               // part of n_k used by unknowns
};

/// Returns the evidence of a fit.
ModelEvidence evidence(const Linearisation& at);

/// FittedData are samples of a recording and the values fitted to them.
struct FittedData {
  const Recording& recording;
  const std::vector<int>& samples;
  const EstimationSetup& setup;
  const Values& values;
};
/// Returns the evidence of fits to several parts of the data. Each part has unknowns of its own;
/// the noise is common.
ModelEvidence evidence(const std::vector<FittedData>& parts);
/// Returns the log evidence of these fits with known noise: the factors of `noise`, and 1 for kinds
/// that it lacks. NaN: it is not defined.
double log_evidence_at(const std::vector<FittedData>& parts, const ModelEvidence& noise);

/// A FreeDirection is a further unknown that moves components fixed in the fit, each by its
/// coefficient. Its prior is N(0, width^2) about their fixed values. One component with coefficient
/// 1 is a parameter.
struct FreeDirection {
  std::vector<std::pair<Component, double>> moved;
  double width = 1;
};

/// Returns for each group of directions the gain of log evidence if all of them are estimated.
/// @throws std::invalid_argument if the fit already estimates one of the components.
std::vector<double> scores(const Linearisation& at,
                           const std::vector<std::vector<FreeDirection>>& groups);

/// Returns the prior width of an unknown without a prior in the fit: 1 m and 1 rad for poses, which
/// may be anywhere, else its usual error (rig/scales.h).
double reference_width(const ParameterTable& table, const Component& component,
                       const VectorXd& values);

/// A ReadingTrend says that errors of joint readings depend on the posture: in sample s those of
/// the axes are  at[s] c  beside their noise.
struct ReadingTrend {
  std::vector<int> axes;     // joints with such errors
  std::vector<MatrixXd> at;  // by sample of the recording: a row an axis
};
/// A WeighedTrend compares a fit with such a trend to the fit without it.
struct WeighedTrend {
  double gain = 0;  // of log evidence, with unknown noise; NaN: it is not defined
  VectorXd moved;   // of the fit's unknowns, if there is a trend
  MatrixXd wider;   // by how much its covariance is larger then
};
/// Returns one for each of these widths of c,  c_i ~ N(0, width(i)^2). The fit has mode latent.
std::vector<WeighedTrend> weigh_trend(const Linearisation& at, const ReadingTrend& trend,
                                      const std::vector<VectorXd>& widths);

/// An Alternative is another model of the data, for example with a mistake undone, and its odds
/// against the data as they are, prior odds included.
struct Alternative {
  NoticeKind kind = NoticeKind::square;
  Subjects where;
  double log_odds = 0;
};
/// Odds from which an Alternative is a finding; another one within the second factor is named with
/// it.
constexpr double kFoundOdds = 99, kAsLikelyOdds = 9;

/// A WeighedModel is one of several models of the same data, and one of these changes nothing.
struct WeighedModel {
  double log_evidence = 0, log_odds = 0;  // prior log odds, against any fixed model
  int kind = 0;                           // models of one kind share their probability
};
struct ModelProbabilities {
  std::vector<double> of_model;
  std::map<int, double> of_kind;
};
ModelProbabilities posterior(const std::vector<WeighedModel>& models);

}  // namespace kincal
