#include "drift_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "../../solver/kernels.h"
#include "state_bytes.h"

namespace kincal {
namespace {

using Eigen::Index;
constexpr int kWidestGroup = 32;
constexpr int kSquare = 8;  // numbers of a cache line: a matrix is mirrored by such squares
using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kWidestGroup,
                            kWidestGroup>;  // on the stack
constexpr double kScales[] = {1, 0.1, 0.01};
constexpr int kScaleCount = 3;
constexpr size_t kAskedStarts = 4;  // of each group, by the whole model
constexpr double kUnlikely = 7;  // log of how much less likely a start is that is not asked about
constexpr double kLargeProduct = 1e100;    // a product: its logarithm is taken before it overflows
const double kLogEvidence = std::log(99);  // of one change against none: from there on it counts

double log_sum(double a, double b) {
  if (a < b) std::swap(a, b);
  return std::isinf(b) ? a : a + std::log1p(std::exp(b - a));
}

/// Index of the first entry of row i of a lower triangle, row after row.
int row_start(int i) { return i * (i + 1) / 2; }

}  // namespace

DriftWatch::DriftWatch(const MatrixXd& covariance, std::vector<DriftGroup> groups,
                       double samples_between_alarms, int most_rows)
    : groups_(std::move(groups)),
      log_limit_(std::log(samples_between_alarms / kOvershoot)),
      log_statistic_(-std::numeric_limits<double>::infinity()) {
  const Index n = covariance.rows();
  if (covariance.cols() != n) throw std::invalid_argument("covariance: it is not square");
  if (!covariance.allFinite()) throw std::invalid_argument("covariance: it is not finite");
  if (!(samples_between_alarms >= 1))
    throw std::invalid_argument("samples_between_alarms: at least 1 is expected");
  for (const DriftGroup& g : groups_) {
    const auto size = static_cast<Index>(g.columns.size());
    if (size == 0 || size > kWidestGroup || g.width.size() != size)
      throw std::invalid_argument("group '" + g.name +
                                  "': 1 to 32 columns, with a width each, are expected");
    for (Index i = 0; i < size; ++i) {
      if (g.columns[i] < 0 || g.columns[i] >= n)
        throw std::invalid_argument("group '" + g.name + "': there is no such column");
      if (!(g.width(i) > 0) || !std::isfinite(g.width(i)))
        throw std::invalid_argument("group '" + g.name + "': a width is positive");
    }
  }
  mean_ = VectorXd::Zero(n);
  sum_ = VectorXd::Zero(n * (n + 1) / 2);
  sum_pull_ = VectorXd::Zero(n);
  most_rows_ = most_rows;
  const auto columns = static_cast<int>(n);
  j_stride_ = padded(columns + 1) + kSlack;
  rows_stride_ = padded(2 * columns + 1) + kSlack;
  known_stride_ = padded(columns) + kSlack;
  const auto numbers = [](std::ptrdiff_t stride, int count) {
    return AlignedNumbers(static_cast<size_t>(stride) * count + kSlack, 0.0);
  };
  j_ = numbers(j_stride_, most_rows);
  gram_ = numbers(j_stride_, columns + 1);
  rows_ = numbers(rows_stride_, most_rows);
  seen_ = numbers(known_stride_, most_rows);
  p_ = numbers(known_stride_, columns);
  covariance_ = p_;
  step_ = numbers(known_stride_, 1);
  turned_ = numbers(padded(most_rows) + kSlack, columns);
  s_ = numbers(padded(most_rows) + kSlack, most_rows);
  touched_.reserve(static_cast<size_t>(n));
  touched_known_.reserve(static_cast<size_t>(n));
  known_.reserve(static_cast<size_t>(n));
  known_at_.resize(static_cast<size_t>(n));
  place_.assign(static_cast<size_t>(n), -1);
  int widest = 0;
  for (const DriftGroup& g : groups_) {
    const auto size = static_cast<int>(g.columns.size());
    widest = std::max(widest, size);
    scores_.push_back({numbers(kLanes, row_start(size) + size),
                       VectorXd::Constant(kLanes, -std::numeric_limits<double>::infinity())});
  }
  block_ = numbers(kSlack, row_start(widest) + 2 * widest);
  more_ = numbers(1, row_start(widest) + widest);
  Start empty;
  empty.mean.resize(n);
  empty.covariance = sum_;
  empty.before = sum_;
  empty.before_pull = mean_;
  starts_.assign(kStarts, empty);
  for (int s = 0; s < kStarts; ++s) order_.push_back(s);
  set_covariance(covariance);
}

/// Finds the columns that P leaves uncertain: all others stay as they are.
void DriftWatch::set_covariance(const MatrixXd& covariance) {
  known_.clear();
  for (Index c = 0; c < covariance.cols(); ++c) {
    const bool known = (covariance.col(c).array() != 0).any() || mean_(c) != 0;
    known_at_[c] = known ? static_cast<int>(known_.size()) : -1;
    if (known) known_.push_back(static_cast<int>(c));
  }
  for (size_t c = 0; c < known_.size(); ++c)
    for (size_t r = 0; r < known_.size(); ++r)
      covariance_[c * static_cast<size_t>(known_stride_) + r] = covariance(known_[r], known_[c]);
}

MatrixXd DriftWatch::covariance() const {
  MatrixXd out(mean_.size(), mean_.size());
  for (Index c = 0; c < out.cols(); ++c)
    for (Index r = 0; r < out.rows(); ++r)
      out(r, c) = covariance(static_cast<int>(r), static_cast<int>(c));
  return out;
}

/// Begins a start time, and merges old ones.
void DriftWatch::begin(long sample) {
  if (used_ == kStarts) --used_;  // the oldest drops out
  std::rotate(order_.begin(), order_.begin() + used_, order_.begin() + used_ + 1);
  ++used_;
  const int slot = order_[0];
  Start& now = starts_[slot];
  now.first = sample;
  now.weight = 1;
  for (GroupSums& sums : scores_) {
    for (size_t i = static_cast<size_t>(slot); i + kSlack < sums.entries.size(); i += kLanes)
      sums.entries[i] = 0;
    sums.log_evidence(slot) = -std::numeric_limits<double>::infinity();
  }
  const auto n = static_cast<Index>(known_.size());
  double* triangle = now.covariance.data();
  for (Index c = 0; c < n; ++c) {
    now.mean(c) = mean_(known_[c]);
    triangle = std::copy_n(covariance_.data() + c * (known_stride_ + 1), n - c, triangle);
  }
  now.before = sum_;
  now.before_pull = sum_pull_;
  now.before_squares = sum_squares_;
  now.before_residuals = sum_residuals_;
  // Of each weight at most kPerSpan: where there is one more, the two oldest become one of twice
  // the weight. It keeps the later one's start: a change since the other would seem smaller by the
  // samples before it.
  for (int first = 0; first < used_;) {
    int last = first;
    while (last < used_ && start(last).weight == start(first).weight) ++last;
    if (last - first <= kPerSpan) {
      first = last;
      continue;
    }
    start(last - 2).weight *= 2;
    start(last - 2).sure = false;
    std::rotate(order_.begin() + last - 1, order_.begin() + last, order_.begin() + used_);
    --used_;
    first = last - 2;  // the merged one has joined the next weight
  }
}

double DriftWatch::look(const Eigen::Ref<const MatrixXd>& j, const Eigen::Ref<const VectorXd>& y,
                        long residuals) {
  touched_.clear();
  for (Index c = 0; c < j.cols(); ++c) {
    if ((j.col(c).array() == 0).all()) continue;
    set_column(static_cast<int>(touched_.size()), j.col(c));
    touched_.push_back(static_cast<int>(c));
  }
  return look_at(y, residuals);
}

double DriftWatch::look(const std::vector<int>& columns, const Eigen::Ref<const MatrixXd>& j,
                        const Eigen::Ref<const VectorXd>& y, long residuals) {
  touched_.assign(columns.begin(), columns.end());
  for (Index c = 0; c < j.cols(); ++c) set_column(static_cast<int>(c), j.col(c));
  return look_at(y, residuals);
}

/// Sets a column of j_.
void DriftWatch::set_column(int c, const Eigen::Ref<const VectorXd>& column) {
  for (Index i = 0; i < column.size(); ++i) j_[i * j_stride_ + c] = column(i);
}

/// With J of touched_ in j_: leaves [L^-1 J, L^-1 v, L^-1 J P] in rows_, L of S in s_.
double DriftWatch::look_at(const Eigen::Ref<const VectorXd>& y, long residuals) {
  const auto m = static_cast<int>(y.size()), t = static_cast<int>(touched_.size()),
             known = static_cast<int>(known_.size());
  count_ = m;
  residuals_ = residuals < 0 ? static_cast<long>(m) : residuals;
  set_column(t, y);
  for (int i = 0; i < m; ++i)
    std::copy_n(j_.begin() + i * j_stride_, t + 1, rows_.begin() + i * rows_stride_);
  touched_known_.clear();
  const auto seen_stride = static_cast<int>(known_stride_);
  const int s_stride = padded(m) + kSlack;
  for (int c = 0; c < t; ++c) {
    const int at = known_at_[touched_[c]];
    if (at < 0) continue;
    const int r = static_cast<int>(touched_known_.size());
    touched_known_.push_back(at);
    const double mean = mean_(touched_[c]);
    for (int i = 0; i < m; ++i) {
      const double x = j_[i * j_stride_ + c];
      seen_[i * seen_stride + r] = x;
      rows_[i * rows_stride_ + t] -= mean * x;
    }
    std::copy_n(covariance_.data() + at * known_stride_, known, p_.data() + r * known_stride_);
  }
  const int seen = static_cast<int>(touched_known_.size());
  double* const gain = rows_.data() + t + 1;
  kernels().multiply(seen_.data(), seen_stride, 1, m, seen, p_.data(), seen_stride, known, gain,
                     static_cast<int>(rows_stride_));
  for (int r = 0; r < seen; ++r)
    for (int i = 0; i < m; ++i)
      turned_[r * s_stride + i] = gain[i * rows_stride_ + touched_known_[r]];
  kernels().multiply(seen_.data(), seen_stride, 1, m, seen, turned_.data(), s_stride, m, s_.data(),
                     s_stride);
  for (int i = 0; i < m; ++i) s_[i * s_stride + i] += 1;
  kernels().cholesky(s_.data(), m, s_stride);
  kernels().solve_rows(s_.data(), m, s_stride, rows_.data(), t + 1 + known, rows_stride_);
  double out = 0;
  for (int i = 0; i < m; ++i) {
    const double v = rows_[i * rows_stride_ + t];
    out += v * v;
  }
  return out;
}

double DriftWatch::log_factor(int slot, size_t group, int scale) const {
  const VectorXd& width = groups_[group].width;
  const double* const entries = scores_[group].entries.data() + slot;
  const auto n = static_cast<int>(width.size());
  Block a(n, n);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kWidestGroup, 1> b(n);
  for (int i = 0; i < n; ++i) {
    const double wi = kScales[scale] * width(i);
    b(i) = wi * entries[(row_start(n) + i) * kLanes];
    for (int k = 0; k <= i; ++k)
      a(i, k) = wi * kScales[scale] * width(k) * entries[(row_start(i) + k) * kLanes];
    a(i, i) += 1;
  }
  double log_determinant = 0, product = 1;  // of L's diagonal, whose elements are at least 1
  for (int k = 0; k < n; ++k) {             // Cholesky's factor, and L^-1 b
    for (int c = 0; c < k; ++c) a(k, k) -= a(k, c) * a(k, c);
    a(k, k) = std::sqrt(a(k, k));
    product *= a(k, k);
    if (product > kLargeProduct || k + 1 == n) {
      log_determinant += 2 * std::log(product);
      product = 1;
    }
    for (int c = 0; c < k; ++c) b(k) -= a(k, c) * b(c);
    b(k) /= a(k, k);
    for (int r = k + 1; r < n; ++r) {
      for (int c = 0; c < k; ++c) a(r, k) -= a(r, c) * a(k, c);
      a(r, k) /= a(k, k);
    }
  }
  return 0.5 * (b.squaredNorm() - log_determinant);
}

/// Leaves what the sample adds to A and b of a group in more_.
void DriftWatch::score(const std::vector<int>& columns) {
  const auto size = static_cast<int>(columns.size()), right = static_cast<int>(touched_.size());
  int first = right, last = -1;
  for (const int c : columns) {
    if (place_[c] < 0) continue;
    first = std::min(first, place_[c]);
    last = std::max(last, place_[c]);
  }
  const double* const rows = rows_.data();
  const int width = last - first + 1, stride = padded(width), ld = static_cast<int>(rows_stride_);
  double* const products = gram_.data();
  double* const pull = products + width * stride;
  kernels().multiply(rows + first, 1, rows_stride_, width, count_, rows + first, ld, width,
                     products, stride);
  kernels().multiply(rows + right, 1, rows_stride_, 1, count_, rows + first, ld, width, pull,
                     stride);
  double* to = more_.data();
  for (int i = 0; i < size; ++i) {
    const int at = place_[columns[i]] - first;
    for (int k = 0; k <= i; ++k) {
      const int other = place_[columns[k]] - first;
      *to++ = at < 0 || other < 0 ? 0 : products[at * stride + other];
    }
  }
  for (int i = 0; i < size; ++i) {
    const int at = place_[columns[i]] - first;
    *to++ = at < 0 ? 0 : pull[at];
  }
}

/// Adds more_ to A and b of a group, for each start, and finds which B exceed 99. For the scale w
///     log B <= 1/2 b'(A + W^-2)^-1 b - 1/2 log|1 + W A W| - n log w,
/// because |1 + w^2 W A W| >= w^2n |1 + W A W|; and log B <= 1/2 b'(A + W^-2)^-1 b. The rest is
/// computed where these suffice.
void DriftWatch::weigh(size_t group) {
  const VectorXd& width = groups_[group].width;
  GroupSums& sums = scores_[group];
  const auto n = static_cast<int>(width.size());
  double form[kLanes], inverse[kLanes];
  kernels().add_and_weigh(sums.entries.data(), more_.data(), width.data(), n, kLanes, block_.data(),
                          form, inverse);
  for (int s = 0; s < kStarts; ++s) {
    double& log_sum_of = sums.log_evidence(s);
    log_sum_of = -std::numeric_limits<double>::infinity();
    if (!(0.5 * form[s] > kLogEvidence)) continue;
    const double bound =
        0.5 * (form[s] + std::log(std::max(inverse[s], std::numeric_limits<double>::min())));
    for (int scale = 0; scale < kScaleCount; ++scale) {
      if (!(bound - n * std::log(kScales[scale]) > kLogEvidence)) continue;
      const double log = log_factor(s, group, scale);
      if (log > kLogEvidence) log_sum_of = log_sum(log_sum_of, log);
    }
  }
}

void DriftWatch::take(bool learn, long sample) {
  if (alarm_) learn = false;
  // Of samples in a row that are not learnt from the first begins a start: it happened then.
  if (used_ == 0 || (!alarm_ && (learn || !streak_))) {
    begin(sample);
    start(0).sure = !learn;
  }
  streak_ = !learn;
  latest_ = sample;
  for (size_t c = 0; c < touched_.size(); ++c) place_[touched_[c]] = static_cast<int>(c);
  for (size_t g = 0; g < groups_.size(); ++g) {
    const std::vector<int>& columns = groups_[g].columns;
    if (std::all_of(columns.begin(), columns.end(), [&](int c) { return place_[c] < 0; })) continue;
    score(columns);
    weigh(g);
  }
  for (const int c : touched_) place_[c] = -1;
  constexpr double kNone = -std::numeric_limits<double>::infinity();
  log_statistic_ = kNone;
  const double log_share = -std::log(static_cast<double>(groups_.size() * kScaleCount));
  for (int s = 0; s < used_; ++s) {
    double all = kNone;
    for (const GroupSums& sums : scores_)
      if (sums.log_evidence(order_[s]) > kNone) all = log_sum(all, sums.log_evidence(order_[s]));
    if (all > kNone)
      log_statistic_ = log_sum(log_statistic_, std::log(start(s).weight) + log_share + all);
  }
  alarm_ = alarm_ || log_statistic_ >= log_limit_;
  add_sums();
  if (learn) this->learn();
}

void DriftWatch::add_sums() {
  const auto t = static_cast<int>(touched_.size());
  const int stride = padded(t + 1) + kSlack;
  std::fill_n(gram_.begin(), static_cast<std::ptrdiff_t>(t + 1) * stride, 0.0);
  kernels().subtract_product(gram_.data(), t + 1, stride, j_.data(), count_, j_stride_);
  const Index n = mean_.size();
  for (int c = 0; c < t; ++c) {
    const double* const of = gram_.data() + c * stride;
    const Index at = touched_[c];
    double* const to = sum_.data() + at * (2 * n - at - 1) / 2;
    for (int first = c, last = c; first < t; first = last) {  // runs of neighbours
      while (last < t && touched_[last] - touched_[first] == last - first) ++last;
      double* const run = to + touched_[first];
      for (int r = 0; r < last - first; ++r) run[r] -= of[first + r];
    }
    sum_pull_(at) -= of[t];
  }
  sum_squares_ -= gram_[static_cast<size_t>(t) * stride + t];
  sum_residuals_ += residuals_;
}

/// Kalman's update: with G = L^-1 J P, mean += G' v and P -= G' G.
void DriftWatch::learn() {
  const auto t = static_cast<int>(touched_.size()), known = static_cast<int>(known_.size());
  const double* const gain = rows_.data() + t + 1;
  const auto stride = static_cast<int>(known_stride_);
  kernels().multiply(rows_.data() + t, 0, rows_stride_, 1, count_, gain,
                     static_cast<int>(rows_stride_), known, step_.data(), stride);
  for (int k = 0; k < known; ++k) mean_(known_[k]) += step_[k];
  double* const p = covariance_.data();
  kernels().subtract_product(p, known, stride, gain, count_, rows_stride_);
  for (int from = 0; from < known; from += kSquare)
    for (int row = from; row < known; row += kSquare)
      for (int c = from; c < std::min(from + kSquare, known); ++c)
        for (int r = std::max(row, c + 1); r < std::min(row + kSquare, known); ++r)
          p[r * known_stride_ + c] = p[c * known_stride_ + r];
}

/// Returns a symmetric matrix of known columns with all columns, 0 where there is none.
MatrixXd DriftWatch::whole_matrix(const VectorXd& triangle_of_known) const {
  MatrixXd out = MatrixXd::Zero(mean_.size(), mean_.size());
  const double* from = triangle_of_known.data();
  for (size_t c = 0; c < known_.size(); ++c)
    for (size_t r = c; r < known_.size(); ++r)
      out(known_[r], known_[c]) = out(known_[c], known_[r]) = *from++;
  return out;
}

VectorXd DriftWatch::whole(const VectorXd& of_known) const {
  VectorXd out = VectorXd::Zero(mean_.size());
  for (size_t c = 0; c < known_.size(); ++c) out(known_[c]) = of_known(static_cast<Index>(c));
  return out;
}

/// Returns the matrix of a lower triangle, column after column.
MatrixXd DriftWatch::unpacked(const VectorXd& sum) const {
  const Index n = mean_.size();
  MatrixXd out(n, n);
  Index at = 0;
  for (Index c = 0; c < n; ++c)
    for (Index r = c; r < n; ++r, ++at) out(r, c) = out(c, r) = sum(at);
  return out;
}

namespace {

/// What the whole model says of a group that moved by N(0, E W^2 E'): M = P + E W^2 E'.
struct WholeModel {
  double log_evidence = 0;
  VectorXd mean;  // of d and the change together
  MatrixXd covariance;
  VectorXd change, sigma;
};

WholeModel whole_model(const MatrixXd& p, const MatrixXd& n, const VectorXd& b,
                       const std::vector<int>& columns, const VectorXd& width) {
  MatrixXd m = p;
  for (size_t i = 0; i < columns.size(); ++i)
    m(columns[i], columns[i]) += width(static_cast<Index>(i)) * width(static_cast<Index>(i));
  const MatrixXd one = MatrixXd::Identity(p.rows(), p.cols());
  const Lu lu(one + m * n);
  WholeModel out;
  out.covariance = lu.solve(m);
  out.mean = out.covariance * b;
  out.log_evidence = 0.5 * b.dot(out.mean) - 0.5 * lu.log_determinant();
  // The change alone: E x = E W^2 E' (1 + N M)^-1 b.
  const MatrixXd kept = lu.solve_transposed(one);  // (1 + N M)^-1, for N and M are symmetric
  const VectorXd pull = kept * b;
  const MatrixXd lost = kept * n;
  out.change.resize(width.size());
  out.sigma.resize(width.size());
  for (size_t i = 0; i < columns.size(); ++i) {
    const auto k = static_cast<Index>(i);
    const double w2 = width(k) * width(k);
    out.change(k) = w2 * pull(columns[i]);
    out.sigma(k) = std::sqrt(std::max(0.0, w2 - w2 * lost(columns[i], columns[i]) * w2));
  }
  return out;
}

}  // namespace

/// Returns how a group moved if it did so at a start: by the whole model, with the scale that the
/// innovations prefer. `log` becomes the log evidence against nothing, times the start's weight.
Moved DriftWatch::moved_since(int place, size_t group, double& log) const {
  const Start& start = this->start(place);
  const int slot = order_[place];
  double best = log_factor(slot, group, 0), scale = kScales[0];
  for (int k = 1; k < kScaleCount; ++k) {
    const double other = log_factor(slot, group, k);
    if (other <= best) continue;
    best = other;
    scale = kScales[k];
  }
  const MatrixXd n = unpacked(sum_ - start.before), known = whole_matrix(start.covariance);
  const VectorXd mean = whole(start.mean);
  const VectorXd pull = sum_pull_ - start.before_pull, b = pull - n * mean;
  const WholeModel found =
      whole_model(known, n, b, groups_[group].columns, scale * groups_[group].width);
  log = std::log(start.weight) + found.log_evidence -
        whole_model(known, n, b, {}, VectorXd()).log_evidence;
  const VectorXd d = mean + found.mean;
  Moved out;
  out.group = static_cast<int>(group);
  out.since = start.first;
  out.change = found.change;
  out.sigma = found.sigma;
  // It may have been any sample since the start before: those between would be taken for the other
  // side.
  if (!start.sure && place + 1 < used_) {
    const auto gap = static_cast<double>(start.first - this->start(place + 1).first);
    const double share = gap / (gap + static_cast<double>(latest_ - start.first + 1));
    out.sigma = (out.sigma.cwiseAbs2() + share * share / 3 * out.change.cwiseAbs2()).cwiseSqrt();
  }
  out.chi2 = sum_squares_ - start.before_squares - d.dot(2 * pull - n * d);
  out.residuals = sum_residuals_ - start.before_residuals;
  return out;
}

std::vector<Moved> DriftWatch::moved() const {
  std::vector<Moved> out;
  if (used_ == 0) return out;
  constexpr double kNone = -std::numeric_limits<double>::infinity();
  std::vector<double> logs;
  double total = kNone;
  for (size_t g = 0; g < groups_.size(); ++g) {
    // Starts by the innovations, the likeliest first; the whole model is asked about these.
    std::vector<std::pair<double, int>> starts;
    double sum = kNone;
    for (int s = 0; s < used_; ++s) {
      double log = kNone;
      for (int k = 0; k < kScaleCount; ++k)
        log = log_sum(log, std::log(start(s).weight) + log_factor(order_[s], g, k));
      starts.push_back({log, s});
      sum = log_sum(sum, log);
    }
    std::stable_sort(starts.begin(), starts.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
    double whole = kNone, asked = kNone, highest = kNone;
    Moved best;
    VectorXd mean, square;  // over the starts
    for (size_t s = 0; s < starts.size() && s < kAskedStarts; ++s) {
      if (starts[s].first < starts[0].first - kUnlikely) break;
      double log = 0;
      const Moved one = moved_since(starts[s].second, g, log);
      const VectorXd spread = one.sigma.cwiseAbs2() + one.change.cwiseAbs2();
      whole = log_sum(whole, log);
      const double share = std::exp(log - whole);
      mean = s == 0 ? one.change : VectorXd(mean + share * (one.change - mean));
      square = s == 0 ? spread : VectorXd(square + share * (spread - square));
      asked = log_sum(asked, starts[s].first);
      if (log <= highest) continue;
      highest = log;
      best = one;
    }
    best.change = mean;
    best.sigma = (square - mean.cwiseAbs2()).cwiseMax(0).cwiseSqrt();
    logs.push_back(whole + sum - asked);
    total = log_sum(total, logs.back());
    out.push_back(best);
  }
  for (size_t g = 0; g < out.size(); ++g) out[g].probability = std::exp(logs[g] - total);
  std::stable_sort(out.begin(), out.end(),
                   [](const Moved& a, const Moved& b) { return a.probability > b.probability; });
  return out;
}

void DriftWatch::restart(const std::vector<Moved>& found) {
  if (!found.empty()) {
    const Moved& moved = found.front();
    for (int s = 0; s < used_; ++s) {
      const Start& from = start(s);
      if (from.first != moved.since) continue;
      const MatrixXd n = unpacked(sum_ - from.before);
      const VectorXd mean = whole(from.mean);
      const VectorXd b = sum_pull_ - from.before_pull - n * mean;
      const WholeModel now = whole_model(whole_matrix(from.covariance), n, b,
                                         groups_[moved.group].columns, groups_[moved.group].width);
      mean_ = mean + now.mean;
      set_covariance(0.5 * (now.covariance + now.covariance.transpose()));
      break;
    }
  }
  used_ = 0;
  alarm_ = false;
  log_statistic_ = -std::numeric_limits<double>::infinity();
}

void DriftWatch::transfer(StateBytes& bytes) {
  bytes.value(latest_);
  bytes.value(alarm_);
  bytes.value(streak_);
  bytes.value(log_statistic_);
  bytes.coefficients(mean_);
  MatrixXd covariance = this->covariance();
  bytes.coefficients(covariance);
  if (!bytes.writes()) set_covariance(covariance);
  transfer_triangle(bytes, sum_);
  bytes.coefficients(sum_pull_);
  bytes.value(sum_squares_);
  bytes.value(sum_residuals_);
  bytes.value(used_);
  if (used_ < 0 || used_ > kStarts) throw std::invalid_argument("state: it is damaged");
  for (int s = 0; s < used_; ++s) {
    Start& of = start(s);
    bytes.value(of.first);
    bytes.value(of.weight);
    bytes.value(of.sure);
    transfer_scores(bytes, order_[s]);
    transfer_known(bytes, of);
    transfer_triangle(bytes, of.before);
    bytes.coefficients(of.before_pull);
    bytes.value(of.before_squares);
    bytes.value(of.before_residuals);
  }
  std::fill(more_.begin(), more_.end(), 0.0);
  if (!bytes.writes())
    for (size_t g = 0; g < groups_.size(); ++g) weigh(g);
}

void DriftWatch::transfer_triangle(StateBytes& bytes, VectorXd& sum) const {
  MatrixXd all = unpacked(sum);
  bytes.coefficients(all);
  Index at = 0;
  for (Index c = 0; c < all.cols(); ++c)
    for (Index r = c; r < all.rows(); ++r, ++at) sum(at) = all(r, c);
}

/// A of all groups, then b.
void DriftWatch::transfer_scores(StateBytes& bytes, int slot) {
  const auto size = [&](size_t g) { return static_cast<int>(groups_[g].columns.size()); };
  const auto entry = [&](size_t g, int i) -> double& {
    return scores_[g].entries[static_cast<size_t>(i) * kLanes + static_cast<size_t>(slot)];
  };
  for (size_t g = 0; g < groups_.size(); ++g) {
    MatrixXd a(size(g), size(g));
    for (int i = 0; i < size(g); ++i)
      for (int k = 0; k <= i; ++k) a(i, k) = a(k, i) = entry(g, row_start(i) + k);
    bytes.coefficients(a);
    for (int i = 0; i < size(g); ++i)
      for (int k = 0; k <= i; ++k) entry(g, row_start(i) + k) = a(i, k);
  }
  for (size_t g = 0; g < groups_.size(); ++g)
    for (int i = 0; i < size(g); ++i) bytes.value(entry(g, row_start(size(g)) + i));
}

void DriftWatch::transfer_known(StateBytes& bytes, Start& of) const {
  VectorXd mean = whole(of.mean);
  MatrixXd known = whole_matrix(of.covariance);
  bytes.coefficients(mean);
  bytes.coefficients(known);
  double* to = of.covariance.data();
  for (size_t c = 0; c < known_.size(); ++c) {
    of.mean(static_cast<Index>(c)) = mean(known_[c]);
    for (size_t r = c; r < known_.size(); ++r) *to++ = known(known_[r], known_[c]);
  }
}

}  // namespace kincal
