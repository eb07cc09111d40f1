#include "drift_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "state_bytes.h"

namespace kincal {
namespace {

using Eigen::Index;
constexpr int kWidestGroup = 32;
using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kWidestGroup,
                            kWidestGroup>;  // on the stack
constexpr double kScales[] = {1, 0.1, 0.01};
constexpr int kScaleCount = 3;
constexpr size_t kAskedStarts = 4;  // of each group, by the whole model
constexpr double kUnlikely = 7;  // log of how much less likely a start is that is not asked about
const double kLogEvidence = std::log(99);  // of one change against none: from there on it counts

double log_sum(double a, double b) {
  if (a < b) std::swap(a, b);
  return std::isinf(b) ? a : a + std::log1p(std::exp(b - a));
}

/// Replaces the lower triangle of S by its Cholesky factor, in place. S is 1 and more.
void factorise(Eigen::Ref<MatrixXd> s) {
  const Index n = s.rows();
  for (Index k = 0; k < n; ++k) {
    const double pivot = std::sqrt(s(k, k));
    s(k, k) = pivot;
    const Index below = n - k - 1;
    s.col(k).tail(below) /= pivot;
    for (Index c = k + 1; c < n; ++c) s.col(c).tail(n - c) -= s(c, k) * s.col(k).tail(n - c);
  }
}

/// Replaces each column of B by L^-1 B.
void solve_lower(const Eigen::Ref<const MatrixXd>& l, Eigen::Ref<MatrixXd> b) {
  const Index n = l.rows();
  for (Index k = 0; k < n; ++k) {
    b.row(k) /= l(k, k);
    for (Index r = k + 1; r < n; ++r) b.row(r) -= l(r, k) * b.row(k);
  }
}

}  // namespace

DriftWatch::DriftWatch(MatrixXd covariance, std::vector<DriftGroup> groups,
                       double samples_between_alarms, int most_rows)
    : groups_(std::move(groups)),
      log_limit_(std::log(samples_between_alarms / kOvershoot)),
      log_statistic_(-std::numeric_limits<double>::infinity()),
      covariance_(std::move(covariance)) {
  const Index n = covariance_.rows();
  if (covariance_.cols() != n) throw std::invalid_argument("covariance: it is not square");
  if (!covariance_.allFinite()) throw std::invalid_argument("covariance: it is not finite");
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
  sum_ = MatrixXd::Zero(n, n);
  sum_pull_ = VectorXd::Zero(n);
  j_.resize(most_rows, n);
  y_.resize(most_rows);
  through_.resize(most_rows, n);
  narrow_.resize(n, n);
  square_.resize(n, std::max<Index>(n, most_rows));
  touched_.reserve(static_cast<size_t>(n));
  place_.assign(static_cast<size_t>(n), -1);
  gain_.resize(n, most_rows);
  s_.resize(most_rows, most_rows);
  v_.resize(most_rows);
  Start empty;
  for (const DriftGroup& g : groups_) {
    const auto size = static_cast<Index>(g.columns.size());
    empty.information.push_back(MatrixXd::Zero(size, size));
    empty.pull.push_back(VectorXd::Zero(size));
  }
  empty.mean = empty.before_pull = mean_;
  empty.covariance = empty.before = sum_;
  starts_.assign(kPerSpan * kSpans + 1, empty);
}

/// Begins a start time, and merges old ones.
void DriftWatch::begin(long sample) {
  if (used_ == static_cast<int>(starts_.size())) --used_;  // the oldest drops out
  std::rotate(starts_.begin(), starts_.begin() + used_, starts_.begin() + used_ + 1);
  ++used_;
  Start& now = starts_.front();
  now.first = sample;
  now.weight = 1;
  for (MatrixXd& a : now.information) a.setZero();
  for (VectorXd& b : now.pull) b.setZero();
  now.mean = mean_;
  now.covariance = covariance_;
  now.before = sum_;
  now.before_pull = sum_pull_;
  now.before_squares = sum_squares_;
  now.before_residuals = sum_residuals_;
  // Of each weight at most kPerSpan: where there is one more, the two oldest become one of twice
  // the weight. It keeps the later one's start: a change since the other would seem smaller by the
  // samples before it.
  for (int first = 0; first < used_;) {
    int last = first;
    while (last < used_ && starts_[last].weight == starts_[first].weight) ++last;
    if (last - first <= kPerSpan) {
      first = last;
      continue;
    }
    starts_[last - 2].weight *= 2;
    starts_[last - 2].sure = false;
    std::rotate(starts_.begin() + last - 1, starts_.begin() + last, starts_.begin() + used_);
    --used_;
    first = last - 2;  // the merged one has joined the next weight
  }
}

double DriftWatch::look(const Eigen::Ref<const MatrixXd>& j, const Eigen::Ref<const VectorXd>& y,
                        long residuals) {
  // Leaves the columns that are not 0 in touched_ and, one after the other, in j_; L of S in s_,
  // L^-1 J in through_, L^-1 v in v_.
  rows_ = j.rows();
  residuals_ = residuals < 0 ? static_cast<long>(rows_) : residuals;
  touched_.clear();
  for (Index c = 0; c < j.cols(); ++c) {
    if ((j.col(c).array() == 0).all()) continue;
    j_.col(static_cast<Index>(touched_.size())).head(rows_) = j.col(c);
    touched_.push_back(static_cast<int>(c));
  }
  const Index m = rows_, n = static_cast<Index>(touched_.size());
  const auto seen = j_.topLeftCorner(m, n);
  for (Index c = 0; c < n; ++c) narrow_.col(c) = covariance_.col(touched_[c]);
  auto gain = gain_.leftCols(m);
  gain.noalias() = narrow_.leftCols(n) * seen.transpose();
  for (Index c = 0; c < n; ++c) square_.row(c).head(m) = gain.row(touched_[c]);
  auto s = s_.topLeftCorner(m, m);
  s.noalias() = seen * square_.topLeftCorner(n, m);
  s.diagonal().array() += 1;
  factorise(s);
  auto through = through_.topLeftCorner(m, n);
  through = seen;
  solve_lower(s, through);
  y_.head(m) = y;
  auto v = v_.head(m);
  v = y;
  for (Index c = 0; c < n; ++c) v -= mean_(touched_[c]) * seen.col(c);
  solve_lower(s, v);
  return v.squaredNorm();
}

double DriftWatch::log_factor(const Start& start, size_t group, int scale) const {
  const VectorXd& width = groups_[group].width;
  const Index n = width.size();
  Block a(n, n);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kWidestGroup, 1> b(n);
  for (Index i = 0; i < n; ++i) {
    const double wi = kScales[scale] * width(i);
    b(i) = wi * start.pull[group](i);
    for (Index k = 0; k < n; ++k)
      a(i, k) = wi * kScales[scale] * width(k) * start.information[group](i, k);
    a(i, i) += 1;
  }
  double log_determinant = 0;
  for (Index k = 0; k < n; ++k) {  // Cholesky's factor, and L^-1 b
    for (Index c = 0; c < k; ++c) a(k, k) -= a(k, c) * a(k, c);
    a(k, k) = std::sqrt(a(k, k));
    log_determinant += 2 * std::log(a(k, k));
    for (Index c = 0; c < k; ++c) b(k) -= a(k, c) * b(c);
    b(k) /= a(k, k);
    for (Index r = k + 1; r < n; ++r) {
      for (Index c = 0; c < k; ++c) a(r, k) -= a(r, c) * a(k, c);
      a(r, k) /= a(k, k);
    }
  }
  return 0.5 * (b.squaredNorm() - log_determinant);
}

void DriftWatch::take(bool learn, long sample) {
  const Index m = rows_, n = static_cast<Index>(touched_.size());
  if (alarm_) learn = false;
  // Of samples in a row that are not learnt from the first begins a start: it happened then.
  if (used_ == 0 || (!alarm_ && (learn || !streak_))) {
    begin(sample);
    starts_.front().sure = !learn;
  }
  streak_ = !learn;
  latest_ = sample;
  const auto j = j_.topLeftCorner(m, n), through = through_.topLeftCorner(m, n);
  const auto v = v_.head(m);
  for (Index c = 0; c < n; ++c) place_[touched_[c]] = static_cast<int>(c);
  log_statistic_ = -std::numeric_limits<double>::infinity();
  const double log_share = -std::log(static_cast<double>(groups_.size() * kScaleCount));
  for (size_t g = 0; g < groups_.size(); ++g) {
    const std::vector<int>& columns = groups_[g].columns;
    for (size_t i = 0; i < columns.size(); ++i) {
      const int at = place_[columns[i]];
      if (at < 0) continue;
      const auto row = static_cast<Index>(i);
      const double pull = through.col(at).dot(v);
      for (int s = 0; s < used_; ++s) starts_[s].pull[g](row) += pull;
      for (size_t k = 0; k <= i; ++k) {
        const int other = place_[columns[k]];
        if (other < 0) continue;
        const double a = through.col(at).dot(through.col(other));
        const auto column = static_cast<Index>(k);
        for (int s = 0; s < used_; ++s) {
          starts_[s].information[g](row, column) += a;
          if (i != k) starts_[s].information[g](column, row) += a;
        }
      }
    }
    for (int s = 0; s < used_; ++s)
      for (int scale = 0; scale < kScaleCount; ++scale) {
        const double log = log_factor(starts_[s], g, scale);
        if (log > kLogEvidence)
          log_statistic_ = log_sum(log_statistic_, std::log(starts_[s].weight) + log_share + log);
      }
  }
  alarm_ = alarm_ || log_statistic_ >= log_limit_;
  sum_squares_ += y_.head(m).squaredNorm();
  sum_residuals_ += residuals_;
  auto square = square_.topLeftCorner(n, n);
  square.noalias() = j.transpose() * j;
  for (Index c = 0; c < n; ++c) {
    sum_pull_(touched_[c]) += j.col(c).dot(y_.head(m));
    for (Index r = 0; r < n; ++r) sum_(touched_[r], touched_[c]) += square(r, c);
    place_[touched_[c]] = -1;
  }
  if (learn) {
    auto gain = gain_.leftCols(m);  // P J', then P J' L^-T
    const auto s = s_.topLeftCorner(m, m);
    for (Index k = 0; k < m; ++k) {
      gain.col(k) /= s(k, k);
      for (Index r = k + 1; r < m; ++r) gain.col(r) -= s(r, k) * gain.col(k);
    }
    mean_.noalias() += gain * v;
    covariance_.noalias() -= gain * gain.transpose();
  }
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
Moved DriftWatch::moved_since(const Start& start, size_t group, double& log) const {
  double best = log_factor(start, group, 0), scale = kScales[0];
  for (int k = 1; k < kScaleCount; ++k) {
    const double other = log_factor(start, group, k);
    if (other <= best) continue;
    best = other;
    scale = kScales[k];
  }
  const MatrixXd n = sum_ - start.before;
  const VectorXd pull = sum_pull_ - start.before_pull, b = pull - n * start.mean;
  const WholeModel found =
      whole_model(start.covariance, n, b, groups_[group].columns, scale * groups_[group].width);
  log = std::log(start.weight) + found.log_evidence -
        whole_model(start.covariance, n, b, {}, VectorXd()).log_evidence;
  const VectorXd d = start.mean + found.mean;
  Moved out;
  out.group = static_cast<int>(group);
  out.since = start.first;
  out.change = found.change;
  out.sigma = found.sigma;
  // It may have been any sample since the start before: those between would be taken for the other
  // side.
  const Start* const earlier = &start + 1;
  if (!start.sure && earlier < starts_.data() + used_) {
    const auto gap = static_cast<double>(start.first - earlier->first);
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
    std::vector<std::pair<double, const Start*>> starts;
    double sum = kNone;
    for (int s = 0; s < used_; ++s) {
      double log = kNone;
      for (int k = 0; k < kScaleCount; ++k)
        log = log_sum(log, std::log(starts_[s].weight) + log_factor(starts_[s], g, k));
      starts.push_back({log, &starts_[s]});
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
      const Moved one = moved_since(*starts[s].second, g, log);
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
      const Start& start = starts_[s];
      if (start.first != moved.since) continue;
      const MatrixXd n = sum_ - start.before;
      const VectorXd b = sum_pull_ - start.before_pull - n * start.mean;
      const WholeModel now = whole_model(start.covariance, n, b, groups_[moved.group].columns,
                                         groups_[moved.group].width);
      mean_ = start.mean + now.mean;
      covariance_ = 0.5 * (now.covariance + now.covariance.transpose());
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
  bytes.coefficients(covariance_);
  bytes.coefficients(sum_);
  bytes.coefficients(sum_pull_);
  bytes.value(sum_squares_);
  bytes.value(sum_residuals_);
  bytes.value(used_);
  if (used_ < 0 || used_ > static_cast<int>(starts_.size()))
    throw std::invalid_argument("state: it is damaged");
  for (int s = 0; s < used_; ++s) {
    Start& start = starts_[s];
    bytes.value(start.first);
    bytes.value(start.weight);
    bytes.value(start.sure);
    for (MatrixXd& a : start.information) bytes.coefficients(a);
    for (VectorXd& b : start.pull) bytes.coefficients(b);
    bytes.coefficients(start.mean);
    bytes.coefficients(start.covariance);
    bytes.coefficients(start.before);
    bytes.coefficients(start.before_pull);
    bytes.value(start.before_squares);
    bytes.value(start.before_residuals);
  }
}

}  // namespace kincal
