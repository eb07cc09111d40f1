// When something is still, and what it is then: series of numbers over time.
//
// Noise. The scatter of a series at rest is what a parabola leaves inside windows of 1/4 s (of 8
// values at least), so that motion makes little of it. Motion that no parabola follows makes some
// windows larger, so a low quantile (a tenth) of the windows' standard deviations is taken, divided
// by what that quantile is of a Gaussian's (chi^2 of n - 3 degrees of freedom). Encoders that count
// have no scatter at all while they rest; the smallest step between two readings stands beside it.
// Some drivers repeat a reading bit by bit in some rests (a brake, a
// filter, a stall) and not in others: where more than a tenth of the windows are constant (within
// one step), but more than a tenth of those at rest are not, the median is taken of those which
// jitter: windows of which a parabola explains no more than chance does (F below 12).
//
// Rest. A stretch is still if all its values are within a band of twice the tolerance. Of all
// stretches that cannot be made longer the longest are taken first, so that a rest is whole and
// what creeps is cut outside of it. Ways begin and end slowly, inside the band: at the ends blocks
// of eight values are cut off whose mean is more than three of its sigmas from the mean of the
// middle half.
//
// Averages. n readings of scatter s have a mean of scatter s / sqrt(n). What a rest does not
// average away (gears, bending, the lens) is in the rig's sigma: the mean's own is
//     sigma^2 = s^2 / n + sigma_rig^2.
// A reading that is repeated bit by bit is one, however often: with runs of n_k equal values, n is
// (sum n_k)^2 / sum n_k^2.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace kincal {

/// A Series is one number over time; times ascend.
struct Series {
  std::vector<double> times;  // s
  std::vector<double> values;

  size_t size() const { return times.size(); }
};

/// A TimeInterval, s.
struct TimeInterval {
  double begin = 0, end = 0;

  double length() const { return end - begin; }
  bool contains(double time) const { return time >= begin && time <= end; }
};
using Intervals = std::vector<TimeInterval>;  // ascending, apart from each other

/// Returns the scatter of a series while it rests; 0 where it has none, or too few values.
double scatter_at_rest(const Series& series);

/// Returns the smallest step between values that follow each other; 0: they are all equal.
double smallest_step(const Series& series);

/// Returns how far a value may be from the middle while the series is still: six times the scatter,
/// or one and a half steps of what counts.
double still_tolerance(const Series& series);

/// Returns the stretches in which all values are within +-tolerance of their middle; none goes over
/// a gap of more than `longest_gap` s without values. Single values are no stretch.
Intervals still_intervals(const Series& series, double tolerance, double longest_gap);

/// Returns of how many independent values those in a time are: repeated ones are one.
double independent(const Series& series, const TimeInterval& over);

/// Returns a rest without the beginnings of ways at its ends; half of it stays at least. `scatter`
/// is of one value.
TimeInterval without_slow_ends(const Series& series, const TimeInterval& rest, double scatter);

/// Returns the gap between two values that is unusual: five times the usual one, at least 0.1 s.
double longest_gap(const std::vector<double>& times);

/// Returns when there are values, without gaps of more than `longest_gap` s.
Intervals coverage(const std::vector<double>& times, double longest_gap);
/// Returns which of them a time is in; -1: none.
int interval_at(const Intervals& intervals, double time);
/// Returns what is in either.
Intervals united(Intervals a, const Intervals& b);
/// Returns what is in both.
Intervals intersected(const Intervals& a, const Intervals& b);
/// Returns the times between `begin` and `end` that are in none of them.
Intervals complement(const Intervals& of, double begin, double end);

/// Returns how far apart values are within a time of this length at least, in the quietest such
/// time: half their range; infinite where there is no such time.
double quietest(const Series& series, double length, double longest_gap);

/// An Average over an interval.
struct Average {
  double mean = 0, scatter = 0;  // scatter: of one value
  long count = 0;

  /// Returns the mean's sigma, where one value has `sigma` that averaging does not remove.
  double sigma(double sigma) const;
};
Average average(const Series& series, const TimeInterval& over);

/// Returns the value at a time by the cubic through the four values around it; NaN: outside, or in
/// a gap of more than `longest_gap` s.
double value_at(const Series& series, double time, double longest_gap);

}  // namespace kincal
