#include "view_kernels.h"

#include "../../solver/kernels.h"

namespace kincal {

namespace baseline {
extern const ViewKernels kViewKernels;
}
#ifdef KINCAL_X86_SETS
namespace avx2 {
extern const ViewKernels kViewKernels;
}
namespace avx512 {
extern const ViewKernels kViewKernels;
}
#endif

const ViewKernels& view_kernels(int set) {
#ifdef KINCAL_X86_SETS
  if (set == 2) return avx512::kViewKernels;
  if (set == 1) return avx2::kViewKernels;
#endif
  (void)set;
  return baseline::kViewKernels;
}

const ViewKernels& view_kernels() { return view_kernels(instruction_set()); }

}  // namespace kincal
