// The equations of one sample against their prediction by the calibration. Linear algebra
// only; scratch grows to the largest sample and stays.
//
// Rows of the sample are [A J r] over its private unknowns, the columns it touches and the
// residual; row i has noise of variance f_i. P is the covariance of the columns and d their mean.
//   - expect(): S = T + A A' with T = diag(f) + J P J' and private unknowns N(0, 1): nothing is
//     known of them in m and rad. With H = S^-1 (rows times their noise) and u = H (r + J d), rows
//     s given the others have the covariance (H_ss)^-1 and the innovation (H_ss)^-1 u_s. Where its
//     variance is that of the private unknowns, nothing else tells of them. If a kind of noise has
//     the variance 1 + c, u_i of its row has H_ii + c H_ii^2. With T = L L', B = L^-1 A and
//     1 + B'B = M M':  H = T^-1 - Y'Y,  Y = M^-1 B' L^-1.
//   - the chi2 of all rows with private unknowns free: what is left of L^-1 (r + J d) across B.
//   - reduce(): the part of [J y] that does not depend on private unknowns, by orthogonal
//     transformations; if there are more rows than columns, a triangle of them.
// In m rows, j of them with J, p private unknowns, k columns with an uncertainty and t columns
// these take about
//     j k^2 + j^2 (k/2 + p) + j^3   and   2 m p (p + t) (and 2 m t^2 where they make a triangle)
// multiplications. With n uncertain columns in all and r = min(m - p, t + 1), Monitor::add() takes
// another r n (k + n) + r^2 (t + n + r) + r t^2. A view has at most one row more than its own
// columns, a scan all its rows.
#pragma once

#include <utility>
#include <vector>

#include "drift_watch.h"

namespace kincal {

/// Equations are those of one sample, over the stated noise. Rows of one sensor follow each other.
struct Equations {
  struct OfSensor {
    int sensor, first, count;  // rows
  };
  AlignedNumbers rows;  // of [A J r], column after column, `stride` apart
  std::ptrdiff_t stride = 0;
  int count = 0, private_size = 0;
  std::vector<int> columns;                     // of J, ascending
  std::vector<int> kind;                        // of noise, by row
  std::vector<OfSensor> sensors;                // ascending
  std::vector<std::pair<double, double>> rest;  // by kind: chi2 and dof of the noise alone

  const double* column(int c) const { return rows.data() + c * stride; }
  double* column(int c) { return rows.data() + c * stride; }
  int width() const { return private_size + static_cast<int>(columns.size()) + 1; }
  bool has_rest() const;
};

class Innovations {
 public:
  /// The information of a sample about a sensor, and about a kind of noise: variances over the
  /// stated one.
  struct OfSensor {
    int sensor;
    double chi2, dof;
  };
  struct OfNoise {
    double squares = 0, residuals = 0;
    bool seen = false;
  };

  /// Makes room for equations of this size, as for all smaller ones.
  void reserve(int rows, int privates, int columns, int kinds);
  /// Sets the results below. `variance`: of each kind of noise.
  void expect(const Equations& of, const std::vector<double>& variance, const DriftWatch& test);
  double chi2() const { return chi2_; }  // of all rows
  int dof() const { return dof_; }
  const std::vector<OfSensor>& sensors() const { return sensors_; }
  const std::vector<OfNoise>& noise() const { return noise_; }  // by kind

  /// Leaves J and y as j() and y(): y = J d + e with e ~ N(0, 1). Returns how many residuals they
  /// stand for.
  long reduce(const Equations& of, const std::vector<double>& variance);
  using Columns = Eigen::Map<const MatrixXd, 0, Eigen::OuterStride<>>;
  Columns j() const { return {block() + privates_ * stride_, left_, touched_, Stride(stride_)}; }
  Eigen::Map<const VectorXd> y() const {
    return {block() + (privates_ + touched_) * stride_, left_};
  }

 private:
  using Stride = Eigen::OuterStride<>;
  const double* block() const { return reduced_.data() + first_; }
  void factorise(const Equations& of, const std::vector<double>& variance, const DriftWatch& test);
  void invert(int rows);
  void explain(int rows, int privates);
  OfSensor sensor(const Equations& of, const Equations::OfSensor& rows);
  template <class Fill>
  int eliminate(const Fill& fill, int rows, int privates, int columns, int triangle);
  int eliminate_by_rank(int rows, int privates, int columns);
  bool is_of_full_rank(int privates);

  double chi2_ = 0;
  int dof_ = 0;
  std::vector<OfSensor> sensors_;
  std::vector<OfNoise> noise_;
  std::ptrdiff_t stride_ = 0;        // of all below
  AlignedNumbers j_, p_, right_;     // J of seen_; P of these; P J'
  AlignedNumbers factor_, inverse_;  // of T: L; L^-1 row after row
  AlignedNumbers solved_, y_;        // L^-1 [r + J d, A], row after row; Y
  AlignedNumbers reduced_;           // column after column
  AlignedNumbers triangle_, h_;
  std::vector<double> u_, share_, sigma_, along_, values_, beside_, explained_;
  std::vector<int> seen_;
  int moving_ = 0;  // rows with J: the first
  int first_ = 0, left_ = 0, privates_ = 0, touched_ = 0;
};

}  // namespace kincal
