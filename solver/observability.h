// What the data determine: rank, covariance, and the directions that nothing holds.
//
// Works on square roots throughout: each view's rows are compressed by QR, a group's private unknowns are eliminated by an
// orthogonal factorisation with column pivoting (by rank: a block that its sample does not determine loses only what it has),
// the remainders of all groups are compressed to a triangle R with R'R = S. Nothing is squared, so that 1e-14 of a squared
// column norm can be told from rounding, which the normal equations cannot.
//
// Unobservable: a column of which elimination leaves at most 1e-14 of its squared norm, by itself. Of the others, columns scaled
// to unit length: a squared singular value of at most 1e-9 of the largest. Several such directions form a subspace; its basis is
// brought to reduced echelon form with pivoting, which keeps independent gauges apart (gauges of disjoint parameters exactly).
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "problem.h"

namespace kincal {

struct Observability {
  MatrixXd covariance;           // of the shared unknowns, n x n; zero in directions that are unobservable
  std::vector<char> unobservable;  // takes part in such a direction with more than 1e-3 of its scaled unit vector
  /// Per direction: (column, coefficient) of what has more than 0.02; real units, the largest scaled one is 1.
  std::vector<std::vector<std::pair<int, double>>> directions;
  MatrixXd null_space;           // n x directions: the same with all their coefficients, real units, the largest scaled one is 1
  MatrixXd root;                 // covariance = root root'
  long rows = 0;                 // whitened residuals, priors included
  long rank = 0;                 // of all unknowns, private ones included
  long dof() const { return rows - rank; }
};

/// At a solution. Covariances as they were last renewed. Allocates. `left`: for every group [J_touched r] after the elimination of its
/// private unknowns, a few rows whose Gram matrices sum up to that of the reduced system.
Observability observe(Problem& problem, const VectorXd& state, std::vector<MatrixXd>* left = nullptr);

}  // namespace kincal
