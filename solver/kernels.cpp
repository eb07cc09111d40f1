#include "kernels.h"

#include <cstdlib>
#include <cstring>

namespace kincal {

namespace baseline {
extern const Kernels kKernels;
}
#ifdef KINCAL_X86_SETS
namespace avx2 {
extern const Kernels kKernels;
}
namespace avx512 {
extern const Kernels kKernels;
}
#endif

namespace {

/// The best instruction set of this processor: 0 baseline, 1 avx2, 2 avx512.
int best() {
#ifdef KINCAL_X86_SETS
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return 0;
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                 __builtin_cpu_supports("avx512vl")
             ? 2
             : 1;
#else
  return 0;
#endif
}

#ifdef KINCAL_X86_SETS
const Kernels* const kSets[] = {&baseline::kKernels, &avx2::kKernels, &avx512::kKernels};
#else
const Kernels* const kSets[] = {&baseline::kKernels};
#endif

int choose() {
  const int most = best();
  const char* wanted = std::getenv("KINCAL_ISA");
  for (int set = 0; wanted && set < most; ++set)
    if (std::strcmp(wanted, kSets[set]->name) == 0) return set;
  return most;
}

}  // namespace

int instruction_set() {
  static const int set = choose();
  return set;
}

const Kernels& kernels() { return *kSets[instruction_set()]; }

const Kernels* const* all_kernels(int& count) {
  count = best() + 1;
  return kSets;
}

}  // namespace kincal
