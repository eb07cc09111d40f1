// Detects whether something has moved since the calibration: a sequential test on the equations of
// samples, one at a time, with a given rate of false alarms. Linear algebra only, without robots.
//
// Model. d is the difference of the parameters from the calibrated values, N(0, P) with P the
// calibration's covariance. Sample i measures  y_i = J_i d + e_i, e_i ~ N(0, 1). Possible
// changes: from sample t on, the parameters of one group g have a further error x ~ N(0, w^2
// W_g^2); W_g is the group's usual change and w one of 1, 1/10, 1/100 (equally likely), because the
// strength of a collision is unknown.
//
// Test. While nothing moves, the innovations  v_i = y_i - J_i d_i  are independent,
// N(0, S_i = 1 + J_i P_i J_i'), where d_i, P_i are the estimate of d from P and all samples before
// i (Kalman's filter). A change x shows in them as J_i x, unless the filter has attributed it
// to an error of the calibration; so with
//     A = sum J_i' S_i^-1 J_i,  b = sum J_i' S_i^-1 v_i  (of g; samples from t on)
//     log B(g, w, t) = 1/2 b'(A + (w W)^-2)^-1 b - 1/2 log|1 + w^2 W A W|
// and  R = sum over t of the mean over g and w of B, of those B above 99. With all of them R minus
// the number of samples is a martingale while nothing moves, so the mean time until R reaches a
// limit is the mean of R at that moment (Shiryaev and Roberts; Pollak, Annals of Statistics 13
// (1985)). For changes with no effect on the data, B remains near 1; without them R is
// smaller and alarms are rarer. The mean time is kOvershoot times the limit, because R jumps over
// it, and rare jumps are large.
//
// Start times are kept more sparsely the older they are: kPerSpan of each span 1, 2, 4 ... samples.
// One that represents m others counts m times. Those older than kSpans spans are dropped.
//
// The whole model determines the change (moved()): before t the filter's d_t, P_t, from then
// on the sums of J_i'J_i and J_i'y_i, with every group and d estimated together.
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "../../solver/aligned.h"

namespace kincal {

class StateBytes;

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Mean factor by which R exceeds the limit at an alarm: 5 to 7 in simulations of groups of one to
/// six columns and widths of 5 to 100 sigmas (tests/models/monitor/drift_watch_test.cpp).
constexpr double kOvershoot = 5;

/// Share of healthy samples, or points of an image, that count as outliers: one in a million.
constexpr double kOutlier = 1e-6;
/// Number of residuals that the initial value of a noise factor counts as; its relative error is
/// then a quarter. With 5, on simulated PR2 data, the scatter of the first factors caused 6 false
/// alarms instead of the expected 2.6. With twice the noise there was none with 5 and one with 10,
/// in 300 samples.
constexpr double kNoiseKnown = 10;

/// A DriftGroup is a set of columns of the equations that change together, with their usual
/// changes.
struct DriftGroup {
  std::string name;
  std::vector<int> columns;
  VectorXd width;  // one per column, in its unit
};

/// A Moved is a group that may have moved, with the change and the probability that it was this
/// group.
struct Moved {
  int group = -1;
  double probability = 0;  // among all groups
  long since = 0;          // sample
  VectorXd change, sigma;  // one per column of the group
  double chi2 = 0;         // of the samples since then, with it
  long residuals = 0;      // number of residuals in their equations
};

class DriftWatch {
 public:
  /// `covariance` is P. All memory is allocated here. `most_rows` is the largest number of
  /// equations of one sample. @throws std::invalid_argument: sizes that do not match, a column that
  /// does not exist, a width that is not positive, a rate below 1
  DriftWatch(const MatrixXd& covariance, std::vector<DriftGroup> groups,
             double samples_between_alarms, int most_rows);

  /// Returns the bytes that it takes, by the sizes of the groups.
  static size_t memory(int columns, const std::vector<int>& groups, int most_rows);

  /// Evaluates the equations of a sample (j: rows x columns, y: rows), already divided by the
  /// noise; at most most_rows. `residuals` is the number of residuals that they represent (-1: the
  /// number of rows). Returns v'S^-1 v. Allocates nothing.
  double look(const Eigen::Ref<const MatrixXd>& j, const Eigen::Ref<const VectorXd>& y,
              long residuals = -1);
  /// The same of some columns, ascending; all others are 0. `j` is rows x columns.size().
  double look(const std::vector<int>& columns, const Eigen::Ref<const MatrixXd>& j,
              const Eigen::Ref<const VectorXd>& y, long residuals);
  /// Adds the equations last passed to look(). With `learn` they update the filter and the test,
  /// otherwise only the test (samples that fit badly must not corrupt the estimate). During an
  /// alarm the filter is not updated and no start is added, because the change would corrupt both.
  /// `sample` is the sample's number, for Moved::since. Allocates nothing.
  void take(bool learn, long sample);

  /// Returns log R; -infinity before the first sample.
  double log_statistic() const { return log_statistic_; }
  /// True from the sample at which R reached the limit, until restart().
  bool alarm() const { return alarm_; }
  /// Returns the groups that may have moved, most likely first. Allocates.
  std::vector<Moved> moved() const;
  /// Starts counting changes again. If `found` is not empty, its first change is accepted: the
  /// estimate and its covariance then include it. Allocates.
  void restart(const std::vector<Moved>& found);

  const std::vector<DriftGroup>& groups() const { return groups_; }
  /// These return the estimate of d after all samples, and its covariance.
  const VectorXd& mean() const { return mean_; }
  MatrixXd covariance() const;
  double covariance(int a, int b) const {
    const int row = known_at_[a], column = known_at_[b];
    return row < 0 || column < 0 ? 0 : covariance_[column * known_stride_ + row];
  }

  /// Writes or reads the learned state (state_bytes.h) of a watch made with the same arguments.
  /// @throws std::invalid_argument: the bytes are invalid; part of the state may have been read
  /// then
  void transfer(StateBytes& bytes);

 private:
  static constexpr int kPerSpan = 2, kSpans = 14, kStarts = kPerSpan * kSpans + 1;
  static constexpr int kLanes = 32;  // starts side by side in memory; the last ones stay 0

  /// A Start is a sample from which something may have moved. Matrices of known columns.
  struct Start {
    long first = 0;
    double weight = 0;             // number of start times that it represents
    bool sure = false;             // it was exactly this sample
    VectorXd mean;                 // of the filter before it
    VectorXd covariance;           // lower triangle, column after column
    VectorXd before, before_pull;  // sums of J'J (as sum_) and J'y before it
    double before_squares = 0;     // sum of y'y, and of how many residuals
    long before_residuals = 0;
  };
  /// A GroupSums has A and b of a group by start: for each entry of A's lower triangle, row after
  /// row, and then of b, kLanes numbers, one a start; and log of the sum of B above 99.
  struct GroupSums {
    AlignedNumbers entries;
    VectorXd log_evidence;
  };
  void set_column(int c, const Eigen::Ref<const VectorXd>& column);
  double look_at(const Eigen::Ref<const VectorXd>& y, long residuals);
  void begin(long sample);
  void set_covariance(const MatrixXd& covariance);
  void score(const std::vector<int>& columns);
  void weigh(size_t group);
  void add_sums();
  void learn();
  Moved moved_since(int place, size_t group, double& log) const;
  double log_factor(int slot, size_t group, int scale) const;
  VectorXd whole(const VectorXd& of_known) const;
  MatrixXd whole_matrix(const VectorXd& triangle_of_known) const;
  MatrixXd unpacked(const VectorXd& sum) const;
  void transfer_scores(StateBytes& bytes, int slot);
  void transfer_triangle(StateBytes& bytes, VectorXd& sum) const;
  void transfer_known(StateBytes& bytes, Start& of) const;
  const Start& start(int place) const { return starts_[order_[place]]; }
  Start& start(int place) { return starts_[order_[place]]; }

  std::vector<DriftGroup> groups_;
  double log_limit_;
  long latest_ = 0;
  bool alarm_ = false, streak_ = false;  // streak: the filter did not learn from the last sample
  double log_statistic_;
  VectorXd mean_;
  AlignedNumbers covariance_;  // of known columns
  VectorXd sum_;               // of J'J: the lower triangle, column after column
  VectorXd sum_pull_;
  double sum_squares_ = 0;
  long sum_residuals_ = 0;
  std::vector<Start> starts_;
  std::vector<int> order_;  // which of starts_: the used ones first, the latest start first
  int used_ = 0;
  std::vector<GroupSums> scores_;
  std::vector<int> known_;     // columns with a variance that is not 0
  std::vector<int> known_at_;  // by column: place in known_, or -1
  // Scratch
  std::vector<int> touched_, place_, touched_known_;
  AlignedNumbers j_, gram_;    // [J y], row after row; minus the products of its columns
  AlignedNumbers rows_;        // [J v J P], row after row
  AlignedNumbers seen_, p_;    // of known columns: J row after row; rows of P
  AlignedNumbers turned_, s_;  // (J P)'; S
  AlignedNumbers step_;        // of the mean
  AlignedNumbers more_;        // of a group's A and b: what the sample adds
  AlignedNumbers block_;       // of a group
  std::ptrdiff_t j_stride_, rows_stride_, known_stride_;
  int most_rows_, count_ = 0;  // count: rows of the sample
  long residuals_ = 0;
};

}  // namespace kincal
