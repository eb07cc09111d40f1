// Tails of the normal, chi-squared, F and Student's distribution, to rounding, and those quantiles
// that are asked for.
//
// With the regularised incomplete gamma and beta functions Q and I (Abramowitz, Stegun 6.5, 26.5)
//     P(chi2_k > x) = Q(k / 2, x / 2),   P(F_(a,b) > f) = I_(b / (b + a f))(b / 2, a / 2),
//     P(t_n > t) = 1/2 P(F_(1,n) > t^2)  where t > 0.
// Where these are too small for a double their logarithms come from the continued fraction of Q
// (Lentz), the power series of I, and the asymptotic series of erfc. Degrees of freedom need not be
// integers.
#pragma once

#include <cmath>

namespace kincal {

/// Returns the logarithm of the share of values above the first argument.
double log_normal_tail(double z);
double log_chi2_tail(double x, double freedom);
double log_f_tail(double f, double freedom1, double freedom2);
double log_student_tail(double t, double freedom);

inline double normal_tail(double z) { return std::exp(log_normal_tail(z)); }
inline double chi2_tail(double x, double freedom) { return std::exp(log_chi2_tail(x, freedom)); }
inline double f_tail(double f, double freedom1, double freedom2) {
  return std::exp(log_f_tail(f, freedom1, freedom2));
}
inline double student_tail(double t, double freedom) {
  return std::exp(log_student_tail(t, freedom));
}

/// Returns the value of a standard normal variable that is exceeded as often as this one of
/// another: "so many standard deviations".
double chi2_deviate(double x, double freedom);
double f_deviate(double f, double freedom1, double freedom2);
double student_deviate(double t, double freedom);

/// Returns the value that the share `tail` of values exceeds, 0 < tail < 1; of Student's t below
/// 1/2.
double chi2_quantile(double tail, double freedom);
double student_quantile(double tail, double freedom);

}  // namespace kincal
