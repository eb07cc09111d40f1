// Constants and small statistics that many files need.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "../../kinematics/transform.h"  // kPi

namespace kincal {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Returns the number with index `smaller` (from 0) if the numbers are in ascending order. There
/// must be more numbers than `smaller`, and none may be NaN.
inline double nth_smallest(std::vector<double> numbers, std::size_t smaller) {
  const auto nth = numbers.begin() + static_cast<std::ptrdiff_t>(smaller);
  std::nth_element(numbers.begin(), nth, numbers.end());
  return *nth;
}

/// Returns the number at this share (0 to 1) of the ascending order. There must be at least one
/// number, and no NaN.
inline double quantile(std::vector<double> numbers, double share) {
  const double smaller = share * static_cast<double>(numbers.size() - 1);
  return nth_smallest(std::move(numbers), static_cast<std::size_t>(smaller));
}

/// Returns the upper median of the numbers; `none` if there are none. They must not contain NaN.
inline double median(std::vector<double> numbers, double none = kNan) {
  const std::size_t half = numbers.size() / 2;
  return numbers.empty() ? none : nth_smallest(std::move(numbers), half);
}

/// A Mean accumulates numbers. Its value is 0 without numbers.
struct Mean {
  double sum = 0;
  long count = 0;
  double value() const { return count ? sum / static_cast<double>(count) : 0; }
};

/// Returns 0, 1, ... n - 1.
inline std::vector<int> indices(size_t n) {
  std::vector<int> out(n);
  for (size_t i = 0; i < n; ++i) out[i] = static_cast<int>(i);
  return out;
}

}  // namespace kincal
