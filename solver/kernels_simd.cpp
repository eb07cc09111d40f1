// Compiled once for each instruction set; see simd.h and kernels.h.
#include "kernels.h"
#include "simd.h"

namespace kincal {
namespace KINCAL_ISA {
namespace {

// ---- gram: tiles of T x T sums of products along the rows.

constexpr int T = kRegisters == 32 ? 4 : 3;

template <int I, int J, bool Diagonal>
inline void gram_tile(const double* a, const double* b, int rows, std::ptrdiff_t stride, double* g,
                      int ld) {
  Pack s[I][J] = {};
  for (int r = 0; r < rows; r += kLanes) {
    Pack x[I], y[J];
    for (int i = 0; i < I; ++i) x[i] = load(a + i * stride + r);
    if (!Diagonal)
      for (int j = 0; j < J; ++j) y[j] = load(b + j * stride + r);
    for (int i = 0; i < I; ++i)
      for (int j = 0; j < (Diagonal ? i + 1 : J); ++j) s[i][j] += x[i] * (Diagonal ? x[j] : y[j]);
  }
  double out[I * J + 3];
  int k = 0;
  if constexpr (I >= 4 && J == 4) {
    for (int i = 0; i < I; ++i) sum4(s[i][0], s[i][1], s[i][2], s[i][3], out + 4 * i);
  } else {
    for (int i = 0; i < I; ++i)
      for (int j = 0; j < J; ++j, ++k) out[k] = sum(s[i][j]);
  }
  for (int i = 0; i < I; ++i)
    for (int j = 0; j < (Diagonal ? i + 1 : J); ++j)
      g[i + static_cast<std::ptrdiff_t>(j) * ld] = out[i * J + j];
}

/// More than 6 parameters because kernels take plain pointers.
template <int J>
inline void gram_rows(const double* a, const double* b, int rows, std::ptrdiff_t stride, int left,
                      double* g, int ld) {
  while (left >= T) {
    // 32 registers have room for a fifth row, which by itself would wait for its own sums.
    if (T == 4 && left == 5) return gram_tile<5, J, false>(a, b, rows, stride, g, ld);
    gram_tile<T, J, false>(a, b, rows, stride, g, ld);
    a += T * stride;
    g += T;
    left -= T;
  }
  if (left == 1) gram_tile<1, J, false>(a, b, rows, stride, g, ld);
  if (left == 2) gram_tile<2, J, false>(a, b, rows, stride, g, ld);
  if (T > 3 && left == 3) gram_tile<3, J, false>(a, b, rows, stride, g, ld);
}

/// A tile on the diagonal.
inline void gram_corner(const double* b, int rows, std::ptrdiff_t stride, int width, double* g,
                        int ld) {
  switch (width) {
    case 1:
      return gram_tile<1, 1, true>(b, b, rows, stride, g, ld);
    case 2:
      return gram_tile<2, 2, true>(b, b, rows, stride, g, ld);
    case 3:
      return gram_tile<3, 3, true>(b, b, rows, stride, g, ld);
    default:
      gram_tile<T, T, true>(b, b, rows, stride, g, ld);
  }
}

/// The upper triangle from the lower one.
inline void mirror(double* g, int w, int ld) {
  for (int j = 1; j < w; ++j)
    for (int i = 0; i < j; ++i)
      g[i + static_cast<std::ptrdiff_t>(j) * ld] = g[j + static_cast<std::ptrdiff_t>(i) * ld];
}

void gram(const double* columns, int rows, std::ptrdiff_t stride, int w, double* g, int ld) {
  for (int j = 0; j < w; j += T) {
    const int width = w - j < T ? w - j : T;
    const double* b = columns + j * stride;
    double* corner = g + j + static_cast<std::ptrdiff_t>(j) * ld;
    gram_corner(b, rows, stride, width, corner, ld);
    if (width == T) gram_rows<T>(b + T * stride, b, rows, stride, w - j - T, corner + T, ld);
  }
  mirror(g, w, ld);
}

/// A tile of I columns by four of which the first two have the first half of the rows and the
/// others the second; with `Last` by the column behind these as well, which has all. Entry (i, j)
/// goes to g[i apart_i + j apart_j]; more than 6 parameters because kernels take plain pointers.
template <int I, bool Last>
inline void halves_tile(const double* a, const double* b, int rows, std::ptrdiff_t stride,
                        double* g, std::ptrdiff_t apart_i, std::ptrdiff_t apart_j) {
  Pack s[I][4] = {}, last[I] = {};
  for (int h = 0; h < 2; ++h) {
    const double* c = b + 2 * h * stride;
    for (int r = h * rows / 2; r < (h + 1) * rows / 2; r += kLanes) {
      const Pack first = load(c + r), second = load(c + stride + r);
      Pack behind = {};
      if (Last) behind = load(b + 4 * stride + r);
      for (int i = 0; i < I; ++i) {
        const Pack x = load(a + i * stride + r);
        s[i][2 * h] += x * first;
        s[i][2 * h + 1] += x * second;
        if (Last) last[i] += x * behind;
      }
    }
  }
  for (int i = 0; i < I; ++i) {
    double out[4];
    sum4(s[i][0], s[i][1], s[i][2], s[i][3], out);
    for (int j = 0; j < 4; ++j) g[i * apart_i + j * apart_j] = out[j];
    if (Last) g[i * apart_i + 4 * apart_j] = sum(last[i]);
  }
}

/// The products of these columns among themselves: those of two halves are none.
template <bool Last>
inline void halves_corner(const double* b, int rows, std::ptrdiff_t stride, double* g,
                          std::ptrdiff_t ld) {
  Pack last = {};
  for (int h = 0; h < 2; ++h) {
    const double* c = b + 2 * h * stride;
    Pack s[5] = {};
    for (int r = h * rows / 2; r < (h + 1) * rows / 2; r += kLanes) {
      const Pack first = load(c + r), second = load(c + stride + r);
      s[0] += first * first;
      s[1] += first * second;
      s[2] += second * second;
      if (!Last) continue;
      const Pack behind = load(b + 4 * stride + r);
      s[3] += first * behind;
      s[4] += second * behind;
      last += behind * behind;
    }
    double* to = g + 2 * h * (ld + 1);
    to[0] = sum(s[0]), to[1] = sum(s[1]), to[ld + 1] = sum(s[2]);
    if (!Last) continue;
    g[4 + 2 * h * ld] = sum(s[3]);
    g[4 + (2 * h + 1) * ld] = sum(s[4]);
  }
  for (int j = 0; j < 2; ++j) g[2 + j * ld] = g[3 + j * ld] = 0;
  if (Last) g[4 + 4 * ld] = sum(last);
}

/// gram() where halves begin at column `at` with a tile; more than 6 parameters because kernels
/// take plain pointers. `Last`: the residuals' column alone stands behind the halves.
template <bool Last>
void gram_by_halves(const double* columns, int rows, std::ptrdiff_t stride, int w, int at,
                    double* g, std::ptrdiff_t ld) {
  constexpr int kWidth = Last ? T + 1 : T;
  const double* halves = columns + at * stride;
  for (int j = 0; j < w; j += j == at ? kWidth : T) {
    const int width = w - j < T ? w - j : T;
    const double* b = columns + j * stride;
    double* corner = g + j * (ld + 1);
    if (j == at) {
      halves_corner<Last>(b, rows, stride, corner, ld);
      int left = w - at - kWidth;
      const double* a = b + kWidth * stride;
      double* to = corner + kWidth;
      for (; left >= T; left -= T, a += T * stride, to += T)
        halves_tile<T, false>(a, b, rows, stride, to, 1, ld);
      for (; left > 0; --left, a += stride, ++to)
        halves_tile<1, false>(a, b, rows, stride, to, 1, ld);
      continue;
    }
    gram_corner(b, rows, stride, width, corner, static_cast<int>(ld));
    if (width < T) continue;
    if (j > at) {
      gram_rows<T>(b + T * stride, b, rows, stride, w - j - T, corner + T, static_cast<int>(ld));
      continue;
    }
    gram_rows<T>(b + T * stride, b, rows, stride, at - j - T, corner + T, static_cast<int>(ld));
    halves_tile<T, Last>(b, halves, rows, stride, g + at + j * ld, ld, 1);
    gram_rows<T>(halves + kWidth * stride, b, rows, stride, w - at - kWidth,
                 g + at + kWidth + j * ld, static_cast<int>(ld));
  }
  mirror(g, w, static_cast<int>(ld));
}

/// More than 6 parameters because kernels take plain pointers.
void gram_of_halves(const double* columns, int rows, std::ptrdiff_t stride, int w, int at,
                    double* g, int ld) {
  if (T != kTile || at % T != 0 || at + T > w || rows % (2 * kLanes) != 0)
    return gram(columns, rows, stride, w, g, ld);
  if (w == at + T + 1) return gram_by_halves<true>(columns, rows, stride, w, at, g, ld);
  gram_by_halves<false>(columns, rows, stride, w, at, g, ld);
}

// ---- subtract_product: tiles of P packs x N columns stay in registers over the whole depth.

constexpr int P = 3;
constexpr int N = kLanes == 8 ? 8 : 4;

template <int Packs, int Columns>
inline void product_tile(double* c, int ldc, const double* a, const double* b, int depth,
                         std::ptrdiff_t lda) {
  Pack s[Packs][Columns] = {};
  for (int k = 0; k < depth; ++k) {
    Pack x[Packs];
    for (int p = 0; p < Packs; ++p) x[p] = load(a + p * kLanes);
    for (int j = 0; j < Columns; ++j)
      for (int p = 0; p < Packs; ++p) s[p][j] += x[p] * b[j];
    a += lda;
    b += lda;
  }
  for (int j = 0; j < Columns; ++j)
    for (int p = 0; p < Packs; ++p) {
      double* d = c + static_cast<std::ptrdiff_t>(j) * ldc + p * kLanes;
      store(d, load(d) - s[p][j]);
    }
}

/// More than 6 parameters because kernels take plain pointers.
template <int Columns>
inline void product_columns(double* c, int rows, int ldc, const double* a, const double* b,
                            int depth, std::ptrdiff_t lda) {
  int i = 0;
  for (; i + P * kLanes <= rows; i += P * kLanes)
    product_tile<P, Columns>(c + i, ldc, a + i, b, depth, lda);
  for (; i + kLanes < rows; i += 2 * kLanes)
    product_tile<2, Columns>(c + i, ldc, a + i, b, depth, lda);
  if (i < rows) product_tile<1, Columns>(c + i, ldc, a + i, b, depth, lda);
}

/// The first `columns` columns of subtract_product(); more than 6 parameters because kernels take
/// plain pointers.
void subtract_columns(double* c, int n, int columns, int ldc, const double* a, int depth,
                      std::ptrdiff_t lda) {
  int j = 0;
  for (; j + N <= columns; j += N)
    product_columns<N>(c + j + static_cast<std::ptrdiff_t>(j) * ldc, n - j, ldc, a + j, a + j,
                       depth, lda);
  for (; j + 2 <= columns; j += 2)
    product_columns<2>(c + j + static_cast<std::ptrdiff_t>(j) * ldc, n - j, ldc, a + j, a + j,
                       depth, lda);
  if (j < columns)
    product_columns<1>(c + j + static_cast<std::ptrdiff_t>(j) * ldc, n - j, ldc, a + j, a + j,
                       depth, lda);
}

void subtract_product(double* c, int n, int ldc, const double* a, int depth, std::ptrdiff_t lda) {
  subtract_columns(c, n, n, ldc, a, depth, lda);
}

// ---- cholesky: strips of kStrip columns, of panels of kPanel columns; the rest of the strip is
// updated after each panel, the rest of the matrix after each strip.

constexpr int kPanel = 16;

inline double root(double x) { return __builtin_sqrt(x); }

/// Few numbers: no packs.
template <int N3>
inline bool small_cholesky(double* a, int ld) {
  for (int j = 0; j < N3; ++j) {
    for (int p = 0; p < j; ++p)
      for (int i = j; i < N3; ++i) a[i + j * ld] -= a[i + p * ld] * a[j + p * ld];
    const double pivot = a[j + j * ld];
    if (!(pivot > 0) || pivot > 1.7976931348623157e308) return false;
    const double inverse = 1 / root(pivot);
    for (int i = j + 1; i < N3; ++i) a[i + j * ld] *= inverse;
    a[j + j * ld] = inverse;
  }
  return true;
}

/// Of at most kPanel columns. In a copy: packs write below the corner.
bool cholesky_corner(double* corner, int n, int ld_corner) {
  constexpr int ld = kPanel + kLanes;
  double a[kPanel * ld];
  for (int j = 0; j < n; ++j)
    for (int i = j; i < n; ++i)
      a[i + j * ld] = corner[i + static_cast<std::ptrdiff_t>(j) * ld_corner];
  for (int j = 0; j < n; ++j) {
    double* column = a + static_cast<std::ptrdiff_t>(j) * ld;
    for (int p = 0; p < j; ++p) {
      const double* before = a + static_cast<std::ptrdiff_t>(p) * ld;
      const double b = before[j];
      for (int i = j; i < n; i += kLanes)
        store(column + i, load(column + i) - load(before + i) * b);
    }
    const double pivot = column[j];
    if (!(pivot > 0) || pivot > 1.7976931348623157e308) return false;
    const double inverse = 1 / root(pivot);
    for (int i = j + 1; i < n; i += kLanes) store(column + i, load(column + i) * inverse);
    column[j] = inverse;
  }
  for (int j = 0; j < n; ++j)
    for (int i = j; i < n; ++i)
      corner[i + static_cast<std::ptrdiff_t>(j) * ld_corner] = a[i + j * ld];
  return true;
}

/// X <- X L^-T for a pack of rows below a factored corner of kPanel columns.
inline void solve_below(const double* corner, double* x, int ld) {
  constexpr int half = kPanel / 2;
  for (int first = 0; first < kPanel; first += half) {
    Pack s[half];
    for (int j = 0; j < half; ++j) s[j] = load(x + static_cast<std::ptrdiff_t>(first + j) * ld);
    for (int p = 0; p < first; ++p) {
      const Pack before = load(x + static_cast<std::ptrdiff_t>(p) * ld);
      for (int j = 0; j < half; ++j)
        s[j] -= before * corner[first + j + static_cast<std::ptrdiff_t>(p) * ld];
    }
    for (int p = 0; p < half; ++p) {
      const double* column = corner + first + static_cast<std::ptrdiff_t>(first + p) * ld;
      s[p] *= column[p];
      for (int j = p + 1; j < half; ++j) s[j] -= s[p] * column[j];
    }
    for (int j = 0; j < half; ++j) store(x + static_cast<std::ptrdiff_t>(first + j) * ld, s[j]);
  }
}

/// The same below a corner of fewer columns.
inline void solve_below_few(const double* corner, int columns, double* x, int ld) {
  for (int j = 0; j < columns; ++j) {
    Pack s = load(x + static_cast<std::ptrdiff_t>(j) * ld);
    for (int p = 0; p < j; ++p)
      s -= load(x + static_cast<std::ptrdiff_t>(p) * ld) *
           corner[j + static_cast<std::ptrdiff_t>(p) * ld];
    store(x + static_cast<std::ptrdiff_t>(j) * ld,
          s * corner[j + static_cast<std::ptrdiff_t>(j) * ld]);
  }
}

bool factor_columns(double* a, int n, int columns, int ld) {
  for (int k = 0; k < columns; k += kPanel) {
    const int end = k + kPanel < columns ? k + kPanel : columns, width = end - k;
    double* corner = a + k + static_cast<std::ptrdiff_t>(k) * ld;
    if (!cholesky_corner(corner, width, ld)) return false;
    if (end == n) return true;
    for (int i = width; i < n - k; i += kLanes) {
      if (width == kPanel)
        solve_below(corner, corner + i, ld);
      else
        solve_below_few(corner, width, corner + i, ld);
    }
    subtract_columns(corner + width * (static_cast<std::ptrdiff_t>(ld) + 1), n - end, columns - end,
                     ld, corner + width, width, ld);
  }
  return true;
}

bool partial_cholesky(double* a, int n, int columns, int ld) {
  for (int strip = 0; strip < columns; strip += kStrip) {
    const int width = strip + kStrip < columns ? kStrip : columns - strip, behind = strip + width;
    double* corner = a + strip * (static_cast<std::ptrdiff_t>(ld) + 1);
    if (!factor_columns(corner, n - strip, width, ld)) return false;
    subtract_product(a + behind * (static_cast<std::ptrdiff_t>(ld) + 1), n - behind, ld,
                     corner + width, width, ld);
  }
  return true;
}

bool cholesky(double* a, int n, int ld) {
  if (n == 3) return small_cholesky<3>(a, ld);
  if (n == 6) return small_cholesky<6>(a, ld);
  return partial_cholesky(a, n, n, ld);
}

void solve_lower(const double* factor, int n, int ld, double* b) {
  if (n == 3) {
    b[0] *= factor[0];
    b[1] = (b[1] - factor[1] * b[0]) * factor[1 + ld];
    b[2] = (b[2] - factor[2] * b[0] - factor[2 + ld] * b[1]) * factor[2 + 2 * ld];
    return;
  }
  for (int j = 0; j < n; ++j) {
    const double* column = factor + static_cast<std::ptrdiff_t>(j) * ld;
    const double x = b[j] * column[j];
    for (int i = j + 1; i < n; i += kLanes) store(b + i, load(b + i) - load(column + i) * x);
    b[j] = x;
  }
}

void solve_lower_transposed(const double* factor, int n, int ld, double* b) {
  if (n == 3) {
    b[2] *= factor[2 + 2 * ld];
    b[1] = (b[1] - factor[2 + ld] * b[2]) * factor[1 + ld];
    b[0] = (b[0] - factor[1] * b[1] - factor[2] * b[2]) * factor[0];
    return;
  }
  for (int j = n - 1; j >= 0; --j) {
    const double* column = factor + static_cast<std::ptrdiff_t>(j) * ld;
    Pack s = {};
    int i = j + 1;
    for (; i + kLanes <= n; i += kLanes) s += load(column + i) * load(b + i);
    double x = b[j] - sum(s);
    for (; i < n; ++i) x -= column[i] * b[i];
    b[j] = x * column[j];
  }
}

// ---- solve_rows: a few packs of columns at a time.

template <int Packs>
inline void solve_packs(const double* factor, int n, int ld, double* b, std::ptrdiff_t stride) {
  for (int i = 0; i < n; ++i) {
    Pack x[Packs];
    for (int p = 0; p < Packs; ++p) x[p] = load(b + i * stride + p * kLanes);
    for (int j = 0; j < i; ++j) {
      const double l = factor[i + static_cast<std::ptrdiff_t>(j) * ld];
      for (int p = 0; p < Packs; ++p) x[p] -= l * load(b + j * stride + p * kLanes);
    }
    const double inverse = factor[i + static_cast<std::ptrdiff_t>(i) * ld];
    for (int p = 0; p < Packs; ++p) store(b + i * stride + p * kLanes, x[p] * inverse);
  }
}

void solve_rows(const double* factor, int n, int ld, double* b, int width, std::ptrdiff_t stride) {
  int c = 0;
  for (; c + 3 * kLanes < width; c += 4 * kLanes) solve_packs<4>(factor, n, ld, b + c, stride);
  for (; c < width; c += kLanes) solve_packs<1>(factor, n, ld, b + c, stride);
}

// ---- subtract_block

/// More than 6 parameters because kernels take plain pointers.
template <int Depth>
inline void block_columns(double* d, const std::ptrdiff_t* step, const double* a, int rows,
                          const double* b, int columns, int depth, std::ptrdiff_t stride) {
  const int n = Depth > 0 ? Depth : depth;
  int i = 0;
  for (; i + kLanes <= rows; i += kLanes) {
    if constexpr (Depth > 0) {
      Pack x[Depth];
      for (int k = 0; k < Depth; ++k) x[k] = load(a + k * stride + i);
      for (int q = 0; q < columns; ++q) {
        Pack s = x[0] * b[q];
        for (int k = 1; k < Depth; ++k) s += x[k] * b[k * stride + q];
        store(d + step[q] + i, load(d + step[q] + i) - s);
      }
    } else {
      for (int q = 0; q < columns; ++q) {
        Pack s = {};
        for (int k = 0; k < n; ++k) s += load(a + k * stride + i) * b[k * stride + q];
        store(d + step[q] + i, load(d + step[q] + i) - s);
      }
    }
  }
  for (; i < rows; ++i)
    for (int q = 0; q < columns; ++q) {
      double s = 0;
      for (int k = 0; k < n; ++k) s += a[k * stride + i] * b[k * stride + q];
      d[step[q] + i] -= s;
    }
}

/// More than 6 parameters because kernels take plain pointers.
void subtract_block(double* d, const std::ptrdiff_t* step, const double* a, int rows,
                    const double* b, int columns, int depth, std::ptrdiff_t stride) {
  if (depth == 3)
    block_columns<3>(d, step, a, rows, b, columns, depth, stride);
  else if (depth == 6)
    block_columns<6>(d, step, a, rows, b, columns, depth, stride);
  else
    block_columns<0>(d, step, a, rows, b, columns, depth, stride);
}

// ---- subtract_products_9x9

constexpr int kEight = 8 / kLanes;

/// More than 6 parameters because kernels take plain pointers.
void subtract_products_9x9(double* blocks, const int* block, const int* first, int runs,
                           const double* b, std::ptrdiff_t stride, double* gradient) {
  const double *r0 = b + 9 * runs, *r1 = r0 + stride, *r2 = r1 + stride;
  for (int i = 0; i < runs; ++i) {
    const double* bi = b + 9 * i;
    Pack x[3][kEight];
    for (int k = 0; k < 3; ++k)
      for (int p = 0; p < kEight; ++p) x[k][p] = load(bi + k * stride + p * kLanes);
    const double l0 = bi[8], l1 = bi[stride + 8], l2 = bi[2 * stride + 8];
    double* g = gradient + first[i];
    for (int p = 0; p < kEight; ++p)
      store(g + p * kLanes, load(g + p * kLanes) - x[0][p] * *r0 - x[1][p] * *r1 - x[2][p] * *r2);
    g[8] -= l0 * *r0 + l1 * *r1 + l2 * *r2;
    const double* b0 = b;
    for (int j = 0; j <= i; ++j, b0 += 9) {
      const double *b1 = b0 + stride, *b2 = b1 + stride;
      double* d = blocks + static_cast<std::ptrdiff_t>(*block++) * kBlockStorage9x9;
      for (int q = 0; q < 9; ++q, d += 8)
        for (int p = 0; p < kEight; ++p)
          store(d + p * kLanes,
                load(d + p * kLanes) - x[0][p] * b0[q] - x[1][p] * b1[q] - x[2][p] * b2[q]);
      for (int p = 0; p < 8; p += kLanes)
        store(d + p, load(d + p) - load(b0 + p) * l0 - load(b1 + p) * l1 - load(b2 + p) * l2);
      d[8] -= l0 * b0[8] + l1 * b1[8] + l2 * b2[8];
    }
  }
}

// ---- expand: both products are  to(i, :) = sum_r factor(i, r) * from(r, :)  with few r.

/// With `upper` only what is not below the diagonal; more than 6 parameters because kernels take
/// plain pointers.
template <int Depth>
inline void combine(const double* factor, std::ptrdiff_t step_i, std::ptrdiff_t step_r, int rows,
                    int depth, const double* from, std::ptrdiff_t ld_from, int columns, double* to,
                    std::ptrdiff_t ld, bool upper = false) {
  const int n = Depth > 0 ? Depth : depth;
  for (int j = 0; j < columns; j += kLanes) {
    const int last = upper && j + kLanes < rows ? j + kLanes : rows;
    if constexpr (Depth > 0) {
      Pack x[Depth];
      for (int r = 0; r < Depth; ++r) x[r] = load(from + r * ld_from + j);
      for (int i = 0; i < last; ++i) {
        const double* f = factor + i * step_i;
        Pack s = x[0] * f[0], t = x[1] * f[step_r];
        for (int r = 2; r < Depth; r += 2) {
          s += x[r] * f[r * step_r];
          t += x[r + 1] * f[(r + 1) * step_r];
        }
        store(to + i * ld + j, s + t);
      }
    } else {
      for (int i = 0; i < last; ++i) {
        const double* f = factor + i * step_i;
        Pack s = {};
        for (int r = 0; r < n; ++r) s += load(from + r * ld_from + j) * f[r * step_r];
        store(to + i * ld + j, s);
      }
    }
  }
}

/// More than 6 parameters because kernels take plain pointers.
void expand(const double* g, int ldg, int width, const double* m, int ldm, int k, int columns,
            double* product, int ldp, double* out, int ld) {
  if (k == 6) {
    combine<6>(m, 1, ldm, columns, k, g, ldg, width, product, ldp);
    combine<6>(product, ldp, 1, columns, k, m, ldm, columns, out, ld, true);
  } else {
    combine<0>(m, 1, ldm, columns, k, g, ldg, width, product, ldp);
    combine<0>(product, ldp, 1, columns, k, m, ldm, columns, out, ld, true);
  }
}

/// More than 6 parameters because kernels take plain pointers.
void add_rows(double* a, int lda, const double* b, int ldb, int rows, int columns, bool upper) {
  for (int i = 0; i < rows; ++i, a += lda, b += ldb)
    for (int j = upper ? i / kLanes * kLanes : 0; j < columns; j += kLanes)
      store(a + j, load(a + j) + load(b + j));
}

/// Four rows and J packs of columns of a product; more than 6 parameters because kernels take plain
/// pointers.
template <int J>
inline void multiply_tile(const double* f, std::ptrdiff_t step_i, std::ptrdiff_t step_r, int depth,
                          const double* g, int ldg, double* out, int ld) {
  Pack s[4][J] = {};
  for (int r = 0; r < depth; ++r, f += step_r, g += ldg)
    for (int q = 0; q < 4; ++q)
      for (int j = 0; j < J; ++j) s[q][j] += load(g + j * kLanes) * f[q * step_i];
  for (int q = 0; q < 4; ++q, out += ld)
    for (int j = 0; j < J; ++j) store(out + j * kLanes, s[q][j]);
}

/// combine() for any depth; more than 6 parameters because kernels take plain pointers.
void multiply(const double* f, std::ptrdiff_t step_i, std::ptrdiff_t step_r, int rows, int depth,
              const double* g, int ldg, int columns, double* out, int ld) {
  for (; rows >= 4; rows -= 4, f += 4 * step_i, out += 4 * static_cast<std::ptrdiff_t>(ld)) {
    int j = 0;
    for (; j + kLanes < columns; j += 2 * kLanes)
      multiply_tile<2>(f, step_i, step_r, depth, g + j, ldg, out + j, ld);
    if (j < columns) multiply_tile<1>(f, step_i, step_r, depth, g + j, ldg, out + j, ld);
  }
  if (rows > 0) combine<0>(f, step_i, step_r, rows, depth, g, ldg, columns, out, ld);
}

// ---- triangularise: with w = x - beta e_k (x: column k from row k on, beta = -sign(x_k) |x|) the
// reflection 1 - w w' / (beta (beta - x_k)) takes x to beta e_k.

struct Reflection {
  const double* column;
  Pack head;      // of w: the pack of row k, 0 above it
  double factor;  // 1 / (beta (beta - x_k))
  int first;      // row of the head
};

template <int J>
inline void reflect(const Reflection& w, int rows, double* a, std::ptrdiff_t stride) {
  Pack sums[J];
  for (int j = 0; j < J; ++j) sums[j] = w.head * load(a + j * stride + w.first);
  for (int r = w.first + kLanes; r < rows; r += kLanes)
    for (int j = 0; j < J; ++j) sums[j] += load(w.column + r) * load(a + j * stride + r);
  double by[J];
  if constexpr (J == 4)
    sum4(sums[0], sums[1], sums[2], sums[3], by);
  else
    for (int j = 0; j < J; ++j) by[j] = sum(sums[j]);
  for (int j = 0; j < J; ++j) {
    by[j] *= w.factor;
    double* const to = a + j * stride + w.first;
    store(to, load(to) - w.head * by[j]);
  }
  for (int r = w.first + kLanes; r < rows; r += kLanes)
    for (int j = 0; j < J; ++j)
      store(a + j * stride + r, load(a + j * stride + r) - load(w.column + r) * by[j]);
}

void triangularise(double* a, int rows, int columns, int first, std::ptrdiff_t stride) {
  for (int k = 0; k < first && k + 1 < rows; ++k) {
    double* x = a + k * stride;
    const int start = k / kLanes * kLanes;
    double head[kLanes];
    for (int r = 0; r < kLanes; ++r) head[r] = start + r > k ? x[start + r] : 0;
    Pack squares = load(head) * load(head);
    for (int r = start + kLanes; r < rows; r += kLanes) squares += load(x + r) * load(x + r);
    const double below = sum(squares);
    if (!(below > 1e-300)) continue;
    const double norm = root(x[k] * x[k] + below), beta = x[k] > 0 ? -norm : norm;
    head[k - start] = x[k] - beta;
    const Reflection w{x, load(head), 1 / (beta * (beta - x[k])), start};
    x[k] = beta;
    int j = k + 1;
    for (; j + 4 <= columns; j += 4) reflect<4>(w, rows, a + j * stride, stride);
    for (; j < columns; ++j) reflect<1>(w, rows, a + j * stride, stride);
  }
}

/// By 1 + W A W = L D L', without roots; more than 6 parameters because kernels take plain
/// pointers.
void add_and_weigh(double* entries, const double* more, const double* width, int n, int lanes,
                   double* work, double* form, double* inverse) {
  const int triangle = n * (n + 1) / 2;
  double* const z = work + triangle * kLanes;  // L^-1 W b
  double* const u = z + n * kLanes;            // the row of L D at hand
  for (int s = 0; s < lanes; s += kLanes, entries += kLanes) {
    Pack sum = {}, product = all(1.0);
    double* row = work;  // of L, and then 1 / D
    double* entry = entries;
    const double* of_sample = more;
    const auto next = [&] {
      const Pack x = load(entry) + *of_sample++;
      store(entry, x);
      entry += lanes;
      return x;
    };
    for (int i = 0; i < n; row += ++i * kLanes) {
      const double* other = work;
      for (int k = 0; k <= i; other += ++k * kLanes) {
        Pack x = next() * (width[i] * width[k]);
        for (int c = 0; c < k; ++c) x -= load(u + c * kLanes) * load(other + c * kLanes);
        if (k < i) {
          store(u + k * kLanes, x);
          store(row + k * kLanes, x * load(other + k * kLanes));
        } else {
          x = 1 / (1 + x);
          store(row + k * kLanes, x);
          product *= x;
        }
      }
    }
    row = work;
    for (int i = 0; i < n; row += ++i * kLanes) {
      Pack x = next() * width[i];
      for (int c = 0; c < i; ++c) x -= load(row + c * kLanes) * load(z + c * kLanes);
      store(z + i * kLanes, x);
      sum += x * x * load(row + i * kLanes);
    }
    store(form + s, sum);
    store(inverse + s, product);
  }
}

void add(double* a, const double* b, std::ptrdiff_t n) {
  std::ptrdiff_t i = 0;
  for (; i + kLanes <= n; i += kLanes) store(a + i, load(a + i) + load(b + i));
  for (; i < n; ++i) a[i] += b[i];
}

}  // namespace

extern const Kernels kKernels;
const Kernels kKernels = {KINCAL_ISA_NAME,
                          gram,
                          gram_of_halves,
                          subtract_product,
                          subtract_columns,
                          cholesky,
                          partial_cholesky,
                          factor_columns,
                          solve_lower,
                          solve_lower_transposed,
                          solve_rows,
                          subtract_block,
                          subtract_products_9x9,
                          expand,
                          multiply,
                          triangularise,
                          add_rows,
                          add_and_weigh,
                          add};

}  // namespace KINCAL_ISA
}  // namespace kincal
