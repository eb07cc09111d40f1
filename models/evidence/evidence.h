// How well a model explains the data: the log marginal likelihood of a fit, what it would gain by
// more parameters, and the probabilities of alternatives that follow.
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
// Numbers. A view is split by an orthogonal transformation into the part of its residuals that a
// motion of the target changes, and the rest, how its points lie to each other, of m numbers. Each
// part has a factor of its own. What is wrong with a rigid view is at most six numbers; the same
// bent board or lens shows in every point of the rest, which is weighed by min(1, 6 / m): as six
// numbers, too. An error of a joint's reading (mode latent) is one number.
//
// Priors. Priors of the fit count as stated. So that models with different unknowns can be
// compared, unknowns without one have the width reference_width(): whatever two models have in
// common cancels, and one more unknown pays log(t / sigma), its Occam factor. It is not pulled
// anywhere: only the density of such a prior counts.
//
// Where a model is wrong its residuals may be put down to one kind of noise or another: log p(z |
// u) has several modes, of which the highest that is found counts. Evidence of two models that are
// both wrong may be some nats off for that.
//
// More parameters are judged at the same linearisation, with the unknowns of the fit: no fit is
// made, exact where the problem is linear. Losses are not modelled: fit without.
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

/// A NoiseKind is what has a noise factor of its own: a part of a sensor's noise
/// (SensorModel::noise_parts), once for where its targets are and once for the rest of its views,
/// or the readings of a joint.
struct NoiseKind {
  int sensor = -1, part = 0;
  bool rest = false;
  int joint = -1;
  bool operator<(const NoiseKind& o) const {
    return std::tie(sensor, part, rest, joint) < std::tie(o.sensor, o.part, o.rest, o.joint);
  }
};

/// A ModelEvidence is the log marginal likelihood of a model, and what it was integrated over.
struct ModelEvidence {
  double log = 0;                // NaN: H is not positive definite
  std::vector<NoiseKind> kinds;  // of a linear model without sensors: empty
  VectorXd factor;               // s_k at the mode, by kind
  VectorXd numbers;              // n_k
  VectorXd fitted;               // of these, so many are spent on unknowns
};

/// Returns the evidence of a fit.
ModelEvidence evidence(const Linearisation& at);

/// FittedData are samples of a recording and what was fitted to them.
struct FittedData {
  const Recording& recording;
  const std::vector<int>& samples;
  const EstimationSetup& setup;
  const Values& values;
};
/// Returns the evidence of fits of several parts of the data: each has unknowns of its own, and all
/// have the same noise.
ModelEvidence evidence(const std::vector<FittedData>& parts);
/// Returns the log evidence of such fits where the noise is known: the factors of `noise`, 1 of
/// kinds that it lacks. NaN: it is not defined.
double log_evidence_at(const std::vector<FittedData>& parts, const ModelEvidence& noise);

/// A FreeDirection is one more unknown: it moves components that the fit held, each so far, and has
/// the prior N(0, width^2) about where they are held. One component with coefficient 1: a
/// parameter.
struct FreeDirection {
  std::vector<std::pair<Component, double>> moved;
  double width = 1;
};

/// Returns for each group of further unknowns by how much freeing all of its directions raises log
/// evidence. @throws std::invalid_argument where the fit frees such a component.
std::vector<double> scores(const Linearisation& at,
                           const std::vector<std::vector<FreeDirection>>& groups);

/// Returns the width of the prior that an unknown has where the fit has none: 1 m and 1 rad for
/// poses, which may be anywhere, else its usual error (rig/scales.h).
double reference_width(const ParameterTable& table, const Component& component,
                       const VectorXd& values);

/// An Alternative is another model of the data, as what a mistake undone makes of them, and its
/// odds against the data as they are, those beforehand counted.
struct Alternative {
  NoticeKind kind = NoticeKind::square;
  Subjects where;
  double log_odds = 0;
};
/// It is a finding from these odds on; another is named with it within these.
constexpr double kFoundOdds = 99, kAsLikelyOdds = 9;

/// A WeighedModel is one of several models of the same data, one of them "as it is".
struct WeighedModel {
  double log_evidence = 0, log_odds = 0;  // of its prior, against any fixed one
  int kind = 0;                           // models of one kind share their probability
};
struct ModelProbabilities {
  std::vector<double> of_model;
  std::map<int, double> of_kind;
};
ModelProbabilities posterior(const std::vector<WeighedModel>& models);

}  // namespace kincal
