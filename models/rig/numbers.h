// Constants and small statistics that many files need.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "../../kinematics/transform.h"  // kPi

namespace kincal {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Returns the upper median of numbers; `none` if there are none. NaN must not be among them.
inline double median(std::vector<double> numbers, double none = kNan) {
  if (numbers.empty()) return none;
  const auto middle = numbers.begin() + static_cast<std::ptrdiff_t>(numbers.size() / 2);
  std::nth_element(numbers.begin(), middle, numbers.end());
  return *middle;
}

/// A Mean sums numbers up to their mean; it is 0 without numbers.
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
