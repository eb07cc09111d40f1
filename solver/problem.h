// The problem that the solver minimises.
//
// Cost = 1/2 sum_k rho(|r_k|^2) over residual blocks r_k, whitened. Unknowns are shared (columns 0
// .. n-1) or private to a group; a group (one sample of a robot, one point of a bundle adjustment)
// sees only its own private unknowns and some shared columns, so the normal equations are an
// arrowhead:
//     [ P_1           Q_1 ] [dp_1]     [a_1]
//     [      P_2      Q_2 ] [dp_2] = - [a_2]
//     [ Q_1' Q_2' ..  C   ] [dx  ]     [b  ]
// A group's part of it is the Gram matrix of [J_private J_shared r] over its columns; that is all a
// problem must compute. Its private rows are kept by group, the rest is added to C and b.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <exception>
#include <string>
#include <utility>
#include <vector>

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// LinearSolver selects the solver for the reduced system of the shared unknowns
/// (reduced_system.h).
enum class LinearSolver { automatic, dense, sparse, cholmod };

/// A MissingLibrary is thrown if CHOLMOD is needed and cannot be loaded.
class MissingLibrary : public std::exception {
 public:
  explicit MissingLibrary(std::string text) : text_(std::move(text)) {}
  const char* what() const noexcept override;

 private:
  std::string text_;
};

/// `chi2` is the sum of squared whitened residuals; `doubled` is twice the minimised cost, with
/// losses.
struct Cost {
  double doubled = 0, chi2 = 0;
};

struct GroupShape {
  int private_size = 0;
  std::vector<int> columns;  // shared columns that the group touches, ascending
  int rows = 0;              // whitened residuals, priors of private unknowns included
  int size() const { return private_size + static_cast<int>(columns.size()); }
};

/// GroupEquations are the destinations of a group's part of the normal equations. Places 0 .. m - 1
/// are the group's shared columns, in order.
struct GroupEquations {
  double* rows;    // [P | Q | a], initially zero: private_size rows of size() + 1 numbers; of P the
                   // upper triangle counts
  int stride;      // between rows
  double* shared;  // C at places i >= j is added to shared[origin[row[j]] + row[i]]
  const std::ptrdiff_t* origin;
  const int* row;
  double* gradient;  // b at place i is added to gradient[row[i]]
};

/// A Problem is a nonlinear least-squares problem in groups. Its state is one vector that only the
/// problem interprets. Calls with different workers may run at the same time; `worker` selects
/// scratch space. No result may depend on the number of workers.
class Problem {
 public:
  virtual ~Problem() = default;
  virtual int shared_size() const = 0;
  virtual const std::vector<GroupShape>& groups() const = 0;
  /// Returns the group with the priors of shared unknowns, which has no private unknowns; -1: none.
  /// To keep a sparse system sparse, a prior may couple only adjacent columns on which the same
  /// groups depend, as those of one pose.
  virtual int prior_group() const { return -1; }
  /// Allocates scratch for workers 0 .. count - 1.
  virtual void set_workers(int count) = 0;

  /// Computes the data that groups share. Called once before evaluate(), linearise() or
  /// square_root() of all groups at this state.
  virtual void prepare(const VectorXd& state) = 0;
  /// Computes the cost of a group. Returns false if a residual is undefined.
  virtual bool evaluate(int group, const VectorXd& state, int worker, Cost& cost) const = 0;
  /// Adds the Gram matrix of [J_private J_touched r], weighted by the losses' slopes, to the normal
  /// equations.
  virtual bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                         Cost& cost) const = 0;
  /// Between these two calls, linearise() of the worker's groups may keep back its contributions to
  /// C and b, to sum them first. end_piece() adds them; the places of `to` are then all shared
  /// columns. They are not used for sparse systems.
  virtual void begin_piece(int /*worker*/) const {}
  virtual void end_piece(int /*worker*/, const GroupEquations& /*to*/) const {}
  /// Computes a square root of the same: rows A with A'A = gram, by QR of each view, without
  /// squaring the residuals.
  virtual bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const = 0;
  /// Applies a step to `state` and writes the result to `moved`. `private_step` has the private
  /// unknowns group after group.
  virtual void retract(const VectorXd& state, const VectorXd& shared_step,
                       const VectorXd& private_step, VectorXd& moved) const = 0;
  /// Evaluates state-dependent covariances at this state and keeps them from then on. Returns false
  /// if no covariance depends on the state.
  virtual bool renew(const VectorXd& state) = 0;
};

/// A RangeProblem has very many tiny groups (bundle adjustment). The solver passes them in ranges,
/// so that several can be computed at once. It linearises again instead of keeping the groups'
/// rows, because this is cheaper here. Adjacent shared columns (of one camera) are coupled to
/// others only through private unknowns: linearise() writes only the diagonal blocks of C.
class RangeProblem : public Problem {
 public:
  static constexpr int kRange = 64;  // most groups of a range
  /// Evaluates groups first .. last - 1, any number of them, and adds their cost to `cost`.
  virtual bool evaluate_range(int first, int last, const VectorXd& state, int worker,
                              Cost& cost) const = 0;
  /// Prepares the following linearise() of these groups.
  virtual void prepare_range(int first, int last, const VectorXd& state, int worker) const = 0;
  /// Writes [P | a | a + Q dx] of these groups to `rows`: group after group, private_size rows of
  /// private_size + 2 numbers, upper triangle of P. `rows` has slack at its end.
  virtual void recompute_rows(int first, int last, const VectorXd& state,
                              const VectorXd& shared_step, int worker, double* rows) const = 0;
};

}  // namespace kincal
