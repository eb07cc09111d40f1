// Rank, covariance and unobservable directions of a linearised problem.
//
// Works on square roots throughout: each view's rows are compressed by QR, a group's private
// unknowns are eliminated by an orthogonal factorisation with column pivoting (by rank: a block
// that its sample does not determine loses only what it has), the remainders of all groups are
// compressed to a triangle R with R'R = S. Nothing is squared, so that 1e-14 of a squared column
// norm can be distinguished from rounding, which the normal equations cannot.
//
// Unobservable: a column of which elimination leaves at most 1e-14 of its squared norm, by itself,
// unless it has a prior. Of the others, columns scaled to unit length: a squared singular value
// of at most 1e-9 of the largest, unless priors fix the direction.
//
// A singular value this small may be rounding. Rows of priors are exact: however wide they are
// beside precise data, they determine the direction correctly. With W an orthonormal
// basis of the candidates and R_p the rows of the priors, the singular values of R_p W split W:
// those above rounding (1e-13 of the largest of R; or of what the columns were before elimination,
// whose rounding remains) are fixed, and their covariance is W (W'R'R W)^-1 W'. R maps
// W and its complement to orthogonal spaces, so this adds to the covariance of the others.
//
// The rest is unobservable. Several such directions form a subspace; its basis is brought to
// reduced echelon form with pivoting, which keeps independent gauges apart (gauges of disjoint
// parameters exactly: rounding in the entries of others, up to 3e-9 of the scaled unit vector,
// counts as 0).
//
// Of the unknowns the priors decide tr(R_p C R_p') and the data the rest, the effective number of
// parameters tr(H_data H^-1): by it chi2 of the data alone is to be judged.
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "problem.h"
#include "progress.h"

namespace kincal {

/// Number of groups between two reports of progress.
constexpr size_t kGroupsTold = 256;

struct Observability {
  /// Covariance of the shared unknowns (n x n), zero in unobservable directions.
  MatrixXd covariance;
  /// 1 for each unknown that takes part in an unobservable direction: its share of the scaled unit
  /// vector is above 1e-3.
  std::vector<char> unobservable;
  /// The larger entries of each unobservable direction, as (column, coefficient) in real units,
  /// scaled so that the largest is 1. Entries below 0.02 (of the scaled unit vector) are omitted.
  std::vector<std::vector<std::pair<int, double>>> directions;
  /// The same directions with all coefficients (n x directions).
  MatrixXd null_space;
  /// A root of the covariance: covariance = root root'.
  MatrixXd root;
  /// Number of whitened residuals, priors included.
  long rows = 0;
  /// Rank of the derivatives by all unknowns, private ones included.
  long rank = 0;
  long dof() const { return rows - rank; }
  /// Number of rows that are priors of shared unknowns, and their chi2.
  long prior_rows = 0;
  double prior_chi2 = 0;
  /// Effective number of unknowns that these priors determine instead of the data.
  double decided_by_priors = 0;
  /// Returns the degrees of freedom of the data alone; 0 if the difference is only rounding.
  double dof_data() const {
    const double left = static_cast<double>(rows - prior_rows - rank) + decided_by_priors;
    return left > 1e-6 ? left : 0;
  }
};

/// Computes the observability at a solution, with covariances as last renewed. It allocates. `kept`
/// receives for each group, in order, [J_touched r] after elimination of its private unknowns: a
/// few rows whose Gram matrices sum to that of the reduced system. Groups beyond a total of 32 MB
/// are not kept; reduced_rows() computes them again.
/// @throws Cancelled
Observability observe(Problem& problem, const VectorXd& state,
                      std::vector<MatrixXd>* kept = nullptr, const Progress& progress = {});

/// Computes these rows, identical to those kept, for one group of a problem prepared at `state`.
MatrixXd reduced_rows(const Problem& problem, const VectorXd& state, size_t group);

/// Eliminates a group's private unknowns, the first `private_size` columns of its rows [J_private
/// J_touched r] (Problem::square_root). Returns the remaining rows of [J_touched r], at most as
/// many as it has columns plus undetermined private unknowns, and adds the rank of the private
/// columns to `rank`. Without private unknowns it returns the rows unchanged.
MatrixXd eliminate(MatrixXd rows, int private_size, long& rank);

}  // namespace kincal
