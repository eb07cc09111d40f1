// The solver by itself: nonlinear least squares with shared and private unknowns, without robots.
// It needs only the component `solver`.
//
//   Problem            The minimised problem: derive from it. RangeProblem: of very many tiny
//   groups. Loss               Losses that a problem may use: none, Huber, Cauchy, Tukey.
//   LevenbergMarquardt Minimises a problem; SolverOptions, SolveSummary, Outcome.
//   observe()          What the data determine at a solution: rank, covariance, and the directions
//                      that nothing determines (Observability).
#pragma once

#include "detail/solver/levenberg_marquardt.h"
#include "detail/solver/loss.h"
#include "detail/solver/observability.h"
#include "detail/solver/problem.h"
