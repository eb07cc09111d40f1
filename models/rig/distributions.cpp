#include "distributions.h"

#include <algorithm>
#include <limits>
#include <unsupported/Eigen/SpecialFunctions>

namespace kincal {
namespace {

constexpr double kSmall = 1e-290;  // below it logarithms are taken of series, not of values
constexpr double kHalf = -0.6931471805599453;  // log 1/2

/// log(1 - exp(x)), x <= 0.
double log_complement(double x) { return std::log1p(-std::exp(x)); }

/// log(exp(-x) x^a / Gamma(a)).
double log_gamma_term(double a, double x) { return a * std::log(x) - x - Eigen::numext::lgamma(a); }

/// log Q(a, x) far above the mean, by its continued fraction.
double log_far_gamma(double a, double x) {
  double b = x + 1 - a, c = std::numeric_limits<double>::infinity(), d = 1 / b, fraction = d;
  for (int i = 1; i < 1000; ++i) {
    const double term = -i * (i - a);
    b += 2;
    d = 1 / (term * d + b);
    c = b + term / c;
    fraction *= c * d;
    if (std::abs(c * d - 1) < 1e-15) break;
  }
  return log_gamma_term(a, x) + std::log(fraction);
}

/// log of the lower tail 1 - Q(a, x).
double log_lower_gamma(double a, double x) {
  const double lower = Eigen::numext::igamma(a, x);
  return lower > kSmall ? std::log(lower) : log_gamma_term(a, x) - std::log(a);
}

double log_upper_gamma(double a, double x) {
  if (!(x > 0)) return 0;
  if (x < a) return log_complement(log_lower_gamma(a, x));
  const double upper = Eigen::numext::igammac(a, x);
  return upper > kSmall ? std::log(upper) : log_far_gamma(a, x);
}

/// log I_x(a, b), x = share / (share + rest), below the mean.
double log_beta(double a, double b, double share, double rest) {
  const double x = share / (share + rest), value = Eigen::numext::betainc(a, b, x);
  if (value > kSmall) return std::log(value);
  double sum = 1, term = 1;
  for (int i = 0; term > 1e-16 * sum; ++i) sum += term *= x * (a + b + i) / (a + 1 + i);
  return a * std::log(x) + b * std::log(rest / (share + rest)) - std::log(a) + std::log(sum) +
         Eigen::numext::lgamma(a + b) - Eigen::numext::lgamma(a) - Eigen::numext::lgamma(b);
}

/// The normal value with this upper tail, at most 1/2. Newton's method on a concave function comes
/// down from the right.
double normal_quantile(double log_tail) {
  double z = std::sqrt(std::max(0.0, -2 * log_tail));  // its tail is smaller
  for (int i = 0; i < 100; ++i) {
    const double tail = log_normal_tail(z),
                 slope = -std::exp(-z * z / 2 - tail) / std::sqrt(2 * EIGEN_PI);
    const double step = (tail - log_tail) / slope;
    z -= step;
    if (!(std::abs(step) > 1e-14 * (1 + std::abs(z)))) break;
  }
  return z;
}

/// The normal value with these tails, of which one is at most 1/2.
double deviate(double log_upper, double log_lower) {
  return log_upper < log_lower ? normal_quantile(log_upper) : -normal_quantile(log_lower);
}

}  // namespace

double log_normal_tail(double z) {
  if (z < 0) return log_complement(log_normal_tail(-z));
  if (z < 30) return std::log(0.5 * std::erfc(z / std::sqrt(2.0)));
  const double v = 1 / (z * z);
  return -z * z / 2 - std::log(z * std::sqrt(2 * EIGEN_PI)) +
         std::log1p(-v * (1 - v * (3 - v * (15 - v * (105 - 945 * v)))));
}

double log_chi2_tail(double x, double freedom) { return log_upper_gamma(freedom / 2, x / 2); }

double log_f_tail(double f, double freedom1, double freedom2) {
  if (!(f > 0)) return 0;
  if (f < 1) return log_complement(log_beta(freedom1 / 2, freedom2 / 2, freedom1 * f, freedom2));
  return log_beta(freedom2 / 2, freedom1 / 2, freedom2, freedom1 * f);
}

double log_student_tail(double t, double freedom) {
  const double beyond = kHalf + log_f_tail(t * t, 1, freedom);
  return t < 0 ? log_complement(beyond) : beyond;
}

double chi2_deviate(double x, double freedom) {
  const double at = std::max(x, kSmall);
  return deviate(log_chi2_tail(at, freedom), log_lower_gamma(freedom / 2, at / 2));
}

double f_deviate(double f, double freedom1, double freedom2) {
  const double at = std::max(f, kSmall);
  return deviate(log_f_tail(at, freedom1, freedom2), log_f_tail(1 / at, freedom2, freedom1));
}

double student_deviate(double t, double freedom) {
  const double size = normal_quantile(log_student_tail(std::abs(t), freedom));
  return t < 0 ? -size : size;
}

double chi2_quantile(double tail, double freedom) {
  const double a = freedom / 2, log_tail = std::log(tail);
  double root = std::sqrt(freedom) + std::sqrt(-2 * log_tail);  // its tail is smaller
  for (int i = 0; i < 100; ++i) {  // by the root the logarithm is concave: from the right
    const double x = root * root / 2, now = log_upper_gamma(a, x),
                 slope = -2 / root * std::exp(log_gamma_term(a, x) - now);
    const double step = (now - log_tail) / slope;
    root -= step;
    if (!(std::abs(step) > 1e-14 * root)) break;
  }
  return root * root;
}

double student_quantile(double tail, double freedom) {
  const double log_tail = std::log(tail);
  double low = 0, high = 1;
  while (log_student_tail(high, freedom) > log_tail) high *= 2;
  for (double middle = high / 2; middle > low && middle < high; middle = low + (high - low) / 2)
    (log_student_tail(middle, freedom) > log_tail ? low : high) = middle;
  return high;
}

}  // namespace kincal
