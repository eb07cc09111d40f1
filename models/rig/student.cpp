#include "student.h"

#include <cmath>

namespace kincal {

double student_tail(double t, double freedom) {
  const double z =
      std::sqrt(freedom * std::log1p(t * t / freedom)) * (8 * freedom + 1) / (8 * freedom + 3);
  return normal_tail(t < 0 ? -z : z);
}

double normal_tail(double t) { return 0.5 * std::erfc(t / std::sqrt(2.0)); }

double student_quantile(long n) {
  if (n == 2) return std::sqrt(2 / (0.05 * 1.95) - 2);
  constexpr double z = 1.959963984540054, q = z * z;
  const double a = 1 / static_cast<double>(n);
  return z *
         (1 + a * ((q + 1) / 4 +
                   a * (((5 * q + 16) * q + 3) / 96 +
                        a * ((((3 * q + 19) * q + 17) * q - 15) / 384 +
                             a * (((((79 * q + 776) * q + 1482) * q - 1920) * q - 945) / 92160)))));
}

}  // namespace kincal
