#include "innovation.h"

#include <algorithm>
#include <cmath>

#include "../../solver/kernels.h"

namespace kincal {
namespace {

// Of the inverse variance of an innovation, over that of the noise. What is expected to 30 sigmas
// or worse tells nothing of how a sensor fits.
constexpr double kUnexpected = 1e-3;
constexpr double kFullRank = 1e-9;  // singular value of columns of unit length, relative
constexpr int kAtOnce = 16;         // columns of a triangle: above them it is 0, or not needed

double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

/// Makes a symmetric matrix (its lower triangle, column after column) tridiagonal by reflections,
/// which u undergoes too. Leaves the diagonal in d and the elements beside it in e, from e[1] on.
void tridiagonalise(double* a, std::ptrdiff_t ld, int n, double* u, double* d, double* e) {
  const auto at = [&](int row, int column) -> double& { return a[column * ld + row]; };
  for (int i = n - 1; i > 0; --i) {
    for (int k = 0; k < i; ++k) d[k] = at(i, k);  // becomes the reflection's direction
    const double below = dot(d, d, i - 1), last = d[i - 1];
    if (below == 0) {
      e[i] = last;
      continue;
    }
    const double norm = std::sqrt(below + last * last);
    e[i] = last > 0 ? -norm : norm;
    d[i - 1] = last - e[i];
    const double h = -e[i] * d[i - 1];
    std::fill_n(e, i, 0.0);  // becomes A d / h and less
    for (int j = 0; j < i; ++j) {
      e[j] += at(j, j) * d[j] + dot(&at(j, j) + 1, d + j + 1, i - j - 1);
      for (int k = j + 1; k < i; ++k) e[k] += at(k, j) * d[j];
    }
    const double half = dot(e, d, i) / (2 * h), by = dot(d, u, i) / h;
    for (int j = 0; j < i; ++j) {
      e[j] = (e[j] - half * d[j]) / h;
      u[j] -= by * d[j];
    }
    for (int j = 0; j < i; ++j)
      for (int k = j; k < i; ++k) at(k, j) -= d[j] * e[k] + e[j] * d[k];
  }
  for (int i = 0; i < n; ++i) d[i] = at(i, i);
}

/// Makes the eigenvalues d of a tridiagonal matrix, by the implicit QL method (Bowdler et al.,
/// Numerische Mathematik 11 (1968)), and u along each eigenvector.
void diagonalise(int n, double* u, double* d, double* e) {
  constexpr double kPrecision = 2.3e-16;
  constexpr int kMost = 50;  // iterations for an eigenvalue; two are usual
  for (int i = 1; i < n; ++i) e[i - 1] = e[i];
  e[n - 1] = 0;
  for (int l = 0; l < n; ++l)
    for (int iteration = 0; iteration < kMost; ++iteration) {
      int m = l;
      while (m + 1 < n && std::abs(e[m]) > kPrecision * (std::abs(d[m]) + std::abs(d[m + 1]))) ++m;
      if (m == l) break;
      const double middle = (d[l + 1] - d[l]) / (2 * e[l]);
      double g = d[m] - d[l] + e[l] / (middle + std::copysign(std::hypot(middle, 1), middle));
      double s = 1, c = 1, p = 0;
      int i = m - 1;
      for (; i >= l; --i) {
        const double f = s * e[i], b = c * e[i], r = std::hypot(f, g);
        e[i + 1] = r;
        if (r == 0) break;
        s = f / r;
        c = g / r;
        g = d[i + 1] - p;
        const double t = (d[i] - g) * s + 2 * c * b;
        p = s * t;
        d[i + 1] = g + p;
        g = c * t - b;
        const double turned = u[i + 1];
        u[i + 1] = s * u[i] + c * turned;
        u[i] = c * u[i] - s * turned;
      }
      if (i >= l) {
        d[i + 1] -= p;
        e[m] = 0;
        continue;
      }
      d[l] -= p;
      e[l] = g;
      e[m] = 0;
    }
}

}  // namespace

bool Equations::has_rest() const {
  return std::any_of(rest.begin(), rest.end(), [](const auto& r) { return r.second > 0; });
}

void Innovations::reserve(int rows, int privates, int columns, int kinds) {
  const std::ptrdiff_t most = padded(std::max(rows, privates + columns + 1)) + kSlack;
  noise_.resize(static_cast<size_t>(kinds));
  if (most <= stride_) return;
  stride_ = most;
  const auto size = static_cast<size_t>(most);
  for (AlignedNumbers* a :
       {&j_, &right_, &p_, &factor_, &inverse_, &solved_, &y_, &reduced_, &triangle_, &h_})
    a->assign(size * size, 0.0);
  for (std::vector<double>* a : {&u_, &share_, &sigma_, &along_, &values_, &beside_, &explained_})
    a->assign(size, 0.0);
  seen_.reserve(size);
  sensors_.reserve(size);
}

/// T, its factor L, and L^-1 [r + J d, A]. The last rows, of joints' errors, have no J: there T and
/// L are diagonal.
void Innovations::factorise(const Equations& of, const std::vector<double>& variance,
                            const DriftWatch& test) {
  const int m = of.count, p = of.private_size;
  const auto ld = static_cast<int>(stride_);
  seen_.clear();
  for (size_t c = 0; c < of.columns.size(); ++c)
    if (test.covariance(of.columns[c], of.columns[c]) > 0) seen_.push_back(static_cast<int>(c));
  const int k = static_cast<int>(seen_.size());
  const auto touches = [&](int row) {
    return std::any_of(seen_.begin(), seen_.end(),
                       [&](int c) { return of.column(p + c)[row] != 0; });
  };
  moving_ = m;
  while (moving_ > 0 && !touches(moving_ - 1)) --moving_;
  std::copy_n(of.column(of.width() - 1), m, u_.begin());  // becomes r + J d
  for (int a = 0; a < k; ++a) {
    const double* const column = of.column(p + seen_[a]);
    std::copy_n(column, moving_, j_.begin() + a * stride_);
    const double mean = test.mean()(of.columns[seen_[a]]);
    for (int i = 0; i < m; ++i) u_[i] += mean * column[i];
    for (int b = 0; b <= a; ++b)
      p_[a * stride_ + b] = p_[b * stride_ + a] =
          test.covariance(of.columns[seen_[a]], of.columns[seen_[b]]);
  }
  kernels().multiply(p_.data(), stride_, 1, k, k, j_.data(), ld, moving_, right_.data(), ld);
  for (int i = 0; i < moving_; i += kAtOnce)
    kernels().multiply(j_.data() + i, 1, stride_, std::min(kAtOnce, moving_ - i), k,
                       right_.data() + i, ld, moving_ - i, factor_.data() + i * (stride_ + 1), ld);
  for (int i = 0; i < moving_; ++i) factor_[i * (stride_ + 1)] += variance[of.kind[i]];
  kernels().cholesky(factor_.data(), moving_, ld);
  for (int i = 0; i < m; ++i) {
    double* const row = solved_.data() + i * stride_;
    row[0] = u_[i];
    for (int c = 0; c < p; ++c) row[1 + c] = of.column(c)[i];
  }
  kernels().solve_rows(factor_.data(), moving_, ld, solved_.data(), 1 + p, stride_);
  for (int i = moving_; i < m; ++i)
    for (int c = 0; c <= p; ++c) solved_[i * stride_ + c] /= sigma_[i];
}

/// L^-1 of the rows with J, with a column for every row.
void Innovations::invert(int rows) {
  const auto ld = static_cast<int>(stride_);
  for (int i = 0; i < moving_; ++i) {
    std::fill_n(inverse_.begin() + i * stride_, padded(rows), 0.0);
    inverse_[i * (stride_ + 1)] = 1;
  }
  for (int k = 0; k < moving_; k += kAtOnce)
    kernels().solve_rows(factor_.data() + k * (stride_ + 1), moving_ - k, ld,
                         inverse_.data() + k * (stride_ + 1), std::min(kAtOnce, moving_ - k),
                         stride_);
}

/// What private unknowns explain: Y, and M^-1 B' L^-1 (r + J d) in explained_.
void Innovations::explain(int rows, int privates) {
  const auto ld = static_cast<int>(stride_);
  const double* const a = solved_.data() + 1;
  kernels().multiply(a, 1, stride_, privates, rows, a, ld, privates, triangle_.data(), ld);
  for (int k = 0; k < moving_; k += kAtOnce)
    kernels().multiply(a + k * stride_, 1, stride_, privates, moving_ - k,
                       inverse_.data() + k * (stride_ + 1), ld, std::min(kAtOnce, moving_ - k),
                       y_.data() + k, ld);
  for (int c = 0; c < privates; ++c) {
    for (int i = moving_; i < rows; ++i) y_[c * stride_ + i] = a[i * stride_ + c] / sigma_[i];
    triangle_[c * (stride_ + 1)] += 1;
    explained_[c] = 0;
    for (int i = 0; i < rows; ++i) explained_[c] += a[i * stride_ + c] * solved_[i * stride_];
  }
  if (privates == 0) return;
  kernels().cholesky(triangle_.data(), privates, ld);
  kernels().solve_rows(triangle_.data(), privates, ld, y_.data(), rows, stride_);
  kernels().solve_lower(triangle_.data(), privates, ld, explained_.data());
}

Innovations::OfSensor Innovations::sensor(const Equations& of, const Equations::OfSensor& rows) {
  const int n = rows.count, from = rows.first;
  const auto ld = static_cast<int>(stride_);
  const double* const inverse = inverse_.data() + from * (stride_ + 1);
  const double* const y = y_.data() + from;
  for (int i = 0; i < n; i += kAtOnce) {  // on and below the diagonal
    const std::ptrdiff_t corner = i * (stride_ + 1);
    const int columns = std::min(kAtOnce, n - i);
    kernels().multiply(inverse + corner, 1, stride_, columns, std::max(0, moving_ - from - i),
                       inverse + corner, ld, n - i, h_.data() + corner, ld);
    kernels().multiply(y + i, 1, stride_, columns, of.private_size, y + i, ld, n - i,
                       factor_.data() + corner, ld);
  }
  for (int c = 0; c < n; ++c) {
    const double sigma = sigma_[from + c];
    if (from + c >= moving_) h_[c * (stride_ + 1)] += 1 / (sigma * sigma);
    for (int r = c; r < n; ++r) {
      double& h = h_[c * stride_ + r];
      h = (h - factor_[c * stride_ + r]) * sigma * sigma_[from + r];
    }
  }
  OfSensor out{rows.sensor, 0, static_cast<double>(n)};
  const auto factorises = [&](double less) {
    for (int c = 0; c < n; ++c)
      std::copy_n(h_.begin() + c * (stride_ + 1), n - c, factor_.begin() + c * (stride_ + 1));
    for (int i = 0; i < n; ++i) factor_[i * (stride_ + 1)] -= less;
    return kernels().cholesky(factor_.data(), n, ld);
  };
  if (factorises(kUnexpected) && factorises(0)) {
    std::copy_n(u_.begin() + from, n, along_.begin());
    kernels().solve_lower(factor_.data(), n, ld, along_.data());
    out.chi2 = dot(along_.data(), along_.data(), n);
    return out;
  }
  std::copy_n(u_.begin() + from, n, along_.begin());
  tridiagonalise(h_.data(), stride_, n, along_.data(), values_.data(), beside_.data());
  diagonalise(n, along_.data(), values_.data(), beside_.data());
  out.dof = 0;
  for (int i = 0; i < n; ++i) {
    if (!(values_[i] > kUnexpected)) continue;
    out.chi2 += along_[i] * along_[i] / values_[i];
    ++out.dof;
  }
  return out;
}

void Innovations::expect(const Equations& of, const std::vector<double>& variance,
                         const DriftWatch& test) {
  const int m = of.count, p = of.private_size;
  reserve(m, p, static_cast<int>(of.columns.size()), static_cast<int>(of.rest.size()));
  for (int i = 0; i < m; ++i) sigma_[i] = std::sqrt(variance[of.kind[i]]);
  factorise(of, variance, test);
  invert(m);
  explain(m, p);
  for (int i = 0; i < m; ++i) {
    u_[i] = i < moving_ ? 0 : solved_[i * stride_] / sigma_[i];
    share_[i] = i < moving_ ? 0 : 1 / variance[of.kind[i]];
  }
  for (int k = 0; k < moving_; ++k) {
    const double* const row = inverse_.data() + k * stride_;
    const double z = solved_[k * stride_];
    for (int i = 0; i <= k; ++i) {
      u_[i] += row[i] * z;
      share_[i] += row[i] * row[i];
    }
  }
  for (int q = 0; q < p; ++q) {
    const double* const row = y_.data() + q * stride_;
    for (int i = 0; i < m; ++i) {
      u_[i] -= row[i] * explained_[q];
      share_[i] -= row[i] * row[i];
    }
  }
  for (int i = 0; i < m; ++i) {
    u_[i] *= sigma_[i];
    share_[i] *= sigma_[i] * sigma_[i];
  }
  sensors_.clear();
  for (const Equations::OfSensor& rows : of.sensors) sensors_.push_back(sensor(of, rows));
  std::fill(noise_.begin(), noise_.end(), OfNoise());
  for (int i = 0; i < m; ++i) {
    OfNoise& noise = noise_[of.kind[i]];
    const double h = share_[i];
    noise.squares += variance[of.kind[i]] * (h * h + u_[i] * u_[i] - h);
    noise.residuals += h * h;
    noise.seen = true;
  }
  for (size_t k = 0; k < of.rest.size(); ++k) {
    if (!(of.rest[k].second > 0)) continue;
    noise_[k].squares += of.rest[k].first;
    noise_[k].residuals += of.rest[k].second;
    noise_[k].seen = true;
  }
  const auto fill = [&] {
    for (int c = 0; c <= p; ++c) {
      double* const to = reduced_.data() + c * stride_;
      const int from = c < p ? 1 + c : 0;
      for (int i = 0; i < m; ++i) to[i] = solved_[i * stride_ + from];
      std::fill(to + m, to + padded(m), 0.0);
    }
  };
  const int rank = eliminate(fill, m, p, p + 1, 0);
  dof_ = m - rank;
  const double* const rest = reduced_.data() + p * stride_ + rank;
  chi2_ = dot(rest, rest, dof_);
}

long Innovations::reduce(const Equations& of, const std::vector<double>& variance) {
  const int m = of.count, p = of.private_size, t = static_cast<int>(of.columns.size());
  reserve(m, p, t, static_cast<int>(of.rest.size()));
  for (int i = 0; i < m; ++i) sigma_[i] = 1 / std::sqrt(variance[of.kind[i]]);
  const auto fill = [&] {
    for (int c = 0; c <= p + t; ++c) {
      double* const to = reduced_.data() + c * stride_;
      const double* const from = of.column(c);
      const double sign = c < p + t ? 1 : -1;
      for (int i = 0; i < m; ++i) to[i] = sign * sigma_[i] * from[i];
      std::fill(to + m, to + padded(m), 0.0);
    }
  };
  privates_ = p;
  touched_ = t;
  const int rank = eliminate(fill, m, p, p + t + 1, t + 1);
  first_ = rank;
  left_ = std::min(m - rank, t + 1);
  if (m - rank > t + 1)
    for (int c = 0; c <= t; ++c) {
      double* const to = reduced_.data() + (p + c) * stride_ + rank;
      std::fill(to + c + 1, to + left_, 0.0);
    }
  return m - rank;
}

/// Turns the first `privates` of the columns that `fill` leaves in reduced_ into a triangle; the
/// rows below it are free of them. With more of these rows than `triangle` > 0, these columns
/// become one, too. Returns the rank.
template <class Fill>
int Innovations::eliminate(const Fill& fill, int rows, int privates, int columns, int triangle) {
  const bool many = triangle > 0 && rows - privates > triangle;
  const int whole = padded(rows);
  fill();
  if (privates > 0) {
    kernels().triangularise(reduced_.data(), whole, columns, many ? columns : privates, stride_);
    if (privates <= rows && is_of_full_rank(privates)) return privates;
    fill();
    const int rank = eliminate_by_rank(rows, privates, columns);
    if (triangle > 0 && rows - rank > triangle) {
      const int left = rows - rank;
      for (int c = privates; c < columns; ++c) {
        double* const to = reduced_.data() + c * stride_;
        std::copy(to + rank, to + rows, to);
        std::fill(to + left, to + whole, 0.0);
      }
      kernels().triangularise(reduced_.data() + privates * stride_, whole, triangle, triangle,
                              stride_);
      for (int c = privates; c < columns; ++c) {
        double* const to = reduced_.data() + c * stride_;
        std::copy_backward(to, to + std::min(left, triangle), to + rank + std::min(left, triangle));
      }
    }
    return rank;
  }
  if (many) kernels().triangularise(reduced_.data(), whole, columns, columns, stride_);
  return 0;
}

/// Returns whether the triangle of private unknowns in reduced_ is certainly of full rank, columns
/// scaled to unit length: largest over least singular value <= |R| |R^-1| (Frobenius).
bool Innovations::is_of_full_rank(int privates) {
  double squared = 0;
  for (int j = 0; j < privates; ++j) {
    const double* const column = reduced_.data() + j * stride_;
    const double scale = 1 / std::sqrt(dot(column, column, j + 1));
    double* const r = triangle_.data() + j * stride_;
    for (int i = 0; i <= j; ++i) r[i] = scale * column[i];
  }
  for (int j = 0; j < privates; ++j) {
    double* const x = along_.data();
    std::fill_n(x, j, 0.0);
    x[j] = 1;
    for (int i = j; i >= 0; --i) {
      const double* const column = triangle_.data() + i * stride_;
      x[i] /= column[i];
      for (int k = 0; k < i; ++k) x[k] -= x[i] * column[k];
      squared += x[i] * x[i];
    }
  }
  return std::sqrt(squared * privates) < 1 / kFullRank;  // NaN and infinity are not
}

/// The same by reflections with pivots.
int Innovations::eliminate_by_rank(int rows, int privates, int columns) {
  const auto column = [&](int c) { return reduced_.data() + c * stride_; };
  for (int c = 0; c < privates; ++c) {
    const double norm = std::sqrt(dot(column(c), column(c), rows));
    if (norm > 0)
      for (int i = 0; i < rows; ++i) column(c)[i] /= norm;
  }
  double first = 0;
  for (int k = 0; k < std::min(rows, privates); ++k) {
    int best = k;
    double largest = -1;
    for (int c = k; c < privates; ++c) {
      const double squared = dot(column(c) + k, column(c) + k, rows - k);
      if (squared > largest) largest = squared, best = c;
    }
    const double norm = std::sqrt(largest);
    if (k == 0) first = norm;
    if (!(norm > kFullRank * first)) return k;
    std::swap_ranges(column(k), column(k) + rows, column(best));
    double* const x = column(k) + k;
    const double beta = x[0] > 0 ? -norm : norm, w = x[0] - beta,
                 factor = 1 / (beta * (beta - x[0]));
    x[0] = w;
    for (int c = k + 1; c < columns; ++c) {
      const double by = factor * dot(x, column(c) + k, rows - k);
      for (int i = 0; i < rows - k; ++i) column(c)[k + i] -= by * x[i];
    }
    x[0] = beta;
  }
  return std::min(rows, privates);
}

}  // namespace kincal
