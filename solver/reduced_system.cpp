#include "reduced_system.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <new>

#include "threads.h"

#ifdef KINCAL_CHOLMOD
#include <cholmod.h>
#include <dlfcn.h>
#else
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>
#endif

namespace kincal {

const char* MissingLibrary::what() const noexcept { return text_.c_str(); }

#ifdef KINCAL_CHOLMOD
#define KINCAL_TEXT_OF(x) #x
#define KINCAL_TEXT(x) KINCAL_TEXT_OF(x)

/// CHOLMOD's functions, loaded with the first sparse system: with the BLAS that it brings along
/// loading takes longer than a small calibration's solve.
struct CholmodLibrary {
  void* const library = dlopen("libcholmod.so." KINCAL_TEXT(CHOLMOD_MAIN_VERSION), RTLD_NOW);
#define KINCAL_FUNCTION(name) decltype(&cholmod_##name) const name = load(name, "cholmod_" #name)
  KINCAL_FUNCTION(start);
  KINCAL_FUNCTION(finish);
  KINCAL_FUNCTION(amd);
  KINCAL_FUNCTION(analyze_p);
  KINCAL_FUNCTION(factorize);
  KINCAL_FUNCTION(solve2);
  KINCAL_FUNCTION(free_dense);
  KINCAL_FUNCTION(free_factor);
#undef KINCAL_FUNCTION

  template <class Function>
  Function load(Function, const char* name) const {
    void* const found = library ? dlsym(library, name) : nullptr;
    if (!found)
      throw MissingLibrary(std::string("CHOLMOD, which orders sparse systems, cannot be loaded: ") +
                           dlerror() +
                           ". Install SuiteSparse's libcholmod, or choose the dense solver");
    return reinterpret_cast<Function>(found);
  }
};
static const CholmodLibrary& cholmod_library() {
  static const CholmodLibrary loaded;
  return loaded;
}

struct ReducedSystem::Cholmod {
  const CholmodLibrary& cholmod = cholmod_library();
  cholmod_common common;
  cholmod_sparse matrix{};
  cholmod_factor* factor = nullptr;
  cholmod_dense *x = nullptr, *y = nullptr, *e = nullptr;

  /// `order`: permutation of the columns.
  Cholmod(int n, std::vector<int>& start, std::vector<int>& row, std::vector<int>& order) {
    cholmod.start(&common);
    common.print = 0;
#ifdef KINCAL_SUPERNODAL
    common.supernodal = CHOLMOD_AUTO;
#else
    common.supernodal = CHOLMOD_SIMPLICIAL;
#endif
    common.final_ll = 1;
    common.nmethods = 1;
    common.method[0].ordering = CHOLMOD_GIVEN;
    common.postorder = 1;
    common.quick_return_if_not_posdef = 1;
    matrix = pattern(n, start, row);
    factor = cholmod.analyze_p(&matrix, order.data(), nullptr, 0, &common);
    if (!factor) throw std::bad_alloc();
    matrix.xtype = CHOLMOD_REAL;
  }
  static cholmod_sparse pattern(int n, std::vector<int>& start, std::vector<int>& row) {
    cholmod_sparse m{};
    m.nrow = m.ncol = static_cast<size_t>(n);
    m.nzmax = row.size();
    m.p = start.data();
    m.i = row.data();
    m.stype = -1;
    m.itype = CHOLMOD_INT;
    m.xtype = CHOLMOD_PATTERN;  // no numbers yet
    m.dtype = CHOLMOD_DOUBLE;
    m.sorted = m.packed = 1;
    return m;
  }
  /// Approximate minimum degree of a graph.
  static std::vector<int> amd(int n, std::vector<int>& start, std::vector<int>& row) {
    std::vector<int> order(n);
    const CholmodLibrary& cholmod = cholmod_library();
    cholmod_common c;
    cholmod.start(&c);
    cholmod_sparse m = pattern(n, start, row);
    if (!cholmod.amd(&m, nullptr, 0, order.data(), &c)) throw std::bad_alloc();
    cholmod.finish(&c);
    return order;
  }
  ~Cholmod() {
    cholmod.free_dense(&x, &common);
    cholmod.free_dense(&y, &common);
    cholmod.free_dense(&e, &common);
    cholmod.free_factor(&factor, &common);
    cholmod.finish(&common);
  }
  bool compute(const double* values) {
    matrix.x = const_cast<double*>(values);  // read only
    const bool done = cholmod.factorize(&matrix, factor, &common) != 0;
    if (common.status == CHOLMOD_OUT_OF_MEMORY) throw std::bad_alloc();
    return done && common.status == CHOLMOD_OK && factor->minor == factor->n;
  }
  void solve(double* b) {
    cholmod_dense right{};
    right.nrow = right.d = right.nzmax = matrix.nrow;
    right.ncol = 1;
    right.x = b;
    right.xtype = CHOLMOD_REAL;
    right.dtype = CHOLMOD_DOUBLE;
    if (!cholmod.solve2(CHOLMOD_A, factor, &right, nullptr, &x, nullptr, &y, &e, &common))
      throw std::bad_alloc();
    std::copy_n(static_cast<double*>(x->x), matrix.nrow, b);
  }
};
#else
struct ReducedSystem::Cholmod {
  Eigen::SparseMatrix<double> matrix;
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> factor;

  Cholmod(int n, std::vector<int>& start, std::vector<int>& row, std::vector<int>&) {
    const std::vector<double> ones(row.size(), 1);
    matrix = Eigen::Map<const Eigen::SparseMatrix<double>>(n, n, static_cast<int>(row.size()),
                                                           start.data(), row.data(), ones.data());
    factor.analyzePattern(matrix);
  }
  bool compute(const double* values) {
    std::copy_n(values, matrix.nonZeros(), matrix.valuePtr());
    factor.factorize(matrix);
    return factor.info() == Eigen::Success;
  }
  static std::vector<int> amd(int n, std::vector<int>& start, std::vector<int>& row) {
    const std::vector<double> ones(row.size(), 1);
    const Eigen::Map<const Eigen::SparseMatrix<double>> lower(
        n, n, static_cast<int>(row.size()), start.data(), row.data(), ones.data());
    const Eigen::SparseMatrix<double> whole = lower.selfadjointView<Eigen::Lower>();
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
    Eigen::AMDOrdering<int>()(whole, order);
    return {order.indices().data(), order.indices().data() + n};
  }
  void solve(double* b) {
    Eigen::Map<VectorXd> x(b, matrix.rows());
    x = factor.solve(x).eval();
  }
};
#endif

ReducedSystem::ReducedSystem(int n, const std::vector<GroupShape>& groups, LinearSolver choice,
                             GroupKinds kinds)
    : n_(n), groups_(&groups), kinds_(kinds) {
  find_runs();
  const Work work = place_runs();
  in_blocks_ =
      kinds.ranges &&
      std::all_of(runs_.begin(), runs_.end(), [](const Run& run) { return run.size == 9; }) &&
      std::all_of(groups.begin(), groups.end(),
                  [](const GroupShape& g) { return g.private_size == 3; });
  dense_ =
      choice == LinearSolver::dense || n == 0 || (choice == LinearSolver::automatic && n <= 400);
  RunGraph graph;
  if (!dense_) {
    size_t entries;
    graph = graph_of_runs(entries);
    dense_ =
        choice == LinearSolver::automatic && static_cast<double>(entries) > 0.3 * n * (n + 1.0) / 2;
  }
  if (dense_)
    place_dense(work);
  else
    place_sparse(graph, choice == LinearSolver::cholmod);
}

/// Runs: neighbours that the same groups touch. A group's set of columns is recognised by hashes,
/// summed by column.
void ReducedSystem::find_runs() {
  std::vector<std::uint64_t> touched(n_, 0);
  for (size_t g = 0; g < groups_->size(); ++g) {
    std::uint64_t hash = (g + 1) * 0x9E3779B97F4A7C15ull;
    hash = (hash ^ (hash >> 31)) * 0xBF58476D1CE4E5B9ull;
    hash ^= hash >> 29;
    for (int c : (*groups_)[g].columns) touched[c] += hash;
  }
  for (int c = 0; c < n_; ++c) {
    if (c == 0 || touched[c] != touched[c - 1]) runs_.push_back({c, 0});
    ++runs_.back().size;
  }
  for (const Run& run : runs_)
    for (int q = 0; q < run.size; ++q) {
      diagonal_origin_.push_back(static_cast<std::ptrdiff_t>(diagonal_storage_) - run.first);
      diagonal_storage_ += run.size;
    }
}

/// The groups' runs.
ReducedSystem::Work ReducedSystem::place_runs() {
  std::vector<int> run_of(n_);
  for (size_t r = 0; r < runs_.size(); ++r)
    std::fill_n(run_of.begin() + runs_[r].first, runs_[r].size, static_cast<int>(r));
  Work work;
  group_runs_start_.push_back(0);
  for (const GroupShape& g : *groups_) {
    for (size_t i = 0; i < g.columns.size(); i += runs_[group_runs_.back()].size)
      group_runs_.push_back(run_of[g.columns[i]]);
    group_runs_start_.push_back(static_cast<int>(group_runs_.size()));
    for (size_t i = group_firsts_.size(); i < group_runs_.size(); ++i)
      group_firsts_.push_back(runs_[group_runs_[i]].first);
    work.full += static_cast<double>(g.private_size) * n_ * n_;
    work.touched += static_cast<double>(g.private_size) * g.columns.size() * g.columns.size();
  }
  return work;
}

/// Pattern of the graph of runs, column by column; `entries`: of the matrix.
ReducedSystem::RunGraph ReducedSystem::graph_of_runs(size_t& entries) const {
  const int runs = static_cast<int>(runs_.size());
  RunGraph graph;
  std::vector<std::vector<int>> below(runs);
  for (int r = 0; r < runs; ++r) below[r].push_back(r);
  const auto compress = [](std::vector<int>& column) {
    std::sort(column.begin(), column.end());
    column.erase(std::unique(column.begin(), column.end()), column.end());
  };
  for (size_t g = 0; g < groups_->size(); ++g) {
    if (static_cast<int>(g) == kinds_.priors) continue;
    for (int j = group_runs_start_[g]; j < group_runs_start_[g + 1]; ++j) {
      std::vector<int>& column = below[group_runs_[j]];
      column.insert(column.end(), group_runs_.begin() + j,
                    group_runs_.begin() + group_runs_start_[g + 1]);
      if (column.size() > 4 * static_cast<size_t>(runs) + 64) compress(column);
    }
  }
  entries = 0;
  for (int r = 0; r < runs; ++r) {
    compress(below[r]);
    for (int a : below[r]) entries += static_cast<size_t>(runs_[a].size) * runs_[r].size;
    graph.row.insert(graph.row.end(), below[r].begin(), below[r].end());
    graph.start.push_back(static_cast<int>(graph.row.size()));
  }
  return graph;
}

void ReducedSystem::place_dense(const Work& work) {
  const int runs = static_cast<int>(runs_.size());
  stacks_ = work.touched > 0.4 * work.full;
  if (stacks_) in_blocks_ = false;
  ld_ = padded(n_ + 1) + kSlack;
  for (int j = 0; j < n_; ++j) origin_.push_back(static_cast<std::ptrdiff_t>(j) * ld_);
  step_ = origin_;
  for (int a = 0; in_blocks_ && a < runs; ++a)
    for (int b = 0; b <= a; ++b) blocks_.push_back({a, b, 0});
  place_blocks([](int a, int b) { return a * (a + 1) / 2 + b; });
}

void ReducedSystem::place_sparse(RunGraph& graph, bool cholmod) {
  const int runs = static_cast<int>(runs_.size());
  column_start_.push_back(0);
  for (int r = 0; r < runs; ++r)
    for (int q = 0; q < runs_[r].size; ++q) {
      const int start = static_cast<int>(row_of_.size());
      origin_.push_back(start - (runs_[r].first + q));
      step_.push_back(start - q);
      for (int k = graph.start[r]; k < graph.start[r + 1]; ++k) {
        const Run& a = runs_[graph.row[k]];
        for (int i = graph.row[k] == r ? q : 0; i < a.size; ++i) row_of_.push_back(a.first + i);
      }
      column_start_.push_back(static_cast<int>(row_of_.size()));
    }
  // Where run a begins in the columns of run b, counted as if the diagonal block were whole.
  std::vector<int> begin_of(graph.row.size());
  for (int r = 0; r < runs; ++r)
    for (int k = graph.start[r], at = 0; k < graph.start[r + 1]; ++k) {
      begin_of[k] = at;
      at += runs_[graph.row[k]].size;
    }
  for (int b = 0; in_blocks_ && b < runs; ++b)
    for (int k = graph.start[b]; k < graph.start[b + 1]; ++k)
      blocks_.push_back({graph.row[k], b, begin_of[k]});
  place_blocks([&](int a, int b) {
    return static_cast<int>(std::lower_bound(graph.row.begin() + graph.start[b],
                                             graph.row.begin() + graph.start[b + 1], a) -
                            graph.row.begin());
  });
  for (size_t g = 0; !in_blocks_ && g < groups_->size(); ++g) {
    pair_start_.push_back(pair_places_.size());
    if (static_cast<int>(g) == kinds_.priors) continue;
    for (int b = group_runs_start_[g]; b < group_runs_start_[g + 1]; ++b) {
      const auto begin = graph.row.begin() + graph.start[group_runs_[b]],
                 end = graph.row.begin() + graph.start[group_runs_[b] + 1];
      auto it = begin;
      for (int a = b + 1; a < group_runs_start_[g + 1]; ++a) {
        it = std::lower_bound(it, end, group_runs_[a]);
        pair_places_.push_back(begin_of[it - graph.row.begin()]);
      }
    }
  }
  const std::vector<int> order = Cholmod::amd(runs, graph.start, graph.row);
  if (cholmod) {
    std::vector<int> columns;
    for (const int r : order)
      for (int q = 0; q < runs_[r].size; ++q) columns.push_back(runs_[r].first + q);
    cholmod_ = std::make_unique<Cholmod>(n_, column_start_, row_of_, columns);
    return;
  }
  std::vector<int> first;
  for (const Run& run : runs_) first.push_back(run.first);
  first.push_back(n_);
  std::vector<SparseBlock> blocks;
  for (int b = 0; b < runs; ++b)
    for (int k = graph.start[b]; k < graph.start[b + 1]; ++k)
      blocks.push_back({graph.row[k], b, begin_of[k]});
  fronts_ = std::make_unique<SparseCholesky>(first, blocks, step_, order);
}

ReducedSystem::~ReducedSystem() = default;

template <class BlockOf>
void ReducedSystem::place_blocks(const BlockOf& block_of) {
  for (size_t g = 0; in_blocks_ && g < groups_->size(); ++g) {
    group_blocks_start_.push_back(group_blocks_.size());
    for (int i = group_runs_start_[g]; i < group_runs_start_[g + 1]; ++i)
      for (int j = group_runs_start_[g]; j <= i; ++j)
        group_blocks_.push_back(block_of(group_runs_[i], group_runs_[j]));
  }
}

void ReducedSystem::subtract_blocks(int group, const double* b, std::ptrdiff_t stride,
                                    double* blocks, double* gradient) const {
  const int first = group_runs_start_[group];
  kernels().subtract_products_9x9(blocks, group_blocks_.data() + group_blocks_start_[group],
                                  group_firsts_.data() + first,
                                  group_runs_start_[group + 1] - first, b, stride, gradient);
}

void ReducedSystem::put_blocks(double* values, const double* const* sums, int count,
                               Part part) const {
  const size_t last = blocks_.size() * (part.index + 1) / part.of;
  for (size_t k = blocks_.size() * part.index / part.of; k < last; ++k) {
    const Block& block = blocks_[k];
    const int first = runs_[block.column].first,
              below = dense_ ? runs_[block.row].first : block.place;
    double sum[kBlockStorage9x9];
    std::copy_n(sums[0] + k * kBlockStorage9x9, 81, sum);
    for (int s = 1; s < count; ++s)
      for (int i = 0; i < 81; ++i) sum[i] += sums[s][k * kBlockStorage9x9 + i];
    for (int q = 0; q < 9; ++q) {
      double* to = values + step_[first + q] + below;
      for (int i = block.row == block.column ? q : 0; i < 8; ++i) to[i] = sum[8 * q + i];
      to[8] = sum[72 + q];
    }
  }
}

void ReducedSystem::add(int group, const double* block, int ld, double* values) const {
  const int* place = pair_places_.data() + pair_start_[group];
  const int first = group_runs_start_[group], last = group_runs_start_[group + 1];
  for (int b = first, column = 0; b < last; column += runs_[group_runs_[b++]].size)
    for (int a = b, row = column; a < last; row += runs_[group_runs_[a++]].size) {
      const Run &ra = runs_[group_runs_[a]], &rb = runs_[group_runs_[b]];
      const int at = a == b ? 0 : *place++;
      for (int q = 0; q < rb.size; ++q)
        for (int i = a == b ? q : 0; i < ra.size; ++i)
          values[step_[rb.first + q] + at + i] +=
              block[row + i + static_cast<size_t>(column + q) * ld];
    }
}

void ReducedSystem::subtract(int group, const double* b, int depth, std::ptrdiff_t stride,
                             double* values, double* gradient) const {
  const Kernels& kernel = kernels();
  const int* place = dense_ ? nullptr : pair_places_.data() + pair_start_[group];
  const int first = group_runs_start_[group], last = group_runs_start_[group + 1];
  const int m = static_cast<int>((*groups_)[group].columns.size());
  const std::ptrdiff_t none = 0;
  for (int j = first, column = 0; j < last; column += runs_[group_runs_[j++]].size) {
    const Run& rj = runs_[group_runs_[j]];
    kernel.subtract_block(gradient + rj.first, &none, b + column, rj.size, b + m, 1, depth, stride);
    const std::ptrdiff_t* step = step_.data() + rj.first;
    // The diagonal block column by column: above the diagonal a sparse array has the numbers of
    // others.
    double* corner = values + (dense_ ? rj.first : 0);
    for (int q = 0; q < rj.size; ++q)
      kernel.subtract_block(corner + q, step + q, b + column + q, rj.size - q, b + column + q, 1,
                            depth, stride);
    for (int i = j + 1, row = column + rj.size; i < last; row += runs_[group_runs_[i++]].size) {
      const Run& ri = runs_[group_runs_[i]];
      kernel.subtract_block(values + (dense_ ? ri.first : *place++), step, b + row, ri.size,
                            b + column, rj.size, depth, stride);
    }
  }
}

void ReducedSystem::accumulate(double* to, const double* from) const {
  if (!dense_) return kernels().add(to, from, static_cast<std::ptrdiff_t>(row_of_.size()));
  for (int j = 0; j < n_; ++j)
    kernels().add(to + origin_[j] + j, from + origin_[j] + j, n_ + 1 - j);
}

void ReducedSystem::clear(double* values) const {
  if (!dense_) std::fill_n(values, storage(), 0.0);
  for (int j = 0; dense_ && j < n_; ++j) std::fill_n(values + origin_[j] + j, n_ + 1 - j, 0.0);
}

void ReducedSystem::add_diagonal_blocks(double* values, const double* blocks) const {
  for (const Run& run : runs_)
    for (int j = run.first; j < run.first + run.size; ++j)
      for (int i = j; i < run.first + run.size; ++i)
        values[origin_[j] + i] += blocks[diagonal_origin_[j] + i];
}

MatrixXd ReducedSystem::full(const double* values) const {
  MatrixXd m = MatrixXd::Zero(n_, n_);
  for (int j = 0; j < n_; ++j)
    if (dense_)
      for (int i = j; i < n_; ++i) m(i, j) = values[origin_[j] + i];
    else
      for (int k = column_start_[j]; k < column_start_[j + 1]; ++k) m(row_of_[k], j) = values[k];
  return m.selfadjointView<Eigen::Lower>();
}

/// Columns from which on a pool saves more than it costs to call it once a strip.
constexpr int kShared = 300;

/// Kernels::cholesky() by a pool, which shares the columns behind each strip: the same bits. Who
/// has the next strip's columns factors them at once, while the others are at work on the rest.
static bool factor_together(double* a, int n, int ld, ThreadPool& pool) {
  bool definite = kernels().factor_columns(a, n, std::min(kStrip, n), ld);
  for (int strip = 0; definite && strip + kStrip < n; strip += kStrip) {
    double* corner = a + strip * (static_cast<std::ptrdiff_t>(ld) + 1);
    pool.run((n - strip - 1) / kStrip, ThreadPool::kMostShares, [&](int piece, int) {
      const int first = (piece + 1) * kStrip, rows = n - strip - first,
                columns = std::min(kStrip, rows);
      double* block = corner + first * (static_cast<std::ptrdiff_t>(ld) + 1);
      kernels().subtract_columns(block, rows, columns, ld, corner + first, kStrip, ld);
      if (piece == 0) definite = kernels().factor_columns(block, rows, columns, ld);
    });
  }
  return definite;
}

bool ReducedSystem::factor(double* values, ThreadPool& pool) {
  if (dense_)
    return n_ > kShared && pool.size() > 1 ? factor_together(values, n_, ld_, pool)
                                           : kernels().cholesky(values, n_, ld_);
  return fronts_ ? fronts_->factor(values) : cholmod_->compute(values);
}

void ReducedSystem::solve(const double* factored, double* b) {
  if (fronts_) return fronts_->solve(b);
  if (cholmod_) return cholmod_->solve(b);
  kernels().solve_lower(factored, n_, ld_, b);
  kernels().solve_lower_transposed(factored, n_, ld_, b);
}

}  // namespace kincal
