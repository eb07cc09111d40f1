// The dense inner loops of the solver on plain pointers, compiled for several instruction sets and
// chosen at run time.
//
// Nothing here allocates. Arrays are column-major with leading dimension `ld` unless said
// otherwise. Vector code works in packs of up to 8 numbers and may read and overwrite up to kSlack
// numbers behind what it is given: rows n .. n + kSlack - 1 of each column must exist (ld >= n +
// kSlack, or the next array's slack), what is in them does not matter. Results differ in the last
// bits between instruction sets (fused multiply-add), never between runs or numbers of threads.
#pragma once

#include <cstddef>

namespace kincal {

constexpr int kSlack = 8;
constexpr int kStrip = 48;  // columns that Cholesky's factorisation multiplies at once

/// A block of 9 x 9 has this many numbers: it is padded so that it fills whole cache lines.
constexpr int kBlockStorage9x9 = 88;

/// Columns of a tile of gram() where it knows of halves.
constexpr int kTile = 4;

/// Returns n rounded up to a multiple of 8.
constexpr int padded(int n) { return (n + 7) & ~7; }

struct Kernels {
  const char* name;

  /// Computes g = L'L (w x w, both triangles, leading dimension ld) of w columns of `rows` numbers
  /// (a multiple of 8), `stride` apart.
  void (*gram)(const double* columns, int rows, std::ptrdiff_t stride, int w, double* g, int ld);

  /// The same where of the rows columns `at` and at + 1 are zero in the second half and the next
  /// two in the first: half of their products are left out, if `at` suits the tiles.
  void (*gram_of_halves)(const double* columns, int rows, std::ptrdiff_t stride, int w, int at,
                         double* g, int ld);

  /// Computes C -= A A' on the lower triangle of C (n x n): A is n x depth, column-major, lda >= n
  /// + kSlack or slack behind its last column. What is above the diagonal of C is scratch.
  void (*subtract_product)(double* c, int n, int ldc, const double* a, int depth,
                           std::ptrdiff_t lda);

  /// The same for the first `columns` columns of C only.
  void (*subtract_columns)(double* c, int n, int columns, int ldc, const double* a, int depth,
                           std::ptrdiff_t lda);

  /// Replaces the lower triangle by its Cholesky factor L; the diagonal then holds 1 / L(i, i).
  /// False if it is not positive definite to rounding.
  bool (*cholesky)(double* a, int n, int ld);
  /// The same for the first `columns` columns only, [L11; L21]; from the triangle behind them it
  /// subtracts L21 L21'. What is above the diagonal there is scratch.
  bool (*partial_cholesky)(double* a, int n, int columns, int ld);
  /// [L11; L21] alone, of at most kStrip columns: the triangle behind them stays.
  /// partial_cholesky() is this strip after strip, and the products of each subtracted from all
  /// that is behind it.
  bool (*factor_columns)(double* a, int n, int columns, int ld);
  /// These compute b <- L^-1 b and b <- L^-T b with such a factor (b has slack).
  void (*solve_lower)(const double* factor, int n, int ld, double* b);
  void (*solve_lower_transposed)(const double* factor, int n, int ld, double* b);

  /// Computes B <- L^-1 B with such a factor: B is n x width, row-major, rows `stride` >=
  /// padded(width) apart.
  void (*solve_rows)(const double* factor, int n, int ld, double* b, int width,
                     std::ptrdiff_t stride);

  /// Computes d -= sum_k a_k b_k': d has `columns` columns of `rows` numbers, column q at d +
  /// step[q]; a_k(row) = a[k stride + row], b_k(q) = b[k stride + q]. Writes exactly `rows` numbers
  /// a column.
  void (*subtract_block)(double* d, const std::ptrdiff_t* step, const double* a, int rows,
                         const double* b, int columns, int depth, std::ptrdiff_t stride);

  /// Eliminates a point seen by cameras of 9 numbers: with B = [B_0 .. B_runs-1 | b] (3 rows,
  /// `stride` apart, 9 columns a run), block -= B_i' B_j for the runs' pairs i >= j, and gradient
  /// -= B_i' b at first[i] .. + 8. `block` has the blocks' numbers pair after pair, for i, for j <=
  /// i. A block has kBlockStorage9x9 numbers: rows 0-7 column after column, then row 8.
  void (*subtract_products_9x9)(double* blocks, const int* block, const int* first, int runs,
                                const double* b, std::ptrdiff_t stride, double* gradient);

  /// Computes product = M' G and the upper triangle of out = M' G M: G (width x width, both
  /// triangles, ldg >= padded(width)), of which the first k rows count; M (k x columns), product
  /// (columns x width) and out (columns x columns; what is below the diagonal is scratch)
  /// row-major, rows at least padded(columns) or padded(width) apart.
  void (*expand)(const double* g, int ldg, int width, const double* m, int ldm, int k, int columns,
                 double* product, int ldp, double* out, int ld);

  /// Computes out = F G: F (rows x depth) has entry (i, r) at f[i step_i + r step_r], G (depth x
  /// columns) and out (rows x columns) are row-major, ldg and ld >= columns + kSlack apart.
  void (*multiply)(const double* f, std::ptrdiff_t step_i, std::ptrdiff_t step_r, int rows,
                   int depth, const double* g, int ldg, int columns, double* out, int ld);

  /// Reflects `columns` columns of `rows` numbers (a multiple of 8), `stride` apart, so that the
  /// first `first` of them become an upper triangle (Householder's reflections): their Gram matrix
  /// stays. With all of them reflected an upper triangle is left. What is below the diagonal of
  /// the first ones is scratch afterwards.
  void (*triangularise)(double* a, int rows, int columns, int first, std::ptrdiff_t stride);

  /// Adds B (rows x columns) to A, both row-major with rows at least padded(columns) apart; with
  /// `upper` the upper triangle, what is below the diagonal of A is scratch then.
  void (*add_rows)(double* a, int lda, const double* b, int ldb, int rows, int columns, bool upper);

  /// Of `lanes` systems side by side (a multiple of 8) adds `more` to A (n x n, its lower triangle
  /// row after row) and b: of each of these entries there is one number a lane. With W =
  /// diag(width) leaves form = b'(A + W^-2)^-1 b and inverse = 1 / |1 + W A W| of each. `work` has
  /// room for 8 times the entries and 8 n.
  void (*add_and_weigh)(double* entries, const double* more, const double* width, int n, int lanes,
                        double* work, double* form, double* inverse);

  /// Adds b to a.
  void (*add)(double* a, const double* b, std::ptrdiff_t n);
};

/// Returns the kernels for this processor. The environment variable KINCAL_ISA (baseline, avx2,
/// avx512) lowers the instruction set, for tests and comparisons; any other value of it is ignored.
/// On arm64 the only set is neon, which every processor has.
const Kernels& kernels();
/// Returns all kernels that this processor can run, `count` of them, the plainest first; for tests.
const Kernels* const* all_kernels(int& count);
/// Returns the instruction set that kernels() chose: 0 baseline (on arm64: neon), 1 avx2, 2 avx512.
int instruction_set();

}  // namespace kincal
