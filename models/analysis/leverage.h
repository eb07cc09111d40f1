// Influence of single samples on the estimate.
//
// With A_i, r_i the rows of sample i after the elimination of its private unknowns, C = W W' the
// covariance of all and B_i = A_i W, a Newton step without the sample moves the parameters by
//     delta_i = (S - A_i' A_i)^-1 A_i' r_i = W (I - B_i' B_i)^-1 B_i' r_i
// (Cook and Weisberg, Residuals and Influence in Regression, 1982, chapter 3, for blocks of rows):
// the sum of A_j' r_j is 0 at the solution. Squares of nothing but B_i are formed, whose singular
// values are below 1. Where one is 1 the sample alone determines a direction of the parameters.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "../../solver/progress.h"
#include "linearisation.h"

namespace kincal {

/// An Influence is the change of a column, in its sigmas, without the group; infinite: the column
/// is then not determined.
struct Influence {
  int group, column;
  double sigmas;
};

/// ReducedRows returns a group's rows after elimination of its private unknowns (reduced_rows()).
using ReducedRows = std::function<const MatrixXd&(size_t group)>;

/// Returns the influences above `least` in size, largest first (equal ones in the order of groups).
std::vector<Influence> influences(const std::vector<GroupShape>& groups,
                                  const ReducedRows& reduced_rows,
                                  const Observability& observability, double least = 1);

/// A Leverage is the change of a component, in its sigmas, without the sample (one Newton step);
/// infinite: the component is then not determined.
struct Leverage {
  std::string sample, parameter;
  double moved_sigmas;
};
/// Returns the leverages above 1 sigma, largest first. @throws Cancelled
std::vector<Leverage> leverage(const Linearisation& at, const Progress& progress = {});

}  // namespace kincal
