// A linear model of data with several kinds of noise, and its evidence: what evidence.h makes of a
// linearisation. The formulas stand there.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A LinearModel has whitened rows [J_private J_touched r] group by group. Private unknowns have
/// their priors among the rows; shared ones P, with the pull P (x - x0) and cost (x - x0)'P (x -
/// x0) at the present values x.
struct LinearModel {
  struct Group {
    int private_size = 0;
    std::vector<int> columns;  // shared ones that it touches
    MatrixXd rows;
    std::vector<int> kind;  // by row; -1: its noise is known
  };
  std::vector<Group> groups;
  VectorXd numbers;  // n_k, by kind
  MatrixXd prior;    // P
  VectorXd pull;
  double prior_cost = 0;
  VectorXd width;                // t of the priors of shared unknowns
  double log_private_prior = 0;  // -sum log t of those of private ones
};

/// Factors of the noise are no smaller: sensors are hardly ever 27 times better than stated. Data
/// without noise are, and then what is left of rounding is no evidence.
constexpr double kLeastFactor = 1.0 / 27;

struct LinearEvidence {
  double log = 0;           // NaN: it is not defined
  VectorXd factor, fitted;  // by kind
  VectorXd step;            // of the shared unknowns
};

/// Returns the evidence. The factors are looked for from the stated noise on, from a factor that
/// all have in common, and from `start` on, if it is given.
LinearEvidence evidence(const LinearModel& model, const VectorXd& start = VectorXd());

/// Returns the log evidence for factors of the noise that are known; NaN: it is not defined.
double log_evidence_at(const LinearModel& model, const VectorXd& factor);

/// Returns the covariance H^-1 of the shared unknowns at these factors; empty: it is not defined.
MatrixXd covariance_at(const LinearModel& model, const VectorXd& factor);

/// Returns the model with these of its shared unknowns, in this order, and behind them one for each
/// column of `directions`, which says how far it moves every shared unknown of the model and has
/// the prior N(0, width^2).
LinearModel with_unknowns(const LinearModel& model, const std::vector<int>& kept,
                          const MatrixXd& directions, const VectorXd& width);

}  // namespace kincal
