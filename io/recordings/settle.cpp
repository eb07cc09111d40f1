#include "settle.h"

#include <algorithm>
#include <cmath>
#include <deque>

#include "../../models/rig/distributions.h"
#include "../../models/rig/numbers.h"

namespace kincal {
namespace {

constexpr double kNoiseWindow = 0.25;   // s
constexpr size_t kLeastInWindow = 8;    // values
constexpr double kQuantile = 0.1;       // of windows
constexpr double kTolerance = 6;        // in scatters
constexpr double kStepTolerance = 1.5;  // in steps of an encoder
constexpr double kNoTrend =
    12;  // F of two and n - 3 degrees of freedom: 1 in 4000 of noise is above
constexpr double kJitters = 0.1;  // of the windows at rest, at least

/// A NoiseWindow is what a parabola says of some values: what it leaves (standard deviation), and
/// how much it explains, in variances of what it leaves, for each of its two slopes.
struct NoiseWindow {
  double deviation = 0, trend = 0, range = 0;
};

NoiseWindow noise_window(const Series& s, size_t first, size_t end) {
  NoiseWindow out;
  const auto [least, greatest] =
      std::minmax_element(s.values.begin() + static_cast<std::ptrdiff_t>(first),
                          s.values.begin() + static_cast<std::ptrdiff_t>(end));
  out.range = *greatest - *least;
  const size_t n = end - first;
  const double begin = s.times[first], half = (s.times[end - 1] - begin) / 2;
  std::vector<double> basis[3], left(n);
  for (size_t i = 0; i < n; ++i) {
    const double t = (s.times[first + i] - begin) / half - 1;
    basis[0].push_back(1);
    basis[1].push_back(t);
    basis[2].push_back(t * t);
    left[i] = s.values[first + i] - s.values[first];
  }
  const auto dot = [&](const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (size_t i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
  };
  for (int k = 0; k < 3; ++k) {  // Gram and Schmidt
    for (int j = 0; j < k; ++j) {
      const double share = dot(basis[k], basis[j]);
      for (size_t i = 0; i < n; ++i) basis[k][i] -= share * basis[j][i];
    }
    const double length = std::sqrt(dot(basis[k], basis[k]));
    if (length < 1e-9) return out;  // all at one time
    for (double& b : basis[k]) b /= length;
    const double share = dot(left, basis[k]);
    if (k > 0) out.trend += share * share / 2;
    for (size_t i = 0; i < n; ++i) left[i] -= share * basis[k][i];
  }
  const double variance = dot(left, left) / static_cast<double>(n - 3);
  out.deviation = std::sqrt(variance);
  out.trend = variance > 0 ? out.trend / variance : out.trend > 0 ? kInfinity : 0;
  return out;
}

/// What a share of the standard deviations of k degrees of freedom is below, of a Gaussian with
/// sigma 1.
double usual_deviation(double k, double share) {
  return std::sqrt(chi2_quantile(1 - share, k) / k);
}

/// Value i of a series, and how it goes on there: the slope of the parabola through it and its
/// neighbours.
double slope_at(const Series& s, size_t i, double gap) {
  const bool before = i > 0 && s.times[i] - s.times[i - 1] <= gap,
             after = i + 1 < s.size() && s.times[i + 1] - s.times[i] <= gap;
  const auto chord = [&](size_t a) {
    return (s.values[a + 1] - s.values[a]) / (s.times[a + 1] - s.times[a]);
  };
  if (!before && !after) return 0;
  if (!before) return chord(i);
  if (!after) return chord(i - 1);
  const double left = s.times[i] - s.times[i - 1], right = s.times[i + 1] - s.times[i];
  return (chord(i - 1) * right + chord(i) * left) / (left + right);
}

/// Indices of the values in a time: [first, second).
std::pair<size_t, size_t> range_of(const Series& series, const TimeInterval& in) {
  const auto begin = series.times.begin();
  return {static_cast<size_t>(std::lower_bound(begin, series.times.end(), in.begin) - begin),
          static_cast<size_t>(std::upper_bound(begin, series.times.end(), in.end) - begin)};
}

/// Least and greatest of the values in a window that moves on.
class WindowRange {
 public:
  explicit WindowRange(const std::vector<double>& values) : values_(values) {}
  void add(size_t i) {
    while (!least_.empty() && values_[least_.back()] >= values_[i]) least_.pop_back();
    while (!greatest_.empty() && values_[greatest_.back()] <= values_[i]) greatest_.pop_back();
    least_.push_back(i);
    greatest_.push_back(i);
  }
  void drop_before(size_t i) {
    while (!least_.empty() && least_.front() < i) least_.pop_front();
    while (!greatest_.empty() && greatest_.front() < i) greatest_.pop_front();
  }
  double range() const {
    return least_.empty() ? 0 : values_[greatest_.front()] - values_[least_.front()];
  }
  double range_with(double value) const {
    return least_.empty() ? 0
                          : std::max(value, values_[greatest_.front()]) -
                                std::min(value, values_[least_.front()]);
  }

 private:
  const std::vector<double>& values_;
  std::deque<size_t> least_, greatest_;
};

struct Stretch {
  size_t first, last;  // of its values
};

}  // namespace

double scatter_at_rest(const Series& series) {
  std::vector<double> deviations, jitters;
  const double step = smallest_step(series);
  size_t constant = 0;
  for (size_t first = 0; first < series.size();) {
    size_t end = first;
    while (end < series.size() &&
           (series.times[end] < series.times[first] + kNoiseWindow || end - first < kLeastInWindow))
      ++end;
    if (end - first >= kLeastInWindow) {
      const NoiseWindow window = noise_window(series, first, end);
      const double freedom = static_cast<double>(end - first) - 3;
      deviations.push_back(window.deviation / usual_deviation(freedom, kQuantile));
      if (window.range <= 1.001 * step)
        ++constant;
      else if (window.trend < kNoTrend)
        jitters.push_back(window.deviation / usual_deviation(freedom, 0.5));
    }
    first = end;
  }
  if (deviations.empty()) return 0;
  const auto all = static_cast<double>(deviations.size()), resting = static_cast<double>(constant),
             jittering = static_cast<double>(jitters.size());
  if (resting > kQuantile * all && jittering > kJitters * (resting + jittering))
    return median(std::move(jitters), 0);
  return nth_smallest(std::move(deviations), static_cast<size_t>(kQuantile * all));
}

double smallest_step(const Series& series) {
  double least = 0;
  for (size_t i = 1; i < series.size(); ++i) {
    const double step = std::abs(series.values[i] - series.values[i - 1]);
    if (step > 1e-12 * std::abs(series.values[i]) && (least == 0 || step < least)) least = step;
  }
  return least;
}

double still_tolerance(const Series& series) {
  return std::max(kTolerance * scatter_at_rest(series), kStepTolerance * smallest_step(series));
}

Intervals still_intervals(const Series& series, double tolerance, double longest_gap) {
  std::vector<Stretch> stretches;  // that cannot be made longer; neither end goes back
  WindowRange window(series.values);
  size_t end = 0;
  for (size_t first = 0; first < series.size(); ++first) {
    window.drop_before(first);
    end = std::max(end, first);
    const size_t before = end;
    for (; end < series.size(); ++end) {
      if (end > first && series.times[end] - series.times[end - 1] > longest_gap) break;
      if (window.range_with(series.values[end]) > 2 * tolerance) break;
      window.add(end);
    }
    if (end > before && end - first > 1) stretches.push_back({first, end - 1});
  }
  const auto length = [&](const Stretch& s) {
    return series.times[s.last] - series.times[s.first];
  };
  std::vector<Stretch> by_length = stretches, taken;
  std::stable_sort(by_length.begin(), by_length.end(),
                   [&](const Stretch& a, const Stretch& b) { return length(a) > length(b); });
  std::vector<char> used(series.size(), 0);
  for (Stretch s : by_length) {
    while (s.first <= s.last && used[s.first]) ++s.first;
    while (s.last > s.first && used[s.last]) --s.last;
    if (s.first >= s.last) continue;
    for (size_t i = s.first; i <= s.last; ++i) used[i] = 1;
    taken.push_back(s);
  }
  std::sort(taken.begin(), taken.end(),
            [](const Stretch& a, const Stretch& b) { return a.first < b.first; });
  Intervals out;
  for (const Stretch& s : taken) out.push_back({series.times[s.first], series.times[s.last]});
  return out;
}

double independent(const Series& series, const TimeInterval& over) {
  const auto [first, end] = range_of(series, over);
  double squares = 0;
  for (size_t i = first, run = 0; i < end; ++i) {
    ++run;
    if (i + 1 < end && series.values[i + 1] == series.values[i]) continue;
    squares += static_cast<double>(run * run);
    run = 0;
  }
  const auto n = static_cast<double>(end - first);
  return squares > 0 ? n * n / squares : 0;
}

TimeInterval without_slow_ends(const Series& series, const TimeInterval& rest, double scatter) {
  constexpr size_t block = 8;
  const double quarter = rest.length() / 4;
  const TimeInterval half{rest.begin + quarter, rest.end - quarter};
  const double middle = average(series, half).mean, in_middle = independent(series, half);
  // A mean of readings that count is known to a part of a step.
  const double step = smallest_step(series) / std::sqrt(12. * static_cast<double>(block));
  auto [first, end] = range_of(series, rest);
  const auto off = [&](size_t from) {
    Mean mean;
    for (size_t i = from; i < from + block; ++i) mean.sum += series.values[i], ++mean.count;
    const double in_block =
        independent(series, {series.times[from], series.times[from + block - 1]});
    const double sigma =
        scatter / std::sqrt(std::max(1., in_middle > 0 ? std::min(in_middle, in_block) : in_block));
    return std::abs(mean.value() - middle) > 3 * std::max(step, sigma);
  };
  TimeInterval out = rest;
  while (first + block < end && series.times[first + block] < rest.begin + quarter && off(first))
    out.begin = series.times[first += block];
  while (end > first + block && series.times[end - 1 - block] > rest.end - quarter &&
         off(end - block))
    out.end = series.times[(end -= block) - 1];
  return out;
}

double longest_gap(const std::vector<double>& times) {
  std::vector<double> gaps;
  for (size_t i = 1; i < times.size(); ++i) gaps.push_back(times[i] - times[i - 1]);
  return std::max(0.1, 5 * median(gaps, 0));
}

Intervals coverage(const std::vector<double>& times, double longest_gap) {
  Intervals out;
  for (size_t i = 0; i < times.size(); ++i)
    if (i > 0 && times[i] - times[i - 1] <= longest_gap)
      out.back().end = times[i];
    else
      out.push_back({times[i], times[i]});
  return out;
}

int interval_at(const Intervals& intervals, double time) {
  for (size_t i = 0; i < intervals.size(); ++i)
    if (intervals[i].contains(time)) return static_cast<int>(i);
  return -1;
}

Intervals united(Intervals a, const Intervals& b) {
  a.insert(a.end(), b.begin(), b.end());
  std::sort(a.begin(), a.end(),
            [](const TimeInterval& x, const TimeInterval& y) { return x.begin < y.begin; });
  Intervals out;
  for (const TimeInterval& one : a)
    if (!out.empty() && one.begin <= out.back().end)
      out.back().end = std::max(out.back().end, one.end);
    else
      out.push_back(one);
  return out;
}

Intervals intersected(const Intervals& a, const Intervals& b) {
  Intervals out;
  for (size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    const TimeInterval both{std::max(a[i].begin, b[j].begin), std::min(a[i].end, b[j].end)};
    if (both.begin < both.end) out.push_back(both);
    if (a[i].end < b[j].end)
      ++i;
    else
      ++j;
  }
  return out;
}

Intervals complement(const Intervals& of, double begin, double end) {
  Intervals out;
  double at = begin;
  for (const TimeInterval& one : of) {
    if (one.begin > at) out.push_back({at, std::min(one.begin, end)});
    at = std::max(at, one.end);
  }
  if (at < end) out.push_back({at, end});
  return out;
}

double quietest(const Series& series, double length, double longest_gap) {
  double least = kInfinity;
  WindowRange window(series.values);
  for (size_t first = 0, end = 0; first < series.size(); ++first) {
    if (end < first) end = first;
    window.drop_before(first);
    while (end < series.size() &&
           (end == first || series.times[end - 1] - series.times[first] < length)) {
      if (end > first && series.times[end] - series.times[end - 1] > longest_gap) break;
      window.add(end++);
    }
    if (series.times[end - 1] - series.times[first] >= length)
      least = std::min(least, window.range() / 2);
  }
  return least;
}

double Average::sigma(double sigma) const {
  return std::sqrt(sigma * sigma +
                   (count > 0 ? scatter * scatter / static_cast<double>(count) : 0));
}

Average average(const Series& series, const TimeInterval& over) {
  const auto [first, end] = range_of(series, over);
  Average out;
  Mean mean;
  for (size_t i = first; i < end; ++i) mean.sum += series.values[i], ++mean.count;
  out.mean = mean.value();
  out.count = mean.count;
  double squares = 0;
  for (size_t i = first; i < end; ++i)
    squares += (series.values[i] - out.mean) * (series.values[i] - out.mean);
  if (out.count > 1) out.scatter = std::sqrt(squares / static_cast<double>(out.count - 1));
  return out;
}

double value_at(const Series& series, double time, double longest_gap) {
  const auto next = static_cast<size_t>(
      std::lower_bound(series.times.begin(), series.times.end(), time) - series.times.begin());
  if (next == series.size()) return kNan;
  if (series.times[next] == time) return series.values[next];
  if (next == 0 || series.times[next] - series.times[next - 1] > longest_gap) return kNan;
  const size_t a = next - 1;
  const double h = series.times[next] - series.times[a], u = (time - series.times[a]) / h;
  const double left = h * slope_at(series, a, longest_gap),
               right = h * slope_at(series, next, longest_gap);
  const double p = series.values[a], q = series.values[next];
  return p + u * (left + u * (3 * (q - p) - 2 * left - right + u * (left + right - 2 * (q - p))));
}

}  // namespace kincal
