// The whitened rows [L r] of views and priors at a state. How covariances of the noise modes become
// white stands at the head of estimation.h. This header is for the sources of this folder only.
#pragma once

#include <vector>

#include "motion.h"

namespace kincal {

using RowMatrix3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6>;  // on the stack

/// A Whitening says how residuals of a view become white that has no kernel, or own noise.
struct Whitening {
  VectorXd inverse_sigma;     // one a row of a block, where there are no roots
  std::vector<double> roots;  // k x k of each block of k rows, column by column (for a kernel as
                              // ScanView has them); or empty
  MatrixXd noise;             // mode marginal: U, whitened own noise assumed; or empty
  MatrixXd root;              // (1 + U U')^-1/2 = 1 - noise root noise'
};

/// A PriorRow is the row of a prior: its derivatives stand at places place .. place + count - 1 of
/// the priors' group.
struct PriorRow {
  int parameter = -1, place = 0, count = 0;
  double derivative[6];
  double r = 0;
  Vector6d log;
  Matrix6d inverse_jacobian;
};

class Rows {
 public:
  Rows(const Layout& layout, const Motion& motion);
  /// Takes over the setup's loss and noise ratios when they have changed.
  void set_losses();
  /// Evaluates the covariances at this state; false if none depends on what is estimated.
  /// Motion::prepare() must have been called.
  bool renew(const VectorXd& state, Scratch& scratch);

  bool view_rows(const PlacedView& v, const PlacedSample& s, const VectorXd& state,
                 Scratch& scratch, bool derivatives, Cost& cost) const;
  void view_input(const PlacedView& v, const VectorXd& state, Scratch& scratch) const;
  void prior_row(size_t i, const VectorXd& state, bool derivatives, PriorRow& row) const;

 private:
  ScanView scan_view(const PlacedView& v, const RowMatrix3d& side, bool derivatives,
                     Scratch& scratch) const;
  bool kernel_rows(const PlacedView& v, const VectorXd& state, Scratch& scratch, bool derivatives,
                   Cost& cost) const;
  bool plain_rows(const PlacedView& v, const VectorXd& state, Scratch& scratch, bool derivatives,
                  Cost& cost) const;

  const Layout& layout_;
  const Motion& motion_;
  std::vector<Loss> losses_;  // by sensor
  std::vector<Whitening> whitenings_;
};

}  // namespace kincal
