// Packs of doubles as wide as the instruction set of the file that includes this. For the files
// that are compiled once for each instruction set (CMakeLists.txt,
// kincal_for_each_instruction_set): everything stands in a namespace named after the set, and no
// Eigen and no standard algorithm may be included there, so that no function compiled for a new
// processor can be taken by the linker for use on an old one.
#pragma once

#ifndef KINCAL_ISA
#error "for files that are compiled once for each instruction set"
#endif

namespace kincal {
namespace KINCAL_ISA {

#if defined(__AVX512F__)
constexpr int kLanes = 8;
#elif defined(__AVX__)
constexpr int kLanes = 4;
#else  // also NEON
constexpr int kLanes = 2;
#endif

/// How many packs the processor's registers hold.
#if defined(__AVX512F__) || defined(__aarch64__)
constexpr int kRegisters = 32;
#else
constexpr int kRegisters = 16;
#endif

typedef double Pack __attribute__((vector_size(8 * kLanes)));
typedef double LoosePack __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));

static inline Pack load(const double* p) { return *reinterpret_cast<const LoosePack*>(p); }
static inline void store(double* p, Pack x) { *reinterpret_cast<LoosePack*>(p) = x; }
static inline Pack all(double x) { return x - Pack{}; }

/// Moves lane j of row i to lane i of row j.
static inline void transpose(Pack* r) {
#if defined(__AVX512F__)
  Pack t[8], u[8];
  for (int k = 0; k < 8; k += 2) {
    t[k] = __builtin_shufflevector(r[k], r[k + 1], 0, 8, 2, 10, 4, 12, 6, 14);
    t[k + 1] = __builtin_shufflevector(r[k], r[k + 1], 1, 9, 3, 11, 5, 13, 7, 15);
  }
  for (int k = 0; k < 8; k += 4)
    for (int i = 0; i < 2; ++i) {
      u[k + i] = __builtin_shufflevector(t[k + i], t[k + i + 2], 0, 1, 8, 9, 4, 5, 12, 13);
      u[k + i + 2] = __builtin_shufflevector(t[k + i], t[k + i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  for (int k = 0; k < 4; ++k) {
    r[k] = __builtin_shufflevector(u[k], u[k + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    r[k + 4] = __builtin_shufflevector(u[k], u[k + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
#elif defined(__AVX__)
  Pack t[4];
  for (int k = 0; k < 4; k += 2) {
    t[k] = __builtin_shufflevector(r[k], r[k + 1], 0, 4, 2, 6);
    t[k + 1] = __builtin_shufflevector(r[k], r[k + 1], 1, 5, 3, 7);
  }
  for (int k = 0; k < 2; ++k) {
    r[k] = __builtin_shufflevector(t[k], t[k + 2], 0, 1, 4, 5);
    r[k + 2] = __builtin_shufflevector(t[k], t[k + 2], 2, 3, 6, 7);
  }
#else
  const Pack t = __builtin_shufflevector(r[0], r[1], 0, 2);
  r[1] = __builtin_shufflevector(r[0], r[1], 1, 3);
  r[0] = t;
#endif
}

/// Returns the sum of the lanes.
static inline double sum(Pack x) {
#if defined(__AVX512F__)
  typedef double Half __attribute__((vector_size(32)));
  const Half h =
      __builtin_shufflevector(x, x, 0, 1, 2, 3) + __builtin_shufflevector(x, x, 4, 5, 6, 7);
  return (h[0] + h[2]) + (h[1] + h[3]);
#elif defined(__AVX__)
  return (x[0] + x[2]) + (x[1] + x[3]);
#else
  return x[0] + x[1];
#endif
}

/// Writes the sums of the lanes of four packs.
static inline void sum4(Pack a, Pack b, Pack c, Pack d, double* out) {
#if defined(__AVX__)
  typedef double Quad __attribute__((vector_size(32)));
#if defined(__AVX512F__)
  const Quad qa =
      __builtin_shufflevector(a, a, 0, 1, 2, 3) + __builtin_shufflevector(a, a, 4, 5, 6, 7);
  const Quad qb =
      __builtin_shufflevector(b, b, 0, 1, 2, 3) + __builtin_shufflevector(b, b, 4, 5, 6, 7);
  const Quad qc =
      __builtin_shufflevector(c, c, 0, 1, 2, 3) + __builtin_shufflevector(c, c, 4, 5, 6, 7);
  const Quad qd =
      __builtin_shufflevector(d, d, 0, 1, 2, 3) + __builtin_shufflevector(d, d, 4, 5, 6, 7);
#else
  const Quad qa = a, qb = b, qc = c, qd = d;
#endif
  const Quad ab =
      __builtin_shufflevector(qa, qb, 0, 4, 2, 6) + __builtin_shufflevector(qa, qb, 1, 5, 3, 7);
  const Quad cd =
      __builtin_shufflevector(qc, qd, 0, 4, 2, 6) + __builtin_shufflevector(qc, qd, 1, 5, 3, 7);
  const Quad s =
      __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
  out[0] = s[0], out[1] = s[1], out[2] = s[2], out[3] = s[3];
#else
  out[0] = sum(a), out[1] = sum(b), out[2] = sum(c), out[3] = sum(d);
#endif
}

}  // namespace KINCAL_ISA
}  // namespace kincal
